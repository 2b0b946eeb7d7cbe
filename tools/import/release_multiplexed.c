// SPDX-License-Identifier: Apache-2.0
// The multiplexed camera of the authors' release: measurement.png at an eighth of the sensor's
// sides, and calibration.npz with the lenses and the light that each leaves on every pixel. It has
// no held-out views.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/str.h"
#include "tools/common/npz.h"
#include "tools/import/release_sensor.h"
#include "tools/import/release.h"

#define REDUCTION   8
#define LIT_COUNTS  16.0 // of 4x4 samples
#define MEASUREMENT "measurement"
#define POINTS      "points3d.ply"
#define TRANSFORMS  "transforms_train_multiplexed.json"

typedef struct {
  sv_npz z;
  const char *path;
  sv_npy sensor_size, names, k, pose, footprints, points;
  int n, sensor_px[2], grid_px[2]; // lenses; full sensor; measurement
  double max_overlap;
} calibration;

static sv_status get(calibration *c, const char *name, sv_npy *a, const size_t *dim, int n_dims,
                     sv_err *err) {
  sv_status s = sv_npz_get(&c->z, name, a, err);
  if (s == SV_OK && !sv_npy_is_shape(a, n_dims, dim))
    s = sv_fail(err, SV_E_FORMAT, "%.150s: %s has another shape than expected", c->path, name);
  return s;
}

// Halves to even, as Python's round.
static int eighth(int px) { return (int)nearbyint((double)px / REDUCTION); }

static sv_status open_calibration(calibration *c, const char *path, sv_err *err) {
  const size_t two[] = {2}, any[] = {0};
  c->path = path;
  sv_status s = sv_npz_open(&c->z, path, err);
  if (s == SV_OK) s = get(c, "sensor_size", &c->sensor_size, two, 1, err);
  if (s == SV_OK) s = get(c, "names", &c->names, any, 1, err);
  if (s != SV_OK) return s;
  const size_t n = c->names.n_items, k[] = {n, 3, 3}, pose[] = {n, 4, 4}, area[] = {n, 0, 0},
               points[] = {0, 3};
  s = get(c, "K", &c->k, k, 3, err);
  if (s == SV_OK) s = get(c, "camtoworld", &c->pose, pose, 3, err);
  if (s == SV_OK) s = get(c, "footprints", &c->footprints, area, 3, err);
  if (s == SV_OK) s = get(c, "points", &c->points, points, 2, err);
  if (s != SV_OK) return s;
  for (int i = 0; i < 2; i++) {
    const double px = sv_npy_real(&c->sensor_size, (size_t)i);
    if (!(px >= REDUCTION * LAB_MIN_SIDE_PX && px <= REDUCTION * 32767))
      return sv_fail(err, SV_E_RANGE, "%.150s: a sensor of %g pixels a side", path, px);
    c->sensor_px[i] = (int)px;
    c->grid_px[i] = eighth((int)px);
  }
  if (n < 1 || n > SV_CAP_SUB_VIEWS)
    return sv_fail(err, SV_E_RANGE, "%.150s: %zu lenses; expected 1 to %d", path, n, SV_CAP_SUB_VIEWS);
  const size_t h = c->footprints.dim[1], w = c->footprints.dim[2];
  if (c->footprints.kind != 'u' || c->footprints.item_bytes != 1 || w < (size_t)c->grid_px[0] ||
      h < (size_t)c->grid_px[1] || w * (size_t)c->sensor_px[1] != h * (size_t)c->sensor_px[0])
    return sv_fail(err, SV_E_FORMAT,
                   "%.150s: footprints of %zux%zu; expected bytes of at least %dx%d in the sensor's shape",
                   path, w, h, c->grid_px[0], c->grid_px[1]);
  c->n = (int)n;
  return SV_OK;
}

static void close_calibration(calibration *c) {
  sv_npy *const arrays[] = {&c->sensor_size, &c->names, &c->k, &c->pose, &c->footprints, &c->points};
  for (size_t i = 0; i < sizeof arrays / sizeof *arrays; i++) sv_npy_free(arrays[i]);
  sv_npz_close(&c->z);
}

// --- footprints ----------------------------------------------------------------------------------

// M_max: of the footprints as stored.
static double largest_sum(const calibration *c) {
  const size_t px = c->footprints.dim[1] * c->footprints.dim[2];
  unsigned most = 0;
  for (size_t i = 0; i < px; i++) {
    unsigned sum = 0;
    for (int m = 0; m < c->n; m++) sum += c->footprints.data[(size_t)m * px + i];
    if (sum > most) most = sum;
  }
  return most / LIT_COUNTS;
}

