// SPDX-License-Identifier: Apache-2.0
// Rigid bodies: moved places and quaternions against the definition in double, gradients of the
// bodies' poses and of their members against central differences of it, for the loss sum(weight x
// moved).
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "src/base/vec.h"
#include "src/deform/deform.h"
#include "tests/common/test.h"

#define N      40
#define N_ROWS 23
#define CAP    48
#define N_POS  2
#define T      0.4f

static _Alignas(64) unsigned char block[8 << 20];
static float weight[CAP / 16][N_ROWS][16];
static sv_kernels k;
static sv_gaussians g;
static sv_motion mo;

static void fill(float *x, int n, uint64_t seed) {
  sv_rng rng = sv_rng_make(seed, 2);
  for (int i = 0; i < n; i++) x[i] = 2 * sv_rng_f(&rng) - 1;
}

static void normalise(float q[4]) {
  float n = sqrtf(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
  for (int e = 0; e < 4; e++) q[e] /= n;
}

// Two bodies of 13 slots each, the others of none, all with motion of their own; a knot at T.
static void make(sv_arena *a) {
  const sv_motion_cfg c = {.n_pos = N_POS, .n_rot = 1, .has_grad = true, .cap_knots = 3};
  assert_int_equal(sv_gaussians_init(&g, N, 1, a), SV_OK);
  assert_int_equal(sv_motion_init(&mo, &c, &g, a), SV_OK);
  fill(g.param, CAP * N_ROWS, 9);
  fill(&weight[0][0][0], CAP * N_ROWS, 10);
  sv_motion_reset(&mo, N);
  for (int i = 0; i < N; i++)
    for (int r = SV_MROW_FUNCTIONS; r < mo.n_rows; r++)
      *sv_motion_row(&mo, i, r) = 0.1f * sinf((float)(7 * i + r));
  sv_bodies *b = &mo.bodies;
  assert_int_equal(sv_bodies_add_knot(b, T), 0);
  b->n = 3;
  for (int body = 1; body < 3; body++) {
    sv_rigid *m = sv_bodies_knot(b, body, 0);
    fill(m->q, 4, 20 + (uint64_t)body);
    fill(m->d, 3, 30 + (uint64_t)body);
    fill(b->centre[body], 3, 40 + (uint64_t)body);
    normalise(m->q);
  }
  for (int i = 0; i < N; i++) b->of[i] = (uint8_t)(i % 3);
}

// Rows 0..6 of a slot, moved by its functions, and then by its body, which is turned by w and
// shifted by s more.
static void moved(const double own[7], int body, const double w[3], const double s[3], double out[7]) {
  memcpy(out, own, 7 * sizeof *out);
  if (!body) return;
  const sv_rigid *m = sv_bodies_knot(&mo.bodies, body, 0);
  double q[4], r[9], more[9], x[3];
  for (int e = 0; e < 4; e++) q[e] = (double)m->q[e];
  sv_quat_to_mat(r, q);
  sv_rodrigues(more, w);
  sv_mul33(r, more, r);
  for (int e = 0; e < 3; e++) x[e] = own[e] - (double)mo.bodies.centre[body][e];
  sv_apply33(x, r, x);
  for (int e = 0; e < 3; e++) out[e] = x[e] + (double)mo.bodies.centre[body][e] + (double)m->d[e] + s[e];
  const double a[4] = {1, 0.5 * w[0], 0.5 * w[1], 0.5 * w[2]}; // to first order
  const double *p = own + 3;
  double b[4] = {a[0] * q[0] - a[1] * q[1] - a[2] * q[2] - a[3] * q[3],
                 a[0] * q[1] + a[1] * q[0] + a[2] * q[3] - a[3] * q[2],
                 a[0] * q[2] - a[1] * q[3] + a[2] * q[0] + a[3] * q[1],
                 a[0] * q[3] + a[1] * q[2] - a[2] * q[1] + a[3] * q[0]};
  out[3] = b[0] * p[0] - b[1] * p[1] - b[2] * p[2] - b[3] * p[3];
  out[4] = b[0] * p[1] + b[1] * p[0] + b[2] * p[3] - b[3] * p[2];
  out[5] = b[0] * p[2] - b[1] * p[3] + b[2] * p[0] + b[3] * p[1];
  out[6] = b[0] * p[3] + b[1] * p[2] - b[2] * p[1] + b[3] * p[0];
}

static void own_of(int i, double own[7]) {
  sv_motion_values f = sv_motion_values_at(&mo.cfg, T);
  for (int r = 0; r < 7; r++) {
    own[r] = (double)*sv_gaussians_at(&g, i, r);
    for (int j = 0; j < (r < 3 ? N_POS : 1); j++)
      own[r] += (double)(r < 3 ? f.pos[j] : f.rot[j]) *
                (double)*sv_motion_row(&mo, i, SV_MROW_FUNCTIONS + (r < 3 ? 3 * j + r : 3 * N_POS + r - 3));
  }
}

static double loss_of(int i, const double own[7], const double w[3], const double s[3]) {
  double out[7], sum = 0;
  moved(own, mo.bodies.of[i], w, s, out);
  for (int r = 0; r < 7; r++) sum += (double)weight[i / 16][r][i % 16] * out[r];
  return sum;
}

static void check(double is, double expected, const char *what, int i, int r) {
  if (fabs(is - expected) > 1e-3 * (0.05 + fabs(is) + fabs(expected)))
    fail_msg("%s %d, %d: %g, expected %g", what, i, r, is, expected);
}

static void check_poses(float (*sum)[6]) {
  const double h = 1e-5;
  for (int body = 0; body < 3; body++)
    for (int e = 0; e < 6; e++) {
      double up[6] = {0}, down[6] = {0}, d = 0, own[7];
      up[e] = h;
      down[e] = -h;
      for (int i = 0; i < N; i++) {
        if (mo.bodies.of[i] != body || body == 0) continue;
        own_of(i, own);
        d += (loss_of(i, own, up, up + 3) - loss_of(i, own, down, down + 3)) / (2 * h);
      }
      check((double)sum[body][e], d, "pose of body", body, e);
    }
}

static void check_members(float grad[CAP / 16][N_ROWS][16]) {
  const double h = 1e-5, none[3] = {0};
  for (int i = 0; i < N; i++)
    for (int r = 0; r < 7; r++) {
      double own[7], at;
      own_of(i, own);
      at = own[r];
      own[r] = at + h;
      double up = loss_of(i, own, none, none);
      own[r] = at - h;
      check((double)grad[i / 16][r][i % 16], (up - loss_of(i, own, none, none)) / (2 * h), "Gaussian", i, r);
    }
}

TEST(test_bodies) {
  sv_arena a = sv_arena_make(block, sizeof block);
  sv_pool pool = sv_pool_serial();
  static float grad[CAP / 16][N_ROWS][16];
  float sum[SV_CAP_BODIES][6] = {{0}};
  const double none[3] = {0};
  make(&a);
  sv_motion_at(&mo, &(sv_compute){&k, &pool}, &g, T);
  for (int i = 0; i < N; i++) {
    double own[7], out[7];
    own_of(i, own);
    moved(own, mo.bodies.of[i], none, none, out);
    for (int r = 0; r < 7; r++)
      assert_true(fabs(out[r] - (double)g.moved[sv_gaussians_at(&g, i, r) - g.param]) < 2e-5);
  }
  memcpy(grad, weight, sizeof grad);
  for (int b = 0; b < CAP / 16; b++)
    sv_bodies_carry_bwd(&mo.bodies, mo.moved, N_ROWS, b, 0xffff, &grad[b][0][0], sum);
  check_poses(sum);
  check_members(grad);
  for (int r = 7; r < N_ROWS; r++) assert_memory_equal(grad[1][r], weight[1][r], sizeof grad[1][r]);
}

int main(void) {
  sv_kernels_init(&k, ~0u);
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_bodies)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
