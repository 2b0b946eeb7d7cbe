// SPDX-License-Identifier: Apache-2.0
// Trigger pulses: how a line is written, a GPIO chip of the test's own that counts and times what
// it gets, a PWM channel and a driver's parameter in a folder like /sys, and each refusal.
#include <errno.h>
#include <linux/gpio.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "platform/camera/pulses.h"
#include "tests/common/test.h"

#define MS      SV_NS_PER_MS
#define FD_CHIP 100
#define FD_LINE 101

static struct {
  int n_open, open_errno, line_errno, n_lines;
  uint64_t flags;
  bool value;
  int n_rising, n_falling, fail_at, hang_at;
  sv_ns rising_ns[1000];
} chip;

static sv_ns now(void) {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return (sv_ns)t.tv_sec * SV_NS_PER_S + t.tv_nsec;
}
static void sleep_ns(sv_ns ns) {
  const struct timespec t = {.tv_sec = ns / SV_NS_PER_S, .tv_nsec = ns % SV_NS_PER_S};
  nanosleep(&t, NULL);
}

static int chip_open(void *self, const char *path) {
  (void)self;
  if (strcmp(path, "/dev/gpiochip3")) return -ENOENT;
  if (chip.open_errno) return -chip.open_errno;
  chip.n_open++;
  return FD_CHIP;
}
static int chip_close(void *self, int fd) {
  (void)self;
  assert_true(fd == FD_CHIP || fd == FD_LINE);
  chip.n_open--;
  return 0;
}

static int set_values(const struct gpio_v2_line_values *v) {
  const bool is_on = v->bits & v->mask & 1;
  if (is_on && chip.fail_at && chip.n_rising == chip.fail_at) return -EIO;
  if (is_on && chip.hang_at && chip.n_rising == chip.hang_at) {
    chip.hang_at = 0;
    sleep_ns(50 * MS);
  }
  if (is_on && !chip.value) chip.rising_ns[chip.n_rising++ % 1000] = now();
  if (!is_on && chip.value) chip.n_falling++;
  chip.value = is_on;
  return 0;
}

static int chip_ioctl(void *self, int fd, unsigned long request, void *arg) {
  (void)self;
  if (request == GPIO_V2_LINE_SET_VALUES_IOCTL) return fd == FD_LINE ? set_values(arg) : -EINVAL;
  if (fd != FD_CHIP) return -EINVAL;
  if (request == GPIO_GET_CHIPINFO_IOCTL) {
    ((struct gpiochip_info *)arg)->lines = (uint32_t)chip.n_lines;
    return 0;
  }
  if (request == GPIO_V2_GET_LINEINFO_IOCTL) {
    strcpy(((struct gpio_v2_line_info *)arg)->consumer, "a lamp");
    return 0;
  }
  struct gpio_v2_line_request *q = arg;
  assert_true(request == GPIO_V2_GET_LINE_IOCTL);
  if (chip.line_errno) return -chip.line_errno;
  if (q->offsets[0] >= (uint32_t)chip.n_lines) return -EINVAL;
  chip.flags = q->config.flags;
  assert_string_equal(q->consumer, "subview");
  chip.n_open++;
  q->fd = FD_LINE;
  return 0;
}

static sv_pulses pulses;
static sv_pulses_sys sys(void) {
  return (sv_pulses_sys){NULL, chip_open, chip_close, chip_ioctl, temp_folder};
}
static sv_err err;

static sv_trigger line_of(const char *text, sv_ns period_ns, sv_ns width_ns) {
  sv_trigger t = {.period_ns = period_ns, .width_ns = width_ns};
  assert_true(sv_trigger_parse_line(text, strlen(text), &t));
  return t;
}

static sv_status open_line(sv_trigger t) {
  const sv_pulses_sys s = sys();
  return sv_pulses_open(&pulses, &t, &s, &err);
}

FIXTURE(clean) {
  memset(&chip, 0, sizeof chip);
  chip.n_lines = 8;
  return 0;
}
FIXTURE(end) {
  sv_pulses_close(&pulses);
  return 0;
}

// --- text ----------------------------------------------------------------------------------------
TEST(lines_and_modes_are_read) {
  static const char *const bad[] = {"",
                                    "gpio",
                                    "gpio:gpiochip0",
                                    "gpio:gpiochip0:",
                                    "gpio::1",
                                    "gpio:a/b:1",
                                    "gpio:chip:-1",
                                    "gpio:chip:99999",
                                    "spi:chip:1",
                                    "gpio:a_name_that_is_longer_than_any_chip:1"};
  sv_trigger t = {0};
  sv_trigger_mode m;
  char text[64];
  for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
    assert_false(sv_trigger_parse_line(bad[i], strlen(bad[i]), &t));
  assert_int_equal(t.kind, SV_LINE_NONE);
  t = line_of("pwm:pwmchip2:1", 0, 0);
  sv_str s = sv_str_make(text, sizeof text);
  sv_trigger_add_line(&s, &t);
  assert_string_equal(text, "pwm:pwmchip2:1");
  static const char *const bad_modes[] = {"", "a", "a:", "a:x", "a.b", "../b:1", "a.b/c:1", "a:99999999999"};
  for (size_t i = 0; i < sizeof bad_modes / sizeof *bad_modes; i++)
    assert_false(sv_trigger_parse_mode(bad_modes[i], strlen(bad_modes[i]), &m));
  assert_true(sv_trigger_parse_mode("imx296.trigger_mode:1", 21, &m));
  assert_string_equal(m.module, "imx296");
  assert_string_equal(m.name, "trigger_mode");
  assert_int_equal(m.value, 1);
  assert_true(sv_trigger_parse_mode("frame_sync:-2", 13, &m));
  assert_string_equal(m.module, "");
  assert_int_equal(m.value, -2);
}

