// SPDX-License-Identifier: Apache-2.0
// Motion and deformation field: values against formulas in double, gradients against central
// differences of these, for the loss sum(weight x moved).
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "src/deform/deform.h"
#include "tests/common/test.h"

#define N       40
#define N_ROWS  23
#define CAP     48
#define N_POS   3
#define N_ROT   2
#define N_COL   2
#define N_MROWS SV_N_MROWS(N_POS, N_ROT, N_COL)

static _Alignas(64) unsigned char block[32 << 20];
static float weight[CAP / 16][N_ROWS][16];
static sv_kernels k;
static sv_gaussians g;

static void make_gaussians(sv_arena *a) {
  sv_rng rng = sv_rng_make(9, 2);
  assert_int_equal(sv_gaussians_init(&g, N, 1, a), SV_OK);
  for (int i = 0; i < CAP * N_ROWS; i++) g.param[i] = 2 * sv_rng_f(&rng) - 1;
  for (int i = 0; i < CAP * N_ROWS; i++) (&weight[0][0][0])[i] = 2 * sv_rng_f(&rng) - 1;
}

static double relative(double a, double b) { return fabs(a - b) / (0.05 + fabs(a) + fabs(b)); }

// --- motion --------------------------------------------------------------------------------------

// Row r of slot i at time t, from the definition.
static double moved(const double *m, const sv_motion_cfg *c, const float *p, int r, double t) {
  sv_motion_values f = sv_motion_values_at(c, (float)t);
  double v = (double)p[16 * r];
  if (r < 3)
    for (int j = 0; j < N_POS; j++) v += (double)f.pos[j] * m[2 + 3 * j + r];
  else if (r < 7)
    for (int j = 0; j < N_ROT; j++) v += (double)f.rot[j] * m[2 + 3 * N_POS + 4 * j + r - 3];
  else if (r == SV_ROW_LOGIT) v -= fmin(exp(m[1]) * (t - m[0]) * (t - m[0]), (double)SV_WINDOW_MAX);
  else if (r >= SV_ROW_SH && r < SV_ROW_SH + 3)
    for (int j = 0; j < N_COL; j++)
      v += (double)f.colour[j] * m[2 + 3 * N_POS + 4 * N_ROT + 3 * j + r - SV_ROW_SH];
  return v;
}

static double motion_loss(const double *m, const sv_motion_cfg *c, int i, double t, const sv_motion_args *a) {
  double sum = 0, len[3] = {0};
  for (int r = 0; r < N_ROWS; r++)
    sum += (double)weight[i / 16][r][i % 16] * moved(m, c, sv_gaussians_at(&g, i, 0), r, t);
  for (int r = 2; r < N_MROWS; r++)
    len[r < 2 + 3 * N_POS ? 0 : r < 2 + 3 * N_POS + 4 * N_ROT ? 1 : 2] += m[r] * m[r];
  return sum + (double)a->reg_pos * sqrt(len[0]) + (double)a->reg_rot * sqrt(len[1]) +
         (double)a->reg_col * sqrt(len[2]);
}

