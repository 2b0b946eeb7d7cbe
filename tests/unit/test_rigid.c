// SPDX-License-Identifier: Apache-2.0
// Rigid bodies from displacements that one, two or two close cameras have seen to half a pixel,
// three in ten of them wrong: motions fitted to one body, and bodies found among others that touch,
// stand still or hide.
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "src/base/mathx.h"
#include "src/base/rng.h"
#include "src/base/vec.h"
#include "src/dynamic/rigid.h"
#include "tests/common/test.h"

#define CAP       4000
#define F         300.0f
#define Z         3.0f
#define TOLERANCE 1.5f
#define NOISE     0.5f
#define WRONG     0.3f
#define LEFT_OPEN 1e-4f // of the mean diagonal, as where displacements are solved for

typedef struct {
  int n;
  float at[4]; // along x; they look along z
} cameras;

static const cameras ONE = {1, {0}}, TWO = {2, {-0.4f, 0.4f}}, CLOSE = {2, {-0.05f, 0.05f}};

static sv_displaced of[CAP];
static uint8_t body[CAP], label[CAP];
static uint32_t order[CAP], list[2 * CAP];
static bool is_wrong[CAP];
static sv_rng rng;
static sv_kernels kernels;
static _Alignas(64) unsigned char block[4u << 20];

static sv_rigid motion_of(float wx, float wy, float wz, float dx, float dy,
                          float dz) { // degrees, world units
  const double w[3] = {(double)wx * SV_PI / 180, (double)wy * SV_PI / 180, (double)wz * SV_PI / 180};
  double r[9], q[4];
  sv_rodrigues(r, w);
  sv_quat_from_mat(q, r);
  return (sv_rigid){{(float)q[0], (float)q[1], (float)q[2], (float)q[3]}, {dx, dy, dz}};
}

static void pixel(float cam, const float x[3], float px[2], float jac[6]) {
  px[0] = F * (x[0] - cam) / x[2];
  px[1] = F * x[1] / x[2];
  const float j[6] = {F / x[2], 0, -px[0] / x[2], 0, F / x[2], -px[1] / x[2]};
  memcpy(jac, j, sizeof j);
}

// What the cameras tell of the way from x to y: each to NOISE pixels, or all together of somewhere
// else.
static void see(const cameras *c, sv_displaced *o, const float x[3], const float y[3], bool wrong) {
  float a[6] = {0}, b[3] = {0};
  const float off[2] = {wrong ? 30 * sv_rng_f(&rng) - 15 : 0, wrong ? 30 * sv_rng_f(&rng) - 15 : 0};
  *o = (sv_displaced){.x = {x[0], x[1], x[2]}, .is_known = true};
  for (int i = 0; i < c->n; i++) {
    float p[2], q[2], jac[6];
    pixel(c->at[i], y, q, jac);
    pixel(c->at[i], x, p, jac);
    for (int e = 0; e < 2; e++) {
      const float *g = jac + 3 * e, r = q[e] - p[e] + NOISE * sv_rng_normal(&rng) + off[e];
      for (int k = 0, m = 0; k < 3; k++) {
        for (int l = k; l < 3; l++) a[m++] += g[k] * g[l] / (float)c->n;
        b[k] += g[k] * r / (float)c->n;
      }
    }
  }
  const float ridge = LEFT_OPEN / 3 * (a[0] + a[3] + a[5]);
  a[0] += ridge;
  a[3] += ridge;
  a[5] += ridge;
  memcpy(o->a, a, sizeof a);
  assert_true(sv_solve3(a, b, o->u));
}

// n points from index `first` on, on the half of a ball that faces the cameras, or (flat) on a
// square of twice the size.
typedef struct {
  int first, n, which;
  const float *centre;
  float radius;
  bool flat;
} shape;

static void add_body(const cameras *c, const shape *s, const sv_rigid *m, float wrong) {
  const float *centre = s->centre, radius = s->radius;
  const bool flat = s->flat;
  for (int i = s->first; i < s->first + s->n; i++) {
    float x[3], y[3], z = flat ? 0 : sv_rng_f(&rng), r = sqrtf(1 - z * z);
    float along = (float)(2 * SV_PI) * sv_rng_f(&rng);
    x[0] = flat ? 2 * sv_rng_f(&rng) - 1 : r * (float)sv_cos((double)along);
    x[1] = flat ? 2 * sv_rng_f(&rng) - 1 : r * (float)sv_sin((double)along);
    x[2] = -z;
    for (int k = 0; k < 3; k++) x[k] = centre[k] + radius * x[k];
    sv_rigid_apply(m, centre, x, y);
    is_wrong[i] = sv_rng_f(&rng) < wrong;
    body[i] = (uint8_t)s->which;
    see(c, &of[i], x, y, is_wrong[i]);
    order[i] = (uint32_t)i;
  }
}

