// SPDX-License-Identifier: Apache-2.0
#include <string.h>

#include "tests/kernels/check.h"

typedef struct {
  int32_t light[2304];
  uint8_t display[SV_CORRECT_CODES];
  uint16_t inverse_falloff[64];
} tables;

static void one_case(ck *c, int w) {
  static tables t;
  const size_t row = (size_t)(3 * w);
  ck_begin(c, "%d px", w);
  ck_fill_bytes(c, t.display, sizeof t.display);
  for (int i = 0; i < 2304; i++) t.light[i] = (int32_t)(sv_rng_u32(&c->rng) >> 15) - 40000;
  for (int i = 0; i < 64; i++) t.inverse_falloff[i] = (uint16_t)(sv_rng_u32(&c->rng) >> 17);
  uint8_t *px = ck_bytes_at_end(c, 2 * row), was[400];
  ck_fill_bytes(c, px, 2 * row);
  memcpy(was, px, 2 * row);
  sv_correct_args a = {.px = px,
                       .stride_bytes = row,
                       .width_px = w,
                       .light = t.light,
                       .inverse_falloff = t.inverse_falloff,
                       .display = t.display,
                       .row0 = 1,
                       .row1 = 2};
  c->var.correct(&a);
  ck_true(c, memcmp(px, was, row) == 0, "a row that is not asked for");
  for (int x = 0; x < w; x++)
    for (int i = 0; i < 3; i++) {
      const uint8_t *in = was + row + 3 * x;
      int64_t v = 0;
      for (int k = 0; k < 3; k++) v += t.light[768 * i + 256 * k + in[k]];
      v = v < 0 ? 0 : v > 131071 ? 131071 : v;
      const int64_t code = (v * t.inverse_falloff[w + x] + 4096) / 8192;
      const int must = t.display[code > 16383 ? 16383 : code], is = px[row + (size_t)(3 * x + i)];
      ck_true(c, is == must, "channel %d of pixel %d is %d, must be %d", i, x, is, must);
    }
}

static void check_correct(ck *c) {
  for (int w = 1; w < 32; w++) one_case(c, w);
}

static void run(void *arg, const sv_kernels *k) { k->correct(arg); }
static void bench_correct(ck *c) {
  static uint16_t inverse_falloff[640 * 480];
  static int32_t light[2304];
  ck_begin(c, "bench");
  uint8_t *px = ck_bytes(c, 640 * 480 * 3), *display = ck_bytes(c, SV_CORRECT_CODES);
  ck_fill_bytes(c, px, 640 * 480 * 3);
  ck_fill_bytes(c, display, SV_CORRECT_CODES);
  for (int i = 0; i < 640 * 480; i++) inverse_falloff[i] = SV_CORRECT_FALLOFF;
  for (int i = 0; i < 2304; i++) light[i] = i % 256 * 80;
  sv_correct_args a = {.px = px,
                       .stride_bytes = 640 * 3,
                       .width_px = 640,
                       .light = light,
                       .inverse_falloff = inverse_falloff,
                       .display = display,
                       .row1 = 480};
  ck_time(c, "640x480", 640 * 480, run, &a);
}
CK_REGISTER(correct, check_correct, bench_correct)
