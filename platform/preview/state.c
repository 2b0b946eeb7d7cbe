// SPDX-License-Identifier: Apache-2.0
// The runtime's state as JSON for the page.
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "platform/preview/preview.h"

pv_blob *pv_blob_make(size_t bytes, uint64_t seq) {
  pv_blob *b = malloc(sizeof *b);
  uint8_t *data = malloc(bytes ? bytes : 1);
  if (!b || !data) {
    free(b);
    free(data);
    return NULL;
  }
  *b = (pv_blob){.n_users = 1, .seq = seq, .bytes = bytes, .data = data};
  return b;
}

void pv_blob_drop(pv_blob *b) {
  if (!b || --b->n_users > 0) return;
  free(b->data);
  free(b);
}

bool pv_state_read(pv_source *s) {
  size_t bytes;
  if (sv_feed_read(&s->reader, SV_FEED_MODES, &s->modes_seq, &s->modes, sizeof s->modes, &bytes) < 0 ||
      !s->modes_seq)
    s->modes.n = 0;
  return sv_feed_read(&s->reader, SV_FEED_STATE, &s->state_seq, &s->state, sizeof s->state, &bytes) == SV_OK;
}

// The clock of the heartbeats
static sv_ns now_ns(void) {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return (sv_ns)t.tv_sec * SV_NS_PER_S + t.tv_nsec;
}

void pv_stale_read(pv_source *s) {
  sv_ns age_ns;
  (void)sv_beat_oldest(s->reader.header->beats, now_ns(), &age_ns);
  s->stale_s = age_ns < PV_STALE_S * SV_NS_PER_S ? 0 : (int)(age_ns / SV_NS_PER_S % 1000000000);
}

static void add_text(sv_str *o, const char *key, const char *text, size_t cap) {
  char copy[256];
  size_t n = 0;
  // The block is another process's: no zero is sure
  while (n < cap && n < sizeof copy - 1 && text[n]) n++;
  memcpy(copy, text, n);
  copy[n] = 0;
  sv_str_add(o, "\"%s\":\"", key);
  sv_str_add_json(o, copy);
  sv_str_add(o, "\",");
}

static void add_number(sv_str *o, const char *key, double v) {
  if (isfinite(v)) sv_str_add(o, "\"%s\":%.9g,", key, v);
  else sv_str_add(o, "\"%s\":null,", key);
}

static void close_with(sv_str *o, const char *end) { // over the last comma
  if (o->len && o->buf[o->len - 1] == ',') o->len--;
  sv_str_add(o, "%s", end);
}

static int bounded(int n, int cap) { return n < 0 ? 0 : n > cap ? cap : n; }

static void add_cameras(sv_str *o, const sv_feed_state *s) {
  int n_reasons = bounded(s->n_reasons, SV_FEED_CAP_REASONS);
  sv_str_add(o, "\"cameras\":[");
  for (int i = 0; i < bounded(s->n_cameras, SV_FEED_CAP_CAMERAS); i++) {
    const sv_feed_camera *c = &s->cameras[i];
    sv_str_add(o, "{");
    add_text(o, "name", c->name, sizeof c->name);
    add_number(o, "fps", c->fps);
    sv_str_add(o,
               "\"width\":%d,\"height\":%d,\"captured\":%llu,\"delivered\":%llu,\"pending\":%llu,"
               "\"dropped\":%llu,\"tiles\":%llu,\"dropped_by\":{",
               c->width_px, c->height_px, (unsigned long long)c->captured, (unsigned long long)c->delivered,
               (unsigned long long)c->pending, (unsigned long long)c->dropped,
               (unsigned long long)c->n_tiles);
    for (int r = 0; r < n_reasons; r++)
      if (c->dropped_by[r])
        sv_str_add(o, "\"%.*s\":%llu,", (int)sizeof s->reasons[r] - 1, s->reasons[r],
                   (unsigned long long)c->dropped_by[r]);
    close_with(o, "}},");
  }
  close_with(o, "],");
}

static void add_modes(sv_str *o, const sv_feed_modes *m) {
  sv_str_add(o, "\"mode\":%d,\"modes\":[", m->i_mode);
  for (int i = 0; i < bounded(m->n, SV_FEED_CAP_MODES); i++) {
    char text[SV_FEED_CAP_MODE_TEXT];
    memcpy(text, m->text[i], sizeof text);
    text[sizeof text - 1] = 0; // the block is another process's
    sv_str_add(o, "\"");
    sv_str_add_json(o, text);
    sv_str_add(o, "\",");
  }
  close_with(o, "],");
}

static void add_memory(sv_str *o, const sv_feed_state *s) {
  sv_str_add(o, "\"memory\":{\"cap\":%llu,\"used\":%llu,\"parts\":[", (unsigned long long)s->arena_cap_bytes,
             (unsigned long long)s->arena_used_bytes);
  for (int i = 0; i < bounded(s->n_parts, SV_FEED_CAP_PARTS); i++) {
    sv_str_add(o, "{");
    add_text(o, "name", s->parts[i].name, sizeof s->parts[i].name);
    sv_str_add(o, "\"bytes\":%llu},", (unsigned long long)s->parts[i].bytes);
  }
  close_with(o, "]},");
}

