// SPDX-License-Identifier: Apache-2.0
#include <math.h>
#include <string.h>

#include "tests/kernels/parameter_rows.h"

// --- the probe ----------------------------------------

static void check_probe(ck *c) {
  enum { N_ROWS_OF_PLANE = 5, ROW0 = 1, ROW1 = 4 };
  for (int width = 1; width < 100; width++) {
    ck_begin(c, "width %d", width);
    const int stride = (width + 15) / 16 * 16;
    const size_t n = (size_t)stride * N_ROWS_OF_PLANE;
    sv_probe_args a = {ck_floats(c, n), width, stride, ROW0, ROW1, 0.25f, 77u + (uint32_t)width}, b = a;
    b.plane = ck_floats(c, n);
    memset(a.plane, 0, n * sizeof *a.plane);
    memset(b.plane, 0, n * sizeof *b.plane);
    c->ref.probe(&a);
    c->var.probe(&b);
    ck_same(c, "plane", a.plane, b.plane, n, 0);
    for (size_t i = 0; i < n; i++) {
      bool is_in = i >= (size_t)(ROW0 * stride) && i < (size_t)(ROW1 * stride) && (int)i % stride < width;
      ck_true(c, fabsf(b.plane[i]) == (is_in ? 0.25f : 0.0f), "%g at %zu", (double)b.plane[i], i);
    }
  }
}

// Signs that do not know of each other: as many plus as minus, and neighbours, rows and keys that
// agree half the time.
static void check_signs(ck *c) {
  enum { SIDE = 512 };
  static const float limit = 4.0f / SIDE; // four standard deviations of a mean of SIDE^2 signs
  ck_begin(c, "statistics of the signs");
  sv_probe_args a = {ck_floats(c, SIDE * SIDE), SIDE, SIDE, 0, SIDE, 1.0f, 5}, b = a;
  b.plane = ck_floats(c, SIDE * SIDE);
  b.key = 6;
  c->var.probe(&a);
  c->var.probe(&b);
  const int shift[] = {1, 16, 32, SIDE, SIDE + 1, 7 * SIDE};
  double sum = 0, keys = 0;
  for (int i = 0; i < SIDE * SIDE; i++) {
    sum += (double)a.plane[i];
    keys += (double)(a.plane[i] * b.plane[i]);
  }
  ck_true(c, fabs(sum) < (double)(limit * SIDE * SIDE), "the sum is %g", sum);
  ck_true(c, fabs(keys) < (double)(limit * SIDE * SIDE), "two keys agree by %g", keys);
  for (size_t k = 0; k < sizeof shift / sizeof *shift; k++) {
    double same = 0;
    for (int i = 0; i + shift[k] < SIDE * SIDE; i++) same += (double)(a.plane[i] * a.plane[i + shift[k]]);
    ck_true(c, fabs(same) < (double)(limit * SIDE * SIDE), "signs %d apart agree by %g", shift[k], same);
  }
}

static void check_probe_all(ck *c) {
  check_probe(c);
  check_signs(c);
}

static void run_probe(void *arg, const sv_kernels *k) { k->probe(arg); }

static void bench_probe(ck *c) {
  ck_begin(c, "bench");
  sv_probe_args a = {ck_floats(c, 320 * 240), 320, 320, 0, 240, 1.0f, 1};
  ck_time(c, "320x240; per pixel", 320 * 240, run_probe, &a);
}

CK_REGISTER(probe, check_probe_all, bench_probe)

// --- the running mean ----------------------------------------

// Curvature of n_rows rows; some parameters have none yet. A mean's coordinates are coupled by at
// most 0.9, so that what rounding leaves of a pivot does not decide the step.
static sv_curvatures make_curvatures(ck *c, int n_rows, int fill) {
  const size_t n = 16 * (size_t)n_rows;
  float *diag = ck_floats(c, n), *cross = ck_floats(c, 48);
  ck_fill(c, diag, n, fill);
  ck_fill(c, cross, 48, CK_SIGNED);
  for (size_t i = 0; i < n; i++) diag[i] = i % 7 ? fabsf(diag[i]) : 0.0f;
  for (size_t i = 0; i < 48; i++) {
    const float *a = diag + (i < 32 ? 0 : 16) + i % 16, *b = diag + (i < 16 ? 16 : 32) + i % 16;
    cross[i] = 0.9f * fmaxf(fminf(cross[i], 1.0f), -1.0f) * sqrtf(*a * *b);
  }
  return (sv_curvatures){ck_highs(c, diag, n), ck_highs(c, cross, 48)};
}

static sv_curvatures copy_curvatures(ck *c, const sv_curvatures *from, int n_rows) {
  const size_t n = 16 * (size_t)n_rows;
  return (sv_curvatures){ck_highs(c, ck_wide(c, from->diag, n), n),
                         ck_highs(c, ck_wide(c, from->cross, 48), 48)};
}

typedef struct {
  float *x, *products; // products: NULL, or x are squares
  sv_curvatures c;
  uint32_t touched;
  int n_rows;
} curvature_job;

