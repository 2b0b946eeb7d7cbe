// SPDX-License-Identifier: Apache-2.0
// The measurement noise: moments, 14-bit levels, alpha, and the same bits however it is called.
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "src/image/noise.h"
#include "tests/common/test.h"

static uint8_t memory[1 << 18];
static sv_noise tables;

FIXTURE(setup) {
  memset(memory, 0xa5, sizeof memory);
  sv_arena a = sv_arena_make(memory, sv_noise_bytes() + SV_ARENA_ALIGN);
  assert_int_equal(sv_noise_init(&tables, &a), SV_OK);
  assert_true(a.used_bytes <= sv_noise_bytes() + SV_ARENA_ALIGN);
  sv_arena small = sv_arena_make(memory + sv_noise_bytes() + 256, sv_noise_bytes() - 1);
  sv_noise t;
  assert_int_equal(sv_noise_init(&t, &small), SV_E_NOMEM);
  return 0;
}

static double encode(double x) { return x <= 0.0031308 ? 12.92 * x : 1.055 * pow(x, 1 / 2.4) - 0.055; }
static double decode(double y) { return y <= 0.04045 ? y / 12.92 : pow((y + 0.055) / 1.055, 2.4); }

// N samples of y = x + s z: the mean within 5 s / sqrt(N), the variance within 5 sqrt(2 / N) of
// itself, the channels uncorrelated within 5 / sqrt(N).
#define N 400000
TEST(test_moments) {
  static const sv_noise_model models[] = {{1e-4f, 0.01f}, {0.0f, 0.004f}, {2.5e-3f, 0.0f}, {1e-6f, 1e-6f}};
  static const double xs[] = {0.02, 0.25, 0.7, 1.0};
  for (size_t m = 0; m < sizeof models / sizeof *models; m++)
    for (size_t i = 0; i < sizeof xs / sizeof *xs; i++) {
      double x = (double)(float)xs[i], sum[3] = {0}, sq[3] = {0}, cross[3] = {0}, kurt = 0;
      double s = sqrt((double)models[m].read + (double)models[m].shot * x);
      for (uint32_t k = 0; k < N; k++) {
        const uint32_t key[2] = {(uint32_t)m + 7, (uint32_t)i};
        float in[3] = {(float)x, (float)x, (float)x}, out[3];
        sv_noise_add(&tables, &models[m], key, k, in, out);
        double z[3];
        for (int c = 0; c < 3; c++) {
          z[c] = ((double)out[c] - x) / s;
          sum[c] += z[c];
          sq[c] += z[c] * z[c];
        }
        for (int c = 0; c < 3; c++) cross[c] += z[c] * z[(c + 1) % 3];
        kurt += z[0] * z[0] * z[0] * z[0];
      }
      for (int c = 0; c < 3; c++) {
        assert_true(fabs(sum[c] / N) < 5 / sqrt(N));
        assert_true(fabs(sq[c] / N - 1) < 5 * sqrt(2.0 / N));
        assert_true(fabs(cross[c] / N) < 5 / sqrt(N));
      }
      assert_true(fabs(kurt / N - 3) < 5 * sqrt(96.0 / N)); // Gaussian in its tails, too
    }
}

TEST(test_neighbours_are_independent) {
  sv_noise_model m = {1, 0};
  double across = 0, pictures[2] = {0};
  float last = 0, zero[3] = {0}, a[3], b[3], c[3];
  for (uint32_t k = 0; k < N; k++) {
    sv_noise_add(&tables, &m, (uint32_t[]){1, 2}, k, zero, a);
    sv_noise_add(&tables, &m, (uint32_t[]){1, 3}, k, zero, b);
    sv_noise_add(&tables, &m, (uint32_t[]){2, 2}, k, zero, c);
    across += (double)a[0] * (double)last;
    last = a[0];
    pictures[0] += (double)a[0] * (double)b[0];
    pictures[1] += (double)a[0] * (double)c[0];
  }
  assert_true(fabs(across / N) < 5 / sqrt(N));
  assert_true(fabs(pictures[0] / N) < 5 / sqrt(N) && fabs(pictures[1] / N) < 5 / sqrt(N));
}

