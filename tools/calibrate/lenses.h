// SPDX-License-Identifier: Apache-2.0
// The images of a multiplexed sensor's calibration: one white image a lens, and images of a
// textured object with all lenses masked but one.
#ifndef SV_TOOLS_CALIBRATE_LENSES_H
#define SV_TOOLS_CALIBRATE_LENSES_H

#include "src/rig/footprint.h"
#include "tools/calibrate/calibrate.h"

typedef struct {
  char name[32]; // of the white image, without extension
  sv_footprint footprint;
  sv_footprint_stats stats;
  void *block;   // holds footprint.coverage
  uint8_t *mask; // [height][width] of the footprint: 255 where it is well lit and not at its rim
  uint8_t *
      // [n_exposures] each [height][width] of the footprint, evened out by the coverage; NULL: none
      *grey;
} cal_lens;

typedef struct {
  int n_lenses, n_exposures, width_px, height_px; // of the sensor
  cal_lens *lenses;
  float max_overlap;          // lenses that meet in a pixel at most
  const lab_session *session; // tells of a request to stop
} cal_lenses;

// Reads WHITE/<lens>.png, measures the footprints, and reads the isolated images:
// ISOLATED/<lens>.png, ISOLATED/<lens>/*.png (exposures in order of names) or
// ISOLATED/<exposure>/<lens>.png. Values are taken as sRGB-encoded light unless o->is_linear.
// Sentences name the picture.
sv_status cal_lenses_read(cal_lenses *l, const cal_options *o, const lab_session *session,
                          sv_err *err) SV_MUST_USE;
void cal_lenses_free(cal_lenses *l);

#endif
