// SPDX-License-Identifier: Apache-2.0
// Views of rolling shutters: the rendering against one of each row at its own pose; a whole step's
// gradient and that of the pose against central differences; the same bits from all kernels and any
// number of threads; without motion the bits of a global shutter.
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "platform/linux/linux.h"
#include "src/base/mathx.h"
#include "src/track/bundle.h"
#include "tests/common/step_gradient.h"
#include "tests/common/test.h"

#define W 37
#define H 26

static uint8_t block[24 << 20] __attribute__((aligned(64)));
static uint8_t picture[2][H * W * 3];
static sv_trainer t;
static const double MOTION[2][6] = {{0.9, -1.1, 0.7, 0.8, -0.5, 0.6}, {-0.5, 1.3, 0.9, -0.7, 0.9, 0.2}};
static double fx = 40, fy = 41;
static const double CX = 18, CY = 13.5;
#define ASIDE 0.9 // radians from a fisheye's axis to the scene
static sv_fisheye fisheye;
static bool is_fisheye;

static sv_camera_model lens_of_test(void) {
  return (sv_camera_model){.kind = is_fisheye ? SV_MODEL_KB4 : SV_MODEL_PINHOLE,
                           .width_px = W,
                           .height_px = H,
                           .p = {fx, fy, is_fisheye ? CX - ASIDE * fx : CX, CY, is_fisheye ? 0.01 : 0}};
}

static sv_row_time row_time_of(double readout_s, sv_shutter_direction direction) {
  const sv_camera_model lens = lens_of_test();
  sv_row_time time;
  assert_int_equal(sv_row_time_make(&time, &(sv_row_time_cfg){.shutter = {readout_s, direction},
                                                              .lens = &lens,
                                                              .fisheye = is_fisheye ? &fisheye : NULL,
                                                              .sensor_width_px = W,
                                                              .sensor_height_px = H,
                                                              .half_x = 0.5 * W / fx + is_fisheye * ASIDE,
                                                              .half_y = 0.5 * H / fy}),
                   SV_OK);
  return time;
}

static void open_training(const sv_kernels *k, const sv_pool *pool, sv_train_cfg cfg, float log_scale,
                          double readout_s, const double motion[2][6]) {
  sv_arena a = sv_arena_make(block, sizeof block);
  sv_err err;
  step_gradient_settings(&cfg);
  cfg.cap_views = 2;
  cfg.cap_width_px = W;
  cfg.cap_height_px = H;
  cfg.n_threads = pool->n_threads;
  if (sv_trainer_init(&t, &cfg, (sv_compute){k, pool}, &a, &err) < 0) fail_msg("%s", err.text);
  const sv_camera_model lens = lens_of_test();
  assert_true(sv_fisheye_make(&fisheye, &lens) == is_fisheye);
  for (int i = 0; i < 2; i++) {
    for (int px = 0; px < W * H * 3; px++) picture[i][px] = (px / (20 + 7 * i)) % 2 ? 255 : 0;
    sv_pose pose;
    double eye[3] = {3, i - 0.5, 0.7}, at[3] = {0, 0, 0}, up[3] = {0, 0, 1};
    assert_true(sv_pose_look_at(&pose, eye, at, up));
    if (is_fisheye) {
      double turn[9], none[3];
      sv_motion_apply(none, (const double[6]){0, ASIDE}, 1, pose.t, turn);
      sv_mul33(pose.r, turn, pose.r);
      memcpy(pose.t, none, sizeof none);
    }
    sv_view view = sv_view_make(W, H, lens.p, &pose);
    view.fisheye = is_fisheye ? &fisheye : NULL;
    sv_image_u8 im = {picture[i], W, H, 3, W * 3};
    assert_ok(sv_train_add_view(&t, &view, &im, &err), &err);
    const sv_row_time time = row_time_of(readout_s, i ? SV_SHUTTER_LEFT : SV_SHUTTER_DOWN);
    if (motion) sv_train_set_rolling(&t, i, &time, motion[i]);
    if (cfg.poses.cap_poses > 0) {
      const sv_pose none = sv_pose_identity();
      sv_train_refine_view(&t, i, i, &none, &pose, true);
    }
  }
  step_gradient_start(&t, log_scale, &a);
}

static sv_train_cfg settings(void) {
  sv_train_cfg cfg = sv_train_defaults();
  cfg.is_rolling = true;
  return cfg;
}

// --- value ---------------------------------------------------------------------------------------

