// SPDX-License-Identifier: Apache-2.0
// A user who follows the hints: the scene is covered with few more exposures than in the best
// order, and the model is better than from the same number of exposures taken in a row.
#include <math.h>
#include <string.h>

#include "src/base/mathx.h"
#include "src/base/rng.h"
#include "src/capture/guidance.h"
#include "src/metric/metric.h"
#include "tests/common/test.h"
#include "tests/common/world.h"

#define SPEC       "textured,rig=stereo,size=96x72,exposures=%d"
#define DEG        (SV_PI / 180)
#define CAP_PLACES 120
#define STEP_DEG   6.0 // that the user moves between two looks at the hint
#define N_LOOKS    4000
#define N_HELDOUT  16

static world w;
static sv_guidance g;
static sv_pose place[CAP_PLACES];
static int n_places;
static sv_status (*plain_dequeue)(void *self, sv_frame *f, sv_ns until_ns);

// --- places around the scene ---------------------------------------------------------------------

typedef struct {
  double azimuth_deg, elevation_deg, distance_m;
  double aim_m[3];
} stand;

static sv_pose pose_of(const stand *s) {
  const double az = s->azimuth_deg * DEG, el = s->elevation_deg * DEG, c = sv_cos(el) * s->distance_m;
  const double turned = az - 2 * SV_PI * floor(az / (2 * SV_PI));
  const double eye[3] = {c * sv_cos(turned), c * sv_sin(turned), sv_sin(el) * s->distance_m},
               up[3] = {0, 0, 1};
  sv_pose p;
  assert_true(sv_pose_look_at(&p, eye, s->aim_m, up));
  return p;
}

static sv_guidance_cfg guidance_cfg(void) {
  double centre[3], radius;
  sv_sim_scene_bounds(&w.sim, centre, &radius);
  return (sv_guidance_cfg){.rig = sv_sim_rig(&w.sim),
                           .bounds = {{(float)centre[0], (float)centre[1], (float)centre[2]}, (float)radius},
                           .up = {0, 0, 1},
                           .middle = {1, 0, 0}};
}

static sv_guidance_shot shot_at(const sv_pose *p) { return (sv_guidance_shot){p, 1, 0.4, 0}; }

// --- the user ------------------------------------------------------------------------------------

static double noise(sv_rng *rng) { return 2 * (double)sv_rng_f(rng) - 1; }

static void move(stand *s, sv_hint hint, sv_rng *rng) {
  const double far = STEP_DEG / sv_cos(s->elevation_deg * DEG);
  s->azimuth_deg += noise(rng) + (hint == SV_HINT_RIGHT ? far : hint == SV_HINT_LEFT ? -far : 0);
  s->elevation_deg += noise(rng) + (hint == SV_HINT_UP ? STEP_DEG : hint == SV_HINT_DOWN ? -STEP_DEG : 0);
  s->elevation_deg = sv_maxd(3, sv_mind(60, s->elevation_deg));
  s->distance_m *= hint == SV_HINT_CLOSER ? 0.92 : hint == SV_HINT_BACK ? 1.08 : 1 + 0.01 * noise(rng);
  for (int k = 0; k < 3; k++) s->aim_m[k] = hint == SV_HINT_AIM ? 0 : s->aim_m[k] + 0.02 * noise(rng);
}

// Exposures until the guidance says that it is enough; the hints are followed, not precisely.
static int follow(uint64_t seed) {
  sv_rng rng = sv_rng_make(seed, 1);
  stand s = {20, 25, 4.4, {0.1, -0.1, 0}};
  const sv_guidance_cfg cfg = guidance_cfg();
  n_places = 0;
  sv_guidance_init(&g, &cfg);
  for (int i = 0; i < N_LOOKS && n_places < CAP_PLACES; i++) {
    const sv_pose p = pose_of(&s);
    const sv_guidance_shot shot = shot_at(&p);
    sv_guidance_look(&g, &shot);
    if (g.hint == SV_HINT_ENOUGH) break;
    if (g.hint == SV_HINT_TAKE) {
      sv_guidance_keep(&g, &shot);
      place[n_places++] = p;
    } else {
      assert_in_range(g.hint, SV_HINT_RIGHT, SV_HINT_AIM);
    }
    move(&s, g.hint, &rng);
  }
  return n_places;
}

