// SPDX-License-Identifier: Apache-2.0
// run.json and the memory map: what a run did, in numbers that add up.
#include <string.h>

#include "src/prior/methods.h"
#include "src/run/app.h"
#include "src/base/mathx.h"
#include "src/metric/metric.h"

// --- memory map ----------------------------------------------------------------------------------

void sv_app_memory_map(sv_str *out, const sv_arena *a, bool is_json) {
  for (int i = 0; i < a->n_parts; i++) {
    const sv_arena_part *p = &a->parts[i];
    double share = a->used_bytes ? 100.0 * (double)p->bytes / (double)a->used_bytes : 0;
    if (is_json) sv_str_add(out, "%s{\"name\": \"%s\", \"bytes\": %zu}", i ? ", " : "", p->name, p->bytes);
    else sv_str_add(out, "%-22s %12zu  %5.1f %%\n", p->name, p->bytes, share);
  }
}

// --- run.json ------------------------------------------------------------------------------------

// Of a live run: who got the time.
static void add_live(sv_str *s, const sv_app *app) {
  const sv_governor *g = &app->capture.governor;
  if (app->cfg.is_dynamic)
    sv_str_add(s, "  \"moving\": %d, \"renewed\": %u,\n", sv_deform_n_moving(&app->dynamic.deform),
               app->dynamic.n_renewed);
  const sv_app_moving *m = &app->moving;
  if (m->n_scored)
    sv_str_add(
        s,
        "  \"live_psnr\": %.3f, \"live_psnr_late\": %.3f, \"live_psnr_25\": %.3f, \"live_psnr_usual\": "
        "%.3f, \"live_exposures\": %llu, \"live_steps\": %.1f, \"live_reduced\": %llu,\n",
        m->psnr_sum / (double)m->n_scored, m->psnr_late, sv_app_recent_psnr(m), m->psnr_usual,
        (unsigned long long)m->n_scored, (double)m->steps_mean, (unsigned long long)m->n_reduced);
  const sv_history *h = &app->moving.history;
  if (h->n_frames > 0)
    sv_str_add(s,
               "  \"history\": {\"frames\": %d, \"seconds\": %.3f, \"bytes\": %zu, \"ring_bytes\": %zu},\n",
               h->n_frames, sv_ns_to_s(sv_history_span_ns(h)), sv_history_used_bytes(h), h->cap_bytes);
  if (!app->cfg.is_continuous) return;
  sv_str_add(s,
             "  \"live\": {\"exposures_replaced\": %llu, \"previews\": %llu, \"preview_slowdown\": %d, "
             "\"dequeue_ms\": {\"p50\": %.3f, \"p99\": %.3f, \"max\": %.3f}, \"deadline_ms\": %.3f, "
             "\"deadline_misses\": %llu},\n",
             (unsigned long long)app->exposures.n_replaced, (unsigned long long)g->n[SV_WORK_PREVIEW],
             g->slowdown, sv_ns_to_ms(sv_skew_percentile_ns(&app->queue.latency, 50)),
             sv_ns_to_ms(sv_skew_percentile_ns(&app->queue.latency, 99)),
             sv_ns_to_ms(app->queue.latency.max_ns), sv_ns_to_ms(app->queue.deadline_ns),
             (unsigned long long)app->queue.n_missed);
}

static void add_celsius(sv_str *s, const char *key, double c) {
  if (c > -300 && c < 1000) sv_str_add(s, "\"%s\": %.1f, ", key, c);
  else sv_str_add(s, "\"%s\": null, ", key);
}