static double difference(float rows[3][H][W]) {
  double sum = 0;
  for (int c = 0; c < 3; c++)
    for (int y = 0; y < H; y++)
      for (int x = 0; x < W; x++)
        sum += fabs((double)rows[c][y][x] - (double)t.render.rgb.c[c][y * t.render.rgb.stride + x]);
  return sum / (3.0 * H * W);
}

// Each row from the pose at its own time.
TEST(test_value) {
  static float rows[3][H][W];
  sv_kernels k;
  sv_pool pool = sv_pool_serial();
  sv_kernels_init(&k, ~0u);
  open_training(&k, &pool, settings(), -3.5f, 0.04, MOTION);
  const sv_render_options o = sv_train_render_options(&t, 1.0f, false);
  const sv_view *v = &t.views[0].view;
  for (int y = 0; y < H; y++) {
    sv_view at = *v;
    const double s = 0.04 * ((y + 0.5) / H - 0.5),
                 w[3] = {s * MOTION[0][0], s * MOTION[0][1], s * MOTION[0][2]};
    double turn[9];
    sv_rodrigues(turn, w);
    for (int i = 0; i < 3; i++) {
      double moved = s * MOTION[0][3 + i];
      for (int j = 0; j < 3; j++) {
        double r = 0;
        for (int n = 0; n < 3; n++) r += turn[3 * i + n] * (double)v->r[3 * n + j];
        at.r[3 * i + j] = (float)r;
        moved += turn[3 * i + j] * (double)v->t[j];
      }
      at.t[i] = (float)moved;
    }
    assert_int_equal(sv_render(&t.render, &t.g, &at, &o), SV_OK);
    for (int c = 0; c < 3; c++)
      memcpy(rows[c][y], t.render.rgb.c[c] + y * t.render.rgb.stride, sizeof rows[c][y]);
  }
  assert_int_equal(sv_render(&t.render, &t.g, v, &o), SV_OK);
  const double still = difference(rows);
  sv_train_roll(&t, 0, v, o.near_z);
  assert_int_equal(sv_render(&t.render, &t.g, v, &o), SV_OK);
  sv_train_unroll(&t);
  const double rolled = difference(rows);
  print_message("from the rows' own poses off by %.2g, without the shutter by %.2g\n", rolled, still);
  assert_true(still > 0.001);
  assert_true(rolled < 0.3 * still);
}

// --- gradients -----------------------------------------------------------------------------------

static void check_gradients(bool is_supersampled, float log_scale) {
  sv_kernels k;
  sv_pool pool = sv_pool_serial();
  sv_train_cfg cfg = settings();
  step_gradient sum = {0};
  step_gradient_kernels(&k);
  cfg.is_supersampled = is_supersampled;
  open_training(&k, &pool, cfg, log_scale, 0.1, MOTION);
  for (int i = 0; i < 2; i++) step_gradient_check(&t, &sum);
  step_gradient_agrees(&sum, is_supersampled ? "rolling shutter, supersampled" : "rolling shutter", 100, 300,
                       8);
}

TEST(test_gradients) {
  if (is_emulated()) skip(); // quotients of whole steps take minutes
  check_gradients(false, 0.9f);
  check_gradients(true, 0.9f);
}

TEST(test_fisheye_gradients) {
  if (is_emulated()) skip(); // quotients of whole steps take minutes
  is_fisheye = true;
  fx = fy = 100; // so narrow that no splat ends, of sizes that are drawn
  check_gradients(false, -0.3f);
  fx = fy = 40;
  is_fisheye = false;
}

TEST(test_fisheye_value) {
  is_fisheye = true;
  test_value(NULL);
  is_fisheye = false;
}

static double loss_at(const sv_trainer *before, int i_view, const sv_view *view) {
  sv_step_stats st;
  t.rng = before->rng;
  t.i_order = before->i_order;
  t.step = before->step;
  t.views[i_view].view = *view;
  assert_int_equal(sv_train_step(&t, 0.5f, &st), SV_OK);
  assert_int_equal(st.i_view, i_view);
  return st.loss;
}

static sv_view twisted(const sv_view *v, int i, double by) {
  double twist[6] = {0};
  sv_pose p;
  sv_view out = *v;
  for (int k = 0; k < 9; k++) p.r[k] = (double)v->r[k];
  for (int k = 0; k < 3; k++) p.t[k] = (double)v->t[k];
  twist[i] = by;
  sv_pose_twist(&p, twist);
  sv_view_set_pose(&out, &p);
  return out;
}

