// SPDX-License-Identifier: Apache-2.0
#include "src/format/axes.h"

#include <math.h>
#include <stdint.h>
#include <string.h>

#include "src/base/vec.h"

// Parity of the polynomial of SH coefficient k in x (bit 0), y (bit 1), z (bit 2), in the order of
// 3DGS: 1 | y z x | xy yz 3zz-1 xz xx-yy | y(3xx-yy) xyz y(5zz-1) z(5zz-3) x(5zz-1) z(xx-yy)
// x(xx-3yy)
static const uint8_t parity[16] = {0, 2, 4, 1, 3, 6, 0, 5, 0, 2, 7, 2, 4, 1, 4, 1};

void sv_gaussian_turn(sv_gaussian *g, sv_half_turn turn) {
  static const uint8_t flips_of[] = {0, 6, 3};
  const uint8_t flips = flips_of[turn];
  for (int a = 0; a < 3; a++) {
    if (!(flips >> a & 1)) continue;
    g->mean[a] = -g->mean[a];
    g->quat_wxyz[1 + a] = -g->quat_wxyz[1 + a];
  }
  for (int k = 1; k < 16; k++) {
    int odd = parity[k] & flips;
    if (!((odd ^ odd >> 1 ^ odd >> 2) & 1)) continue;
    for (int c = 0; c < 3; c++) g->sh[k][c] = -g->sh[k][c];
  }
}

// --- up ------------------------------------------------------------------------------------------

static const char *const up_names[6] = {"x", "y", "z", "-x", "-y", "-z"};

bool sv_up_axis(const char *name, double up[3]) {
  for (int i = 0; name && i < 6; i++)
    if (strcmp(name, up_names[i]) == 0) {
      for (int k = 0; k < 3; k++) up[k] = k == i % 3 ? (i < 3 ? 1.0 : -1.0) : 0.0;
      return true;
    }
  return false;
}

const char *sv_up_name(const float up[3]) {
  int best = 0;
  for (int k = 1; k < 3; k++)
    if (fabsf(up[k]) > fabsf(up[best])) best = k;
  return up_names[best + (up[best] < 0 ? 3 : 0)];
}

// --- any rotation --------------------------------------------------------------------------------

#define CAP_BAND 7

// The 2 l + 1 functions of degree l in a direction.
static void band(double *y, int l, const double d[3]) {
  const double x = d[0], v = d[1], z = d[2], xx = x * x, vv = v * v, zz = z * z;
  if (l == 1) {
    const double c = 0.4886025119029199, b[3] = {-c * v, c * z, -c * x};
    memcpy(y, b, sizeof b);
  } else if (l == 2) {
    const double c = 1.0925484305920792;
    const double b[5] = {c * x * v, -c * v * z, 0.31539156525252005 * (2 * zz - xx - vv), -c * x * z,
                         0.5462742152960396 * (xx - vv)};
    memcpy(y, b, sizeof b);
  } else {
    const double c = 0.5900435899266435, e = 0.4570457994644658;
    const double b[7] = {-c * v * (3 * xx - vv),      2.890611442640554 * x * v * z,
                         -e * v * (4 * zz - xx - vv), 0.3731763325901154 * z * (2 * zz - 3 * xx - 3 * vv),
                         -e * x * (4 * zz - xx - vv), 1.445305721320277 * z * (xx - vv),
                         -c * x * (xx - 3 * vv)};
    memcpy(y, b, sizeof b);
  }
}

void sv_sh_basis(double y[15], const double d[3]) {
  for (int l = 1, first = 0; l <= 3; first += 2 * l + 1, l++) band(y + first, l, d);
}

// Gauss-Jordan with pivoting until the left n columns of a[n][2 n] are the identity.
static void eliminate(double a[CAP_BAND][2 * CAP_BAND], int n) {
  for (int c = 0; c < n; c++) {
    int best = c;
    for (int r = c + 1; r < n; r++)
      if (fabs(a[r][c]) > fabs(a[best][c])) best = r;
    for (int k = 0; k < 2 * n; k++) {
      double s = a[c][k];
      a[c][k] = a[best][k];
      a[best][k] = s;
    }
    for (int r = 0; r < n; r++) {
      double f = a[r][c] / a[c][c];
      for (int k = 0; r != c && k < 2 * n; k++) a[r][k] -= f * a[c][k];
    }
    double pivot = a[c][c];
    for (int k = 0; k < 2 * n; k++) a[c][k] /= pivot;
  }
}

