// SPDX-License-Identifier: Apache-2.0
// A field is fitted to a clip's motion that is known: the loss and its gradient, how much of the
// motion is left over, what is drawn at the middle time, and the same bits for any number of
// threads.
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "platform/linux/linux.h"
#include "src/dynamic/distil.h"
#include "tests/common/moving_scene.h"
#include "tests/common/test.h"

#define N_GAUSS 480
#define N_STEPS 600

static _Alignas(64) unsigned char block[96u << 20];
static moving_scene scene;
static sv_trainer trainer;
static sv_dynamic dynamic;
static sv_kernels kernels;
static sv_pool pool;

FIXTURE(setup) {
  moving_scene_make(&scene, block, sizeof block);
  sv_kernels_init(&kernels, ~0u);
  pool = sv_pool_serial();
  return 0;
}

TEST(test_loss) {
  enum { N_ROWS = SV_ROW_SH + 3 };
  sv_fit_weights p;
  float is[N_ROWS * 16], want[N_ROWS * 16], grad[N_ROWS * 16];
  sv_rng rng = sv_rng_make(5, 1);
  for (int r = 0; r < SV_ROW_LOGIT; r++) p.row[r] = r < SV_ROW_QUAT ? 20.0f : 1.0f + (float)r;
  for (int i = 0; i < N_ROWS * 16; i++) {
    is[i] = 2 * sv_rng_f(&rng) - 1;
    want[i] = 2 * sv_rng_f(&rng) - 1;
  }
  assert_true(sv_fit_loss(&p, is, is) == 0.0);
  sv_fit_loss_bwd(&p, is, want, N_ROWS, grad);
  for (int i = 0; i < 16 * SV_ROW_LOGIT; i++) {
    const float h = 1e-2f, was = is[i];
    is[i] = was + h;
    double up = sv_fit_loss(&p, is, want), step = (double)is[i];
    is[i] = was - h;
    up -= sv_fit_loss(&p, is, want);
    step -= (double)is[i];
    is[i] = was;
    assert_true(fabs(up / step - (double)grad[i]) < 1e-3 * (1.0 + fabs(up / step)));
  }
  for (int i = 16 * SV_ROW_LOGIT; i < 16 * N_ROWS; i++) assert_true(grad[i] == 0.0f);
}

// A trainer whose Gaussians move by polynomials: by position, far to one side and curved;
// half of them are of a body besides that turns.
static void start(const sv_pool *with) {
  moving_scene_settings c = moving_scene_cfg(SV_DEFORM_FIELD, N_GAUSS, N_STEPS);
  c.dynamic.n_pos = 3;
  c.dynamic.fit = 1.0f;
  assert_true(moving_scene_start(&scene, &trainer, &dynamic, &c, (sv_compute){&kernels, with},
                                 sv_arena_make(block, sizeof block)));
  sv_motion *mo = &dynamic.deform.motion;
  sv_deform_set_moving(&dynamic.deform, N_GAUSS);
  for (int i = 0; i < N_GAUSS; i++) {
    const float *x = sv_gaussians_at(&trainer.g, i, SV_ROW_MEAN);
    sv_motion_rest(mo, i);
    dynamic.is_moving[i] = 1;
    *sv_motion_row(mo, i, SV_MROW_FUNCTIONS) = 0.4f + 0.2f * x[16];
    *sv_motion_row(mo, i, SV_MROW_FUNCTIONS + 4) = 0.2f - 0.1f * x[0];
  }
  moving_scene_plant_body(&dynamic);
  for (int i = 0; i < N_GAUSS; i++) mo->bodies.of[i] = *sv_gaussians_at(&trainer.g, i, SV_ROW_MEAN) < -0.1f;
}

static void moved_places(float x[N_GAUSS][3]) {
  for (int i = 0; i < N_GAUSS; i++)
    for (int k = 0; k < 3; k++)
      x[i][k] =
          trainer.g.moved[((size_t)(i / 16) * (size_t)trainer.g.n_rows + (size_t)k) * 16 + (size_t)(i % 16)];
}

// Places of all at a time.
static void places(float time, float x[N_GAUSS][3]) {
  sv_train_set_time(&trainer, time);
  moved_places(x);
}

TEST(test_fit) {
  enum { N_TIMES = 9 }; // every other one has no picture
  static float before[N_TIMES][N_GAUSS][3], after[N_GAUSS][3], middle[N_GAUSS][3], local[N_GAUSS][3];
  double off = 0, far = 0;
  start(&pool);
  for (int n = 0; n < N_TIMES; n++) places(0.04f + 0.92f * (float)n / (N_TIMES - 1), before[n]);
  places(trainer.reference_time, middle);
  sv_motion_local_at(&dynamic.deform.motion, &trainer.compute, &trainer.g, trainer.reference_time);
  moved_places(local);
  sv_distil_begin(&dynamic);
  assert_int_equal(dynamic.deform.kind, SV_DEFORM_FIELD);
  assert_int_equal(dynamic.deform.field.n_moving, N_GAUSS);
  int n_calls = 0;
  for (; dynamic.fit_steps_left > 0; n_calls++) sv_distil_fit(&dynamic, dynamic.cfg.distil_at);
  assert_true(n_calls > 1); // a stop or a time limit is looked at between them
  for (int i = 0; i < N_GAUSS; i++)
    for (int k = 0; k < 3; k++) assert_true(*sv_gaussians_at(&trainer.g, i, k) == local[i][k]);
  for (int n = 0; n < N_TIMES; n++) {
    places(0.04f + 0.92f * (float)n / (N_TIMES - 1), after);
    for (int i = 0; i < N_GAUSS; i++)
      for (int k = 0; k < 3; k++) {
        const double e = (double)after[i][k] - (double)before[n][i][k];
        const double d = (double)before[n][i][k] - (double)middle[i][k];
        off += e * e;
        far += d * d;
      }
  }
  print_message("root mean square of motion %.3f, left over %.4f\n", sqrt(far / (N_TIMES * N_GAUSS)),
                sqrt(off / (N_TIMES * N_GAUSS)));
  assert_true(sqrt(off) < 0.03 * sqrt(far));
}

