// SPDX-License-Identifier: Apache-2.0
// Runs of fisheye rigs: all pixels are trained on, the depth start and odometry work through the
// lens, and digests are those of any instruction set and number of threads.
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "src/base/mathx.h"
#include "src/metric/metric.h"
#include "src/train/relocate.h"
#include "src/train/stereo.h"
#include "tests/common/test.h"
#include "tests/common/world.h"

#define HALL "hall,rig=stereo,size=160x120"

static world w;

// --- splined lenses ------------------------------------------------------------------------------

#define N_KNOTS    24
#define U_PER_KNOT 0.22

// A lens's shift at a place of the stereographic plane; beyond the lens's range as at its end.
static double shift_of(const sv_camera_model *m, const double u[2], int axis) {
  const double r = sqrt(u[0] * u[0] + u[1] * u[1]), inner = r > 0 ? sv_mind(r, 2.3) / r : 1;
  const double at[2] = {inner * u[0], inner * u[1]}, s = 0.25 * (at[0] * at[0] + at[1] * at[1]),
               x[3] = {at[0], at[1], 1 - s};
  double uv[2];
  assert_true(sv_model_project(m, x, uv, NULL, NULL));
  return (uv[axis] - m->p[2 + axis]) / m->p[axis] - at[axis];
}

// The same lens as a spline through it (quasi-interpolation).
static sv_camera_model splined(const sv_camera_model *m) {
  static double control[N_KNOTS * N_KNOTS * 2];
  for (int i = 0; i < N_KNOTS * N_KNOTS; i++)
    for (int axis = 0; axis < 2; axis++) {
      const double x = (i % N_KNOTS - 0.5 * (N_KNOTS - 1)) * U_PER_KNOT,
                   y = (i / N_KNOTS - 0.5 * (N_KNOTS - 1)) * U_PER_KNOT, h = U_PER_KNOT;
      const double around[4][2] = {{x - h, y}, {x + h, y}, {x, y - h}, {x, y + h}};
      double sum = 10 * shift_of(m, (const double[2]){x, y}, axis);
      for (int k = 0; k < 4; k++) sum -= shift_of(m, around[k], axis);
      control[2 * i + axis] = sum / 6;
    }
  sv_camera_model out = *m;
  out.kind = SV_MODEL_SPLINED;
  for (int k = 4; k < SV_CAP_MODEL_PARAMS; k++) out.p[k] = 0;
  out.spline = (sv_lens_spline){3, N_KNOTS, N_KNOTS,
                                720 / SV_PI * sv_atan2(0.25 * (N_KNOTS - 3) * U_PER_KNOT, 1), control};
  return out;
}

static void run(const char *spec, uint32_t isas, int n_threads, int n_steps) {
  world_open_well(&w, spec, 6, isas, n_threads);
  w.cfg.train.n_gaussians = 4000;
  w.cfg.steps = n_steps;
  world_run_well(&w);
}

TEST(test_all_pixels) {
  static uint8_t rgb[160 * 120 * 3];
  run(HALL ",exposures=6,lens=kb4:185", ~0u, 2, 400);
  sv_image_u8 im;
  sv_view v;
  double time_s;
  sv_exposures_get(&w.app.exposures, 0, 0, &im, &v);
  assert_true(v.fisheye && !im.mask && v.width_px == 160 && v.height_px == 120);
  sv_sim_view(&w.sim, 0, 0, &v, &time_s);
  sv_sim_render(&w.sim, &v, time_s, rgb, NULL);
  assert_memory_equal(rgb, im.px, sizeof rgb); // as the camera gave it
  const double heldout = world_heldout_psnr(&w, 4), trained = world_training_psnr(&w);
  printf("  185 degrees: held-out %.2f dB, training views %.2f dB\n", heldout, trained);
  assert_true(heldout > 31 && trained > 32);
}

// A rig whose fisheyes are known as splines: trained on with all of their field, and as good.
TEST(test_splined) {
  static sv_sub_view sub[2];
  double heldout[2];
  for (int is_splined = 0; is_splined < 2; is_splined++) {
    world_open_well(&w, HALL ",exposures=6,lens=kb4:185", 6, ~0u, 2);
    sv_rig rig = *w.cfg.rig;
    memcpy(sub, rig.sub_views, sizeof sub);
    for (int i = 0; i < 2 && is_splined; i++) sub[i].model = splined(&sub[i].model);
    rig.sub_views = sub;
    w.cfg.rig = &rig;
    w.cfg.train.n_gaussians = 4000;
    w.cfg.steps = 200;
    world_run_well(&w);
    sv_image_u8 im;
    sv_view v;
    int n_lit = 0;
    sv_exposures_get(&w.app.exposures, 0, 0, &im, &v);
    for (int i = 0; i < 160 * 120; i++) n_lit += !im.mask || im.mask[i];
    assert_true(v.fisheye && n_lit > 0.97 * 160 * 120);
    heldout[is_splined] = world_heldout_psnr(&w, 4);
  }
  printf("  held-out %.2f dB as KB4, %.2f dB as splines\n", heldout[0], heldout[1]);
  assert_true(heldout[1] > heldout[0] - 0.7); // seeds: -0.47, -0.16, +0.22 dB
}