// The overlap of cell i of `to` cells with each of `from` cells over the same length, as weights
// that sum to 1: first cell in *at.
static double cell_weight(int from, int to, int i, int at) {
  const double lo = (double)i * from / to, hi = (double)(i + 1) * from / to;
  const double a = fmax(lo, at), b = fmin(hi, at + 1);
  return b > a ? (b - a) / (hi - lo) : 0;
}

// Area average of one lens's footprint on the measurement's pixels: share of 255.
static void average(const calibration *c, int lens, uint8_t *out) {
  const int w = (int)c->footprints.dim[2], h = (int)c->footprints.dim[1], gw = c->grid_px[0],
            gh = c->grid_px[1];
  const uint8_t *f = c->footprints.data + (size_t)lens * (size_t)w * (size_t)h;
  for (int y = 0; y < gh; y++)
    for (int x = 0; x < gw; x++) {
      double sum = 0;
      for (int v = y * h / gh; v < h && v < (y + 1) * (double)h / gh; v++)
        for (int u = x * w / gw; u < w && u < (x + 1) * (double)w / gw; u++)
          sum += cell_weight(h, gh, y, v) * cell_weight(w, gw, x, u) * f[(size_t)v * (size_t)w + (size_t)u];
      out[(size_t)y * (size_t)gw + (size_t)x] = (uint8_t)(fmin(1, sum / LIT_COUNTS) * 255 + 0.5);
    }
}

// The rectangle that a lens lights; width 0: nothing.
static sv_footprint lit_part(const calibration *c, const uint8_t *share) {
  int lo[2] = {c->grid_px[0], c->grid_px[1]}, hi[2] = {-1, -1};
  for (int y = 0; y < c->grid_px[1]; y++)
    for (int x = 0; x < c->grid_px[0]; x++) {
      if (!share[(size_t)y * (size_t)c->grid_px[0] + (size_t)x]) continue;
      lo[0] = x < lo[0] ? x : lo[0];
      hi[0] = x > hi[0] ? x : hi[0];
      lo[1] = y < lo[1] ? y : lo[1];
      hi[1] = y > hi[1] ? y : hi[1];
    }
  if (hi[0] < 0) return (sv_footprint){0};
  return (sv_footprint){lo[0], lo[1], hi[0] - lo[0] + 1, hi[1] - lo[1] + 1, NULL};
}

static sv_status save_part(const calibration *c, const uint8_t *share, const sv_footprint *at,
                           const char *path, sv_err *err) {
  uint8_t *part = malloc((size_t)at->width_px * (size_t)at->height_px);
  if (!part) return sv_fail(err, SV_E_NOMEM, "%s: no memory for it", path);
  for (int y = 0; y < at->height_px; y++)
    memcpy(part + (size_t)y * (size_t)at->width_px,
           share + (size_t)(y + at->y0_px) * (size_t)c->grid_px[0] + (size_t)at->x0_px, (size_t)at->width_px);
  const sv_bitmap b = {at->width_px, at->height_px, 1, 8, part, NULL};
  sv_status s = sv_bitmap_write_png(path, &b, err);
  free(part);
  return s;
}

// --- lenses --------------------------------------------------------------------------------------

// A camera on the measurement's grid, cut to the lens's place.
static sv_status place_lens(const calibration *c, int i, lab_sensor_lens *l, sv_err *err) {
  lab_import_view *v = &l->view;
  const size_t k = 9 * (size_t)i, p = 16 * (size_t)i;
  const double sx = (double)c->grid_px[0] / c->sensor_px[0], sy = (double)c->grid_px[1] / c->sensor_px[1];
  sv_pose w;
  v->model = (sv_camera_model){.kind = SV_MODEL_PINHOLE,
                               .width_px = v->crop.width_px,
                               .height_px = v->crop.height_px,
                               .p = {sv_npy_real(&c->k, k) * sx, sv_npy_real(&c->k, k + 4) * sy,
                                     sv_npy_real(&c->k, k + 2) * sx - v->crop.x0_px,
                                     sv_npy_real(&c->k, k + 5) * sy - v->crop.y0_px}};
  for (size_t a = 0; a < 3; a++) {
    for (size_t b = 0; b < 3; b++) w.r[3 * a + b] = sv_npy_real(&c->pose, p + 4 * a + b);
    w.t[a] = sv_npy_real(&c->pose, p + 4 * a + 3);
  }
  const double off = sv_rotation_error(w.r);
  if (!(off <= 1e-3) || !(v->model.p[0] > 0 && v->model.p[1] > 0))
    return sv_fail(err, SV_E_FORMAT, "%.150s: lens %d has no valid pose and focal length", c->path, i);
  v->cam_from_world = sv_pose_inv(&w);
  v->exposure = 0;
  v->sub_view = i;
  return SV_OK;
}