// Heat, what training gave up for it, and how each thread made progress.
static void add_watch(sv_str *s, const sv_app *app) {
  const sv_heartbeats *h = app->port.heartbeats;
  const sv_governor *g = &app->capture.governor;
  sv_str_add(s, "  \"heat\": {");
  add_celsius(s, "temperature_c", app->heat.temperature_c);
  add_celsius(s, "hottest_c", app->hottest_c);
  sv_str_add(s, "\"throttled\": %d, \"train_duty\": %.3f, \"least_train_duty\": %.3f},\n",
             app->heat.is_throttled, g->duty, g->least_duty);
  if (!h) return;
  const sv_ns now_ns = h->clock.now_ns(h->clock.self);
  sv_str_add(s, "  \"heartbeats\": [");
  for (int i = 0, n = 0; i < SV_CAP_BEATS; i++) {
    char name[16];
    const sv_ns longest_ns = sv_beat_longest_ns(h->beats, i);
    if (!longest_ns && i != SV_BEAT_MAIN) continue; // there is no such thread
    sv_beat_name(i, name);
    sv_str_add(s, "%s{\"name\": \"%s\", \"age_s\": %.3f, \"longest_s\": %.3f}", n++ ? ", " : "", name,
               sv_ns_to_s(sv_beat_age_ns(h->beats, i, now_ns)), sv_ns_to_s(longest_ns));
  }
  sv_str_add(s, "],\n");
}

static void add_events(sv_str *s, const sv_sync_stream *st) {
  sv_str_add(s, ", \"events\": {");
  for (int k = 0, n = 0; k < SV_N_SYNC_EVENTS; k++)
    if (st->events[k])
      sv_str_add(s, "%s\"%s\": %llu", n++ ? ", " : "", sv_sync_event_name((sv_sync_event_kind)k),
                 (unsigned long long)st->events[k]);
  sv_str_add(s, "}");
}

static void add_ledger(sv_str *s, const sv_app *app) {
  sv_str_add(s, "  \"ledger\": [");
  for (int i = 0; i < app->cfg.n_cameras; i++) {
    const sv_ledger *l = sv_sync_ledger(&app->queue.sync, i);
    sv_str_add(s, "%s\n    {\"camera\": \"", i ? "," : "");
    sv_str_add_json(s, app->cfg.caps[i].name);
    sv_str_add(s, "\", \"captured\": %llu, \"delivered\": %llu, \"pending\": %llu, \"dropped\": {",
               (unsigned long long)l->captured, (unsigned long long)l->delivered,
               (unsigned long long)l->pending);
    for (int r = 0, n = 0; r < SV_N_DROPS; r++)
      if (l->dropped[r])
        sv_str_add(s, "%s\"%s\": %llu", n++ ? ", " : "", sv_drop_name((sv_drop_reason)r),
                   (unsigned long long)l->dropped[r]);
    sv_str_add(s, "}");
    add_events(s, &app->queue.sync.streams[i]);
    sv_str_add(s, ", \"is_exact\": %s}", sv_ledger_is_exact(l) ? "true" : "false");
  }
  sv_str_add(s, "\n  ],\n");
}

static void add_masks(sv_str *s, const sv_rig *rig) {
  int n = 0;
  for (int i = 0; i < rig->n_sub_views; i++) n += rig->sub_views[i].mask != NULL;
  if (n) sv_str_add(s, "  \"masks\": %d,\n", n);
}

static void add_settings(sv_str *s, const sv_app *app) {
  const sv_train_cfg *t = &app->trainer.cfg;
  sv_str_add(s, "  \"source\": \"");
  sv_str_add_json(s, app->cfg.source_name);
  sv_str_add(s, "\",\n  \"rig\": \"");
  sv_str_add_json(s, app->cfg.rig->name);
  sv_str_add(s, "\",\n  \"gaussians\": %d,\n  \"threads\": %d,\n  \"isa\": \"%s\",\n  \"prior\": \"%s\",\n  ",
             t->n_gaussians, t->n_threads, sv_isa_name(app->k->isa), sv_prior_method_name(app->cfg.prior));
  sv_driver_add_settings(s, &app->trainer);
  sv_str_add(s, ",\n  \"exposures\": %d,\n  \"views\": %d,\n", app->exposures.n,
             sv_driver_n_views(&app->trainer));
  if (app->cfg.is_deep) sv_str_add(s, "  \"depth\": 16,\n  \"white\": %.6g,\n", (double)app->exposures.white);
  add_masks(s, app->cfg.rig);
}

