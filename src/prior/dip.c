// SPDX-License-Identifier: Apache-2.0
// The dip statistic (Hartigan & Hartigan 1985): between the greatest convex minorant of the
// distribution function, left of the modal interval, and its least concave majorant, right of it.
// The interval shrinks to where the two are farthest apart, until it does not matter any more.
#include "src/base/mathx.h"
#include "src/prior/methods.h"

static void sift(float *v, int at, int n) {
  const float x = v[at];
  for (int child; (child = 2 * at + 1) < n; at = child) {
    child += child + 1 < n && v[child + 1] > v[child];
    if (!(v[child] > x)) break;
    v[at] = v[child];
  }
  v[at] = x;
}

void sv_prior_sort(float *v, int n) {
  for (int i = n / 2; i-- > 0;) sift(v, i, n);
  for (int i = n - 1; i > 0; i--) {
    const float x = v[0];
    v[0] = v[i];
    v[i] = x;
    sift(v, 0, i);
  }
}

typedef struct {
  int32_t *at; // [n] vertices, left to right
  int n;
} hull;

// Vertices, left to right, of the lower (sign 1) or upper (sign -1) hull of the points (x[i], i),
// low <= i <= high.
static int hull_of(const float *x, int low, int high, double sign, int32_t *out) {
  int n = 0;
  for (int i = low; i <= high; i++) {
    while (n > 1) {
      const int a = out[n - 2], b = out[n - 1];
      const double turn =
          ((double)x[b] - (double)x[a]) * (double)(i - a) - (double)(b - a) * ((double)x[i] - (double)x[a]);
      if (sign * turn > 0) break;
      n--;
    }
    out[n++] = i;
  }
  return n;
}

// Height over x of the hull's segment that ends at vertex k.
static double height(const float *x, const int32_t *vertex, int k, double at) {
  const int a = vertex[k - 1], b = vertex[k];
  const double width = (double)x[b] - (double)x[a];
  return width > 0 ? a + (b - a) * (at - (double)x[a]) / width : b;
}

// Largest distance of the points' steps from a hull over its segments [k0, k1]; the minorant lies
// below (sign 1).
static double largest_gap(const float *x, const int32_t *vertex, int k0, int k1, double sign) {
  double max = 0;
  for (int k = k0 + 1; k <= k1; k++)
    for (int i = vertex[k - 1]; i <= vertex[k]; i++)
      max = sv_maxd(max, sign * ((double)i - height(x, vertex, k, (double)x[i])) + 1);
  return max;
}

// Where the hulls are farthest apart: vertices *at_g and *at_l of the two, between which the modal
// interval lies.
static double widest(const float *x, const hull *minorant, const hull *majorant, int *at_g, int *at_l) {
  const int32_t *g = minorant->at, *l = majorant->at;
  const int n_g = minorant->n, n_l = majorant->n;
  double max = -1;
  for (int i = 0, k = 1; i < n_g; i++) { // the minorant's vertices below the majorant's segments
    while (k < n_l - 1 && l[k] < g[i]) k++;
    const double d = height(x, l, k, (double)x[g[i]]) + 1 - g[i];
    if (d > max) {
      max = d;
      *at_g = i;
      *at_l = k;
    }
  }
  for (int i = 0, k = 1; i < n_l; i++) {
    while (k < n_g - 1 && g[k] < l[i]) k++;
    const double d = l[i] + 1 - height(x, g, k, (double)x[l[i]]);
    if (d > max) {
      max = d;
      *at_g = k - 1;
      *at_l = i;
    }
  }
  return max;
}

double sv_prior_dip(const float *x, int n, int32_t *scratch) {
  int low = 0, high = n - 1, at_g = 0, at_l = 0;
  int32_t *g = scratch, *l = scratch + n;
  double dip = 1;
  if (n < 2 || !(x[n - 1] > x[0])) return n > 0 ? 0.5 / n : 0;
  while (high > low) {
    const hull minorant = {g, hull_of(x, low, high, 1, g)}, majorant = {l, hull_of(x, low, high, -1, l)};
    if (widest(x, &minorant, &majorant, &at_g, &at_l) <= dip) break;
    dip = sv_maxd(dip, largest_gap(x, g, 0, at_g, 1));
    dip = sv_maxd(dip, largest_gap(x, l, at_l, majorant.n - 1, -1));
    if ((g[at_g] == low && l[at_l] == high) || g[at_g] >= l[at_l]) break;
    low = g[at_g];
    high = l[at_l];
  }
  return dip / (2.0 * n);
}
