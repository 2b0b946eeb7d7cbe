// SPDX-License-Identifier: Apache-2.0
// Meters of a camera: mean, clipping and histogram of known pictures, and a sharpness that blur
// lowers and light does not.
#include <string.h>

#include "src/capture/meter.h"
#include "tests/common/test.h"

#define W 160
#define H 120

static uint8_t px[H * W * 3];

static sv_frame grey(int (*value)(int x, int y)) {
  for (int y = 0; y < H; y++)
    for (int x = 0; x < W; x++) memset(px + 3 * (y * W + x), value(x, y), 3);
  return (sv_frame){.width_px = W, .height_px = H, .stride_bytes = 3 * W, .format = SV_PIX_RGB8, .data = px};
}

static int middle(int x, int y) { return 128 + 0 * (x + y); }
static int half_clipped(int x, int y) { return x < W / 2 ? 255 : 100 + 0 * y; }
static int stripes(int x, int y) { return (x / 8 + y / 8) % 2 ? 200 : 40; }
static int dim_stripes(int x, int y) { return stripes(x, y) / 4; }
// The same behind a box of 8 pixels along x.
static int blurred(int x, int y) {
  int sum = 0;
  for (int k = 0; k < 8; k++) sum += stripes(x + k, y);
  return sum / 8;
}

static sv_meter of(int (*value)(int x, int y)) {
  const sv_frame f = grey(value);
  sv_meter m;
  assert_true(sv_meter_frame(&f, &m));
  return m;
}

TEST(test_light) {
  const sv_meter m = of(middle), c = of(half_clipped);
  assert_near(m.luma, 128 / 255.0, 1e-9);
  assert_true(m.clipped == 0 && m.black == 0 && m.sharpness == 0);
  assert_int_equal(m.histogram[128 * SV_METER_BINS / 256], (int)m.sums.n);
  assert_near(c.clipped, 0.5, 0.02);
  assert_int_equal(c.histogram[SV_METER_BINS - 1], (int)(c.clipped * c.sums.n + 0.5));
}

TEST(test_sharpness) {
  const sv_meter sharp = of(stripes), dim = of(dim_stripes), soft = of(blurred);
  assert_true(sharp.sharpness > 0.1);
  assert_near(dim.sharpness / sharp.sharpness, 1, 0.05);
  assert_true(soft.sums.dx2 < 0.5 * sharp.sums.dx2);
}

TEST(test_bad_frames) {
  sv_meter m;
  sv_frame f = grey(middle);
  f.format = SV_PIX_JPEG;
  assert_false(sv_meter_frame(&f, &m));
  f = grey(middle);
  f.data_bytes = 100; // shorter than it says
  assert_false(sv_meter_frame(&f, &m));
  f = grey(middle);
  f.width_px = 2;
  assert_false(sv_meter_frame(&f, &m));
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_light), cmocka_unit_test(test_sharpness),
                                     cmocka_unit_test(test_bad_frames)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
