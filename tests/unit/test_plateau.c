// SPDX-License-Identifier: Apache-2.0
// When training is done: curves of PSNR over time, and the progress that schedules see then.
#include <math.h>

#include "src/train/plateau.h"
#include "tests/common/test.h"

#define STEPS_PER_S 400.0
#define N_STEPS     7000

typedef double curve(double s);

static double saturating(double s) { return 35 - 10 * exp(-s / 2); }
static double rising(double s) { return 20 + 0.5 * s; }
static double falling(double s) { return 30 - 0.1 * s; }
static double noisy(double s) { return rising(s) + 0.04 * sin(40 * s); }

typedef struct {
  sv_plateau p;
  uint32_t n; // steps at the end
  int n_measured;
  float last;
} outcome;

// A run of N_STEPS at most.
static outcome train(curve *quality, double least_db_per_s) {
  outcome o = {.p.least_db_per_s = least_db_per_s};
  for (;; o.n++) {
    const double s = o.n / STEPS_PER_S;
    const float progress = sv_plateau_progress(&o.p, o.n, (float)o.n / N_STEPS);
    assert_true(progress >= o.last);
    o.last = progress;
    if (progress >= 1) return o;
    if (!sv_plateau_is_due(&o.p, progress, s)) continue;
    o.n_measured++;
    const bool is_end = sv_plateau_measured(&o.p, quality(s), o.n, progress, s);
    assert_true(is_end == (o.p.n_steps > 0));
  }
}

TEST(a_curve_that_levels_out_ends) {
  const outcome o = train(saturating, 0.2);
  // 0.2 dB a second are won after 2 ln 25 = 6.4 s; two windows of a second or more see it
  print_message("settling from %.1f s, %u steps, %d measurements\n", o.p.from_step / STEPS_PER_S,
                (unsigned)o.n, o.n_measured);
  assert_true(o.p.from_step > 6.4 * STEPS_PER_S && o.p.from_step < 10 * STEPS_PER_S);
  assert_int_equal(o.p.n_steps, o.p.from_step / 4);
  assert_int_equal(o.n, o.p.from_step + o.p.n_steps);
  assert_true(o.n_measured < 12); // each costs renderings
}

TEST(a_curve_that_rises_goes_on) {
  assert_int_equal(train(rising, 0.2).n, N_STEPS);
  assert_int_equal(train(noisy, 0.2).n, N_STEPS);
  assert_int_equal(train(rising, 0).n_measured, 0);
}

TEST(a_curve_that_falls_ends_soon) {
  const outcome o = train(falling, 0.05);
  // not before images of full size: 30 % of the schedule
  assert_true(o.p.from_step >= 2100 && o.p.from_step < 3000);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(a_curve_that_levels_out_ends),
                                     cmocka_unit_test(a_curve_that_rises_goes_on),
                                     cmocka_unit_test(a_curve_that_falls_ends_soon)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