TEST(periods_and_widths_are_checked) {
  sv_trigger t = line_of("gpio:gpiochip3:1", 0, 0);
  assert_error(sv_trigger_complete(&t, &err), SV_E_RANGE, &err, "expected fps=");
  t.period_ns = 100;
  assert_error(sv_trigger_complete(&t, &err), SV_E_RANGE, &err, "expected 1 ms to 10 s");
  t = line_of("gpio:gpiochip3:1", 5 * MS, 5 * MS);
  assert_error(sv_trigger_complete(&t, &err), SV_E_RANGE, &err, "less than the period");
  t.width_ns = 0;
  assert_ok(sv_trigger_complete(&t, &err), &err);
  assert_int_equal(t.width_ns, MS / 2);
}

// --- GPIO ----------------------------------------------------------------------------------------
// All pulses are on the grid of the first one, as far as they were late: lateness does not add up.
static void assert_on_grid(int i_first, sv_ns period_ns) {
  const sv_pulses_stats *s = &pulses.stats;
  const sv_ns last_ns = chip.rising_ns[chip.n_rising - 1];
  const double n = (double)(last_ns - chip.rising_ns[i_first]) / (double)period_ns;
  const double late = (double)s->max_late_ns / (double)period_ns;
  // What was skipped after the last pulse counts, too.
  assert_near(n, (double)(s->n_pulses + s->n_skipped) - 1, late + 0.01);
}

TEST(a_line_gets_its_pulses_on_a_grid) {
  sv_trigger t = line_of("gpio:gpiochip3:5", 4 * MS, MS);
  t.is_active_low = true;
  assert_ok(open_line(t), &err);
  assert_true(chip.flags == (GPIO_V2_LINE_FLAG_OUTPUT | GPIO_V2_LINE_FLAG_ACTIVE_LOW));
  sleep_ns(10 * MS);
  assert_int_equal(chip.n_rising, 0); // not before the start
  for (int k = 0; k < 2; k++) {
    const int before = chip.n_rising;
    assert_int_equal(sv_pulses_start(&pulses), SV_OK);
    assert_int_equal(sv_pulses_start(&pulses), SV_E_ARG);
    sleep_ns(400 * MS);
    sv_pulses_stop(&pulses);
    const sv_pulses_stats *s = &pulses.stats;
    const int n = chip.n_rising - before;
    assert_int_equal(chip.value, 0);
    assert_int_equal(chip.n_falling, chip.n_rising);
    assert_int_equal(s->n_pulses, n);
    assert_true(n > 2);
    assert_int_equal(s->error, 0);
    assert_on_grid(before, 4 * MS);
    assert_true(sv_pulses_late_ns(s, 50) <= sv_pulses_late_ns(s, 99));
    assert_true(sv_pulses_late_ns(s, 100) + SV_NS_PER_US >= s->max_late_ns);
  }
  sv_pulses_close(&pulses);
  sv_pulses_close(&pulses);
  assert_int_equal(chip.n_open, 0);
}

TEST(pulses_that_are_a_period_late_are_skipped) {
  chip.hang_at = 10;
  assert_ok(open_line(line_of("gpio:gpiochip3:0", 5 * MS, MS)), &err);
  assert_int_equal(sv_pulses_start(&pulses), SV_OK);
  sleep_ns(200 * MS);
  sv_pulses_stop(&pulses);
  assert_true(pulses.stats.n_skipped >= 8);
  assert_true(pulses.stats.max_late_ns >= 50 * MS);
  assert_on_grid(0, 5 * MS);
  sv_pulses_close(&pulses);
}

TEST(a_line_that_fails_is_told) {
  chip.fail_at = 3;
  assert_ok(open_line(line_of("gpio:gpiochip3:0", 2 * MS, MS)), &err);
  assert_int_equal(sv_pulses_start(&pulses), SV_OK);
  sleep_ns(50 * MS);
  sv_pulses_stop(&pulses);
  assert_int_equal(pulses.stats.error, EIO);
  assert_int_equal(pulses.stats.n_pulses, 3);
  sv_pulses_close(&pulses);
  assert_int_equal(chip.n_open, 0);
}

