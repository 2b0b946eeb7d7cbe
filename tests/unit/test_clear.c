// SPDX-License-Identifier: Apache-2.0
// What the lenses of a multiplexed measurement see through, from their images' alpha.
#include <stdlib.h>

#include "platform/linux/linux.h"
#include "tests/common/test.h"
#include "tools/dataset/measurement.h"

#define SIDE 400

static uint16_t clear[SIDE * SIDE], px[3 * SIDE * SIDE];

static const lab_source source = {.folder = "tests/data/kitchen",
                                  .transforms = "transforms_train_multiplexed_theta10.json",
                                  .split = "train",
                                  .is_multiplexed = true,
                                  .n_exposures = 1,
                                  .scale = 1};

// Light over black: there is none where all lenses see through. Corners have one lens of M_max 4.
TEST(test_seen_through) {
  const sv_pool pool = sv_pool_serial();
  lab_views v = {0};
  sv_err err = {0};
  assert_ok(lab_views_open(&v, &source, &pool, &err), &err);
  assert_int_equal(v.n_measurements, 1);
  assert_true(v.measurements[0].has_alpha && v.measurements[0].width_px == SIDE);
  assert_ok(lab_measurement_clear(&v, 0, clear, &err), &err);
  assert_ok(lab_measurement_load(&v.measurements[0], px, &err), &err);
  assert_int_equal(clear[0], 65535 / 4 + 1);
  int n_open = 0, n_shut = 0;
  for (int i = 0; i < SIDE * SIDE; i++) {
    n_open += clear[i] == 65535;
    n_shut += clear[i] == 0;
    if (clear[i] == 65535) assert_int_equal(px[3 * i] + px[3 * i + 1] + px[3 * i + 2], 0);
  }
  print_message("%d pixels see through, %d nowhere\n", n_open, n_shut);
  assert_true(n_open > SIDE * SIDE / 20 && n_shut > SIDE * SIDE / 50);
  lab_views_free(&v);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_seen_through)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
