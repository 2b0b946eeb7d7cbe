// SPDX-License-Identifier: Apache-2.0
// Metrics against values that an independent script computed from the formulas (direct sums in
// double), and against cases that can be done by hand.
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "src/metric/metric.h"
#include "tests/common/test.h"

enum { W = 29, H = 23 };
static float a[3][H][W], b[3][H][W];
static uint8_t mask[H][W];
static double scratch[11 * 6 * W];
static const sv_image_pair im = {&a[0][0][0], &b[0][0][0], W, H, 3};

static uint32_t lcg = 1;
static double next(void) {
  lcg = lcg * 1664525u + 1013904223u;
  return (double)(lcg >> 24) / 255.0;
}

FIXTURE(setup) {
  for (int c = 0; c < 3; c++)
    for (int y = 0; y < H; y++)
      for (int x = 0; x < W; x++) {
        double r = next(), q = next();
        a[c][y][x] = (float)(0.5 * r + 0.5 * x / W);
        b[c][y][x] = (float)(0.4 * r + 0.1 * q + 0.5 * x / W);
      }
  for (int y = 0; y < H; y++)
    for (int x = 0; x < W; x++) mask[y][x] = (x * 7 + y * 5) % 11 < 4 && !(x < 14 && y < 14) ? 255 : 0;
  return sv_ssim_scratch_doubles(W) == sizeof scratch / sizeof *scratch ? 0 : -1;
}

TEST(test_against_reference) {
  double v;
  assert_near(sv_psnr(&im), 27.644389373468094, 1e-10);
  assert_near(sv_psnr_masked(&im, &mask[0][0]), 27.322350858192827, 1e-10);
  assert_int_equal(sv_ssim(&im, SV_SSIM_SAME, scratch, &v), SV_OK);
  assert_near(v, 0.9650331807203157, 1e-12);
  assert_int_equal(sv_ssim(&im, SV_SSIM_VALID, scratch, &v), SV_OK);
  assert_near(v, 0.9498445548067878, 1e-12);
  assert_int_equal(sv_ssim_masked(&im, &mask[0][0], scratch, &v), SV_OK);
  assert_near(v, 0.9582246999022871, 1e-12);
}

// Over what a mask leaves: the plain value for a whole mask; elsewhere nothing matters.
TEST(test_ssim_counted) {
  static uint8_t all[H][W], none[H][W];
  static float c[3][H][W];
  const sv_image_pair other = {&a[0][0][0], &c[0][0][0], W, H, 3};
  double v, v2;
  memset(all, 1, sizeof all);
  assert_int_equal(sv_ssim_counted(&im, &all[0][0], scratch, &v), SV_OK);
  assert_int_equal(sv_ssim(&im, SV_SSIM_SAME, scratch, &v2), SV_OK);
  assert_near(v, v2, 1e-12);
  assert_int_equal(sv_ssim_counted(&im, &none[0][0], scratch, &v), SV_OK);
  assert_near(v, 1, 0);
  memcpy(c, b, sizeof c);
  for (int k = 0; k < 3; k++)
    for (int y = 0; y < H; y++)
      for (int x = 0; x < W; x++)
        if (!mask[y][x]) c[k][y][x] = (float)next();
  assert_int_equal(sv_ssim_counted(&im, &mask[0][0], scratch, &v), SV_OK);
  assert_int_equal(sv_ssim_counted(&other, &mask[0][0], scratch, &v2), SV_OK);
  assert_near(v, v2, 0);
  assert_true(v < 1 && v > 0.9);
}

TEST(test_by_hand) {
  double v, v2;
  static uint8_t all[H][W], none[H][W], u[300], w[300];
  memset(all, 1, sizeof all);
  sv_image_pair same = {&a[0][0][0], &a[0][0][0], W, H, 3};
  assert_near(sv_psnr(&same), 100, 1e-12);
  assert_int_equal(sv_ssim(&same, SV_SSIM_SAME, scratch, &v), SV_OK);
  assert_near(v, 1, 1e-12);
  // a whole mask gives the plain values: "valid" SSIM, PSNR (the clamps do not bite on this pair)
  assert_near(sv_psnr_masked(&im, &all[0][0]), sv_psnr(&im), 1e-12);
  assert_int_equal(sv_ssim_masked(&im, &all[0][0], scratch, &v), SV_OK);
  assert_int_equal(sv_ssim(&im, SV_SSIM_VALID, scratch, &v2), SV_OK);
  assert_near(v, v2, 1e-12);
  // nothing in the mask: every window counts as 1
  assert_near(sv_psnr_masked(&im, &none[0][0]), 100, 1e-12);
  assert_int_equal(sv_ssim_masked(&im, &none[0][0], scratch, &v), SV_OK);
  assert_near(v, 1, 1e-12);
  // constant images: variances are zero, SSIM = (2 m1 m2 + C1) / (m1^2 + m2^2 + C1) in every whole
  // window
  static float flat[2][H][W];
  for (int i = 0; i < H * W; i++) {
    flat[0][i / W][i % W] = 0.25f;
    flat[1][i / W][i % W] = 0.75f;
  }
  sv_image_pair f = {&flat[0][0][0], &flat[1][0][0], W, H, 1};
  assert_int_equal(sv_ssim(&f, SV_SSIM_VALID, scratch, &v), SV_OK);
  assert_near(v, (2 * 0.25 * 0.75 + 1e-4) / (0.0625 + 0.5625 + 1e-4), 1e-12);
  assert_near(sv_psnr(&f), -10 * log10(0.25), 1e-12);
  // mse = 3 of 255^2
  for (int i = 0; i < 300; i++) {
    u[i] = 10;
    w[i] = (uint8_t)(i % 3 ? 10 : 13);
  }
  assert_near(sv_psnr_u8(u, w, 300), -10 * log10(3 / 65025.0), 1e-10);
  sv_image_pair tiny = {&a[0][0][0], &b[0][0][0], 10, 23, 1};
  assert_int_equal(sv_ssim(&tiny, SV_SSIM_VALID, scratch, &v), SV_E_RANGE);
  assert_int_equal(sv_ssim(&tiny, SV_SSIM_SAME, scratch, &v), SV_OK);
  assert_int_equal(sv_ssim_masked(&tiny, &mask[0][0], scratch, &v), SV_E_RANGE);
  sv_image_pair one = {&a[0][0][0], &a[0][0][0], 1, 1, 1}; // smaller than half a window
  assert_int_equal(sv_ssim(&one, SV_SSIM_SAME, scratch, &v), SV_OK);
  assert_near(v, 1, 1e-12);
}

