// SPDX-License-Identifier: Apache-2.0
#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "src/base/str.h"
#include "src/deform/deform_file.h"
#include "src/format/ply.h"
#include "src/splat/constants.h"
#include "src/train/background.h"
#include "src/train/driver.h"
#include "tools/lab/lab.h"
#include "tools/lab/model_formats.h"
#include "tools/lab/sequence.h"

// --- the model file ------------------------------------------------------------------------------

static sv_status fill(lab_model *m, const char *path, sv_ply *ply, sv_err *err) {
  size_t bytes = sv_gaussians_bytes((int)ply->n, ply->sh_degree) + SV_ARENA_ALIGN;
  m->block = malloc(bytes);
  if (!m->block) return sv_fail(err, SV_E_NOMEM, "%s: no memory for its %u Gaussians", path, ply->n);
  sv_arena a = sv_arena_make(m->block, bytes);
  sv_status s = sv_gaussians_init(&m->g, (int)ply->n, ply->sh_degree, &a);
  if (s != SV_OK) return sv_fail(err, s, "%s: cannot hold %u Gaussians", path, ply->n);
  for (uint32_t i = 0; i < ply->n; i++) {
    sv_gaussian g;
    s = sv_ply_read_gaussian(ply, i, &g, err);
    if (s != SV_OK) return s;
    sv_gaussians_put(&m->g, (int)i, &g);
  }
  m->is_mip = ply->is_mip;
  m->dilation_px2 = ply->dilation_px2;
  memcpy(m->up, ply->up, sizeof m->up);
  m->unit = ply->unit;
  m->background = ply->background;
  return SV_OK;
}

static sv_status motion_path(char out[SV_CAP_PATH], const char *model_path, sv_err *err) {
  char folder[SV_CAP_PATH];
  sv_path_folder(folder, sizeof folder, model_path);
  return sv_path_join(out, SV_CAP_PATH, folder, "motion.bin", err);
}

static sv_status take_motion(lab_model *m, const sv_deform_file *f, sv_err *err) {
  sv_arena dry = sv_arena_dry();
  sv_deform *d = malloc(sizeof *d);
  sv_status s = d ? sv_deform_carve(d, &f->head, &m->g, SV_LINUX_CAP_THREADS, &dry) : SV_E_NOMEM;
  size_t bytes = dry.used_bytes + SV_ARENA_ALIGN;
  free(d);
  if (s != SV_OK) return sv_fail(err, s, "%s: invalid sizes", f->sections.name);
  if (!(m->deform_block = malloc(bytes)))
    return sv_fail(err, SV_E_NOMEM, "%s: no memory for its motion", f->sections.name);
  sv_arena a = sv_arena_make(m->deform_block, bytes);
  return sv_deform_read(&m->deform, f, &m->g, SV_LINUX_CAP_THREADS, &a, err);
}

static sv_status lab_motion_read(lab_model *m, const char *model_path, sv_err *err) {
  char path[SV_CAP_PATH];
  void *data;
  size_t bytes;
  sv_deform_file f;
  sv_status s = motion_path(path, model_path, err);
  if (s != SV_OK || !sv_path_exists(path)) return s;
  if ((s = sv_file_read(path, &data, &bytes, err)) != SV_OK) return s;
  s = sv_deform_open(&f, &(sv_file_data){path, data, bytes}, err);
  if (s == SV_OK) s = take_motion(m, &f, err);
  free(data);
  return s;
}

sv_status lab_motion_begin(sv_file *f, const sv_deform *d, const sv_gaussians *g, const char *model_path,
                           sv_err *err) {
  char path[SV_CAP_PATH];
  sv_file_init(f);
  sv_status s = motion_path(path, model_path, err);
  if (s == SV_OK) s = sv_file_begin(f, path, err);
  return s == SV_OK ? sv_deform_write(d, g, (sv_sink){f, sv_file_append}, err) : s;
}

sv_status lab_motion_remove(const char *model_path, sv_err *err) {
  char path[SV_CAP_PATH];
  sv_status s = motion_path(path, model_path, err);
  if (s == SV_OK && unlink(path) != 0 && errno != ENOENT)
    return sv_fail(err, SV_E_IO, "%s: cannot be removed: %s", path, sv_linux_reason(errno));
  return s;
}

