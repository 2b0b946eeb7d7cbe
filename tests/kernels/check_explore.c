// SPDX-License-Identifier: Apache-2.0
#include <math.h>
#include <string.h>

#include "src/base/vec.h"
#include "tests/kernels/check.h"

static const uint32_t masks[] = {0xffff, 0, 1, 0x8000, 0x5555, 0x7fff, 0x1248};

enum { ROWS = SV_ROW_SH + 3 };

typedef struct {
  float *p, *eta;
  uint32_t on;
} explore_job;

// A block of Gaussians as training has them: any turn, sizes over six decades, nearly transparent.
static explore_job make_job(ck *c, uint32_t on) {
  explore_job j = {ck_floats(c, 16 * ROWS), ck_floats(c, 48), on};
  ck_fill(c, j.p, 16 * ROWS, CK_SIGNED);
  ck_fill(c, j.eta, 48, CK_SIGNED);
  for (int k = 0; k < 16; k++) {
    for (int a = 0; a < 3; a++) j.p[16 * (SV_ROW_SCALE + a) + k] = -14.0f + 0.3f * (float)(16 * a + k);
    j.p[16 * SV_ROW_LOGIT + k] = -2.0f - 0.4f * (float)k;
  }
  return j;
}

// The reference itself against the rotation matrix in double.
static void check_formula(ck *c) {
  ck_begin(c, "formula");
  explore_job j = make_job(c, 0xffff);
  float *b = ck_floats(c, 16 * ROWS);
  memcpy(b, j.p, 16 * ROWS * sizeof *b);
  c->ref.explore(b, j.on, j.eta, 0.5f, 0.005f);
  for (int k = 0; k < 16; k++) {
    double q[4], r[9], n = 0, d[3], o = 1 / (1 + exp(-(double)j.p[16 * SV_ROW_LOGIT + k]));
    double gate = 1 / (1 + exp(100 * (o - 0.005)));
    for (int i = 0; i < 4; i++) q[i] = (double)j.p[16 * (SV_ROW_QUAT + i) + k], n += q[i] * q[i];
    for (int i = 0; i < 4; i++) q[i] /= sqrt(n);
    sv_quat_to_mat(r, q);
    for (int a = 0; a < 3; a++) {
      double s = exp((double)j.p[16 * (SV_ROW_SCALE + a) + k]);
      d[a] = gate * fmin(0.5 * s, 1) * s * (double)j.eta[16 * a + k];
    }
    for (int a = 0; a < 3; a++) {
      double by = r[3 * a] * d[0] + r[3 * a + 1] * d[1] + r[3 * a + 2] * d[2];
      double got = (double)b[16 * a + k] - (double)j.p[16 * a + k];
      ck_true(c, fabs(got - by) < 1e-6 + 1e-5 * fabs(by), "lane %d axis %d: %g, expected %g", k, a, got, by);
    }
  }
}

static void check_explore(ck *c) {
  check_formula(c);
  static const float gains[] = {0.0f, 1e-3f, 40.0f};
  for (size_t g = 0; g < sizeof gains / sizeof *gains; g++)
    for (size_t m = 0; m < sizeof masks / sizeof *masks; m++) {
      ck_begin(c, "gain %g mask %04x", (double)gains[g], masks[m]);
      explore_job a = make_job(c, masks[m]);
      float *b = ck_floats(c, 16 * ROWS), *before = ck_floats(c, 16 * ROWS);
      memcpy(b, a.p, 16 * ROWS * sizeof *b);
      memcpy(before, a.p, 16 * ROWS * sizeof *b);
      c->ref.explore(a.p, a.on, a.eta, gains[g], 0.005f);
      c->var.explore(b, a.on, a.eta, gains[g], 0.005f);
      ck_same(c, "p", a.p, b, 16 * ROWS, 1e-5);
      for (int i = 0; i < 16 * ROWS; i++)
        ck_true(c, b[i] == before[i] || (i < 48 && (masks[m] >> i % 16 & 1)), "entry %d moved", i);
    }
}

static void run_explore(void *arg, const sv_kernels *k) {
  explore_job *j = arg;
  k->explore(j->p, j->on, j->eta, 1e-3f, 0.005f);
}

static void bench_explore(ck *c) {
  ck_begin(c, "bench");
  explore_job j = make_job(c, 0xffff);
  ck_time(c, "per Gaussian", 16, run_explore, &j);
}

CK_REGISTER(explore, check_explore, bench_explore)
