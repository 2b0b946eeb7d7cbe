// SPDX-License-Identifier: Apache-2.0
// Neighbours of one surface move alike: where pictures do not tell what became of a Gaussian, its
// neighbours do. Whatever turns and shifts as one body moves affinely, so an affine function of
// place is fitted to the displacements of those nearby (weighted least squares with a ridge towards
// pure translation); those that disagree with it count little in the next round (Geman & McClure's
// weights).
#ifndef SV_DYNAMIC_LOCAL_MOTION_H
#define SV_DYNAMIC_LOCAL_MOTION_H

#include "kernels/kernels.h"
#include "src/base/arena.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  float x[3], u[3]; // place at one time and displacement to another, world units
  bool is_known;    // u and a
  float a[6];       // how sure u is: squared pixels, as the cameras see them, per squared unit; 3 x
                    // 3 by rows
} sv_displaced;

typedef struct {
  sv_displaced *of; // [cap], by slot
  uint32_t *order;  // [n] slots along a curve that seldom leaves a neighbourhood (Morton 1966)
  int32_t *at;      // [cap] where a slot is in order
  sv_pair *pair, *tmp;
  uint32_t *hist;
  int n;
} sv_local_motion;

// NULL on a dry arena and when the block is too small.
sv_local_motion *sv_local_motion_carve(int cap, sv_arena *a);
// Makes neighbours of the n slots b->order; their places lie within 2 half of the centre, or are
// taken as there.
void sv_local_motion_find(sv_local_motion *b, const sv_kernels *k, int n, const float centre[3], float half);
// Displacement of slot i, one of those found, as the others have it that know theirs. False: too
// few are near.
bool sv_local_motion_say(const sv_local_motion *b, int i, float u[3]);

// a x = b, a symmetric by rows (xx xy xz yy yz zz). False where a is not positive definite.
bool sv_solve3(const float a[6], const float b[3], float x[3]);

#ifdef __cplusplus
}
#endif
#endif
