// SPDX-License-Identifier: Apache-2.0
// A rig against new images of a chessboard: do its lenses and poses still hold?
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "calib/solve/corners.h"
#include "src/base/mathx.h"
#include "src/base/str.h"
#include "src/format/rig_file.h"
#include "tools/calibrate/calibrate.h"
#include "tools/calibrate/check.h"
#include "tools/calibrate/photometry.h"

#define SCENE_SIZES   20.0 // the assumed distance of a scene, in widths of the rig, without images
#define KNOCKED_TIMES 3.0  // poses fit so much worse together than each camera alone
#define KNOCKED_PX    0.5
#define LENS_RMS_PX   1.0
#define UNLIKE        0.03 // of the light
#define MIN_SQUARES   20

sv_status cal_read_rig(sv_rig *rig, const char *folder, void *block, sv_err *err) {
  sv_arena a = sv_arena_make(block, CAL_RIG_BYTES / 2),
           scratch = sv_arena_make((char *)block + CAL_RIG_BYTES / 2, CAL_RIG_BYTES / 2);
  char path[SV_CAP_PATH];
  sv_copy(path, sizeof path, folder);
  sv_file_reader files = {path, sv_folder_read};
  if (sv_rig_init(rig, SV_CAP_SUB_VIEWS, &a) != SV_OK)
    return sv_fail(err, SV_E_NOMEM, "%s: no memory", folder);
  return sv_rig_read(rig, &files, -1, &scratch, err);
}

// The center of gravity of the boards, or a point before the rig.
static void scene_centre(const sv_rig *rig, const cal_check *c, double out[3]) {
  double n = 0, sum[3] = {0};
  for (int f = 0; c && f < c->boards->n_frames; f++) {
    if (!c->has_pose[f]) continue;
    for (int k = 0; k < 3; k++) sum[k] += c->rig_from_board[f].t[k];
    n++;
  }
  for (int k = 0; k < 3 && n > 0; k++) out[k] = sum[k] / n;
  if (n > 0) return;
  double centre[3], p[3], axis[3] = {0}, width = 0;
  sv_pose_centre(centre, &rig->sub_views[0].cam_from_rig);
  for (int i = 0; i < rig->n_sub_views; i++) {
    sv_pose_centre(p, &rig->sub_views[i].cam_from_rig);
    sv_sub3(p, p, centre);
    if (sv_norm3(p) > width) width = sv_norm3(p);
    for (int k = 0; k < 3; k++) axis[k] += rig->sub_views[i].cam_from_rig.r[6 + k] / rig->n_sub_views;
  }
  for (int k = 0; k < 3; k++) out[k] = centre[k] + axis[k] * SCENE_SIZES * (width > 0 ? width : 1);
}

// From the left to the right edge at the height of the principal point, also more than 180 degrees.
// NAN where the lens tells no direction of an edge.
static double field_of_view_deg(const sv_camera_model *m) {
  const double left[2] = {0, m->p[3]}, right[2] = {m->width_px, m->p[3]};
  double a[3], b[3];
  if (!sv_model_unproject(m, left, a) || !sv_model_unproject(m, right, b)) return NAN;
  return (atan2(b[0], b[2]) - atan2(a[0], a[2])) * 180 / SV_PI;
}

static void report(lab_report *j, const sv_rig *rig, const cal_check *c, double angle_deg,
                   const cal_advice *a) {
  lab_report_begin(j);
  lab_report_text(j, "rig", rig->name);
  lab_report_int(j, "sub_views", rig->n_sub_views);
  lab_report_num(j, "angular_baseline_deg", angle_deg);
  if (c) {
    lab_report_num(j, "rms_px", c->rms_px);
    lab_report_int(j, "frames", c->n_frames);
  }
  lab_report_array(j, "cameras");
  for (int i = 0; i < rig->n_sub_views; i++) {
    const sv_camera_model *m = &rig->sub_views[i].model;
    lab_report_item_begin(j);
    lab_report_text(j, "name", rig->sub_views[i].name);
    lab_report_text(j, "model", sv_model_name(m->kind));
    lab_report_num(j, "fx_px", m->p[0]);
    lab_report_num(j, "field_of_view_deg", field_of_view_deg(m));
    if (c) {
      lab_report_int(j, "boards", c->cameras[i].n_boards);
      lab_report_num(j, "rms_alone_px", c->cameras[i].rms_alone_px);
      lab_report_num(j, "rms_in_rig_px", c->cameras[i].rms_rig_px);
      lab_report_num(j, "epipolar_px", c->cameras[i].epipolar_px);
      lab_report_int(j, "squares", c->cameras[i].n_squares);
    }
    static const char *const lights[] = {"light_r", "light_g", "light_b"};
    for (int k = 0; c && k < 3 && c->cameras[i].n_squares; k++)
      lab_report_num(j, lights[k], c->cameras[i].light[k]);
    if (c) {
    }
    lab_report_item_end(j);
  }
  lab_report_array_end(j);
  cal_report_warnings(j, a);
  lab_report_end(j);
}

