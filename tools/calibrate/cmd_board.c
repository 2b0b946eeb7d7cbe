// SPDX-License-Identifier: Apache-2.0
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "calib/solve/corners.h"
#include "src/base/str.h"
#include "tools/calibrate/calibrate.h"

static sv_boards problem_of(const cal_boards *b, const cal_options *o) {
  sv_model_kind model = SV_MODEL_OPENCV5;
  // the words were checked
  if (o->model && !sv_model_by_name(o->model, &model)) model = SV_MODEL_OPENCV5;
  int n_seen = 0;
  for (int i = 0; i < b->n_cameras * b->n_frames; i++) n_seen += b->is_seen[i];
  return (sv_boards){.n_cameras = b->n_cameras,
                     .n_frames = b->n_frames,
                     .n_cols = b->n_cols,
                     .n_rows = b->n_rows,
                     .spacing_m = o->spacing_m,
                     .model = model,
                     .has_warp =
                         // a few views would explain their noise by a warp
                     !o->is_flat && n_seen >= 8,
                     .names = b->names,
                     .size_px = (const int(*)[2])b->size_px,
                     .uv_px = b->uv_px,
                     .is_seen = b->is_seen};
}

// Shell-expanded patterns would make each image a camera.
static int check_words(const cal_options *o) {
  int n_plain = 0;
  for (int i = 0; i < o->images.n; i++) {
    struct stat st;
    n_plain += stat(o->images.of[i], &st) == 0 && !S_ISDIR(st.st_mode);
  }
  if (n_plain && o->images.n > 1)
    return cal_usage("board",
                     "'%.80s' is a single image: --images takes one quoted pattern or folder per camera",
                     o->images.of[0]);
  return CAL_EXIT_OK;
}

// Relative deviation of the rig's lengths: that of the distance which is known best. 0: one camera.
// The board's spacing is taken as it was given.
static double scale_sigma(const sv_boards_result *r) {
  double least = 0;
  for (int c = 1; c < r->n_cameras; c++) {
    double centre[3];
    sv_pose_centre(centre, &r->cam_from_rig[c]);
    const double sigma = r->cameras[c].translation_sd_m / sv_norm3(centre);
    if (sigma > 0 && sigma < 1 && (least == 0 || sigma < least)) least = sigma;
  }
  return least;
}

static sv_status write_rig(const cal_options *o, const cal_boards *b, const sv_boards_result *r,
                           sv_err *err) {
  sv_sub_view *views = calloc((size_t)b->n_cameras, sizeof *views);
  if (!views) return sv_fail(err, SV_E_NOMEM, "%s: no memory to write the rig", o->out);
  sv_rig rig = {.forward = SV_FORWARD_DIRECT, .n_sub_views = b->n_cameras, .cap_sub_views = b->n_cameras};
  rig.sub_views = views;
  rig.scale_sigma = scale_sigma(r);
  sv_fmt(rig.name, sizeof rig.name, "%.31s", o->name ? o->name : sv_path_name(o->out));
  if (!*rig.name) sv_fmt(rig.name, sizeof rig.name, "rig");
  for (int c = 0; c < b->n_cameras; c++) {
    views[c] = (sv_sub_view){.i_camera = c, .model = r->models[c], .cam_from_rig = r->cam_from_rig[c]};
    sv_copy(views[c].name, sizeof views[c].name, b->cameras[c].name);
    if (!cal_sensor_area(b->cameras[c].pictures[0].path, b->size_px[c], &views[c].area))
      views[c].area = (sv_sensor_area){.sensor_width_px = 0};
  }
  sv_status s = cal_rig_write(o->out, &rig, err);
  free(views);
  return s;
}

static double worst_uncertainty(const sv_boards_camera *q) {
  double worst = 0;
  for (int j = 0; j < SV_BOARDS_GRID_Y; j++)
    for (int i = 0; i < SV_BOARDS_GRID_X; i++)
      if (q->uncertainty_px[j][i] > worst) worst = q->uncertainty_px[j][i];
  return worst;
}

