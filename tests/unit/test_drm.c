// SPDX-License-Identifier: Apache-2.0
// A screen by DRM/KMS on cards that are not there: which screen and mode are chosen, what is said
// when there is none, flips that never wait, and a picture before that comes back.
#include <errno.h>
#include <string.h>

#include "tests/common/fake_drm.h"
#include "tests/common/test.h"

static fake_drm fake;
static sv_drm d;
static sv_err err;

FIXTURE(clean) {
  fake_drm_init(&fake);
  return 0;
}

static sv_status open_screen(const char *spec) {
  const sv_drm_sys sys = fake_drm_sys(&fake);
  return sv_drm_open(&d, spec, &sys, &err);
}

static void is_as_before(uint32_t fb_id) {
  assert_int_equal(fake.n_open, 0);
  assert_int_equal(fake.n_mapped, 0);
  assert_int_equal(fake_drm_n_buffers(&fake), 0);
  assert_int_equal(fake.fb_id, fb_id);
}

TEST(the_first_connected_screen_is_taken_and_given_back) {
  assert_ok(open_screen("auto"), &err);
  assert_string_equal(d.name, "DSI-1 of /dev/dri/card1");
  assert_int_equal(d.width_px, 800);
  assert_int_equal(d.height_px, 480);
  assert_near(d.rate_hz, 60, 0.1);
  sv_display_frame shown = fake_drm_shown(&fake);
  assert_int_equal(shown.width_px, 800);
  for (int i = 0; i < 800 * 4; i++) assert_int_equal(shown.px[i], 0);
  sv_drm_close(&d);
  is_as_before(FAKE_DRM_FBCON);
}

TEST(a_screen_that_was_off_is_off_again) {
  fake.fb_id = 0;
  assert_ok(open_screen("card1:DSI-1"), &err);
  sv_drm_close(&d);
  is_as_before(0);
}

TEST(large_screens_get_a_mode_that_a_board_can_draw) {
  fake.is_hdmi_there = true;
  assert_ok(open_screen("/dev/dri/card1:HDMI-A-1"), &err);
  assert_int_equal(d.width_px, 1920);
  assert_int_equal(d.height_px, 1080);
  sv_drm_close(&d);
}

TEST(a_missing_screen_is_named) {
  static const struct {
    const char *spec, *part;
    sv_status status;
  } cases[] = {{"card1:HDMI-A-1", "no screen is connected", SV_E_NOT_FOUND},
               {"card1:DP-9", "/dev/dri/card1 has no connector DP-9", SV_E_NOT_FOUND},
               {"card0", "no screen is connected", SV_E_NOT_FOUND},
               {"card9", "no such card", SV_E_NOT_FOUND},
               {"a-card-with-a-very-very-long-name", "expected auto or CARD", SV_E_ARG}};
  for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
    assert_error(open_screen(cases[i].spec), cases[i].status, &err, cases[i].part);
    assert_one_sentence(err.text);
    is_as_before(FAKE_DRM_FBCON);
  }
  fake.has_no_cards = true;
  assert_error(open_screen("auto"), SV_E_NOT_FOUND, &err, "no such card");
}

TEST(a_screen_that_cannot_be_had_is_explained) {
  fake.open_errno = EACCES;
  assert_error(open_screen("auto"), SV_E_DEVICE, &err, "group video");
  clean(NULL);
  fake.has_other_master = true;
  assert_error(open_screen("auto"), SV_E_DEVICE, &err, "another program has the screen DSI-1");
  is_as_before(FAKE_DRM_FBCON);
  clean(NULL);
  fake.is_mode_refused = true;
  assert_error(open_screen("auto"), SV_E_DEVICE, &err, "refuses its mode of 800x480");
  for (int n = 0; n < 2; n++) {
    clean(NULL);
    fake.n_allocs_left = n;
    assert_error(open_screen("auto"), SV_E_DEVICE, &err, "gives no frame");
    is_as_before(FAKE_DRM_FBCON);
  }
}

TEST(frames_are_shown_in_turn_and_nothing_waits) {
  sv_display_frame f;
  assert_ok(open_screen("auto"), &err);
  const sv_display display = sv_drm_display(&d);
  fake.are_flips_waiting = true;
  for (int i = 0; i < 3; i++) {
    assert_true(display.begin(display.self, &f));
    memset(f.px, 10 + i, f.stride_bytes * (size_t)f.height_px);
    display.commit(display.self);
    assert_ptr_equal(fake_drm_shown(&fake).px, f.px);
    assert_int_equal(fake_drm_shown(&fake).px[0], 10 + i);
    assert_false(display.begin(display.self, &f)); // until the screen has shown it
    fake.has_event = true;
  }
  assert_true(display.begin(display.self, &f));
  fake.are_flips_refused = true; // another program has the screen for a while
  display.commit(display.self);
  assert_int_equal(d.n_refused, 1);
  fake.are_flips_refused = false;
  assert_true(display.begin(display.self, &f));
  display.commit(display.self);
  assert_int_equal(d.n_flips, 4);
  sv_drm_close(&d);
  is_as_before(FAKE_DRM_FBCON);
}

TEST(text_is_white_and_stays_within_the_frame) {
  sv_display_frame f;
  assert_ok(open_screen("auto"), &err);
  const sv_display display = sv_drm_display(&d);
  assert_true(display.begin(display.self, &f));
  display.text(display.self, 4, f.height_px - 8, 2,
               "Scan 3: a line that is longer than the screen is wide, "
               "with letters that it has not (\xc3\xa4), and so on");
  display.text(display.self, -7, -7, 3, "AB");
  long n = 0;
  for (int y = 0; y < f.height_px; y++)
    for (int x = 0; x < f.width_px; x++) {
      const uint8_t *p = f.px + (size_t)y * f.stride_bytes + 4 * (size_t)x;
      assert_true(p[0] == 0 || p[0] == 255);
      n += p[0] == 255;
    }
  assert_in_range(n, 500, 20000);
  for (int y = 0; y < f.height_px; y++) // the padding of the rows
    for (size_t i = 4 * (size_t)f.width_px; i < f.stride_bytes; i++)
      assert_int_equal(f.px[(size_t)y * f.stride_bytes + i], 0);
  sv_drm_close(&d);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test_setup(the_first_connected_screen_is_taken_and_given_back, clean),
      cmocka_unit_test_setup(a_screen_that_was_off_is_off_again, clean),
      cmocka_unit_test_setup(large_screens_get_a_mode_that_a_board_can_draw, clean),
      cmocka_unit_test_setup(a_missing_screen_is_named, clean),
      cmocka_unit_test_setup(a_screen_that_cannot_be_had_is_explained, clean),
      cmocka_unit_test_setup(frames_are_shown_in_turn_and_nothing_waits, clean),
      cmocka_unit_test_setup(text_is_white_and_stays_within_the_frame, clean),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
