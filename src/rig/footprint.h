// SPDX-License-Identifier: Apache-2.0
// Footprints of a multiplexed sensor from white images (the paper, section 3.2 and its camera
// calibration): one image of an even field for each lens, with all other lenses masked. A footprint
// is the rectangle that the lens lights, and the share of the plateau that each pixel gets: w_m(x)
// of the forward model.
#ifndef SV_RIG_FOOTPRINT_H
#define SV_RIG_FOOTPRINT_H

#include "src/rig/raw.h"
#include "src/rig/rig.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  double dark, plateau; // values (0..1) of no light, and of the lit part of the lens
  double noise;         // standard deviation on the plateau, as a share of plateau - dark
  double area_px;       // sum of the coverage
  int n_dead;           // dead pixels replaced: they differ from all neighbours
} sv_footprint_stats;

// Scratch for images of this size: 65536 bins and one float a pixel.
size_t sv_footprint_bytes(int width_px, int height_px);

// The image of an even field through one lens, with all others masked.
typedef struct {
  const char *name;  // of the file, for messages
  const sv_raw *raw; // linear values, one channel
  // Value of no light, 0..1. Below 0: measured, as the level of the unlit part of the image, which
  // must then be there.
  double dark;
} sv_white_image;

// Measures one white image. coverage is taken from `out_arena` (width x height of the rectangle;
// nothing is left there after a failure); scratch is given back.
//   coverage = (value - dark) / (plateau - dark), clamped to 0..1, in 255ths,
// with the plateau at the lens's brightest part (95th percentile of means over 7x7 pixels,
// corrected for noise): vignetting inside the lens is part of its weight. Where 5x5 pixels differ
// by no more than noise their mean is used. E_FORMAT with a sentence: dark, overexposed, nothing
// unlit.
sv_status sv_footprint_measure(sv_footprint *f, sv_footprint_stats *stats, const sv_white_image *white,
                               sv_arena *out_arena, sv_arena *scratch, sv_err *err) SV_MUST_USE;

// How many lenses light each pixel of a sensor.
typedef struct {
  int width_px, height_px;
  float *sum;        // [height_px][width_px] in lenses
  float max_overlap; // M_max, the largest of them; 0: nothing is lit
} sv_overlap_map;

// Fills in sum and max_overlap from all footprints. E_RANGE with a sentence when a footprint is not
// on the sensor.
sv_status sv_footprint_sum(const sv_footprint *f, int n, sv_overlap_map *map, sv_err *err) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
