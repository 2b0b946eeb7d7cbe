// SPDX-License-Identifier: Apache-2.0
// Following: a textured square that jumps by more than its texture from one picture to the next, before a textured
// wall, seen by two cameras.
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>

#include "src/base/mathx.h"
#include "src/splat/constants.h"
#include "src/train/train.h"

#define W        96
#define H        96
#define N_TIMES  3
#define N_CAMS   2
#define F        100.0f
#define Z_WALL   4.0f
#define Z_SQUARE 3.0f
#define HALF     0.3f  // of the square, world units: 10 px
#define STEP     0.27f // to the right, per time: 9 px
#define BASE     0.2f  // between the cameras
#define SIDE     40    // Gaussians along the wall, and
#define SIDE2    14    // along the square
#define N        (SIDE * SIDE + SIDE2 * SIDE2)

static _Alignas(64) unsigned char block[64u << 20];
static unsigned char px[N_TIMES][N_CAMS][H][W][3];
static sv_view views[N_TIMES][N_CAMS];
static sv_trainer trainer;
static sv_kernels kernels;
static sv_pool pool;
static sv_point point[N];

// Smooth noise: what a surface looks like at a place of its own.
static float shade(float x, float y, uint32_t key) {
  float fx = x * 12 + 100, fy = y * 12 + 100;
  uint32_t ix = (uint32_t)fx, iy = (uint32_t)fy;
  float u = fx - (float)ix, v = fy - (float)iy, s[4];
  for (uint32_t k = 0; k < 4; k++) s[k] = (float)(sv_hash3(ix + (k & 1), iy + (k >> 1), key) & 255) / 255.0f;
  return (1 - v) * ((1 - u) * s[0] + u * s[1]) + v * ((1 - u) * s[2] + u * s[3]);
}

static float square_x(int time) { return STEP * (float)(time - 1); }

static void make_pictures(void) {
  for (int t = 0; t < N_TIMES; t++)
    for (int c = 0; c < N_CAMS; c++) {
      float at = ((float)c - 0.5f) * BASE;
      views[t][c] = (sv_view){
          W, H, F, F, W / 2.0f, H / 2.0f, {1, 0, 0, 0, 1, 0, 0, 0, 1}, {-at, 0, 0}, 0.5f * (float)t, t, c};
      for (int y = 0; y < H; y++)
        for (int x = 0; x < W; x++) {
          float dx = ((float)x + 0.5f - W / 2.0f) / F, dy = ((float)y + 0.5f - H / 2.0f) / F;
          float sx = at + dx * Z_SQUARE - square_x(t), sy = dy * Z_SQUARE;
          bool is_square = fabsf(sx) < HALF && fabsf(sy) < HALF;
          for (uint32_t k = 0; k < 3; k++)
            px[t][c][y][x][k] =
                (unsigned char)(255.0f * (is_square ? shade(sx, sy, 7 + k)
                                                    : shade(at + dx * Z_WALL, dy * Z_WALL, 1 + k)));
        }
    }
}

static void make_points(void) {
  int n = 0;
  for (int j = 0; j < SIDE; j++)
    for (int i = 0; i < SIDE; i++)
      point[n++] = (sv_point){
          .mean = {-2.2f + 4.4f * (float)i / (SIDE - 1), -2.2f + 4.4f * (float)j / (SIDE - 1), Z_WALL},
          .rgb = {0.5f, 0.5f, 0.5f}};
  for (int j = 0; j < SIDE2; j++)
    for (int i = 0; i < SIDE2; i++)
      point[n++] = (sv_point){.mean = {HALF * (2.0f * (float)i / (SIDE2 - 1) - 1),
                                       HALF * (2.0f * (float)j / (SIDE2 - 1) - 1), Z_SQUARE},
                              .rgb = {0.5f, 0.5f, 0.5f}};
}