TEST(test_pose_gradient) {
  static sv_trainer before;
  sv_kernels k;
  sv_pool pool = sv_pool_serial();
  sv_train_cfg cfg = settings();
  sv_step_stats st;
  double diff2 = 0, size2 = 0;
  int n = 0;
  if (is_emulated()) skip(); // quotients of whole steps take minutes
  step_gradient_kernels(&k);
  cfg.poses = (sv_train_poses_cfg){.cap_poses = 2, .until = 1};
  cfg.dropout = 0;
  open_training(&k, &pool, cfg, 0.9f, 0.1, MOTION);
  for (int view_of_two = 0; view_of_two < 2; view_of_two++) {
    before = t;
    assert_int_equal(sv_train_step(&t, 0.5f, &st), SV_OK);
    const int i_view = st.i_view;
    const sv_view view = t.views[i_view].view;
    double is[6] = {0};
    for (int task = 0; task < (t.g.n / 16 + 32) / 32; task++)
      for (int i = 0; i < 6; i++) is[i] += (double)t.poses.sum[task][i];
    for (int i = 0; i < 6; i++) {
      double quotient[2];
      for (int wide = 0; wide < 2; wide++) {
        const double h = wide ? 0.006 : 0.003;
        const sv_view up = twisted(&view, i, h), down = twisted(&view, i, -h);
        quotient[wide] = (loss_at(&before, i_view, &up) - loss_at(&before, i_view, &down)) / (2 * h);
      }
      print_message("view %d twist %d: %g, by differences %g %g\n", i_view, i, is[i], quotient[0],
                    quotient[1]);
      if (fabs(quotient[0] - quotient[1]) > 0.03 * fabs(quotient[0]) + 5e-7) continue; // a jump
      diff2 += (is[i] - quotient[0]) * (is[i] - quotient[0]);
      size2 += quotient[0] * quotient[0];
      n++;
    }
    (void)loss_at(&before, i_view, &view);
  }
  assert_true(n >= 8 && sqrt(diff2 / size2) < 0.015);
}

// --- bits ----------------------------------------------------------------------------------------

static uint64_t digest(uint32_t isa_mask, int n_threads, bool is_rolling, const double motion[2][6]) {
  sv_kernels k;
  sv_linux_pool threads;
  sv_err err;
  assert_int_equal(sv_linux_pool_start(&threads, n_threads, -1, &err), SV_OK);
  sv_pool pool = sv_linux_pool_port(&threads);
  sv_train_cfg cfg = settings();
  sv_step_stats st;
  sv_kernels_init(&k, isa_mask);
  cfg.is_rolling = is_rolling;
  open_training(&k, &pool, cfg, -1.5f, 0.1, motion);
  for (int i = 0; i < 12; i++) assert_int_equal(sv_train_step(&t, (float)i / 12.0f, &st), SV_OK);
  sv_linux_pool_stop(&threads);
  return sv_train_digest(&t);
}

TEST(test_same_bits) {
  static const double none[2][6] = {{0}};
  const uint64_t ref = digest(SV_ISA_BIT(SV_ISA_REF), 1, true, MOTION);
  for (int n = 1; n <= 4; n *= 2) assert_true(digest(~0u, n, true, MOTION) == ref);
  for (int isa = 0; isa < SV_N_ISAS; isa++)
    if ((sv_cpu_isas() & SV_ISA_BIT(isa)) && isa != SV_ISA_SSE41)
      assert_true(digest(sv_isa_only((sv_isa)isa), 2, true, MOTION) == ref);
  const uint64_t global = digest(~0u, 2, false, MOTION);
  assert_true(global != ref);
  assert_true(digest(~0u, 2, true, none) == global);
  assert_true(digest(~0u, 2, true, NULL) == global);
}

TEST(test_refused) {
  sv_kernels k;
  sv_pool pool = sv_pool_serial();
  sv_arena a = sv_arena_make(block, sizeof block);
  sv_err err;
  sv_train_cfg cfg = settings();
  sv_kernels_init(&k, ~0u);
  cfg.has_motion = true;
  assert_int_equal(sv_trainer_init(&t, &cfg, (sv_compute){&k, &pool}, &a, &err), SV_E_UNSUPPORTED);
  assert_contains(err.text, "rolling shutters");
  sv_train_cfg global = sv_train_defaults(), rolling = settings();
  const size_t more = sv_trainer_bytes(&rolling) - sv_trainer_bytes(&global);
  assert_true(more > sizeof(float) * 20000 * SV_N_ROWS(1) &&
              more < sizeof(float) * 20000 * (SV_N_ROWS(1) + 2));
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_value),
      cmocka_unit_test(test_gradients),
      cmocka_unit_test(test_pose_gradient),
      cmocka_unit_test(test_same_bits),
      cmocka_unit_test(test_refused),
      cmocka_unit_test(test_fisheye_value),
      cmocka_unit_test(test_fisheye_gradients),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
