// SPDX-License-Identifier: Apache-2.0
// What the way in which exposures sample a scene decides.
#include "src/train/objective.h"
#include "src/train/optimize.h"
#include "tests/common/test.h"

static sv_train_cfg of_gaussians(int n, int n_exposures, int n_sub_views, bool is_multiplexed,
                                 bool is_moving) {
  sv_train_cfg c = sv_train_defaults();
  c.n_gaussians = n;
  sv_train_set_objective(&c, &(sv_sampling){.n_exposures = n_exposures,
                                            .n_sub_views = n_sub_views,
                                            .is_multiplexed = is_multiplexed,
                                            .is_moving = is_moving});
  return c;
}

static sv_train_cfg of(int n_exposures, int n_sub_views, bool is_multiplexed, bool is_moving) {
  return of_gaussians(20000, n_exposures, n_sub_views, is_multiplexed, is_moving);
}

// The fewer exposures, the more Gaussians are left out of a step; none where there are many, where
// the scene moves or lenses share a sensor.
TEST(test_dropout) {
  assert_true(sv_train_defaults().dropout == 0);
  for (int n_sub_views = 1; n_sub_views <= 16; n_sub_views *= 4) {
    float before = 1;
    for (int n = 1; n <= 30; n++) {
      const sv_train_cfg c = of(n, n_sub_views, false, false);
      assert_true(c.dropout >= 0 && c.dropout <= before && c.dropout < 0.5f);
      assert_true((c.dropout > 0) == (n < 18));
      assert_true(c.dropout_until == (c.is_supersampled ? c.supersample_from : 0.85f));
      before = c.dropout;
    }
    assert_true(of(1, n_sub_views, false, true).dropout == 0);
    assert_true(of(1, n_sub_views, true, false).dropout == 0);
  }
  assert_true(of(1, 16, false, false).dropout < of(1, 2, false, false).dropout);
}

// Many exposures, or instants, tell which Gaussians matter least.
TEST(test_relocated_share) {
  assert_true(sv_train_defaults().relocate_share == 0);
  for (int n = 1; n <= 30; n++) {
    assert_true((of(n, 2, false, false).relocate_share > 0) == (n >= 18));
    assert_true(of(n, 2, false, true).relocate_share > 0);
    assert_true(of(n, 16, true, false).relocate_share == 0);
  }
}

// With several exposures of a still scene rates stay until late, then fall to the end; else they
// do not settle.
TEST(test_settling) {
  assert_true(sv_train_settling(&(sv_train_cfg){.settle_from = 1, .settle_rate = 0.1f}, 1) == 1);
  for (int n = 1; n <= 30; n++) {
    const sv_train_cfg c = of(n, 2, false, false);
    float before = 1;
    assert_true((c.settle_from < 1) == (n >= 6));
    assert_true((c.newton.rate_end == c.newton.rate_start) == (n >= 6));
    assert_true(of(n, 2, false, true).settle_from == 1 && of(n, 16, true, false).settle_from == 1);
    for (int i = 0; i <= 100 && n >= 6; i++) {
      const float factor = sv_train_settling(&c, 0.01f * (float)i);
      assert_true(factor <= before && (factor < 1) == (i > 80));
      before = factor;
    }
    assert_true(n < 6 || (before > 0.0999f && before < 0.1001f));
    assert_true(sv_train_settling(&c, 2) == before || n < 6);
  }
}

// What a few exposures of a still scene do not show is seen from elsewhere.
TEST(test_background) {
  for (int n = 1; n <= 30; n++) {
    assert_int_equal(of(n, 2, false, false).background, n < 18 ? SV_BG_OF_PICTURES : SV_BG_BACKDROP);
    assert_int_equal(of(n, 2, false, true).background, SV_BG_BACKDROP);
    assert_int_equal(of(n, 16, true, false).background, SV_BG_BLACK);
  }
}