static void advise_light(cal_advice *a, const sv_rig *rig, const cal_check *c) {
  for (int i = 1; i < c->n_cameras; i++) {
    const cal_check_camera *q = &c->cameras[i];
    double off = 0;
    if (q->n_squares < MIN_SQUARES && q->n_saturated >= MIN_SQUARES)
      cal_advise(a,
                 "%s: %d white squares of the boards are saturated, so that its light cannot be compared; "
                 "expected a shorter exposure",
                 rig->sub_views[i].name, q->n_saturated);
    for (int k = 0; k < 3; k++) off = sv_maxd(off, fabs(q->light[k] - 1));
    if (q->n_squares < MIN_SQUARES || off <= UNLIKE) continue;
    cal_advise(
        a,
        "%s shows the boards' white squares otherwise than %s: red %+.0f %%, green %+.0f %%, blue %+.0f %% "
        "of the light%s. Lock exposure, gain and white balance, then use 'subview-calibrate photometric'",
        rig->sub_views[i].name, rig->sub_views[0].name, 100 * (q->light[0] - 1), 100 * (q->light[1] - 1),
        100 * (q->light[2] - 1),
        rig->sub_views[i].photometric.is_known ? ", after the rig's photometric calibration" : "");
  }
}

static void advise(cal_advice *a, const cal_check *c) {
  for (int i = 0; i < c->n_cameras; i++) {
    const cal_check_camera *q = &c->cameras[i];
    const char *name = c->boards->cameras[i].name;
    if (!q->n_boards) continue;
    if (q->rms_alone_px > LENS_RMS_PX)
      cal_advise(
          a,
          "%s: its lens does not fit the board (%.2f px RMS with the best pose): was it focused or zoomed? "
          "Calibrate again",
          name, q->rms_alone_px);
    if (c->n_cameras > 1 && q->rms_rig_px > KNOCKED_PX && q->rms_rig_px > KNOCKED_TIMES * q->rms_alone_px)
      cal_advise(
          a,
          "%s has moved relative to the other cameras (%.2f px RMS in the rig, %.2f px alone): the rig was "
          "knocked, or images with the same number were not taken at the same time. Calibrate again",
          name, q->rms_rig_px, q->rms_alone_px);
  }
}

static sv_status compare_light(const sv_rig *rig, const cal_boards *b, cal_check *c, sv_err *err) {
  cal_squares squares = {0};
  // What a camera shows of light goes with its exposure time.
  for (int i = 1; i < rig->n_sub_views; i++) {
    const double share = cal_exposure_share(b, i);
    for (int k = 0; k < 9; k++) rig->sub_views[i].photometric.color[k] *= share;
  }
  sv_status s = cal_squares_read(&squares, rig, b, err);
  for (int i = 0; i < c->n_cameras && s == SV_OK; i++) {
    c->cameras[i].n_squares = cal_squares_compare(&squares, rig, i, c->cameras[i].light);
    c->cameras[i].n_saturated = squares.n_saturated[i];
  }
  cal_squares_free(&squares);
  return s;
}