static void add_values(sv_str *s, const char *key, const double *v, int n) {
  sv_str_add(s, "\"%s\": [", key);
  for (int i = 0; i < n; i++) sv_str_add(s, "%s%.4f", i ? ", " : "", v[i]);
  sv_str_add(s, "]");
}

#define CAP_REPORTED_EXPOSURES 100 // more would not fit

// What training learned of the cameras' and the exposures' color.
static void add_appearance(sv_str *s, const sv_app *app) {
  const sv_appearance_cfg *c = &app->trainer.cfg.appearance;
  const sv_appearance *a = &app->trainer.appearance;
  if (c->n_cameras < 1) return;
  sv_str_add(s, "  \"appearance\": {\"cameras\": [");
  for (int i = 0; i < c->n_cameras; i++) {
    sv_str_add(s, "%s\n    {", i ? "," : "");
    add_values(s, "color", a->camera[i].p, 9);
    sv_str_add(s, ", ");
    add_values(s, "offset", a->camera[i].p + 9, 3);
    sv_str_add(s, ", ");
    add_values(s, "falloff", a->camera[i].p + 12, 3);
    sv_str_add(s, "}");
  }
  sv_str_add(s, "], \"exposures\": [");
  for (int i = 0; i < sv_mini(c->n_exposures, CAP_REPORTED_EXPOSURES); i++) {
    sv_str_add(s, "%s\n    {", i ? "," : "");
    add_values(s, "color", a->exposure[i].p, 9);
    sv_str_add(s, "}");
  }
  sv_str_add(s, "]},\n");
}

static void add_odometry(sv_str *s, const sv_app *app) {
  const sv_odometry *o = &app->odometry;
  const sv_track_summary *m = &o->summary;
  const sv_unit unit = sv_app_unit(app);
  if (unit.is_metric) sv_str_add(s, "  \"unit\": \"m\",\n");
  if (unit.scale_sigma > 0) sv_str_add(s, "  \"scale_sigma\": %.3g,\n", (double)unit.scale_sigma);
  if (!o->is_on || !m->n_exposures) return;
  sv_str_add(
      s,
      "  \"odometry\": {\"is_still\": %s, \"is_tracked\": %s, \"exposures\": %d, \"placed\": %d, "
      "\"points\": %d, \"seen_again\": %d, \"path_m\": %.4f, \"rms_px\": %.3f, \"scale_sigma\": %.5f},\n",
      m->is_still ? "true" : "false", o->is_tracked ? "true" : "false", m->n_exposures, m->n_placed,
      m->n_points, m->n_seen_again, m->path_m, m->rms_px, m->scale_sigma);
}

// The histogram has steps of a quarter of an octave: the largest skew of each, and how many
// exposures; steps without any are left out.
static void add_skew(sv_str *s, const sv_skew_stats *k) {
  sv_str_add(
      s, "  \"skew_us\": {\"p50\": %.1f, \"p99\": %.1f, \"max\": %.1f, \"exposures\": %llu, \"histogram\": [",
      (double)sv_skew_percentile_ns(k, 50) * 1e-3, (double)sv_skew_percentile_ns(k, 99) * 1e-3,
      (double)k->max_ns * 1e-3, (unsigned long long)k->n);
  for (int i = 0, n = 0; i < SV_SKEW_BINS; i += 2) {
    const uint64_t count = k->bins[i] + k->bins[i + 1];
    if (!count) continue;
    sv_str_add(s, "%s[%.3f, %llu]", n++ ? ", " : "", (double)sv_skew_edge_ns(i + 1) * 1e-3,
               (unsigned long long)count);
  }
  sv_str_add(s, "]},\n");
}

