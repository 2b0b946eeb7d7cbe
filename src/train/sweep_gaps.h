// SPDX-License-Identifier: Apache-2.0
// Depth between the measured pixels of a depth map; a part of sweep.h.
// Owns nothing; never measures.
#ifndef SV_TRAIN_SWEEP_GAPS_H
#define SV_TRAIN_SWEEP_GAPS_H

#include "src/train/sweep.h"

#ifdef __cplusplus
extern "C" {
#endif

// From the confirmed codes in m->grey to m->code: gaps of a few pixels in rows and columns are
// filled from their ends.
void sv_sweep_fill_gaps(sv_depth_map *m);

#ifdef __cplusplus
}
#endif
#endif
