// SPDX-License-Identifier: Apache-2.0
// LPIPS against its authors' figures for their example pictures, and against values for a made pair
// that were written down when the authors' figures came out right.
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "platform/linux/linux.h"
#include "src/base/rng.h"
#include "tests/common/test.h"
#include "tools/common/imageio.h"
#include "tools/metric/lpips.h"

enum { W = 53, H = 41 };
static float a[3][H][W], b[3][H][W];
static uint8_t mask[H][W];
static const sv_image_pair im = {&a[0][0][0], &b[0][0][0], W, H, 3};
static sv_lpips *lpips;
static sv_err err;

// Discs on a checkerboard; b has them moved and some noise. Integers only, so the pictures are the
// same everywhere.
FIXTURE(setup) {
  for (int i = 0; i < H * W; i++) {
    int x = i % W, y = i / W;
    for (int c = 0; c < 3; c++) {
      int board = ((x >> 3) + (y >> 3)) % 2 ? 60 + 40 * c : 200 - 30 * c;
      int da = (x - 20) * (x - 20) + (y - 15) * (y - 15), db = (x - 24) * (x - 24) + (y - 17) * (y - 17);
      int noise = (int)(sv_hash3((uint32_t)x, (uint32_t)y, (uint32_t)c) % 21) - 10;
      a[c][y][x] = (float)(da < 100 ? 30 + 90 * c : board) / 255.0f;
      b[c][y][x] = (float)((db < 100 ? 30 + 90 * c : board) + noise) / 255.0f;
    }
    mask[y][x] = x + y < 45;
  }
  return sv_lpips_open(&lpips, NULL, &err) == SV_OK ? 0 : -1;
}

FIXTURE(teardown) {
  sv_lpips_close(lpips);
  return 0;
}

TEST(test_made_pair) {
  static float map[H * W];
  sv_pool one = sv_pool_serial();
  double v;
  assert_int_equal(sv_lpips_compare(lpips, &im, &one, &v, &err), SV_OK);
  assert_near(v, 0.057572575, 1e-8);
  assert_int_equal(sv_lpips_masked(lpips, &im, &mask[0][0], &one, &v, &err), SV_OK);
  assert_near(v, 0.050320743, 1e-8);
  assert_int_equal(sv_lpips_map(lpips, &im, &one, map, &err), SV_OK);
  double sum = 0;
  for (int i = 0; i < H * W; i++) {
    assert_true(map[i] >= 0);
    sum += (double)map[i];
  }
  assert_near(sum / (H * W), 0.057582302, 1e-8);
}

TEST(test_equal_pictures) {
  sv_pool one = sv_pool_serial();
  sv_image_pair same = {&a[0][0][0], &a[0][0][0], W, H, 3};
  double v = 1;
  assert_int_equal(sv_lpips_compare(lpips, &same, &one, &v, &err), SV_OK);
  assert_true(v == 0);
  // what the mask hides does not count; with nothing left the distance is 0
  static float c[3][H][W];
  for (int k = 0; k < 3; k++)
    for (int i = 0; i < H * W; i++) c[k][i / W][i % W] = mask[i / W][i % W] ? a[k][i / W][i % W] : 0.5f;
  sv_image_pair hidden = {&a[0][0][0], &c[0][0][0], W, H, 3};
  assert_int_equal(sv_lpips_masked(lpips, &hidden, &mask[0][0], &one, &v, &err), SV_OK);
  assert_true(v == 0);
  static const uint8_t none[H * W];
  v = 1;
  assert_int_equal(sv_lpips_masked(lpips, &im, none, &one, &v, &err), SV_OK);
  assert_true(v == 0);
}

TEST(test_whole_mask) {
  static uint8_t all[H * W];
  static float map[H * W];
  sv_pool one = sv_pool_serial();
  double v, sum = 0;
  memset(all, 1, sizeof all);
  assert_int_equal(sv_lpips_masked(lpips, &im, all, &one, &v, &err), SV_OK);
  assert_int_equal(sv_lpips_map(lpips, &im, &one, map, &err), SV_OK);
  for (int i = 0; i < H * W; i++) sum += (double)map[i];
  assert_near(v, sum / (H * W), 1e-12);
}

