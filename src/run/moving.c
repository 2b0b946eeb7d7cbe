// SPDX-License-Identifier: Apache-2.0
// Moving scenes in a run. A clip: exposures are captured first, their times run from 0 to 1, and
// the motion is a few functions of that time. Live: exposures stream through a ring; times are
// seconds before the newest exposure, and the motion is a power series about it, which is moved on
// with each new one, so that the last model's motion is the start of the next; what is not there
// gets Gaussians from the newest exposure's depth maps. Each exposure gets a fixed time; what came
// meanwhile is left out as whole exposures (src/sync/capture_queue.h).
#include "src/run/app.h"
#include "src/base/mathx.h"
#include "src/metric/metric.h"
#include "src/train/objective.h"
#include "src/dynamic/renew.h"

#define CONTINUOUS_RATE 1.5f
#define FIND_EVERY      16   // exposures between two searches for what moves
#define STEADY_PROGRESS 0.5f // all detail is on, and dead Gaussians are relocated
// of a Gaussian; a smaller one only blinks, and Adam never ends shrinking it
#define MIN_SCALE_PX    0.1f
#define MEAN_EXPOSURES  50.0 // that psnr_late is a mean of, about
#define USUAL_EXPOSURES 5000.0
#define FALL_DB         3.0 // below the usual PSNR
#define RECOVERED_DB    1.5
#define FALL_EXPOSURES  100 // before which nothing is usual
// With fewer steps for each exposure, images of half the size give better models
// (docs/notes/motion.md).
#define LEAST_STEPS   8.0f
#define REDUCED       2
#define REDUCED_STEPS 3.0f // as many in the same time
#define ENOUGH_STEPS  1.5f // times what is needed: then full size again
#define MEAN_TURNS    8.0f

void sv_app_plan_moving(const sv_app_cfg *c, sv_train_cfg *t) {
  t->has_motion = true;
  t->n_novel = 0;
  if (!c->is_continuous) return;
  // Every exposure is like the last one: nothing cools down, and there are but a few dozen steps
  // for what is new in it.
  t->lr.mean_start = t->lr.mean_end = 9.6e-4f;
  if (!c->optimizer) t->optimizer = SV_OPTIMIZER_ADAM; // too few for an estimate of the curvature
  t->lr.quat *= CONTINUOUS_RATE;
  t->lr.scale *= CONTINUOUS_RATE;
  t->lr.sh0 *= 2 * CONTINUOUS_RATE;
  t->lr.logit *= 2 * CONTINUOUS_RATE;
  t->start_scale = 1;
  t->relocate_until = 1;
  t->reg_opacity_until = 1;
  t->relocate_share = 0;
  t->noise = 0;
  t->min_scale_px = MIN_SCALE_PX;
}

float sv_app_steady_progress(const sv_app_cfg *c) {
  return c->is_dynamic && c->is_continuous ? STEADY_PROGRESS : 0;
}

bool sv_app_has_quality_fallen(const sv_app_moving *m) {
  return m->n_scored >= FALL_EXPOSURES && m->psnr_late < m->psnr_usual - FALL_DB;
}

sv_dynamic_cfg sv_app_dynamic_cfg(const sv_app_cfg *c) {
  sv_dynamic_cfg d = c->dynamic;
  d.kind = c->is_dynamic ? SV_DEFORM_CLIP : SV_DEFORM_NONE;
  sv_dynamic_set_times(&d, 0, c->n_exposures);
  if (!c->is_continuous) return d;
  d.functions = SV_MOTION_POWERS;
  d.n_pos = d.n_rot = d.n_colour = 1; // exposures of a ring are too few for more
  d.lr_rot = d.lr_colour = 2e-3f;     // rates are per second, not per clip
  d.lr_body = 20;
  d.lr_window = d.window_start = 0; // windows in a time that has no end
  d.from = d.grow_until = 0;
  d.find_every = d.find_until = 0; // by exposures instead
  // One step of 60 sees an exposure of the ring, in turn, all others the newest: older ones drag
  // back what moves. What appears and disappears does so by opacity and color, faster than it
  // could travel; what the newest images show elsewhere is put there (src/dynamic/renew.h).
  d.older_every = 60;
  d.keep_hidden = sv_mini(sv_maxi(c->n_exposures, d.keep_hidden), 254);
  return d;
}

