// SPDX-License-Identifier: Apache-2.0
#include "src/preview/preview.h"

#include <math.h>
#include <string.h>

#include "src/base/mathx.h"
#include "src/base/str.h"
#include "src/preview/pictures.h"
#include "src/splat/constants.h"

#define STATE_PERIOD_S 0.25
#define MODEL_PERIOD_S 1.0
#define MODEL_SHARE    0.03 // of the time at most goes into snapshots of the model
#define POINT_PERIOD_S 0.5
#define POLL_NS        (20 * SV_NS_PER_MS)
#define SCREEN_SHARE   0.2 // of the time at most goes into the screen, unless the model is trained

static double machine_s(const sv_preview *l) {
  const sv_clock *c = &l->cfg.port->machine;
  return sv_ns_to_s(c->now_ns(c->self));
}

void sv_preview_carve(sv_preview *l, const sv_preview_parts *parts, sv_arena *a) {
  if (!parts->is_on) return;
  sv_arena_part_begin(a, "live view");
  l->cameras = SV_TAKE(a, sv_preview_camera, parts->n_cameras);
  l->tiles = SV_TAKE(a, sv_feed_tiles, 1);
  l->curve = SV_TAKE(a, sv_feed_curve, 1);
  l->events = SV_TAKE(a, sv_feed_events, 1);
  l->counts = SV_TAKE(a, sv_preview_counts, 2);
  if (parts->has_screen) sv_screen_carve(&l->screen, a);
}

void sv_preview_init(sv_preview *l, const sv_preview_cfg *cfg) { l->cfg = *cfg; }

void sv_preview_start(sv_preview *l) {
  l->feed = l->tiles && l->events ? l->cfg.port->publish.feed : NULL;
  if (!l->feed) return;
  memset(l->cameras, 0, sizeof *l->cameras * (size_t)l->cfg.n_cameras);
  memset(l->tiles, 0, sizeof *l->tiles);
  memset(l->counts, 0, 2 * sizeof *l->counts);
  memset(l->curve, 0, sizeof *l->curve);
  memset(l->events, 0, sizeof *l->events);
  l->curve->stride = 1;
  l->tiles->n = sv_mini(l->cfg.n_cameras, SV_FEED_CAP_TILES);
  l->is_session = l->cfg.is_session;
  l->is_coded = l->cfg.exposures->sub != NULL;
  for (int i = 0; i < l->cfg.n_cameras; i++)
    if (sv_pixel(l->cfg.caps[i].format)->layout != SV_LAYOUT_CODED) l->is_coded = false;
  l->start_s = machine_s(l);
  l->status = SV_FEED_STATUS_CAPTURING;
  // An older run's model and pictures are no longer what is there: readers see 0 Gaussians.
  memset(sv_feed_begin(l->feed, SV_FEED_MODEL), 0, sizeof(sv_feed_model));
  sv_feed_commit(l->feed, SV_FEED_MODEL, sizeof(sv_feed_model));
  memset(sv_feed_begin(l->feed, SV_FEED_PICTURE), 0, sizeof(sv_feed_picture));
  sv_feed_commit(l->feed, SV_FEED_PICTURE, sizeof(sv_feed_picture));
  sv_screen_start(&l->screen, l->feed, &l->cfg.port->display);
}

// --- state ---------------------------------------------------------------------------------------