static void check_motion(sv_motion_functions_kind kind, float t) {
  sv_arena a = sv_arena_make(block, sizeof block);
  sv_motion mo;
  sv_pool pool = sv_pool_serial();
  sv_rng rng = sv_rng_make(1, 1);
  sv_motion_cfg c = {.functions = kind, .n_pos = N_POS, .n_rot = N_ROT, .n_colour = N_COL, .t0 = 0.3f};
  make_gaussians(&a);
  assert_int_equal(sv_motion_init(&mo, &c, &g, &a), SV_OK);
  sv_motion_reset(&mo, N);
  for (int i = 0; i < N; i++)
    for (int r = 0; r < N_MROWS; r++)
      *sv_motion_row(&mo, i, r) = r == SV_MROW_SHARPNESS ? 6 * sv_rng_f(&rng) - 2 : 2 * sv_rng_f(&rng) - 1;
  sv_motion_at(&mo, &(sv_compute){&k, &pool}, &g, t);
  sv_motion_values f = sv_motion_values_at(&c, t);
  sv_motion_args args = sv_motion_args_of(&mo, &g, t, &f);
  args.reg_pos = 0.1f;
  args.reg_rot = 0.2f;
  args.reg_col = 0.3f;
  for (int i = 0; i < N; i++) {
    float grad[N_MROWS * 16];
    double m[N_MROWS];
    k.motion_bwd(&args, i / 16, 1u << (i % 16), &weight[i / 16][0][0], grad);
    for (int r = 0; r < N_MROWS; r++) m[r] = (double)*sv_motion_row(&mo, i, r);
    for (int r = 0; r < N_ROWS; r++)
      assert_true(fabs(moved(m, &c, sv_gaussians_at(&g, i, 0), r, (double)t) -
                       (double)g.moved[sv_gaussians_at(&g, i, r) - g.param]) < 2e-5);
    for (int r = 0; r < N_MROWS; r++) {
      double keep = m[r], h = 1e-5;
      m[r] = keep + h;
      double up = motion_loss(m, &c, i, (double)t, &args);
      m[r] = keep - h;
      double d = (up - motion_loss(m, &c, i, (double)t, &args)) / (2 * h);
      m[r] = keep;
      if (relative(d, (double)grad[16 * r + i % 16]) > 1e-3)
        fail_msg("Gaussian %d row %d: %g, expected %g", i, r, (double)grad[16 * r + i % 16], d);
    }
  }
}

TEST(test_motion) {
  check_motion(SV_MOTION_CHEBYSHEV, 0.37f);
  check_motion(SV_MOTION_POWERS, 0.9f);
}

// --- field ---------------------------------------------------------------------------------------

static const int axes[6][2] = {{0, 1}, {0, 2}, {0, 3}, {1, 2}, {1, 3}, {2, 3}};
static sv_field field;
static double param[200000]; // a copy of the field's in double

static double sample(int l, int p, int ch, const double c[4]) {
  int res[2], n_f = field.cfg.n_channels, at[2];
  double u[2];
  for (int i = 0; i < 2; i++) {
    res[i] = axes[p][i] == 3 ? field.cfg.n_times : field.cfg.base * field.cfg.mult[l];
    double x = fmin(fmax(c[axes[p][i]] * (res[i] - 1), 0), res[i] - 1);
    at[i] = (int)fmin(floor(x), res[i] - 2);
    u[i] = x - at[i];
  }
  const double *q = param + field.plane_at[l][p] + (size_t)((at[1] * res[0] + at[0]) * n_f + ch);
  return (1 - u[1]) * ((1 - u[0]) * q[0] + u[0] * q[n_f]) +
         u[1] * ((1 - u[0]) * q[res[0] * n_f] + u[0] * q[(res[0] + 1) * n_f]);
}

typedef struct {
  size_t w, b; // offsets of weights and biases
  int n_in, n_out;
} layer;

static void linear(layer l, const double *x, double *y, bool is_relu) {
  for (int o = 0; o < l.n_out; o++) {
    y[o] = param[l.b + (size_t)o];
    for (int i = 0; i < l.n_in; i++)
      y[o] += param[l.w + (size_t)(o * l.n_in + i)] * (is_relu ? fmax(x[i], 0) : x[i]);
  }
}

// One Gaussian's share of the loss, with its mean given.
static double field_loss(int i, const double mean[3], double t) {
  double c[4], feature[128], h[128], h2[128], out[64], sum = 0;
  int n_f = field.cfg.n_channels, w = field.cfg.width;
  for (int d = 0; d < 3; d++) c[d] = (mean[d] - (double)field.lo[d]) * (double)field.inv[d];
  c[3] = t;
  for (int l = 0; l < field.cfg.n_levels; l++)
    for (int ch = 0; ch < n_f; ch++) {
      feature[l * n_f + ch] = 1;
      for (int p = 0; p < 6; p++) feature[l * n_f + ch] *= sample(l, p, ch, c);
    }
  linear((layer){field.trunk_w, field.trunk_b, field.n_feature, w}, feature, h, false);
  for (int hd = 0; hd < field.n_heads; hd++) {
    const sv_field_head *o = &field.head[hd];
    linear((layer){o->w1, o->b1, w, w}, h, h2, true);
    linear((layer){o->w2, o->b2, w, o->n}, h2, out, true);
    for (int r = 0; r < o->n; r++) sum += (double)weight[i / 16][o->row + r][i % 16] * out[r];
  }
  for (int r = 0; r < N_ROWS; r++)
    sum += (double)weight[i / 16][r][i % 16] * (r < 3 ? mean[r] : (double)*sv_gaussians_at(&g, i, r));
  return sum;
}

