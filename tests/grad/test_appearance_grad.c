// SPDX-License-Identifier: Apache-2.0
// Appearance: gradients of the rendered image and of all parameters against central differences,
// through sRGB and back; saturated targets; the start from surface points.
#include <math.h>
#include <string.h>

#include "src/base/rng.h"
#include "src/train/appearance_start.h"
#include "src/train/step.h"
#include "src/train/train.h"
#include "tests/common/test.h"

#define W      40
#define H      24
#define N_PX   (W * H)
#define SPREAD 0.002

static uint8_t block[24 << 20] __attribute__((aligned(64)));
static uint8_t pictures[4][N_PX * 3];
static sv_trainer t;
static sv_kernels k;
static sv_pool pool;
static sv_planes x, weights;

static void open_trainer(int n_views, int n_exposures, int n_gaussians) {
  sv_arena a = sv_arena_make(block, sizeof block);
  sv_err err = {0};
  sv_train_cfg cfg = sv_train_defaults();
  sv_kernels_init(&k, ~0u);
  pool = sv_pool_serial();
  cfg.n_gaussians = n_gaussians;
  cfg.cap_views = n_views;
  cfg.cap_width_px = cfg.cap_height_px = 64;
  cfg.appearance.n_cameras = 2;
  cfg.is_deep = true;
  cfg.appearance.n_exposures = n_exposures;
  assert_ok(sv_trainer_init(&t, &cfg, (sv_compute){&k, &pool}, &a, &err), &err);
  assert_ok(sv_planes_init(&x, W, H, &a), &err);
  assert_ok(sv_planes_init(&weights, W, H, &a), &err);
  for (int i = 0; i < n_views; i++) {
    sv_pose pose;
    const double eye[3] = {3, 0.9 * i - 1.3, i & 1 ? 0.9 : -0.5},
                 at[3] = {0, 0.3 * (i & 2) - 0.3, 0.2 * (i & 1)}, up[3] = {0, 0, 1};
    assert_true(sv_pose_look_at(&pose, eye, at, up));
    const sv_view v = sv_view_make(W, H, (const double[]){44, 44, 0.45 * W, 0.55 * H}, &pose);
    const sv_image_u8 image = {pictures[i], W, H, 3, 3 * W};
    assert_ok(sv_train_add_view(&t, &v, &image, &err), &err);
    sv_train_set_appearance(&t, i, i % 2, n_exposures ? i / 2 : -1);
  }
  sv_appearance_reset(&t.appearance, &t.cfg.appearance);
}

static void fill(sv_planes *p, sv_rng *rng, float from, float to) {
  for (int c = 0; c < 3; c++)
    for (int y = 0; y < H; y++)
      for (int i = 0; i < W; i++) p->c[c][y * p->stride + i] = from + (to - from) * sv_rng_f(rng);
}

// The weighted sum of what view i_view's camera shows.
static double value(int i_view) {
  const sv_planes *shown = sv_train_appear(&t, i_view, &t.views[i_view].view, &x);
  double sum = 0;
  for (int c = 0; c < 3; c++)
    for (int y = 0; y < H; y++)
      for (int i = 0; i < W; i++)
        sum += (double)weights.c[c][y * weights.stride + i] * (double)shown->c[c][y * shown->stride + i];
  return sum;
}

static void make_problem(sv_appearance_group *camera, sv_appearance_group *exposure) {
  static const double m[9] = {1.2, 0.1, -0.05, 0.02, 0.8, 0.03, -0.1, 0.07, 1.1};
  sv_rng rng = sv_rng_make(3, 3);
  fill(&x, &rng, 0.3f, 0.9f); // not where sRGB has its kink
  fill(&weights, &rng, -1, 1);
  sv_planes_set_size(&t.target, W, H);
  sv_planes_clear(&t.target); // nothing is saturated
  memcpy(camera->p, m, sizeof m);
  for (int i = 0; i < 3; i++) camera->p[9 + i] = 0.01 * (i - 1);
  for (int i = 0; i < 3; i++) camera->p[12 + i] = -0.1 - 0.05 * i;
  for (int i = 0; i < 9; i++) exposure->p[i] = (i % 4 == 0 ? 0.9 : 0.02) + 0.01 * i;
}

// The gradient of view 3 without a step: with rates of 0.
static void gradient(double sum[SV_APPEARANCE_SUMS]) {
  t.cfg.appearance.lr_camera = t.cfg.appearance.lr_offset = 0;
  t.cfg.appearance.lr_falloff = t.cfg.appearance.lr_exposure = 0;
  sv_planes_set_size(&t.grad, W, H);
  for (int c = 0; c < 3; c++) memcpy(t.grad.c[c], weights.c[c], (size_t)weights.stride * H * sizeof(float));
  sv_train_appear_bwd(&t, 3, &x, &t.views[3].view, 0.5f);
  memset(sum, 0, SV_APPEARANCE_SUMS * sizeof *sum);
  for (int y = 0; y < H; y++)
    for (int i = 0; i < SV_APPEARANCE_SUMS; i++)
      sum[i] += (double)t.appearance.row_sum[y * SV_APPEARANCE_SUMS + i];
}

