// SPDX-License-Identifier: Apache-2.0
// LPIPS with VGG16 by a file of made weights, against the network written down plainly in double
// precision; files that are something else get one sentence.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/rng.h"
#include "src/format/crc32c.h"
#include "tests/common/test.h"
#include "tools/common/fileio.h"
#include "tools/metric/features.h"
#include "tools/metric/lpips.h"

enum { W = 22, H = 19, N_LINEAR = 64 + 128 + 256 + 512 + 512, HEADER = 24 };

static const int n_convs[5] = {2, 2, 3, 3, 3}, n_outs[5] = {64, 128, 256, 512, 512};
static float a[3][H][W], b[3][H][W];
static uint8_t *file;
static float *values; // within the file
static size_t n_values;
static sv_err err;

static void put32(uint8_t *p, uint32_t v) {
  for (int i = 0; i < 4; i++) p[i] = (uint8_t)(v >> (8 * i));
}

static double uniform(uint32_t i, uint32_t k) { return (double)sv_hash3(i, k, 9) * 0x1p-32; }

FIXTURE(setup) {
  n_values = sv_net_floats(SV_NET_VGG) + N_LINEAR;
  file = malloc(HEADER + 4 * n_values);
  if (!file || temp_folder_setup(state) != 0) return -1;
  values = (float *)(void *)(file + HEADER);
  size_t at = 0;
  for (int block = 0, n_in = 3; block < 5; block++)
    for (int i = 0; i < n_convs[block]; i++, n_in = n_outs[block]) {
      const double size = sqrt(24.0 / (9 * n_in)); // keeps the activations' size
      for (int k = 0; k < 9 * n_in * n_outs[block]; k++, at++)
        values[at] = (float)(size * (uniform((uint32_t)at, 0) - 0.5));
      for (int k = 0; k < n_outs[block]; k++, at++)
        values[at] = (float)(0.1 * (uniform((uint32_t)at, 0) - 0.5));
    }
  for (; at < n_values; at++) values[at] = (float)uniform((uint32_t)at, 0);
  memset(file, 0, HEADER);
  memcpy(file, "SVLPIPS1", 8);
  put32(file + 8, 4);
  put32(file + 12, (uint32_t)n_values);
  put32(file + 16, sv_crc32c(0, values, 4 * n_values));
  for (int i = 0; i < 3 * H * W; i++) {
    (&a[0][0][0])[i] = (float)uniform((uint32_t)i, 1);
    (&b[0][0][0])[i] = (float)(0.7 * uniform((uint32_t)i, 1) + 0.3 * uniform((uint32_t)i, 2));
  }
  return 0;
}

FIXTURE(teardown) {
  free(file);
  return temp_folder_teardown(state);
}

// --- the network, plainly: planes [channel][y][x] ------------------------------------------------

typedef struct {
  int w, h, n;
  double *v;
} planes;

static planes planes_make(int w, int h, int n) {
  planes p = {w, h, n, calloc((size_t)(w * h * n), sizeof(double))};
  assert_non_null(p.v);
  return p;
}

static void convolve(planes *p, int n_out, const float **at) {
  planes out = planes_make(p->w, p->h, n_out);
  const float *weight = *at, *bias = weight + (size_t)9 * (size_t)p->n * (size_t)n_out;
  for (int o = 0; o < n_out; o++)
    for (int y = 0; y < p->h; y++)
      for (int x = 0; x < p->w; x++) {
        double sum = (double)bias[o];
        for (int i = 0; i < p->n; i++)
          for (int t = 0; t < 9; t++) {
            const int yy = y + t / 3 - 1, xx = x + t % 3 - 1;
            if (yy < 0 || xx < 0 || yy >= p->h || xx >= p->w) continue;
            sum += (double)weight[(o * p->n + i) * 9 + t] * p->v[(i * p->h + yy) * p->w + xx];
          }
        out.v[(o * p->h + y) * p->w + x] = sum > 0 ? sum : 0;
      }
  *at = bias + n_out;
  free(p->v);
  *p = out;
}