static void fill_cameras(const sv_preview *l, sv_feed_state *s) {
  s->n_cameras = sv_mini(l->cfg.n_cameras, SV_FEED_CAP_CAMERAS);
  for (int i = 0; i < s->n_cameras; i++) {
    sv_feed_camera *c = &s->cameras[i];
    const sv_preview_camera *lc = &l->cameras[i];
    const sv_ledger *ledger = sv_preview_ledger(l, i);
    memset(c, 0, sizeof *c);
    sv_copy(c->name, sizeof c->name, l->cfg.caps[i].name);
    c->width_px = l->cfg.caps[i].width_px;
    c->height_px = l->cfg.caps[i].height_px;
    c->fps = lc->fps;
    c->n_tiles = lc->n_tiles;
    c->captured = ledger->captured;
    c->delivered = ledger->delivered;
    c->pending = ledger->pending;
    c->dropped = sv_ledger_dropped(ledger);
    for (int r = 0; r < SV_N_DROPS && r < SV_FEED_CAP_REASONS; r++) c->dropped_by[r] = ledger->dropped[r];
  }
  s->n_reasons = sv_mini(SV_N_DROPS, SV_FEED_CAP_REASONS);
  for (int r = 0; r < s->n_reasons; r++)
    sv_copy(s->reasons[r], sizeof s->reasons[r], sv_drop_name((sv_drop_reason)r));
}

// Eighths of an octave of nanoseconds -> quarters of an octave from 1 us.
static void fill_skew(const sv_preview *l, sv_feed_state *s) {
  const sv_skew_stats *k = sv_preview_skew(l);
  s->n_skew = k->n;
  s->skew_p50_us = (double)sv_skew_percentile_ns(k, 50) * 1e-3;
  s->skew_p99_us = (double)sv_skew_percentile_ns(k, 99) * 1e-3;
  s->skew_max_us = (double)k->max_ns * 1e-3;
  memset(s->skew_bins, 0, sizeof s->skew_bins);
  for (int b = 0; b < SV_SKEW_BINS; b++) {
    int q = sv_clampi(b / 2 - 32, 0, SV_FEED_SKEW_BINS - 1); // sync's bin 64 begins at 1.024 us
    s->skew_bins[q] += (uint32_t)k->bins[b];
  }
}

static void fill_machine(sv_preview *l, sv_feed_state *s) {
  const sv_arena *a = l->cfg.arena;
  const sv_heat heat = l->cfg.calls.heat(l->cfg.calls.self);
  s->temperature_c = heat.temperature_c;
  s->is_throttled = heat.is_throttled;
  s->train_duty = l->cfg.capture->governor.duty;
  s->arena_cap_bytes = a->cap_bytes;
  s->arena_used_bytes = a->used_bytes;
  s->n_parts = sv_mini(a->n_parts, SV_FEED_CAP_PARTS);
  for (int i = 0; i < s->n_parts; i++) {
    sv_copy(s->parts[i].name, sizeof s->parts[i].name, a->parts[i].name);
    s->parts[i].bytes = a->parts[i].bytes;
  }
}

_Static_assert(SV_GUIDANCE_CELLS <= SV_FEED_CAP_CELLS, "the dome does not fit the feed");

static void fill_guidance(const sv_preview *l, sv_feed_guidance *f) {
  const sv_guidance *g = &l->cfg.capture->guidance;
  sv_copy(f->hint, sizeof f->hint, sv_hint_name(g->hint));
  f->n_kept = g->n_kept;
  f->n_good = g->n_good;
  f->n_bands = SV_GUIDANCE_BANDS;
  f->n_sectors = SV_GUIDANCE_SECTORS;
  f->i_cell = g->i_cell;
  f->i_target = g->i_target;
  f->coverage = sv_guidance_coverage(g);
  for (int i = 0; i < SV_GUIDANCE_CELLS; i++)
    f->covered_percent[i] =
        g->has_scene && g->cell_weight[i] > 0 ? (int8_t)(100 * sv_guidance_cell(g, i) + 0.5) : -1;
}

