// SPDX-License-Identifier: Apache-2.0
// Photon transfer: a sensor's read noise and shot noise, from pairs of pictures of the same light.
// After J. Janesick, "Photon Transfer" (SPIE Press, 2007), chapters 4 and 5: half of the variance
// of the difference of two pictures, at each brightness, has neither the pattern of the pixels nor
// that of the scene.
// Owns the sums. Never reads files.
#ifndef SV_TOOLS_CALIBRATE_PHOTON_TRANSFER_H
#define SV_TOOLS_CALIBRATE_PHOTON_TRANSFER_H

#include <stddef.h>
#include <stdint.h>

#include "src/base/status.h"
#include "src/rig/rig.h"

#define PTC_BINS 64 // of brightness, even in its square root

typedef struct {
  double n, n_clipped; // samples
  double sum_x;        // of the means of two values
  double sum_squares;  // of the differences, about their mean
  double freedom;      // degrees of freedom
} ptc_bin;

typedef struct {
  ptc_bin bin[PTC_BINS];
  int n_pairs;
} ptc;

typedef struct {
  sv_sensor_noise noise;
  double sigma_read, sigma_shot; // standard deviations
  int n_pairs, n_levels;
} ptc_result;

// Adds two pictures of n values each, sRGB-encoded in 16 bits.
void ptc_add(ptc *p, const uint16_t *a, const uint16_t *b, size_t n);
// Fits variance = read + shot x. E_RANGE with a sentence when the levels do not tell the two apart.
sv_status ptc_solve(const ptc *p, ptc_result *out, sv_err *err) SV_MUST_USE;

#endif