// Flat pictures, mask only in the columns from K on: the sums can be written down. A window that
// sees `count` of its 11 columns weights them with s = (their weights) * 11 / count, so means are s
// m, second moments s m^2, variances (s - s^2) m^2 (0 when negative); with no column at all the
// window counts as 1.
TEST(test_masked_by_hand) {
  enum { K = 17 };
  static float flat[2][H][W];
  static uint8_t half[H][W];
  double v, sum = 0, g[11], total = 0;
  const double ma = 0.25, mb = 0.75;
  for (int i = 0; i < H * W; i++) {
    flat[0][i / W][i % W] = (float)ma;
    flat[1][i / W][i % W] = (float)mb;
    half[i / W][i % W] = i % W >= K;
  }
  sv_image_pair f = {&flat[0][0][0], &flat[1][0][0], W, H, 1};
  for (int t = 0; t < 11; t++) total += g[t] = exp(-(t - 5) * (t - 5) / 4.5);
  for (int x = 0; x + 10 < W; x++) {
    double w = 0;
    int count = 0;
    for (int t = 0; t < 11; t++)
      if (x + t >= K) {
        w += g[t] / total;
        count++;
      }
    double s = count ? w * 11 / count : 0, d = s - s * s > 0 ? s - s * s : 0, c = s - s * s;
    double cov = c * ma * mb > d * ma * mb    ? d * ma * mb
                 : c * ma * mb < -d * ma * mb ? -d * ma * mb
                                              : c * ma * mb;
    sum += (2 * s * s * ma * mb + 1e-4) * (2 * cov + 9e-4) /
           ((s * s * (ma * ma + mb * mb) + 1e-4) * (d * (ma * ma + mb * mb) + 9e-4));
    if (count == 0) assert_near(s, 0, 0);
  }
  assert_int_equal(sv_ssim_masked(&f, &half[0][0], scratch, &v), SV_OK);
  assert_near(v, sum / (W - 10), 1e-12);
  // the error of the pixels outside does not count
  assert_near(sv_psnr_masked(&f, &half[0][0]), -10 * log10(0.25), 1e-12);
  for (int i = 0; i < H * W; i++) flat[0][i / W][i % W] = i % W < K ? 0.0f : i % 2 ? 0.5f : 0.625f;
  double n = 0, e = 0;
  for (int i = 0; i < H * W; i++)
    if (i % W >= K) {
      n++;
      e += i % 2 ? 1.0 / 16 : 1.0 / 64;
    }
  assert_near(sv_psnr_masked(&f, &half[0][0]), -10 * log10(e / n), 1e-12);
}

TEST(test_depth) {
  const float d[8] = {1, 2.2f, 0, NAN, 5, INFINITY, -1, 4}, t[8] = {2, 2, 2, 2, 0, 2, 2, NAN};
  const uint8_t m[8] = {0, 1, 1, 1, 1, 1, 1, 1};
  sv_depth_error e = sv_depth_compare(d, t, NULL, 8);
  assert_int_equal(e.n, 2);
  assert_near(e.abs_rel, (0.5 + 0.1) / 2, 1e-7);
  assert_near(e.rmse, sqrt((1 + 0.04) / 2), 1e-7);
  assert_near(e.coverage, 2 / 6.0, 1e-12);
  e = sv_depth_compare(d, t, m, 8);
  assert_int_equal(e.n, 1);
  assert_near(e.abs_rel, 0.1, 1e-7);
  assert_near(e.coverage, 1 / 5.0, 1e-12);
  e = sv_depth_compare(d, t, m, 1);
  assert_true(e.n == 0 && e.abs_rel == 0 && e.rmse == 0 && e.coverage == 0);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_against_reference), cmocka_unit_test(test_by_hand),
                                     cmocka_unit_test(test_ssim_counted),
                                     cmocka_unit_test(test_masked_by_hand), cmocka_unit_test(test_depth)};
  return cmocka_run_group_tests(tests, setup, NULL);
}
