// SPDX-License-Identifier: Apache-2.0
// Synthetic scenes of the authors' release: SCENE/transforms_test.json, and for each device and
// number of exposures SCENE/DEVICE/Nviews/train. Both grids divide one sensor: the light field's
// lens images lie side by side, those of the multiplexed sensor overlap. The release stores full
// views of the lenses; the sensor's picture of each is made here, as the authors' loader does.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/str.h"
#include "tools/import/release_sensor.h"
#include "tools/import/release.h"

#define GRID   4 // lenses a side
#define LENSES (GRID * GRID)
// A lens's side in units u, u = a twelfth of a quarter of the sensor's side, rounded down.
#define UNITS_LIGHTFIELD  12
#define UNITS_MULTIPLEXED 20

static const struct {
  const char *name, *device; // in the release; of ours
} devices[] = {
    {"monocular", "mono"}, {"stereo", "stereo"}, {"iphone", "phone"}, {"lightfield", "lightfield"}};

typedef struct {
  lab_release *r;
  const char *source;       // folder of the scene
  char folder[SV_CAP_PATH]; // of the dataset
  int n_files;
} scene_job;

static int compare_views(const void *a, const void *b) {
  const lab_import_view *x = a, *y = b;
  if (x->exposure != y->exposure) return (x->exposure > y->exposure) - (x->exposure < y->exposure);
  return (x->sub_view > y->sub_view) - (x->sub_view < y->sub_view);
}

// Exposures become 0, 1, ... in their order. Of one camera each frame is an exposure, whatever the
// file says; frames keep their order then.
static void number_exposures(lab_import *im, bool is_mono) {
  for (int i = 0; is_mono && i < im->n; i++) {
    im->views[i].exposure = i;
    im->views[i].sub_view = 0;
  }
  if (im->n > 1) qsort(im->views, (size_t)im->n, sizeof *im->views, compare_views);
  int n = -1, last = -1;
  for (int i = 0; i < im->n; i++) {
    lab_import_view *v = &im->views[i];
    if (i == 0 || v->exposure != last) n++;
    last = v->exposure;
    v->exposure = n;
  }
}

// Names in the dataset: e00_s00.png in a folder of the file.
static void name_views(lab_import *im, const char *folder) {
  for (int i = 0; i < im->n; i++) {
    lab_import_view *v = &im->views[i];
    snprintf(v->name, sizeof v->name, "%.60s/e%02d_s%02d%.8s", folder, v->exposure, v->sub_view,
             sv_path_extension(v->source));
  }
}

// --- grids ---------------------------------------------------------------------------------------

// RGB over black, 8 bits rounded down.
static void over_black(sv_bitmap *b) {
  const size_t n = (size_t)b->width_px * (size_t)b->height_px;
  if (b->n_channels != 4) return;
  for (size_t i = 0; i < n; i++)
    for (int k = 0; k < 3; k++)
      b->u8[3 * i + (size_t)k] = (uint8_t)(b->u8[4 * i + (size_t)k] * (unsigned)b->u8[4 * i + 3] / 255u);
  b->n_channels = 3;
}

// Bilinear between pixel centers, without a prefilter; dst [side][side][3], 0 to 255.
static void shrink(const sv_bitmap *b, int side, float *dst) {
  for (int y = 0; y < side; y++)
    for (int x = 0; x < side; x++) {
      double u = fmax(0, (x + 0.5) * b->width_px / side - 0.5),
             v = fmax(0, (y + 0.5) * b->height_px / side - 0.5);
      int x0 = (int)u, y0 = (int)v, x1 = x0 + 1 < b->width_px ? x0 + 1 : x0,
          y1 = y0 + 1 < b->height_px ? y0 + 1 : y0;
      double fx = u - x0, fy = v - y0;
      const uint8_t *rows[2] = {b->u8 + 3 * (size_t)y0 * (size_t)b->width_px,
                                b->u8 + 3 * (size_t)y1 * (size_t)b->width_px};
      for (int k = 0; k < 3; k++) {
        double top = (1 - fx) * rows[0][3 * x0 + k] + fx * rows[0][3 * x1 + k],
               low = (1 - fx) * rows[1][3 * x0 + k] + fx * rows[1][3 * x1 + k];
        dst[3 * ((size_t)y * (size_t)side + (size_t)x) + (size_t)k] = (float)((1 - fy) * top + fy * low);
      }
    }
}