static curvature_job make_curvature(ck *c, int n_rows, int fill, uint32_t touched) {
  const size_t n = 16 * (size_t)n_rows;
  curvature_job j = {
      .x = ck_floats(c, n), .c = make_curvatures(c, n_rows, fill), .touched = touched, .n_rows = n_rows};
  ck_fill(c, j.x, n, fill);
  if (n_rows % 2) {
    j.products = ck_floats(c, 48);
    ck_fill(c, j.products, 48, CK_SIGNED);
    for (size_t i = 0; i < n; i++) j.x[i] = fabsf(j.x[i]);
  }
  return j;
}

static void check_curvature_rows(ck *c, int n_rows, int fill, uint32_t touched) {
  if (n_rows < SV_ROW_QUAT) return; // no means
  const size_t n = 16 * (size_t)n_rows;
  curvature_job j = make_curvature(c, n_rows, fill, touched);
  const sv_curvatures a = copy_curvatures(c, &j.c, n_rows), b = copy_curvatures(c, &j.c, n_rows);
  c->ref.curvature(0.9f, n_rows, touched, j.x, j.products, &a);
  c->var.curvature(0.9f, n_rows, touched, j.x, j.products, &b);
  ck_same(c, "diag", ck_wide(c, a.diag, n), ck_wide(c, b.diag, n), n, CK_HIGH_TOL);
  ck_same(c, "cross", ck_wide(c, a.cross, 48), ck_wide(c, b.cross, 48), 48, CK_HIGH_TOL);
  ck_untouched(c, touched, ck_wide(c, j.c.diag, n), ck_wide(c, b.diag, n), n);
  ck_untouched(c, touched, ck_wide(c, j.c.cross, 48), ck_wide(c, b.cross, 48), 48);
}

static void check_curvature(ck *c) { ck_each_rows(c, check_curvature_rows); }

static void run_curvature(void *arg, const sv_kernels *k) {
  curvature_job *j = arg;
  k->curvature(0.9f, j->n_rows, j->touched, j->x, NULL, &j->c);
}

static void bench_curvature(ck *c) {
  ck_begin(c, "bench");
  curvature_job j = make_curvature(c, 23, CK_UNIT, 0xffff);
  ck_time(c, "23 rows; per Gaussian", 16, run_curvature, &j);
}

CK_REGISTER(curvature, check_curvature, bench_curvature)

// --- the step ----------------------------------------

typedef struct {
  float *cap, *damping, *grad, *p;
  sv_curvatures c;
  uint16_t *m;
  sv_newton_args args;
  uint32_t touched;
} newton_job;

static newton_job make_newton(ck *c, int n_rows, int fill, uint32_t touched) {
  size_t n = 16 * (size_t)n_rows;
  newton_job j = {.cap = ck_floats(c, (size_t)n_rows),
                  .damping = ck_floats(c, (size_t)n_rows),
                  .grad = ck_floats(c, n),
                  .p = ck_floats(c, n),
                  .c = make_curvatures(c, n_rows, fill),
                  .touched = touched};
  float *m = ck_floats(c, n);
  for (int i = 0; i < n_rows; i++) {
    j.cap[i] = 1e-2f * (float)(1 + i % 7);
    j.damping[i] = 0.3f * (float)(1 + i % 4);
  }
  ck_fill(c, j.grad, n, fill);
  ck_fill(c, j.p, n, CK_SIGNED);
  ck_fill(c, m, n, fill);
  j.m = ck_highs(c, m, n);
  j.args = (sv_newton_args){
      .beta1 = 0.9f, .rate = 0.1f, .damping = j.damping, .cap_mean = 0.02f, .cap = j.cap, .n_rows = n_rows};
  return j;
}

static void check_newton_rows(ck *c, int n_rows, int fill, uint32_t touched) {
  if (n_rows < SV_ROW_LOGIT) return; // no scales
  size_t n = 16 * (size_t)n_rows;
  newton_job j = make_newton(c, n_rows, fill, touched);
  float *p = ck_copy(c, j.p, n), *q = ck_copy(c, j.p, n);
  const float *before = ck_wide(c, j.m, n);
  uint16_t *m = ck_highs(c, before, n);
  c->ref.newton(&j.args, j.touched, j.grad, &j.c, p, m);
  c->var.newton(&j.args, j.touched, j.grad, &j.c, q, j.m);
  ck_same(c, "p", p, q, n, 1e-5);
  ck_same(c, "m", ck_wide(c, m, n), ck_wide(c, j.m, n), n, CK_HIGH_TOL);
  ck_untouched(c, touched, j.p, q, n);
  ck_untouched(c, touched, before, ck_wide(c, j.m, n), n);
  for (size_t i = 16 * SV_ROW_QUAT; i < n; i++) {
    ck_true(c, j.c.diag[i] > 0 || q[i] == j.p[i], "lane %zu of row %zu moved", i % 16, i / 16);
    ck_true(c, fabsf(q[i] - j.p[i]) <= 1.001f * j.cap[i / 16] + 1e-6f * fabsf(j.p[i]),
            "lane %zu of row %zu moved too far", i % 16, i / 16);
  }
  for (size_t k = 0; k < 16; k++) {
    const float *s = j.p + 16 * SV_ROW_SCALE + k, x = q[k] - j.p[k], y = q[16 + k] - j.p[16 + k],
                z = q[32 + k] - j.p[32 + k], cap = j.args.cap_mean * expf((s[0] + s[16] + s[32]) / 3);
    const bool has_all = j.c.diag[k] > 0 && j.c.diag[16 + k] > 0 && j.c.diag[32 + k] > 0;
    ck_true(c, has_all || x * x + y * y + z * z == 0, "the mean of lane %zu moved", k);
    ck_true(c, sqrtf(x * x + y * y + z * z) <= 1.001f * cap + 1e-5f, "the mean of lane %zu moved too far", k);
  }
}

