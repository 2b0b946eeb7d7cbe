// SPDX-License-Identifier: Apache-2.0
// The photometric loss of Gaussian splatting (Kerbl et al. 2023, eq. 7) with its gradient:
//   L = (1 - l) mean |x - y| + l (1 - mean SSIM(x, y))      means over pixels and channels
// SSIM as in kernels/ssim/ssim.h, its mean over windows on every second row. The result does not
// depend on the number of threads: each row has its own sum, and rows are added in index order.
#ifndef SV_LOSS_PHOTOMETRIC_H
#define SV_LOSS_PHOTOMETRIC_H

#include "src/base/arena.h"
#include "src/image/planes.h"
#include "src/port/compute.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  int cap_width_px, cap_height_px; // the largest picture
  int n_threads;                   // of the pool that will be used
  bool has_ssim;                   // false: weight_ssim is always 0 and no maps are needed
} sv_photometric_cfg;

typedef struct {
  sv_photometric_cfg cfg;
  sv_compute compute;
  int phase;        // 0 or 1: SSIM's windows stand on the rows 2 j + phase; the caller may change
                    // it between calls
  int cap_map_rows; // rows of windows whose maps are kept at a time
  float *map;       // [n_threads][3: dm1, ds1, ds12 of one channel][cap_map_rows][cap stride]. NULL
                    // without SSIM
  float *map_ssim;  // [n_threads][cap rows]
  float *row_ssim;  // [3][cap rows]
  float *row_l1;    // [3][cap rows]
  float **scratch;  // [n_threads]
} sv_photometric;

// Takes its memory from the arena (on a dry one only counts). E_ARG for sizes that are not
// positive.
sv_status sv_photometric_init(sv_photometric *p, const sv_photometric_cfg *cfg, sv_compute compute,
                              sv_arena *arena) SV_MUST_USE;
size_t sv_photometric_bytes(const sv_photometric_cfg *cfg);

// A loss and its parts.
typedef struct {
  double loss, l1, ssim; // ssim is 0 when weight_ssim is 0
} sv_photometric_value;

// Value, and with grad != NULL dL/d render: grad is overwritten, padding columns and rows with
// zeros. err_plane ([rows_padded][stride] of render) gets the mean of |x - y| over the channels,
// padding 0; may be NULL. render, target and grad have one size within the capacity; target's
// stride must equal render's. weight_ssim is l, in [0, 1], and 0 when cfg.has_ssim is false. The
// pool has at most cfg.n_threads.
sv_photometric_value sv_photometric_loss(sv_photometric *p, const sv_planes *render, const sv_planes *target,
                                         sv_planes *grad, float *err_plane, float weight_ssim);

#ifdef __cplusplus
}
#endif
#endif