static sv_status add_lenses(const calibration *c, lab_sensor_lens *lenses, const char *folder, sv_err *err) {
  uint8_t *share = malloc((size_t)c->grid_px[0] * (size_t)c->grid_px[1]);
  sv_status s = share ? SV_OK : sv_fail(err, SV_E_NOMEM, "no memory for a footprint");
  for (int i = 0; i < c->n && s == SV_OK; i++) {
    char path[SV_CAP_PATH];
    average(c, i, share);
    lenses[i].view.crop = lit_part(c, share);
    if (lenses[i].view.crop.width_px < LAB_MIN_SIDE_PX || lenses[i].view.crop.height_px < LAB_MIN_SIDE_PX) {
      s = sv_fail(err, SV_E_RANGE, "%.150s: lens %d lights nothing, or less than %d pixels a side", c->path,
                  i, LAB_MIN_SIDE_PX);
      break;
    }
    snprintf(lenses[i].coverage, sizeof lenses[i].coverage, "coverage_%03d.png", i);
    s = place_lens(c, i, &lenses[i], err);
    if (s == SV_OK) s = sv_path_join(path, sizeof path, folder, lenses[i].coverage, err);
    if (s == SV_OK) s = save_part(c, share, &lenses[i].view.crop, path, err);
  }
  free(share);
  return s;
}

static sv_status copy_measurement(const calibration *c, const char *from, const char *folder, sv_err *err) {
  char to[SV_CAP_PATH];
  sv_bitmap b;
  sv_status s = sv_bitmap_read(from, &b, err);
  if (s != SV_OK) return s;
  if (b.width_px != c->grid_px[0] || b.height_px != c->grid_px[1])
    s = sv_fail(err, SV_E_FORMAT, "%.150s: %dx%d pixels; the calibration's sensor asks for %dx%d", from,
                b.width_px, b.height_px, c->grid_px[0], c->grid_px[1]);
  if (s == SV_OK) s = sv_path_join(to, sizeof to, folder, MEASUREMENT "_e00.png", err);
  if (s == SV_OK) s = sv_bitmap_write_png(to, &b, err);
  sv_bitmap_free(&b);
  return s;
}

// Grey, as the calibration has no colors.
static sv_status write_points(const calibration *c, const char *folder, sv_err *err) {
  char path[SV_CAP_PATH];
  lab_import im = {0};
  sv_status s = sv_path_join(path, sizeof path, folder, POINTS, err);
  for (size_t i = 0; i < c->points.dim[0] && s == SV_OK; i++) {
    sv_point *p = lab_import_add_point(&im);
    if (!p) s = sv_fail(err, SV_E_NOMEM, "no memory for %zu points", c->points.dim[0]);
    for (size_t k = 0; p && k < 3; k++) {
      p->mean[k] = (float)sv_npy_real(&c->points, 3 * i + k);
      p->rgb[k] = 0.5f;
    }
  }
  if (s == SV_OK) s = lab_import_write_points(&im, path, err);
  lab_import_free(&im);
  return s;
}

static sv_status write_dataset(lab_release *r, calibration *c, const char *measurement, sv_err *err) {
  char folder[SV_CAP_PATH];
  lab_sensor_lens *lenses = calloc((size_t)c->n, sizeof *lenses);
  sv_status s = lenses ? lab_release_folder(r, folder, (const char *const[]){"multiplexed", NULL, NULL}, err)
                       : sv_fail(err, SV_E_NOMEM, "no memory for %d lenses", c->n);
  if (s == SV_OK) s = copy_measurement(c, measurement, folder, err);
  if (s == SV_OK) s = add_lenses(c, lenses, folder, err);
  if (s == SV_OK) s = write_points(c, folder, err);
  const lab_sensor_file f = {lenses, c->n, largest_sum(c), MEASUREMENT, 1, POINTS};
  if (s == SV_OK) s = lab_sensor_write(&f, folder, TRANSFORMS, err);
  if (s == SV_OK)
    lab_release_made(r, folder, "%d lenses on %dx%d pixels, no held-out views", c->n, c->grid_px[0],
                     c->grid_px[1]);
  free(lenses);
  return s;
}

sv_status lab_release_multiplexed(lab_release *r, sv_err *err) {
  char npz[SV_CAP_PATH], measurement[SV_CAP_PATH];
  calibration c = {.n = 0};
  sv_status s = sv_path_join(npz, sizeof npz, r->data, "multiplexed/calibration.npz", err);
  if (s == SV_OK)
    s = sv_path_join(measurement, sizeof measurement, r->data, "multiplexed/measurement.png", err);
  if (s != SV_OK || !sv_path_exists(npz)) return s;
  s = open_calibration(&c, npz, err);
  if (s == SV_OK) s = write_dataset(r, &c, measurement, err);
  close_calibration(&c);
  return s;
}
