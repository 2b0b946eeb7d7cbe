// SPDX-License-Identifier: Apache-2.0
// Depth maps at half the size, which tell the planes that full-size maps have to look at; a part of
// sweep.h. Owns nothing; never measures.
#ifndef SV_TRAIN_SWEEP_HALF_H
#define SV_TRAIN_SWEEP_HALF_H

#include "src/train/sweep.h"

#ifdef __cplusplus
extern "C" {
#endif

// Pixels of m at half the size.
size_t sv_sweep_half_px(const sv_depth_map *m);
// m at half the size, over every second plane, its picture reduced to out->grey; n_planes is 0
// where all planes are looked at. out: grey and code of sv_sweep_half_px values.
void sv_sweep_half(const sv_depth_map *m, sv_depth_map *out);

// The planes *first to *last of a map of n_planes on which the surfaces of 16 columns and
// SV_SWEEP_BAND rows from (x, y) on may lie: those of the half-size map and a few around. All of
// them where it has measured next to nothing.
void sv_sweep_half_planes(const sv_depth_map *half, int n_planes, int x, int y, int *first, int *last);

#ifdef __cplusplus
}
#endif
#endif