static sv_status read_lens(const lab_import_view *v, int side, float *dst, sv_err *err) {
  sv_bitmap b;
  sv_status s = sv_bitmap_read(v->source, &b, err);
  if (s == SV_OK) s = sv_bitmap_to_8(&b, err);
  if (s == SV_OK && b.n_channels < 3) s = sv_bitmap_to_channels(&b, 3, err);
  if (s != SV_OK) return s;
  over_black(&b);
  shrink(&b, side, dst);
  sv_bitmap_free(&b);
  return SV_OK;
}

// The view at the size of its lens image.
static void resize_model(sv_camera_model *m, int side) {
  const double sx = (double)side / m->width_px, sy = (double)side / m->height_px;
  m->p[0] *= sx;
  m->p[2] *= sx;
  m->p[1] *= sy;
  m->p[3] *= sy;
  m->width_px = m->height_px = side;
}

static int lens_side(const lab_import *im, int units) {
  const sv_camera_model *m = &im->views[0].model;
  const int side = m->width_px < m->height_px ? m->width_px : m->height_px;
  return side / 4 / 12 * units;
}

static sv_status check_grid(const lab_import *im, const char *path, sv_err *err) {
  for (int i = 0; i < im->n; i++)
    if (im->n % LENSES || im->views[i].exposure != i / LENSES || im->views[i].sub_view != i % LENSES)
      return sv_fail(err, SV_E_FORMAT, "%.150s: expected %d views (view_id 0 to %d) of each exposure", path,
                     LENSES, LENSES - 1);
  if (lens_side(im, UNITS_LIGHTFIELD) < LAB_MIN_SIDE_PX)
    return sv_fail(err, SV_E_RANGE, "%.150s: pictures are too small for a sensor of %d lenses", path, LENSES);
  return SV_OK;
}

// Lens images side by side: each is a picture of its own.
static sv_status write_lightfield(scene_job *j, const lab_import *full, const char *transforms,
                                  const char *pictures, sv_err *err) {
  const int side = lens_side(full, UNITS_LIGHTFIELD);
  const size_t n = 3 * (size_t)side * (size_t)side;
  float *values = malloc(n * sizeof *values);
  uint8_t *bytes = malloc(n);
  lab_import im = {0};
  sv_status s = values && bytes ? SV_OK : sv_fail(err, SV_E_NOMEM, "no memory for a lens image");
  for (int i = 0; i < full->n && s == SV_OK; i++) {
    char path[SV_CAP_PATH], up[SV_CAP_PATH], name[SV_TRANSFORMS_CAP_PATH + 8];
    s = read_lens(&full->views[i], side, values, err);
    if (s == SV_OK) s = lab_release_copy(&im, &full->views[i], err);
    if (s != SV_OK) break;
    lab_import_view *v = &im.views[i];
    resize_model(&v->model, side);
    snprintf(v->name, sizeof v->name, "%.60s/e%02d_s%02d.png", pictures, v->exposure, v->sub_view);
    snprintf(name, sizeof name, "images/%s", v->name);
    for (size_t k = 0; k < n; k++) bytes[k] = (uint8_t)(values[k] + 0.5f);
    const sv_bitmap b = {side, side, 3, 8, bytes, NULL};
    s = sv_path_join(path, sizeof path, j->folder, name, err);
    sv_path_folder(up, sizeof up, path);
    if (s == SV_OK) s = sv_path_make_folder(up, err);
    if (s == SV_OK) s = sv_bitmap_write_png(path, &b, err);
    sv_copy(v->source, sizeof v->source, path);
  }
  if (s == SV_OK) s = lab_import_write_as(&im, j->r->se, j->folder, transforms, err);
  lab_import_free(&im);
  free(values);
  free(bytes);
  return s;
}

// Left or upper edge of lens i of a row of GRID.
static int lens_edge(int i, int side, int sensor_side) {
  return (int)floor((double)i * (sensor_side - side) / (GRID - 1) + 0.5);
}

// The place of view `id` of an exposure: the grid is turned and transposed on the sensor.
static void lens_place(int id, int *row, int *column) {
  *column = GRID - 1 - id / GRID;
  *row = GRID - 1 - id % GRID;
}

