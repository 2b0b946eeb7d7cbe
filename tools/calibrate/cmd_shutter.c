// SPDX-License-Identifier: Apache-2.0
// subview-calibrate shutter: readout times of rolling shutters, from a capture of a moving board.
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "calib/solve/corners.h"
#include "calib/solve/shutter.h"
#include "platform/replay/capture.h"
#include "src/base/str.h"
#include "tools/calibrate/calibrate.h"
#include "tools/calibrate/check.h"
#include "tools/common/fileio.h"

#define BLOCK_BYTES ((size_t)256 << 20)

typedef struct {
  sv_arena arena, scratch;
  sv_capture capture;
  sv_rig rig;
  sv_coverage_names names;
  cal_boards boards;
  sv_shutter_result result[SV_BOARDS_CAP_CAMERAS];
} job;

// --- what there is -------------------------------------------------------------------------------

// The sub-view that is a camera's whole image; NULL: there is none.
static sv_sub_view *whole_image_of(sv_rig *rig, int i_camera) {
  sv_sub_view *found = NULL;
  for (int i = 0; i < rig->n_sub_views; i++) {
    sv_sub_view *v = &rig->sub_views[i];
    if (v->i_camera != i_camera) continue;
    if (found || v->footprint.width_px) return NULL;
    found = v;
  }
  return found;
}

static sv_status open_all(job *j, const cal_options *o, sv_err *err) {
  sv_file_reader files = {(void *)(uintptr_t)o->rig, sv_folder_read};
  sv_status s = sv_capture_load(&j->capture, o->capture, &j->arena, err);
  if (s < 0) return s;
  if (j->capture.n_cameras > SV_OPTIONS_CAP_LIST)
    return sv_fail(err, SV_E_UNSUPPORTED, "%s: %d cameras, at most %d can be searched for a board",
                   o->capture, j->capture.n_cameras, SV_OPTIONS_CAP_LIST);
  if (sv_rig_init(&j->rig, SV_CAP_SUB_VIEWS, &j->arena) < 0)
    return sv_fail(err, SV_E_NOMEM, "%s: no memory for the rig", o->rig);
  s = sv_rig_read_coverage(&j->rig, &j->names, &files, j->capture.n_cameras, &j->scratch, err);
  for (int c = 0; c < j->capture.n_cameras && s >= 0; c++) {
    const sv_sub_view *v = whole_image_of(&j->rig, c);
    const sv_camera_caps *caps = &j->capture.cameras[c].caps;
    if (!v)
      s = sv_fail(err, SV_E_UNSUPPORTED,
                  "%s: camera %d has no sub-view for its whole image; readouts of shared sensors are not "
                  "calibrated",
                  o->rig, c);
    else if (v->model.width_px != caps->width_px || v->model.height_px != caps->height_px)
      s = sv_fail(err, SV_E_RANGE, "%s: the images of camera %d have %dx%d pixels, the rig's lens has %dx%d",
                  o->capture, c, caps->width_px, caps->height_px, v->model.width_px, v->model.height_px);
  }
  return s;
}

// The folders of the capture's cameras take the place of --images.
static sv_status find_boards(job *j, const cal_options *o, lab_session *se, sv_err *err) {
  cal_options with = *o;
  with.images.n = j->capture.n_cameras;
  for (int c = 0; c < j->capture.n_cameras; c++) {
    char *path = SV_TAKE(&j->arena, char, SV_CAP_PATH);
    if (!path) return sv_fail(err, SV_E_NOMEM, "%s: no memory for names", o->capture);
    sv_status s = sv_path_join(path, SV_CAP_PATH, o->capture, j->capture.cameras[c].folder, err);
    if (s < 0) return s;
    with.images.of[c] = path;
  }
  sv_status s = cal_boards_list(&j->boards, &with, err);
  if (s == SV_OK) s = cal_boards_find(&j->boards, se, NULL, err);
  return s;
}

// --- one camera ----------------------------------------------------------------------------------

// The time of a frame by the name of its file; NAN: the capture does not list it.
static double time_of(const sv_capture_camera *c, const char *file) {
  for (int i = 0; i < c->n_frames; i++)
    if (strcmp(c->frames[i].file, file) == 0)
      return sv_ns_to_s(c->frames[i].camera_ns - c->frames[0].camera_ns);
  return NAN;
}

typedef struct {
  int n;
  double *time_s, *uv_px;
  sv_pose *pose;
} frames;

// Frames in which the board was found, in the order of time, which is that of their names.
static void take_frames(const job *j, int c, const cal_boards *one, const cal_check *check, frames *f) {
  const size_t corners = (size_t)(one->n_cols * one->n_rows);
  for (int i = 0; i < one->n_frames; i++) {
    const double t = time_of(&j->capture.cameras[c], one->frames[i]);
    if (!one->is_seen[i] || !check->has_pose[i] || !(t >= 0)) continue;
    if (f->n && !(t > f->time_s[f->n - 1])) continue;
    f->time_s[f->n] = t;
    f->pose[f->n] = check->rig_from_board[i];
    memcpy(f->uv_px + 2 * corners * (size_t)f->n, one->uv_px + 2 * corners * (size_t)i,
           2 * corners * sizeof(double));
    f->n++;
  }
}

