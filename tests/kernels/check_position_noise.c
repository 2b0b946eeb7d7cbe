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
} noise_job;

// A block of Gaussians as training has them: any turn, sizes over six decades, nearly transparent.
static noise_job make_job(ck *c, uint32_t on) {
  noise_job j = {ck_floats(c, 16 * ROWS), ck_floats(c, 48), on};
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
  noise_job j = make_job(c, 0xffff);
  float *b = ck_floats(c, 16 * ROWS);
  memcpy(b, j.p, 16 * ROWS * sizeof *b);
  c->ref.position_noise(b, j.on, j.eta, 0.5f, 0.005f);
  for (int k = 0; k < 16; k++) {
    double q[4], r[9], n = 0, d[3], o = 1 / (1 + exp(-(double)j.p[16 * SV_ROW_LOGIT + k]));
    double gate = 1 / (1 + exp(100 * (o - 0.005)));
    for (int i = 0; i < 4; i++) {
      q[i] = (double)j.p[16 * (SV_ROW_QUAT + i) + k];
      n += q[i] * q[i];
    }
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

static void check_position_noise(ck *c) {
  check_formula(c);
  static const float gains[] = {0.0f, 1e-3f, 40.0f};
  for (size_t g = 0; g < sizeof gains / sizeof *gains; g++)
    for (size_t m = 0; m < sizeof masks / sizeof *masks; m++) {
      ck_begin(c, "gain %g mask %04x", (double)gains[g], masks[m]);
      noise_job a = make_job(c, masks[m]);
      float *b = ck_floats(c, 16 * ROWS), *before = ck_floats(c, 16 * ROWS);
      memcpy(b, a.p, 16 * ROWS * sizeof *b);
      memcpy(before, a.p, 16 * ROWS * sizeof *b);
      c->ref.position_noise(a.p, a.on, a.eta, gains[g], 0.005f);
      c->var.position_noise(b, a.on, a.eta, gains[g], 0.005f);
      ck_same(c, "p", a.p, b, 16 * ROWS, 1e-5);
      for (int i = 0; i < 16 * ROWS; i++)
        ck_true(c, b[i] == before[i] || (i < 48 && (masks[m] >> i % 16 & 1)), "entry %d moved", i);
    }
}

static void run_position_noise(void *arg, const sv_kernels *k) {
  noise_job *j = arg;
  k->position_noise(j->p, j->on, j->eta, 1e-3f, 0.005f);
}

static void bench_position_noise(ck *c) {
  ck_begin(c, "bench");
  noise_job j = make_job(c, 0xffff);
  ck_time(c, "per Gaussian", 16, run_position_noise, &j);
}

CK_REGISTER(position_noise, check_position_noise, bench_position_noise)

// --- errors ----------------------------------------

typedef struct {
  float *err, *e, *logit;
} errors_job;

static errors_job make_errors(ck *c) {
  errors_job j = {ck_floats(c, 16), ck_floats(c, 16), ck_floats(c, 16)};
  ck_fill(c, j.err, 16, CK_SIGNED);
  ck_fill(c, j.e, 16, CK_SIGNED);
  ck_fill(c, j.logit, 16, CK_SIGNED);
  j.logit[3] = NAN;
  j.logit[9] = -0.25f; // may wander, as what lies on the limit
  return j;
}

static void check_errors(ck *c) {
  for (size_t m = 0; m < sizeof masks / sizeof *masks; m++) {
    ck_begin(c, "mask %04x", masks[m]);
    errors_job j = make_errors(c);
    float *a = ck_floats(c, 16), *b = ck_floats(c, 16);
    memcpy(a, j.e, 16 * sizeof *a);
    memcpy(b, j.e, 16 * sizeof *b);
    uint32_t low = c->ref.blend_errors(masks[m], 0.9f, j.err, a, j.logit, -0.25f);
    uint32_t of_var = c->var.blend_errors(masks[m], 0.9f, j.err, b, j.logit, -0.25f);
    ck_true(c, low == of_var, "lanes %04x, reference %04x", of_var, low);
    ck_same(c, "e", a, b, 16, 0);
    for (int k = 0; k < 16; k++) {
      const double mean = 0.9 * (double)j.e[k] + 0.1 * (double)j.err[k];
      const bool is_on = masks[m] >> k & 1;
      ck_true(c, is_on ? fabs((double)b[k] - mean) < 1e-6 * (1 + fabs(mean)) : b[k] == j.e[k], "entry %d", k);
      ck_true(c, (low >> k & 1) == !(j.logit[k] > -0.25f), "lane %d", k);
    }
  }
}

static void run_errors(void *arg, const sv_kernels *k) {
  errors_job *j = arg;
  (void)k->blend_errors(0xffff, 0.9f, j->err, j->e, j->logit, -0.25f);
}

static void bench_errors(ck *c) {
  ck_begin(c, "bench");
  errors_job j = make_errors(c);
  ck_time(c, "per Gaussian", 16, run_errors, &j);
}

CK_REGISTER(blend_errors, check_errors, bench_errors)
