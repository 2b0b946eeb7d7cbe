// SPDX-License-Identifier: Apache-2.0
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/str.h"
#include "src/base/vec.h"
#include "src/format/axes.h"
#include "tools/lab/export_html.h"
#include "tools/lab/export_sog.h"
#include "tools/lab/lab.h"
#include "tools/lab/model_formats.h"
#include "tools/lab/sequence.h"
#include "tools/pictures/orbit.h"
#include "tools/pictures/supported.h"
#include "tools/train/support_mask.h"

// The up axis that a file of this format has where it is opened; NULL: that of the model. SPZ and
// GLB say theirs, and their writers turn the model.
static const char *up_of_viewer(const lab_options *o) {
  if (sv_str_eq(o->format, "spz") || sv_str_eq(o->format, "glb")) return NULL;
  if (o->viewer) return sv_str_eq(o->viewer, "blender") ? "z" : SV_UP_DEFAULT;
  const bool is_playcanvas = sv_str_eq(o->format, "sog") || sv_str_eq(o->format, "compressed-ply");
  return is_playcanvas ? SV_UP_DEFAULT : NULL;
}

// Rotations of length 1, and all turned, with the cameras of `seen`.
static void turn(lab_model *m, const char *to, lab_seen *seen) {
  sv_turn t;
  sv_turn_between(&t, *m->up ? m->up : SV_UP_DEFAULT, to ? to : "");
  for (int v = 0; !t.is_none && v < seen->n_views; v++) {
    const double eye[3] = {seen->eye[v][0], seen->eye[v][1], seen->eye[v][2]};
    sv_apply33(seen->eye[v], t.r, eye);
  }
  for (int i = 0; i < m->g.n; i++) {
    sv_gaussian v;
    sv_gaussians_get(&m->g, i, &v);
    const float *q = v.quat_wxyz, norm = sqrtf(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    for (int k = 0; k < 4; k++) v.quat_wxyz[k] = norm > 0 ? q[k] / norm : (float)(k == 0);
    sv_gaussian_turn_by(&v, &t);
    sv_gaussians_put(&m->g, i, &v);
  }
  if (to) sv_copy(m->up, sizeof m->up, to);
}

// --- what training views see ---------------------------------------------------------------------

typedef struct {
  lab_seen seen; // no views: nothing was asked
  double eye[SV_SUPPORT_VIEWS][3];
  float *weight;
} seen_by;

static sv_status ask_views(seen_by *by, const lab_options *o, lab_model *m, lab_session *se, sv_err *err) {
  lab_settings st;
  sv_support support;
  void *block = NULL;
  if (m->deform.kind || m->sequence)
    return sv_fail(err, SV_E_UNSUPPORTED, "%s: moves; --data is for still models", o->model);
  if (lab_is_upright(o->model))
    return sv_fail(err, SV_E_UNSUPPORTED, "%s: --data needs the PLY, which has the dataset's axes", o->model);
  sv_status s = lab_settings_for(&st, o, m, err);
  if (s != SV_OK) return s;
  by->weight = malloc(SV_SUPPORT_VIEWS * (size_t)m->g.n * sizeof *by->weight);
  if (!by->weight) return sv_fail(err, SV_E_NOMEM, "no memory for %d Gaussians", m->g.n);
  const lab_source src = {.folder = o->data,
                          .transforms = st.transforms,
                          .told_by = st.told_by,
                          .split = "train",
                          .n_exposures = st.n_exposures,
                          .scale = st.scale};
  const lab_eval_job job = {
      .session = se, .g = &m->g, .render = lab_render_options(&st, m->g.sh_degree, false)};
  s = lab_support_measure(&support, &block, &job, &src, by->weight, err);
  if (s == SV_OK) {
    for (int v = 0; v < support.n_views; v++)
      for (int k = 0; k < 3; k++) by->eye[v][k] = (double)support.eye[v][k];
    by->seen = (lab_seen){support.n_views, by->weight, by->eye};
  }
  free(block);
  return s;
}

// --- --crop --------------------------------------------------------------------------------------

static int read_numbers(const char *text, double *out, int cap) {
  int n = 0;
  for (const char *p = text; n < cap; p++) {
    const size_t len = strcspn(p, ",");
    if (!sv_parse_double(p, len, &out[n++])) return 0;
    p += len;
    if (!*p) return n;
  }
  return 0;
}

static bool is_inside(const float mean[3], const double *c, int n) {
  double d2 = 0;
  for (int k = 0; k < 3; k++) {
    const double x = (double)mean[k];
    if (n == 6 && !(x >= c[k] && x <= c[3 + k])) return false;
    d2 += (x - c[k]) * (x - c[k]);
  }
  return n == 6 || d2 <= c[3] * c[3];
}

static sv_status crop(lab_model *m, const char *text, sv_err *err) {
  double c[6];
  int n = read_numbers(text, c, 6), kept = 0;
  if (n != 4 && n != 6)
    return sv_fail(err, SV_E_ARG, "--crop %.80s: expected x0,y0,z0,x1,y1,z1 or x,y,z,radius", text);
  for (int i = 0; i < m->g.n; i++) {
    sv_gaussian v;
    sv_gaussians_get(&m->g, i, &v);
    if (is_inside(v.mean, c, n)) sv_gaussians_put(&m->g, kept++, &v);
  }
  if (!kept) return sv_fail(err, SV_E_RANGE, "--crop %.80s: no Gaussian lies in it", text);
  m->g.n = kept;
  return SV_OK;
}

// --- SOG -----------------------------------------------------------------------------------------

#define JUDGE_WIDTH_PX 256
#define INVISIBLE_DB   52.0 // PSNR against the model, where its own PSNR is not known
// Above the model's PSNR: error that costs it 0.1 dB.
#define ABOVE_MODEL_DB 16.3

// Cameras that the loss is measured with: at the places of training views, else around the model.
static sv_status judge_views(sog_judge *j, const lab_settings *st, const lab_model *m, const lab_seen *seen,
                             sv_err *err) {
  lab_orbit orbit = lab_orbit_of_model(m, st, JUDGE_WIDTH_PX);
  const double height = orbit.height;
  double up[3], centre[3];
  sv_status s = SV_OK;
  for (int k = 0; k < 3; k++) {
    up[k] = (double)orbit.scene.up[k];
    centre[k] = (double)st->centre[k];
  }
  for (int v = 0; s == SV_OK && v < SOG_CAP_VIEWS; v++, j->n_views++) {
    sv_pose pose;
    const sv_view *l = &orbit.lens;
    const double pinhole[4] = {(double)l->fx, (double)l->fy, (double)l->cx, (double)l->cy};
    orbit.height = v % 2 ? height : 0;
    if (seen->n_views && sv_pose_look_at(&pose, seen->eye[v * seen->n_views / SOG_CAP_VIEWS], centre, up))
      j->view[v] = sv_view_make(l->width_px, l->height_px, pinhole, &pose);
    else s = lab_orbit_view(&orbit, (double)v / SOG_CAP_VIEWS, &j->view[v], err);
  }
  return s;
}

static sv_status write_sog(const lab_options *o, lab_model *m, lab_session *se, const char *path,
                           sv_err *err) {
  seen_by by = {0};
  lab_settings st;
  sv_turn t;
  sv_status s = lab_settings_for(&st, o, m, err);
  if (s == SV_OK && o->data) s = ask_views(&by, o, m, se, err);
  if (s != SV_OK) {
    free(by.weight);
    return s;
  }
  double centre[3];
  sv_turn_between(&t, *m->up ? m->up : SV_UP_DEFAULT, up_of_viewer(o));
  for (int k = 0; k < 3; k++) centre[k] = (double)st.centre[k];
  if (!t.is_none) sv_apply33(centre, t.r, centre);
  for (int k = 0; k < 3; k++) st.centre[k] = (float)centre[k];
  turn(m, up_of_viewer(o), &by.seen);
  const sv_model_notes notes = lab_model_notes(m);
  sog_judge judge = {.session = se,
                     .render = lab_render_options(&st, m->g.sh_degree, false),
                     .target_db = st.psnr > 0 ? (double)st.psnr + ABOVE_MODEL_DB : INVISIBLE_DB};
  s = judge_views(&judge, &st, m, &by.seen, err);
  if (s == SV_OK) s = lab_write_sog(&m->g, &notes, by.seen.n_views ? &by.seen : NULL, &judge, path, err);
  free(by.weight);
  return s;
}

// --- the command ---------------------------------------------------------------------------------

#define N_FRAMES 25 // of delta and sequence, unless --frames says otherwise

// One still model, or one instant of a moving one.
static sv_status write_still(const lab_options *o, lab_model *m, lab_session *se, const char *path,
                             sv_err *err) {
  sv_status s = o->is_supported ? lab_keep_supported(m, o, se, err) : SV_OK;
  if (s == SV_OK && o->crop) s = crop(m, o->crop, err);
  if (s != SV_OK) return s;
  if (sv_str_eq(o->format, "sog")) return write_sog(o, m, se, path, err);
  turn(m, up_of_viewer(o), &(lab_seen){0});
  const sv_model_notes notes = lab_model_notes(m);
  int version = o->spz_version > 0 ? (int)o->spz_version : 4;
  if (sv_str_eq(o->format, "splat")) return lab_write_splat(&m->g, path, err);
  if (sv_str_eq(o->format, "html")) {
    lab_settings st;
    s = lab_settings_for(&st, o, m, err);
    return s == SV_OK ? lab_write_html(m, &st, path, err) : s;
  }
  if (sv_str_eq(o->format, "spz")) return lab_write_spz(&m->g, &notes, version, path, err);
  if (sv_str_eq(o->format, "glb")) return lab_write_glb(&m->g, &notes, path, err);
  if (sv_str_eq(o->format, "compressed-ply")) return lab_write_compressed_ply(&m->g, &notes, path, err);
  return lab_model_write(&m->g, &notes, path, err);
}

static const char *extension_of(const char *format) {
  return sv_str_eq(format, "compressed-ply") ? ".compressed.ply"
         : sv_str_eq(format, "spz")          ? ".spz"
         : sv_str_eq(format, "sog")          ? ".sog"
         : sv_str_eq(format, "glb")          ? ".glb"
         : sv_str_eq(format, "splat")        ? ".splat"
                                             : ".ply";
}

static sv_status write_as(const lab_options *o, lab_model *m, lab_session *se, sv_err *err) {
  const int n_frames = o->frames > 0 ? (int)o->frames : N_FRAMES;
  if (o->up) sv_copy(m->up, sizeof m->up, o->up); // better known than said in the file
  if (sv_str_eq(o->format, "delta")) return lab_write_delta(m, se, n_frames, o->out, err);
  if (sv_str_eq(o->format, "sequence")) {
    lab_settings st;
    sv_status s = lab_settings_for(&st, o, m, err);
    return s == SV_OK ? lab_write_sequence(m, se, &st, n_frames, o->out, err) : s;
  }
  const lab_frames frames = {
      .o = o, .n = n_frames, .folder = o->out, .extension = extension_of(o->format), .write = write_still};
  return o->frames > 0 ? lab_write_frames(m, se, &frames, err) : write_still(o, m, se, o->out, err);
}

int lab_cmd_export(const lab_options *o) {
  sv_err err = {0};
  lab_session se;
  lab_model m = {0};
  int code = LAB_EXIT_OK;
  sv_status s = lab_session_start(&se, 0, o->is_quiet, &err);
  if (s == SV_OK) s = sv_linux_catch_signals(&err);
  if (s == SV_OK) s = lab_model_read(&m, o->model, &err);
  if (s == SV_OK) s = write_as(o, &m, &se, &err);
  if (s != SV_OK) code = lab_failed(&se, &err);
  else lab_say(&se, "%s: %d Gaussians as %s", o->out, m.g.n, o->format);
  lab_session_stop(&se);
  lab_model_free(&m);
  return code;
}