// Against the inverse by cofactors, in double precision: a step that no cap shortens.
static void check_solve(ck *c) {
  ck_begin(c, "the matrix of a mean");
  newton_job j = make_newton(c, SV_ROW_LOGIT, CK_UNIT, 0xffff);
  float *p = ck_copy(c, j.p, 16 * SV_ROW_LOGIT);
  float *m = ck_wide(c, j.m, 16 * SV_ROW_LOGIT), *d = ck_wide(c, j.c.diag, 48),
        *x = ck_wide(c, j.c.cross, 48);
  double ridge = 0;
  for (int i = 0; i < 48; i++) ridge += (double)j.damping[0] * (double)d[i] / 48;
  j.args.cap_mean = 1e6f;
  c->var.newton(&j.args, 0xffff, j.grad, &j.c, p, j.m);
  for (int k = 0; k < 16; k++) {
    if (!(d[k] > 0 && d[16 + k] > 0 && d[32 + k] > 0)) continue;
    const double a = (double)d[k] + ridge, b = (double)d[16 + k] + ridge, e = (double)d[32 + k] + ridge;
    const double xy = (double)x[k], xz = (double)x[16 + k], yz = (double)x[32 + k];
    const double inverse[3][3] = {{b * e - yz * yz, xz * yz - xy * e, xy * yz - xz * b},
                                  {xz * yz - xy * e, a * e - xz * xz, xy * xz - a * yz},
                                  {xy * yz - xz * b, xy * xz - a * yz, a * b - xy * xy}};
    const double det = a * inverse[0][0] + xy * inverse[1][0] + xz * inverse[2][0];
    double g[3];
    for (int i = 0; i < 3; i++)
      g[i] = 0.1 * (0.9 * (double)m[16 * i + k] + (1 - 0.9) * (double)j.grad[16 * i + k]);
    if (det < 0.05 * a * b * e) continue; // the least pivot
    for (int i = 0; i < 3; i++) {
      const double step = (inverse[i][0] * g[0] + inverse[i][1] * g[1] + inverse[i][2] * g[2]) / det;
      const double got = (double)j.p[16 * i + k] - (double)p[16 * i + k];
      ck_true(c, fabs(got - step) < 1e-4 * (fabs(step) + 1), "coordinate %d of lane %d: %g, not %g", i, k,
              got, step);
    }
  }
}

// Means alone: the same steps, and all else stays.
static void check_means_alone(ck *c) {
  ck_begin(c, "means alone");
  const size_t n = 16 * SV_ROW_LOGIT, n_means = 16 * SV_ROW_QUAT;
  newton_job j = make_newton(c, SV_ROW_LOGIT, CK_UNIT, 0xffff);
  float *p = ck_copy(c, j.p, n), *q = ck_copy(c, j.p, n);
  uint16_t *m = ck_highs(c, ck_wide(c, j.m, n), n);
  c->ref.newton(&j.args, j.touched, j.grad, &j.c, p, m);
  j.args.n_rows = SV_ROW_QUAT;
  c->var.newton(&j.args, j.touched, j.grad, &j.c, q, j.m);
  ck_same(c, "means", p, q, n_means, 1e-5);
  ck_true(c, !memcmp(q + n_means, j.p + n_means, (n - n_means) * sizeof *q), "another parameter moved");
}

static void check_newton(ck *c) {
  ck_each_rows(c, check_newton_rows);
  check_means_alone(c);
  check_solve(c);
}

static void run_newton(void *arg, const sv_kernels *k) {
  newton_job *j = arg;
  k->newton(&j->args, j->touched, j->grad, &j->c, j->p, j->m);
}

static void bench_newton(ck *c) {
  ck_begin(c, "bench");
  newton_job a = make_newton(c, 59, CK_SIGNED, 0xffff), b = make_newton(c, 14, CK_SIGNED, 0xffff);
  ck_time(c, "59 rows; per Gaussian", 16, run_newton, &a);
  ck_time(c, "14 rows; per Gaussian", 16, run_newton, &b);
}

CK_REGISTER(newton, check_newton, bench_newton)