TEST(test_threads) {
  static sv_linux_pool threads;
  double v1, v3, m1, m3;
  sv_pool one = sv_pool_serial();
  assert_int_equal(sv_linux_pool_start(&threads, 3, -1, &err), SV_OK);
  sv_pool three = sv_linux_pool_port(&threads);
  assert_int_equal(sv_lpips_compare(lpips, &im, &one, &v1, &err), SV_OK);
  assert_int_equal(sv_lpips_compare(lpips, &im, &three, &v3, &err), SV_OK);
  assert_int_equal(sv_lpips_masked(lpips, &im, &mask[0][0], &one, &m1, &err), SV_OK);
  assert_int_equal(sv_lpips_masked(lpips, &im, &mask[0][0], &three, &m3, &err), SV_OK);
  sv_linux_pool_stop(&threads);
  assert_true(v1 == v3 && m1 == m3);
}

// The network and its buffers serve one size after the other, also larger ones; too small is
// refused.
TEST(test_sizes) {
  static const struct { int w, h; } size[] = {{17, 17}, {18, 40}, {19, 19}, {41, 17}, {20, 23}, {50, 40}};
  sv_pool one = sv_pool_serial();
  double before, after, v;
  assert_int_equal(sv_lpips_compare(lpips, &im, &one, &before, &err), SV_OK);
  for (size_t i = 0; i < sizeof size / sizeof *size; i++) {
    sv_image_pair part = {&a[0][0][0], &b[0][0][0], size[i].w, size[i].h, 3};
    assert_int_equal(sv_lpips_compare(lpips, &part, &one, &v, &err), SV_OK);
    assert_true(v > 0 && v < 2);
  }
  assert_int_equal(sv_lpips_compare(lpips, &im, &one, &after, &err), SV_OK);
  assert_true(before == after);
  sv_image_pair small = {&a[0][0][0], &b[0][0][0], 16, 41, 3}, grey = {&a[0][0][0], &b[0][0][0], W, H, 1};
  assert_int_equal(sv_lpips_compare(lpips, &small, &one, &v, &err), SV_E_RANGE);
  assert_contains(err.text, "17x17");
  assert_int_equal(sv_lpips_compare(lpips, &grey, &one, &v, &err), SV_E_RANGE);
}

static float *read_planes(const char *name, int *w, int *h) {
  char path[1024];
  sv_bitmap m;
  snprintf(path, sizeof path, "tests/data/lpips_examples/%s", name);
  assert_ok(sv_bitmap_read(path, &m, &err), &err);
  size_t n = (size_t)m.width_px * (size_t)m.height_px;
  float *p = m.bits == 8 && m.n_channels == 3 ? malloc(3 * n * sizeof *p) : NULL;
  for (size_t i = 0; p && i < 3 * n; i++) p[i % 3 * n + i / 3] = (float)m.u8[i] / 255.0f;
  *w = m.width_px;
  *h = m.height_px;
  sv_bitmap_free(&m);
  return p;
}

TEST(test_published) {
  static const struct {
    const char *name;
    double want;
  } cases[] = {{"ex_p0.png", 0.711048}, {"ex_p1.png", 0.147902}, {"ex_ref.png", 0}};
  sv_pool one = sv_pool_serial();
  int w, h, w2, h2;
  float *ref = read_planes("ex_ref.png", &w, &h);
  assert_non_null(ref);
  for (size_t i = 0; i < 3; i++) {
    double v;
    float *p = read_planes(cases[i].name, &w2, &h2);
    assert_true(p && w == w2 && h == h2);
    sv_image_pair pair = {ref, p, w, h, 3};
    assert_int_equal(sv_lpips_compare(lpips, &pair, &one, &v, &err), SV_OK);
    assert_near(v, cases[i].want, 1e-6);
    free(p);
  }
  free(ref);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_made_pair),  cmocka_unit_test(test_equal_pictures),
                                     cmocka_unit_test(test_whole_mask), cmocka_unit_test(test_threads),
                                     cmocka_unit_test(test_sizes),      cmocka_unit_test(test_published)};
  return cmocka_run_group_tests(tests, setup, teardown);
}
