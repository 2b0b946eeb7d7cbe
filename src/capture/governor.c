// SPDX-License-Identifier: Apache-2.0
#include "src/capture/governor.h"

#define WINDOW_NS (500 * SV_NS_PER_MS)
// A long exposure must not be followed by nothing but training
#define MOST_OWED_NS (200 * SV_NS_PER_MS)
// Previews come faster again when training has so much more than its share
#define SHARE_RELAXED 1.25

sv_governor_cfg sv_governor_defaults(sv_ns preview_every_ns) {
  return (sv_governor_cfg){.preview_every_ns = preview_every_ns, .train_share = 0.4, .train_floor = 0.1};
}

void sv_governor_init(sv_governor *g, const sv_governor_cfg *cfg, sv_ns now_ns) {
  *g = (sv_governor){.cfg = *cfg, .window_ns = now_ns, .preview_ns = now_ns, .now_ns = now_ns, .slowdown = 1};
}

// At the end of a window: did training get its share?
static void judge(sv_governor *g, sv_ns now_ns) {
  double share = (double)g->spent_ns[SV_WORK_TRAIN] / (double)(now_ns - g->window_ns);
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

sv_work sv_governor_next(sv_governor *g, sv_ns now_ns, bool is_exposure_ready) {
  if (now_ns > g->now_ns) {
    g->credit_ns += (sv_ns)((double)(now_ns - g->now_ns) * g->cfg.train_floor);
    if (g->credit_ns > MOST_OWED_NS) g->credit_ns = MOST_OWED_NS;
    g->now_ns = now_ns;
  }
  if (now_ns - g->window_ns >= WINDOW_NS) judge(g, now_ns);
  if (is_exposure_ready) return g->credit_ns > 0 ? SV_WORK_TRAIN : SV_WORK_EXPOSURE;
  if (g->cfg.preview_every_ns > 0 && now_ns - g->preview_ns >= g->cfg.preview_every_ns * g->slowdown)
    return SV_WORK_PREVIEW;
  return SV_WORK_TRAIN;
}

void sv_governor_done(sv_governor *g, sv_work work, sv_ns from_ns, sv_ns now_ns) {
  sv_ns took_ns = now_ns > from_ns ? now_ns - from_ns : 0;
  g->n[work]++;
  g->spent_ns[work] += took_ns;
  if (work == SV_WORK_TRAIN) {
    g->credit_ns -= took_ns;
    if (g->credit_ns < -MOST_OWED_NS) g->credit_ns = -MOST_OWED_NS;
  }
  if (work == SV_WORK_PREVIEW) g->preview_ns = now_ns;
}
