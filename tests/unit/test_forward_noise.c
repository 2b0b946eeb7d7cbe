// SPDX-License-Identifier: Apache-2.0
// Noise that is laid over a predicted measurement: its size, its rounding, its derivative.
#include <math.h>
#include <stdint.h>

#include "src/rig/forward.h"
#include "tests/common/test.h"

#define SIDE  64
#define LEVEL 0.25f
#define READ  0.01f
#define SHOT  0.02f

static _Alignas(64) uint8_t block[1 << 20];

typedef struct {
  sv_lens lens;
  sv_multiplexed c;
  sv_kernels k;
  sv_pool pool;
  sv_forward f;
  sv_planes rgb, g, out;
  sv_region region;
  sv_crop crop;
} world;

static void take_planes(sv_planes *p, sv_arena *a) {
  *p = (sv_planes){
      .width_px = SIDE, .height_px = SIDE, .stride = sv_plane_pad(SIDE), .rows_padded = sv_plane_pad(SIDE)};
  for (int k = 0; k < 3; k++) p->c[k] = SV_TAKE(a, float, sv_plane_floats(SIDE, SIDE));
  sv_planes_clear(p);
}

// One lens on all of the sensor, a flat picture, display values.
static void make_world(world *w) {
  sv_arena a = sv_arena_make(block, sizeof block);
  *w = (world){.lens = {.view = {.width_px = SIDE, .height_px = SIDE, .fx = SIDE, .fy = SIDE},
                        .footprint = {.width_px = SIDE, .height_px = SIDE}},
               .region = {0, 0, SIDE, SIDE}};
  w->c = (sv_multiplexed){
      .width_px = SIDE, .height_px = SIDE, .n_lenses = 1, .lenses = &w->lens, .max_overlap = 1.0f};
  sv_kernels_init(&w->k, SV_ISA_BIT(SV_ISA_REF));
  w->pool = sv_pool_serial();
  sv_forward_cfg fc = {.cap_width_px = SIDE, .cap_height_px = SIDE, .n_threads = 1};
  assert_int_equal(sv_forward_init(&w->f, &fc, (sv_compute){&w->k, &w->pool}, &a), SV_OK);
  take_planes(&w->rgb, &a);
  take_planes(&w->g, &a);
  take_planes(&w->out, &a);
  assert_int_equal(a.status, SV_OK);
  for (int y = 0; y < SIDE; y++)
    for (int x = 0; x < SIDE; x++)
      for (int k = 0; k < 3; k++) {
        w->rgb.c[k][y * w->rgb.stride + x] = LEVEL;
        w->g.c[k][y * w->g.stride + x] = 1.0f;
      }
  assert_true(sv_multiplexed_crop(&w->c, 0, &w->region, &w->crop));
}

static void predict(world *w, uint32_t key) {
  w->f.noise = (sv_forward_noise){READ, SHOT, key};
  assert_int_equal(sv_forward_begin(&w->f, &w->region), SV_OK);
  sv_forward_add(&w->f, &w->c, &w->crop, &w->rgb, NULL);
  sv_forward_finish(&w->f, &w->c);
  sv_forward_bwd(&w->f, &w->c, &w->crop, &w->rgb, &(sv_forward_grad){&w->g, NULL, &w->out, NULL, NULL});
}

TEST(test_size_rounding_and_derivative) {
  static world w;
  double sum = 0, sum2 = 0;
  const double deviation = (double)(READ + SHOT * LEVEL);
  make_world(&w);
  predict(&w, 7);
  for (int y = 0; y < SIDE; y++)
    for (int x = 0; x < SIDE; x++)
      for (int k = 0; k < 3; k++) {
        double v = (double)w.f.predicted.c[k][y * w.f.predicted.stride + x],
               e = (v - (double)LEVEL) / deviation;
        double code = v * 16383;
        assert_float_equal(code, floor(code + 0.5), 2e-3);
        // y + (read + shot y) n: the derivative is 1 + shot n.
        assert_float_equal(w.out.c[k][y * w.out.stride + x], 1 + (double)SHOT * e, 1e-4);
        sum += e;
        sum2 += e * e;
      }
  const double n = 3.0 * SIDE * SIDE;
  assert_float_equal(sum / n, 0, 0.03);
  assert_float_equal(sum2 / n, 1, 0.04);
}

TEST(test_keys_differ_and_repeat) {
  static world w;
  float first[SIDE];
  int n_same = 0;
  make_world(&w);
  predict(&w, 1);
  for (int x = 0; x < SIDE; x++) first[x] = w.f.predicted.c[0][x];
  predict(&w, 2);
  for (int x = 0; x < SIDE; x++) n_same += first[x] == w.f.predicted.c[0][x];
  assert_in_range(n_same, 0, 4);
  predict(&w, 1);
  for (int x = 0; x < SIDE; x++) assert_true(first[x] == w.f.predicted.c[0][x]);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_size_rounding_and_derivative),
                                     cmocka_unit_test(test_keys_differ_and_repeat)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
