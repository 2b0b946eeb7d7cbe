// SPDX-License-Identifier: Apache-2.0
// A run with a screen: what it shows is what the runtime renders, the training does not notice, and
// a screen that does not answer holds nothing up.
#include <string.h>

#include "tests/common/display_run.h"
#include "tests/common/fake_drm.h"
#include "tests/common/test.h"

static world w;
static fake_drm fake;
static sv_drm d;

static sv_display open_screen(void) {
  const sv_drm_sys sys = fake_drm_sys(&fake);
  fake_drm_init(&fake);
  assert_ok(sv_drm_open(&d, "auto", &sys, &w.err), &w.err);
  return sv_drm_display(&d);
}

TEST(the_screen_shows_what_the_runtime_renders) {
  const sv_display display = open_screen();
  if (!display_run(&w, &display)) fail_msg("%s", w.err.text);
  sv_display_frame shown = fake_drm_shown(&fake);
  long n;
  assert_int_equal(display_differences(&w, &shown, &n), 0);
  // The model beside the two cameras
  assert_in_range(w.app.preview.screen.model.width_px, 600, 640);
  assert_in_range(w.app.preview.screen.tile[0].width_px, 100, 160);
  assert_in_range(w.app.preview.screen.tile[1].width_px, 100, 160);
  assert_in_range(n, 250000, 384000);
  assert_true(w.app.preview.screen.n_drawn > 3);
  const uint64_t with = world_digest(&w);
  world_close(&w);
  sv_drm_close(&d);
  assert_int_equal(fake.fb_id, FAKE_DRM_FBCON);
  if (!display_run(&w, NULL)) fail_msg("%s", w.err.text);
  assert_true(world_digest(&w) == with);
  world_close(&w);
}

TEST(a_screen_that_hangs_holds_nothing_up) {
  const sv_display display = open_screen();
  fake.are_flips_waiting = true;
  if (!display_run(&w, &display)) fail_msg("%s", w.err.text);
  assert_int_equal(w.app.preview.screen.n_drawn, 1);
  world_close(&w);
  sv_drm_close(&d);
}

// A module of the code at the right of the screen, dark or light.
TEST(before_start_the_link_is_a_code_on_the_screen) {
  static const char link[] = "http://192.168.1.20:8080/#0123456789abcdef0123456789abcdef";
  static sv_screen screen;
  static sv_feed_tiles tiles;
  static sv_qr q;
  static _Alignas(64) uint8_t block[16u << 20];
  sv_feed feed;
  sv_display display = open_screen();
  display.link = link;
  screen.tiles = &tiles;
  assert_int_equal(sv_feed_init(&feed, block, sizeof block, 1, 1, 0), SV_OK);
  sv_screen_start(&screen, &feed, &display);
  assert_true(sv_qr_make(&q, link));
  sv_screen_draw(&screen, &display, &(sv_screen_content){.is_waiting = true, .line = "Waiting for Start"});
  const sv_display_frame f = fake_drm_shown(&fake);
  const int zoom = 400 / (q.side + 8), px = zoom * (q.side + 8);
  assert_true(zoom >= 4);
  const int x0 = 800 - px, y0 = (480 - 14 - px) / 2;
  for (int y = -4; y < q.side + 4; y++)
    for (int x = -4; x < q.side + 4; x++) {
      const bool is_in = x >= 0 && y >= 0 && x < q.side && y < q.side;
      const bool is_dark = is_in && (q.module[y][x] & SV_QR_DARK);
      const int at_x = x0 + (x + 4) * zoom + zoom / 2, at_y = y0 + (y + 4) * zoom + zoom / 2;
      assert_int_equal(f.px[(size_t)at_y * f.stride_bytes + 4 * (size_t)at_x], is_dark ? 0 : 255);
    }
  sv_drm_close(&d);
}

TEST(a_failure_is_told_in_lines) {
  const sv_display display = open_screen();
  sv_screen_message(&display,
                    "v4l2:/dev/video0: the camera cannot be opened (no such device); plug it in and "
                    "look at subview cameras for what there is on this machine");
  const sv_display_frame f = fake_drm_shown(&fake);
  int n_rows = 0;
  for (int line = 1; line < 4; line++) {
    bool has_text = false;
    for (int y = line * 12; y < line * 12 + 12; y++)
      for (int x = 0; x < f.width_px; x++)
        has_text |= f.px[(size_t)y * f.stride_bytes + 4 * (size_t)x] == 255;
    n_rows += has_text;
  }
  assert_int_equal(n_rows, 2);
  sv_drm_close(&d);
}

// The program itself, where no card is.
TEST(a_missing_card_is_said) {
  const int code =
      shell_run("%s/subview run --source sim:textured,rig=stereo,size=64x48 --steps 2 --gaussians 50 "
                "--exposures 1 --display card77 --out %s 2>&1",
                shell_bin(), temp_path("no-card"));
  assert_int_equal(code, 1);
  assert_contains(shell_out, "--display card77: there is no such card in /dev/dri");
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(the_screen_shows_what_the_runtime_renders),
      cmocka_unit_test(a_screen_that_hangs_holds_nothing_up),
      cmocka_unit_test(before_start_the_link_is_a_code_on_the_screen),
      cmocka_unit_test(a_failure_is_told_in_lines),
      cmocka_unit_test(a_missing_card_is_said),
  };
  return cmocka_run_group_tests(tests, temp_folder_setup, temp_folder_teardown);
}