// A few exposures tell what is transparent by random backgrounds while the model takes shape.
TEST(test_random_backgrounds) {
  assert_true(sv_train_defaults().random_until == 0);
  for (int n_sub_views = 1; n_sub_views <= 16; n_sub_views *= 4)
    for (int n = 1; n <= 30; n++) {
      assert_true(of(n, n_sub_views, false, false).random_until == (n > 1 && n < 18 ? 0.3f : 0.0f));
      assert_true(of(n, n_sub_views, false, true).random_until == 0);
    }
}

// Few exposures of several cameras, and moving scenes, have smooth depth, but for lens grids.
TEST(test_smooth_depth) {
  for (int n = 1; n <= 30; n++) {
    assert_true(of(n, 1, false, false).weight_smooth == 0);
    assert_true((of(n, 2, false, false).weight_smooth > 0) == (n <= 3));
    assert_true((of(n, 2, false, false).weight_reproject > 0) == (n <= 3));
    assert_true(of(n, 16, false, false).weight_smooth == 0 && of(n, 16, true, false).weight_smooth == 0);
    assert_true(of(n, 2, false, true).weight_smooth > 0 && of(n, 1, false, true).weight_smooth == 0);
  }
}

// Novel views beside those of several exposures, the less the more there are; none with one
// exposure, with lens grids, which have reduced ones, with moving scenes and from afar.
TEST(test_novel_views) {
  for (int n_sub_views = 1; n_sub_views <= 4; n_sub_views++)
    for (int n = 1; n <= 30; n++) {
      const sv_train_cfg c = of(n, n_sub_views, false, false), more = of(n + 1, n_sub_views, false, false);
      const bool has_novel = n > 1 && n < 18;
      assert_int_equal(c.n_novel, has_novel);
      assert_true((c.weight_reproject_novel > 0) == has_novel && (c.weight_smooth_novel > 0) == has_novel);
      assert_true(c.weight_tv_novel == 0);
      if (n > 1) assert_true(more.weight_smooth_novel <= c.weight_smooth_novel);
      assert_int_equal(of(n, n_sub_views, false, true).n_novel, 0);
      assert_true(of(n, 16, n_sub_views % 2 == 0, false).weight_smooth_novel == 0);
      sv_train_cfg far = sv_train_defaults();
      sv_train_set_objective(&far,
                             &(sv_sampling){.n_exposures = n, .n_sub_views = n_sub_views, .is_far = true});
      assert_int_equal(far.n_novel, 0);
    }
}

// Where exposures are few, of more than 20,000 Gaussians each has the weight that it would have
// among so many; fewer share the whole weight.
TEST(test_weight_of_many) {
  for (int n_sub_views = 1; n_sub_views <= 4; n_sub_views++)
    for (int n = 1; n <= 30; n++) {
      const float base = of(n, n_sub_views, false, false).reg_opacity;
      const float five = of_gaussians(100000, n, n_sub_views, false, false).reg_opacity / base;
      assert_true(of_gaussians(5000, n, n_sub_views, false, false).reg_opacity == base);
      assert_true(n <= SV_FEW_EXPOSURES ? five > 4.999f && five < 5.001f : five < 5);
      assert_true((five > 1) == (n < 18));
    }
  assert_true(of_gaussians(100000, 1, 16, false, false).reg_opacity == of(1, 16, false, false).reg_opacity);
  assert_true(of_gaussians(100000, 1, 16, true, false).reg_opacity == of(1, 16, true, false).reg_opacity);
  assert_true(of_gaussians(100000, 1, 2, false, true).reg_opacity == of(1, 2, false, true).reg_opacity);
}

// Regularization of opacities ends early, but not where few pictures of one camera are all there
// is.
TEST(test_opacity_until) {
  for (int n = 1; n <= 24; n++) {
    assert_true((of(n, 1, false, false).reg_opacity_until == 1) == (n <= SV_FEW_EXPOSURES));
    assert_true((of(n, 1, false, true).reg_opacity_until == 1) == (n <= SV_FEW_EXPOSURES));
    assert_true(of(n, 2, false, false).reg_opacity_until < 0.5f);
    assert_true(of(n, 2, false, true).reg_opacity_until < 0.5f);
    assert_true(of(n, 16, true, false).reg_opacity_until < 0.5f);
  }
}

