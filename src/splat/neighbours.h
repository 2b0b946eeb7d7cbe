// SPDX-License-Identifier: Apache-2.0
// Distances to the nearest neighbours of a point set, by a k-d tree over an index array.
#ifndef SV_SPLAT_NEIGHBOURS_H
#define SV_SPLAT_NEIGHBOURS_H

#include <stdint.h>

#include "src/base/arena.h"

#ifdef __cplusplus
extern "C" {
#endif

// dist2[n]: mean of the squared distances to the three nearest other points (fewer when n < 4; 0
// when n is 1). xyz: [n][3], finite. Scratch: sv_neighbours_bytes(n). E_NOMEM when it is too small.
sv_status sv_neighbours(const float *xyz, int n, float *dist2, sv_arena *scratch) SV_MUST_USE;
// The same with the neighbours themselves, the nearest first: nearest[n][3], -1 where there are
// fewer.
sv_status sv_neighbours_find(const float *xyz, int n, float *dist2, int32_t *nearest,
                             sv_arena *scratch) SV_MUST_USE;
size_t sv_neighbours_bytes(int n);

#ifdef __cplusplus
}
#endif
#endif
