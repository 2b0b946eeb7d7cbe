// SPDX-License-Identifier: Apache-2.0
// Pages that share a run: one controls, it can be asked for, and it goes on when a page is gone.
#include <stdio.h>

#include "platform/preview/control.h"
#include "tests/common/test.h"

#define S 1000000000LL

static pv_control c;
static const char A[] = "page-a-0123456789", B[] = "page-b-0123456789", C[] = "page-c-0123456789";

TEST(test_first_controls) {
  c = (pv_control){0};
  assert_true(pv_control_may(&c, NULL)); // nobody is there: programs without a page
  assert_int_equal(pv_control_enter(&c, A, S), 1);
  assert_int_equal(pv_control_enter(&c, B, S), 2);
  assert_int_equal(pv_control_enter(&c, A, 2 * S), 1); // the same page
  assert_true(pv_control_may(&c, A));
  assert_false(pv_control_may(&c, B));
  assert_false(pv_control_may(&c, NULL));
  assert_false(pv_control_may(&c, ""));
  assert_false(pv_control_may(&c, "page-a-012345678"));
}

TEST(test_ids) {
  c = (pv_control){0};
  assert_int_equal(pv_control_enter(&c, NULL, S), 0);
  assert_int_equal(pv_control_enter(&c, "too-short", S), 0);
  assert_int_equal(pv_control_enter(&c, "0123456789abcdef\"", S), 0);
  assert_int_equal(pv_control_enter(&c, "0123456789abcdef0123456789abcdef0", S), 0);
  assert_int_equal(c.by, 0);
  assert_false(pv_control_ask(&c, A, S));
}

TEST(test_ask) {
  c = (pv_control){0};
  pv_control_enter(&c, A, S);
  pv_control_enter(&c, B, S);
  pv_control_enter(&c, C, S);
  assert_false(pv_control_answer(&c, A, true)); // nobody asks
  assert_true(pv_control_ask(&c, B, S));
  assert_true(pv_control_ask(&c, C, S)); // one at a time
  assert_int_equal(c.asked, 2);
  assert_false(pv_control_answer(&c, B, true)); // not its to answer
  assert_true(pv_control_answer(&c, A, false));
  assert_true(pv_control_may(&c, A));
  assert_int_equal(c.asked, 0);
  assert_true(pv_control_ask(&c, B, S));
  assert_true(pv_control_answer(&c, A, true));
  assert_true(pv_control_may(&c, B));
  assert_false(pv_control_may(&c, A));
}

TEST(test_silence) {
  c = (pv_control){0};
  pv_control_enter(&c, A, S);
  pv_control_enter(&c, B, S);
  pv_control_ask(&c, B, 2 * S);
  pv_control_enter(&c, A, 20 * S);
  pv_control_enter(&c, B, 20 * S);
  pv_control_step(&c, 22 * S);
  assert_int_equal(c.by, 1);
  pv_control_step(&c, 23 * S); // no answer
  assert_int_equal(c.by, 2);
  pv_control_step(&c, 41 * S); // both are gone
  assert_int_equal(c.by, 0);
  assert_int_equal(pv_control_enter(&c, C, 42 * S), 3);
  assert_true(pv_control_may(&c, C));
}

// More pages than seats: the page in control stays.
TEST(test_full) {
  c = (pv_control){0};
  char id[20];
  pv_control_enter(&c, A, S);
  for (int i = 0; i < 3 * PV_CAP_SEATS; i++) {
    snprintf(id, sizeof id, "another-page-%04d", i);
    assert_true(pv_control_enter(&c, id, (i + 2) * S) > 1);
  }
  assert_true(pv_control_may(&c, A));
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_first_controls), cmocka_unit_test(test_ids),
                                     cmocka_unit_test(test_ask), cmocka_unit_test(test_silence),
                                     cmocka_unit_test(test_full)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
