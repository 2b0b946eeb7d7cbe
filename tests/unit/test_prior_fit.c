// SPDX-License-Identifier: Apache-2.0
// The robust line that tells scale and shift of a relative depth map.
#include <math.h>
#include <stdlib.h>

#include "src/prior/align.h"
#include "tests/common/test.h"

// A third of the values lies anywhere above the line.
TEST(test_line_with_outliers) {
  enum { N_VALUES = 300 };
  static float map[N_VALUES], target[N_VALUES], work[N_VALUES];
  sv_rng r = sv_rng_make(3, 1);
  float scale, shift;
  for (int i = 0; i < N_VALUES; i++) {
    map[i] = sv_rng_f(&r);
    target[i] = 0.4f * map[i] + 0.2f + 0.001f * sv_rng_normal(&r) + (i % 3 ? 0.0f : sv_rng_f(&r));
  }
  const sv_prior_fit f = {map, target, target, N_VALUES};
  assert_true(sv_prior_fit_line(&f, work, &scale, &shift));
  assert_true(fabsf(scale - 0.4f) < 0.004f && fabsf(shift - 0.2f) < 0.003f);
  for (int i = 0; i < N_VALUES; i++) target[i] = -map[i];
  assert_false(sv_prior_fit_line(&f, work, &scale, &shift)); // a relief turned inside out
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_line_with_outliers)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
