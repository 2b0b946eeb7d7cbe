// SPDX-License-Identifier: Apache-2.0
// Depth maps of the simulator's scene against its true depth, from rigs of two alike cameras, of
// three focal lengths and of sixteen small ones; and what gives none.
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "platform/linux/linux.h"
#include "src/train/stereo.h"
#include "tests/common/test.h"
#include "tests/common/world.h"

static world w;
static uint8_t scratch_block[24 << 20] __attribute__((aligned(64)));
static sv_point point[20000];

// An app that has captured its exposures and taken no step: the trainer has its views.
static void open_views(const char *spec, int n_exposures, int n_threads) {
  world_open_well(&w, spec, n_exposures, ~0u, n_threads);
  w.cfg.train.n_gaussians = 4000;
  w.cfg.steps = 1;
  world_run_well(&w);
}

static sv_arena scratch_of(size_t less) {
  size_t bytes = sv_sweep_bytes(&w.app.trainer.cfg);
  assert_true(bytes > 0 && bytes <= sizeof scratch_block);
  return sv_arena_make(scratch_block, bytes - less);
}

enum { CAP_PX = 160 * 160 };
static float truth[16][CAP_PX];

static void render_truth(void) {
  assert_in_range(world_stats(&w).n_views, 1, 16);
  for (int i = 0; i < world_stats(&w).n_views; i++) {
    const sv_view *v = &w.app.trainer.views[i].view;
    assert_true(v->width_px * v->height_px <= CAP_PX);
    sv_sim_render(&w.sim, v, 0, NULL, truth[i]);
  }
}

// Relative distance from the surface along the ray, in the view where it is least; 1: on none.
static double error_of(const sv_point *p) {
  double least = 1;
  for (int i = 0; i < world_stats(&w).n_views; i++) {
    const sv_view *v = &w.app.trainer.views[i].view;
    float x[3];
    for (int r = 0; r < 3; r++)
      x[r] = v->r[3 * r] * p->mean[0] + v->r[3 * r + 1] * p->mean[1] + v->r[3 * r + 2] * p->mean[2] + v->t[r];
    float u = v->fx * x[0] / x[2] + v->cx, y = v->fy * x[1] / x[2] + v->cy;
    if (!(x[2] > 0 && u >= 0 && y >= 0 && u < (float)v->width_px && y < (float)v->height_px)) continue;
    double d = (double)truth[i][(int)y * v->width_px + (int)u];
    if (d > 0) least = fmin(least, fabs(d - (double)x[2]) / d);
  }
  return least;
}

typedef struct {
  int n_maps, n;
  double median, wrong; // relative error of the depth, share of the points that are off by more
                        // than 3 %
  uint64_t digest;
} outcome;

static int compare(const void *a, const void *b) {
  double x = *(const double *)a, y = *(const double *)b;
  return (x > y) - (x < y);
}

static outcome measure(int n) {
  static double error[20000];
  outcome o = {.digest = 14695981039346656037ull};
  sv_arena a = scratch_of(0);
  sv_stereo_cloud cloud = {.point = point, .cap = n};
  assert_int_equal(sv_stereo_points(&w.app.trainer, &w.cfg.bounds, &a, &cloud), SV_OK);
  o.n = cloud.n;
  o.n_maps = cloud.n_maps;
  assert_int_equal(a.used_bytes, 0);
  assert_true(a.high_bytes <= a.cap_bytes);
  render_truth();
  for (int i = 0; i < o.n; i++) {
    error[i] = error_of(&point[i]);
    o.wrong += error[i] < 0.03 ? 0 : 1.0 / o.n;
    for (int k = 0; k < 6; k++) {
      uint32_t bits;
      memcpy(&bits, k < 3 ? &point[i].mean[k] : &point[i].rgb[k - 3], 4);
      o.digest = (o.digest ^ bits) * 1099511628211ull;
      if (k >= 3) assert_true(point[i].rgb[k - 3] >= 0 && point[i].rgb[k - 3] <= 1);
    }
  }
  qsort(error, (size_t)o.n, sizeof *error, compare);
  o.median = error[o.n / 2];
  return o;
}

TEST(test_rigs) {
  static const struct {
    const char *spec;
    int n_maps, least; // points
    double median, wrong;
  } cases[] = {{"textured,rig=stereo,size=160x120", 2, 2000, 0.01, 0.2},
               {"textured,rig=phone,size=160x120", 3, 1000, 0.02, 0.35},
               {"textured,rig=lightfield,size=400x400", 16, 4000, 0.01, 0.3},
               {"textured,rig=stereo,size=160x120,noise=read:1e-4:shot:1e-3", 2, 1500, 0.01, 0.2}};
  for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
    open_views(cases[i].spec, 1, 2);
    outcome o = measure(20000);
    print_message("%s: %d points, median error %.2f %%, %.1f %% off the surface\n", cases[i].spec, o.n,
                  100 * o.median, 100 * o.wrong);
    assert_int_equal(o.n_maps, cases[i].n_maps);
    assert_true(o.n >= cases[i].least && o.median < cases[i].median && o.wrong < cases[i].wrong);
    outcome few = measure(500); // evenly over all of them
    assert_int_equal(few.n, 500);
    assert_true(few.median < 1.5 * cases[i].median && few.wrong < cases[i].wrong + 0.05);
    world_close(&w);
  }
}

