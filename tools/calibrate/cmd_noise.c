// SPDX-License-Identifier: Apache-2.0
// subview-calibrate noise: read noise and shot noise of the cameras, by photon transfer.
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/str.h"
#include "tools/calibrate/calibrate.h"
#include "tools/calibrate/photon_transfer.h"
#include "tools/common/fileio.h"
#include "tools/common/imageio.h"

#define BLOCK_BYTES ((size_t)64 << 20)

typedef struct {
  sv_arena arena, scratch;
  sv_rig rig;
  sv_coverage_names names;
  cal_boards series; // of the cameras' pictures
  ptc sums;
  ptc_result result[SV_OPTIONS_CAP_LIST];
} job;

static sv_status open_rig(job *j, const cal_options *o, sv_err *err) {
  sv_file_reader files = {(void *)(uintptr_t)o->rig, sv_folder_read};
  int n_cameras = 0;
  if (sv_rig_init(&j->rig, SV_CAP_SUB_VIEWS, &j->arena) < 0)
    return sv_fail(err, SV_E_NOMEM, "%s: no memory for the rig", o->rig);
  sv_status s = sv_rig_read_coverage(&j->rig, &j->names, &files, -1, &j->scratch, err);
  for (int i = 0; s >= 0 && i < j->rig.n_sub_views; i++)
    if (j->rig.sub_views[i].i_camera >= n_cameras) n_cameras = j->rig.sub_views[i].i_camera + 1;
  if (s >= 0 && n_cameras != o->images.n)
    return sv_fail(err, SV_E_ARG, "%s: the rig has %d cameras, --images has %d", o->rig, n_cameras,
                   o->images.n);
  return s;
}

static sv_status read_deep(const char *path, sv_bitmap *out, sv_err *err) {
  sv_status s = sv_bitmap_read(path, out, err);
  if (s < 0) return s;
  if (out->bits == 16 && out->n_channels == 3) return SV_OK;
  s = sv_fail(err, SV_E_UNSUPPORTED,
              "%s: %d bits and %d channels, expected RGB of 16 bits, as subview capture keeps of cameras "
              "with --depth 16",
              path, out->bits, out->n_channels);
  sv_bitmap_free(out);
  return s;
}

// Picture after picture in pairs: 1 and 2, 3 and 4.
static sv_status measure(job *j, int c, sv_err *err) {
  const cal_camera *cam = &j->series.cameras[c];
  sv_err why;
  memset(&j->sums, 0, sizeof j->sums);
  for (int i = 0; i + 1 < cam->n_pictures; i += 2) {
    sv_bitmap a, b;
    sv_status s = read_deep(cam->pictures[i].path, &a, err);
    if (s < 0) return s;
    s = read_deep(cam->pictures[i + 1].path, &b, err);
    if (s >= 0 && (a.width_px != b.width_px || a.height_px != b.height_px))
      s = sv_fail(err, SV_E_RANGE, "%s: another size than the picture before it", cam->pictures[i + 1].path);
    if (s >= 0) ptc_add(&j->sums, a.u16, b.u16, 3 * (size_t)a.width_px * (size_t)a.height_px);
    sv_bitmap_free(&a);
    if (s < 0) return s;
    sv_bitmap_free(&b);
  }
  const sv_status s = ptc_solve(&j->sums, &j->result[c], &why);
  return s < 0 ? sv_fail(err, s, "%s: %s", cam->name, why.text) : s;
}

static void say(lab_session *se, const job *j, int c) {
  const ptc_result *r = &j->result[c];
  lab_say(
      se,
      "  %s: variance = %.3g (+- %.1g) + %.3g (+- %.1g) x light; as electrons: full scale %.0f, read noise "
      "%.1f; %d pairs",
      j->series.cameras[c].name, r->noise.read, r->sigma_read, r->noise.shot, r->sigma_shot,
      1 / r->noise.shot, sqrt(r->noise.read) / r->noise.shot, r->n_pairs);
}

static void report(lab_report *r, const job *j) {
  lab_report_begin(r);
  lab_report_array(r, "cameras");
  for (int c = 0; c < j->series.n_cameras; c++) {
    const ptc_result *x = &j->result[c];
    lab_report_item_begin(r);
    lab_report_text(r, "name", j->series.cameras[c].name);
    lab_report_num(r, "read", x->noise.read);
    lab_report_num(r, "sigma_read", x->sigma_read);
    lab_report_num(r, "shot", x->noise.shot);
    lab_report_num(r, "sigma_shot", x->sigma_shot);
    lab_report_num(r, "full_scale_electrons", 1 / x->noise.shot);
    lab_report_num(r, "read_electrons", sqrt(x->noise.read) / x->noise.shot);
    lab_report_int(r, "pairs", x->n_pairs);
    lab_report_int(r, "levels", x->n_levels);
    lab_report_item_end(r);
  }
  lab_report_array_end(r);
  lab_report_end(r);
}

static sv_status calibrate(job *j, const cal_options *o, lab_session *se, sv_err *err) {
  sv_status s = open_rig(j, o, err);
  if (s >= 0) s = cal_boards_list(&j->series, o, err);
  for (int c = 0; s >= 0 && c < j->series.n_cameras; c++) {
    s = cal_stopped(se, NULL, err);
    if (s >= 0) s = measure(j, c, err);
    if (s >= 0) say(se, j, c);
  }
  for (int i = 0; s >= 0 && i < j->rig.n_sub_views; i++)
    j->rig.sub_views[i].noise = j->result[j->rig.sub_views[i].i_camera].noise;
  if (s >= 0) s = cal_rig_update(o->rig, &j->rig, &j->names, err);
  if (s < 0) return s;
  lab_say(se, "written: %s/rig.json", o->rig);
  if (!o->is_json) return SV_OK;
  lab_report r = {0};
  report(&r, j);
  return lab_report_print(&r, err);
}

static sv_status run(void *memory, const cal_frame *frame, sv_err *err) {
  job *j = memory;
  j->arena = frame->arena;
  j->scratch = frame->scratch;
  sv_status s = calibrate(j, frame->options, frame->session, err);
  cal_boards_free(&j->series);
  return s;
}

int cal_cmd_noise(const cal_options *o) { return cal_frame_run(o, sizeof(job), BLOCK_BYTES, run); }
