// SPDX-License-Identifier: Apache-2.0
// The coarse half of sv_lenslet_find: periods and phase from the middle of a white image.
#ifndef SV_RIG_LENSLET_LATTICE_H
#define SV_RIG_LENSLET_LATTICE_H

#include "src/rig/lenslet.h"

#ifdef __cplusplus
extern "C" {
#endif

// Layout, col_px, row_px (to about 0.1 px) and offset_px of a lenslet near the middle. E_FORMAT
// with a sentence.
sv_status sv_lenslet_coarse(sv_lenslet_grid *g, const char *name, const sv_raw *white, sv_arena *scratch,
                            sv_err *err) SV_MUST_USE;
size_t sv_lenslet_coarse_bytes(void);

#ifdef __cplusplus
}
#endif
#endif