// Each exposure where it adds most, among places all over the dome at the best distance.
static int best_order(double coverage) {
  const sv_guidance_cfg cfg = guidance_cfg();
  int n = 0;
  sv_guidance_init(&g, &cfg);
  while (sv_guidance_coverage(&g) < coverage && n < CAP_PLACES) {
    double best = -1;
    sv_pose best_pose = sv_pose_identity();
    for (double el = 5; el <= 55; el += 5)
      for (double az = 0; az < 360; az += 5) {
        const sv_pose p = pose_of(&(stand){az, el, 4, {0}});
        const double gain = sv_guidance_gain(&g, &p);
        if (gain <= best) continue;
        best = gain;
        best_pose = p;
      }
    const sv_guidance_shot shot = shot_at(&best_pose);
    sv_guidance_keep(&g, &shot);
    n++;
  }
  return n;
}

// --- the runtime, from the user's places ---------------------------------------------------------

static sv_status from_place(void *self, sv_frame *f, sv_ns until_ns) {
  const sv_status s = plain_dequeue(self, f, until_ns);
  if (s != SV_OK || f->sequence >= (uint32_t)n_places) return s;
  const sv_sub_view *v = &sv_sim_rig(&w.sim)->sub_views[f->i_camera];
  const sv_pose cam = sv_pose_mul(&v->cam_from_rig, &place[f->sequence]);
  const sv_view view = sv_view_make(v->model.width_px, v->model.height_px, v->model.p, &cam);
  sv_sim_render(&w.sim, &view, 0, (uint8_t *)(uintptr_t)f->data, NULL);
  return s;
}

static sv_status pose_then(void *self, sv_ns time_ns, sv_pose *rig_from_world) {
  const sv_sim *sim = self;
  const int64_t slot = (time_ns - SV_SIM_EPOCH_NS) / sim->period_ns;
  assert_in_range(slot, 0, n_places - 1);
  *rig_from_world = place[slot];
  return SV_OK;
}

static double heldout_psnr(void) {
  static uint8_t rgb[96 * 72 * 3];
  double psnr = 0;
  for (int i = 0; i < N_HELDOUT; i++) {
    const double u = i * 0.618 - floor(i * 0.618);
    const sv_pose p = pose_of(&(stand){360 * u, 10 + 40.0 * i / (N_HELDOUT - 1), 4, {0}});
    const sv_sub_view *v = &sv_sim_rig(&w.sim)->sub_views[0];
    const sv_pose cam = sv_pose_mul(&v->cam_from_rig, &p);
    const sv_view view = sv_view_make(v->model.width_px, v->model.height_px, v->model.p, &cam);
    double mse;
    sv_sim_render(&w.sim, &view, 0, rgb, NULL);
    assert_int_equal(sv_driver_mse(&w.app.trainer, &view, rgb, &mse), SV_OK);
    psnr += sv_psnr_of_mse(mse) / N_HELDOUT;
  }
  return psnr;
}

static void open_world(int n) {
  char spec[128];
  sv_fmt(spec, sizeof spec, SPEC, n);
  world_open_well(&w, spec, n, ~0u, 2);
}

static double train_on_places(void) {
  open_world(n_places);
  w.cfg.train.n_gaussians = 3000;
  w.cfg.steps = 600;
  plain_dequeue = w.inner.source.dequeue;
  w.inner.source.dequeue = from_place;
  w.inner.source.rig_pose = pose_then;
  world_run_well(&w);
  const double psnr = heldout_psnr();
  world_close(&w);
  return psnr;
}

TEST(test_few_more_than_in_the_best_order) {
  open_world(4);
  for (uint64_t seed = 1; seed <= 4; seed++) {
    const int n = follow(seed);
    const double coverage = sv_guidance_coverage(&g);
    const int n_best = best_order(0.95);
    print_message("seed %d: %d exposures, coverage %.3f; best order %d\n", (int)seed, n, coverage, n_best);
    assert_true(coverage >= 0.95);
    assert_true(n <= 1.3 * n_best);
  }
  world_close(&w);
}

TEST(test_a_better_model_than_in_a_row) {
  open_world(4);
  const int n = follow(1);
  world_close(&w);
  const double guided = train_on_places();
  // The same user without hints: once along the scene.
  for (int i = 0; i < n; i++) place[i] = pose_of(&(stand){20 + i * STEP_DEG, 25, 4.2, {0}});
  const double in_a_row = train_on_places();
  print_message("%d exposures: held-out PSNR %.2f dB with hints, %.2f dB in a row\n", n, guided, in_a_row);
  assert_true(guided >= in_a_row + 1);
}

