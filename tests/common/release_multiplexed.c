// SPDX-License-Identifier: Apache-2.0
// The multiplexed sensor of the release's folder: one measurement and its calibration.
#include <math.h>
#include <string.h>

#include "tests/common/npz_write.h"
#include "tests/common/release_folder.h"
#include "tests/common/release_maker.h"
#include "tests/common/test.h"
#include "tools/common/imageio.h"

#define GRID_W 64 // an eighth of 516: 64.5, halves to even
#define GRID_H 50
// of the stored footprints: a quarter of the sensor, no multiple of the grid
#define FOOTPRINT_W 129
#define FOOTPRINT_H 100
#define LENS_RADIUS 0.32 // of the sensor's width

static double decode(double x) { return x <= 0.04045 ? x / 12.92 : pow((x + 0.055) / 1.055, 2.4); }
static double encode(double x) { return x <= 0.0031308 ? 12.92 * x : 1.055 * pow(x, 1 / 2.4) - 0.055; }

// Center of a lens image as a share of the sensor.
static void lens_center(int i, double at[2]) {
  at[0] = i % 2 ? 0.66 : 0.34;
  at[1] = i / 2 ? 0.66 : 0.34;
}

static void make_footprints(uint8_t *counts) {
  for (int i = 0; i < RELEASE_N_LENSES; i++)
    for (int y = 0; y < FOOTPRINT_H; y++)
      for (int x = 0; x < FOOTPRINT_W; x++) {
        double at[2];
        lens_center(i, at);
        int n = 0;
        for (int s = 0; s < 16; s++)
          n += hypot((x + (s % 4 + 0.5) / 4) / FOOTPRINT_W - at[0],
                     ((y + (s / 4 + 0.5) / 4) / FOOTPRINT_H - at[1]) * RELEASE_SENSOR_H / RELEASE_SENSOR_W) <
               LENS_RADIUS;
        counts[((size_t)i * FOOTPRINT_H + (size_t)y) * FOOTPRINT_W + (size_t)x] = (uint8_t)n;
      }
}

// What a lens sees on the measurement's grid, by a camera with its center there.
static void lens_camera(int i, camera *c, double k[9]) {
  double at[2];
  const double f = 0.9 * RELEASE_SENSOR_W;
  lens_center(i, at);
  *c = release_moved(release_around(45, 25, f / 8, GRID_W, GRID_H), i % 2 ? 0.2 : -0.2, i / 2 ? 0.2 : -0.2);
  const double m[9] = {f, 0, at[0] * RELEASE_SENSOR_W, 0, f, at[1] * RELEASE_SENSOR_H, 0, 0, 1};
  memcpy(k, m, sizeof m);
}

static void add_light(maker *m, int i, const uint8_t *counts, double *sum, double *weight) {
  camera c;
  double k[9];
  uint8_t rgb[3 * GRID_W * GRID_H];
  lens_camera(i, &c, k);
  const double sx = (double)GRID_W / RELEASE_SENSOR_W, sy = (double)GRID_H / RELEASE_SENSOR_H;
  const double p[4] = {k[0] * sx, k[4] * sy, k[2] * sx, k[5] * sy};
  const sv_view v = sv_view_make(GRID_W, GRID_H, p, &c.pose);
  sv_sim_render(&m->sim, &v, 0, rgb, NULL);
  for (int y = 0; y < GRID_H; y++)
    for (int x = 0; x < GRID_W; x++) {
      const size_t to = (size_t)y * GRID_W + (size_t)x;
      double w = 0; // 4x4 samples of the cell are enough here
      for (int s = 0; s < 16; s++)
        w += counts[((size_t)i * FOOTPRINT_H + (size_t)((y + (s / 4 + 0.5) / 4) * FOOTPRINT_H / GRID_H)) *
                        FOOTPRINT_W +
                    (size_t)((x + (s % 4 + 0.5) / 4) * FOOTPRINT_W / GRID_W)] /
             256.0;
      weight[to] += w;
      for (size_t j = 0; j < 3; j++) sum[3 * to + j] += w * decode(rgb[3 * to + j] / 255.0);
    }
}

