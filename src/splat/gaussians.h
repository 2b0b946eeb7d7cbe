// SPDX-License-Identifier: Apache-2.0
// The model: a fixed number of Gaussians in blocks of 16 (layout in kernels/project/project.h).
// Owns their parameters, carved at init. Never trains and never renders.
#ifndef SV_SPLAT_GAUSSIANS_H
#define SV_SPLAT_GAUSSIANS_H

#include "kernels/kernels.h"
#include "src/base/arena.h"
#include "src/base/rng.h"
#include "src/format/gaussian.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  int cap;       // a multiple of 16
  int n;         // Gaussians in use: [0, n)
  int sh_degree; // 0..3, of the rows
  int n_rows;    // SV_N_ROWS(sh_degree)
  float *param;  // [cap/16][n_rows][16]
  // Of a moving scene (src/deform): Gaussians [0, n_moved) at one time, laid out as param, rendered
  // instead of the stored ones. NULL and 0: nothing moves.
  const float *moved;
  int n_moved;
} sv_gaussians;

// E_ARG unless 1 <= n <= 4,000,000 and 0 <= sh_degree <= 3.
sv_status sv_gaussians_init(sv_gaussians *g, int n, int sh_degree, sv_arena *arena) SV_MUST_USE;
size_t sv_gaussians_bytes(int n, int sh_degree);

// Address of one row's value of one Gaussian; other rows are 16 floats apart.
static inline float *sv_gaussians_at(const sv_gaussians *g, int i, int row) {
  return g->param + ((long)(i >> 4) * g->n_rows + row) * 16 + (i & 15);
}
// Writes or reads one Gaussian in the exchange form; SH above the model's degree is cut or zero.
void sv_gaussians_put(sv_gaussians *g, int i, const sv_gaussian *in);
void sv_gaussians_get(const sv_gaussians *g, int i, sv_gaussian *out);

// E_RANGE with a sentence when a value is not finite: such a model is never saved.
sv_status sv_gaussians_check(const sv_gaussians *g, sv_err *err) SV_MUST_USE;

typedef struct {
  float mean[3], rgb[3]; // world; display colour 0..1
} sv_point;

typedef enum { SV_INIT_SPHERE, SV_INIT_CUBE, SV_INIT_POINTS } sv_init_kind;

typedef struct {
  sv_init_kind kind;
  float centre[3], radius; // sphere; half side of the cube
  float opacity;           // 0.1 for random, 0.5 for points
  float scale_factor;      // times the distance to the neighbours
  uint64_t seed;
} sv_init_cfg;

// Fills all n Gaussians. Points: of more than n a random subset is used; of fewer, the rest are
// copies displaced by about the neighbor distance. Scale = rms
// distance to the three nearest neighbours (Kerbl et al. 2023), found on a uniform grid held in
// scratch. E_NOMEM: scratch too small (sv_init_scratch_bytes); E_ARG: no points.
sv_status sv_gaussians_fill(sv_gaussians *g, const sv_init_cfg *cfg, const sv_point *point, int n_points,
                            sv_arena *scratch) SV_MUST_USE;
size_t sv_init_scratch_bytes(int n_gaussians, int n_points);

// Robust radius of the model: 1.5 x the median distance of the Gaussians to their centroid. Never
// derived from camera positions: a single exposure has no camera spread.
float sv_gaussians_radius(const sv_gaussians *g, sv_arena *scratch, float centre[3]);

#ifdef __cplusplus
}
#endif
#endif
