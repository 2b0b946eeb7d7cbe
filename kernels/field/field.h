// SPDX-License-Identifier: Apache-2.0
// The pieces of a deformation field (4D Gaussian Splatting, Wu et al. 2024; HexPlane, Cao & Johnson
// 2023): samples of six planes multiplied, and linear layers, each for a block of 16 Gaussians.
//
// A level has six planes over pairs of x y z t, in the order xy xz xt yz yt zt; a plane is
// [n_second][n_first][F] floats, F = 16 n_vec. The level's feature is the product of its six
// bilinear samples, per channel. Levels are concatenated. Outside the grid the border counts.
#ifndef SV_KERNELS_FIELD_H
#define SV_KERNELS_FIELD_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define SV_FIELD_PLANES     6
#define SV_FIELD_CAP_LEVELS 4
#define SV_FIELD_CAP_VEC    2 // F is 16 or 32

typedef struct {
  int n_vec, n_levels;
  int res[SV_FIELD_CAP_LEVELS][4];                          // points along x y z t, at least 2
  const float *plane[SV_FIELD_CAP_LEVELS][SV_FIELD_PLANES]; // 64-byte aligned
} sv_planes_args;

// c [4][16]: x y z t of each Gaussian, 0..1 along the grid (other values count as the border).
// Writes feature [n_levels F][16]. exact.
typedef void sv_planes_fn(const sv_planes_args *a, const float *c, float *feature);

// dL/dfeature [n_levels F][16] -> part [16][n_levels][6][F]: dL/d(sample of each plane) of each
// Gaussian (the gradient times the other five, never divided), and dc [3][16]: dL/dc of x y z, 0
// beyond the border. exact.
typedef void sv_planes_bwd_fn(const sv_planes_args *a, const float *c, const float *d_feature, float *part,
                              float *dc);

// A block's coordinates and part, and the lanes that have a gradient.
typedef struct {
  const float *c, *part;
  uint32_t touched;
} sv_planes_block;

// Adds the part of one plane of one level to its gradient, Gaussian by Gaussian: tap += weight
// part. Lanes whose bit in touched is 0 are left out. exact.
typedef void sv_planes_add_fn(const sv_planes_args *a, int level, int plane, const sv_planes_block *block,
                              float *grad);

// y [n_out][16] = b + w relu(x), x [n_in][16], w [n_out][n_in]; without is_relu x itself. n_in is a
// multiple of 16.
typedef struct {
  const float *w, *b;
  int n_in, n_out, is_relu;
} sv_linear_args;
typedef void sv_linear_fn(const sv_linear_args *a, const float *x, float *y); // exact
// dx [n_in][16] is overwritten; dw and db are added to, dw Gaussian by Gaussian. exact.
typedef void sv_linear_bwd_fn(const sv_linear_args *a, const float *x, const float *dy, float *dx, float *dw,
                              float *db);

#ifdef __cplusplus
}
#endif
#endif