TEST(test_threads) {
  uint64_t digest[2];
  for (int n = 1; n <= 2; n++) {
    sv_linux_pool threads;
    sv_err err;
    assert_int_equal(sv_linux_pool_start(&threads, n, 0, &err), SV_OK);
    sv_pool with = sv_linux_pool_port(&threads);
    start(&with);
    dynamic.cfg.fit = 0.1f;
    for (int i = 0; i < 20; i++)
      assert_true(sv_train_step(&trainer, dynamic.cfg.distil_at + 0.01f * (float)i, NULL) >= 0);
    assert_int_equal(dynamic.deform.kind, SV_DEFORM_FIELD);
    digest[n - 1] = sv_train_digest(&trainer);
    sv_linux_pool_stop(&threads);
  }
  assert_true(digest[0] == digest[1]);
}

// After the hand-over the clip shows the same as before it, at times between those of the pictures.
TEST(test_lesson) {
  static float before[3][SV_TILE_PX * 8 * SV_TILE_PX * 8];
  start(&pool);
  const sv_train_view *tv = &trainer.views[0];
  sv_view view = tv->view;
  const sv_render_options o = sv_train_render_options(&trainer, 1.0f, false);
  view.time = sv_distil_time_between(&dynamic, view.time, 0.5f);
  assert_true(view.time != tv->view.time);
  for (int i = 0; i < trainer.n_views; i++) assert_true(view.time != trainer.views[i].view.time);
  assert_true(sv_distil_time(&dynamic, tv->view.time) == tv->view.time); // a clip needs none
  sv_train_set_time(&trainer, view.time);
  assert_true(sv_render(&trainer.render, &trainer.g, &view, &o) >= 0);
  const size_t n = (size_t)trainer.render.rgb.stride * (size_t)trainer.render.rgb.rows_padded;
  assert_true(n <= sizeof before[0] / sizeof before[0][0]);
  for (int c = 0; c < 3; c++) memcpy(before[c], trainer.render.rgb.c[c], n * sizeof(float));
  sv_distil_begin(&dynamic);
  while (dynamic.fit_steps_left > 0) sv_distil_fit(&dynamic, dynamic.cfg.distil_at);
  int n_lessons = 0;
  for (int i = 0; i < 400; i++) {
    const float time = sv_distil_time(&dynamic, tv->view.time);
    n_lessons += time != tv->view.time;
    for (int k = 0; k < trainer.n_views && time != tv->view.time; k++)
      assert_true(time != trainer.views[k].view.time);
  }
  assert_in_range(n_lessons, 60, 140); // a quarter
  assert_true(sv_distil_load_target(&dynamic, &view, &o) >= 0);
  for (int c = 0; c < 3; c++) assert_memory_equal(before[c], trainer.target.c[c], n * sizeof(float));
}

// A run of so many seconds: half of what is left at the hand-over, and pictures go on.
TEST(test_time_limit) {
  sv_step_stats st;
  start(&pool);
  const float clip = dynamic.cfg.distil_at, most = 0.5f + 0.5f * clip;
  assert_true(sv_train_step(&trainer, clip, &st) >= 0);
  assert_true(st.i_view == -1 && dynamic.fit_steps_left > 0);
  const uint32_t step = trainer.step;
  assert_true(sv_train_step(&trainer, most + 0.01f, &st) >= 0);
  assert_true(st.i_view == -1 && dynamic.fit_steps_left == 0 && trainer.step == step);
  assert_true(sv_train_step(&trainer, most + 0.02f, &st) >= 0);
  assert_true(st.i_view >= 0 && trainer.step == step + 1);
}

// Nothing moves: there is nothing to fit, and pictures go on.
TEST(test_still) {
  moving_scene_settings c = moving_scene_cfg(SV_DEFORM_FIELD, N_GAUSS, N_STEPS);
  assert_true(moving_scene_start(&scene, &trainer, &dynamic, &c, (sv_compute){&kernels, &pool},
                                 sv_arena_make(block, sizeof block)));
  for (int i = 0; i < 3; i++) assert_true(sv_train_step(&trainer, dynamic.cfg.distil_at, NULL) >= 0);
  assert_int_equal(dynamic.deform.kind, SV_DEFORM_FIELD);
  for (int i = 0; i < N_GAUSS; i++) assert_true(isfinite(*sv_gaussians_at(&trainer.g, i, SV_ROW_MEAN)));
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_loss),    cmocka_unit_test(test_fit),
                                     cmocka_unit_test(test_threads), cmocka_unit_test(test_time_limit),
                                     cmocka_unit_test(test_lesson),  cmocka_unit_test(test_still)};
  return cmocka_run_group_tests(tests, setup, NULL);
}
