// SPDX-License-Identifier: Apache-2.0
// Motion of each Gaussian for itself (clip mode): position, rotation and colour follow a few
// functions of time, opacity a window in time; no network is shared. Formulas and layout:
// kernels/motion/motion.h.
//
// Moving Gaussians stand first: slots [0, n_moving) have motion, the others are still and cost
// nothing per frame. Which are which is learnt: lengths of the coefficients are priced, and who
// does not move by a fraction of a pixel becomes still (sv_motion_sort).
#ifndef SV_DEFORM_MOTION_H
#define SV_DEFORM_MOTION_H

#include "src/base/arena.h"
#include "src/deform/bodies.h"
#include "src/port/compute.h"
#include "src/splat/gaussians.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef enum {
  SV_MOTION_CHEBYSHEV, // polynomial: T_1 .. T_n of 2 t - 1
  SV_MOTION_SPLINE,    // Catmull-Rom: coefficient j is the place at time (j + 1)/n; at time 0 it is
                       // at rest
  SV_MOTION_POWERS     // (t - t0), (t - t0)^2, ...: can be moved on to another t0
                       // (sv_motion_advance)
} sv_motion_functions_kind;

typedef struct {
  sv_motion_functions_kind functions;
  int n_pos, n_rot, n_colour; // 0..SV_CAP_MOTION_FUNCTIONS; together 0: nothing moves
  float t0;                   // of powers
  bool has_grad;              // room for Adam's moments
  int cap_knots;              // of rigid bodies (bodies.h); 0: there are none
} sv_motion_cfg;

typedef struct {
  sv_motion_cfg cfg;
  int cap, n_rows, n_gaussian_rows;
  int n_moving;    // slots [0, n_moving) move
  float *param;    // [cap/16][n_rows][16]
  uint16_t *m, *v; // Adam's moments, laid out as param; NULL without has_grad
  float *moved;    // [cap/16][n_gaussian_rows][16] Gaussians of the last sv_motion_at
  sv_bodies bodies;
} sv_motion;

// E_ARG when a number of functions is out of range.
sv_status sv_motion_init(sv_motion *mo, const sv_motion_cfg *cfg, const sv_gaussians *g,
                         sv_arena *arena) SV_MUST_USE;
// At rest: no coefficient, windows wide open. All n slots move (n_moving = n).
void sv_motion_reset(sv_motion *mo, int n);
// One slot at rest: ready to move, or (still) with a window that takes nothing at all.
void sv_motion_rest(sv_motion *mo, int i);
void sv_motion_still(sv_motion *mo, int i);
static inline float *sv_motion_row(const sv_motion *mo, int i, int row) {
  return mo->param + ((long)(i >> 4) * mo->n_rows + row) * 16 + (i & 15);
}

// Values at one time of n functions of a kind.
void sv_motion_functions(const sv_motion_cfg *cfg, int n, float t, float f[SV_CAP_MOTION_FUNCTIONS]);
typedef struct {
  float pos[SV_CAP_MOTION_FUNCTIONS], rot[SV_CAP_MOTION_FUNCTIONS], colour[SV_CAP_MOTION_FUNCTIONS];
} sv_motion_values;
sv_motion_values sv_motion_values_at(const sv_motion_cfg *cfg, float t);
// Powers: re-expands the series of what moves about t0, and moves the stored Gaussians g there;
// their quaternions get length 1. What is drawn at any time stays the same.
void sv_motion_advance(sv_motion *mo, sv_gaussians *g, float t0);
// Arguments of the kernels for g at time t; f must live as long as they.
sv_motion_args sv_motion_args_of(const sv_motion *mo, const sv_gaussians *g, float t,
                                 const sv_motion_values *f);
// Makes the moving Gaussians of time t and has g drawn with them (g->moved, g->n_moved), until the
// next call.
void sv_motion_at(sv_motion *mo, const sv_compute *c, sv_gaussians *g, float t);

// Slots [i0, i1) of mo->moved, as they are by their own functions, go with their bodies, whose
// poses are now.
void sv_motion_go_with_bodies(const sv_motion *mo, const sv_rigid *now, int i0, int i1);

// From the gradient of the moved Gaussians of one block to that in their bodies' frames, in place;
// with sum, also to what the last poses of the bodies get: sum[body] += dL/d(turn about the moved
// centre, rad; displacement).
void sv_motion_bodies_bwd(const sv_motion *mo, int block, uint32_t touched, float *grad, float (*sum)[6]);

// How far slot i gets from where it is on average, in world units, and by how much its opacity's
// logit and its colour change, over times 0..1 (or the span before t0 for powers).
typedef struct {
  float distance, fade, colour;
} sv_motion_extent;
sv_motion_extent sv_motion_extent_of(const sv_motion *mo, int i);

// Exchanges two slots' motion, moments included.
void sv_motion_swap(sv_motion *mo, int i, int j);
// Copies the motion of a slot; the copy's moments are cleared.
void sv_motion_copy(sv_motion *mo, int to, int from);

#ifdef __cplusplus
}
#endif
#endif
