// SPDX-License-Identifier: Apache-2.0
// Choice of the training exposures: the N candidates whose smallest mutual angle, seen from the
// scene's centre, is largest (max-min dispersion; the paper, section 4.2, "to ensure pose
// diversity").
//
// Exact for N <= 3 while all combinations can be tried. Otherwise each next exposure is the one
// farthest from those chosen, which is at least half as good (Gonzalez 1985). The result depends on
// the candidates' order only for ties: the lower index wins.
#ifndef SV_RIG_DISPERSION_H
#define SV_RIG_DISPERSION_H

#include <stddef.h>

#include "src/base/status.h"

#ifdef __cplusplus
extern "C" {
#endif

// combinations; 2000 candidates for pairs, 229 for triples
#define SV_DISPERSION_CAP_TRIES     2000000
#define SV_DISPERSION_ELEVATION_DEG 30.0 // preferred elevation of a single exposure

typedef struct {
  int n;                 // candidates
  const double (*at)[3]; // [n] where each was taken, world
  double centre[3];      // of the scene
  const double *up;      // [3] any length, or NULL: unknown
} sv_dispersion;

// Doubles of scratch for n candidates.
size_t sv_dispersion_scratch(int n);

// Chooses n_wanted candidates into chosen[n_wanted].
//   1   with up: the one of the exact triple whose elevation is nearest to 30 degrees; without: the
//       medoid, whose angles to all others have the smallest sum
//   2   the exact pair, by index
//   3   the exact triple; with up, the choice of 1 comes first, the rest by index
//   4+  the choice of 3, then farthest points in the order in which they were found: the first k of
//       them are
//       the choice for k, for every k from 3 on
// E_ARG unless 1 <= n_wanted <= n.
sv_status sv_disperse(const sv_dispersion *d, int n_wanted, int *chosen, double *scratch) SV_MUST_USE;

// The smallest angle between two of n candidates, radians; 0 for fewer than two.
double sv_dispersion_of(const sv_dispersion *d, const int *chosen, int n);

#ifdef __cplusplus
}
#endif
#endif