bool sv_app_has_sequence(const sv_app_cfg *cfg) {
  return cfg->is_dynamic && (!cfg->is_continuous || sv_app_has_history(cfg));
}
int sv_app_n_frames(const sv_app_cfg *cfg) { return cfg->n_exposures < 2 ? 2 : cfg->n_exposures; }

float sv_app_time_of(const sv_app *app, sv_ns time_ns) {
  if (!app->cfg.is_dynamic) return 0;
  if (app->cfg.is_continuous) return (float)sv_ns_to_s(time_ns - app->moving.first_ns);
  double span = (double)(app->moving.last_ns - app->moving.first_ns);
  return span > 0 ? sv_clampf((float)((double)(time_ns - app->moving.first_ns) / span), 0.0f, 1.0f) : 0;
}

void sv_app_begin_moving(sv_app *app) {
  const sv_exposures *e = &app->exposures;
  if (!app->cfg.is_dynamic || e->n < 1) return;
  app->moving.first_ns = app->moving.last_ns = e->exposure[0].time_ns;
  for (int i = 1; i < e->n; i++) {
    if (e->exposure[i].time_ns < app->moving.first_ns) app->moving.first_ns = e->exposure[i].time_ns;
    if (e->exposure[i].time_ns > app->moving.last_ns) app->moving.last_ns = e->exposure[i].time_ns;
  }
  app->dynamic.deform.motion.cfg.t0 = sv_app_time_of(app, app->moving.last_ns);
  app->moving.exposure_ns = app->port.machine.now_ns(app->port.machine.self);
}

bool sv_app_is_exposure_due(const sv_app *app) {
  const sv_clock *m = &app->port.machine;
  if (!app->cfg.is_dynamic) return true;
  return m->now_ns(m->self) - app->moving.exposure_ns >= (sv_ns)(app->cfg.exposure_s * 1e9);
}

static bool is_reduced(const sv_app *app) { return app->dynamic.cfg.min_scale > 1; }

// The time of an exposure is held whatever a step takes. When that leaves too few steps, images are
// trained on at half their size.
static void adapt_size(sv_app *app) {
  sv_app_moving *m = &app->moving;
  const float n = (float)(app->trainer.step - m->turn_step);
  m->turn_step = app->trainer.step;
  m->steps_mean += m->steps_mean > 0 ? (n - m->steps_mean) / MEAN_TURNS : n;
  m->n_reduced += is_reduced(app);
  if (!is_reduced(app) && m->n_scored >= MEAN_TURNS && m->steps_mean < LEAST_STEPS) {
    app->dynamic.cfg.min_scale = REDUCED;
    m->steps_mean *= REDUCED_STEPS;
    if (!m->n_reduced)
      sv_app_log(app, SV_LOG_INFO,
                 "few steps fit into the time of an exposure: training on images of half the size; fewer "
                 "--gaussians or a longer --exposure-time avoid it");
  } else if (is_reduced(app) && m->steps_mean > ENOUGH_STEPS * REDUCED_STEPS * LEAST_STEPS) {
    app->dynamic.cfg.min_scale = 1;
    m->steps_mean /= REDUCED_STEPS;
  }
}

