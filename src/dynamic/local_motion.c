// SPDX-License-Identifier: Apache-2.0
#include "src/dynamic/local_motion.h"

#include <string.h>

#include "src/base/mathx.h"

#define SIDE     32   // candidates before and after a Gaussian in the order
#define N_NEAR   12   // neighbours
#define MIN_NEAR 4    // fewer tell nothing
#define RIDGE    0.1f // of the mean variance of the neighbors' positions
#define BITS     10   // of the curve, along each axis
#define N_ROUNDS 3

typedef struct {
  int n;
  const sv_displaced *of[N_NEAR]; // by rising distance
  float d2[N_NEAR], w[N_NEAR];
} near_list;

// An affine function of the place relative to x: its value there and its slope, by rows.
typedef struct {
  float u[3], slope[9];
} affine;

sv_local_motion *sv_local_motion_carve(int cap, sv_arena *a) {
  sv_local_motion b = {.of = SV_TAKE(a, sv_displaced, cap),
                       .order = SV_TAKE(a, uint32_t, cap),
                       .at = SV_TAKE(a, int32_t, cap),
                       .pair = SV_TAKE(a, sv_pair, cap),
                       .tmp = SV_TAKE(a, sv_pair, cap),
                       .hist = SV_TAKE(a, uint32_t, SV_SORT_CAP_BUCKETS)};
  sv_local_motion *out = SV_TAKE(a, sv_local_motion, 1);
  if (out) *out = b;
  return out;
}

static uint32_t spread_bits(uint32_t x) { // bit b to bit 3 b
  uint32_t y = 0;
  for (uint32_t b = 0; b < BITS; b++) y |= (x >> b & 1) << (3 * b);
  return y;
}

void sv_local_motion_find(sv_local_motion *b, const sv_kernels *k, int n, const float centre[3], float half) {
  const float cells = (float)(1 << BITS);
  b->n = n;
  for (int p = 0; p < n; p++) {
    const float *x = b->of[b->order[p]].x;
    b->pair[p] = (sv_pair){.value = b->order[p]};
    for (int e = 0; e < 3; e++) {
      float u = ((x[e] - centre[e]) / (4.0f * half) + 0.5f) * cells;
      b->pair[p].key |= spread_bits((uint32_t)sv_clampf(u, 0.0f, cells - 1.0f)) << e;
    }
  }
  k->sort(
      &(sv_sort_args){.pair = b->pair, .n = (uint32_t)n, .tmp = b->tmp, .hist = b->hist, .order = b->order});
  for (int p = 0; p < n; p++) b->at[b->order[p]] = p;
}

static void add_near(near_list *l, const sv_displaced *o, float d2) {
  if (l->n == N_NEAR && d2 >= l->d2[N_NEAR - 1]) return;
  int at = l->n < N_NEAR ? l->n++ : N_NEAR - 1;
  for (; at > 0 && l->d2[at - 1] > d2; at--) {
    l->of[at] = l->of[at - 1];
    l->d2[at] = l->d2[at - 1];
  }
  l->of[at] = o;
  l->d2[at] = d2;
}

static void find_near(const sv_local_motion *b, int i, near_list *l) {
  const int at = b->at[i], last = sv_mini(at + SIDE, b->n - 1);
  const float *x = b->of[i].x;
  l->n = 0;
  for (int p = sv_maxi(at - SIDE, 0); p <= last; p++) {
    const sv_displaced *o = &b->of[b->order[p]];
    if (p == at || !o->is_known) continue;
    float y[3] = {o->x[0] - x[0], o->x[1] - x[1], o->x[2] - x[2]};
    add_near(l, o, y[0] * y[0] + y[1] * y[1] + y[2] * y[2]);
  }
}