static void publish_state(sv_preview *l, const char *sentence) {
  const sv_trainer *t = l->cfg.trainer;
  sv_feed_state *s = sv_feed_begin(l->feed, SV_FEED_STATE);
  memset(s, 0, offsetof(sv_feed_state, cameras));
  s->status = l->status;
  sv_copy(s->sentence, sizeof s->sentence, sentence ? sentence : "");
  if (l->status == SV_FEED_STATUS_FAILED) s->cause = SV_CAUSE_OTHER;
  sv_copy(s->board, sizeof s->board, l->cfg.board_name ? l->cfg.board_name : "");
  sv_copy(s->source, sizeof s->source, l->cfg.source_name ? l->cfg.source_name : "");
  sv_copy(s->rig, sizeof s->rig, l->cfg.rig->name);
  s->is_session = l->is_session;
  s->budget = l->cfg.has_budget ? (int32_t)l->budget : -1;
  s->n_exposures = l->cfg.exposures->n;
  s->cap_exposures = l->cfg.n_exposures;
  s->n_views = sv_driver_n_views(t);
  s->step = t->step;
  s->steps = l->cfg.steps;
  s->train_s = t->trained_s;
  s->time_limit_s = l->cfg.time_limit_s;
  s->steps_per_s = sv_driver_steps_per_s(l->cfg.driver);
  s->loss = l->cfg.driver->loss;
  s->psnr = l->psnr;
  s->n_gaussians = (uint32_t)t->cfg.n_gaussians;
  s->sh_degree = (uint32_t)t->cfg.sh_degree;
  s->n_saves = l->n_saves;
  s->n_device_errors = l->cfg.capture->n_device_errors;
  s->model_seq = sv_feed_seq(l->feed, SV_FEED_MODEL);
  s->history_s = sv_ns_to_s(sv_history_span_ns(l->cfg.history));
  fill_machine(l, s);
  fill_skew(l, s);
  fill_guidance(l, &s->guidance);
  fill_cameras(l, s);
  sv_feed_commit(l->feed, SV_FEED_STATE, sizeof *s);
}

// --- screen --------------------------------------------------------------------------------------

static void screen_line(const sv_preview *l, char *out, size_t cap) {
  const sv_guidance *g = &l->cfg.capture->guidance;
  const sv_trainer *t = l->cfg.trainer;
  const char *hint = sv_hint_name(g->hint);
  switch (l->status) {
  case SV_FEED_STATUS_WAITING: sv_copy(out, cap, "Waiting for Start on the page"); break;
  case SV_FEED_STATUS_CAPTURING:
    sv_fmt(out, cap, "Capturing: %d of %d exposures%s%s", l->cfg.exposures->n, l->cfg.n_exposures,
           *hint ? "; " : "", hint);
    break;
  case SV_FEED_STATUS_TRAINING:
    if (l->cfg.steps) sv_fmt(out, cap, "Training: step %u of %u", t->step, l->cfg.steps);
    else sv_fmt(out, cap, "Training: step %u, %.0f of %.0f s", t->step, t->trained_s, l->cfg.time_limit_s);
    break;
  case SV_FEED_STATUS_PAUSED: sv_fmt(out, cap, "Paused at step %u", t->step); break;
  case SV_FEED_STATUS_SAVING: sv_copy(out, cap, "Saving"); break;
  case SV_FEED_STATUS_DONE: sv_fmt(out, cap, "Done after %u steps", t->step); break;
  default: sv_copy(out, cap, l->sentence); break;
  }
}

static void show_on_screen(sv_preview *l, bool is_new) {
  const sv_display *d = &l->cfg.port->display;
  sv_screen *s = &l->screen;
  const double now = machine_s(l);
  char line[256];
  if (!s->tiles || !d->begin || (!is_new && now < s->next_s)) return;
  if (l->status == SV_FEED_STATUS_FAILED) {
    sv_screen_message(d, l->sentence);
    return;
  }
  screen_line(l, line, sizeof line);
  const bool has_model = l->status == SV_FEED_STATUS_TRAINING || l->status == SV_FEED_STATUS_PAUSED ||
                         l->status == SV_FEED_STATUS_SAVING || l->status == SV_FEED_STATUS_DONE;
  sv_screen_draw(
      s, d,
      &(sv_screen_content){.t = has_model && sv_driver_n_views(l->cfg.trainer) ? l->cfg.trainer : NULL,
                           .is_waiting = l->status == SV_FEED_STATUS_WAITING,
                           .line = line,
                           .now_s = now});
  const double took = machine_s(l) - now;
  const double share = l->status == SV_FEED_STATUS_TRAINING ? MODEL_SHARE : SCREEN_SHARE;
  s->next_s = now + (took / share > SV_SCREEN_STEP_S ? took / share : SV_SCREEN_STEP_S);
}

