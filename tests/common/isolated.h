// SPDX-License-Identifier: Apache-2.0
// What subview-calibrate lenslets reads, made by the simulator: white pictures of each lens of a
// multiplexed sensor, and pictures with all lenses masked but one. 16 bits, sRGB-encoded, with read
// noise.
#ifndef SV_TESTS_COMMON_ISOLATED_H
#define SV_TESTS_COMMON_ISOLATED_H

#include "platform/sim/sim.h"
#include "tools/common/fileio.h"

typedef struct {
  sv_sim sim;
  void *block;
  bool is_flat; // lenses light all of their rectangle alike, as the simulator's sensor has it; else
                // discs
  char folder[SV_CAP_PATH], white[SV_CAP_PATH], isolated[SV_CAP_PATH], out[SV_CAP_PATH];
  uint32_t n_saved; // pictures, each with noise of its own
} isolated;

// Folders with white pictures and room for n_exposures of the simulator `spec`.
void isolated_open(isolated *s, const char *spec, bool is_flat, int n_exposures);
void isolated_close(isolated *s);

// A lens's true share of light at a pixel of its footprint: 1, or a disc as wide as its rectangle
// with a rim of one pixel, darker outwards by ISOLATED_FALL_OFF at its edge.
#define ISOLATED_FALL_OFF 0.25
double isolated_share(const isolated *s, const sv_footprint *f, int x, int y);
// Picture e of lens i: rgb [height][width][3] of its footprint, display values.
void isolated_save(isolated *s, int e, int i, const uint8_t *rgb);
// The simulator's scene through each lens, all exposures.
void isolated_scene(isolated *s, int n_exposures);

// The rig that was written to s->out; coverage pictures are malloc'ed (sv_coverage_free).
void isolated_read_rig(isolated *s, sv_rig *rig, sv_arena *arena, sv_arena *scratch);

// How far a rig is from the simulator's, both as seen from lens 0: the worst lens.
typedef struct {
  double rotation_deg, focal, place; // the last two as shares: of the focal length, of the array's
                                     // size
} isolated_errors;
isolated_errors isolated_compare(const sv_rig *rig, const sv_rig *want);

double isolated_srgb(double light); // display value

#endif