static sv_status solve_camera(job *j, const cal_options *o, int c, sv_err *err) {
  sv_sub_view *v = whole_image_of(&j->rig, c), alone = *v;
  const sv_rig lens = {.n_sub_views = 1, .cap_sub_views = 1, .sub_views = &alone};
  const cal_boards *b = &j->boards;
  const size_t n = (size_t)b->n_frames, corners = (size_t)(b->n_cols * b->n_rows);
  cal_boards one = *b;
  cal_check check = {0};
  alone.cam_from_rig = sv_pose_identity();
  one.n_cameras = 1;
  one.uv_px = b->uv_px + 2 * corners * n * (size_t)c;
  one.is_seen = b->is_seen + n * (size_t)c;
  frames f = {.time_s = calloc(n + 1, sizeof *f.time_s),
              .uv_px = calloc(2 * corners * n + 1, sizeof *f.uv_px),
              .pose = calloc(n + 1, sizeof *f.pose)};
  sv_status s = f.time_s && f.uv_px && f.pose ? SV_OK : sv_fail(err, SV_E_NOMEM, "no memory for the boards");
  if (s >= 0) s = cal_check_boards(&check, &lens, &one, o->spacing_m, err);
  if (s >= 0) {
    take_frames(j, c, &one, &check, &f);
    const sv_shutter_boards problem = {.lens = &v->model,
                                       .n_cols = b->n_cols,
                                       .n_rows = b->n_rows,
                                       .spacing_m = o->spacing_m,
                                       .n_frames = f.n,
                                       .time_s = f.time_s,
                                       .uv_px = f.uv_px,
                                       .cam_from_board = f.pose};
    sv_err why;
    s = sv_shutter_solve(&problem, &j->result[c], &why);
    if (s < 0) sv_fail(err, s, "%s: %s", v->name, why.text);
  }
  if (s >= 0) v->shutter = j->result[c].shutter;
  cal_check_free(&check);
  free(f.time_s);
  free(f.uv_px);
  free(f.pose);
  return s;
}

// --- what is told --------------------------------------------------------------------------------

static void report(lab_report *r, job *j) {
  lab_report_begin(r);
  lab_report_array(r, "cameras");
  for (int c = 0; c < j->capture.n_cameras; c++) {
    const sv_shutter_result *x = &j->result[c];
    lab_report_item_begin(r);
    lab_report_text(r, "name", whole_image_of(&j->rig, c)->name);
    lab_report_num(r, "readout_ms", 1e3 * x->shutter.readout_s);
    lab_report_num(r, "sigma_ms", 1e3 * x->sigma_s);
    lab_report_text(r, "shutter", sv_shutter_name(x->shutter.direction));
    lab_report_num(r, "across_ms", 1e3 * x->across_s);
    lab_report_int(r, "frames", x->n_used);
    lab_report_num(r, "turn_deg_s", x->turn_deg_s);
    lab_report_num(r, "rms_px", x->rms_px);
    lab_report_num(r, "rms_global_px", x->rms_global_px);
    lab_report_item_end(r);
  }
  lab_report_array_end(r);
  lab_report_end(r);
}

static void say(lab_session *se, job *j, int c) {
  const sv_shutter_result *x = &j->result[c];
  const char *name = whole_image_of(&j->rig, c)->name;
  if (x->shutter.readout_s > 0)
    lab_say(
        se,
        "  %s: %.3f ms (+- %.3f), lines go %s; %d frames, board at %.0f degrees/s; %.3f px RMS, %.3f px as a "
        "global shutter",
        name, 1e3 * x->shutter.readout_s, 1e3 * x->sigma_s, sv_shutter_name(x->shutter.direction), x->n_used,
        x->turn_deg_s, x->rms_px, x->rms_global_px);
  else
    lab_say(se, "  %s: global shutter; %d frames, board at %.0f degrees/s; %.3f px RMS", name, x->n_used,
            x->turn_deg_s, x->rms_px);
}

static sv_status calibrate(job *j, const cal_options *o, lab_session *se, sv_err *err) {
  sv_status s = sv_corners_available(o->n_cols, o->n_rows, err);
  if (s == SV_OK) s = open_all(j, o, err);
  if (s == SV_OK) s = find_boards(j, o, se, err);
  if (s == SV_OK) s = cal_stopped(se, NULL, err);
  for (int c = 0; c < j->capture.n_cameras && s == SV_OK; c++) {
    s = solve_camera(j, o, c, err);
    if (s == SV_OK) say(se, j, c);
  }
  if (s == SV_OK) s = cal_rig_update(o->rig, &j->rig, &j->names, err);
  if (s != SV_OK) return s;
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
  cal_boards_free(&j->boards);
  return s;
}

int cal_cmd_shutter(const cal_options *o) { return cal_frame_run(o, sizeof(job), BLOCK_BYTES, run); }