void sv_preview_show(sv_preview *l, sv_feed_status status, const char *sentence) {
  if (!l->feed) return;
  l->status = status;
  sv_copy(l->sentence, sizeof l->sentence, sentence ? sentence : "");
  publish_state(l, sentence);
  show_on_screen(l, true);
}

void sv_preview_show_failure(sv_feed *feed, sv_feed_cause cause, const char *board, const char *source,
                             bool is_session, const char *sentence) {
  if (!feed) return;
  sv_feed_state *s = sv_feed_begin(feed, SV_FEED_STATE);
  memset(s, 0, sizeof *s);
  s->status = SV_FEED_STATUS_FAILED;
  s->cause = (int32_t)cause;
  s->budget = -1;
  s->is_session = is_session;
  s->temperature_c = NAN;
  s->is_throttled = -1;
  s->train_duty = 1;
  sv_copy(s->sentence, sizeof s->sentence, sentence);
  sv_copy(s->board, sizeof s->board, board);
  sv_copy(s->source, sizeof s->source, source);
  sv_feed_commit(feed, SV_FEED_STATE, sizeof *s);
}

// --- events and curve ----------------------------------------------------------------------------

void sv_preview_event(sv_preview *l, sv_log_level level, const char *text) {
  if (!l->feed || level == SV_LOG_LIVE) return;
  sv_feed_event *e = &l->events->event[l->events->n_total++ % SV_FEED_CAP_EVENTS];
  e->seconds = machine_s(l) - l->start_s;
  e->level = (int32_t)level;
  sv_copy(e->text, sizeof e->text, text);
  l->has_new_event = true;
}

// When the history is full every second point goes and the next ones are twice as far apart.
static void add_point(sv_preview *l, double now) {
  sv_feed_curve *c = l->curve;
  if (now < l->point_s) return;
  l->point_s = now + POINT_PERIOD_S;
  if (l->cfg.driver->step_time.n == 0 || l->n_points++ % c->stride) return;
  if (c->n == SV_FEED_CAP_POINTS) {
    for (uint32_t i = 0; i < SV_FEED_CAP_POINTS / 2; i++) c->point[i] = c->point[2 * i];
    c->n = SV_FEED_CAP_POINTS / 2;
    c->stride *= 2;
  }
  c->point[c->n++] = (sv_feed_point){.seconds = (float)l->cfg.driver->train_s,
                                     .loss = (float)l->cfg.driver->loss,
                                     .psnr = (float)l->psnr,
                                     .steps_per_s = (float)((double)l->cfg.driver->step_time.n /
                                                            sv_maxf(1e-3f, (float)l->cfg.driver->train_s)),
                                     .step = l->cfg.trainer->step};
  memcpy(sv_feed_begin(l->feed, SV_FEED_CURVE), c, sizeof *c);
  sv_feed_commit(l->feed, SV_FEED_CURVE, sizeof *c);
}

// --- model and picture ---------------------------------------------------------------------------