// What starts far from the surface has Adam's steps but for means, and pays as much
// for opacity as before there was dropout; a light field then does without it.
TEST(test_far) {
  for (int n_sub_views = 1; n_sub_views <= 16; n_sub_views *= 2) {
    const bool is_grid = n_sub_views > 4;
    sv_train_cfg near = of(1, n_sub_views, false, false), far = sv_train_defaults();
    sv_train_set_objective(&far,
                           &(sv_sampling){.n_exposures = 1, .n_sub_views = n_sub_views, .is_far = true});
    const sv_optimizer expected = n_sub_views > 1 ? SV_OPTIMIZER_MIXED : SV_OPTIMIZER_GAUSS_NEWTON;
    assert_int_equal(near.optimizer, SV_OPTIMIZER_GAUSS_NEWTON);
    assert_int_equal(far.optimizer, expected);
    assert_true((far.reg_opacity > near.reg_opacity) == (n_sub_views > 1 && !is_grid));
    assert_true(far.dropout == (is_grid ? 0.0f : near.dropout));
    assert_true(far.weight_smooth == 0);
    assert_true(far.reg_opacity_until == 1);
  }
}

// Two or three exposures of one camera: means alone by Gauss-Newton.
TEST(test_one_camera) {
  for (int n = 1; n <= 30; n++) {
    const bool is_mixed = n == 2 || n == 3;
    assert_int_equal(of(n, 1, false, false).optimizer,
                     is_mixed ? SV_OPTIMIZER_MIXED : SV_OPTIMIZER_GAUSS_NEWTON);
    assert_int_equal(of(n, 2, false, false).optimizer, SV_OPTIMIZER_GAUSS_NEWTON);
    assert_int_equal(of(n, 1, true, false).optimizer, SV_OPTIMIZER_GAUSS_NEWTON);
  }
}

static sv_train_cfg of_pixels(int n_px, int n_steps, int n_exposures, bool is_moving) {
  sv_train_cfg c = sv_train_defaults();
  c.expected_steps = n_steps;
  sv_train_set_objective(
      &c, &(sv_sampling){
              .n_exposures = n_exposures, .n_sub_views = 2, .largest_px = n_px, .is_moving = is_moving});
  return c;
}

// Large pictures of many exposures of a still scene reach full size later, but not in long runs,
// and relocate shares until after that.
TEST(test_large_pictures) {
  const sv_train_cfg usual = sv_train_defaults(), small = of_pixels(320 * 240, 1000, 24, false);
  assert_true(small.fine_at == usual.fine_at);
  assert_true(small.relocate_share_until == usual.relocate_share_until);
  assert_true(of_pixels(640 * 480, 1000, 24, true).fine_at == usual.fine_at);
  assert_true(of_pixels(640 * 480, 1000, 12, false).fine_at == usual.fine_at);
  float before = 1;
  for (int n = 0; n <= 5000; n += 500) {
    const sv_train_cfg c = of_pixels(640 * 480, n, 24, false);
    assert_true(c.fine_at >= usual.fine_at && c.fine_at <= 0.5f && c.fine_at <= before);
    assert_true((c.fine_at > usual.fine_at) == (n < 5000));
    assert_true(c.relocate_share_until > c.fine_at);
    before = c.fine_at;
  }
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_dropout),        cmocka_unit_test(test_relocated_share),
      cmocka_unit_test(test_settling),       cmocka_unit_test(test_random_backgrounds),
      cmocka_unit_test(test_background),     cmocka_unit_test(test_one_camera),
      cmocka_unit_test(test_weight_of_many), cmocka_unit_test(test_smooth_depth),
      cmocka_unit_test(test_opacity_until),  cmocka_unit_test(test_far),
      cmocka_unit_test(test_novel_views),    cmocka_unit_test(test_large_pictures)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
