// SPDX-License-Identifier: Apache-2.0
// Per-Gaussian motion: position, rotation and color are sums of basis functions of time, opacity
// has a window in time. Formulas and layout: kernels/motion/motion.h.
//
// Owns coefficients, moments and moved Gaussians: those with indices [0, n_moving) move, the others
// are static and cost nothing per frame.
//
// Never decides which Gaussians move: training does (src/dynamic), by a penalty on the
// coefficients.
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
  SV_MOTION_CHEBYSHEV = 0, // polynomial: T_1 .. T_n of 2 t - 1
  SV_MOTION_POWERS = 2     // (t - t0), (t - t0)^2, ...; sv_motion_advance changes t0. As in files
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
  int n_moving;    // Gaussians [0, n_moving) move
  float *param;    // [cap/16][n_rows][16]
  uint16_t *m, *v; // Adam's moments, laid out as param; NULL without has_grad
  float *moved;    // [cap/16][n_gaussian_rows][16] Gaussians of the last sv_motion_at
  sv_bodies bodies;
} sv_motion;

// E_ARG when a number of functions is out of range.
sv_status sv_motion_init(sv_motion *mo, const sv_motion_cfg *cfg, const sv_gaussians *g,
                         sv_arena *arena) SV_MUST_USE;
// All coefficients 0, windows wide open; n_moving = n.
void sv_motion_reset(sv_motion *mo, int n);
// One Gaussian at rest: rest may move from there on; still has a window of constant opacity.
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
// Powers: re-expands the series about t0, with the stored Gaussians g at t0 and their quaternions
// normalized. Renderings of all times stay the same.
void sv_motion_advance(sv_motion *mo, sv_gaussians *g, float t0);
// Arguments of the kernels for g at time t; f must outlive them.
sv_motion_args sv_motion_args_of(const sv_motion *mo, const sv_gaussians *g, float t,
                                 const sv_motion_values *f);
// Computes the moving Gaussians at time t, with which g is rendered (g->moved, g->n_moved) until
// the next call.
void sv_motion_at(sv_motion *mo, const sv_compute *c, sv_gaussians *g, float t);
// The same without the bodies' poses.
void sv_motion_local_at(sv_motion *mo, const sv_compute *c, sv_gaussians *g, float t);

// Largest distance of Gaussian i from its mean position, in world units, and the largest change of
// its opacity logit and its color, over times 0..1 (for powers: the span before t0).
typedef struct {
  float distance, fade, colour;
} sv_motion_extent;
sv_motion_extent sv_motion_extent_of(const sv_motion *mo, int i);

// Swaps the motion of two Gaussians, moments included.
void sv_motion_swap(sv_motion *mo, int i, int j);
// Copies the motion of a Gaussian; the copy's moments are 0.
void sv_motion_copy(sv_motion *mo, int to, int from);

#ifdef __cplusplus
}
#endif
#endif