static void report_camera(lab_report *j, const cal_boards *b, const sv_boards_result *r, int c) {
  const sv_boards_camera *q = &r->cameras[c];
  const double *p = r->models[c].p;
  double centre[3];
  sv_pose_centre(centre, &r->cam_from_rig[c]);
  lab_report_item_begin(j);
  lab_report_text(j, "name", b->cameras[c].name);
  lab_report_int(j, "pictures", b->cameras[c].n_pictures);
  lab_report_int(j, "boards", q->n_boards);
  lab_report_int(j, "outliers", q->n_outliers);
  lab_report_num(j, "rms_px", q->rms_px);
  lab_report_num(j, "fx_px", p[0]);
  lab_report_num(j, "fy_px", p[1]);
  lab_report_num(j, "cx_px", p[2]);
  lab_report_num(j, "cy_px", p[3]);
  if (r->models[c].kind != SV_MODEL_SPLINED) lab_report_num(j, "fx_sd_px", q->fx_sd_px);
  lab_report_num(j, "rotation_sd_deg", q->rotation_sd_deg);
  lab_report_num(j, "translation_sd_m", q->translation_sd_m);
  lab_report_num(j, "distance_m", sv_norm3(centre)); // of the camera's center from the rig's origin
  lab_report_num(j, "coverage", q->coverage);
  lab_report_num(j, "tilt_deg", q->tilt_deg);
  lab_report_num(j, "worst_uncertainty_px", worst_uncertainty(q));
  lab_report_item_end(j);
}

static void report(lab_report *j, const cal_boards *b, const sv_boards_result *r, const cal_advice *a,
                   const char *model) {
  lab_report_begin(j);
  lab_report_text(j, "model", model);
  lab_report_num(j, "rms_px", r->rms_px);
  lab_report_int(j, "corners", r->n_points);
  lab_report_int(j, "outliers", r->n_outliers);
  lab_report_int(j, "frames", b->n_frames);
  lab_report_num(j, "scale_sigma", scale_sigma(r));
  lab_report_num(j, "board_bend_x_m", r->warp_m[0]);
  lab_report_num(j, "board_bend_y_m", r->warp_m[1]);
  lab_report_array(j, "cameras");
  for (int c = 0; c < b->n_cameras; c++) report_camera(j, b, r, c);
  lab_report_array_end(j);
  lab_report_array(j, "boards");
  for (int c = 0; c < b->n_cameras; c++)
    for (int f = 0; f < b->n_frames; f++) {
      if (!b->is_seen[c * b->n_frames + f]) continue;
      lab_report_item_begin(j);
      lab_report_text(j, "camera", b->cameras[c].name);
      lab_report_text(j, "frame", b->frames[f]);
      lab_report_num(j, "rms_px", r->board_rms_px[c * b->n_frames + f]);
      lab_report_item_end(j);
    }
  lab_report_array_end(j);
  cal_report_warnings(j, a);
  lab_report_end(j);
}

static void say_camera(lab_session *se, const cal_boards *b, const sv_boards_result *r, int c) {
  const sv_boards_camera *q = &r->cameras[c];
  const double *p = r->models[c].p;
  double centre[3], w[3];
  char place[120] = "", sd[40] = "";
  sv_pose_centre(centre, &r->cam_from_rig[c]);
  sv_rodrigues_inv(w, r->cam_from_rig[c].r);
  if (c)
    sv_fmt(place, sizeof place, "; %.4f m and %.3f degrees from %s", sv_norm3(centre),
           sv_norm3(w) * 57.29577951, b->cameras[0].name);
  if (r->models[c].kind != SV_MODEL_SPLINED) sv_fmt(sd, sizeof sd, " (+- %.2f)", q->fx_sd_px);
  lab_say(se, "  %s: %d boards in %d images, %.3f px RMS, focal length %.2f%s px%s", b->cameras[c].name,
          q->n_boards, b->cameras[c].n_pictures, q->rms_px, p[0], sd, place);
}

