// SPDX-License-Identifier: Apache-2.0
#include "tests/kernels/parameter_rows.h"

typedef struct {
  float *lr, *grad, *p;
  uint16_t *m, *v;
  sv_adam_args args;
  uint32_t touched;
} adam_job;

static adam_job make_job(ck *c, int n_rows, int fill, uint32_t touched) {
  size_t n = 16 * (size_t)n_rows;
  adam_job j = {ck_floats(c, (size_t)n_rows), ck_floats(c, n), ck_floats(c, n), .touched = touched};
  float *m = ck_floats(c, n), *v = ck_floats(c, n);
  for (int i = 0; i < n_rows; i++) j.lr[i] = 1e-4f * (float)(1 + i % 7);
  ck_fill(c, j.grad, n, fill);
  ck_fill(c, j.p, n, CK_SIGNED);
  ck_fill(c, m, n, fill);
  ck_fill(c, v, n, CK_UNIT);
  // a first step; a settled one
  for (size_t i = 0; i < n; i += 3) v[i] = i % 2 ? 0.0f : m[i] * m[i];
  for (size_t i = 0; i < n; i += 6) m[i] = 0.0f;
  j.m = ck_highs(c, m, n);
  j.v = ck_highs(c, v, n);
  j.args = (sv_adam_args){.beta1 = 0.9f,
                          .beta2 = 0.999f,
                          .eps = 1e-15f,
                          .rsqrt_bias2 = 31.6f,
                          .lr = j.lr,
                          .n_rows = n_rows,
                          .step = (uint32_t)n_rows + 77 * touched};
  return j;
}

static void check_rows(ck *c, int n_rows, int fill, uint32_t touched) {
  size_t n = 16 * (size_t)n_rows;
  adam_job a = make_job(c, n_rows, fill, touched), b = a;
  const float *before = ck_copy(c, a.p, n), *m = ck_wide(c, a.m, n), *v = ck_wide(c, a.v, n);
  b.p = ck_copy(c, a.p, n);
  b.m = ck_highs(c, m, n);
  b.v = ck_highs(c, v, n);
  c->ref.adam(&a.args, a.touched, a.grad, a.p, a.m, a.v);
  c->var.adam(&b.args, b.touched, b.grad, b.p, b.m, b.v);
  ck_same(c, "p", a.p, b.p, n, 1e-5);
  ck_same(c, "m", ck_wide(c, a.m, n), ck_wide(c, b.m, n), n, CK_HIGH_TOL);
  ck_same(c, "v", ck_wide(c, a.v, n), ck_wide(c, b.v, n), n, CK_HIGH_TOL);
  ck_untouched(c, touched, before, b.p, n);
  ck_untouched(c, touched, m, ck_wide(c, b.m, n), n);
  ck_untouched(c, touched, v, ck_wide(c, b.v, n), n);
}

static void check_adam(ck *c) { ck_each_rows(c, check_rows); }

static void run_adam(void *arg, const sv_kernels *k) {
  adam_job *j = arg;
  k->adam(&j->args, j->touched, j->grad, j->p, j->m, j->v);
}

static void bench_adam(ck *c) {
  ck_begin(c, "bench");
  adam_job a = make_job(c, 59, CK_SIGNED, 0xffff), b = make_job(c, 14, CK_SIGNED, 0xffff);
  a.args.lr = a.lr;
  b.args.lr = b.lr;
  ck_time(c, "59 rows; per Gaussian", 16, run_adam, &a);
  ck_time(c, "14 rows; per Gaussian", 16, run_adam, &b);
}

CK_REGISTER(adam, check_adam, bench_adam)