static void put_measurement(const maker *m, const double *sum, double largest) {
  uint8_t px[3 * GRID_W * GRID_H];
  char path[SV_CAP_PATH];
  sv_err err;
  for (size_t i = 0; i < sizeof px; i++) px[i] = (uint8_t)(255 * encode(fmin(1, sum[i] / largest)) + 0.5);
  const sv_bitmap b = {GRID_W, GRID_H, 3, 8, px, NULL};
  release_path(m, "multiplexed/measurement.png", path);
  assert_ok(sv_bitmap_write_png(path, &b, &err), &err);
}

static void put_calibration(const maker *m, const uint8_t *counts, bool is_deflated) {
  npz_archive z = {.is_deflated = is_deflated};
  char path[SV_CAP_PATH];
  const int64_t size[2] = {RELEASE_SENSOR_W, RELEASE_SENSOR_H};
  uint32_t names[RELEASE_N_LENSES * 4] = {0};
  float k32[RELEASE_N_LENSES * 9], points[20 * 3];
  double poses[RELEASE_N_LENSES * 16] = {0};
  for (int i = 0; i < RELEASE_N_LENSES; i++) {
    camera c;
    double k[9];
    lens_camera(i, &c, k);
    for (int j = 0; j < 9; j++) k32[9 * i + j] = (float)k[j];
    const sv_pose w = sv_pose_inv(&c.pose);
    for (int a = 0; a < 3; a++) {
      for (int b = 0; b < 3; b++) poses[16 * i + 4 * a + b] = w.r[3 * a + b];
      poses[16 * i + 4 * a + 3] = w.t[a];
    }
    poses[16 * i + 15] = 1;
    names[4 * i] = 'L';
    names[4 * i + 1] = (uint32_t)('0' + i);
  }
  for (int i = 0; i < 60; i++) points[i] = 0.3f * (float)((i * 37) % 11 - 5) / 5;
  static const uint32_t metadata[] = {'{', '}'};
  npz_add(&z, &(npz_array){"sensor_size", "<i8", "(2,)", size, sizeof size});
  npz_add(&z, &(npz_array){"names", "<U4", "(4,)", names, sizeof names});
  npz_add(&z, &(npz_array){"K", "<f4", "(4, 3, 3)", k32, sizeof k32});
  npz_add(&z, &(npz_array){"camtoworld", "<f8", "(4, 4, 4)", poses, sizeof poses});
  npz_add(&z, &(npz_array){"footprints", "|u1", "(4, 100, 129)", counts,
                           (size_t)RELEASE_N_LENSES * FOOTPRINT_W * FOOTPRINT_H});
  npz_add(&z, &(npz_array){"points", "<f4", "(20, 3)", points, sizeof points});
  npz_add(&z, &(npz_array){"metadata", "<U2", "()", metadata, sizeof metadata});
  release_path(m, "multiplexed/calibration.npz", path);
  npz_save(&z, path);
  npz_free(&z);
}

void release_put_multiplexed(maker *m) {
  static uint8_t counts[RELEASE_N_LENSES * FOOTPRINT_W * FOOTPRINT_H];
  static double sum[3 * GRID_W * GRID_H], weight[GRID_W * GRID_H];
  unsigned most = 0;
  memset(sum, 0, sizeof sum);
  make_footprints(counts);
  for (int i = 0; i < RELEASE_N_LENSES; i++) add_light(m, i, counts, sum, weight);
  for (size_t i = 0; i < FOOTPRINT_W * FOOTPRINT_H; i++) {
    unsigned n = 0;
    for (size_t k = 0; k < RELEASE_N_LENSES; k++) n += counts[k * FOOTPRINT_W * FOOTPRINT_H + i];
    if (n > most) most = n;
  }
  put_measurement(m, sum, most / 16.0);
  put_calibration(m, counts, true);
}