static double all_loss(double t) {
  double sum = 0;
  for (int i = 0; i < N; i++) {
    double mean[3];
    for (int d = 0; d < 3; d++) mean[d] = (double)*sv_gaussians_at(&g, i, d);
    sum += field_loss(i, mean, t);
  }
  return sum;
}

// dL/d param[at], at inside plane p of level l or inside the layers, as the step sees it.
static double analytic(size_t at, int l, int p) {
  static float grad[200000];
  if (at >= field.n_planes) return (double)field.layers[at - field.n_planes];
  sv_planes_args a = {.n_vec = field.cfg.n_channels / 16, .n_levels = field.cfg.n_levels};
  for (int i = 0; i < a.n_levels; i++)
    for (int d = 0; d < 4; d++) a.res[i][d] = d == 3 ? field.cfg.n_times : field.cfg.base * field.cfg.mult[i];
  memset(grad, 0, field.plane_n[l][p] * sizeof *grad);
  for (int b = 0; b < CAP / 16; b++)
    k.planes_add(&a, l, p,
                 &(sv_planes_block){field.coord + 64 * b,
                                    field.part + (size_t)b * 96 * (size_t)field.n_feature, field.touched[b]},
                 grad);
  return (double)grad[at - field.plane_at[l][p]];
}

static void check_param(size_t at, int l, int p, float t, int *n_kinks) {
  double keep = param[at], h = 1e-4, d[2];
  for (int i = 0; i < 2; i++) {
    param[at] = keep + h / (i + 1);
    double up = all_loss((double)t);
    param[at] = keep - h / (i + 1);
    d[i] = (up - all_loss((double)t)) / (2 * h / (i + 1));
    param[at] = keep;
  }
  double v = analytic(at, l, p);
  if (relative(d[0], d[1]) > 1e-4) (*n_kinks)++; // a ReLU switches between the two
  else if (relative(d[1], v) > 2e-3)
    fail_msg("parameter %zu (level %d plane %d): %g, expected %g", at, l, p, v, d[1]);
}