// Mean distance, seen by camera at, of where two motions take points [0, n) of a body; in space,
// too.
typedef struct {
  const sv_rigid *m;
  const float *centre;
} motion;

static float mean_off(float at, motion found, motion truth, int which, int n, float *in_space) {
  float sum = 0, count = 0;
  *in_space = 0;
  for (int i = 0; i < n; i++) {
    if (body[i] != which) continue;
    float y[3], y0[3], p[2], p0[2], jac[6];
    sv_rigid_apply(found.m, found.centre, of[i].x, y);
    sv_rigid_apply(truth.m, truth.centre, of[i].x, y0);
    pixel(at, y, p, jac);
    pixel(at, y0, p0, jac);
    sum += sqrtf((p[0] - p0[0]) * (p[0] - p0[0]) + (p[1] - p0[1]) * (p[1] - p0[1]));
    *in_space += sqrtf((y[0] - y0[0]) * (y[0] - y0[0]) + (y[1] - y0[1]) * (y[1] - y0[1]) +
                       (y[2] - y0[2]) * (y[2] - y0[2]));
    count += 1;
  }
  *in_space /= count;
  return sum / count;
}

static float degrees_off(const sv_rigid *a, const sv_rigid *b) {
  float dot = 0;
  for (int k = 0; k < 4; k++) dot += a->q[k] * b->q[k];
  return (float)(2 * 180 / SV_PI * sv_acos((double)sv_minf(fabsf(dot), 1)));
}

// --- one body ------------------------------------------------------------------------------------

static void check_fit(const char *name, const cameras *c, bool flat, float most_px, float most_degrees,
                      float most_in_space) {
  static const float centre[3] = {0.1f, -0.1f, Z};
  const sv_rigid truth = motion_of(6, 14, -9, 0.09f, -0.05f, 0.04f);
  sv_rigid m = SV_RIGID_IDENTITY;
  int agree = 0, n = 300;
  float space;
  rng = sv_rng_make(3, 0);
  add_body(c, &(shape){0, n, 1, centre, 0.25f, flat}, &truth, WRONG);
  assert_true(sv_rigid_fit(&(sv_rigid_points){of, order, n, centre}, TOLERANCE, NULL, &m, &agree));
  float px = mean_off(0, (motion){&m, centre}, (motion){&truth, centre}, 1, n, &space),
        turn = degrees_off(&m, &truth);
  print_message("%s: %.3f px, %.2f degrees, %.4f in space; %d of %d agree\n", name, (double)px, (double)turn,
                (double)space, agree, n);
  assert_true(px < most_px && turn < most_degrees && space < most_in_space);
  assert_in_range(agree, 0.55 * n, 0.75 * n);
}

TEST(test_fit) {
  check_fit("two cameras", &TWO, false, 0.2f, 0.7f, 0.004f);
  check_fit("two close cameras", &CLOSE, false, 0.2f, 0.8f, 0.015f);
  check_fit("one camera", &ONE, false, 0.2f, 1.5f, 0.04f);
  check_fit("a plane", &TWO, true, 0.2f, 3.0f, 0.01f);
  check_fit("a plane, one camera", &ONE, true, 0.2f, 4.0f, 0.04f);
}

// A start far off on purpose, with few points that agree to it: the fit leaves it.
TEST(test_fit_from_a_start) {
  static const float centre[3] = {0, 0, Z};
  const sv_rigid truth = motion_of(0, 0, 25, 0.12f, 0, 0), start = motion_of(0, 0, 20, 0.1f, 0, 0);
  sv_rigid m = start;
  float space;
  rng = sv_rng_make(4, 0);
  add_body(&TWO, &(shape){0, 200, 1, centre, 0.25f, false}, &truth, WRONG);
  assert_true(sv_rigid_fit(&(sv_rigid_points){of, order, 200, centre}, TOLERANCE, &start, &m, NULL));
  assert_true(mean_off(0, (motion){&m, centre}, (motion){&truth, centre}, 1, 200, &space) < 0.15f);
}