static sv_status check_images(const cal_options *o, lab_session *se, const sv_rig *rig, cal_boards *b,
                              cal_check *c, sv_err *err) {
  if (o->images.n != rig->n_sub_views)
    return sv_fail(
        err, SV_E_ARG,
        "%s has %d sub-views, --images names %d cameras: expected one per sub-view, in the rig's order",
        o->rig, rig->n_sub_views, o->images.n);
  sv_status s = sv_corners_available(o->n_cols, o->n_rows, err);
  if (s == SV_OK) s = cal_boards_list(b, o, err);
  if (s == SV_OK) s = cal_boards_find(b, se, NULL, err);
  for (int i = 0; i < b->n_cameras && s == SV_OK; i++) {
    const sv_camera_model *m = &rig->sub_views[i].model;
    if (b->size_px[i][0] != m->width_px || b->size_px[i][1] != m->height_px)
      s = sv_fail(err, SV_E_FORMAT, "%s: images of %dx%d pixels, but the rig's %s is for %dx%d",
                  o->images.of[i], b->size_px[i][0], b->size_px[i][1], rig->sub_views[i].name, m->width_px,
                  m->height_px);
  }
  if (s == SV_OK) s = cal_check_boards(c, rig, b, o->spacing_m, err);
  return s == SV_OK ? compare_light(rig, b, c, err) : s;
}

static void say(lab_session *se, const sv_rig *rig, const cal_check *c, double angle_deg) {
  lab_say(se, "rig \"%s\": %d sub-views, angular baseline %.2f degrees at %s", rig->name, rig->n_sub_views,
          angle_deg, c ? "the boards' center" : "20 rig widths in front of it");
  for (int i = 0; i < rig->n_sub_views; i++) {
    const sv_camera_model *m = &rig->sub_views[i].model;
    if (c)
      lab_say(se, "  %s: %d boards, %.3f px RMS alone, %.3f px in the rig, %.3f px from epipolar lines",
              rig->sub_views[i].name, c->cameras[i].n_boards, c->cameras[i].rms_alone_px,
              c->cameras[i].rms_rig_px, c->cameras[i].epipolar_px);
    else
      lab_say(se, "  %s: %s, %dx%d pixels, focal length %.1f px", rig->sub_views[i].name,
              sv_model_name(m->kind), m->width_px, m->height_px, m->p[0]);
  }
}

static sv_status check(const cal_options *o, lab_session *se, cal_boards *b, void *block, sv_err *err) {
  sv_rig rig;
  cal_check c = {0};
  cal_advice *a = calloc(1, sizeof *a);
  double centre[3];
  sv_status s = a ? cal_read_rig(&rig, o->rig, block, err) : sv_fail(err, SV_E_NOMEM, "no memory");
  bool has_images = o->images.n > 0;
  if (s == SV_OK && has_images) s = check_images(o, se, &rig, b, &c, err);
  if (s == SV_OK) {
    const cal_check *found = has_images ? &c : NULL;
    scene_centre(&rig, found, centre);
    double angle_deg = sv_rig_angular_baseline_rad(&rig, centre) * 180 / SV_PI;
    if (has_images) {
      cal_advise_spacing(a, o->spacing_m);
      advise(a, &c);
      advise_light(a, &rig, &c);
    }
    if (rig.n_sub_views > 1 && angle_deg < 0.2)
      cal_advise(a, "the angular baseline is %.2f degrees: the paper's gain begins at about 0.2; move closer",
                 angle_deg);
    say(se, &rig, found, angle_deg);
    for (int i = 0; i < a->n; i++) se->console.log(se->console.self, SV_LOG_WARN, a->text[i]);
    lab_report j = {0};
    if (o->is_json) {
      report(&j, &rig, found, angle_deg, a);
      s = lab_report_print(&j, err);
    }
  }
  cal_check_free(&c);
  free(a);
  return s;
}

int cal_cmd_check(const cal_options *o) {
  lab_session se;
  cal_boards b = {0};
  sv_err err = {0};
  void *block = malloc(CAL_RIG_BYTES);
  if (o->images.n > 0 && !o->board)
    return free(block), cal_usage("check", "--images needs --board and --spacing");
  sv_status s = lab_session_start(&se, o->threads, o->is_quiet, &err);
  if (s == SV_OK) s = sv_linux_catch_signals(&err);
  if (s == SV_OK && !block) s = sv_fail(&err, SV_E_NOMEM, "no memory for a rig");
  if (s == SV_OK) s = check(o, &se, &b, block, &err);
  if (s != SV_OK) lab_failed(&se, &err);
  cal_boards_free(&b);
  lab_session_stop(&se);
  free(block);
  return s == SV_OK ? CAL_EXIT_OK : CAL_EXIT_FAILED;
}