typedef struct {
  int width_px, height_px, side;
  float *sum, *lens;
  double *weight;
} sensor;

static sv_status add_lens(sensor *z, const lab_import_view *v, sv_footprint *place, sv_err *err) {
  int row, column;
  lens_place(v->sub_view, &row, &column);
  *place = (sv_footprint){.x0_px = lens_edge(column, z->side, z->width_px),
                          .y0_px = lens_edge(row, z->side, z->height_px),
                          .width_px = z->side,
                          .height_px = z->side};
  sv_status s = read_lens(v, z->side, z->lens, err);
  for (int y = 0; y < z->side && s == SV_OK; y++)
    for (int x = 0; x < z->side; x++) {
      const size_t to = (size_t)(y + place->y0_px) * (size_t)z->width_px + (size_t)(x + place->x0_px),
                   from = (size_t)y * (size_t)z->side + (size_t)x;
      z->weight[to] += 1;
      for (size_t k = 0; k < 3; k++)
        z->sum[3 * to + k] += (float)lab_srgb_decode((double)z->lens[3 * from + k] / 255);
    }
  return s;
}

static sv_status save_sensor(const sensor *z, double max_overlap, const char *path, sv_err *err) {
  const size_t n = 3 * (size_t)z->width_px * (size_t)z->height_px;
  uint16_t *values = malloc(n * sizeof *values);
  if (!values) return sv_fail(err, SV_E_NOMEM, "%s: no memory for it", path);
  for (size_t i = 0; i < n; i++)
    values[i] = (uint16_t)(65535 * lab_srgb_encode(fmin(1, (double)z->sum[i] / max_overlap)) + 0.5);
  const sv_bitmap b = {z->width_px, z->height_px, 3, 16, NULL, values};
  sv_status s = sv_bitmap_write_png(path, &b, err);
  free(values);
  return s;
}

static double largest(const sensor *z) {
  double most = 0;
  for (size_t i = 0; i < (size_t)z->width_px * (size_t)z->height_px; i++)
    if (z->weight[i] > most) most = z->weight[i];
  return most;
}

static void stop_sensor(sensor *z) {
  free(z->sum);
  free(z->weight);
  free(z->lens);
}

static sv_status start_sensor(sensor *z, const lab_import *full, sv_err *err) {
  const sv_camera_model *m = &full->views[0].model;
  *z = (sensor){m->width_px, m->height_px, lens_side(full, UNITS_MULTIPLEXED), NULL, NULL, NULL};
  const size_t px = (size_t)z->width_px * (size_t)z->height_px;
  z->sum = malloc(3 * px * sizeof *z->sum);
  z->weight = malloc(px * sizeof *z->weight);
  z->lens = malloc(3 * (size_t)z->side * (size_t)z->side * sizeof *z->lens);
  if (z->sum && z->weight && z->lens) return SV_OK;
  stop_sensor(z);
  return sv_fail(err, SV_E_NOMEM, "no memory for a sensor");
}

static sv_status write_multiplexed(scene_job *j, const lab_import *full, const char *transforms,
                                   const char *measurement, sv_err *err) {
  sensor z = {0};
  double max_overlap = 1;
  lab_sensor_lens *lenses = calloc((size_t)full->n, sizeof *lenses);
  sv_status s = lenses ? start_sensor(&z, full, err) : sv_fail(err, SV_E_NOMEM, "no memory for the lenses");
  if (s != SV_OK) {
    free(lenses);
    return s;
  }
  for (int e = 0; e < full->n / LENSES && s == SV_OK; e++) {
    char path[SV_CAP_PATH], name[100];
    const size_t px = (size_t)z.width_px * (size_t)z.height_px;
    memset(z.sum, 0, 3 * px * sizeof *z.sum);
    memset(z.weight, 0, px * sizeof *z.weight);
    for (int i = e * LENSES; i < (e + 1) * LENSES && s == SV_OK; i++) {
      lenses[i].view = full->views[i];
      resize_model(&lenses[i].view.model, z.side);
      s = add_lens(&z, &full->views[i], &lenses[i].view.crop, err);
    }
    max_overlap = largest(&z);
    snprintf(name, sizeof name, "%.60s_e%02d.png", measurement, e);
    if (s == SV_OK) s = sv_path_join(path, sizeof path, j->folder, name, err);
    if (s == SV_OK) s = save_sensor(&z, max_overlap, path, err);
  }
  const lab_sensor_file file = {lenses, full->n, max_overlap, measurement, full->n / LENSES, NULL};
  if (s == SV_OK) s = lab_sensor_write(&file, j->folder, transforms, err);
  stop_sensor(&z);
  free(lenses);
  return s;
}

