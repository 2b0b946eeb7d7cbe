// SPDX-License-Identifier: Apache-2.0
// What the way in which exposures sample a scene decides.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "src/train/objective.h"

static sv_train_cfg of(int n_exposures, int n_sub_views, bool is_multiplexed, bool is_moving) {
  sv_train_cfg c = sv_train_defaults();
  sv_train_set_objective(&c, &(sv_sampling){.n_exposures = n_exposures,
                                            .n_sub_views = n_sub_views,
                                            .is_multiplexed = is_multiplexed,
                                            .is_moving = is_moving});
  return c;
}

// The fewer exposures, the more Gaussians are left out of a step; none where there are many, where the scene moves or
// lenses share a sensor.
static void test_dropout(void **state) {
  (void)state;
  assert_true(sv_train_defaults().dropout == 0);
  for (int n_sub_views = 1; n_sub_views <= 16; n_sub_views *= 4) {
    float before = 1;
    for (int n = 1; n <= 30; n++) {
      const sv_train_cfg c = of(n, n_sub_views, false, false);
      assert_true(c.dropout >= 0 && c.dropout <= before && c.dropout < 0.5f);
      assert_true((c.dropout > 0) == (n < 18));
      assert_true(c.dropout_until == (c.is_supersampled ? c.supersample_from : 0.85f));
      before = c.dropout;
    }
    assert_true(of(1, n_sub_views, false, true).dropout == 0);
    assert_true(of(1, n_sub_views, true, false).dropout == 0);
  }
  assert_true(of(1, 16, false, false).dropout < of(1, 2, false, false).dropout);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_dropout)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
