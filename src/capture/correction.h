// SPDX-License-Identifier: Apache-2.0
// Photometric correction of a sub-view's pictures, as its rig tells (src/rig/photometry.h): they
// become what the reference camera would have shown. Owns the tables of
// kernels/correct/correct.h, made once. Never measures anything.
#ifndef SV_CAPTURE_CORRECTION_H
#define SV_CAPTURE_CORRECTION_H

#include "calib/remap.h"
#include "kernels/kernels.h"
#include "src/base/arena.h"
#include "src/rig/rig.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  int32_t *light;            // [3][3][256]; NULL: pictures stay as they are
  uint16_t *inverse_falloff; // [height][width] of the view
  const uint8_t *display;    // [SV_CORRECT_CODES], shared by all sub-views
  double exposure;           // that light is for, see sv_correction_expose
} sv_correction;

// Whether a sub-view's pictures change: calibrated, and other than the reference's.
bool sv_correction_is_needed(const sv_photometry *p);
// The table of display values, of which one is enough. Filled unless the arena is dry.
uint8_t *sv_correction_display(sv_arena *arena);
// Takes the tables of a sub-view whose view has n_px pixels.
void sv_correction_carve(sv_correction *c, const sv_sub_view *v, const uint8_t *display, size_t n_px,
                         sv_arena *arena);
// Fills them, for a view that is drawn through map, or of the lens's own pixels where it has no
// entries. E_RANGE: a color matrix without inverse.
sv_status sv_correction_fill(sv_correction *c, const sv_sub_view *v, const sv_remap *map) SV_MUST_USE;
// Filled ones, from now on for pictures whose exposure time is so many times the reference
// camera's; 1 at first. Values are limited to 1/64 and 64.
void sv_correction_expose(sv_correction *c, const sv_sub_view *v, double exposure);

#ifdef __cplusplus
}
#endif
#endif
