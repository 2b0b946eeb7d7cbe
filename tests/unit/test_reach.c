// SPDX-License-Identifier: Apache-2.0
// Gaussians far beyond the scene: how large they start and how far their steps go.
#include <math.h>
#include <string.h>

#include "src/splat/constants.h"
#include "src/train/reach.h"
#include "tests/common/test.h"

#define RADIUS 0.5f

static sv_trainer trainer;

// Lane k of a block is at 1, 2, 4, ... reaches from the center.
static void place(float p[48]) {
  trainer.radius = RADIUS;
  trainer.centre[0] = 1;
  memset(p, 0, 48 * sizeof *p);
  for (int k = 0; k < 16; k++) p[k] = 1;
  for (int k = 0; k < 4; k++) p[16 + k] = (float)(1 << k) * SV_REACH_RADII * RADIUS;
}

TEST(test_units) {
  float p[48], factor[16], grad[48];
  place(p);
  assert_int_equal(sv_reach_beyond(&trainer, p, factor), 14); // not the one at the border
  for (int i = 0; i < 48; i++) grad[i] = (float)i;
  sv_reach_scale(14, factor, grad);
  for (int i = 0; i < 48; i++) {
    const int k = i & 15;
    const float f = k < 4 ? (float)(1 << k) : 1;
    assert_true(fabsf(factor[k] - f) < 1e-5f * f);
    assert_true(fabsf(grad[i] - f * (float)i) < 1e-4f * grad[i] + 1e-6f);
  }
  p[17] = p[18] = p[19] = 0;
  assert_int_equal(sv_reach_beyond(&trainer, p, factor), 0);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_units)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
