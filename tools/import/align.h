// SPDX-License-Identifier: Apache-2.0
// How far two clocks are apart, by what both recorded: sound, or the brightness of the pictures.
// Owns nothing but its scratch.
#ifndef SV_TOOLS_IMPORT_ALIGN_H
#define SV_TOOLS_IMPORT_ALIGN_H

#include <stdbool.h>

#include "src/base/status.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  const float *samples;
  int n;
} lab_signal;

typedef struct {
  double delay_s; // an event at time t of the first signal is at t + delay_s of the second
  double sigma_s; // one standard deviation
  double peak;    // of the correlation, in multiples of its RMS over all delays
} lab_delay;

// A peak below this may be chance: of 10 million delays of noise the highest is at 5.7.
#define LAB_DELAY_LEAST_PEAK 9.0

// Cross-correlation. is_whitened: GCC-PHAT (Knapp and Carter 1976), for sound that microphones of
// different kinds heard. E_NOT_FOUND: the signals have nothing in common. The uncertainty is the
// spread of the delays found in parts of the signals, and at least that of one sample.
sv_status lab_delay_find(lab_delay *out, const lab_signal *a, const lab_signal *b, double rate_hz,
                         bool is_whitened, sv_err *err) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
