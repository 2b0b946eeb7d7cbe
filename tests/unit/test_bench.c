// SPDX-License-Identifier: Apache-2.0
// The bench's own arithmetic: sorted times, growth, bounds and counts. Real times are not tested
// here.
#include <math.h>
#include <stdlib.h>

#include "tests/common/test.h"
#include "tools/bench/bench.h"
#include "src/base/str.h"
#include "src/format/json.h"

TEST(test_times) {
  double v[] = {5, 1, 4, 2, 3}, one[] = {7}, two[] = {4, 2};
  sv_bench_times t = sv_bench_times_of(v, 5);
  assert_true(t.least == 1 && t.q1 == 2 && t.median == 3 && t.q3 == 4);
  t = sv_bench_times_of(one, 1);
  assert_true(t.least == 7 && t.median == 7 && t.q3 == 7);
  assert_true(sv_bench_times_of(two, 2).median == 3);
  assert_true(sv_bench_times_of(one, 0).median == 0);
}

static sv_bench_step case_of(int n, int px, double ms) {
  return (sv_bench_step){.n_gaussians = n, .n = {.n_pixels = (uint32_t)px}, .step_ms = {.least = ms}};
}

TEST(test_growth) {
  sv_bench_step r[6];
  const int n[] = {1000, 8000}, px[] = {10000, 40000, 160000};
  for (int i = 0; i < 6; i++) r[i] = case_of(n[i / 3], px[i % 3], 0.5 + 40e-6 * n[i / 3] + 20e-6 * px[i % 3]);
  sv_bench_growth g = sv_bench_growth_of(r, 6);
  assert_true(fabs(g.fixed_ms - 0.5) < 1e-9 && fabs(g.ns_per_gaussian - 40) < 1e-6);
  assert_true(fabs(g.ns_per_pixel - 20) < 1e-6 && g.worst < 1e-9);
  for (int i = 0; i < 6; i++) r[i].step_ms.least = 1e-6 * sqrt(n[i / 3]) * px[i % 3]; // powers
  g = sv_bench_growth_of(r, 6);
  assert_true(fabs(g.by_gaussians - 0.5) < 1e-9 && fabs(g.by_pixels - 1) < 1e-9 && g.worst > 0.01);
  r[2].step_ms.least = 0; // a clock that stands still says nothing
  assert_true(sv_bench_growth_of(r, 6).worst == 0);
  for (int i = 0; i < 3; i++) r[i] = case_of(1000, 10000, 1); // one size has no growth
  assert_true(sv_bench_growth_of(r, 3).ns_per_pixel == 0);
}

