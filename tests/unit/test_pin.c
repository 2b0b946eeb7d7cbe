// SPDX-License-Identifier: Apache-2.0
// The PIN for a second device: one use, two minutes, five tries.
#include <string.h>

#include "platform/preview/pin.h"
#include "tests/common/test.h"

static pv_pin p;

TEST(test_right_once) {
  p = (pv_pin){0};
  assert_int_equal(pv_pin_try(&p, "000000", 0), PV_PIN_CLOSED);
  assert_int_equal(pv_pin_try(&p, "", 0), PV_PIN_CLOSED); // nor does nothing open what is closed
  pv_pin_open(&p, 987654321, 0);
  assert_string_equal(p.digits, "123456");
  assert_int_equal(pv_pin_try(&p, "123456", 1), PV_PIN_RIGHT);
  assert_int_equal(pv_pin_try(&p, "123456", 1), PV_PIN_CLOSED);
}

TEST(test_tries) {
  static const char *const wrong[] = {"123457", "12345", NULL, "1234567", "023456"};
  pv_pin_open(&p, 987654321, 0);
  for (int i = 0; i < 5; i++) assert_int_equal(pv_pin_try(&p, wrong[i], 1), PV_PIN_WRONG);
  assert_int_equal(pv_pin_try(&p, "123456", 1), PV_PIN_CLOSED);
  pv_pin_open(&p, 987654321, 0); // a new one has new tries
  for (int i = 0; i < 4; i++) assert_int_equal(pv_pin_try(&p, "", 1), PV_PIN_WRONG);
  assert_int_equal(pv_pin_try(&p, "123456", 1), PV_PIN_RIGHT);
}

TEST(test_time) {
  pv_pin_open(&p, 987654321, 5);
  assert_int_equal(pv_pin_try(&p, "123456", 6 + PV_PIN_NS), PV_PIN_CLOSED);
  assert_int_equal(pv_pin_try(&p, "123456", 5 + PV_PIN_NS), PV_PIN_RIGHT);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_right_once),
      cmocka_unit_test(test_tries),
      cmocka_unit_test(test_time),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