sv_status lab_model_read(lab_model *m, const char *path, sv_err *err) {
  void *data;
  size_t bytes;
  sv_ply ply;
  memset(m, 0, sizeof *m);
  sv_status s = sv_file_read(path, &data, &bytes, err);
  if (s != SV_OK) return s;
  if (lab_is_sequence(data, bytes)) {
    s = lab_read_sequence(m, &(sv_file_data){path, data, bytes}, err);
    if (s != SV_OK) free(data);
    if (s != SV_OK) lab_model_free(m);
    else m->digest = sv_gaussians_digest(&m->g);
    return s;
  }
  bool is_ply = !lab_is_viewer_format(path, data, bytes);
  sv_model_notes notes = {.is_mip = false};
  if (!is_ply) s = lab_read_viewer_format(&m->g, &notes, &m->block, &(sv_file_data){path, data, bytes}, err);
  else s = sv_ply_open(&ply, path, data, bytes, err);
  if (is_ply && s == SV_OK && ply.kind != SV_PLY_GAUSSIANS)
    s = sv_fail(err, SV_E_FORMAT,
                "%s: is a point cloud; expected a model with scale_0, rot_0, opacity and f_dc_0", path);
  if (is_ply && s == SV_OK && (ply.n < 1 || ply.n > 4000000))
    s = sv_fail(err, SV_E_RANGE, "%s: %u Gaussians; expected 1 to 4000000", path, ply.n);
  if (is_ply && s == SV_OK) s = fill(m, path, &ply, err);
  free(data);
  if (s != SV_OK) {
    lab_model_free(m);
    return s;
  }
  if (!is_ply) {
    m->is_mip = notes.is_mip;
    m->unit = notes.unit;
  }
  if (is_ply)
    // other formats are still: what moves beside them is another model
    s = lab_motion_read(m, path, err);
  m->digest = sv_gaussians_digest(&m->g); // as sv_train_digest
  if (m->deform.kind != SV_DEFORM_NONE) m->digest = sv_dynamic_digest(&m->deform, m->digest);
  if (s != SV_OK) lab_model_free(m);
  return s;
}

void lab_model_free(lab_model *m) {
  free(m->block);
  free(m->deform_block);
  lab_sequence_free(m->sequence);
  memset(m, 0, sizeof *m);
}

lab_motion lab_model_motion(lab_model *m) {
  return (lab_motion){.deform = m->deform.kind ? &m->deform : NULL, .sequence = m->sequence};
}

sv_status lab_motion_at(const lab_motion *m, const lab_session *s, sv_gaussians *g, float t, sv_err *err) {
  if (m->sequence) return lab_sequence_at(m->sequence, g, t, err);
  if (m->deform) sv_deform_at(m->deform, &(sv_compute){&s->k, &s->pool}, g, t);
  return SV_OK;
}

sv_model_notes lab_model_notes(const lab_model *m) {
  return (sv_model_notes){.is_mip = m->is_mip,
                          .dilation_px2 = m->dilation_px2,
                          .up = m->up[0] ? m->up : NULL,
                          .unit = m->unit,
                          .background = m->background};
}

sv_status lab_model_begin(sv_file *f, const sv_gaussians *g, const sv_model_notes *notes, const char *path,
                          sv_err *err) {
  sv_ply_writer w;
  sv_status s = sv_file_begin(f, path, err);
  return s == SV_OK ? sv_model_write_ply(g, notes, (sv_sink){f, sv_file_append}, &w, err) : s;
}

sv_status lab_model_write(const sv_gaussians *g, const sv_model_notes *notes, const char *path, sv_err *err) {
  sv_file f;
  sv_status s = lab_model_begin(&f, g, notes, path, err);
  if (s == SV_OK) return sv_file_commit(&f, err);
  sv_file_abandon(&f);
  return s;
}

// --- the settings beside it ----------------------------------------------------------------------

sv_background lab_background_by_name(const char *name) {
  for (int i = 0; i < 3; i++)
    if (name && sv_str_eq(name, sv_background_name((sv_background)i))) return (sv_background)i;
  return SV_BG_BLACK;
}

lab_settings lab_settings_default(void) { return (lab_settings){.scale = 1, .background = SV_BG_BLACK}; }

static sv_status get_float(const sv_json *j, const char *key, float *out, sv_err *err) {
  double v = (double)*out;
  sv_status s = sv_json_get_double(j, 0, key, &v, err);
  if (s == SV_OK && !(v >= 0 && v < 1e12))
    return sv_json_fail(j, sv_json_get(j, 0, key), err, SV_E_RANGE, "%g is not usable", v);
  *out = (float)v;
  return s < 0 ? s : SV_OK;
}

static sv_status settings_parse(lab_settings *st, const sv_json *j, sv_err *err) {
  char name[16] = "";
  long long scale = st->scale, n_exposures = 0;
  double c[3];
  if (!sv_json_is_object(j, 0)) return sv_json_fail(j, 0, err, SV_E_FORMAT, "expected an object");
  sv_status s = sv_json_get_string(j, 0, "background", name, sizeof name, err);
  if (s >= 0) s = sv_json_get_int(j, 0, "scale", (sv_json_range){1, 64}, &scale, err);
  if (s >= 0) s = sv_json_get_int(j, 0, "exposures", (sv_json_range){1, 1000000}, &n_exposures, err);
  if (s >= 0) s = sv_json_get_string(j, 0, "transforms", st->transforms, sizeof st->transforms, err);
  if (s >= 0) s = sv_json_get_string(j, 0, "refined_poses", st->refined, sizeof st->refined, err);
  int i = sv_json_get(j, 0, "antialiased"), k = sv_json_get(j, 0, "scene_centre");
  if (s >= 0 && i >= 0) s = sv_json_bool(j, i, &st->is_antialiased, err);
  if (s >= 0) s = get_float(j, "dilation_px2", &st->dilation_px2, err);
  if (s >= 0) s = get_float(j, "near_z", &st->near_z, err);
  if (s >= 0) s = get_float(j, "scene_radius", &st->radius, err);
  if (s >= 0 && get_float(j, "psnr", &st->psnr, err) < 0) st->psnr = 0; // null: no views
  if (s >= 0 && k >= 0 && (s = sv_json_doubles(j, k, c, 3, err)) == SV_OK)
    for (int d = 0; d < 3; d++) st->centre[d] = (float)c[d];
  st->background = lab_background_by_name(name);
  st->scale = (int)scale;
  st->n_exposures = (int)n_exposures;
  return s < 0 ? s : SV_OK;
}