TEST(test_gradients) {
  double sum[SV_APPEARANCE_SUMS];
  open_trainer(4, 2, 16);
  sv_appearance_group *camera = &t.appearance.camera[1], *exposure = &t.appearance.exposure[1];
  make_problem(camera, exposure);
  gradient(sum);
  for (int s = 0; s < 60; s++) { // of the image
    const int c = s % 3, at = (s * 7 % H) * x.stride + s * 11 % W;
    float *v = &x.c[c][at];
    const float was = *v;
    *v = was + (float)SPREAD;
    const double up = value(3);
    *v = was - (float)SPREAD;
    const double down = value(3);
    *v = was;
    assert_near((double)t.grad.c[c][at], (up - down) / (2 * SPREAD), 0.01);
  }
  // Of the falloff, and of the exposure and the camera, through what the kernel sums of their
  // product.
  for (int i = 0; i < 3; i++) {
    camera->p[12 + i] += SPREAD;
    const double up = value(3);
    camera->p[12 + i] -= 2 * SPREAD;
    assert_near(sum[12 + i], (up - value(3)) / (2 * SPREAD), 0.02 * (1 + fabs(sum[12 + i])));
    camera->p[12 + i] += SPREAD;
  }
  sv_appearance_group *groups[2] = {exposure, camera};
  double got[2][12];
  sv_appearance_share(sum, camera->p, exposure->p, got[1], got[0]);
  for (int g = 0; g < 2; g++)
    for (int i = 0; i < (g ? 12 : 9); i++) {
      groups[g]->p[i] += SPREAD;
      const double up = value(3);
      groups[g]->p[i] -= 2 * SPREAD;
      assert_near(got[g][i], (up - value(3)) / (2 * SPREAD), 0.02 * (1 + fabs(got[g][i])));
      groups[g]->p[i] += SPREAD;
    }
}

// A pixel of the target that is saturated takes no gradient where the camera would show more.
TEST(test_saturated) {
  double sum[SV_APPEARANCE_SUMS];
  open_trainer(4, 2, 16);
  make_problem(&t.appearance.camera[1], &t.appearance.exposure[1]);
  t.appearance.camera[1].p[0] = 2;
  for (int c = 0; c < 3; c++)
    for (int i = 0; i < H * t.target.stride; i++) t.target.c[c][i] = 1;
  const sv_planes *shown = sv_train_appear(&t, 3, &t.views[3].view, &x);
  int n = 0;
  for (int y = 0; y < H; y++)
    for (int i = 0; i < W; i++) {
      assert_true(shown->c[0][y * shown->stride + i] <= 1.0f);
      n += shown->c[0][y * shown->stride + i] == 1.0f;
    }
  assert_true(n > 20 && n < N_PX);
  gradient(sum);
  for (int y = 0; y < H; y++)
    for (int i = 0; i < W; i++)
      if (shown->c[0][y * shown->stride + i] == 1.0f && shown->c[1][y * shown->stride + i] == 1.0f &&
          shown->c[2][y * shown->stride + i] == 1.0f)
        assert_true(t.grad.c[0][y * t.grad.stride + i] == 0.0f);
}