static void fill_viewpoint(const sv_preview *l, sv_feed_model *m) {
  const sv_trainer *t = l->cfg.trainer;
  const sv_view *v = sv_driver_n_views(t) ? sv_driver_view(t, 0) : NULL;
  for (int k = 0; k < 3; k++) m->centre[k] = t->centre[k];
  m->radius = t->radius;
  const sv_unit unit = l->cfg.calls.unit(l->cfg.calls.self);
  m->is_metric = unit.is_metric;
  m->scale_sigma = unit.scale_sigma;
  sv_pictures_up(t, m->up);
  m->eye[2] = -3;
  m->fov_y = 0.8f;
  if (!v) return;
  sv_view_centre(m->eye, v);
  m->fov_y = 2 * (float)sv_atan2(0.5 * v->height_px, (double)v->fy);
}

static void fill_eyes(const sv_preview *l, sv_feed_model *m) {
  const sv_trainer *t = l->cfg.trainer;
  const int n_views = sv_driver_n_views(t), n = sv_mini(n_views, SV_FEED_CAP_EYES);
  for (int i = 0; i < n; i++) {
    const sv_view *v = sv_driver_view(t, (int)((int64_t)i * n_views / n));
    sv_feed_eye *e = &m->eyes[m->n_eyes++];
    const float x = (float)v->width_px / v->fx, y = (float)v->height_px / v->fy;
    sv_view_centre(e->eye, v);
    for (int k = 0; k < 3; k++) e->forward[k] = v->r[6 + k];
    e->tan_half = 0.5f * sqrtf(x * x + y * y);
  }
}

size_t sv_preview_motion_floats(const sv_dynamic_cfg *d) {
  const size_t rows = d->kind == SV_DEFORM_CLIP ? (size_t)SV_N_MROWS(d->n_pos, d->n_rot, d->n_colour) : 0;
  return rows + sv_dynamic_has_bodies(d); // and which body
}

size_t sv_preview_bodies_floats(const sv_dynamic_cfg *d) {
  return sv_dynamic_has_bodies(d) ? SV_FEED_BODIES_FLOATS(SV_CAP_BODIES, SV_CAP_KNOTS, 0) : 0;
}

// Which times there are pictures of.
static void fill_times(const sv_preview *l, sv_feed_model *m) {
  const sv_exposures *e = l->cfg.exposures;
  sv_ns first_ns = e->exposure[0].time_ns, last_ns = first_ns;
  for (int i = 1; i < e->n; i++) {
    if (e->exposure[i].time_ns < first_ns) first_ns = e->exposure[i].time_ns;
    if (e->exposure[i].time_ns > last_ns) last_ns = e->exposure[i].time_ns;
  }
  m->time_min = l->cfg.calls.time_of(l->cfg.calls.self, first_ns);
  m->time_max = l->cfg.calls.time_of(l->cfg.calls.self, last_ns);
  m->seconds = (float)sv_ns_to_s(last_ns - first_ns);
}

_Static_assert(SV_FEED_CAP_BODIES >= SV_CAP_BODIES && SV_FEED_CAP_KNOTS >= SV_CAP_KNOTS,
               "what the page takes");

static void fill_bodies(const sv_motion *mo, sv_feed_model *m, float *out) {
  const sv_bodies *b = &mo->bodies;
  m->n_bodies = (uint32_t)b->n;
  m->n_knots = (uint32_t)b->n_knots;
  memcpy(out, b->centre, (size_t)b->n * sizeof *b->centre);
  out += 3 * b->n;
  memcpy(out, b->time, (size_t)b->n_knots * sizeof *b->time);
  out += b->n_knots;
  for (int i = 0; i < b->n * b->n_knots; i++, out += 7) {
    const sv_rigid *knot = sv_bodies_knot(b, i / b->n_knots, i % b->n_knots);
    memcpy(out, knot->q, sizeof knot->q);
    memcpy(out + 4, knot->d, sizeof knot->d);
  }
  for (int i = 0; i < mo->n_moving; i++) *out++ = (float)b->of[i];
}

