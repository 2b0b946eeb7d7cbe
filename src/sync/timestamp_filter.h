// SPDX-License-Identifier: Apache-2.0
// Timestamp filter: removes the noise of one camera's timestamps.
// Owns the estimate of phase and period.
// Never changes exact timestamps: it is for cameras whose stamps are known to scatter (software
// stamps).
//
// A sensor exposes at a steady period: stamp(k) = phase + period k + noise. Phase and period are
// estimated by least squares over the stamps with exponentially fading weight (discounted least
// squares of a line: R. G. Brown, "Smoothing, forecasting and prediction", 1963, chapter 12), in
// the recursive form of a two-state Kalman filter. With noise of standard deviation s, the error is
// about
// 2 s / sqrt(n) after n frames, and s sqrt(1.25 / SV_TIMESTAMP_FILTER_FRAMES) in the long run: 18
// us for s = 1 ms.
#ifndef SV_SYNC_TIMESTAMP_FILTER_H
#define SV_SYNC_TIMESTAMP_FILTER_H

#include <stdbool.h>
#include <stdint.h>

#include "src/base/time.h"

#ifdef __cplusplus
extern "C" {
#endif

// of fading memory: long against the noise, short against a crystal's temperature
#define SV_TIMESTAMP_FILTER_FRAMES 4096
#define SV_TIMESTAMP_FILTER_HOLD   128 // frames whose mean tells how far a clock has stepped

typedef struct {
  sv_ns noise_ns; // standard deviation of the stamps; 0: they are passed through
  bool is_started;
  // The first stamp; what steps of the clock have added to the stamps since
  sv_ns ref_ns, step_ns;
  double phase_ns, period_ns; // of the newest frame, relative to ref_ns and without step_ns
  double p00, p01, p11;       // their covariance, of noise_ns^2
  uint32_t n;                 // frames learnt from
  // Frames still to average after a step; frames in a row that do not fit
  int n_hold, n_off;
  double hold_sum_ns;
} sv_timestamp_filter;

void sv_timestamp_filter_init(sv_timestamp_filter *c, sv_ns noise_ns);

// The instant of a frame on the camera's clock as it ran before all steps: the estimate, or the
// stamp itself while nothing is known. n_frames: how many frames after the last one, from the
// sequence numbers; 0: not known. Stamps that lie off the steady frame rate (six times the noise)
// are passed through, and three in a row start it anew.
sv_ns sv_timestamp_filter_add(sv_timestamp_filter *c, sv_ns camera_ns, uint32_t n_frames);

// By how much a stamp lies off what the filter expects of it. False: too little is known, or it
// fits.
bool sv_timestamp_filter_is_off(const sv_timestamp_filter *c, sv_ns camera_ns, uint32_t n_frames,
                                sv_ns *residual_ns);

// The camera's clock has jumped between the last frame and this one: the filter goes on, and the
// next frames tell by how much. Returns false when too little is known for that; the filter then
// starts anew.
bool sv_timestamp_filter_step(sv_timestamp_filter *c, sv_ns camera_ns, uint32_t n_frames);

// The camera was told to make its frames longer by so much from now on.
void sv_timestamp_filter_lengthen(sv_timestamp_filter *c, sv_ns delta_ns);

#ifdef __cplusplus
}
#endif
#endif