TEST(test_points_weigh_regions) {
  open_world(4);
  const sv_guidance_cfg cfg = guidance_cfg();
  sv_guidance_init(&g, &cfg);
  sv_point points[90];
  const float edge = 2 * cfg.bounds.radius / sqrtf(3) / SV_GUIDANCE_SIDE;
  for (int i = 0; i < 90; i++) // in the middle, and outside of the ball
    points[i] = (sv_point){.mean = {cfg.bounds.centre[0] + (i % 2 ? 0.3f * edge : 5 * cfg.bounds.radius),
                                    cfg.bounds.centre[1], cfg.bounds.centre[2]}};
  sv_guidance_set_scene(&g, NULL, points, 90);
  double sum = 0;
  for (int r = 0; r < SV_GUIDANCE_REGIONS; r++) sum += (double)g.region_weight[r];
  assert_near(sum, 1, 1e-5);
  assert_true(g.has_points && g.region_weight[SV_GUIDANCE_REGIONS / 2] > 0.7f);
  const sv_pose p = pose_of(&(stand){0, 30, 4, {0}});
  const sv_guidance_shot shot = shot_at(&p);
  sv_guidance_keep(&g, &shot);
  assert_true(sv_guidance_region(&g, SV_GUIDANCE_REGIONS / 2) > 0.01);
  world_close(&w);
}

TEST(test_bad_images) {
  open_world(4);
  const sv_guidance_cfg cfg = guidance_cfg();
  const sv_pose p = pose_of(&(stand){0, 30, 4, {0}}), far = pose_of(&(stand){0, 30, 40, {0}});
  const struct {
    sv_guidance_shot shot;
    sv_hint hint;
  } cases[] = {{{&p, 0.2, 0.4, 0}, SV_HINT_STILL},
               {{&p, 1, 0.01, 0}, SV_HINT_DARK},
               {{&p, 1, 0.7, 0.4}, SV_HINT_BRIGHT},
               {{&far, 1, 0.4, 0}, SV_HINT_CLOSER},
               {{NULL, 1, 0.4, 0}, SV_HINT_NONE}};
  for (int i = 0; i < 5; i++) {
    sv_guidance_init(&g, &cfg);
    sv_guidance_look(&g, &cases[i].shot);
    assert_int_equal(g.hint, cases[i].hint);
    sv_guidance_keep(&g, &cases[i].shot);
    assert_int_equal(g.n_good, i >= 3);
  }
  world_close(&w);
}

// In a hand: odometry places each exposure as it comes, and its points say where the scene is.
TEST(test_unknown_poses) {
  world_open_well(&w, "textured,rig=stereo,path=handheld,arc=60,poses=unknown,size=320x240,exposures=30", 8,
                  ~0u, 2);
  w.cfg.is_tracking = true;
  w.cfg.train.n_gaussians = 500;
  w.cfg.steps = 10;
  world_run_well(&w);
  const sv_guidance *found = &w.app.capture.guidance;
  print_message("handheld: %d places, coverage %.2f\n", found->n_places, sv_guidance_coverage(found));
  assert_true(w.app.odometry.is_tracked && found->has_points);
  assert_in_range(found->n_places, 6, 8);
  assert_true(sv_guidance_coverage(found) > 0.05 && sv_guidance_coverage(found) < 0.6);
  assert_true(world_has_line(&w, "of the directions around the scene"));
  world_close(&w);
}

// A recording of a rig in a hand, whose source does not tell where it is; also on pictures that
// odometry looks at in half their size.
static double coverage_of_capture(const char *more) {
  assert_int_equal(shell_run("rm -rf %s && $SV_EMULATE $SV_BIN/subview capture --quiet --json --arc 120 "
                             "--exposures 12 --source "
                             "sim:textured,rig=stereo,path=handheld,arc=60,exposures=12%s --out %s",
                             temp_path("capture"), more, temp_path("capture")),
                   0);
  return shell_number("\"coverage\":");
}

TEST(test_capture_without_poses) {
  const double known = coverage_of_capture(",size=320x240"),
               found = coverage_of_capture(",size=320x240,poses=unknown"),
               large = coverage_of_capture(",size=800x600,poses=unknown");
  print_message("captured: coverage %.3f by the source's poses and ball, %.3f and %.3f by odometry\n", known,
                found, large);
  assert_true(found > 0.5 * known - 0.1 && found < known + 0.1); // measured: 0.61, 0.31, 0.30
  assert_true(fabs(large - found) < 0.1);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_few_more_than_in_the_best_order),
                                     cmocka_unit_test(test_a_better_model_than_in_a_row),
                                     cmocka_unit_test(test_points_weigh_regions),
                                     cmocka_unit_test(test_bad_images),
                                     cmocka_unit_test(test_unknown_poses),
                                     cmocka_unit_test(test_capture_without_poses)};
  return cmocka_run_group_tests(tests, temp_folder_setup, temp_folder_teardown);
}