static void fill_motion(const sv_preview *l, sv_feed_model *m, float *row) {
  const sv_motion *mo = &l->cfg.dynamic->deform.motion;
  m->n_moving = (uint32_t)mo->n_moving;
  m->n_motion = (uint32_t)mo->n_rows;
  m->motion = mo->cfg.functions == SV_MOTION_CHEBYSHEV ? SV_FEED_CHEBYSHEV : SV_FEED_POWERS;
  m->n_pos = (uint32_t)mo->cfg.n_pos;
  m->n_rot = (uint32_t)mo->cfg.n_rot;
  m->n_colour = (uint32_t)mo->cfg.n_colour;
  m->t0 = mo->cfg.t0;
  fill_times(l, m);
  for (int i = 0; i < mo->n_moving; i++)
    for (int r = 0; r < mo->n_rows; r++) *row++ = *sv_motion_row(mo, i, r);
  if (mo->bodies.n > 1) fill_bodies(mo, m, row);
}

static size_t motion_floats(const sv_dynamic *dyn) {
  const sv_motion *mo = &dyn->deform.motion;
  if (dyn->deform.kind != SV_DEFORM_CLIP) return 0;
  return (size_t)mo->n_rows * (size_t)mo->n_moving +
         (mo->bodies.n > 1 ? SV_FEED_BODIES_FLOATS(mo->bodies.n, mo->bodies.n_knots, mo->n_moving) : 0);
}

static void publish_model(sv_preview *l) {
  const sv_trainer *t = l->cfg.trainer;
  sv_feed *feed = l->feed;
  const bool is_moving = l->cfg.dynamic->deform.kind == SV_DEFORM_CLIP;
  const size_t n_floats = SV_GAUSSIAN_N_FLOATS(t->g.sh_degree);
  const size_t bytes =
      sizeof(sv_feed_model) + sizeof(float) * (n_floats * (size_t)t->g.n + motion_floats(l->cfg.dynamic));
  if (!t->g.n || bytes > sv_feed_cap(feed, SV_FEED_MODEL)) return;
  sv_feed_model *m = sv_feed_begin(feed, SV_FEED_MODEL);
  memset(m, 0, sizeof *m);
  m->n = (uint32_t)t->g.n;
  m->sh_degree = (uint32_t)t->g.sh_degree;
  m->n_floats = (uint32_t)n_floats;
  m->is_mip = t->cfg.is_antialiased;
  m->step = t->step;
  m->background = t->background.rgb;
  m->dilation_px2 = t->cfg.dilation_px2 > 0 ? t->cfg.dilation_px2 : SV_DILATION_PX2;
  fill_viewpoint(l, m);
  fill_eyes(l, m);
  float *row = (float *)(m + 1);
  for (int i = 0; i < t->g.n; i++, row += n_floats) {
    sv_gaussian g;
    sv_gaussians_get(&t->g, i, &g);
    memcpy(row, &g, n_floats * sizeof *row);
  }
  if (is_moving) fill_motion(l, m, row);
  sv_feed_commit(feed, SV_FEED_MODEL, bytes);
}

void sv_preview_show_model(sv_preview *l) {
  if (!l->feed) return;
  double t0 = machine_s(l);
  publish_model(l);
  double took = machine_s(l) - t0;
  l->next_model_s = t0 + (took / MODEL_SHARE > MODEL_PERIOD_S ? took / MODEL_SHARE : MODEL_PERIOD_S);
}

// The next training picture beside its rendering, and its PSNR; the running mean forgets the start
// quickly.
static void show_picture(sv_preview *l) {
  sv_feed_picture *p = sv_feed_begin(l->feed, SV_FEED_PICTURE);
  sv_picture_pair pair = {.rgb = (uint8_t *)(p + 1),
                          .cap_width_px = SV_FEED_CAP_PICTURE_W,
                          .cap_height_px = SV_FEED_CAP_PICTURE_H};
  sv_status s = sv_pictures_pair(l->cfg.trainer, l->i_picture++, &pair);
  if (s < 0) return; // nothing is committed: readers keep the older image
  const size_t bytes = 3 * (size_t)pair.width_px * (size_t)pair.height_px;
  *p =
      (sv_feed_picture){.width_px = pair.width_px, .height_px = pair.height_px, .step = l->cfg.trainer->step};
  sv_feed_commit(l->feed, SV_FEED_PICTURE, sizeof *p + bytes);
  l->psnr = l->psnr > 0 ? 0.6 * l->psnr + 0.4 * pair.psnr : pair.psnr;
}

