// SPDX-License-Identifier: Apache-2.0
// Spacing of exposures: by time on a grid that frame times do not add up on, and by motion of the
// picture, whatever its exposure.
#include <string.h>

#include "src/capture/spacing.h"
#include "tests/common/test.h"

static sv_spacing_cells cells[2];

#define W 160
#define H 120

static uint8_t px[H * W * 3];
static sv_spacing s;

static bool is_due(sv_ns at) { return sv_spacing_is_due(&s, &(sv_spacing_exposure){at, 0}); }
static bool has_moved(const sv_image_u8 *image, sv_ns at) {
  return sv_spacing_has_moved(&s, image, &(sv_spacing_exposure){at, 0});
}
static void keep(sv_ns at) { sv_spacing_keep(&s, &(sv_spacing_exposure){at, 0}); }

static int kept_of(const sv_spacing_cfg *cfg, int n_frames, sv_ns frame_ns) {
  int n = 0;
  sv_spacing_init(&s, cfg, cells);
  for (int i = 0; i < n_frames; i++) {
    const sv_ns at = 5 * SV_NS_PER_S + i * frame_ns;
    if (!is_due(at)) continue;
    keep(at);
    n++;
  }
  return n;
}

TEST(test_time) {
  const sv_ns frame_ns = 33333333;
  const sv_spacing_cfg all = {0}, half = {.every_ns = SV_NS_PER_S / 2, .early_ns = frame_ns / 2},
                       strict = {.every_ns = SV_NS_PER_S / 2};
  assert_int_equal(kept_of(&all, 300, frame_ns), 300);
  assert_int_equal(kept_of(&half, 300, frame_ns), 20); // ten seconds
  assert_int_equal(kept_of(&strict, 300, frame_ns), 20);
  // An interval that is no whole number of frames: none is lost by rounding.
  const sv_spacing_cfg odd = {.every_ns = 80 * SV_NS_PER_MS, .early_ns = frame_ns / 2};
  assert_int_equal(kept_of(&odd, 300, frame_ns), 125);
}

TEST(test_time_after_a_pause) {
  const sv_spacing_cfg cfg = {.every_ns = SV_NS_PER_S};
  sv_spacing_init(&s, &cfg, cells);
  keep(0);
  keep(10 * SV_NS_PER_S); // a camera was away
  assert_false(is_due(10 * SV_NS_PER_S + SV_NS_PER_S / 2));
  assert_true(is_due(11 * SV_NS_PER_S));
}

// Smooth blobs, moved by (dx, dy) pixels and lit by gain.
static sv_image_u8 draw(int dx, int dy, double gain) {
  for (int y = 0; y < H; y++)
    for (int x = 0; x < W; x++) {
      const int u = (x - dx + 4 * W) / 24, v = (y - dy + 4 * H) / 24;
      const unsigned hash = ((unsigned)u * 2654435761u) ^ ((unsigned)v * 40503u * 65537u);
      for (int k = 0; k < 3; k++) px[(y * W + x) * 3 + k] = (uint8_t)(gain * (40 + (hash >> 24) / 2));
    }
  return (sv_image_u8){px, W, H, 3, W * 3, NULL};
}

static bool moves(int dx, int dy, double gain, sv_ns after_ns) {
  const sv_spacing_cfg cfg = {.is_by_motion = true};
  sv_image_u8 first = draw(0, 0, 1);
  sv_spacing_init(&s, &cfg, cells);
  assert_true(has_moved(&first, 0));
  keep(0);
  sv_image_u8 second = draw(dx, dy, gain);
  return has_moved(&second, after_ns);
}

TEST(test_motion) {
  const sv_ns soon = 30 * SV_NS_PER_MS;
  assert_false(moves(0, 0, 1, soon));
  assert_false(moves(3, 0, 1, soon));   // 2 % of the width
  assert_false(moves(0, 0, 1.3, soon)); // brighter
  assert_true(moves(12, 0, 1, soon));
  assert_true(moves(-12, 0, 1.3, soon));
  assert_true(moves(0, 12, 0.7, soon));
  assert_true(moves(70, 50, 1, soon)); // another picture
  assert_true(moves(0, 0, 1, SV_SPACING_STILL_NS));
}

TEST(test_dark_pictures_wait) {
  const sv_spacing_cfg cfg = {.is_by_motion = true};
  sv_image_u8 dark = draw(0, 0, 0);
  sv_spacing_init(&s, &cfg, cells);
  assert_true(has_moved(&dark, 0));
  keep(0);
  assert_false(has_moved(&dark, SV_NS_PER_S / 2));
  assert_true(has_moved(&dark, SV_NS_PER_S));
}

// Of three shutter times in turn, each for two frames, one of each is kept when one is due.
TEST(test_brackets) {
  const sv_spacing_cfg cfg = {.every_ns = SV_NS_PER_S, .n_brackets = 3};
  static const int kept[] = {0, 2, 4, 30, 32, 34, 60, 62, 64};
  int n = 0;
  sv_spacing_init(&s, &cfg, cells);
  for (int i = 0; i < 90; i++) {
    const sv_spacing_exposure e = {i * SV_NS_PER_S / 30, 1 + i / 2 % 3};
    if (!sv_spacing_is_due(&s, &e)) continue;
    assert_true(n < 9);
    assert_int_equal(i, kept[n++]);
    sv_spacing_keep(&s, &e);
  }
  assert_int_equal(n, 9);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_time),
      cmocka_unit_test(test_time_after_a_pause),
      cmocka_unit_test(test_brackets),
      cmocka_unit_test(test_motion),
      cmocka_unit_test(test_dark_pictures_wait),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
