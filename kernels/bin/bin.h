// SPDX-License-Identifier: Apache-2.0
// Which 4x4 pixel blocks of which tiles a splat touches. The ellipse alpha >= 1/255 is solved
// exactly per row of blocks (StopThePop's tight extent): its widest chord among the rows' pixel
// centres.
#ifndef SV_KERNELS_BIN_H
#define SV_KERNELS_BIN_H

#include "kernels/project/project.h"

#ifdef __cplusplus
extern "C" {
#endif

// Intersections behind the last one that may be overwritten with anything: splats are written four
// at a time.
#define SV_BIN_SLACK 3

// Writes the n_intersections intersections, one or more, of each splat id[0..n), at intersection +
// splat[id].intersection_offset, which follow those of the splat before: its tiles row by row, mask
// 0 where the ellipse misses the tile. The mask may hold a block too many, never one too few. Then
// SV_BIN_SLACK more may be anything. exact.
typedef void sv_bin_fn(const sv_splat *splat, const uint32_t *id, uint32_t n, int n_tiles_x,
                       sv_intersection *intersection);

#ifdef __cplusplus
}
#endif
#endif
