// SPDX-License-Identifier: Apache-2.0
// Depth against a depth prior whose scale and offset are unknown: one minus Pearson's correlation,
// over the whole picture (FSGS, Zhu et al. 2024, eq. 5) or over patches (SparseGS, Xiong et al.
// 2023, sec. 3.2).
//   r = sum a b / sqrt(sum a^2 sum b^2),  a = d - mean d,  b = t - mean t,  L = weight mean over
//                                         patches (1 - r) dL/dd = -weight / n_patches (b / sqrt(Saa
//                                         Sbb) - r a / Saa)
#ifndef SV_LOSS_PEARSON_H
#define SV_LOSS_PEARSON_H

#include <stdint.h>

#include "src/base/arena.h"
#include "src/base/status.h"
#include "src/port/compute.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  int x0, y0, x1, y1; // columns [x0, x1), rows [y0, y1)
} sv_pearson_patch;

typedef struct {
  int cap_patches; // 1 is enough for whole pictures
} sv_pearson_cfg;

typedef struct {
  double mean_d, mean_t, r;
  double per_a, per_b; // dr/dd = per_b b - per_a a; both 0 where r means nothing
} sv_pearson_stat;

typedef struct {
  sv_pearson_cfg cfg;
  sv_compute compute;
  sv_pearson_stat *stats; // [cap_patches]
} sv_pearson;

sv_status sv_pearson_init(sv_pearson *p, const sv_pearson_cfg *cfg, sv_compute compute,
                          sv_arena *arena) SV_MUST_USE;
size_t sv_pearson_bytes(const sv_pearson_cfg *cfg);

typedef struct {
  const float *depth;  // [height_px][stride], rendered
  const float *prior;  // the same shape
  const uint8_t *mask; // the same shape, 0 = leave the pixel out; may be NULL
  int width_px, height_px, stride;
  const sv_pearson_patch *patches; // NULL: one patch, the whole picture
  int n_patches;                   // ignored without patches; at most cap_patches
  float weight;
} sv_pearson_input;

// Returns the loss and adds its gradient to grad_depth ([height][stride], may be NULL). A patch
// with fewer than two pixels or without contrast (deviation below 1e-6 of the mean) counts as r = 0
// and has no gradient. Patches may overlap; they are cut to the picture. The same bits for any
// number of threads.
double sv_pearson_loss(sv_pearson *p, const sv_pearson_input *in, float *grad_depth);

#ifdef __cplusplus
}
#endif
#endif
