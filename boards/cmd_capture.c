// SPDX-License-Identifier: Apache-2.0
// subview capture: records synchronized exposures into a folder that replays.
#include <string.h>

#include "boards/board_main.h"
#include "platform/replay/capture_writer.h"
#include "src/format/cameramodel.h"
#include "src/format/rig_file.h"
#include "src/image/convert.h"
#include "src/sync/camera_stats.h"

#define QUEUE_LEN  4
#define TIMEOUT_NS (10 * SV_NS_PER_S) // without any exposure

typedef struct {
  const char *source, *rig, *out;
  long exposures, skew_ms;
  double duration;
  bool is_json, is_quiet;
} capture_options;

static struct {
  board_source src;
  sv_sync sync;
  sv_sync_camera cameras[SV_CAP_SUB_VIEWS];
  sv_camera_stat stats[SV_CAP_SUB_VIEWS];
  sv_camera_caps caps[SV_CAP_SUB_VIEWS]; // of what is written
  sv_frame *frames;
  sv_convert convert;
  sv_kernels kernels;
  sv_capture_writer writer;
  sv_linux_console console;
  char rig_dir[SV_CAPTURE_CAP_PATH];
  sv_coverage_names coverage;
  char text[64 * 1024];
  long n_exposures;
} cap;

static sv_status write_rig(const char *dir, sv_arena *arena, sv_err *err) {
  sv_linux_store folder;
  sv_fmt(cap.rig_dir, sizeof cap.rig_dir, "%s/rig", dir);
  sv_status s = sv_linux_store_open(&folder, cap.rig_dir, err);
  if (s < 0) return s;
  sv_store st = sv_linux_store_port(&folder);
  s = coverage_write(cap.src.rig, &cap.coverage, &st, arena, err);
  for (int i = -1; s >= 0 && i < cap.src.rig->n_sub_views; i++) {
    sv_str text = sv_str_make(cap.text, sizeof cap.text);
    char name[64] = "rig.json";
    if (i < 0) s = sv_rig_json_write_coverage(&text, cap.src.rig, &cap.coverage);
    else {
      const sv_sub_view *v = &cap.src.rig->sub_views[i];
      sv_fmt(name, sizeof name, "%s.cameramodel", v->name);
      s = sv_cameramodel_write(&text, &v->model, &v->cam_from_rig);
    }
    if (s < 0) sv_fail(err, s, "%s/%s: the rig does not fit its text", cap.rig_dir, name);
    if (s >= 0) s = st.begin(st.self, name, err);
    if (s >= 0) s = st.write(st.self, text.buf, text.len, err);
    if (s >= 0) s = st.commit(st.self, err);
  }
  sv_linux_store_close(&folder);
  return s;
}

// What a capture keeps as it comes; all else becomes RGB8.
static bool is_kept(const sv_camera_caps *c) {
  bool is_coded = sv_pixel(c->format)->layout == SV_LAYOUT_CODED;
  return is_coded ? !c->coded_width_px
                  : c->format == SV_PIX_RGB8 || c->format == SV_PIX_GREY8 || c->format == SV_PIX_RGB16;
}

static sv_status write_frame(const sv_frame *frame, sv_err *err) {
  sv_frame f = *frame;
  sv_image_u8 rgb;
  sv_pool pool = sv_pool_serial();
  if (!is_kept(&cap.src.caps[f.i_camera])) {
    sv_status s = sv_convert_frame(&cap.convert, frame, &cap.kernels, &pool, &rgb, err);
    if (s == SV_E_FORMAT || s == SV_E_CORRUPT) return SV_OK; // a damaged picture: its gap stays visible
    if (s < 0) return s;
    f.format = SV_PIX_RGB8;
    f.data = rgb.px;
    f.stride_bytes = rgb.stride_bytes;
    f.data_bytes = (size_t)rgb.stride_bytes * (size_t)(rgb.height_px - 1) + 3 * (size_t)rgb.width_px;
  }
  return sv_capture_writer_add(&cap.writer, &f, err);
}