// The color seen from R d afterwards is the color seen from d before: sum_m c'_m Y_m(R d) = sum_m
// c_m Y_m(d) for as many directions as there are functions gives c' = Y(R d)^-1 Y(d) c.
static void turn_band(double *out, int l, const double r[9]) {
  static const double directions[CAP_BAND][3] = {{1, 0.2, 0.3},    {-0.4, 1, 0.1},   {0.3, -0.5, 1},
                                                 {-1, -0.7, 0.4},  {0.6, 0.5, -0.9}, {-0.2, 0.9, -0.7},
                                                 {0.8, -0.6, -0.5}};
  const int n = 2 * l + 1;
  double a[CAP_BAND][2 * CAP_BAND], d[3], turned[3];
  for (int i = 0; i < n; i++) {
    double length = sv_norm3(directions[i]);
    for (int k = 0; k < 3; k++) d[k] = directions[i][k] / length;
    sv_apply33(turned, r, d);
    band(a[i], l, turned);
    band(a[i] + n, l, d);
  }
  eliminate(a, n);
  for (int i = 0; i < n; i++)
    for (int k = 0; k < n; k++) out[n * i + k] = a[i][n + k];
}

void sv_turn_make(sv_turn *t, const double r[9]) {
  t->is_none = false;
  memcpy(t->r, r, sizeof t->r);
  sv_quat_from_mat(t->q_wxyz, r);
  for (int l = 1; l <= 3; l++) turn_band(t->sh[l - 1], l, r);
}

void sv_turn_between(sv_turn *t, const char *up, const char *to) {
  double a[3], b[3], r[9], axis[3];
  *t = (sv_turn){.is_none = true};
  if (!sv_up_axis(up, a) || !sv_up_axis(to, b)) return;
  const double c = sv_dot3(a, b); // cosine of the angle: 1, 0 or -1
  if (c > 0) return;
  sv_cross3(axis, a, b);
  // a half turn; any perpendicular axis would do
  if (c < 0) axis[fabs(a[0]) > 0] = 1;
  const double s = c < 0 ? 0.0 : 1.0; // sine of the angle
  const double cross[9] = {0, -axis[2], axis[1], axis[2], 0, -axis[0], -axis[1], axis[0], 0};
  for (int i = 0; i < 3; i++)
    for (int k = 0; k < 3; k++)
      r[3 * i + k] = (i == k ? c : 0.0) + s * cross[3 * i + k] + (1 - c) * axis[i] * axis[k];
  sv_turn_make(t, r);
}

void sv_turn_upright(sv_turn *t, const char *up) { sv_turn_between(t, up, SV_UP_DEFAULT); }

static void turn_sh(sv_gaussian *g, const sv_turn *t) {
  for (int l = 1, first = 1; l <= 3; first += 2 * l + 1, l++)
    for (int c = 0; c < 3; c++) {
      const int n = 2 * l + 1;
      double was[CAP_BAND];
      for (int k = 0; k < n; k++) was[k] = (double)g->sh[first + k][c];
      for (int i = 0; i < n; i++) {
        double sum = 0;
        for (int k = 0; k < n; k++) sum += t->sh[l - 1][n * i + k] * was[k];
        g->sh[first + i][c] = (float)sum;
      }
    }
}

void sv_gaussian_turn_by(sv_gaussian *g, const sv_turn *t) {
  if (t->is_none) return;
  double x[3], q[4], turned[3];
  for (int k = 0; k < 3; k++) x[k] = (double)g->mean[k];
  for (int k = 0; k < 4; k++) q[k] = (double)g->quat_wxyz[k];
  sv_apply33(turned, t->r, x);
  for (int k = 0; k < 3; k++) g->mean[k] = (float)turned[k];
  const double *p = t->q_wxyz; // p q: the Gaussian's rotation comes first
  g->quat_wxyz[0] = (float)(p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3]);
  g->quat_wxyz[1] = (float)(p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2]);
  g->quat_wxyz[2] = (float)(p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1]);
  g->quat_wxyz[3] = (float)(p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0]);
  turn_sh(g, t);
}
