// SPDX-License-Identifier: Apache-2.0
// Total variation of a rendered picture, as a prior on views that no camera took:
//   TV = mean phi(vertical differences) + mean phi(horizontal differences)
// phi squared or absolute (kernels/tv/tv.h); each mean is over the differences of its direction and
// the three channels.
#ifndef SV_LOSS_TV_H
#define SV_LOSS_TV_H

#include "src/base/arena.h"
#include "src/image/planes.h"
#include "src/port/compute.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  int cap_width_px, cap_height_px;
  int n_threads; // of the pool that will be used
} sv_tv_cfg;

typedef struct {
  sv_tv_cfg cfg;
  sv_compute compute;
  float *row_v, *row_h; // [3][cap rows]
  float **scratch;      // [n_threads]
} sv_tv;

// Takes its memory from the arena (on a dry one only counts). E_ARG for sizes that are not
// positive.
sv_status sv_tv_init(sv_tv *t, const sv_tv_cfg *cfg, sv_compute compute, sv_arena *arena) SV_MUST_USE;
size_t sv_tv_bytes(const sv_tv_cfg *cfg);

// Returns weight * TV and adds its gradient by `render` to grad, which has the same size and stride
// and may be NULL; padding is left as it is. The same bits for any number of threads.
double sv_tv_loss(sv_tv *t, const sv_planes *render, sv_planes *grad, sv_tv_form form, float weight);

#ifdef __cplusplus
}
#endif
#endif