static bool is_stopping(const sv_preview *l) { return l->cfg.calls.is_stopping(l->cfg.calls.self); }

// --- the beat ------------------------------------------------------------------------------------

static void publish_due(sv_preview *l) {
  double now = machine_s(l);
  if (l->has_new_event) {
    memcpy(sv_feed_begin(l->feed, SV_FEED_EVENTS), l->events, sizeof *l->events);
    sv_feed_commit(l->feed, SV_FEED_EVENTS, sizeof *l->events);
    l->has_new_event = false;
  }
  if (l->status == SV_FEED_STATUS_TRAINING) {
    if (now >= l->next_model_s) sv_preview_show_model(l);
    if (now >= l->next_picture_s) {
      show_picture(l);
      double took = machine_s(l) - now;
      l->next_picture_s = now + (took / MODEL_SHARE > MODEL_PERIOD_S ? took / MODEL_SHARE : MODEL_PERIOD_S);
    }
    add_point(l, now);
  }
  if (now >= l->next_state_s) {
    l->next_state_s = now + STATE_PERIOD_S;
    publish_state(l, NULL);
  }
  show_on_screen(l, false);
}

static sv_command next_command(sv_preview *l) {
  const sv_publish *p = &l->cfg.port->publish;
  sv_command c = p->command ? p->command(p->self) : SV_COMMAND_NONE;
  if (p->looked_at) l->looked_at = p->looked_at(p->self);
  if (c == SV_COMMAND_HISTORY) sv_preview_show_history(l);
  if (c == SV_COMMAND_NEW) l->is_new_requested = l->is_session;
  // Before a run the cameras are opened again; else the next run has the new mode
  if (c == SV_COMMAND_MODE && l->status == SV_FEED_STATUS_WAITING) l->is_new_requested = l->is_session;
  // The cameras are free before and after a run
  if (c == SV_COMMAND_CALIBRATE && (l->status == SV_FEED_STATUS_WAITING || l->status == SV_FEED_STATUS_DONE))
    l->is_new_requested = l->is_calibration_requested = l->is_session;
  return c;
}

float sv_preview_budget_factor(sv_preview_budget b) {
  static const float factors[SV_N_BUDGETS] = {1, 0.25f, 3};
  return factors[b];
}

static sv_status new_or_ok(const sv_preview *l) { return l->is_new_requested ? SV_E_INTERRUPTED : SV_OK; }

static void rest(sv_preview *l) {
  l->cfg.calls.beat(l->cfg.calls.self);
  const sv_clock *c = &l->cfg.port->machine;
  c->sleep_until_ns(c->self, c->now_ns(c->self) + POLL_NS);
}

sv_status sv_preview_tick(sv_preview *l) {
  if (!l->feed) return SV_OK;
  (void)next_command(l); // Pause and Save have no meaning before training
  publish_due(l);
  return new_or_ok(l);
}

static sv_status save_now(sv_preview *l, sv_err *err) {
  sv_feed_status was = l->status;
  sv_preview_show(l, SV_FEED_STATUS_SAVING, NULL);
  sv_status s = l->cfg.calls.save(l->cfg.calls.self, err);
  if (s < 0 && s != SV_E_IO) return s;
  if (s < 0) l->cfg.calls.log(l->cfg.calls.self, SV_LOG_WARN, err->text);
  else {
    l->n_saves++;
    sv_preview_show_model(l);
    sv_preview_event(l, SV_LOG_INFO, "saved model.ply and checkpoint.bin");
  }
  sv_preview_show(l, was, NULL);
  return SV_OK;
}

