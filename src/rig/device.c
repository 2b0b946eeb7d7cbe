// SPDX-License-Identifier: Apache-2.0
#include "src/rig/device.h"

#include <math.h>

#include "src/base/mathx.h"
#include "src/base/str.h"

static const sv_device_info DEVICES[] = {
#define X(id, name, text, angle_deg, forward, layout, rows, cols, overlap)                                   \
  {name, text, angle_deg, SV_FORWARD_##forward, SV_LAYOUT_##layout, rows, cols, overlap},
#include "src/rig/devices.inc"
};

typedef struct {
  sv_device_id device;
  const char *name;
  double zoom, place;
} camera;

static const camera CAMERAS[] = {
#define V(id, name, zoom, place) {SV_DEVICE_##id, name, zoom, place},
#include "src/rig/devices.inc"
};
#define N_CAMERAS ((int)(sizeof CAMERAS / sizeof *CAMERAS))

const sv_device_info *sv_device_info_of(sv_device_id id) { return &DEVICES[id]; }

sv_device_params sv_device_defaults(sv_device_id id) {
  const sv_device_info *d = &DEVICES[id];
  return (sv_device_params){.device = id,
                            .angle_rad = d->angle_deg * SV_PI / 180,
                            .rows = d->rows,
                            .cols = d->cols,
                            .overlap = d->overlap};
}

int sv_device_n_cameras(sv_device_id id) {
  int n = 0;
  if (DEVICES[id].layout == SV_LAYOUT_GRID) return 1;
  for (int i = 0; i < N_CAMERAS; i++) n += CAMERAS[i].device == id;
  return n;
}

int sv_device_n_sub_views(const sv_device_params *p) {
  return DEVICES[p->device].layout == SV_LAYOUT_GRID ? p->rows * p->cols : sv_device_n_cameras(p->device);
}

// --- what can be built ---------------------------------------------------------------------------

static int pitch_of(int side_px, int n, double overlap) { return (int)floor(side_px / (n - 1 + overlap)); }

static sv_status check_grid(const sv_device_params *p, sv_err *err) {
  const sv_device_info *d = &DEVICES[p->device];
  if (d->layout != SV_LAYOUT_GRID)
    return p->rows == 1 && p->cols == 1 && p->overlap == 1
               ? SV_OK
               : sv_fail(err, SV_E_ARG, "device %s has no grid of lenses; a grid of 1x1 was expected",
                         d->name);
  if (p->rows < 1 || p->cols < 1 || p->rows > SV_CAP_SUB_VIEWS || p->cols > SV_CAP_SUB_VIEWS ||
      p->rows * p->cols > SV_CAP_SUB_VIEWS)
    return sv_fail(err, SV_E_RANGE, "device %s: a grid of %dx%d lenses; 1 to %d were expected", d->name,
                   p->rows, p->cols, SV_CAP_SUB_VIEWS);
  if (!(p->overlap >= 1 && p->overlap <= SV_DEVICE_CAP_OVERLAP))
    return sv_fail(err, SV_E_RANGE, "device %s: an overlap of %g; 1 to %g was expected", d->name, p->overlap,
                   SV_DEVICE_CAP_OVERLAP);
  if (p->overlap > 1 && d->forward != SV_FORWARD_MULTIPLEXED)
    return sv_fail(err, SV_E_ARG, "device %s: an overlap of %g, but its views lie side by side (overlap 1)",
                   d->name, p->overlap);
  if (pitch_of(p->width_px, p->cols, p->overlap) < 1 || pitch_of(p->height_px, p->rows, p->overlap) < 1)
    return sv_fail(err, SV_E_RANGE, "device %s: %dx%d lenses do not fit on a sensor of %dx%d pixels", d->name,
                   p->rows, p->cols, p->width_px, p->height_px);
  return SV_OK;
}

sv_status sv_device_check(const sv_device_params *p, sv_err *err) {
  if ((unsigned)p->device >= SV_N_DEVICES)
    return sv_fail(err, SV_E_ARG, "no device %d; expected 0 to %d", (int)p->device, SV_N_DEVICES - 1);
  const sv_device_info *d = &DEVICES[p->device];
  if (p->width_px < 1 || p->height_px < 1 || p->width_px > 32767 || p->height_px > 32767)
    return sv_fail(err, SV_E_RANGE, "device %s: a sensor of %dx%d pixels; sides of 1 to 32767 were expected",
                   d->name, p->width_px, p->height_px);
  if (!(p->focal_per_width > 0 && p->focal_per_width < 1e3) || !(p->distance_m > 0 && p->distance_m < 1e9))
    return sv_fail(err, SV_E_RANGE,
                   "device %s: a focal length of %g widths at %g m from the scene; numbers "
                   "above 0 were expected",
                   d->name, p->focal_per_width, p->distance_m);
  sv_status s = check_grid(p, err);
  if (s < 0) return s;
  double deg = p->angle_rad * 180 / SV_PI;
  bool is_spread = sv_device_n_sub_views(p) > 1;
  if (!(deg >= 0 && deg <= SV_DEVICE_CAP_ANGLE_DEG) || (is_spread && !(deg > 0)))
    return sv_fail(err, SV_E_RANGE,
                   "device %s: an angular baseline of %g degrees, expected more than 0 (all cameras in one "
                   "place) and at most %g",
                   d->name, deg, SV_DEVICE_CAP_ANGLE_DEG);
  return SV_OK;
}

// --- building ------------------------------------------------------------------------------------

static sv_sub_view *add(sv_rig *rig, const sv_device_params *p, int w, int h, double zoom,
                        const double direction[3]) {
  sv_sub_view *v = &rig->sub_views[rig->n_sub_views++];
  double focal_px = zoom * (p->focal_per_width * w);
  *v = (sv_sub_view){.model = {.kind = SV_MODEL_PINHOLE,
                               .width_px = w,
                               .height_px = h,
                               .p = {focal_px, focal_px, 0.5 * w, 0.5 * h}}};
  double at[3] = {0, 0, p->distance_m}, up[3] = {0, -1, 0}, eye[3], n = sv_norm3(direction);
  for (int i = 0; i < 3; i++) eye[i] = at[i] + p->distance_m * direction[i] / n;
  (void)sv_pose_look_at(&v->cam_from_rig, eye, at, up); // the direction is never along up
  return v;
}

// Where a camera of a ROW or TRIANGLE is, seen from the scene's centre. Three directions at polar
// angle rho are equally far apart, with cos(angle) = 1 - 1.5 sin(rho)^2.
static void direction_of(double d[3], const camera *c, sv_device_layout layout, double angle_rad) {
  d[0] = d[1] = 0;
  d[2] = -1;
  if (layout == SV_LAYOUT_ROW) {
    double a = 0.5 * angle_rad * c->place;
    d[0] = sv_sin(a);
    d[2] = -sv_cos(a);
  } else if (layout == SV_LAYOUT_TRIANGLE) {
    double s = sqrt((1 - sv_cos(angle_rad)) / 1.5), a = c->place * SV_PI / 180;
    d[0] = s * sv_cos(a);
    d[1] = s * sv_sin(a);
    d[2] = -sqrt(1 - s * s);
  }
}

static void build_cameras(sv_rig *rig, const sv_device_params *p) {
  for (int i = 0; i < N_CAMERAS; i++) {
    const camera *c = &CAMERAS[i];
    if (c->device != p->device) continue;
    double d[3];
    direction_of(d, c, DEVICES[p->device].layout, p->angle_rad);
    int i_camera = rig->n_sub_views;
    sv_sub_view *v = add(rig, p, p->width_px, p->height_px, c->zoom, d);
    v->i_camera = i_camera;
    (void)sv_copy(v->name, sizeof v->name, c->name);
  }
}

// Distance of two neighbours on the plane at distance 1, for this angle between opposite corners.
static double grid_step(const sv_device_params *p) {
  int longer = sv_maxi(p->rows, p->cols) - 1, shorter = sv_mini(p->rows, p->cols) - 1;
  if (longer < 1) return 0;
  double ratio = (double)shorter / longer;
  return sv_tan(0.5 * p->angle_rad) / sqrt(1 + ratio * ratio) * (2.0 / longer);
}

static int lens_side(int pitch_px, int sensor_px, int n, double overlap) {
  return sv_mini((int)floor(overlap * pitch_px + 0.5), sensor_px - (n - 1) * pitch_px);
}

static void build_grid(sv_rig *rig, const sv_device_params *p) {
  int pitch_x = pitch_of(p->width_px, p->cols, p->overlap);
  int pitch_y = pitch_of(p->height_px, p->rows, p->overlap);
  int w = lens_side(pitch_x, p->width_px, p->cols, p->overlap);
  int h = lens_side(pitch_y, p->height_px, p->rows, p->overlap);
  double step = grid_step(p);
  bool is_long = p->rows > 10 || p->cols > 10; // names stay unique: v07, v1207
  for (int row = 0; row < p->rows; row++)
    for (int col = 0; col < p->cols; col++) {
      double d[3] = {(col - 0.5 * (p->cols - 1)) * step, (row - 0.5 * (p->rows - 1)) * step, -1};
      sv_sub_view *v = add(rig, p, w, h, 1, d);
      (void)sv_fmt(v->name, sizeof v->name, is_long ? "v%02d%02d" : "v%d%d", row, col);
      v->footprint =
          (sv_footprint){.x0_px = col * pitch_x, .y0_px = row * pitch_y, .width_px = w, .height_px = h};
    }
}

sv_status sv_device_build(sv_rig *rig, const sv_device_params *p, sv_err *err) {
  sv_status s = sv_device_check(p, err);
  if (s < 0) return s;
  const sv_device_info *d = &DEVICES[p->device];
  if (sv_device_n_sub_views(p) > rig->cap_sub_views)
    return sv_fail(err, SV_E_RANGE, "device %s has %d sub-views and the rig has room for %d", d->name,
                   sv_device_n_sub_views(p), rig->cap_sub_views);
  (void)sv_copy(rig->name, sizeof rig->name, d->name);
  rig->forward = d->forward;
  rig->n_sub_views = 0;
  if (d->layout == SV_LAYOUT_GRID) build_grid(rig, p);
  else build_cameras(rig, p);
  return SV_OK;
}

// --- overlap -------------------------------------------------------------------------------------

static bool covers_x(const sv_sub_view *v, int i_camera, int x_px) {
  const sv_footprint *f = &v->footprint;
  return v->i_camera == i_camera && f->height_px > 0 && f->x0_px <= x_px && x_px < f->x0_px + f->width_px;
}

static bool covers_y(const sv_sub_view *v, int y_px) {
  return v->footprint.y0_px <= y_px && y_px < v->footprint.y0_px + v->footprint.height_px;
}

// The maximum is reached where one rectangle begins in x and one in y.
int sv_device_largest_overlap(const sv_rig *rig, int i_camera) {
  const sv_sub_view *v = rig->sub_views;
  int best = 0;
  for (int i = 0; i < rig->n_sub_views; i++) {
    int x = v[i].footprint.x0_px;
    if (!covers_x(&v[i], i_camera, x)) continue;
    for (int j = 0; j < rig->n_sub_views; j++) {
      if (!covers_x(&v[j], i_camera, x)) continue;
      int n = 0, y = v[j].footprint.y0_px;
      for (int k = 0; k < rig->n_sub_views; k++) n += covers_x(&v[k], i_camera, x) && covers_y(&v[k], y);
      best = sv_maxi(best, n);
    }
  }
  return best;
}