static void add_guidance(sv_str *o, const sv_feed_guidance *g) {
  const int n_sectors = bounded(g->n_sectors, SV_FEED_CAP_CELLS),
            n_bands = bounded(g->n_bands, SV_FEED_CAP_CELLS),
            n = bounded(n_sectors * n_bands, SV_FEED_CAP_CELLS);
  sv_str_add(o,
             "\"guidance\":{\"kept\":%d,\"good\":%d,\"bands\":%d,\"sectors\":%d,\"cell\":%d,\"target\":%d,",
             g->n_kept, g->n_good, n_bands, n_sectors, g->i_cell, g->i_target);
  add_text(o, "hint", g->hint, sizeof g->hint);
  add_number(o, "coverage", g->coverage);
  sv_str_add(o, "\"cells\":[");
  for (int i = 0; i < n; i++) sv_str_add(o, "%s%d", i ? "," : "", g->covered_percent[i]);
  sv_str_add(o, "]},");
}

static void add_threads(sv_str *o, const pv_source *p) {
  const sv_beat_of *beats = p->reader.header->beats;
  const sv_ns now = now_ns();
  sv_ns oldest_ns;
  char name[16];
  sv_beat_name(sv_beat_oldest(beats, now, &oldest_ns), name);
  sv_str_add(o, "\"stale_s\":%d,\"stale_thread\":\"%s\",\"heartbeats\":[", p->stale_s,
             p->stale_s ? name : "");
  for (int i = 0; i < SV_CAP_BEATS; i++) {
    const sv_ns age_ns = sv_beat_age_ns(beats, i, now), longest_ns = sv_beat_longest_ns(beats, i);
    if (!age_ns && !longest_ns) continue; // there is no such thread
    sv_beat_name(i, name);
    sv_str_add(o, "{\"name\":\"%s\",\"age_s\":%.3f,\"longest_s\":%.3f},", name, sv_ns_to_s(age_ns),
               sv_ns_to_s(longest_ns));
  }
  close_with(o, "],");
}

static const char *status_name(int v) {
  static const char *const names[] = {"waiting", "capturing", "training", "paused",
                                      "saving",  "done",      "failed",   "calibrating"};
  return names[bounded(v, SV_FEED_STATUS_CALIBRATING)];
}

void pv_state_json(const pv_source *p, sv_str *o) {
  static const char *const causes[] = {"", "camera", "rig", "other"};
  const sv_feed_state *s = &p->state;
  int columns, rows;
  sv_str_add(o, "{\"seq\":%llu,\"state\":\"%s\",\"cause\":\"%s\",", (unsigned long long)p->state_seq,
             p->state_seq ? status_name(s->status) : "starting", causes[bounded(s->cause, SV_CAUSE_OTHER)]);
  add_text(o, "sentence", s->sentence, sizeof s->sentence);
  add_text(o, "board", s->board, sizeof s->board);
  add_text(o, "source", s->source, sizeof s->source);
  add_text(o, "rig", s->rig, sizeof s->rig);
  add_text(o, "sandbox", p->sandbox, sizeof p->sandbox);
  sv_str_add(o,
             "\"session\":%s,\"budget\":%d,\"exposures\":%d,\"cap_exposures\":%d,\"views\":%d,\"step\":%u,"
             "\"steps\":%u,"
             "\"gaussians\":%u,\"sh\":%u,\"saves\":%llu,\"device_errors\":%llu,\"model_seq\":%llu,"
             "\"picture_seq\":%llu,\"throttled\":%d,\"n_skew\":%llu,",
             s->is_session ? "true" : "false", s->budget, s->n_exposures, s->cap_exposures, s->n_views,
             s->step, s->steps, s->n_gaussians, s->sh_degree, (unsigned long long)s->n_saves,
             (unsigned long long)s->n_device_errors,
             (unsigned long long)sv_feed_newest(&p->reader, SV_FEED_MODEL),
             (unsigned long long)sv_feed_newest(&p->reader, SV_FEED_PICTURE), s->is_throttled,
             (unsigned long long)s->n_skew);
  sv_str_add(o, "\"history\":{\"seconds\":%.3f,\"seq\":%llu},", isfinite(s->history_s) ? s->history_s : 0.0,
             (unsigned long long)sv_feed_newest(&p->reader, SV_FEED_HISTORY));
  add_modes(o, &p->modes);
  sv_str_add(o, "\"control\":{\"by\":%u,\"asked\":%u},", p->control.by, p->control.asked);
  add_number(o, "seconds", s->train_s);
  add_number(o, "time_limit", s->time_limit_s);
  add_number(o, "steps_per_s", s->steps_per_s);
  add_number(o, "loss", s->loss);
  add_number(o, "psnr", s->psnr);
  add_number(o, "temperature", p->state_seq ? s->temperature_c : (double)NAN);
  add_number(o, "train_duty", p->state_seq ? s->train_duty : 1);
  add_number(o, "skew_p50_us", s->skew_p50_us);
  add_number(o, "skew_p99_us", s->skew_p99_us);
  add_number(o, "skew_max_us", s->skew_max_us);
  sv_str_add(o, "\"skew\":[");
  for (int i = 0; i < SV_FEED_SKEW_BINS; i++) sv_str_add(o, "%s%u", i ? "," : "", s->skew_bins[i]);
  pv_mosaic_grid(bounded(s->n_cameras, SV_FEED_CAP_TILES), &columns, &rows);
  sv_str_add(o, "],\"grid\":[%d,%d],", columns, rows);
  add_guidance(o, &s->guidance);
  add_cameras(o, s);
  add_memory(o, s);
  add_threads(o, p);
  close_with(o, "}");
}