// A deep view is shown by its noise curve, in units of its white, times its shutter time; with and
// without what is learned of its camera. A probe takes the gradient's way.
TEST(test_deep) {
  static uint16_t px[3 * N_PX];
  sv_image_deep deep = {
      .px = px, .width_px = W, .height_px = H, .exposure = 0.4f, .white = 0.5f, .read = 2e-5f, .shot = 4e-4f};
  const float black[3] = {0};
  for (int i = 0; i < 3 * N_PX; i++) px[i] = (uint16_t)(i * 7 % 30000);
  const sv_photometry calibrated = {.is_known = true,
                                    .color = {0.8, 0.05, 0, 0, 1.1, 0.1, 0.02, 0, 0.9},
                                    .falloff = {-0.3, -0.1, 0},
                                    .corner = 0.7};
  // neither, learned, calibrated
  for (int way = 0; way < 3; way++) {
    const bool learned = way == 1;
    deep.photometric = way == 2 ? &calibrated : NULL;
    double sum[SV_APPEARANCE_SUMS];
    sv_planes probe;
    open_trainer(4, 2, 16);
    make_problem(&t.appearance.camera[1], &t.appearance.exposure[1]);
    sv_train_set_deep(&t, 3, &deep);
    if (!learned) sv_train_set_appearance(&t, 3, -1, -1);
    sv_train_load_target(&t, 3, 1, black);
    const double read = 2e-5 / 0.25, shot = 4e-4 / 0.5, at = px[N_PX + 5 * W + 7] / 65535.0 / 0.5,
                 want = (sqrt(read + shot * at) - sqrt(read)) / (sqrt(read + shot) - sqrt(read));
    assert_near((double)t.target.c[1][5 * t.target.stride + 7], want, 1e-5);
    for (int c = 0; c < 3; c++) // nothing is saturated
      for (int i = 0; i < H * t.target.stride; i++) assert_true(t.target.c[c][i] < sv_deep_saturated(&deep));
    gradient(sum);
    for (int s = 0; s < 60; s++) {
      const int c = s % 3, p = (s * 7 % H) * x.stride + s * 11 % W;
      const float was = x.c[c][p];
      x.c[c][p] = was + (float)SPREAD;
      const double up = value(3);
      x.c[c][p] = was - (float)SPREAD;
      const double down = value(3);
      x.c[c][p] = was;
      assert_near((double)t.grad.c[c][p], (up - down) / (2 * SPREAD), 0.01);
    }
    if (way == 2) { // far from the center there is less light
      for (int c = 0; c < 3; c++)
        for (int p = 0; p < H * x.stride; p++) x.c[c][p] = 0.5f;
      const sv_planes *shown = sv_train_appear(&t, 3, &t.views[3].view, &x);
      assert_true(shown->c[1][0] < 0.9f * shown->c[1][H / 2 * shown->stride + W / 2]);
      gradient(sum);
    }
    probe = t.target;
    for (int c = 0; c < 3; c++) memcpy(probe.c[c], weights.c[c], (size_t)weights.stride * H * sizeof(float));
    sv_train_appear_probe(&t, 3, &x, &t.views[3].view, &probe);
    for (int c = 0; c < 3; c++)
      for (int y = 0; y < H; y++)
        assert_memory_equal(probe.c[c] + y * probe.stride, t.grad.c[c] + y * t.grad.stride,
                            W * sizeof(float));
  }
}

// What is saturated in the sensor's range takes no gradient from brighter renderings.
TEST(test_deep_saturated) {
  static uint16_t px[3 * N_PX];
  sv_image_deep deep = {
      .px = px, .width_px = W, .height_px = H, .exposure = 3, .white = 0.5f, .read = 2e-5f, .shot = 4e-4f};
  const float black[3] = {0};
  double sum[SV_APPEARANCE_SUMS];
  for (int i = 0; i < 3 * N_PX; i++) px[i] = i % W < W / 2 ? 65535 : 60000;
  open_trainer(4, 2, 16);
  make_problem(&t.appearance.camera[1], &t.appearance.exposure[1]);
  sv_train_set_appearance(&t, 3, -1, -1);
  sv_train_set_deep(&t, 3, &deep);
  for (int c = 0; c < 3; c++)
    for (int i = 0; i < H * x.stride; i++) x.c[c][i] = 0.95f; // 3 times as bright: above 1 / white
  sv_train_load_target(&t, 3, 1, black);
  gradient(sum);
  for (int i = 0; i < W; i++) assert_true((t.grad.c[0][5 * t.grad.stride + i] == 0) == (i < W / 2));
}

// The reference camera and exposure stay as they are, but for the falloff; the others move.
TEST(test_reference) {
  open_trainer(4, 2, 16);
  make_problem(&t.appearance.camera[1], &t.appearance.exposure[1]);
  for (int i = 0; i < 4; i++) {
    sv_planes_set_size(&t.grad, W, H);
    for (int c = 0; c < 3; c++) memcpy(t.grad.c[c], weights.c[c], (size_t)weights.stride * H * sizeof(float));
    sv_train_appear_bwd(&t, i, &x, &t.views[i].view, 0.0f);
  }
  for (int i = 0; i < 12; i++) {
    const double identity = i < 9 && i % 4 == 0;
    assert_true(t.appearance.camera[0].p[i] == identity);
    if (i < 9) assert_true(t.appearance.exposure[0].p[i] == identity);
  }
  assert_true(t.appearance.camera[0].p[12] != 0 && t.appearance.camera[1].n_steps == 2);
}

// --- the start
// -------------------------------------------------------------------------------------

static double display_of(double light) {
  return light <= 0.0031308 ? 12.92 * light : 1.055 * pow(light, 1 / 2.4) - 0.055;
}

static const double drift[2] = {1, 0.8}, falloff[2] = {-0.3, -0.2};