// --- files ---------------------------------------------------------------------------------------

static sv_status device_file(scene_job *j, int i_device, int n_exposures, sv_err *err) {
  char part[80], dir[SV_CAP_PATH], path[SV_CAP_PATH], name[80], pictures[60];
  lab_import im = {0};
  snprintf(part, sizeof part, "%s/%dviews/train", devices[i_device].name, n_exposures);
  sv_status s = sv_path_join(dir, sizeof dir, j->source, part, err);
  if (s == SV_OK) s = sv_path_join(path, sizeof path, dir, "transforms_train.json", err);
  if (s != SV_OK || !sv_path_exists(path)) return s;
  s = lab_import_transforms_file(&im, dir, "transforms_train.json", "", err);
  if (s == SV_OK) number_exposures(&im, i_device == 0);
  snprintf(name, sizeof name, "transforms_train_%s_%dviews.json", devices[i_device].device, n_exposures);
  snprintf(pictures, sizeof pictures, "%s_%dviews", devices[i_device].device, n_exposures);
  const bool is_grid = sv_str_eq(devices[i_device].device, "lightfield");
  if (s == SV_OK && is_grid) s = check_grid(&im, path, err);
  if (s == SV_OK && is_grid) s = write_lightfield(j, &im, name, pictures, err);
  if (s == SV_OK && is_grid) {
    snprintf(name, sizeof name, "transforms_train_multiplexed_%dviews.json", n_exposures);
    snprintf(pictures, sizeof pictures, "multiplexed_%dviews", n_exposures);
    s = write_multiplexed(j, &im, name, pictures, err);
  }
  if (s == SV_OK && !is_grid) {
    name_views(&im, pictures);
    s = lab_import_write_as(&im, j->r->se, j->folder, name, err);
  }
  j->n_files += s == SV_OK ? 1 + is_grid : 0;
  lab_import_free(&im);
  return s;
}

static sv_status test_file(scene_job *j, int *n, sv_err *err) {
  lab_import im = {0};
  sv_status s = lab_import_transforms_file(&im, j->source, "transforms_test.json", "", err);
  for (int i = 0; i < im.n; i++) {
    im.views[i].exposure = -1;
    im.views[i].sub_view = i < SV_CAP_SUB_VIEWS ? i : -1;
  }
  *n = im.n;
  if (s == SV_OK) s = lab_release_positions(j->r, &im, j->source, j->folder, err);
  if (s == SV_OK) s = lab_import_write_as(&im, j->r->se, j->folder, "transforms_test.json", err);
  lab_import_free(&im);
  return s;
}

static sv_status synthetic_scene(lab_release *r, const char *folder, const char *scene, sv_err *err) {
  scene_job j = {.r = r, .source = folder};
  char path[SV_CAP_PATH];
  int n_test = 0;
  sv_status s = sv_path_join(path, sizeof path, folder, "transforms_test.json", err);
  if (s != SV_OK || !sv_path_exists(path)) return s; // the folder of .blend files
  s = lab_release_folder(r, j.folder, (const char *const[]){"synthetic", scene, NULL}, err);
  if (s == SV_OK) s = test_file(&j, &n_test, err);
  for (size_t i = 0; i < sizeof devices / sizeof *devices; i++)
    for (int n = 1; n <= 3 && s == SV_OK; n += 2) s = device_file(&j, (int)i, n, err);
  if (s == SV_OK && j.n_files == 0)
    s = sv_fail(err, SV_E_NOT_FOUND, "%.150s: has no DEVICE/1views/train/transforms_train.json", folder);
  if (s == SV_OK) lab_release_made(r, j.folder, "%d training files, %d test views", j.n_files, n_test);
  return s;
}

sv_status lab_release_synthetic(lab_release *r, sv_err *err) {
  return lab_release_scenes(r, "synthetic", synthetic_scene, err);
}