// The same bits for any number of threads; the digest of a whole run says so for every machine.
TEST(test_threads) {
  uint64_t digest = 0;
  for (int n = 1; n <= 4; n *= 2) {
    open_views("textured,rig=stereo,size=100x76", 2, n);
    outcome o = measure(20000);
    if (n > 1) assert_true(o.digest == digest);
    digest = o.digest;
    world_close(&w);
  }
}

static double distance(const sv_point *p) {
  return sqrt((double)p->mean[0] * p->mean[0] + (double)p->mean[1] * p->mean[1] +
              (double)p->mean[2] * p->mean[2]);
}

// A scene that does not end: its far side is measured, too, and what was not measured lies on
// shells behind. One that ends has no such points.
TEST(test_far_field) {
  int n_far = 0;
  open_views("field,rig=stereo,size=160x120", 8, 2);
  outcome o = measure(8000);
  for (int i = 0; i < o.n; i++) n_far += distance(&point[i]) > 5;
  print_message("far field: %d of %d points farther than 5 m, median error %.2f %%, %.1f %% off\n", n_far,
                o.n, 100 * o.median, 100 * o.wrong);
  assert_int_equal(o.n, 8000);
  // at 50 m a pixel of parallax is a third of the depth
  assert_true(n_far > o.n / 2 && o.median < 0.25);
  world_close(&w);
  open_views("room,rig=stereo,size=160x120", 8, 2);
  o = measure(8000);
  for (int i = 0; i < o.n; i++) assert_true(distance(&point[i]) < 25);
  world_close(&w);
}

// More views than maps: groups of neighbours, all of which find something.
TEST(test_more_views_than_maps) {
  open_views("textured,rig=stereo,size=64x64", 40, 2);
  sv_sweep s;
  sv_arena a = scratch_of(0);
  bool is_taken[80] = {false};
  assert_int_equal(sv_sweep_run(&s, &w.app.trainer, &w.cfg.bounds, SV_SWEEP_CAP_PX, &a), SV_OK);
  assert_int_equal(s.n, SV_SWEEP_CAP_VIEWS);
  for (int i = 0; i < s.n; i++) {
    assert_in_range(s.map[i].i_view, 0, 79);
    assert_false(is_taken[s.map[i].i_view]);
    is_taken[s.map[i].i_view] = true;
    assert_in_range(s.map[i].n_sources, 1, SV_SWEEP_CAP_SOURCES);
    assert_true(s.map[i].n_measured > 0);
  }
  world_close(&w);
}

static void expect_none(const char *spec, int n_exposures) {
  open_views(spec, n_exposures, 2);
  sv_stereo_cloud cloud = {.point = point, .cap = 4000, .n = -1};
  sv_arena a = sv_arena_make(scratch_block, sizeof scratch_block);
  assert_int_equal(sv_stereo_points(&w.app.trainer, &w.cfg.bounds, &a, &cloud), SV_AGAIN);
  assert_int_equal(cloud.n, 0);
  assert_int_equal(world_stats(&w).step, 1); // it ran all the same
  assert_false(world_has_line(&w, "depth maps"));
  world_close(&w);
}

TEST(test_nothing_to_compare) {
  expect_none("textured,rig=mono,size=64x48", 1);
  // The same picture twice from one place.
  open_views("textured,rig=mono,size=64x48", 2, 2);
  w.app.trainer.views[1] = w.app.trainer.views[0];
  sv_stereo_cloud cloud = {.point = point, .cap = 4000};
  sv_arena a = scratch_of(0);
  assert_int_equal(sv_stereo_points(&w.app.trainer, &w.cfg.bounds, &a, &cloud), SV_AGAIN);
  world_close(&w);
}

TEST(test_memory) {
  open_views("textured,rig=stereo,size=100x76", 2, 3);
  sv_stereo_cloud cloud = {.point = point, .cap = 4000};
  sv_arena a = scratch_of(64);
  assert_int_equal(sv_stereo_points(&w.app.trainer, &w.cfg.bounds, &a, &cloud), SV_E_NOMEM);
  assert_int_equal(a.used_bytes, 0);
  assert_true(world_has_line(&w, "depth maps of 4 views"));
  world_close(&w);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_rigs),
      cmocka_unit_test(test_threads),
      cmocka_unit_test(test_far_field),
      cmocka_unit_test(test_more_views_than_maps),
      cmocka_unit_test(test_nothing_to_compare),
      cmocka_unit_test(test_memory),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
