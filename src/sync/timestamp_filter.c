// SPDX-License-Identifier: Apache-2.0
#include "src/sync/timestamp_filter.h"

#include <math.h>

#define MIN_FRAMES 16  // before that the period is not known well enough to say what does not fit
#define GATE       6.0 // of the noise
#define MAX_OFF    3
#define START_VAR  1e12 // of the period, in noise^2: unknown

void sv_timestamp_filter_init(sv_timestamp_filter *c, sv_ns noise_ns) {
  *c = (sv_timestamp_filter){.noise_ns = noise_ns};
}

static sv_ns start(sv_timestamp_filter *c, sv_ns camera_ns) {
  c->is_started = true;
  c->ref_ns = camera_ns - c->step_ns; // the scale stays, so that the clock's model stays good
  c->phase_ns = c->period_ns = 0;
  c->p00 = 1;
  c->p01 = 0;
  c->p11 = START_VAR;
  c->n = 1;
  c->n_hold = c->n_off = 0;
  return c->ref_ns;
}

// From one frame to the next: fading divides the covariance by the weight that old stamps keep.
static void predict(sv_timestamp_filter *c, uint32_t n_frames) {
  double k = (double)n_frames, fade = 1 + k / SV_TIMESTAMP_FILTER_FRAMES;
  c->phase_ns += k * c->period_ns;
  c->p00 = (c->p00 + 2 * k * c->p01 + k * k * c->p11) * fade;
  c->p01 = (c->p01 + k * c->p11) * fade;
  c->p11 *= fade;
}

static void learn(sv_timestamp_filter *c, double residual_ns) {
  double s = c->p00 + 1, g0 = c->p00 / s, g1 = c->p01 / s;
  c->phase_ns += g0 * residual_ns;
  c->period_ns += g1 * residual_ns;
  c->p11 -= g1 * c->p01;
  c->p01 -= g0 * c->p01;
  c->p00 -= g0 * c->p00;
  c->n++;
}

static sv_ns estimate(const sv_timestamp_filter *c) { return c->ref_ns + (sv_ns)floor(c->phase_ns + 0.5); }

// How many frames have passed, judged by time.
static uint32_t frames_since(const sv_timestamp_filter *c, sv_ns camera_ns) {
  double k =
      c->period_ns > 0 ? ((double)(camera_ns - c->step_ns - c->ref_ns) - c->phase_ns) / c->period_ns : 1;
  return k < 1.5 ? 1 : k > 1e6 ? 1000000 : (uint32_t)(k + 0.5);
}

sv_ns sv_timestamp_filter_add(sv_timestamp_filter *c, sv_ns camera_ns, uint32_t n_frames) {
  if (c->noise_ns <= 0) return camera_ns;
  if (!c->is_started) return start(c, camera_ns);
  predict(c, n_frames ? n_frames : frames_since(c, camera_ns));
  double residual_ns = (double)(camera_ns - c->step_ns - c->ref_ns) - c->phase_ns;
  // The mean of the residuals is what the first estimate of the step was wrong by
  if (c->n_hold > 0) {
    c->hold_sum_ns += residual_ns;
    if (--c->n_hold == 0) c->step_ns += (sv_ns)floor(c->hold_sum_ns / SV_TIMESTAMP_FILTER_HOLD + 0.5);
    return estimate(c);
  }
  double gate = GATE * (double)c->noise_ns;
  if (c->n >= MIN_FRAMES && residual_ns * residual_ns > gate * gate * (1 + c->p00)) {
    if (++c->n_off >= MAX_OFF) return start(c, camera_ns);
    return camera_ns - c->step_ns;
  }
  c->n_off = 0;
  learn(c, residual_ns);
  return estimate(c);
}

bool sv_timestamp_filter_is_off(const sv_timestamp_filter *c, sv_ns camera_ns, uint32_t n_frames,
                                sv_ns *residual_ns) {
  if (c->noise_ns <= 0 || !c->is_started || c->n < MIN_FRAMES || !n_frames) return false;
  double r = (double)(camera_ns - c->step_ns - c->ref_ns) - c->phase_ns - (double)n_frames * c->period_ns;
  *residual_ns = (sv_ns)floor(r + 0.5);
  return fabs(r) > 2 * GATE * (double)c->noise_ns;
}

bool sv_timestamp_filter_step(sv_timestamp_filter *c, sv_ns camera_ns, uint32_t n_frames) {
  if (c->noise_ns <= 0) return false;
  if (!c->is_started || c->n < MIN_FRAMES || !n_frames) {
    c->step_ns = 0;
    (void)start(c, camera_ns);
    return false;
  }
  predict(c, n_frames);
  c->step_ns = camera_ns - c->ref_ns - (sv_ns)floor(c->phase_ns + 0.5);
  c->n_hold = SV_TIMESTAMP_FILTER_HOLD;
  c->hold_sum_ns = 0;
  c->n_off = 0;
  return true;
}

void sv_timestamp_filter_lengthen(sv_timestamp_filter *c, sv_ns delta_ns) {
  if (!c->is_started) return;
  c->period_ns += (double)delta_ns;
  // When exactly the camera follows is not known: the phase may be off by a few such changes.
  double d = (double)delta_ns / (double)(c->noise_ns > 0 ? c->noise_ns : 1);
  c->p00 += 4 * d * d;
}