sv_status sv_preview_between_steps(sv_preview *l, double *paused_s, sv_err *err) {
  bool was_away = false; // showing is training time, waiting and saving are not
  *paused_s = 0;
  if (!l->feed) return SV_OK;
  double t0 = machine_s(l);
  do {
    sv_command c = next_command(l);
    if (c == SV_COMMAND_PAUSE && !l->is_paused) {
      l->is_paused = true;
      sv_preview_show_model(l);
      sv_preview_show(l, SV_FEED_STATUS_PAUSED, NULL);
    }
    if (c == SV_COMMAND_START && l->is_paused) {
      l->is_paused = false;
      sv_preview_show(l, SV_FEED_STATUS_TRAINING, NULL);
    }
    if (c == SV_COMMAND_SAVE) {
      sv_status s = save_now(l, err);
      if (s < 0) return s;
      was_away = true;
    }
    publish_due(l);
    if (l->is_paused) {
      was_away = true;
      rest(l);
    }
  } while (l->is_paused && !l->is_new_requested && !is_stopping(l));
  l->is_paused = l->is_paused && !l->is_new_requested && !is_stopping(l);
  if (was_away) {
    *paused_s = machine_s(l) - t0;
    l->cfg.capture->machine_ns += (sv_ns)(*paused_s * 1e9); // virtual cameras rested, too
  }
  return new_or_ok(l);
}

sv_status sv_preview_wait_start(sv_preview *l, sv_err *err) {
  const sv_source *src = &l->cfg.port->source;
  const sv_clock *host = &l->cfg.port->clock, *machine = &l->cfg.port->machine;
  if (!l->feed || !l->is_session || l->cfg.starts_at_once) return SV_OK;
  l->status = SV_FEED_STATUS_WAITING;
  sv_status s = src->start(src->self);
  if (s < 0) return sv_fail(err, s, "the cameras did not start: %s", sv_status_text(s));
  sv_ns ahead_ns = machine->now_ns(machine->self) - host->now_ns(host->self);
  bool is_over = false;
  for (sv_command c = SV_COMMAND_NONE; c != SV_COMMAND_START && s >= 0; c = next_command(l)) {
    l->cfg.calls.beat(l->cfg.calls.self);
    publish_due(l);
    if (is_stopping(l) || l->is_new_requested) s = SV_E_INTERRUPTED;
    if (l->cfg.has_budget && c >= SV_COMMAND_NORMAL) l->budget = (sv_preview_budget)(c - SV_COMMAND_NORMAL);
    sv_frame f;
    sv_status got = is_over ? SV_AGAIN : src->dequeue(src->self, &f, host->now_ns(host->self) + POLL_NS);
    if (got == SV_OK) {
      sv_preview_frame(l, &f);
      if (!f.is_error) sv_preview_decode(l, &f);
      if (src->requeue(src->self, &f) < 0) l->cfg.capture->n_device_errors++;
      // A simulated or replayed clock must not run ahead of the person who watches.
      machine->sleep_until_ns(machine->self, f.arrival_ns + ahead_ns);
    } else {
      if (got == SV_END) is_over = true;
      if (got < 0) l->cfg.capture->n_device_errors++;
      rest(l);
    }
  }
  sv_status stopped = src->stop(src->self);
  if (s >= 0 && stopped < 0)
    return sv_fail(err, stopped, "the cameras did not stop: %s", sv_status_text(stopped));
  l->status = SV_FEED_STATUS_CAPTURING;
  return s;
}

sv_status sv_preview_stay(sv_preview *l) {
  if (!l->feed || !l->is_session) return SV_OK;
  while (!is_stopping(l)) {
    (void)next_command(l);
    if (l->is_new_requested) return SV_AGAIN;
    publish_due(l);
    rest(l);
  }
  return SV_OK;
}