// Points of the depth start lie on surfaces, in all of the field.
TEST(test_depth_start) {
  static uint8_t block[24 << 20] __attribute__((aligned(64)));
  static sv_point point[4000];
  static float depth[160 * 120];
  run(HALL ",exposures=6,lens=kb4:185", ~0u, 2, 1);
  sv_arena scratch = sv_arena_make(block, sizeof block);
  const sv_bounds b = {{0, 0, 0}, 6};
  sv_stereo_cloud cloud = {.point = point, .cap = 4000};
  assert_int_equal(sv_stereo_points(&w.app.trainer, &b, &scratch, &cloud), SV_OK);
  int n_seen = 0, n_good = 0, n_wide = 0;
  const sv_view *v = &w.app.trainer.views[0].view;
  sv_sim_render(&w.sim, v, sv_sim_slot_time_s(&w.sim, 0), NULL, depth);
  for (int i = 0; i < cloud.n; i++) {
    float x[3], uv[2], d;
    for (int r = 0; r < 3; r++)
      x[r] = v->r[3 * r] * point[i].mean[0] + v->r[3 * r + 1] * point[i].mean[1] +
             v->r[3 * r + 2] * point[i].mean[2] + v->t[r];
    if (!sv_view_project(v, x, uv, &d) || !(uv[0] >= 0 && uv[1] >= 0 && uv[0] < 160 && uv[1] < 120)) continue;
    const float there = depth[(int)uv[1] * 160 + (int)uv[0]];
    if (!(d < 1.05f * there)) continue; // hidden from here
    n_seen++;
    n_good += d > 0.95f * there;
    n_wide += d > 0.95f * there && x[2] < 0.5f * d; // more than 60 degrees off the axis
  }
  printf("  %d points, %d in view 0 of which %d lie within 5 %% of a surface, %d beyond 60 degrees\n",
         cloud.n, n_seen, n_good, n_wide);
  assert_true(n_seen > 500 && n_good > 0.7 * n_seen && n_wide > 50);
}

TEST(test_digests) {
  const uint32_t all = sv_cpu_isas() & ~SV_ISA_BIT(SV_ISA_SSE41);
  run(HALL ",exposures=6,lens=kb4:120", sv_isa_only(SV_ISA_REF), 1, 40);
  const uint64_t first = world_digest(&w);
  run(HALL ",exposures=6,lens=kb4:120", all, 2, 40);
  assert_true(world_digest(&w) == first);
}

TEST(test_too_wide) {
  run(HALL ",exposures=6,lens=kb4:185", ~0u, 2, 1);
  sv_trainer *t = &w.app.trainer;
  float *p = sv_gaussians_at(&t->g, 7, 0), eye[3];
  sv_view_centre(eye, &t->views[0].view);
  for (int k = 0; k < 3; k++) p[16 * k] = 0.9f * eye[k]; // 0.4 m before the camera
  for (int k = 0; k < 3; k++) p[16 * (SV_ROW_SCALE + k)] = (float)sv_log(0.3);
  p[16 * SV_ROW_LOGIT] = 2;
  const sv_render_options o = sv_train_render_options(t, 1.0f, false);
  assert_int_equal(sv_render(&t->render, &t->g, &t->views[0].view, &o), SV_OK);
  assert_int_equal(t->render.splat[7].n_intersections, 0);
  const float at = p[0];
  assert_true(sv_train_relocate(t, 0.5f) >= 1);
  assert_true(p[0] != at && p[16 * SV_ROW_LOGIT] < 2);
  // One that is small is drawn.
  for (int k = 0; k < 3; k++) p[16 * k] = 0.9f * eye[k];
  for (int k = 0; k < 3; k++) p[16 * (SV_ROW_SCALE + k)] = (float)sv_log(0.03);
  p[16 * SV_ROW_LOGIT] = 2;
  assert_int_equal(sv_render(&t->render, &t->g, &t->views[0].view, &o), SV_OK);
  assert_true(t->render.splat[7].n_intersections > 0);
}

TEST(test_odometry) {
  world_open_well(&w,
                  "hall,rig=stereo,size=320x240,lens=kb4:120,path=handheld,arc=60,poses=unknown,exposures=10",
                  10, ~0u, 2);
  w.cfg.is_tracking = true;
  w.cfg.train.n_gaussians = 2000;
  w.cfg.steps = 10;
  world_run_well(&w);
  const sv_track_summary *s = &w.app.odometry.summary;
  printf("  odometry: %d of %d exposures, %d points, %.2f px\n", s->n_placed, s->n_exposures, s->n_points,
         s->rms_px);
  assert_int_equal(s->n_placed, 10);
  assert_true(s->rms_px < 1);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_all_pixels), cmocka_unit_test(test_depth_start),
                                     cmocka_unit_test(test_splined),    cmocka_unit_test(test_digests),
                                     cmocka_unit_test(test_too_wide),   cmocka_unit_test(test_odometry)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