void pv_curve_json(const pv_source *p, sv_str *o) {
  static sv_feed_curve c;
  uint64_t seq = 0;
  size_t bytes;
  c.n = 0;
  if (sv_feed_read(&p->reader, SV_FEED_CURVE, &seq, &c, sizeof c, &bytes) != SV_OK) c.n = 0;
  sv_str_add(o, "[");
  for (int i = 0; i < bounded((int)c.n, SV_FEED_CAP_POINTS); i++) {
    sv_str_add(o, "{");
    add_number(o, "seconds", (double)c.point[i].seconds);
    add_number(o, "loss", (double)c.point[i].loss);
    add_number(o, "psnr", (double)c.point[i].psnr);
    add_number(o, "steps_per_s", (double)c.point[i].steps_per_s);
    sv_str_add(o, "\"step\":%u},", c.point[i].step);
  }
  close_with(o, "]");
}

static void add_board_camera(sv_str *o, const sv_calibration_camera *c) {
  sv_str_add(o, "{");
  add_text(o, "name", c->name, sizeof c->name);
  add_number(o, "rms_px", c->rms_px);
  add_number(o, "epipolar_px", c->epipolar_px);
  add_number(o, "before_px", c->before_px);
  sv_str_add(o, "\"boards\":%d,\"seen\":%s,\"coverage\":\"%012llx\",\"outline\":[", c->n_boards,
             c->is_seen ? "true" : "false", (unsigned long long)(c->coverage & 0xffffffffffff));
  for (int k = 0; k < 8; k++) {
    const double v = (double)c->outline[k / 2][k % 2];
    sv_str_add(o, "%s%.4f", k ? "," : "", v >= 0 && v <= 1 ? v : 0);
  }
  sv_str_add(o, "]},");
}

void pv_calibration_json(const pv_source *p, sv_str *o) {
  static const char *const phases[] = {"", "looking", "solving", "done", "failed"};
  static sv_feed_calibration c;
  uint64_t seq = 0;
  size_t bytes;
  if (sv_feed_read(&p->reader, SV_FEED_CALIBRATION, &seq, &c, sizeof c, &bytes) != SV_OK)
    memset(&c, 0, sizeof c);
  sv_str_add(o, "{\"phase\":\"%s\",\"columns\":%d,\"rows\":%d,\"exposures\":%d,\"needed\":%d,\"peak\":%llu,",
             phases[bounded(c.phase, SV_CALIBRATION_FAILED)], c.n_cols, c.n_rows, c.n_exposures, c.n_needed,
             (unsigned long long)c.peak_bytes);
  add_number(o, "spacing_m", c.spacing_m);
  add_number(o, "seconds", c.seconds);
  add_number(o, "baseline_m", c.baseline_m);
  add_text(o, "sentence", c.sentence, sizeof c.sentence);
  sv_str_add(o, "\"cameras\":[");
  for (int i = 0; i < bounded(c.n_cameras, SV_CALIBRATION_CAP_CAMERAS); i++)
    add_board_camera(o, &c.camera[i]);
  close_with(o, "]}");
}

void pv_events_json(const pv_source *p, sv_str *o) {
  static sv_feed_events e;
  uint64_t seq = 0;
  size_t bytes;
  if (sv_feed_read(&p->reader, SV_FEED_EVENTS, &seq, &e, sizeof e, &bytes) != SV_OK) e.n_total = 0;
  uint64_t first = e.n_total > SV_FEED_CAP_EVENTS ? e.n_total - SV_FEED_CAP_EVENTS : 0;
  sv_str_add(o, "[");
  for (uint64_t i = first; i < e.n_total; i++) {
    const sv_feed_event *v = &e.event[i % SV_FEED_CAP_EVENTS];
    sv_str_add(o, "{\"level\":%d,", v->level);
    add_text(o, "text", v->text, sizeof v->text);
    add_number(o, "seconds", v->seconds);
    close_with(o, "},");
  }
  close_with(o, "]");
}