// Light that pixel p of view v shows of a textured plane, x = 0: even views are camera 0's, odd
// ones have the color matrix m; the last two have less exposure.
static void plane_light(int v, int p, const double m[9], double out[3]) {
  const sv_view *view = &t.views[v].view;
  const double du = (p % W) + 0.5 - (double)view->cx, dv = (p / W) + 0.5 - (double)view->cy;
  const double far_x = fmax((double)view->cx, W - (double)view->cx),
               far_y = fmax((double)view->cy, H - (double)view->cy);
  const double d[3] = {du / (double)view->fx, dv / (double)view->fy, 1};
  double o[3] = {0}, dir[3] = {0}, light[3];
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++) {
      o[i] -= (double)view->r[3 * j + i] * (double)view->t[j];
      dir[i] += (double)view->r[3 * j + i] * d[j];
    }
  const double s = -o[0] / dir[0], yw = o[1] + s * dir[1], zw = o[2] + s * dir[2];
  for (int c = 0; c < 3; c++) light[c] = 0.35 + 0.1 * sin(3 * yw + c) * cos(2 * zw);
  for (int c = 0; c < 3; c++) {
    const double mixed = m[3 * c] * light[0] + m[3 * c + 1] * light[1] + m[3 * c + 2] * light[2];
    out[c] = (v % 2 ? mixed : light[c]) * drift[v / 2] *
             (1 + falloff[v % 2] * (du * du + dv * dv) / (far_x * far_x + far_y * far_y));
  }
}

// The plane seen by four views; Gaussians on it. What the cameras do to its light is found.
static void start_on_plane(const double m[9]) {
  static uint8_t memory[8 << 20] __attribute__((aligned(64)));
  sv_arena scratch = sv_arena_make(memory, sizeof memory);
  int n_points;
  open_trainer(4, 2, 3600);
  for (int v = 0; v < 4; v++)
    for (int p = 0; p < N_PX; p++) {
      double light[3];
      plane_light(v, p, m, light);
      for (int c = 0; c < 3; c++) pictures[v][3 * p + c] = (uint8_t)(255 * display_of(light[c]) + 0.5);
    }
  for (int i = 0; i < 3600; i++) {
    const sv_gaussian g = {.mean = {0, (float)(i % 60) / 30 - 1, (float)(i / 60) / 30 - 1},
                           .quat_wxyz = {1},
                           .log_scale = {-6, -3.6f, -3.6f},
                           .opacity_logit = 3};
    sv_gaussians_put(&t.g, i, &g);
  }
  sv_train_set_scene(&t, (const float[]){0, 0, 0}, 1.5f);
  assert_int_equal(sv_appearance_start(&t, &scratch, &n_points), SV_OK);
  print_message("%d points\n", n_points);
  assert_true(n_points > 300);
  for (int c = 0; c < 3; c++) assert_near(t.appearance.exposure[1].p[4 * c], drift[1], 0.02);
  for (int i = 0; i < 2; i++) {
    const double *f = t.appearance.camera[i].p + 12;
    assert_near(f[0] + f[1] + f[2], falloff[i], 0.03);
    assert_near(f[0] / 2 + f[1] / 4 + f[2] / 8, falloff[i] / 2, 0.03);
  }
}

TEST(test_start) {
  static const double gains[9] = {1.3, 0, 0, 0, 0.9, 0, 0, 0, 0.7};
  start_on_plane(gains);
  const sv_photometry *found = &t.appearance.measured[1];
  assert_true(found->is_known);
  for (int i = 0; i < 9; i++) { // no mixing is found where there is none
    assert_near(t.appearance.camera[1].p[i], gains[i], i % 4 ? 0 : 0.01);
    assert_near(found->color[i], t.appearance.camera[1].p[i], 0);
  }
  for (int c = 0; c < 3; c++) assert_true(found->color_sigma[c] > 0 && found->color_sigma[c] < 0.02);
  assert_true(found->falloff_sigma > 0 && found->falloff_sigma < 0.05);
  assert_true(found->mix_sigma > 0 && found->mix_sigma < 0.05);
}

TEST(test_start_mixed) {
  static const double mixed[9] = {1.1, 0.2, 0.1, 0.05, 0.8, 0.1, -0.1, 0.15, 0.7};
  start_on_plane(mixed);
  for (int i = 0; i < 9; i++) assert_near(t.appearance.camera[1].p[i], mixed[i], 0.02);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_gradients),  cmocka_unit_test(test_saturated),
                                     cmocka_unit_test(test_deep),       cmocka_unit_test(test_deep_saturated),
                                     cmocka_unit_test(test_reference),  cmocka_unit_test(test_start),
                                     cmocka_unit_test(test_start_mixed)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