TEST(test_few) {
  static const float centre[3] = {0, 0, Z};
  const sv_rigid truth = motion_of(0, 0, 0, 0.05f, 0.02f, 0), before = motion_of(1, 2, 3, 4, 5, 6);
  sv_rigid m = before;
  int agree;
  rng = sv_rng_make(5, 0);
  add_body(&TWO, &(shape){0, 20, 1, centre, 0.2f, false}, &truth, 0);
  assert_false(sv_rigid_fit(&(sv_rigid_points){of, order, 2, centre}, TOLERANCE, NULL, &m, &agree));
  assert_false(sv_rigid_fit(&(sv_rigid_points){of, order, 0, centre}, TOLERANCE, NULL, &m, &agree));
  for (int i = 2; i < 20; i++) of[i].is_known = false;
  assert_false(sv_rigid_fit(&(sv_rigid_points){of, order, 20, centre}, TOLERANCE, NULL, &m, &agree));
  assert_memory_equal(&m, &before, sizeof m);
  for (int i = 2; i < 20; i++) of[i].is_known = true;
  of[4].u[0] = NAN;
  of[5].x[1] = INFINITY; // nothing follows from these: refused, not spread
  assert_false(sv_rigid_fit(&(sv_rigid_points){of, order, 20, centre}, TOLERANCE, NULL, &m, &agree));
  assert_memory_equal(&m, &before, sizeof m);
}

// Points in a line do not tell how they turned about it: they did not.
TEST(test_line) {
  static const float centre[3] = {0, 0, Z};
  const sv_rigid truth = motion_of(0, 0, 20, 0.05f, 0.02f, 0); // the line lies along x
  sv_rigid m;
  rng = sv_rng_make(6, 0);
  for (int i = 0; i < 40; i++) {
    float x[3] = {0.01f * (float)(i - 20), 0, Z}, y[3];
    sv_rigid_apply(&truth, centre, x, y);
    see(&TWO, &of[i], x, y, false);
    order[i] = (uint32_t)i;
  }
  assert_true(sv_rigid_fit(&(sv_rigid_points){of, order, 40, centre}, TOLERANCE, NULL, &m, NULL));
  assert_true(degrees_off(&m, &truth) < 2);
  assert_true(fabsf(m.q[1]) < 0.02f);
}

// --- several -------------------------------------------------------------------------------------

static int find(int n, int cap_bodies, sv_rigid *m, float centre[][3]) {
  static const float origin[3] = {0, 0, Z};
  sv_arena a = sv_arena_make(block, sizeof block);
  sv_local_motion *near = sv_local_motion_carve(CAP, &a);
  assert_non_null(near);
  memcpy(near->of, of, sizeof of);
  for (int i = 0; i < n; i++) near->order[i] = (uint32_t)i;
  sv_local_motion_find(near, &kernels, n, origin, 1.0f);
  memset(label, 0, sizeof label);
  return sv_rigid_find(&(sv_rigid_search){.of = of,
                                          .order = near->order,
                                          .label = label,
                                          .list = list,
                                          .n = n,
                                          .first_label = 1,
                                          .cap_bodies = cap_bodies,
                                          .min_members = 20,
                                          .min_px = 1,
                                          .tolerance_px = TOLERANCE,
                                          .seed = 1},
                       m, centre);
}

// Two balls that touch and turn against each other before a wall that stands still; n: Gaussians.
static const float LEFT[3] = {-0.25f, 0, Z}, RIGHT[3] = {0.25f, 0.02f, Z}, WALL[3] = {0, 0, Z + 0.5f};
static const sv_rigid STILL = {.q = {1, 0, 0, 0}};

static int two_balls(const cameras *c, sv_rigid truth[2]) {
  truth[0] = motion_of(0, 0, 15, 0.02f, 0, 0);
  truth[1] = motion_of(5, 0, -15, -0.03f, 0.02f, 0);
  rng = sv_rng_make(7, 0);
  add_body(c, &(shape){0, 300, 1, LEFT, 0.25f, false}, &truth[0], WRONG);
  add_body(c, &(shape){300, 200, 2, RIGHT, 0.25f, false}, &truth[1], WRONG);
  add_body(c, &(shape){500, 800, 0, WALL, 1.0f, true}, &STILL, 0.03f);
  for (int i = 0; i < 500; i += 10) of[i].is_known = false; // hidden
  return 1300;
}

static void check_two(const char *name, const cameras *c) {
  sv_rigid truth[2], m[6];
  float centre[6][3], space;
  int joined[3][3] = {{0}}, n = two_balls(c, truth);
  int found = find(n, 6, m, centre);
  assert_int_equal(found, 2);
  for (int i = 0; i < n; i++) joined[body[i]][label[i]]++;
  print_message(
      "%s: of the left ball %d, %d, %d to no body, the first, the second; of the right %d, %d, %d; of the "
      "wall %d, %d, %d\n",
      name, joined[1][0], joined[1][1], joined[1][2], joined[2][0], joined[2][1], joined[2][2], joined[0][0],
      joined[0][1], joined[0][2]);
  for (int b = 1; b <= 2; b++) {
    const float *at = b == 1 ? LEFT : RIGHT;
    float px = mean_off(0, (motion){&m[b - 1], centre[b - 1]}, (motion){&truth[b - 1], at}, b, n, &space);
    print_message("  ball %d: %.3f px, %.2f degrees\n", b, (double)px,
                  (double)degrees_off(&m[b - 1], &truth[b - 1]));
    assert_true(px < 0.3f && degrees_off(&m[b - 1], &truth[b - 1]) < 1.5f);
    assert_true(joined[b][b] > 0.85f * (float)(b == 1 ? 300 : 200));
    assert_true(joined[b][3 - b] < 0.06f * (float)(b == 1 ? 300 : 200));
  }
  assert_true(joined[0][1] + joined[0][2] < 10);
}