static void halve(planes *p) {
  planes out = planes_make(p->w / 2, p->h / 2, p->n);
  for (int c = 0; c < p->n; c++)
    for (int y = 0; y < out.h; y++)
      for (int x = 0; x < out.w; x++) {
        double most = 0;
        for (int t = 0; t < 4; t++)
          most = fmax(most, p->v[(c * p->h + 2 * y + t / 2) * p->w + 2 * x + t % 2]);
        out.v[(c * out.h + y) * out.w + x] = most;
      }
  free(p->v);
  *p = out;
}

static double distance(const planes *p, const planes *q, const float *linear) {
  const int n = p->w * p->h;
  double sum = 0;
  for (int i = 0; i < n; i++) {
    double lp = 0, lq = 0;
    for (int c = 0; c < p->n; c++) {
      lp += p->v[c * n + i] * p->v[c * n + i];
      lq += q->v[c * n + i] * q->v[c * n + i];
    }
    for (int c = 0; c < p->n; c++) {
      const double d = p->v[c * n + i] / (sqrt(lp) + 1e-10) - q->v[c * n + i] / (sqrt(lq) + 1e-10);
      sum += (double)linear[c] * d * d / n;
    }
  }
  return sum;
}

static double reference(void) {
  static const double shift[3] = {-0.030, -0.088, -0.188}, scale[3] = {0.458, 0.448, 0.450};
  planes p[2] = {planes_make(W, H, 3), planes_make(W, H, 3)};
  const float *linear = values + n_values - N_LINEAR, *start = values;
  double sum = 0;
  for (int i = 0; i < 3 * W * H; i++)
    for (int k = 0; k < 2; k++)
      p[k].v[i] =
          (2 * (double)(k ? &b[0][0][0] : &a[0][0][0])[i] - 1 - shift[i / (W * H)]) / scale[i / (W * H)];
  for (int block = 0; block < 5; block++) {
    const float *end = start;
    for (int k = 0; k < 2; k++) {
      if (block) halve(&p[k]);
      end = start;
      for (int i = 0; i < n_convs[block]; i++) convolve(&p[k], n_outs[block], &end);
    }
    start = end;
    sum += distance(&p[0], &p[1], linear);
    linear += n_outs[block];
  }
  free(p[0].v);
  free(p[1].v);
  return sum;
}

static const char *save(const void *data, size_t bytes) {
  static char path[400];
  snprintf(path, sizeof path, "%s/vgg.bin", temp_folder);
  assert_ok(sv_file_write(path, data, bytes, &err), &err);
  return path;
}

TEST(test_vgg) {
  sv_lpips *l;
  sv_pool one = sv_pool_serial();
  const sv_image_pair im = {&a[0][0][0], &b[0][0][0], W, H, 3}, same = {&a[0][0][0], &a[0][0][0], W, H, 3};
  double v;
  assert_ok(sv_lpips_open(&l, save(file, HEADER + 4 * n_values), &err), &err);
  assert_ok(sv_lpips_compare(l, &im, &one, &v, &err), &err);
  const double want = reference();
  assert_true(want > 0.01);
  assert_near(v, want, 1e-5 * want);
  assert_ok(sv_lpips_compare(l, &same, &one, &v, &err), &err);
  assert_true(v == 0);
  sv_lpips_close(l);
}

TEST(test_damaged) {
  sv_lpips *l;
  file[HEADER + 1000] ^= 1;
  assert_error(sv_lpips_open(&l, save(file, HEADER + 4 * n_values), &err), SV_E_FORMAT, &err, "damaged");
  file[HEADER + 1000] ^= 1;
  assert_error(sv_lpips_open(&l, save(file, 1000), &err), SV_E_FORMAT, &err, "not the expected");
  assert_error(sv_lpips_open(&l, "/nowhere/vgg.bin", &err), SV_E_NOT_FOUND, &err, "vgg.bin");
  assert_null(l);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_vgg), cmocka_unit_test(test_damaged)};
  return cmocka_run_group_tests(tests, setup, teardown);
}
