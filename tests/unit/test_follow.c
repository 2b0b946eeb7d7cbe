// SPDX-License-Identifier: Apache-2.0
// Following: a textured square that jumps by more than its texture from one picture to the next,
// before a textured wall, seen by two cameras; and neighbours, who say where those went that no
// camera saw.
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "src/base/mathx.h"
#include "src/splat/constants.h"
#include "src/dynamic/bodies.h"
#include "src/dynamic/curriculum.h"
#include "src/dynamic/match.h"
#include "src/dynamic/search.h"
#include "tests/common/test.h"

#define W        96
#define H        96
#define N_TIMES  5
#define MIDDLE   2
#define N_CAMS   2
#define F        100.0f
#define Z_WALL   4.0f
#define Z_SQUARE 3.0f
#define HALF     0.3f // of the square, world units: 10 px
// to the right, from the middle time to the next: 9 px, as far as is looked for
#define STEP  0.27f
#define STEP2 0.33f // and to the last: 11 px
#define BASE  0.2f  // between the cameras
#define SIDE  40    // Gaussians along the wall, and
#define SIDE2 14    // along the square
#define N     (SIDE * SIDE + SIDE2 * SIDE2)

static _Alignas(64) unsigned char block[64u << 20];
static unsigned char px[N_TIMES][N_CAMS][H][W][3];
static sv_view views[N_TIMES][N_CAMS];
static sv_trainer trainer;
static sv_dynamic dynamic;
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

static float square_x(int time) {
  static const float x[N_TIMES] = {-STEP - STEP2, -STEP, 0, STEP, STEP + STEP2};
  return x[time];
}