static sv_status save_exposure(const sv_exposure *ex, sv_err *err) {
  sv_pose pose;
  sv_status s = SV_OK;
  sv_camera_stats_exposure(cap.stats, &cap.sync, ex, cap.frames);
  for (int i = 0; s >= 0 && i < cap.src.source.n_cameras; i++) {
    if (cap.frames[i].i_camera < 0) continue;
    s = write_frame(&cap.frames[i], err);
  }
  sv_convert_forget(&cap.convert);
  for (int i = 0; i < cap.src.source.n_cameras; i++) {
    if (cap.frames[i].i_camera < 0) continue;
    sv_status r = cap.src.source.requeue(cap.src.source.self, &cap.frames[i]);
    if (s >= 0 && r < 0) s = sv_fail(err, r, "camera %d does not take its buffer back", i);
  }
  if (s >= 0 && cap.src.source.rig_pose &&
      cap.src.source.rig_pose(cap.src.source.self, ex->time_ns, &pose) == SV_OK)
    s = sv_capture_writer_add_pose(&cap.writer, ex->time_ns, &pose, err);
  if (s >= 0) cap.n_exposures++;
  return s;
}

static sv_status drain(long max, sv_err *err) {
  sv_exposure ex;
  sv_frame f;
  sv_status s = SV_OK;
  while (s >= 0 && cap.n_exposures < max && sv_sync_pop_exposure(&cap.sync, &ex, cap.frames) == SV_OK)
    s = save_exposure(&ex, err);
  while (sv_sync_pop_return(&cap.sync, &f) == SV_OK)
    if (cap.src.source.requeue(cap.src.source.self, &f) < 0 && s >= 0)
      s = sv_fail(err, SV_E_DEVICE, "camera %d does not take its buffer back", f.i_camera);
  return s;
}

static void log_events(const sv_console *con) {
  char line[256];
  sv_camera_event e;
  sv_source *src = &cap.src.source;
  while (src->event && src->event(src->self, &e) == SV_OK) {
    sv_str s = sv_str_make(line, sizeof line);
    sv_camera_event_line(&s, &e, cap.src.caps, src->n_cameras);
    con->log(con->self, SV_LOG_WARN, line);
  }
}

static void log_live(const sv_console *con, double elapsed_s) {
  char line[512];
  sv_str s = sv_str_make(line, sizeof line);
  sv_str_add(&s, "capture  %ld exposures  %.1f s", cap.n_exposures, elapsed_s);
  sv_camera_stats_live(&s, cap.stats, &cap.sync, cap.src.caps);
  con->log(con->self, SV_LOG_LIVE, line);
}

static sv_status record(const capture_options *o, sv_err *err) {
  sv_source *src = &cap.src.source;
  sv_clock *clk = &cap.src.clock;
  sv_console con = sv_linux_console_port(&cap.console);
  sv_ns begin = clk->now_ns(clk->self), end = begin + (sv_ns)(o->duration * 1e9);
  long max = o->exposures ? o->exposures : 1000000000;
  sv_ns last_ns = begin;
  long before = 0;
  for (sv_ns now = begin; cap.n_exposures < max && !con.is_stop_requested(con.self);
       now = clk->now_ns(clk->self)) {
    sv_frame f;
    if (o->duration > 0 && now >= end) break;
    sv_status s = src->dequeue(src->self, &f, now + 100 * SV_NS_PER_MS);
    log_events(&con);
    if (s == SV_END) break;
    if (s < 0 && !src->event) return sv_fail(err, s, "camera %d: %s", f.i_camera, sv_status_text(s));
    if (cap.n_exposures > before) before = cap.n_exposures, last_ns = now;
    if (now - last_ns > TIMEOUT_NS)
      return sv_fail(
          err, SV_E_TIMEOUT,
          "no synchronized exposure came for %g s (%ld captured); is a camera missing or is the skew limit "
          "of %ld ms too tight?",
          sv_ns_to_s(now - last_ns), cap.n_exposures, o->skew_ms);
    if (s != SV_OK) continue; // a camera that failed comes back by itself, the others go on
    sv_camera_stats_frame(cap.stats, &f);
    s = sv_sync_push(&cap.sync, &f);
    if (s < 0)
      return sv_fail(err, s, "camera %d: its frame was not taken: %s", f.i_camera, sv_status_text(s));
    if ((s = drain(max, err)) < 0) return s;
    log_live(&con, sv_ns_to_s(now - begin));
  }
  return SV_OK;
}

