// SPDX-License-Identifier: Apache-2.0
// Gauss-Newton on blocks of 16 Gaussians: the probe that estimates J^T W J, its running mean, and
// the damped step. The three coordinates of a mean are coupled, all other parameters are not: few
// views pin a mean down across their rays and hardly along them, which no diagonal can say.
//
// For a plane s of independent random signs, E[(J^T W^(1/2) s)_i^2] = (J^T W J)_ii (Hutchinson
// 1990; Bekas, Kokiopoulou and Saad 2007, "An estimator for the diagonal of a matrix"): a backward
// pass with s in the place of the loss's gradient, and a square, estimate the whole diagonal
// without a bias; products of two coordinates in the place of the square, what couples them.
#ifndef SV_KERNELS_NEWTON_H
#define SV_KERNELS_NEWTON_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

// One channel's probe: +-size in the rows [row0, row1) and columns [0, width), 0 in [width, next
// multiple of 16).
typedef struct {
  float *plane;         // [height][stride] out
  int width_px, stride; // stride: a multiple of 16
  int row0, row1;
  float size;   // W^(1/2)
  uint32_t key; // other keys give independent signs
} sv_probe_args;

// 32 signs of columns [32 i_col, 32 i_col + 32) of a row: bit set, minus. The finaliser of
// MurmurHash3 (A. Appleby) over the three numbers in turn.
static inline uint32_t sv_probe_mix(uint32_t h) {
  h = (h ^ h >> 16) * 0x85ebca6bu;
  h = (h ^ h >> 13) * 0xc2b2ae35u;
  return h ^ h >> 16;
}
static inline uint32_t sv_probe_bits(uint32_t i_col, uint32_t row, uint32_t key) {
  return sv_probe_mix(i_col + sv_probe_mix(row + sv_probe_mix(key + 0x9e3779b9u)));
}

// exact.
typedef void sv_probe_fn(const sv_probe_args *a);

// diag, cross, and m below, are kept as the upper halves of floats (bfloat16), rounded to the
// nearest: means of 0.9 a step change by more than that loses.
typedef struct {
  uint16_t *diag;  // [n_rows][16]
  uint16_t *cross; // [3][16] of a mean's coordinates: x y, x z, y z
} sv_curvatures;

// Updated in the lanes of touched with a new estimate s: c = keep c + (1 - keep) s, and where there
// is none yet (diag is 0; of cross, diag of x) c = s. s: squares and products of x [n_rows][16]; or
// with products [3][16], x >= 0 and these themselves. exact.
typedef void sv_curvature_fn(float keep, int n_rows, uint32_t touched, const float *x, const float *products,
                             const sv_curvatures *c);

typedef struct {
  float beta1;
  float rate;
  // [n_rows] times a row's mean of diag over the block is added to diag; of a mean's rows the
  // first, times the mean of the three
  const float *damping;
  float cap_mean;   // longest step of a mean, > 0: times the geometric mean of the Gaussian's axes
  const float *cap; // [n_rows] longest steps of the other rows, > 0
  int n_rows;       // that move, of kernels/project/project.h: those of a mean, or more
} sv_newton_args;

#define SV_NEWTON_LOG2E_3 0.480898347f // log2(e) / 3: of the mean of three logarithms

// Pivots of the mean's matrix, scaled to a diagonal of 1, are at least this: bfloat16 leaves no
// more.
#define SV_NEWTON_PIVOT_MIN (1.0f / 64.0f)
// Below, a step would leave the range of floats.
#define SV_NEWTON_CURVATURE_MIN 1e-30f

// p, m: [n_rows][16] of the block, updated; p holds its scales in any case; grad [n_rows][16].
// Lanes whose bit in touched is 0 keep p and m; parameters without an estimate (diag 0) stay where
// they are.
//   m = b1 m + (1-b1) g;  p -= clamp(rate m / (diag + damping mean(diag)), -cap, cap). exact.
// Of a mean: p -= rate (H + ridge I)^-1 m, H from diag and cross, shortened to the cap, which grows
// with its Gaussian: a longer move is not linear in the picture.
typedef void sv_newton_fn(const sv_newton_args *a, uint32_t touched, const float *grad,
                          const sv_curvatures *c, float *p, uint16_t *m);

#ifdef __cplusplus
}
#endif
#endif