static sv_status run_parse(lab_settings *st, const sv_json *j, sv_err *err) {
  const sv_status s = get_float(j, "train_psnr", &st->psnr, err);
  return s < 0 ? s : SV_OK;
}

typedef sv_status parse(lab_settings *st, const sv_json *j, sv_err *err);

static sv_status read_report(lab_settings *out, const char *path, parse *with, sv_err *err) {
  void *text;
  size_t bytes;
  int n_tok;
  sv_json j;
  sv_status s = sv_file_read(path, &text, &bytes, err);
  if (s != SV_OK) return s;
  jsmntok_t *tok = NULL;
  s = sv_json_count(path, text, bytes, &n_tok, err);
  if (s == SV_OK && !(tok = malloc(((size_t)n_tok + 1) * sizeof *tok)))
    s = sv_fail(err, SV_E_NOMEM, "%s: no memory for its %d JSON tokens", path, n_tok);
  if (s == SV_OK) s = sv_json_parse(&j, &(sv_file_data){path, text, bytes}, tok, n_tok, err);
  if (s == SV_OK) s = with(out, &j, err);
  free(tok);
  free(text);
  return s;
}

sv_status lab_settings_read(lab_settings *out, const char *model_path, sv_err *err) {
  char folder[SV_CAP_PATH], path[SV_CAP_PATH];
  sv_path_folder(folder, sizeof folder, model_path);
  sv_status s = sv_path_join(path, sizeof path, folder, "run.json", err);
  if (s == SV_OK && sv_path_exists(path) && read_report(out, path, run_parse, err) != SV_OK) out->psnr = 0;
  if (s == SV_OK) s = sv_path_join(path, sizeof path, folder, "train.json", err);
  if (s != SV_OK || !sv_path_exists(path)) return s;
  s = read_report(out, path, settings_parse, err);
  sv_copy(out->told_by, sizeof out->told_by, path);
  if (s == SV_OK && *out->refined) {
    sv_copy(path, sizeof path, sv_path_name(out->refined));
    s = sv_path_join(out->refined, sizeof out->refined, folder, path, err);
  }
  return s;
}

sv_status lab_settings_for(lab_settings *st, const lab_options *o, const lab_model *m, sv_err *err) {
  *st = lab_settings_default();
  st->is_antialiased = m->is_mip;
  st->dilation_px2 = m->dilation_px2;
  sv_status s = lab_settings_read(st, o->model, err);
  if (s != SV_OK) return s;
  if (st->background == SV_BG_BLACK && m->background) {
    st->background = SV_BG_OF_PICTURES;
    st->color = m->background;
  }
  if (o->background) st->background = lab_background_by_name(o->background);
  if (o->scale > 0) st->scale = (int)o->scale;
  if (o->transforms && !sv_copy(st->transforms, sizeof st->transforms, o->transforms))
    return sv_fail(err, SV_E_RANGE, "the name given with --transforms is longer than %zu bytes",
                   sizeof st->transforms);
  if (o->transforms) st->told_by[0] = st->refined[0] = 0;
  if (st->near_z > 0 && st->radius > 0) return SV_OK;
  size_t bytes = (size_t)m->g.n * sizeof(float) + 2 * SV_ARENA_ALIGN;
  void *block = malloc(bytes);
  if (!block) return sv_fail(err, SV_E_NOMEM, "no memory to measure %d Gaussians", m->g.n);
  sv_arena a = sv_arena_make(block, bytes);
  float centre[3], radius = sv_gaussians_radius(&m->g, &a, centre);
  free(block);
  if (!(st->radius > 0)) {
    st->radius = radius;
    memcpy(st->centre, centre, sizeof centre);
  }
  if (!(st->near_z > 0)) st->near_z = SV_NEAR_FRACTION * st->radius;
  return SV_OK;
}

sv_render_options lab_render_options(const lab_settings *st, int sh_degree, bool has_depth) {
  sv_render_options o = {.sh_degree = sh_degree,
                         .near_z = st->near_z,
                         .is_antialiased = st->is_antialiased,
                         .dilation_px2 = st->dilation_px2,
                         .has_depth = has_depth};
  sv_train_background_color(st->background, st->color, o.bg);
  return o;
}