// Without noise a 16-bit picture may only take the 16384 levels, and each pixel the nearest one.
TEST(test_levels) {
  static uint16_t px[65536 * 3];
  static uint8_t seen[65536];
  for (int i = 0; i < 65536; i++) px[3 * i] = px[3 * i + 1] = px[3 * i + 2] = (uint16_t)i;
  sv_noise_job j = {.key = {1, 1}};
  assert_int_equal(sv_noise_u16(&tables, &j, px, 3, 65536), SV_OK);
  memset(seen, 0, sizeof seen);
  for (int i = 0; i < 65536; i++) {
    double x = decode(i / 65535.0), code = floor(16383 * x + 0.5);
    assert_true(fabs(65535 * encode(code / 16383) - px[3 * i]) < 1.01 ||
                fabs(16383 * x - floor(16383 * x) - 0.5) < 1e-3); // between two codes: either
    seen[px[3 * i]] = 1;
  }
  int n_levels = 0;
  for (int i = 0; i < 65536; i++) n_levels += seen[i];
  assert_in_range(n_levels, 12000, 16384);
  assert_int_equal(px[0], 0);
  assert_int_equal(px[3 * 65535], 65535);
  assert_int_equal(sv_noise_quantise(-1), 0);
  assert_int_equal(sv_noise_quantise(2), 16383);
  assert_int_equal(sv_noise_quantise(0.5f / 16383), 1);
  assert_int_equal(sv_noise_quantise(0.49f / 16383), 0);
  uint8_t all[256 * 3]; // 14 bits hold all 8-bit display values
  for (int i = 0; i < 768; i++) all[i] = (uint8_t)(i / 3);
  assert_int_equal(sv_noise_u8(&tables, &j, all, 3, 256), SV_OK);
  for (int i = 0; i < 768; i++) assert_int_equal(all[i], i / 3);
}

// A grey picture, measured: moments in linear light, as far as 8 bits can tell.
TEST(test_display_pictures) {
  enum { SIDE = 300 };
  static uint8_t px[SIDE * SIDE * 3], again[SIDE * SIDE * 3];
  static uint16_t deep[SIDE * SIDE * 3];
  sv_noise_job j = {.model = {4e-4f, 2e-3f}, .key = {3, 9}};
  memset(px, 170, sizeof px);
  memset(again, 170, sizeof again);
  for (int i = 0; i < SIDE * SIDE * 3; i++) deep[i] = 170 * 257;
  assert_int_equal(sv_noise_u8(&tables, &j, px, 3, SIDE * SIDE), SV_OK);
  assert_int_equal(sv_noise_u8(&tables, &j, again, 3, SIDE * SIDE), SV_OK);
  assert_memory_equal(px, again, sizeof px);
  assert_int_equal(sv_noise_u16(&tables, &j, deep, 3, SIDE * SIDE), SV_OK);
  double x = decode(170 / 255.0), want = 4e-4 + 2e-3 * x, n = SIDE * SIDE * 3, sum = 0, sq = 0;
  for (int i = 0; i < SIDE * SIDE * 3; i++) {
    double e = decode(deep[i] / 65535.0) - x;
    sum += e;
    sq += e * e;
    assert_true(abs((deep[i] + 128) / 257 - px[i]) <= 1); // the same noise at both depths
  }
  assert_true(fabs(sum / n) < 5 * sqrt(want / n));
  assert_true(fabs(sq / n / want - 1) < 5 * sqrt(2 / n));
}

TEST(test_alpha) {
  uint8_t px[4 * 4] = {200, 100, 50, 255, 200, 100, 50, 128, 200, 100, 50, 0, 255, 255, 255, 255},
                 flat[4 * 3];
  sv_noise_job j = {.key = {1, 1}};
  uint8_t before[sizeof px];
  memcpy(before, px, sizeof px);
  assert_int_equal(sv_noise_u8(&tables, &j, px, 4, 4), SV_E_ARG); // the caller has to say so
  assert_memory_equal(px, before, sizeof px);
  assert_int_equal(sv_noise_u8(&tables, &j, px, 1, 4), SV_E_ARG);
  j.is_over_black = true;
  assert_int_equal(sv_noise_u8(&tables, &j, px, 4, 4), SV_OK);
  static const uint8_t want[4 * 4] = {200, 100, 50, 255, 100, 50, 25, 255, 0, 0, 0, 255, 255, 255, 255, 255};
  for (int i = 0; i < 16; i++) assert_true(abs(px[i] - want[i]) <= 1);
  // Noise reaches empty pixels as well, and is the one of the same picture without alpha.
  j.model = (sv_noise_model){0.01f, 0.01f};
  memcpy(px, want, sizeof px);
  for (int i = 0; i < 12; i++) flat[i] = want[i / 3 * 4 + i % 3];
  assert_int_equal(sv_noise_u8(&tables, &j, px, 4, 4), SV_OK);
  assert_int_equal(sv_noise_u8(&tables, &j, flat, 3, 4), SV_OK);
  for (int i = 0; i < 12; i++) assert_int_equal(px[i / 3 * 4 + i % 3], flat[i]);
  assert_true(px[8] || px[9] || px[10]);
  uint16_t deep[4] = {65535, 32768, 0, 0};
  assert_int_equal(sv_noise_u16(&tables, &(sv_noise_job){.is_over_black = true}, deep, 4, 1), SV_OK);
  assert_true(deep[0] == 0 && deep[1] == 0 && deep[3] == 65535);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_moments), cmocka_unit_test(test_neighbours_are_independent),
      cmocka_unit_test(test_levels),  cmocka_unit_test(test_display_pictures),
      cmocka_unit_test(test_alpha),
  };
  return cmocka_run_group_tests(tests, setup, NULL);
}