TEST(test_bound) {
  sv_bench_peak p = {
      .flop_per_s = 1e9, .n_copy_sizes = 2, .copy_bytes = {1000, 4000}, .copy_bytes_per_s = {4e9, 1e9}};
  sv_bench_cost c = {1e9, 1e9};
  assert_true(sv_bench_bound_s(&p, c, 1000) == 1); // arithmetic
  const sv_bench_cost moves = {0, 8e9};
  assert_true(sv_bench_bound_s(&p, moves, 10) == 2 &&
              sv_bench_bound_s(&p, moves, 1000) == 2);                // out of the cache
  assert_true(fabs(sv_bench_bound_s(&p, moves, 2000) - 3.2) < 1e-12); // partly
  assert_true(sv_bench_bound_s(&p, moves, 4000) == 8 &&
              sv_bench_bound_s(&p, moves, 9e9) == 8); // out of memory
  sv_bench_peak disturbed = p;
  disturbed.copy_bytes_per_s[0] = 0.5e9;
  assert_true(sv_bench_bound_s(&disturbed, moves, 1000) == 8);
  assert_true(sv_bench_bound_s(&(sv_bench_peak){0}, c, 1000) == 0); // nothing measured
  sv_bench_step r = {.n = {.pairs = 1000000,
                           .block_rows = 1000,
                           .n_intersections = 100,
                           .n_gaussians = 10,
                           .n_pixels = 100,
                           .n_rows = 23}};
  assert_true(sv_bench_arrays_bytes(&r.n) == 10 * (23 * 8 + 64) + 100 * (16 + 4 + 8 + 32) + 100 * 43);
  double sum = 0;
  sv_bench_bound(&r, &p);
  for (int s = 0; s < SV_N_STAGES; s++) sum += r.stage_bound_ms[s];
  // By ports: 16 and 27 instructions a pair, 1 and 6 a row of a block, two operations each.
  double more = 2e-6 * (16e6 + 1 * 16 * 1000) - r.stage_bound_ms[SV_STAGE_RASTER] +
                2e-6 * (27e6 + 6 * 16 * 1000) - r.stage_bound_ms[SV_STAGE_RASTER_BWD];
  assert_true(fabs(r.slot_bound_ms - r.bound_ms - more) < 1e-9);
  // 24 and 39 operations a pair, 1 and 10 a lane of a row of blocks, 9 x 15 a record.
  assert_true(fabs(r.pixel_bound_ms - (63 + 11e-6 * 16 * 1000 + 135e-6 * 100)) < 1e-9 &&
              r.bound_ms >= r.pixel_bound_ms && fabs(sum - r.bound_ms) < 1e-9);
}

// The light that the count leaves at each pixel is what the kernels left there.
TEST(test_count) {
  sv_bench_step size = {.n_gaussians = 300, .width_px = 90, .height_px = 50, .n_threads = 1};
  static sv_bench_scene scene;
  sv_kernels k;
  sv_pool pool = sv_pool_serial();
  sv_step_stats st;
  size_t bytes = sv_bench_scene_bytes(&size) + SV_ARENA_ALIGN;
  void *block = malloc(bytes);
  assert_non_null(block);
  sv_arena a = sv_arena_make(block, bytes);
  sv_kernels_init(&k, ~0u);
  assert_true(sv_bench_scene_make(&scene, &size, (sv_compute){&k, &pool}, 1, &a, NULL) >= 0);
  uint64_t before = sv_train_digest(&scene.t);
  assert_int_equal(sv_train_step(&scene.t, 0.5f, &st), SV_OK);
  assert_true(sv_train_digest(&scene.t) == before); // every step is the same work
  sv_render_options o = sv_train_render_options(&scene.t, 0.5f, true);
  assert_int_equal(sv_render(&scene.t.render, &scene.t.g, &scene.t.views[0].view, &o), SV_OK);
  sv_bench_counts n = sv_bench_count(&scene.t);
  const sv_renderer *r = &scene.t.render;
  assert_true(n.useful > 0 && n.useful <= n.pairs && n.pairs % 16 == 0 && n.n_pixels == 90 * 50);
  int n_off = 0;
  for (int y = 0; y < 50; y++)
    for (int x = 0; x < 90; x++) {
      int at = y * r->rgb.stride + x;
      n_off += fabsf(fabsf(r->depth[at]) - r->trans[at]) > 1e-3f;
    }
  assert_true(n_off < 5); // a splat at the very edge of 1/255 may go either way
  free(block);
}

// Each look at this clock is a tenth of a second later.
static sv_ns tick(void *self) {
  sv_ns *now = self;
  return *now += SV_NS_PER_S / 10;
}

