// SPDX-License-Identifier: Apache-2.0
#include "src/sync/frame_length.h"

#include <math.h>
#include <string.h>

#define LOST_NS   SV_NS_PER_S // a leading camera that is silent for so long leads no more
#define GAIN_RATE 0.1         // of the newest difference between two measurements

sv_status sv_frame_length_init(sv_frame_length *f, const sv_frame_length_cfg *cfg, sv_arena *arena) {
  memset(f, 0, sizeof *f);
  if (cfg->n_cameras < 1 || cfg->period_ns < 1 || cfg->dead_band_ns < 0) return SV_E_ARG;
  f->cfg = *cfg;
  if (!f->cfg.dead_band_ns) f->cfg.dead_band_ns = 20 * SV_NS_PER_US;
  f->cameras = SV_TAKE(arena, sv_frame_length_camera, cfg->n_cameras);
  if (arena->status < 0) return arena->status;
  for (int i = 0; f->cameras && i < cfg->n_cameras; i++)
    f->cameras[i] = (sv_frame_length_camera){.set_ns = cfg->period_ns};
  return SV_OK;
}

// The first camera that is there: the same one as long as it lives.
static int leader(const sv_frame_length *f, sv_ns now_ns) {
  for (int i = 0; i < f->cfg.n_cameras; i++)
    if (f->cameras[i].has_frame && now_ns - f->cameras[i].mid_ns < LOST_NS) return i;
  return -1;
}

static double clamp(double x, double most) { return x > most ? most : x < -most ? -most : x; }

// Of (-period/2, period/2]: frames of the leader are a whole number of periods apart.
static double phase(const sv_frame_length *f, sv_ns mid_ns, sv_ns leading_ns) {
  double p = (double)f->cfg.period_ns, d = (double)(mid_ns - leading_ns);
  d -= p * floor(d / p);
  return d > 0.5 * p ? d - p : d;
}

// What the oscillators do, from two measurements with the correction between them taken off.
static void learn_rate(const sv_frame_length *f, sv_frame_length_camera *c, double mean_ns) {
  double p = (double)f->cfg.period_ns, most = SV_FRAME_LENGTH_DRIFT * p;
  uint32_t n = c->i_frame - c->i_phase;
  double grown_ns = mean_ns - c->phase_ns;
  if (c->has_phase && n && fabs(grown_ns) < 0.25 * p)
    c->rate_ns += GAIN_RATE * (clamp(grown_ns / n, most) - c->rate_ns);
  c->has_phase = true;
  c->phase_ns = mean_ns;
  c->i_phase = c->i_frame;
}

// Frames are made so much longer, for so many frames, that the phase is zero midway to the next
// correction.
static bool plan(sv_frame_length *f, sv_frame_length_camera *c, double mean_ns, sv_ns *duration_ns) {
  double p = (double)f->cfg.period_ns, most = SV_FRAME_LENGTH_MAX * p;
  int cycle = SV_FRAME_LENGTH_MEASURE + SV_FRAME_LENGTH_SETTLE;
  double want_ns =
      -(mean_ns + c->rate_ns * (0.5 * SV_FRAME_LENGTH_MEASURE + SV_FRAME_LENGTH_SETTLE + 0.5 * cycle));
  if (fabs(want_ns) <= (double)f->cfg.dead_band_ns) return false;
  // Few large changes follow faster, many small ones are finer: as few as the bound allows.
  double n = ceil(fabs(want_ns) / most);
  c->n_changed = n > SV_FRAME_LENGTH_BURST ? SV_FRAME_LENGTH_BURST : (int)n;
  *duration_ns = f->cfg.period_ns + (sv_ns)floor(clamp(want_ns / c->n_changed, most) + 0.5);
  return *duration_ns != f->cfg.period_ns;
}

bool sv_frame_length_frame(sv_frame_length *f, int i, sv_ns mid_ns, sv_ns *duration_ns) {
  sv_frame_length_camera *c = &f->cameras[i];
  int lead = leader(f, mid_ns);
  c->has_frame = true;
  c->mid_ns = mid_ns;
  c->i_frame++;
  if (c->is_off) return false;
  c->n_frames++;
  if (c->state == SV_FRAME_LENGTH_CHANGED) { // also of a camera that leads by now
    if (c->n_frames < c->n_changed) return false;
    *duration_ns = f->cfg.period_ns;
    f->n_commands++;
    return true;
  }
  if (c->state == SV_FRAME_LENGTH_SETTLING) {
    if (c->n_frames < SV_FRAME_LENGTH_SETTLE) return false;
    c->state = SV_FRAME_LENGTH_MEASURING;
    c->n_frames = 0;
    c->sum_ns = 0;
    return false;
  }
  if (lead < 0 || lead == i) {
    c->n_frames = 0;
    c->sum_ns = 0;
    return false;
  }
  double e = phase(f, mid_ns, f->cameras[lead].mid_ns), p = (double)f->cfg.period_ns;
  // Half a period off, noise flips the sign and the mean would be zero: stay on the side of the
  // first one.
  if (c->n_frames > 1 && fabs(e - c->sum_ns / (c->n_frames - 1)) > 0.5 * p) e += e < 0 ? p : -p;
  c->sum_ns += e;
  if (c->n_frames < SV_FRAME_LENGTH_MEASURE) return false;
  double mean_ns = c->sum_ns / c->n_frames;
  learn_rate(f, c, mean_ns);
  c->n_frames = 0;
  c->sum_ns = 0;
  if (!plan(f, c, mean_ns, duration_ns)) return false;
  f->n_commands++;
  return true;
}

void sv_frame_length_set(sv_frame_length *f, int i, sv_ns set_ns) {
  sv_frame_length_camera *c = &f->cameras[i];
  bool was_changed = c->state == SV_FRAME_LENGTH_CHANGED;
  c->is_off = set_ns <= 0;
  if (was_changed) c->phase_ns += (double)(c->set_ns - f->cfg.period_ns) * c->n_changed;
  c->set_ns = c->is_off ? f->cfg.period_ns : set_ns;
  c->state = was_changed ? SV_FRAME_LENGTH_SETTLING : SV_FRAME_LENGTH_CHANGED;
  c->n_frames = 0;
}

void sv_frame_length_forget(sv_frame_length *f, int i) {
  sv_frame_length_camera *c = &f->cameras[i];
  c->has_phase = c->has_frame = false;
  if (c->state == SV_FRAME_LENGTH_CHANGED) return; // its frames get their length back first
  c->state = SV_FRAME_LENGTH_MEASURING;
  c->n_frames = 0;
  c->sum_ns = 0;
}