TEST(where_there_is_no_line_the_reason_is_said) {
  assert_error(open_line(line_of("gpio:gpiochip9:0", MS, 0)), SV_E_NOT_FOUND, &err,
               "/dev/gpiochip9 cannot be opened");
  assert_one_sentence(err.text);
  assert_error(open_line(line_of("gpio:gpiochip3:8", MS, 0)), SV_E_RANGE, &err, "has the lines 0 to 7");
  chip.line_errno = EBUSY;
  assert_error(open_line(line_of("gpio:gpiochip3:1", MS, 0)), SV_E_DEVICE, &err, "used by \"a lamp\"");
  chip.line_errno = EPERM;
  assert_error(open_line(line_of("gpio:gpiochip3:1", MS, 0)), SV_E_DEVICE, &err, "cannot be an output");
  chip.open_errno = EACCES;
  assert_error(open_line(line_of("gpio:gpiochip3:1", MS, 0)), SV_E_DEVICE, &err, "group gpio");
  assert_int_equal(chip.n_open, 0);
}

// --- files like those of /sys --------------------------------------------------------------------
static void put(const char *name, const char *text) {
  char path[512];
  snprintf(path, sizeof path, "%s/%s", temp_folder, name);
  for (char *c = path + strlen(temp_folder) + 1; (c = strchr(c, '/')); c++) {
    *c = 0;
    mkdir(path, 0700);
    *c = '/';
  }
  FILE *f = fopen(path, "w");
  assert_non_null(f);
  fputs(text, f);
  fclose(f);
}
static void assert_file(const char *name, const char *begin) {
  char path[512], text[64] = "";
  snprintf(path, sizeof path, "%s/%s", temp_folder, name);
  FILE *f = fopen(path, "r");
  assert_non_null(f);
  assert_non_null(fgets(text, sizeof text, f));
  fclose(f);
  assert_true(!strncmp(text, begin, strlen(begin)));
}

TEST(a_pwm_channel_makes_the_pulses) {
  static const char *const files[] = {"enable", "period", "duty_cycle", "polarity"};
  put("class/pwm/pwmchip2/npwm", "2\n");
  put("class/pwm/pwmchip2/export", "");
  for (int i = 0; i < 4; i++) {
    char name[64];
    snprintf(name, sizeof name, "class/pwm/pwmchip2/pwm1/%s", files[i]);
    put(name, "");
  }
  sv_trigger t = line_of("pwm:pwmchip2:1", 33333333, 500000);
  t.is_active_low = true;
  assert_ok(open_line(t), &err);
  assert_file("class/pwm/pwmchip2/pwm1/enable", "0");
  assert_file("class/pwm/pwmchip2/pwm1/period", "33333333");
  assert_file("class/pwm/pwmchip2/pwm1/duty_cycle", "500000");
  assert_file("class/pwm/pwmchip2/pwm1/polarity", "inversed");
  assert_int_equal(sv_pulses_start(&pulses), SV_OK);
  assert_file("class/pwm/pwmchip2/pwm1/enable", "1");
  sv_pulses_stop(&pulses);
  assert_file("class/pwm/pwmchip2/pwm1/enable", "0");
  sv_pulses_close(&pulses);
  assert_error(open_line(line_of("pwm:pwmchip0:0", MS, 0)), SV_E_NOT_FOUND, &err, "there is no");
  assert_error(open_line(line_of("pwm:pwmchip2:2", MS, 0)), SV_E_RANGE, &err, "has the channels 0 to 1");
  assert_error(open_line(line_of("pwm:pwmchip2:0", MS, 0)), SV_E_DEVICE, &err, "does not take");
  assert_file("class/pwm/pwmchip2/export", "0");
  assert_one_sentence(err.text);
}

TEST(the_sensors_driver_is_switched_and_given_back) {
  sv_trigger t = line_of("gpio:gpiochip3:1", 10 * MS, 0);
  sv_copy(t.mode, sizeof t.mode, "imx296.trigger_mode:1");
  assert_error(open_line(t), SV_E_NOT_FOUND, &err, "driver loaded?");
  put("module/imx296/parameters/trigger_mode", "0\n");
  assert_ok(open_line(t), &err);
  assert_file("module/imx296/parameters/trigger_mode", "1");
  sv_pulses_close(&pulses);
  assert_file("module/imx296/parameters/trigger_mode", "0");
  assert_int_equal(chip.n_open, 0);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test_setup_teardown(lines_and_modes_are_read, clean, end),
      cmocka_unit_test_setup_teardown(periods_and_widths_are_checked, clean, end),
      cmocka_unit_test_setup_teardown(a_line_gets_its_pulses_on_a_grid, clean, end),
      cmocka_unit_test_setup_teardown(pulses_that_are_a_period_late_are_skipped, clean, end),
      cmocka_unit_test_setup_teardown(a_line_that_fails_is_told, clean, end),
      cmocka_unit_test_setup_teardown(where_there_is_no_line_the_reason_is_said, clean, end),
      cmocka_unit_test_setup_teardown(a_pwm_channel_makes_the_pulses, clean, end),
      cmocka_unit_test_setup_teardown(the_sensors_driver_is_switched_and_given_back, clean, end),
  };
  return cmocka_run_group_tests_name("pulses", tests, temp_folder_setup, temp_folder_teardown);
}
