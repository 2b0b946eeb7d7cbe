// SPDX-License-Identifier: Apache-2.0
#include "tools/lab/curve.h"

#include <math.h>
#include <stdlib.h>

typedef struct {
  uint32_t code;
  int i;
} coded;

static int by_code(const void *a, const void *b) {
  const coded *x = a, *y = b;
  return x->code != y->code ? (x->code > y->code) - (x->code < y->code) : (x->i > y->i) - (x->i < y->i);
}

static uint32_t spread(uint32_t x) { // ten bits, two zeros between each
  x = (x | x << 16) & 0x030000ff;
  x = (x | x << 8) & 0x0300f00f;
  x = (x | x << 4) & 0x030c30c3;
  return (x | x << 2) & 0x09249249;
}

float lab_curve_log(float x) { return copysignf(log1pf(fabsf(x)), x); }

void lab_curve_ranges(const sv_gaussian *v, int n, double lo[3], double hi[3]) {
  for (int k = 0; k < 3; k++) {
    lo[k] = INFINITY;
    hi[k] = -INFINITY;
    for (int i = 0; i < n; i++) {
      const double x = (double)lab_curve_log(v[i].mean[k]);
      lo[k] = fmin(lo[k], x);
      hi[k] = fmax(hi[k], x);
    }
  }
}

sv_gaussian *lab_curve_order(const sv_gaussians *g, int *index) {
  const size_t n = (size_t)g->n;
  double lo[3], hi[3];
  coded *c = malloc(n * sizeof *c);
  sv_gaussian *from = calloc(n, sizeof *from), *to = malloc(n * sizeof *to);
  const bool is_good = c && from && to;
  if (is_good) {
    for (int i = 0; i < g->n; i++) sv_gaussians_get(g, i, &from[i]);
    lab_curve_ranges(from, g->n, lo, hi);
    for (int i = 0; i < g->n; i++) {
      c[i] = (coded){0, i};
      for (int k = 0; k < 3; k++) {
        const double x = (double)lab_curve_log(from[i].mean[k]);
        const double u = hi[k] > lo[k] ? (x - lo[k]) / (hi[k] - lo[k]) : 0;
        c[i].code |= spread((uint32_t)(u * 1023.0)) << k;
      }
    }
    qsort(c, n, sizeof *c, by_code);
    for (int i = 0; i < g->n; i++) to[i] = from[c[i].i];
    for (int i = 0; index && i < g->n; i++) index[i] = c[i].i;
  }
  free(c);
  free(from);
  if (is_good) return to;
  free(to);
  return NULL;
}