// A trainer that knows the wall and the square of the middle time, and what it takes to follow to the others.
static void start(int n_cams) {
  static const sv_init_cfg init = {
      .kind = SV_INIT_POINTS, .radius = 2, .opacity = 0.95f, .scale_factor = 1.0f, .seed = 1};
  sv_train_cfg c = sv_train_defaults();
  sv_err err;
  sv_arena a = sv_arena_make(block, sizeof block);
  c.n_gaussians = N, c.sh_degree = 0, c.cap_views = N_TIMES * N_CAMS, c.cap_width_px = W, c.cap_height_px = H;
  c.start_scale = 1;
  c.dynamic.kind = SV_DEFORM_CLIP;
  c.dynamic.n_pos = 2, c.dynamic.n_rot = c.dynamic.n_colour = 1;
  assert_int_equal(sv_trainer_init(&trainer, &c, &kernels, &pool, &a, &err), SV_OK);
  for (int t = 0; t < N_TIMES; t++)
    for (int k = 0; k < n_cams; k++) {
      sv_image_u8 im = {&px[t][k][0][0][0], W, H, 3, 3 * W};
      assert_int_equal(sv_train_add_view(&trainer, &views[t][k], &im, &err), SV_OK);
    }
  assert_int_equal(sv_train_start(&trainer, &init, point, N, &a), SV_OK);
}

static void place(int i, float time, float x[3]) {
  sv_motion_values v = sv_motion_values_at(&trainer.deform.motion.cfg, time);
  for (int k = 0; k < 3; k++) {
    x[k] = *sv_gaussians_at(&trainer.g, i, SV_ROW_MEAN + k);
    for (int f = 0; f < trainer.deform.motion.cfg.n_pos && i < trainer.deform.motion.n_moving; f++)
      x[k] += v.pos[f] * *sv_motion_row(&trainer.deform.motion, i, SV_MROW_FUNCTIONS + 3 * f + k);
  }
}

typedef struct {
  int n_square,
      n_followed;       // well inside the square at the middle time; of these, where they belong at both ends
  int n_wall, n_astray; // away from it; of these, those that moved by more than a pixel
  float depth_error;    // largest, of those followed
} outcome;

static outcome look(void) {
  outcome o = {0};
  for (int i = 0; i < N; i++) {
    float x[N_TIMES][3];
    for (int t = 0; t < N_TIMES; t++) place(i, 0.5f * (float)t, x[t]);
    if (x[1][2] > 3.5f) {
      if (fabsf(x[1][0]) < 1.3f) continue; // beside or behind the square
      o.n_wall++;
      o.n_astray += fabsf(x[0][0] - x[1][0]) > Z_WALL / F || fabsf(x[2][0] - x[1][0]) > Z_WALL / F;
      continue;
    }
    if (fabsf(x[1][0]) > 0.7f * HALF || fabsf(x[1][1]) > 0.7f * HALF) continue;
    o.n_square++;
    if (fabsf(x[0][0] - x[1][0] + STEP) > 0.03f || fabsf(x[2][0] - x[1][0] - STEP) > 0.03f)
      continue; // a pixel
    o.n_followed++;
    o.depth_error = sv_maxf(o.depth_error, sv_maxf(fabsf(x[0][2] - Z_SQUARE), fabsf(x[2][2] - Z_SQUARE)));
  }
  print_message("%d of %d followed, depth within %.3f; %d of %d of the wall astray; %d move\n", o.n_followed,
                o.n_square, (double)o.depth_error, o.n_astray, o.n_wall, trainer.deform.motion.n_moving);
  return o;
}

static int setup(void **state) {
  (void)state;
  make_pictures();
  make_points();
  sv_kernels_init(&kernels, ~0u);
  pool = sv_pool_serial();
  return 0;
}

static void follow_all(void) {
  assert_true(sv_train_has_time(&trainer, 0.5f, 0.1f) && !sv_train_has_time(&trainer, 0, 0.1f));
  assert_int_equal(sv_train_follow(&trainer, 0.1f, 0.9f), SV_OK);
}

static void test_two_cameras(void **state) {
  (void)state;
  start(N_CAMS);
  follow_all();
  outcome o = look();
  assert_true(o.n_square > 50 && o.n_followed > o.n_square * 9 / 10);
  assert_true(o.depth_error < 0.15f);
  assert_true(o.n_wall > 100 && o.n_astray < o.n_wall / 20);
}

// What one camera cannot tell stays as it was.
static void test_one_camera(void **state) {
  (void)state;
  start(1);
  follow_all();
  outcome o = look();
  assert_true(o.n_followed > o.n_square * 8 / 10 && o.depth_error < 0.05f);
}

static void test_nothing_new(void **state) {
  (void)state;
  start(N_CAMS);
  assert_int_equal(sv_train_follow(&trainer, 0.1f, 0.1f), SV_OK);
  assert_int_equal(trainer.deform.motion.n_moving, 0);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_two_cameras),
      cmocka_unit_test(test_one_camera),
      cmocka_unit_test(test_nothing_new),
  };
  return cmocka_run_group_tests(tests, setup, NULL);
}
