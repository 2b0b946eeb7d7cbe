// SPDX-License-Identifier: Apache-2.0
// Accelerations as text, and their mean about a time.
#include <string.h>

#include "src/capture/imu.h"
#include "tests/common/test.h"

static sv_status parse(sv_imu_sample *s, const char *line) { return sv_imu_parse(s, line, strlen(line)); }

TEST(test_lines) {
  static const char *const good[] = {"1.5,0,-9.8,0.25", " 1.5 0 -9.8 .25", "1.5; 0; -9.8; 2.5e-1; 7\n",
                                     "1.5\t0\t-9.8\t0.25\r\n"};
  static const char *const none[] = {"", "\n", "# time, x, y, z", "time,ax,ay,az", "  \r\n"};
  static const char *const bad[] = {"1.5",         "1.5,0,-9.8", "1.5,0,,", "1.5,0,x,1",
                                    "1.5,0,inf,1", "1,2,3,4x",   "-"};
  sv_imu_sample s;
  for (size_t i = 0; i < sizeof good / sizeof *good; i++) {
    assert_int_equal(parse(&s, good[i]), SV_OK);
    assert_true(s.time_s == 1.5 && s.a[0] == 0 && s.a[1] == -9.8 && s.a[2] == 0.25);
  }
  for (size_t i = 0; i < sizeof none / sizeof *none; i++) assert_int_equal(parse(&s, none[i]), SV_AGAIN);
  for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) assert_int_equal(parse(&s, bad[i]), SV_E_FORMAT);
}

TEST(test_mean) {
  sv_imu_sample s[100];
  for (int i = 0; i < 100; i++) s[i] = (sv_imu_sample){i * 0.05, {i, -10, i % 2}};
  const sv_imu imu = {s, 100};
  double a[3];
  assert_true(sv_imu_at(&imu, 1010 * SV_NS_PER_MS, a)); // 0.95 to 1.1
  assert_true(a[0] == 20.5 && a[1] == -10 && a[2] == 0.5);
  assert_true(sv_imu_at(&imu, -90 * SV_NS_PER_MS, a) && a[0] == 0);
  assert_false(sv_imu_at(&imu, -110 * SV_NS_PER_MS, a));
  assert_true(sv_imu_at(&imu, 5040 * SV_NS_PER_MS, a) && a[0] == 99);
  assert_false(sv_imu_at(&imu, 5060 * SV_NS_PER_MS, a));
  assert_false(sv_imu_at(&(sv_imu){NULL, 0}, 0, a));
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_lines), cmocka_unit_test(test_mean)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