static void check_field(bool is_shared, bool has_colour, int n_channels, int n_levels) {
  sv_arena a = sv_arena_make(block, sizeof block);
  sv_pool pool = sv_pool_serial();
  sv_field_cfg c = {.n_channels = n_channels,
                    .n_levels = n_levels,
                    .mult = {1, 2},
                    .base = 6,
                    .n_times = 5,
                    .width = 32,
                    .is_shared = is_shared,
                    .has_colour = has_colour,
                    .start = 1,
                    .has_grad = true,
                    .n_threads = 1};
  const float t = 0.4f;
  int n_kinks = 0, n_mean = 0;
  make_gaussians(&a);
  assert_int_equal(sv_field_init(&field, &c, &g, &a), SV_OK);
  assert_true(field.n_param < sizeof param / sizeof *param);
  sv_field_reset(&field, &g, 5);
  sv_rng rng = sv_rng_make(4, 4);
  for (size_t i = 0; i < field.n_planes; i++) field.param[i] = 0.6f + 0.8f * sv_rng_f(&rng);
  for (size_t i = 0; i < field.n_param; i++) param[i] = (double)field.param[i];
  field.n_moving = N;
  sv_field_at(&field, &(sv_compute){&k, &pool}, &g, t);
  double loss = 0;
  for (int i = 0; i < N; i++)
    for (int r = 0; r < N_ROWS; r++)
      loss += (double)weight[i / 16][r][i % 16] * (double)g.moved[sv_gaussians_at(&g, i, r) - g.param];
  assert_true(fabs(loss - all_loss((double)t)) < 1e-3);
  for (int b = 0; b < CAP / 16; b++) {
    float grad[N_ROWS * 16];
    memcpy(grad, weight[b], sizeof grad);
    sv_field_bwd_block(&field, &k, b, 0, 0xffff, grad);
    for (int i = 16 * b; i < N && i < 16 * b + 16; i++)
      for (int d = 0; d < 3; d++) {
        double mean[3], h = 1e-5;
        for (int e = 0; e < 3; e++) mean[e] = (double)*sv_gaussians_at(&g, i, e);
        mean[d] += h;
        double up = field_loss(i, mean, (double)t);
        mean[d] -= 2 * h;
        double q = (up - field_loss(i, mean, (double)t)) / (2 * h);
        if (relative(q, (double)grad[16 * d + i % 16]) > 5e-3) n_mean++;
      }
  }
  for (int l = 0; l < n_levels; l++)
    for (int p = 0; p < 6; p++)
      for (int i = 0; i < 40; i++)
        check_param(field.plane_at[l][p] + sv_rng_below(&rng, (uint32_t)field.plane_n[l][p]), l, p, t,
                    &n_kinks);
  for (int i = 0; i < 300; i++)
    check_param(field.n_planes + sv_rng_below(&rng, (uint32_t)(field.n_param - field.n_planes)), 0, 0, t,
                &n_kinks);
  print_message("left out: %d means, %d parameters\n", n_mean, n_kinks);
  // where a ReLU or a cell of the grid changes between the steps
  assert_true(n_mean < 6 && n_kinks < 40);
}

TEST(test_field) {
  check_field(true, false, 16, 1);
  check_field(false, false, 32, 2);
  check_field(false, true, 16, 2);
}

// Plane losses are quadratic but for the distance from 1: differences are exact up to rounding.
TEST(test_plane_losses) {
  sv_arena a = sv_arena_make(block, sizeof block);
  static float grad[20000];
  sv_rng rng = sv_rng_make(4, 4);
  make_gaussians(&a);
  sv_field_cfg c = {.n_channels = 16,
                    .n_levels = 1,
                    .mult = {1},
                    .base = 5,
                    .n_times = 6,
                    .width = 16,
                    .is_shared = true,
                    .tv = 3,
                    .smooth = 2,
                    .l1_time = 0.5f,
                    .n_threads = 1};
  assert_int_equal(sv_field_init(&field, &c, &g, &a), SV_OK);
  sv_field_reset(&field, &g, 5);
  // away from 1
  for (size_t i = 0; i < field.n_planes; i++) field.param[i] = 1.4f + 0.3f * sv_rng_f(&rng);
  for (int p = 0; p < 6; p++) {
    memset(grad, 0, sizeof grad);
    sv_field_plane_loss_bwd(&field, 0, p, grad);
    assert_true(sv_field_plane_loss(&field, 0, p) > 0);
    for (int i = 0; i < 60; i++) {
      size_t at = sv_rng_below(&rng, (uint32_t)field.plane_n[0][p]);
      float *x = field.param + field.plane_at[0][p] + at, keep = *x, up_x = keep + 0.05f,
            down_x = keep - 0.05f;
      *x = up_x;
      double up = sv_field_plane_loss(&field, 0, p);
      *x = down_x;
      double d = (up - sv_field_plane_loss(&field, 0, p)) / ((double)up_x - (double)down_x);
      *x = keep;
      assert_true(fabs(d - (double)grad[at]) < 1e-5);
    }
  }
}

FIXTURE(setup) {
  sv_kernels_init(&k, ~0u);
  return 0;
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_motion), cmocka_unit_test(test_field),
                                     cmocka_unit_test(test_plane_losses)};
  return cmocka_run_group_tests(tests, setup, NULL);
}
