// SPDX-License-Identifier: Apache-2.0
// Max-min dispersion against a plain exhaustive search, its promises and its odd cases.
#include <math.h>
#include <stdint.h>
#include <string.h>

#include "src/base/mathx.h"
#include "src/base/rng.h"
#include "src/base/vec.h"
#include "src/rig/dispersion.h"
#include "tests/common/test.h"

#define CAP 3000
static double at[CAP][3], scratch[4 * CAP + 1];
static const double UP[3] = {0, 0, 2};

// n places on the upper part of a sphere about (1, -2, 0.5).
static sv_dispersion hemisphere(int n, uint64_t seed) {
  sv_rng r = sv_rng_make(seed, 0);
  sv_dispersion d = {.n = n, .at = (const double(*)[3])at, .centre = {1, -2, 0.5}, .up = UP};
  for (int i = 0; i < n; i++) {
    double z = 0.15 + 0.8 * (double)sv_rng_f(&r), a = 2 * SV_PI * (double)sv_rng_f(&r), s = sqrt(1 - z * z);
    at[i][0] = 1 + 4 * s * cos(a);
    at[i][1] = -2 + 4 * s * sin(a);
    at[i][2] = 0.5 + 4 * z;
  }
  return d;
}

static void disperse(const sv_dispersion *d, int n, int *chosen) {
  scratch[sv_dispersion_scratch(d->n)] = 123;
  assert_int_equal(sv_disperse(d, n, chosen, scratch), SV_OK);
  assert_true(scratch[sv_dispersion_scratch(d->n)] == 123);
  for (int i = 0; i < n; i++) {
    assert_in_range(chosen[i], 0, d->n - 1);
    for (int j = 0; j < i; j++) assert_int_not_equal(chosen[i], chosen[j]);
  }
}

static double best_of_all(const sv_dispersion *d, int n) {
  double best = 0;
  for (int i = 0; i < d->n; i++)
    for (int j = i + 1; j < d->n; j++)
      for (int k = j + 1; k < (n == 3 ? d->n : j + 2); k++) {
        int c[3] = {i, j, k};
        best = fmax(best, sv_dispersion_of(d, c, n));
      }
  return best;
}

TEST(test_exact) {
  for (uint64_t seed = 1; seed <= 6; seed++) {
    int c[3];
    sv_dispersion d = hemisphere(40, seed);
    disperse(&d, 2, c);
    assert_true(sv_dispersion_of(&d, c, 2) == best_of_all(&d, 2));
    assert_true(c[0] < c[1]);
    disperse(&d, 3, c);
    assert_true(sv_dispersion_of(&d, c, 3) == best_of_all(&d, 3));
  }
}

static double elevation_deg(int i) { return asin((at[i][2] - 0.5) / 4) * 180 / SV_PI; }

TEST(test_one) {
  for (uint64_t seed = 1; seed <= 6; seed++) {
    int one, three[3];
    sv_dispersion d = hemisphere(60, seed);
    disperse(&d, 3, three);
    disperse(&d, 1, &one);
    assert_int_equal(one, three[0]);
    for (int i = 1; i < 3; i++)
      assert_true(fabs(elevation_deg(one) - 30) <= fabs(elevation_deg(three[i]) - 30));
    d.up = NULL; // then the one in the middle: smallest sum of angles
    disperse(&d, 1, &one);
    double sums[60] = {0};
    for (int i = 0; i < 60; i++)
      for (int j = 0; j < 60; j++) sums[i] += i == j ? 0 : sv_dispersion_of(&d, (int[]){i, j}, 2);
    for (int i = 0; i < 60; i++) assert_true(sums[one] <= sums[i] + 1e-12);
    disperse(&d, 3, three);
    assert_true(three[0] < three[1] && three[1] < three[2]);
  }
}

