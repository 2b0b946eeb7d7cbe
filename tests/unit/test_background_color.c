// SPDX-License-Identifier: Apache-2.0
// The color behind the model, from pictures (src/train/background.h), and in a model file.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/format/ply.h"
#include "src/train/background.h"
#include "tests/common/test.h"

#define W 64
#define H 40

static uint8_t px[2][H * W * 4], mask[H * W];
static sv_train_view views[2];
static sv_trainer t;

// Noise of all brightnesses, in the mean (120, 90, 60); the first `n` pixels are flat.
static void paint(int n_channels, int n, uint8_t flat) {
  memset(&t, 0, sizeof t);
  memset(views, 0, sizeof views);
  for (int v = 0; v < 2; v++) {
    for (int i = 0; i < W * H; i++) {
      uint8_t *p = px[v] + i * n_channels;
      const int light = i * 37 % 251;
      for (int k = 0; k < 3; k++) p[k] = (uint8_t)(i < n ? flat + i % 5 : light * (24 - 6 * k) / 25);
      if (n_channels == 4) p[3] = 255;
    }
    views[v].image = (sv_image_u8){px[v], W, H, n_channels, W * n_channels};
  }
  t.cfg.background = SV_BG_OF_PICTURES;
  t.views = views;
  t.n_views = 2;
}

static uint32_t found(void) { return sv_train_background_of_views(&t).rgb; }
static bool is_guess(void) { return sv_train_background_of_views(&t).is_guess; }

static bool is_about(uint32_t rgb, int r, int g, int b) {
  const int want[3] = {r, g, b};
  for (int k = 0; k < 3; k++)
    if (abs((int)(rgb >> (16 - 8 * k) & 255) - want[k]) > 4) return false;
  return true;
}

TEST(test_mean) {
  paint(3, 0, 0);
  assert_true(is_guess() && is_about(found(), 120, 90, 60));
  paint(3, W * H / 5, 245); // not enough for a backdrop
  assert_true(is_about(found(), 145, 121, 97));
}

TEST(test_flat_backdrops) {
  paint(3, W * H / 3, 250);
  assert_true(!is_guess() && is_about(found(), 252, 252, 252));
  t.cfg.background = SV_BG_BACKDROP;
  assert_true(is_about(found(), 252, 252, 252));
  paint(3, W * H / 6, 0);
  assert_true(!is_guess() && found() == 0);
}

TEST(test_black_otherwise) {
  paint(4, 0, 0);
  assert_true(found() == 0);
  paint(3, 0, 0);
  t.cfg.background = SV_BG_BACKDROP;
  assert_true(found() == 0);
  paint(3, 0, 0);
  t.cfg.is_deep = true;
  assert_true(found() == 0);
  paint(3, 0, 0);
  t.n_views = 0;
  assert_true(found() == 0);
}

// What masks leave out does not count.
TEST(test_masks) {
  paint(3, W * H / 2, 250);
  memset(mask, 1, sizeof mask);
  memset(mask, 0, W * H / 2);
  for (int v = 0; v < 2; v++) views[v].image.mask = mask;
  assert_true(is_about(found(), 120, 90, 60));
  memset(mask, 0, sizeof mask);
  assert_true(found() == 0);
}

TEST(test_over_which) {
  float bg[3];
  sv_train_background_color(SV_BG_WHITE, 0x102030, bg);
  assert_true(bg[0] == 1 && bg[1] == 1 && bg[2] == 1);
  sv_train_background_color(SV_BG_RANDOM, 0x102030, bg);
  assert_true(bg[0] == 0 && bg[1] == 0 && bg[2] == 0);
  sv_train_background_color(SV_BG_OF_PICTURES, 0x33ff00, bg);
  assert_true(bg[0] == 0.2f && bg[1] == 1 && bg[2] == 0);
}

TEST(test_model_file) {
  static const struct {
    const char *comment;
    uint32_t rgb;
  } cases[] = {
      {"SplatBackground: #867c75", 0x867c75}, {"SplatBackground: #867c7", 0}, {"SplatBackground: 867c750", 0},
      {"SplatBackground: #86ZZ75", 0},        {"SplatBackground:", 0},        {"Background: #867c75", 0}};
  for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
    char text[400];
    sv_ply ply;
    sv_err err;
    snprintf(text, sizeof text,
             "ply\nformat ascii 1.0\ncomment %s\nelement vertex 1\nproperty float x\nproperty float y\n"
             "property float z\nend_header\n0 0 0\n",
             cases[i].comment);
    assert_ok(sv_ply_open(&ply, "m", text, strlen(text), &err), &err);
    assert_int_equal(ply.background, cases[i].rgb);
  }
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_mean),
      cmocka_unit_test(test_flat_backdrops),
      cmocka_unit_test(test_black_otherwise),
      cmocka_unit_test(test_masks),
      cmocka_unit_test(test_over_which),
      cmocka_unit_test(test_model_file),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