TEST(test_two_that_touch) {
  check_two("two cameras", &TWO);
  check_two("two close cameras", &CLOSE);
  check_two("one camera", &ONE);
}

// Two alike that do not touch and go the same way: two bodies, as later they may not.
TEST(test_two_distant) {
  const sv_rigid truth = motion_of(0, 0, 0, 0.06f, 0, 0);
  sv_rigid m[6];
  float centre[6][3];
  rng = sv_rng_make(8, 0);
  add_body(&TWO, &(shape){0, 300, 1, LEFT, 0.1f, false}, &truth, WRONG);
  add_body(&TWO, &(shape){300, 300, 2, RIGHT, 0.1f, false}, &truth, WRONG);
  assert_int_equal(find(600, 6, m, centre), 2);
  for (int i = 0; i < 600; i++) assert_true(!label[i] || label[i] % 2 == label[0] % 2 || body[i] == 2);
  for (int b = 0; b < 2; b++) assert_true(fabsf(fabsf(centre[b][0]) - 0.25f) < 0.02f);
}

TEST(test_none) {
  sv_rigid m[2];
  float centre[2][3];
  rng = sv_rng_make(9, 0);
  add_body(&TWO, &(shape){0, 1000, 0, WALL, 1.0f, true}, &STILL, 0); // nothing moves
  assert_int_equal(find(1000, 2, m, centre), 0);
  add_body(&TWO, &(shape){0, 1000, 0, WALL, 1.0f, true}, &STILL, 1); // each its own way
  assert_int_equal(find(1000, 2, m, centre), 0);
  assert_int_equal(find(0, 2, m, centre), 0);
  for (int i = 0; i < 1000; i++) of[i].is_known = false;
  assert_int_equal(find(1000, 2, m, centre), 0);
  for (int i = 0; i < 1000; i++) assert_int_equal(label[i], 0);
}

// No more than are asked for, and those of a body before keep it.
TEST(test_room) {
  sv_rigid truth[2], m[1];
  float centre[1][3];
  int n = two_balls(&TWO, truth);
  assert_int_equal(find(n, 1, m, centre), 1);
  for (int i = 0; i < n; i++) assert_true(label[i] <= 1);
  uint8_t before[CAP];
  memcpy(before, label, sizeof before);
  sv_rigid_search again = {.of = of,
                           .order = order,
                           .label = label,
                           .list = list,
                           .n = n,
                           .first_label = 9,
                           .cap_bodies = 1,
                           .min_members = 20,
                           .min_px = 1,
                           .tolerance_px = TOLERANCE};
  assert_int_equal(sv_rigid_find(&again, m, centre), 1);
  for (int i = 0; i < n; i++) assert_true(before[i] ? label[i] == before[i] : label[i] == 0 || label[i] == 9);
}

TEST(test_same_again) {
  static uint8_t first[CAP];
  sv_rigid truth[2], m[6], m2[6];
  float centre[6][3], centre2[6][3];
  int n = two_balls(&TWO, truth), found = find(n, 6, m, centre);
  memcpy(first, label, sizeof first);
  memset(list, 0xa5, sizeof list);
  assert_int_equal(find(n, 6, m2, centre2), found);
  assert_memory_equal(first, label, sizeof first);
  assert_memory_equal(m, m2, (size_t)found * sizeof *m);
  assert_memory_equal(centre, centre2, (size_t)found * sizeof *centre);
}

FIXTURE(setup) {
  sv_kernels_init(&kernels, ~0u);
  return 0;
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_fit),
      cmocka_unit_test(test_fit_from_a_start),
      cmocka_unit_test(test_few),
      cmocka_unit_test(test_line),
      cmocka_unit_test(test_two_that_touch),
      cmocka_unit_test(test_two_distant),
      cmocka_unit_test(test_none),
      cmocka_unit_test(test_room),
      cmocka_unit_test(test_same_again),
  };
  return cmocka_run_group_tests(tests, setup, NULL);
}
