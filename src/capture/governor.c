// SPDX-License-Identifier: Apache-2.0
#include "src/capture/governor.h"

#define WINDOW_NS (500 * SV_NS_PER_MS)
// A long exposure must not be followed by nothing but training
#define MAX_OWED_NS (200 * SV_NS_PER_MS)
// Previews come faster again when training has so much more than its share
#define SHARE_RELAXED 1.25

// The Raspberry Pi's processor slows down from 80 degrees on, others later.
#define HOT_C  77.0
#define COOL_C 72.0
// In each look at the temperature
#define HEAT_NS   SV_NS_PER_S
#define DUTY_DOWN 0.85
#define DUTY_UP   0.02
// Kept when the processor is slowed down but not hot: its power supply is weak, and a pause helps
// little.
#define MIN_DUTY_COOL 0.5
#define MAX_REST_NS   (200 * SV_NS_PER_MS)

sv_governor_cfg sv_governor_defaults(sv_ns preview_every_ns) {
  return (sv_governor_cfg){.preview_every_ns = preview_every_ns,
                           .train_share = 0.4,
                           .train_floor = 0.1,
                           .hot_c = HOT_C,
                           .cool_c = COOL_C,
                           .min_duty = 0.1};
}

void sv_governor_init(sv_governor *g, const sv_governor_cfg *cfg, sv_ns now_ns) {
  *g = (sv_governor){.cfg = *cfg,
                     .window_ns = now_ns,
                     .preview_ns = now_ns,
                     .heat_ns = now_ns,
                     .now_ns = now_ns,
                     .slowdown = 1,
                     .duty = 1,
                     .least_duty = 1};
}

// At the end of a window: did training get its share?
static void judge(sv_governor *g, sv_ns now_ns) {
  // Rest is training time that training did not need.
  const sv_ns train_ns = g->spent_ns[SV_WORK_TRAIN] + g->spent_ns[SV_WORK_REST];
  double share = (double)train_ns / (double)(now_ns - g->window_ns);
  if (share < g->cfg.train_share) {
    g->load = g->slowdown < SV_GOVERNOR_SLOWEST ? SV_LOAD_PREVIEW : SV_LOAD_TRAINING;
    if (g->slowdown < SV_GOVERNOR_SLOWEST) g->slowdown *= 2;
  } else if (share > SHARE_RELAXED * g->cfg.train_share && g->slowdown > 1) {
    g->slowdown /= 2;
    g->load = g->slowdown > 1 ? SV_LOAD_PREVIEW : SV_LOAD_FREE;
  } else g->load = g->slowdown > 1 ? SV_LOAD_PREVIEW : SV_LOAD_FREE;
  g->window_ns = now_ns;
  for (int i = 0; i < SV_N_WORKS; i++) g->spent_ns[i] = 0;
}

bool sv_governor_heat(sv_governor *g, const sv_heat *heat, sv_ns now_ns) {
  const bool was_full = g->duty >= 1;
  const bool is_warm = heat->temperature_c >= g->cfg.cool_c; // false when it is not known
  if (now_ns - g->heat_ns < HEAT_NS) return false;
  g->heat_ns = now_ns;
  const double min_duty = is_warm || g->cfg.min_duty > MIN_DUTY_COOL ? g->cfg.min_duty : MIN_DUTY_COOL;
  if (heat->is_throttled == 1 || heat->temperature_c >= g->cfg.hot_c) {
    if (g->duty > min_duty) g->duty = g->duty * DUTY_DOWN > min_duty ? g->duty * DUTY_DOWN : min_duty;
  } else if (!is_warm) g->duty += DUTY_UP;
  if (g->duty > 1) g->duty = 1;
  if (g->duty < g->least_duty) g->least_duty = g->duty;
  return was_full != (g->duty >= 1);
}

sv_work sv_governor_next(sv_governor *g, sv_ns now_ns, bool is_exposure_ready) {
  if (now_ns > g->now_ns) {
    g->credit_ns += (sv_ns)((double)(now_ns - g->now_ns) * g->cfg.train_floor);
    if (g->credit_ns > MAX_OWED_NS) g->credit_ns = MAX_OWED_NS;
    g->now_ns = now_ns;
  }
  if (now_ns - g->window_ns >= WINDOW_NS) judge(g, now_ns);
  if (is_exposure_ready) return g->credit_ns > 0 ? SV_WORK_TRAIN : SV_WORK_EXPOSURE;
  if (g->cfg.preview_every_ns > 0 && now_ns - g->preview_ns >= g->cfg.preview_every_ns * g->slowdown)
    return SV_WORK_PREVIEW;
  return g->rest_ns > 0 ? SV_WORK_REST : SV_WORK_TRAIN;
}

void sv_governor_done(sv_governor *g, sv_work work, sv_ns from_ns, sv_ns now_ns) {
  sv_ns took_ns = now_ns > from_ns ? now_ns - from_ns : 0;
  g->n[work]++;
  g->spent_ns[work] += took_ns;
  if (work == SV_WORK_TRAIN) {
    g->credit_ns -= took_ns;
    if (g->credit_ns < -MAX_OWED_NS) g->credit_ns = -MAX_OWED_NS;
    g->rest_ns += (sv_ns)((double)took_ns * (1 - g->duty) / g->duty);
    if (g->rest_ns > MAX_REST_NS / g->cfg.min_duty) g->rest_ns = (sv_ns)(MAX_REST_NS / g->cfg.min_duty);
  }
  if (work == SV_WORK_REST) g->rest_ns -= took_ns;
  if (work == SV_WORK_PREVIEW) g->preview_ns = now_ns;
}