static void print_ledger(const capture_options *o) {
  sv_ledger l = sv_sync_ledger_sum(&cap.sync);
  if (o->is_json)
    say(1,
        "{\"exposures\": %ld, \"captured\": %llu, \"delivered\": %llu, \"dropped\": %llu, \"skew_us_p99\": "
        "%.1f}\n",
        cap.n_exposures, (unsigned long long)l.captured, (unsigned long long)l.delivered,
        (unsigned long long)sv_ledger_dropped(&l), (double)sv_skew_percentile_ns(&cap.sync.skew, 99) * 1e-3);
  else
    say(1,
        "%ld exposures in %s; frames: %llu captured = %llu delivered + %llu dropped; skew p99 %.1f us\n"
        "replay them with --source replay:%s\n",
        cap.n_exposures, o->out, (unsigned long long)l.captured, (unsigned long long)l.delivered,
        (unsigned long long)sv_ledger_dropped(&l), (double)sv_skew_percentile_ns(&cap.sync.skew, 99) * 1e-3,
        o->out);
  if (o->is_json) return;
  for (int i = 0; i < cap.src.source.n_cameras; i++) {
    char line[512];
    sv_str s = sv_str_make(line, sizeof line);
    sv_camera_stats_line(&s, &cap.stats[i], sv_sync_ledger(&cap.sync, i), cap.src.caps[i].name);
    say(1, "  %s\n", line);
  }
  if (!cap.src.rig)
    say(1, "the capture has no rig: to train on it, calibrate the cameras and give --rig DIR\n");
}

static sv_status open_conversion(sv_arena *arena, sv_err *err) {
  int n = cap.src.source.n_cameras;
  uint32_t mask;
  if (!board_kernels(&cap.kernels, &mask))
    return sv_fail(err, SV_E_ARG, "SV_ISA names no kernels of this build");
  static sv_camera_caps converted[SV_CAP_SUB_VIEWS]; // what is kept needs no conversion
  for (int i = 0; i < n; i++) {
    cap.caps[i] = converted[i] = cap.src.caps[i];
    if (is_kept(&cap.src.caps[i])) converted[i].format = SV_PIX_RGB8;
    else cap.caps[i].format = SV_PIX_RGB8;
  }
  sv_convert_cfg cc = {converted, n, 1, &cap.src.decoder};
  return sv_convert_init(&cap.convert, &cc, arena, err);
}

static sv_status open_all(const capture_options *o, sv_arena *arena, sv_err *err) {
  sv_status s = source_open(&cap.src, o->source, o->rig, (int)o->exposures, false, arena, err);
  if (s < 0) return s;
  int n = cap.src.source.n_cameras;
  for (int i = 0; i < n; i++) cap.cameras[i] = sv_sync_camera_of(&cap.src.caps[i]);
  sv_sync_cfg sc = {.n_cameras = n,
                    .cameras = cap.cameras,
                    .skew_limit_ns = o->skew_ms * SV_NS_PER_MS,
                    .queue_len = QUEUE_LEN};
  sv_arena_part_begin(arena, "sync");
  cap.frames = SV_TAKE(arena, sv_frame, n);
  s = sv_sync_init(&cap.sync, &sc, arena);
  if (s < 0) return sv_fail(err, s, "no frame synchronisation for %d cameras: %s", n, sv_status_text(s));
  if (cap.src.rig && (s = write_rig(o->out, arena, err)) < 0) return s;
  if ((s = open_conversion(arena, err)) < 0) return s;
  double scene[6];
  for (int i = 0; i < 3; i++) {
    double h = (double)cap.src.bounds.radius / sqrt(3.0);
    scene[i] = (double)cap.src.bounds.centre[i] - h, scene[3 + i] = (double)cap.src.bounds.centre[i] + h;
  }
  sv_capture_writer_cfg wc = {.dir = o->out,
                              .name = "",
                              .rig = cap.src.rig ? "rig" : NULL,
                              .n_cameras = n,
                              .caps = cap.caps,
                              .scene_m = cap.src.has_bounds ? scene : NULL};
  sv_arena_part_begin(arena, "writer");
  return sv_capture_writer_open(&cap.writer, &wc, arena, err);
}