// Every stage is between two looks at the clock, and is as long as they are apart.
TEST(test_stages) {
  static sv_bench b;
  sv_ns now = 0;
  sv_bench_step r = {.n_gaussians = 300, .width_px = 90, .height_px = 50, .n_threads = 1};
  sv_kernels k;
  sv_pool pool = sv_pool_serial();
  size_t bytes = sv_bench_scene_bytes(&r) + SV_ARENA_ALIGN;
  void *block = malloc(bytes);
  assert_non_null(block);
  sv_arena a = sv_arena_make(block, bytes);
  sv_kernels_init(&k, ~0u);
  b.cfg = (sv_bench_cfg){.k = &k, .clock = {.self = &now, .now_ns = tick}};
  assert_true(sv_bench_scene_make(&b.scene, &r, (sv_compute){&k, &pool}, 1, &a, NULL) >= 0);
  uint64_t before = sv_train_digest(&b.scene.t);
  assert_int_equal(sv_bench_time_scene(&b, &pool, &r), SV_OK);
  assert_true(sv_train_digest(&b.scene.t) == before);
  assert_int_equal(r.n_samples, 4);                        // of five, as time is up
  const double share = 100.0 / b.scene.t.cfg.newton.every; // of what is timed over several steps
  assert_true(fabs(r.step_ms.median - share) < 1e-6 && fabs(r.render_ms.least - 100) < 1e-6);
  for (int s = 0; s < SV_N_STAGES; s++) {
    // SV_STAGE_ORDER is the rest of a rendering
    double is = s == SV_STAGE_ORDER ? 0 : s == SV_STAGE_CURVATURE ? share : 100;
    assert_true(fabs(r.stage_ms[s].median - is) < 1e-6);
  }
  assert_true(r.n.n_touched > 100 && r.n.n_touched <= 300 && r.n.n_intersections > 0 &&
              r.n.n_visible >= r.n.n_touched);
  free(block);
}

static void collect(void *out, const char *text) { sv_str_add(out, "%s", text); }

// Everything that is printed is one JSON object, whatever was skipped.
TEST(test_json) {
  enum { CAP = 800 };
  static char text[16384];
  static jsmntok_t tok[CAP];
  static sv_bench b;
  sv_kernels k;
  sv_err err;
  sv_json j;
  sv_str s = sv_str_make(text, sizeof text);
  sv_kernels_init(&k, ~0u);
  sv_bench_cfg cfg = {.k = &k, .is_json = true, .out = &s, .write = collect};
  sv_bench_step r = {.n_gaussians = 1000, .width_px = 128, .height_px = 128, .n_threads = 2};
  sv_bench_growth g = {.fixed_ms = 1};
  sv_bench_kernel kernel = {.op = SV_BENCH_RASTER, .ns = {1, 1, 1, 1}, .cost = {27, 1}};
  for (int i = 0; i < 2; i++) { // with and without anything in it
    s = sv_str_make(text, sizeof text);
    sv_bench_begin(&b, &cfg, NULL);
    b.peak = (sv_bench_peak){.flop_per_s = 1e9, .n_copy_sizes = 2};
    for (int n = 0; n < 2 * i; n++) {
      sv_bench_put_peak(&b, 1);
      sv_bench_put_step(&b, &r);
      sv_bench_put_growth(&b, &g, 1);
      sv_bench_put_skipped(&b, &r);
    }
    sv_bench_put_kernels_begin(&b);
    for (int n = 0; n < 2 * i; n++) sv_bench_put_kernel(&b, &kernel);
    sv_bench_end(&b, "\"extra\": 1");
    assert_false(s.is_cut);
    if (sv_json_parse(&j, &(sv_file_data){"bench", text, s.len}, tok, CAP, &err) < 0)
      fail_msg("%s\n%s", err.text, text);
    static const char *const lists[] = {"steps", "kernels", "pools", "skipped"};
    for (int l = 0; l < 4; l++) {
      int at = sv_json_get(&j, 0, lists[l]);
      assert_true(sv_json_is_array(&j, at));
      assert_int_equal(sv_json_size(&j, at), 2 * i);
    }
    assert_true(sv_json_is_number(&j, sv_json_get(&j, 0, "extra")));
  }
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_times),  cmocka_unit_test(test_growth),
                                     cmocka_unit_test(test_bound),  cmocka_unit_test(test_count),
                                     cmocka_unit_test(test_stages), cmocka_unit_test(test_json)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
