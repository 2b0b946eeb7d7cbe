// SPDX-License-Identifier: Apache-2.0
// Where a Gaussian's four taps lie on a plane: scalar, shared by the reference and the vector form.
#ifndef SV_KERNELS_FIELD_TAP_H
#define SV_KERNELS_FIELD_TAP_H

#include "kernels/field/field.h"

static const int field_axis[SV_FIELD_PLANES][2] = {{0, 1}, {0, 2}, {0, 3}, {1, 2}, {1, 3}, {2, 3}};

typedef struct {
  int i;       // lower point
  float u;     // share of the upper one
  float slope; // d u / d c, 0 beyond the border
} field_tap;

static inline field_tap field_tap_at(float c, int n) {
  float x = c * (float)(n - 1), last = (float)(n - 1);
  field_tap t = {0, 0.0f, x > 0.0f && x < last ? last : 0.0f};
  x = x > 0.0f ? x : 0.0f;
  x = x < last ? x : last;
  t.i = (int)x;
  if (t.i > n - 2) t.i = n - 2;
  t.u = x - (float)t.i;
  return t;
}

// Offsets of the taps 00 10 01 11 (first axis first), their weights and the weights' slopes along
// both axes.
typedef struct {
  long at[4];
  float w[4], d0[4], d1[4];
} field_taps;

static inline field_taps field_taps_at(const sv_planes_args *a, int level, int plane, const float *c,
                                       int lane) {
  const int *ax = field_axis[plane], n0 = a->res[level][ax[0]];
  field_tap p = field_tap_at(c[16 * ax[0] + lane], n0),
            q = field_tap_at(c[16 * ax[1] + lane], a->res[level][ax[1]]);
  long f = 16L * a->n_vec, o = ((long)q.i * n0 + p.i) * f;
  float p1 = p.u, p0 = 1.0f - p.u, q1 = q.u, q0 = 1.0f - q.u;
  return (field_taps){{o, o + f, o + n0 * f, o + (n0 + 1) * f},
                      {p0 * q0, p1 * q0, p0 * q1, p1 * q1},
                      {-p.slope * q0, p.slope * q0, -p.slope * q1, p.slope * q1},
                      {-q.slope * p0, -q.slope * p1, q.slope * p0, q.slope * p1}};
}

#endif