// How the model stands to the exposure that was the newest until now, before it makes room. Where
// time is short, one of its sub-views in turn tells.
static sv_status score_newest(sv_app *app) {
  const int n = sv_app_n_trained_sub_views(&app->cfg), n_looked = is_reduced(app) ? 1 : n,
            first = (int)(app->moving.n_scored % (uint64_t)n);
  const int slot = (app->exposures.i_next + app->cfg.n_exposures - 1) % app->cfg.n_exposures;
  double sum = 0;
  for (int i = 0; i < n_looked; i++) {
    double mse;
    sv_status s = sv_driver_view_mse(&app->trainer, slot * n + (first + i) % n, NULL, &mse);
    if (s < 0) return s;
    sum += sv_psnr_of_mse(mse) / n_looked;
  }
  sv_app_moving *m = &app->moving;
  m->psnr_recent[m->n_scored % SV_APP_RECENT] = sum;
  m->n_scored++;
  m->psnr_sum += sum;
  m->psnr_late +=
      (sum - m->psnr_late) / (m->n_scored < MEAN_EXPOSURES ? (double)m->n_scored : MEAN_EXPOSURES);
  m->psnr_usual += (m->psnr_late - m->psnr_usual) / USUAL_EXPOSURES;
  if (m->psnr_usual < m->psnr_late) m->psnr_usual = m->psnr_late;
  return SV_OK;
}

double sv_app_recent_psnr(const sv_app_moving *m) {
  const int n = m->n_scored < SV_APP_RECENT ? (int)m->n_scored : SV_APP_RECENT;
  double sum = 0;
  for (int i = 0; i < n; i++) sum += m->psnr_recent[i];
  return n ? sum / n : 0;
}

// Tells the user once when quality falls, and again after it has recovered.
static void watch_quality(sv_app *app) {
  sv_app_moving *m = &app->moving;
  const bool has_fallen =
      sv_app_has_quality_fallen(m) || (m->has_fallen && m->psnr_late < m->psnr_usual - RECOVERED_DB);
  if (has_fallen && !m->has_fallen)
    sv_app_log(app, SV_LOG_WARN,
               "quality has fallen: %.1f dB in the last exposures, usually %.1f dB; are all cameras free, in "
               "focus and evenly lit, and does nothing else keep the processor busy?",
               m->psnr_late, m->psnr_usual);
  m->has_fallen = has_fallen;
}

sv_status sv_app_leave_exposure(sv_app *app) {
  if (!app->cfg.is_dynamic || !app->cfg.is_continuous) return SV_OK;
  sv_status s = score_newest(app);
  if (s >= 0) watch_quality(app);
  adapt_size(app);
  if (s >= 0) sv_app_note_history(app);
  return s;
}

// The model's time begins anew with the newest exposure, so that floats hold it for ever.
static void move_origin(sv_app *app, sv_ns newest_ns) {
  const float shift = (float)sv_ns_to_s(newest_ns - app->moving.first_ns);
  sv_motion_advance(&app->dynamic.deform.motion, &app->trainer.g, shift);
  app->dynamic.deform.motion.cfg.t0 = 0;
  sv_train_shift_times(&app->trainer, -shift);
  app->moving.first_ns = app->moving.last_ns = newest_ns;
}

sv_status sv_app_enter_exposure(sv_app *app, int slot) {
  const sv_clock *m = &app->port.machine;
  if (!app->cfg.is_dynamic) return SV_OK;
  // Turns of equal length, what it takes to change exposures included; who is late by a whole turn
  // starts anew.
  const sv_ns now_ns = m->now_ns(m->self), turn_ns = (sv_ns)(app->cfg.exposure_s * 1e9);
  app->moving.exposure_ns += turn_ns;
  if (now_ns - app->moving.exposure_ns >= turn_ns) app->moving.exposure_ns = now_ns;
  move_origin(app, app->exposures.exposure[slot].time_ns);
  sv_status s = sv_dynamic_renew(&app->dynamic, STEADY_PROGRESS, &app->scratch);
  if (s < 0 || ++app->moving.n_entered % FIND_EVERY) return s;
  return sv_dynamic_search(&app->dynamic, STEADY_PROGRESS);
}
