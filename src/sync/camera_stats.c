// SPDX-License-Identifier: Apache-2.0
#include "src/sync/camera_stats.h"

#define MEAN_FRAMES 16.0

void sv_camera_stat_frame(sv_camera_stat *s, const sv_frame *f) {
  if (s->n_frames++) {
    // By the stamps: frames that waited for a host that was busy arrive at once, though not those
    // of more than a second. A clock that was stepped says nothing.
    double d = (double)(f->camera_ns - s->last_stamp_ns), n = (double)(s->n_frames - 1);
    double gap = (double)(f->arrival_ns - s->last_ns);
    if (d <= 0 || d > gap + (double)SV_NS_PER_S) d = gap;
    s->interval_ns += (d - s->interval_ns) / (n < MEAN_FRAMES ? n : MEAN_FRAMES);
  }
  s->last_stamp_ns = f->camera_ns;
  s->last_ns = f->arrival_ns;
}

double sv_camera_stat_fps(const sv_camera_stat *s) { return s->interval_ns > 0 ? 1e9 / s->interval_ns : 0; }

void sv_camera_stats_exposure(sv_camera_stat *stats, const sv_sync *sync, const sv_exposure *exposure,
                              const sv_frame *frames) {
  for (int i = 0; i < sync->cfg.n_cameras; i++) {
    const sv_frame *f = &frames[i];
    if (f->i_camera < 0) continue;
    const sv_sync_stream *st = &sync->streams[i];
    sv_ns mid_ns = sv_clock_model_host_ns(&st->clock, f->camera_ns);
    mid_ns += st->stamp == SV_STAMP_START ? f->exposure_ns / 2
              : st->stamp == SV_STAMP_END ? -f->exposure_ns / 2
                                          : 0;
    double d = (double)(mid_ns - exposure->time_ns), m = d < 0 ? -d : d;
    stats[i].offset_ns = d;
    if (m > stats[i].offset_max_ns) stats[i].offset_max_ns = m;
  }
}

void sv_camera_stats_line(sv_str *out, const sv_camera_stat *s, const sv_ledger *l, const char *name) {
  double fps = sv_camera_stat_fps(s);
  unsigned long long dropped = (unsigned long long)sv_ledger_dropped(l);
  sv_str_add(out, "%s %.1f fps %s%.3f ms dropped %llu", name, fps, s->offset_ns < 0 ? "" : "+",
             s->offset_ns * 1e-6, dropped);
  const char *before = " (";
  for (int r = 0; r < SV_N_DROPS; r++) {
    if (!l->dropped[r]) continue;
    sv_str_add(out, "%s%s %llu", before, sv_drop_name((sv_drop_reason)r), (unsigned long long)l->dropped[r]);
    before = ", ";
  }
  if (dropped) sv_str_add(out, ")");
}

void sv_camera_stats_live(sv_str *out, const sv_camera_stat *stats, const sv_sync *sync,
                          const sv_camera_caps *caps) {
  for (int i = 0; i < sync->cfg.n_cameras && out->cap - out->len > 64; i++) {
    sv_str_add(out, " | ");
    sv_camera_stats_line(out, &stats[i], sv_sync_ledger(sync, i), caps[i].name);
  }
}

void sv_camera_event_line(sv_str *out, const sv_camera_event *e, const sv_camera_caps *caps, int n_cameras) {
  bool is_known = e->i_camera >= 0 && e->i_camera < n_cameras;
  if (e->text) {
    sv_str_add(out, "%s", e->text);
    return;
  }
  bool is_time = e->kind == SV_CAMERA_STALLED || e->kind == SV_CAMERA_RETURNED;
  sv_str_add(out, "%s: %s: %s (", is_known ? caps[e->i_camera].name : "?", sv_camera_event_name(e->kind),
             sv_camera_event_sentence(e->kind));
  if (is_time) sv_str_add(out, "after %.0f ms)", sv_ns_to_ms(e->detail));
  else sv_str_add(out, "%s%lld)", e->kind == SV_CAMERA_LOST ? "error " : "", (long long)e->detail);
}
