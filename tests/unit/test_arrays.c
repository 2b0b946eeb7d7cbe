// SPDX-License-Identifier: Apache-2.0
// The list of arrays in the plan against the trainer's own layout: an array that is new, or of
// another type, shows.
#include <math.h>
#include <string.h>

#include "src/run/arrays.h"
#include "tests/common/test.h"

static void check(const sv_train_cfg *c, const char *what) {
  sv_arrays f = sv_arrays_of(c);
  double g = 0, px = 0;
  for (int i = 0; i < f.n_rows; i++) {
    if (strcmp(f.row[i].name, "other") == 0)
      fail_msg("%s: %.2f bytes a Gaussian and %.3f a pixel are in no row of src/run/arrays.c", what,
               f.row[i].per_gaussian, f.row[i].per_pixel);
    g += f.row[i].per_gaussian;
    px += f.row[i].per_pixel;
  }
  if (fabs(g - f.per_gaussian) > 0.1 || fabs(px - f.per_pixel) > 0.1)
    fail_msg("%s: the rows of src/run/arrays.c add up to %.2f and %.3f bytes, the trainer takes %.2f a "
             "Gaussian and "
             "%.3f a pixel",
             what, g, px, f.per_gaussian, f.per_pixel);
}

TEST(test_rows_add_up) {
  for (int sh = 0; sh < 4; sh++) {
    sv_train_cfg c = sv_train_defaults();
    c.sh_degree = sh;
    check(&c, "defaults");
    c.weight_ssim = 0;
    check(&c, "no SSIM");
    c.min_scale_px = 0.3f;
    check(&c, "floors");
    c.n_novel = 2;
    check(&c, "novel views");
    c.is_supersampled = true;
    check(&c, "supersampled");
    c.cap_intersections = 100000;
    check(&c, "a fixed number of records");
  }
}

TEST(test_print) {
  char text[4096];
  sv_train_cfg c = sv_train_defaults();
  sv_arrays f = sv_arrays_of(&c);
  sv_str s = sv_str_make(text, sizeof text);
  sv_arrays_print(&s, &f, false);
  assert_false(s.is_cut);
  assert_contains(text, "parameters                              92.00          0.000\n");
  s = sv_str_make(text, sizeof text);
  sv_arrays_print(&s, &f, true);
  assert_non_null(
      strstr(text, "{\"name\": \"splats\", \"bytes_per_gaussian\": 64.00, \"bytes_per_pixel\": 0.000}, "));
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_rows_add_up), cmocka_unit_test(test_print)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