// At least half of what is possible (three is exact, more are not), each a farthest point, and
// nested.
TEST(test_many) {
  int c[50], fewer[50];
  sv_dispersion d = hemisphere(100, 9);
  disperse(&d, 50, c);
  double last = 10;
  for (int n = 3; n < 50; n++) {
    disperse(&d, n, fewer);
    assert_memory_equal(c, fewer, (size_t)n * sizeof *c);
    double nearest_of_next = 10, most = 0;
    for (int i = 0; i < 100; i++) {
      double nearest = 10;
      for (int k = 0; k < n; k++)
        nearest = fmin(nearest, i == c[k] ? 0 : sv_dispersion_of(&d, (int[]){i, c[k]}, 2));
      most = fmax(most, nearest);
      if (i == c[n]) nearest_of_next = nearest;
    }
    assert_true(nearest_of_next == most);
    double now = sv_dispersion_of(&d, c, n);
    assert_true(now <= last);
    last = now;
  }
  disperse(&d, 50, fewer);
  assert_memory_equal(c, fewer, sizeof c);
}

// Beyond what can be tried out: still far apart, still the same each time, and quick.
TEST(test_large_sets) {
  int c[CAP], d2[CAP];
  sv_dispersion d = hemisphere(400, 3); // pairs are exact, triples are not
  disperse(&d, 3, c);
  int t[2] = {c[0], c[1]};
  assert_true(sv_dispersion_of(&d, t, 2) > 1);
  // three on the rim of a hemisphere: about 1.9 rad
  assert_true(sv_dispersion_of(&d, c, 3) > 0.5 * 1.9);
  d = hemisphere(CAP, 4); // not even pairs
  disperse(&d, 2, c);
  assert_true(sv_dispersion_of(&d, c, 2) > 2);
  disperse(&d, 20, c);
  disperse(&d, 20, d2);
  assert_memory_equal(c, d2, 20 * sizeof *c);
  disperse(&d, 1, c);
  assert_true(c[0] == d2[0]);
}

TEST(test_odd_cases) {
  int c[8];
  sv_dispersion d = hemisphere(5, 1);
  disperse(&d, 5, c); // all of them
  assert_int_equal(sv_disperse(&d, 6, c, scratch), SV_E_ARG);
  assert_int_equal(sv_disperse(&d, 0, c, scratch), SV_E_ARG);
  d.n = 1;
  disperse(&d, 1, c);
  assert_int_equal(c[0], 0);
  d.n = 2;
  disperse(&d, 1, c);
  disperse(&d, 2, c);
  d.n = 0;
  assert_int_equal(sv_disperse(&d, 1, c, scratch), SV_E_ARG);
  d.n = 6;
  // all in one place: any six will do
  for (int i = 0; i < 6; i++) memcpy(at[i], at[0], sizeof at[i]);
  disperse(&d, 6, c);
  for (int i = 0; i < 6; i++) memcpy(at[i], d.centre, sizeof at[i]);
  disperse(&d, 4, c);
}

// acos(v . v) has no digits left at such angles.
TEST(test_tiny_angles) {
  int c[3];
  sv_dispersion d = hemisphere(4, 1);
  d.n = 4;
  static const double x[4] = {0, 3e-10, 1e-9, 1.2e-9};
  for (int i = 0; i < 4; i++) {
    at[i][0] = 1 + 4 * x[i];
    at[i][1] = -2 + 4;
    at[i][2] = 0.5;
  }
  disperse(&d, 2, c);
  assert_true(c[0] == 0 && c[1] == 3);
  d.up = NULL;
  disperse(&d, 3, c); // 0, 0.3, 1.2 is worth 0.3; 0, 0.3, 1 too and comes first
  assert_true(c[0] == 0 && c[1] == 1 && c[2] == 2);
  disperse(&d, 1, c);
  assert_true(c[0] == 1 || c[0] == 2);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_exact),      cmocka_unit_test(test_one),       cmocka_unit_test(test_many),
      cmocka_unit_test(test_large_sets), cmocka_unit_test(test_odd_cases), cmocka_unit_test(test_tiny_angles),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