static void add_timing(sv_str *s, const sv_app *app) {
  const sv_time_stats *t = &app->driver.step_time;
  sv_str_add(s, "  \"seconds\": %.3f,\n  \"steps_per_second\": %.2f,\n", app->driver.train_s,
             sv_driver_steps_per_s(&app->driver));
  sv_str_add(s, "  \"step_ms\": {\"mean\": %.3f, \"p50\": %.3f, \"p99\": %.3f, \"max\": %.3f},\n",
             t->n ? 1e3 * t->sum_s / (double)t->n : 0.0, 1e3 * sv_time_stats_percentile_s(t, 50),
             1e3 * sv_time_stats_percentile_s(t, 99), 1e3 * t->max_s);
  add_skew(s, &app->queue.sync.skew);
}

sv_status sv_app_held_out_psnr(sv_app *app, int n_most, double *psnr) {
  const int n_views = app->trainer.n_views, n = sv_mini(n_views, n_most);
  *psnr = app->released_psnr;
  if (!(app->cfg.hold_out > 0) || n < 1) return SV_E_NOT_FOUND;
  if (app->released_psnr > 0) return SV_OK;
  for (int k = 0; k < n; k++) {
    double mse;
    const int i = (int)((long)k * n_views / n);
    const int i_sub = app->trainer.views[i].view.i_sub_view;
    sv_status s = sv_driver_view_mse(&app->trainer, i, app->exposures.sub[i_sub].held, &mse);
    if (s < 0) return s;
    *psnr += sv_psnr_of_mse(mse) / n;
  }
  return SV_OK;
}

// Which views saw the Gaussians of a still scene.
static void add_support(sv_str *s, sv_app *app) {
  sv_arena scratch = app->scratch;
  sv_support support;
  if (app->cfg.is_dynamic || sv_driver_support(&app->trainer, &scratch, &support) < 0) return;
  const sv_support_summary sum = sv_support_sum_up(&support, &app->trainer.g);
  sv_str_add(s, "  \"support\": ");
  sv_driver_add_support(s, &sum);
  sv_str_add(s, ",\n");
}

sv_status sv_app_save_report(sv_app *app, const char *extra, sv_err *err) {
  sv_str s = sv_str_make(app->files.report, SV_APP_REPORT_BYTES);
  sv_str_add(&s, "{\n  \"version\": 1,\n  \"state\": \"%s\",\n", sv_app_state_name(app->state));
  add_settings(&s, app);
  sv_str_add(&s, "  \"steps\": %u,\n  \"digest\": \"%08x%08x\",\n  \"loss\": %.6f,\n", app->trainer.step,
             (unsigned)(sv_train_digest(&app->trainer) >> 32), (unsigned)sv_train_digest(&app->trainer),
             app->driver.loss);
  if (app->driver.plateau.n_steps)
    sv_str_add(&s, "  \"settled_from_step\": %u,\n", app->driver.plateau.from_step);
  if (extra) sv_str_add(&s, "  %s,\n", extra);
  sv_str_add(&s, "  \"relocated\": %u,\n  \"dropped_splats\": %u,\n  \"device_errors\": %llu,\n",
             app->trainer.n_relocated, app->trainer.render.stats.n_dropped,
             (unsigned long long)app->capture.n_device_errors);
  add_support(&s, app);
  add_appearance(&s, app);
  sv_app_add_photometric(&s, app);
  add_odometry(&s, app);
  add_timing(&s, app);
  add_live(&s, app);
  add_watch(&s, app);
  add_ledger(&s, app);
  sv_str_add(&s,
             "  \"memory\": {\"arena_bytes\": %zu, \"used_bytes\": %zu, \"high_bytes\": %zu, \"parts\": [",
             app->arena->cap_bytes, app->arena->used_bytes, app->arena->high_bytes);
  sv_app_memory_map(&s, app->arena, true);
  sv_str_add(&s, "]}\n}\n");
  if (s.is_cut) return sv_fail(err, SV_E_NOMEM, "run.json: longer than %d bytes", SV_APP_REPORT_BYTES);
  app->files.report_bytes = s.len;
  return sv_app_put_report(app, err);
}