bool sv_solve3(const float a[6], const float b[3], float x[3]) {
  float c[6] = {a[3] * a[5] - a[4] * a[4], a[2] * a[4] - a[1] * a[5], a[1] * a[4] - a[2] * a[3],
                a[0] * a[5] - a[2] * a[2], a[1] * a[2] - a[0] * a[4], a[0] * a[3] - a[1] * a[1]};
  float det = a[0] * c[0] + a[1] * c[1] + a[2] * c[2];
  if (!(det > 0)) return false;
  x[0] = (c[0] * b[0] + c[1] * b[1] + c[2] * b[2]) / det;
  x[1] = (c[1] * b[0] + c[3] * b[1] + c[4] * b[2]) / det;
  x[2] = (c[2] * b[0] + c[4] * b[1] + c[5] * b[2]) / det;
  return true;
}

static bool fit(const float x[3], const near_list *l, affine *f) {
  float sum = 0, y[3] = {0}, u[3] = {0}, yy[6] = {0}, uy[3][3] = {{0}}; // means, then covariances
  for (int n = 0; n < l->n; n++) {
    const sv_displaced *o = l->of[n];
    float w = l->w[n], dy[3];
    sum += w;
    for (int k = 0; k < 3; k++) {
      dy[k] = o->x[k] - x[k];
      y[k] += w * dy[k];
      u[k] += w * o->u[k];
    }
    for (int k = 0, e = 0; k < 3; k++) {
      for (int m = k; m < 3; m++) yy[e++] += w * (dy[k] * dy[m]);
      for (int m = 0; m < 3; m++) uy[m][k] += w * (dy[k] * o->u[m]);
    }
  }
  if (!(sum > 0)) return false;
  for (int k = 0; k < 3; k++) {
    y[k] /= sum;
    u[k] /= sum;
  }
  for (int k = 0, e = 0; k < 3; k++) {
    for (int m = k; m < 3; m++, e++) yy[e] = yy[e] / sum - y[k] * y[m];
    for (int m = 0; m < 3; m++) uy[m][k] = uy[m][k] / sum - y[k] * u[m];
  }
  float ridge = RIDGE / 3 * (yy[0] + yy[3] + yy[5]) + 1e-20f;
  yy[0] += ridge;
  yy[3] += ridge;
  yy[5] += ridge;
  for (int m = 0; m < 3; m++) {
    float *s = f->slope + 3 * m;
    if (!sv_solve3(yy, uy[m], s)) return false;
    f->u[m] = u[m] - (s[0] * y[0] + s[1] * y[1] + s[2] * y[2]);
  }
  return true;
}

// Squared distances of the neighbours' displacements from the function's; their weighted mean.
static float misfit(const float x[3], const near_list *l, const affine *f, float r2[N_NEAR]) {
  float sum = 0, of = 0;
  for (int n = 0; n < l->n; n++) {
    const sv_displaced *o = l->of[n];
    r2[n] = 0;
    for (int m = 0; m < 3; m++) {
      float u = f->u[m];
      for (int k = 0; k < 3; k++) u += f->slope[3 * m + k] * (o->x[k] - x[k]);
      r2[n] += (u - o->u[m]) * (u - o->u[m]);
    }
    sum += l->w[n] * r2[n];
    of += l->w[n];
  }
  return sum / of;
}

bool sv_local_motion_interpolate(const sv_local_motion *b, int i, float u[3]) {
  const float *x = b->of[i].x;
  near_list l;
  affine f;
  float r2[N_NEAR];
  find_near(b, i, &l);
  if (l.n < MIN_NEAR) return false;
  const float far2 = 1.2f * l.d2[l.n - 1] + 1e-30f;
  for (int k = 0; k < l.n; k++) l.w[k] = 1.0f - l.d2[k] / far2;
  for (int round = 0; round < N_ROUNDS; round++) {
    if (!fit(x, &l, &f)) return false;
    float mean = misfit(x, &l, &f, r2) + 1e-20f;
    for (int k = 0; k < l.n; k++) {
      float agrees = mean / (mean + r2[k]);
      l.w[k] = (1.0f - l.d2[k] / far2) * (agrees * agrees);
    }
  }
  memcpy(u, f.u, sizeof f.u);
  return true;
}