static sv_status finish(const cal_options *o, lab_session *se, const cal_boards *b, const sv_boards_result *r,
                        sv_err *err) {
  cal_advice *a = calloc(1, sizeof *a);
  char path[SV_CAP_PATH];
  const char *model = sv_model_name(r->models[0].kind);
  if (!a) return sv_fail(err, SV_E_NOMEM, "%s: no memory for the report", o->out);
  cal_advise_spacing(a, o->spacing_m);
  cal_advise_boards(a, b, r);
  lab_say(se, "%.3f px RMS over %d corners (%d rejected), %s, board deformation %.2f and %.2f mm", r->rms_px,
          r->n_points, r->n_outliers, model, 1e3 * r->warp_m[0], 1e3 * r->warp_m[1]);
  for (int c = 0; c < b->n_cameras; c++) say_camera(se, b, r, c);
  for (int i = 0; i < a->n; i++) se->console.log(se->console.self, SV_LOG_WARN, a->text[i]);
  sv_status s = write_rig(o, b, r, err);
  if (s == SV_OK) s = cal_plots_write(o->out, b, r, se, err);
  if (s == SV_OK) s = sv_path_join(path, sizeof path, o->out, "calibration.json", err);
  lab_report j = {0};
  if (s == SV_OK) {
    report(&j, b, r, a, model);
    s = lab_report_save(&j, path, err);
  }
  if (s == SV_OK && o->is_json) {
    report(&j, b, r, a, model);
    s = lab_report_print(&j, err);
  }
  if (s == SV_OK) lab_say(se, "written: %s (rig.json, calibration.json, residuals.csv, plots/)", o->out);
  free(a);
  return s;
}

sv_status cal_board_solve(const cal_options *o, lab_session *se, const cal_boards *b, sv_err *err) {
  sv_boards_result r;
  sv_boards problem = problem_of(b, o);
  sv_status s = sv_boards_solve(&problem, &r, err);
  if (s != SV_OK) return s;
  s = cal_stopped(se, "corners.txt", err);
  if (s == SV_OK) s = finish(o, se, b, &r, err);
  sv_boards_free(&r);
  return s;
}

static sv_status calibrate(const cal_options *o, lab_session *se, cal_boards *b, sv_err *err) {
  char cache[SV_CAP_PATH];
  sv_status s = sv_boards_available(err);
  if (s == SV_OK) s = sv_corners_available(o->n_cols, o->n_rows, err);
  if (s == SV_OK) s = cal_boards_list(b, o, err);
  if (s == SV_OK) s = lab_session_folder(se, o->out, err);
  if (s == SV_OK) s = sv_path_join(cache, sizeof cache, o->out, "corners.txt", err);
  if (s == SV_OK) s = cal_boards_find(b, se, cache, err);
  if (s != SV_OK) return s;
  lab_say(se, "%d frames of %d cameras: %d images searched for the board, %d from the cache", b->n_frames,
          b->n_cameras, b->n_searched, b->n_cached);
  return cal_board_solve(o, se, b, err);
}

int cal_cmd_board(const cal_options *o) {
  lab_session se;
  cal_boards b = {0};
  sv_err err = {0};
  int e = check_words(o);
  if (e != CAL_EXIT_OK) return e;
  sv_status s = lab_session_start(&se, o->threads, o->is_quiet, &err);
  if (s == SV_OK) s = sv_linux_catch_signals(&err);
  if (s == SV_OK) s = calibrate(o, &se, &b, &err);
  if (s != SV_OK) lab_failed(&se, &err);
  cal_boards_free(&b);
  lab_session_stop(&se);
  return s == SV_OK ? CAL_EXIT_OK : CAL_EXIT_FAILED;
}