static void make_pictures(void) {
  for (int t = 0; t < N_TIMES; t++)
    for (int c = 0; c < N_CAMS; c++) {
      float at = ((float)c - 0.5f) * BASE;
      views[t][c] = (sv_view){
          W, H, F, F, W / 2.0f, H / 2.0f, {1, 0, 0, 0, 1, 0, 0, 0, 1}, {-at, 0, 0}, 0.25f * (float)t, t, c};
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
  for (int i = 0; i < n; i++)
    for (uint32_t k = 0; k < 3; k++)
      point[i].rgb[k] = shade(point[i].mean[0], point[i].mean[1], (point[i].mean[2] < Z_WALL ? 7 : 1) + k);
}

// A trainer that knows the wall and the square of the middle time, and what it takes to follow to
// the others.
static void start(int n_cams, int first, int last, int n_bodies) {
  static const sv_init_cfg init = {
      .kind = SV_INIT_POINTS, .radius = 2, .opacity = 0.95f, .scale_factor = 0.4f, .seed = 1};
  sv_train_cfg c = sv_train_defaults();
  sv_dynamic_cfg m = sv_dynamic_defaults();
  sv_err err;
  sv_arena a = sv_arena_make(block, sizeof block);
  c.n_gaussians = N;
  c.sh_degree = 0;
  c.cap_views = N_TIMES * N_CAMS;
  c.cap_width_px = W;
  c.cap_height_px = H;
  c.start_scale = 1;
  c.has_motion = true;
  m.kind = SV_DEFORM_CLIP;
  m.n_bodies = n_bodies;
  m.n_pos = 4;
  m.n_rot = m.n_colour = 1;
  assert_int_equal(sv_trainer_init(&trainer, &c, (sv_compute){&kernels, &pool}, &a, &err), SV_OK);
  assert_int_equal(sv_dynamic_init(&dynamic, &m, &trainer, &a, &err), SV_OK);
  for (int t = first; t <= last; t++)
    for (int k = 0; k < n_cams; k++) {
      sv_image_u8 im = {&px[t][k][0][0][0], W, H, 3, 3 * W};
      assert_int_equal(sv_train_add_view(&trainer, &views[t][k], &im, &err), SV_OK);
    }
  assert_int_equal(sv_train_start(&trainer, &init, point, N, &a), SV_OK);
}

static void place(int i, float time, float x[3]) {
  const sv_gaussians *g = &trainer.g;
  sv_train_set_time(&trainer, time);
  for (int k = 0; k < 3; k++) {
    const float *p = sv_gaussians_at(g, i, SV_ROW_MEAN + k);
    x[k] = i < g->n_moved ? g->moved[p - g->param] : *p;
  }
}

typedef struct {
  int n_square,
      n_followed;       // well inside the square at the middle time; of these, where they belong at
                        // both ends
  int n_wall, n_astray; // away from it; of these, those that moved by more than a pixel
  float depth_error;    // largest, of those followed
} outcome;

// Between the times middle - n and middle + n.
static outcome look(int n) {
  outcome o = {0};
  const float to = square_x(MIDDLE + n);
  for (int i = 0; i < N; i++) {
    float a[3], x[3], b[3];
    place(i, 0.25f * (float)(MIDDLE - n), a);
    place(i, 0.25f * (float)MIDDLE, x);
    place(i, 0.25f * (float)(MIDDLE + n), b);
    if (x[2] > 3.5f) {
      if (fabsf(x[0]) < 1.3f) continue; // beside or behind the square
      o.n_wall++;
      o.n_astray += fabsf(a[0] - x[0]) > Z_WALL / F || fabsf(b[0] - x[0]) > Z_WALL / F;
      continue;
    }
    if (fabsf(x[0]) > 0.7f * HALF || fabsf(x[1]) > 0.7f * HALF) continue;
    o.n_square++;
    if (fabsf(a[0] - x[0] + to) > 0.03f || fabsf(b[0] - x[0] - to) > 0.03f) continue; // a pixel
    o.n_followed++;
    o.depth_error = sv_maxf(o.depth_error, sv_maxf(fabsf(a[2] - Z_SQUARE), fabsf(b[2] - Z_SQUARE)));
  }
  print_message("%d of %d followed, depth within %.3f; %d of %d of the wall astray; %d move\n", o.n_followed,
                o.n_square, (double)o.depth_error, o.n_astray, o.n_wall, dynamic.deform.motion.n_moving);
  return o;
}

FIXTURE(setup) {
  make_pictures();
  make_points();
  sv_kernels_init(&kernels, ~0u);
  pool = sv_pool_serial();
  return 0;
}

static void follow_all(void) {
  assert_true(sv_dynamic_has_time(&dynamic, 0.5f, 0.1f) && !sv_dynamic_has_time(&dynamic, 0.25f, 0.1f));
  assert_int_equal(sv_dynamic_match(&dynamic, 0.1f, 0.9f), SV_OK);
}

TEST(test_two_cameras) {
  for (int n_bodies = 0; n_bodies < 2; n_bodies++) {
    start(N_CAMS, 1, 3, n_bodies);
    follow_all();
    outcome o = look(1);
    assert_true(o.n_square > 50 && o.n_followed > o.n_square * 9 / 10);
    assert_true(o.depth_error < 0.15f);
    assert_true(o.n_wall > 100 && o.n_astray < o.n_wall / 20);
    assert_int_equal(dynamic.deform.motion.bodies.n, n_bodies ? 2 : 0);
  }
}

// What one camera cannot tell stays as it was.
TEST(test_one_camera) {
  for (int n_bodies = 0; n_bodies < 2; n_bodies++) {
    start(1, 1, 3, n_bodies);
    follow_all();
    outcome o = look(1);
    assert_true(o.n_followed > o.n_square * 8 / 10);
    assert_true(o.depth_error < (n_bodies ? 0.1f : 0.05f)); // a body may turn a little
  }
}

TEST(test_nothing_new) {
  start(N_CAMS, 1, 3, 15);
  assert_int_equal(sv_dynamic_match(&dynamic, 0.1f, 0.1f), SV_OK);
  assert_int_equal(dynamic.deform.motion.n_moving, 0);
}

// Mean distance in camera 0 of the square's middle from where it belongs at the time after the
// middle.
static float off_px(void) {
  float sum = 0, n = 0;
  for (int i = 0; i < N; i++) {
    const float at = -0.5f * BASE;
    float x[3], y[3];
    place(i, 0.25f * MIDDLE, x);
    if (dynamic.deform.motion.bodies.of[i] != 1 || fabsf(x[2] - Z_SQUARE) > 0.1f) continue;
    place(i, 0.25f * (MIDDLE + 1), y);
    const float dx = F * ((y[0] - at) / y[2] - (x[0] + square_x(MIDDLE + 1) - at) / x[2]);
    const float dy = F * (y[1] / y[2] - x[1] / x[2]);
    sum += sqrtf(dx * dx + dy * dy);
    n += 1;
  }
  return sum / n;
}

// A body that is expected 4 px and 8 degrees beside where the pictures show it is moved there; one
// that is expected where nothing of it can be seen stays.
TEST(test_track) {
  for (int n_cams = 1; n_cams <= N_CAMS; n_cams++) {
    start(n_cams, 1, 3, 1);
    follow_all();
    const sv_bodies *b = &dynamic.deform.motion.bodies;
    assert_int_equal(b->n, 2);
    sv_rigid *knot = sv_bodies_knot(b, 1, sv_bodies_find_knot(b, 0.75f)), was = *knot;
    const sv_rigid beside = {{0.9976f, 0, 0, 0.0698f}, {0.1f, -0.06f, 0}},
                   away = {{1, 0, 0, 0}, {0, 0.8f, 0}};
    *knot = sv_rigid_then(knot, &beside);
    const float before = off_px();
    assert_int_equal(sv_dynamic_track_bodies(&dynamic, 0.75f, 0.9f), SV_OK);
    const float after = off_px();
    print_message("%d cameras: from %.2f to %.2f px\n", n_cams, (double)before, (double)after);
    assert_true(before > 3 && after < 0.6f);
    const sv_rigid far = *knot = sv_rigid_then(&was, &away);
    assert_int_equal(sv_dynamic_track_bodies(&dynamic, 0.75f, 0.9f), SV_OK);
    assert_memory_equal(knot, &far, sizeof far);
  }
}

// Half of the square's parts were taken for others that stand still, and some of the wall, before
// which the square goes, for parts of the square: the pictures say whose they are.
TEST(test_members) {
  int n_lost = 0, n_back = 0, n_wall = 0, n_let_go = 0, n_kept = 0, n_square = 0;
  bool was_lost[N] = {false}, was_taken[N] = {false};
  start(N_CAMS, 1, 3, 1);
  follow_all();
  sv_motion *mo = &dynamic.deform.motion;
  sv_bodies *b = &mo->bodies;
  assert_int_equal(b->n, 2);
  const sv_motion_values mid = sv_motion_values_at(&mo->cfg, 0.5f);
  for (int i = 0; i < N; i++) {
    float x[3], q[4];
    sv_dynamic_local_position(&dynamic, i, &mid, x, q);
    const bool is_inside =
        fabsf(x[0]) < 0.7f * HALF && fabsf(x[1]) < 0.7f * HALF && fabsf(x[2] - Z_SQUARE) < 0.1f;
    const bool is_beside = fabsf(x[0]) > 1.3f && fabsf(x[0]) < 1.6f && fabsf(x[1]) < 1.0f && x[2] > 3.5f;
    if (i < mo->n_moving && b->of[i] == 1 && is_inside && i % 2) {
      sv_dynamic_attach(&dynamic, i, 0, x, q);
      was_lost[i] = true;
      n_lost++;
    } else if (is_beside && !(i < mo->n_moving && b->of[i])) {
      sv_dynamic_attach(&dynamic, i, 1, x, q);
      was_taken[i] = true;
      n_wall++;
    } else n_square += is_inside && i < mo->n_moving && b->of[i] == 1;
  }
  sv_deform_set_moving(&dynamic.deform, N); // all that have just begun to move, too
  sv_dynamic_begin_assignment(&dynamic);
  for (int i = 0; i < trainer.n_views; i++) {
    assert_int_equal(sv_dynamic_residual(&dynamic, i, 0.9f), SV_OK);
    sv_dynamic_compare_assignment(&dynamic, i);
  }
  sv_dynamic_end_assignment(&dynamic);
  for (int i = 0; i < N; i++) {
    n_back += was_lost[i] && b->of[i] == 1;
    n_let_go += was_taken[i] && b->of[i] == 0;
    float x[3];
    sv_dynamic_local_position(&dynamic, i, &mid, x, NULL);
    n_kept += !was_lost[i] && b->of[i] == 1 && fabsf(x[0]) < 0.7f * HALF && fabsf(x[1]) < 0.7f * HALF &&
              fabsf(x[2] - Z_SQUARE) < 0.1f;
  }
  print_message("%d of %d came back, %d of %d were let go, %d of %d stayed\n", n_back, n_lost, n_let_go,
                n_wall, n_kept, n_square);
  assert_true(n_lost > 20 && n_back > n_lost * 8 / 10);
  assert_true(n_wall > 20 && n_let_go > n_wall * 6 / 10);
  assert_true(n_square > 20 && n_kept > n_square * 9 / 10);
}

// The second jump is farther than is looked for around the old place: what moved is looked for
// where it was going.
TEST(test_ahead) {
  for (int n_bodies = 0; n_bodies < 2; n_bodies++) {
    start(N_CAMS, 0, 4, n_bodies);
    assert_int_equal(sv_dynamic_match(&dynamic, 0.1f, 0.3f), SV_OK);
    assert_true(sv_dynamic_has_time(&dynamic, 0.75f, 0.3f) && !sv_dynamic_has_time(&dynamic, 1, 0.3f));
    assert_int_equal(sv_dynamic_match(&dynamic, 0.3f, 0.9f), SV_OK);
    outcome o = look(2);
    assert_true(o.n_square > 50 && o.n_followed > o.n_square * 9 / 10);
  }
}

// --- neighbours ----------------------------------------------------------------------------------

#define N_BODY 400

// Points on a ball that turns and shifts; of some the displacement is unknown, of some it is wrong.
// All, asked of the others, went with the ball.
TEST(test_neighbours) {
  static const float centre[3] = {0.2f, -0.1f, 3.0f};
  static const double turn[4] = {0.98, 0.1, -0.15, 0.08};
  double r[9];
  float wrong = 0, most = 0, u[3];
  sv_rng rng = sv_rng_make(1, 1);
  sv_arena a = sv_arena_make(block, sizeof block);
  sv_local_motion *near = sv_local_motion_carve(N_BODY, &a);
  assert_non_null(near);
  sv_quat_to_mat(r, turn);
  float truth[N_BODY][3];
  for (int i = 0; i < N_BODY; i++) {
    sv_displaced *o = &near->of[i];
    double x[3] = {(double)sv_rng_normal(&rng), (double)sv_rng_normal(&rng), (double)sv_rng_normal(&rng)};
    double n = sv_norm3(x);
    for (int k = 0; k < 3; k++) x[k] *= 0.5 / n;
    for (int k = 0; k < 3; k++) {
      double to = r[3 * k] * x[0] + r[3 * k + 1] * x[1] + r[3 * k + 2] * x[2];
      o->x[k] = centre[k] + (float)x[k];
      truth[i][k] = o->u[k] = (float)(to - x[k]) + 0.4f * (float)(k == 0);
    }
    o->is_known = i % 3 != 0;
    if (i % 7 == 1) o->u[i % 3] += 0.5f;
    near->order[i] = (uint32_t)(N_BODY - 1 - i);
  }
  sv_local_motion_find(near, &kernels, N_BODY, centre, 1.0f);
  for (int i = 0; i < N_BODY; i++) {
    float off2 = 0;
    assert_true(sv_local_motion_interpolate(near, i, u));
    for (int k = 0; k < 3; k++) off2 += (u[k] - truth[i][k]) * (u[k] - truth[i][k]);
    wrong += (float)(off2 > 0.05f * 0.05f);
    most = sv_maxf(most, sqrtf(off2));
  }
  print_message("%d of %d are off by more than 0.05, at most by %.3f\n", (int)wrong, N_BODY, (double)most);
  assert_true(wrong < 0.05f * N_BODY);
}

TEST(test_few_neighbours) {
  static const float centre[3] = {0};
  float u[3];
  sv_arena a = sv_arena_make(block, sizeof block);
  sv_local_motion *near = sv_local_motion_carve(4, &a);
  assert_non_null(near);
  for (int i = 0; i < 4; i++) {
    near->of[i] = (sv_displaced){.x = {1e30f, 0, (float)i}, .u = {1, 0, 0}, .is_known = true};
    near->order[i] = (uint32_t)i;
  }
  sv_local_motion_find(near, &kernels, 4, centre, 1.0f); // far outside of the grid
  assert_false(sv_local_motion_interpolate(near, 0, u));
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_two_cameras), cmocka_unit_test(test_one_camera),
      cmocka_unit_test(test_nothing_new), cmocka_unit_test(test_ahead),
      cmocka_unit_test(test_track),       cmocka_unit_test(test_members),
      cmocka_unit_test(test_neighbours),  cmocka_unit_test(test_few_neighbours),
  };
  return cmocka_run_group_tests(tests, setup, NULL);
}