static int capture_all(const capture_options *o) {
  sv_err err = {0}, close_err = {0};
  sv_arena arena = board_arena();
  sv_linux_console_init(&cap.console, 2, o->is_quiet);
  if (sv_linux_catch_signals(&err) < 0 || open_all(o, &arena, &err) < 0) return fail_with(&err);
  sv_arena_seal(&arena);
  sv_source *src = &cap.src.source;
  sv_status s = src->start(src->self);
  if (s < 0) sv_fail(&err, s, "the cameras did not start: %s", sv_status_text(s));
  else {
    s = record(o, &err);
    while (sv_sync_flush(&cap.sync) == SV_E_FULL && drain(0, &close_err) >= 0) {
    }
    if (drain(0, &close_err) < 0 && s >= 0) s = close_err.status, err = close_err;
    if (src->stop(src->self) < 0 && s >= 0) s = sv_fail(&err, SV_E_DEVICE, "the cameras did not stop");
  }
  sv_linux_console_finish(&cap.console);
  if (sv_capture_writer_close(&cap.writer, &close_err) < 0 && s >= 0) s = close_err.status, err = close_err;
  if (s >= 0 && !cap.n_exposures)
    s = sv_fail(&err, SV_E_NOT_FOUND, "the source ended without one synchronized exposure");
  if (s < 0) return fail_with(&err);
  print_ledger(o);
  return 0;
}

int cmd_capture(int argc, char **argv) {
  capture_options o = {.skew_ms = 20};
  const opt list[] = {
      {"--source", OPT_TEXT, &o.source, 0, 0, "S",
       SOURCE_KINDS ", with options (see 'subview cameras --help')"},
      {"--rig", OPT_TEXT, &o.rig, 0, 0, "DIR", "folder with rig.json, when the source brings none"},
      {"--exposures", OPT_INT, &o.exposures, 1, 1000000, "N", "end after so many exposures"},
      {"--duration", OPT_REAL, &o.duration, 0.001, 1e6, "SEC", "end after so many seconds"},
      {"--skew-limit", OPT_INT, &o.skew_ms, 1, 10000, "MS", "largest skew within an exposure (20 ms)"},
      {"--out", OPT_TEXT, &o.out, 0, 0, "DIR", "the capture folder"},
      {"--json", OPT_FLAG, &o.is_json, 0, 0, NULL, "print the figures as one JSON object on stdout"},
      {"--quiet", OPT_FLAG, &o.is_quiet, 0, 0, NULL, "no progress"},
  };
  int r =
      options_parse("capture", "Records synchronized exposures into a folder; the folder is itself a source.",
                    "subview capture --source sim:textured,rig=stereo --exposures 8 --out out/capture", list,
                    sizeof list / sizeof *list, argc, argv);
  if (r) return r < 0 ? 0 : r;
  if (!o.source) return usage_error("capture", "--source is missing");
  if (!o.out) return usage_error("capture", "--out is missing");
  if (!o.exposures && !(o.duration > 0)) return usage_error("capture", "give --exposures or --duration");
  int code = capture_all(&o);
  source_close(&cap.src);
  return code;
}
