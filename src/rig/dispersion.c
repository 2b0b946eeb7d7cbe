// SPDX-License-Identifier: Apache-2.0
#include "src/rig/dispersion.h"

#include "src/base/mathx.h"
#include "src/base/vec.h"

// Directions from the scene's centre, and for each candidate its angle to the nearest one chosen.
typedef struct {
  const sv_dispersion *d;
  double *direction; // [n][3]
  double *nearest;   // [n]
} work;

size_t sv_dispersion_scratch(int n) { return 4 * (size_t)(n > 0 ? n : 0); }

static double angle(const work *w, int i, int j) {
  return sv_angle_between(w->direction + 3 * (size_t)i, w->direction + 3 * (size_t)j);
}

static bool is_affordable(int n, int k) { // n over k, in floating point: n may be large
  double tries = 1;
  for (int i = 0; i < k; i++) tries = tries * (n - i) / (i + 1);
  return tries <= SV_DISPERSION_CAP_TRIES;
}

static double best_pair(const work *w, int out[2]) {
  double best = -1;
  for (int i = 0; i < w->d->n; i++)
    for (int j = i + 1; j < w->d->n; j++) {
      double a = angle(w, i, j);
      if (a > best) {
        best = a;
        out[0] = i;
        out[1] = j;
      }
    }
  return best;
}

// A pair whose angle does not exceed the best triple's cannot be part of a better triple.
static void best_triple(const work *w, int out[3]) {
  double best = -1;
  for (int i = 0; i < w->d->n; i++)
    for (int j = i + 1; j < w->d->n; j++) {
      double ij = angle(w, i, j);
      for (int k = j + 1; k < w->d->n && ij > best; k++) {
        double a = angle(w, i, k);
        if (a > best) {
          double b = angle(w, j, k);
          a = a < b ? a : b;
        }
        a = a < ij ? a : ij;
        if (a > best) {
          best = a;
          out[0] = i;
          out[1] = j;
          out[2] = k;
        }
      }
    }
}

static int medoid(const work *w) {
  int best = 0;
  double least = 0;
  for (int i = 0; i < w->d->n; i++) {
    double sum = 0;
    for (int j = 0; j < w->d->n; j++) sum += i == j ? 0 : angle(w, i, j);
    if (i == 0 || sum < least) {
      least = sum;
      best = i;
    }
  }
  return best;
}

// Moves the choice of a single exposure to the front.
static void front_by_elevation(const work *w, int *chosen, int n) {
  int best = 0;
  double least = 10;
  for (int i = 0; i < n; i++) {
    double up = 0.5 * SV_PI - sv_angle_between(w->d->up, w->direction + 3 * (size_t)chosen[i]);
    double off = fabs(up - SV_DISPERSION_ELEVATION_DEG * SV_PI / 180);
    if (off < least) {
      least = off;
      best = i;
    }
  }
  int front = chosen[best];
  for (int i = best; i > 0; i--) chosen[i] = chosen[i - 1];
  chosen[0] = front;
}

// Adds farthest points until there are n of them.
static void extend(const work *w, int *chosen, int n_have, int n) {
  for (int i = 0; i < w->d->n; i++) {
    w->nearest[i] = 10;
    for (int k = 0; k < n_have; k++) {
      double a = i == chosen[k] ? -1 : angle(w, i, chosen[k]); // -1: never again
      w->nearest[i] = a < w->nearest[i] ? a : w->nearest[i];
    }
  }
  for (; n_have < n; n_have++) {
    int far = 0;
    for (int i = 1; i < w->d->n; i++)
      if (w->nearest[i] > w->nearest[far]) far = i;
    chosen[n_have] = far;
    for (int i = 0; i < w->d->n; i++) {
      double a = i == far ? -1 : angle(w, i, far);
      w->nearest[i] = a < w->nearest[i] ? a : w->nearest[i];
    }
  }
}

// The best available start for n >= 2: exact, or from two far ends.
static void start(const work *w, int *chosen, int n) {
  int n_have = n < 3 ? 2 : 3;
  while (n_have > 1 && !is_affordable(w->d->n, n_have)) n_have--;
  if (n_have == 3) best_triple(w, chosen);
  else if (n_have == 2) (void)best_pair(w, chosen);
  // one end: farthest from any
  else {
    chosen[0] = 0;
    extend(w, chosen, 1, 2);
    chosen[0] = chosen[1];
  }
  extend(w, chosen, n_have, n);
}

sv_status sv_disperse(const sv_dispersion *d, int n_wanted, int *chosen, double *scratch) {
  work w = {d, scratch, scratch + 3 * (size_t)(d->n > 0 ? d->n : 0)};
  if (n_wanted < 1 || n_wanted > d->n) return SV_E_ARG;
  for (int i = 0; i < d->n; i++) sv_sub3(w.direction + 3 * (size_t)i, d->at[i], d->centre);
  if (d->n < 2) {
    chosen[0] = 0;
    return SV_OK;
  }
  if (n_wanted == 1 && !d->up) {
    chosen[0] = medoid(&w);
    return SV_OK;
  }
  int few[3], n_few = d->n < 3 ? d->n : 3;
  if (n_wanted != 1) {
    start(&w, chosen, n_wanted);
    if (n_wanted > 2 && d->up) front_by_elevation(&w, chosen, 3);
    return SV_OK;
  }
  start(&w, few, n_few);
  front_by_elevation(&w, few, n_few);
  chosen[0] = few[0];
  return SV_OK;
}

double sv_dispersion_of(const sv_dispersion *d, const int *chosen, int n) {
  double least = 10;
  for (int i = 0; i < n; i++)
    for (int j = i + 1; j < n; j++) {
      double a[3], b[3];
      sv_sub3(a, d->at[chosen[i]], d->centre);
      sv_sub3(b, d->at[chosen[j]], d->centre);
      double x = sv_angle_between(a, b);
      least = x < least ? x : least;
    }
  return n < 2 ? 0 : least;
}
