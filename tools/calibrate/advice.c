// SPDX-License-Identifier: Apache-2.0
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/str.h"
#include "tools/calibrate/calibrate.h"

#define FEW_BOARDS     8
#define FEW_SHARED     4
#define LITTLE_TILT    25.0  // degrees between the board's normals
#define LITTLE_SPREAD  0.65  // of the image's width or height
#define UNCERTAIN      0.005 // of the focal length
#define UNCERTAIN_DEG  0.1
#define LARGE_RMS_PX   1.0
#define FRAME_TIMES    3.0 // the median board's RMS
#define LARGE_SQUARE_M 0.5 // of a board that somebody can hold before a camera

void cal_advise(cal_advice *a, const char *fmt, ...) {
  va_list ap;
  if (a->n == CAL_CAP_ADVICE) return;
  va_start(ap, fmt);
  sv_vfmt(a->text[a->n++], sizeof a->text[0], fmt, ap);
  va_end(ap);
}

void cal_report_warnings(lab_report *r, const cal_advice *a) {
  lab_report_array(r, "warnings");
  for (int i = 0; i < a->n; i++) {
    lab_report_item_begin(r);
    lab_report_text(r, "text", a->text[i]);
    lab_report_item_end(r);
  }
  lab_report_array_end(r);
}

void cal_advise_spacing(cal_advice *a, double spacing_m) {
  if (spacing_m > LARGE_SQUARE_M) cal_advise(a, "--spacing is in meters: %.6g m between corners?", spacing_m);
}

static const char *side(double centre, const char *low, const char *high) {
  return centre < 0.5 ? low : high;
}

static void advise_coverage(cal_advice *a, const char *name, const sv_boards_camera *q) {
  bool is_narrow = q->spread_u < LITTLE_SPREAD, is_low = q->spread_v < LITTLE_SPREAD;
  if (is_narrow)
    cal_advise(a,
               "%s saw the board only in the %s part of its image (%.0f %% of the width): the lens model "
               "is extrapolated elsewhere; show the board at the %s edge, too",
               name, side(q->centre_u, "left", "right"), 100 * q->spread_u,
               side(q->centre_u, "right", "left"));
  if (is_low)
    cal_advise(a,
               "%s saw the board only in the %s part of its image (%.0f %% of the height): the lens model "
               "is extrapolated elsewhere; show the board at the %s edge, too",
               name, side(q->centre_v, "upper", "lower"), 100 * q->spread_v,
               side(q->centre_v, "lower", "upper"));
  if (!is_narrow && !is_low && q->coverage < 0.6)
    cal_advise(a,
               "%s has corners in only %.0f %% of the 25 cells of its image: show the board in the image "
               "corners, too",
               name, 100 * q->coverage);
}

static void advise_camera(cal_advice *a, const cal_boards *b, const sv_boards_result *r, int c) {
  const sv_boards_camera *q = &r->cameras[c];
  const char *name = b->cameras[c].name;
  double share = q->fx_sd_px / r->models[c].p[0];
  if (q->n_boards < FEW_BOARDS)
    cal_advise(a, "%s saw the board in only %d images: take at least %d, better 20", name, q->n_boards,
               FEW_BOARDS);
  if (q->tilt_deg < LITTLE_TILT)
    cal_advise(a,
               "%s saw the board from nearly one direction (%.0f degrees between its normals): tilt it by 20 "
               "to 45 degrees in all directions, or focal length and distance stay ambiguous",
               name, q->tilt_deg);
  advise_coverage(a, name, q);
  if (!(share < UNCERTAIN))
    cal_advise(a, "%s: the focal length is uncertain by %.2f %%: more boards, tilted and near, help", name,
               100 * share);
  if (!(q->rotation_sd_deg < UNCERTAIN_DEG))
    cal_advise(a,
               "%s: its direction in the rig is uncertain by %.2f degrees: more boards that it sees together "
               "with other cameras help",
               name, q->rotation_sd_deg);
  if (q->rms_px > LARGE_RMS_PX)
    cal_advise(a,
               "%s has %.2f px RMS: is the board flat, are the images sharp, is the lens model rich enough?",
               name, q->rms_px);
}

static int compare(const void *a, const void *b) {
  double x = *(const double *)a, y = *(const double *)b;
  return (x > y) - (x < y);
}

static double median_board(const cal_boards *b, const sv_boards_result *r) {
  double all[2048]; // a sample is enough
  int n = 0;
  for (int i = 0; i < b->n_cameras * b->n_frames && n < 2048; i++)
    if (b->is_seen[i]) all[n++] = r->board_rms_px[i];
  if (!n) return 0;
  qsort(all, (size_t)n, sizeof *all, compare);
  return all[n / 2];
}

// A board that fits badly where the others fit well moved, or was found wrongly.
static void advise_frames(cal_advice *a, const cal_boards *b, const sv_boards_result *r) {
  double limit = FRAME_TIMES * median_board(b, r);
  for (int c = 0; c < b->n_cameras; c++)
    for (int f = 0; f < b->n_frames; f++) {
      double rms = r->board_rms_px[c * b->n_frames + f];
      if (rms > limit && rms > 0.3)
        cal_advise(a, "%s, frame %s: %.2f px RMS, the median is %.2f: was the board moving? Remove the frame",
                   b->cameras[c].name, b->frames[f], rms, limit / FRAME_TIMES);
    }
}

void cal_advise_boards(cal_advice *a, const cal_boards *b, const sv_boards_result *r) {
  for (int c = 0; c < b->n_cameras; c++) advise_camera(a, b, r, c);
  for (int c = 1; c < b->n_cameras; c++) {
    int n_shared = 0;
    for (int f = 0; f < b->n_frames; f++) {
      bool is_other = false;
      for (int k = 0; k < b->n_cameras; k++)
        is_other = is_other || (k != c && b->is_seen[k * b->n_frames + f]);
      n_shared += is_other && b->is_seen[c * b->n_frames + f];
    }
    if (n_shared < FEW_SHARED)
      cal_advise(
          a, "%s saw the board together with other cameras in only %d frames: take more in which both see it",
          b->cameras[c].name, n_shared);
  }
  advise_frames(a, b, r);
  if (r->n_outliers * 20 > r->n_points)
    cal_advise(a, "%d of %d corners were rejected as outliers; plots/ shows where they are", r->n_outliers,
               r->n_outliers + r->n_points);
}
