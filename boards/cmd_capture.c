// SPDX-License-Identifier: Apache-2.0
// subview capture: records synchronized exposures into a folder that replays.
#include <stdatomic.h>
#include <string.h>

#include "boards/board_main.h"
#include "boards/guide.h"
#include "platform/replay/capture_writer.h"
#include "src/base/mathx.h"
#include "src/format/cameramodel.h"
#include "src/format/rig_file.h"
#include "src/image/convert.h"
#include "src/sync/camera_stats.h"
#include "src/sync/capture_queue.h"

#define QUEUE_LEN 4
#define CAP_READY 2 // exposures that wait to be written
// Where time stands still meanwhile, and nothing may be left out
#define CAP_VIRTUAL 8
#define TIMEOUT_NS  (10 * SV_NS_PER_S) // without any exposure
#define LOOK_NS     (2 * SV_NS_PER_MS) // the thread of the cameras is looked at so often
#define N_TRIES     6                  // to save a frame, where the source's time waits for it
#define N_TRIES_NOW 2                  // where it does not
#define N_CLOSE     6                  // to save the rig at the start and capture.json at the end
#define FIRST_WAIT  (100 * SV_NS_PER_MS)
#define CAP_WAIT    (4 * SV_NS_PER_S)

typedef struct {
  options_common common;
  const char *source, *rig, *out, *sync, *depth;
  long exposures, skew_ms;
  double every_s, arc_deg;
  int i_sync; // sv_sync_method
  double duration;
  bool is_json, is_quiet;
} capture_options;

static bool is_deep(const capture_options *o) { return o->depth && !strcmp(o->depth, "16"); }

static struct {
  board_source src;
  sv_capture_queue in;
  sv_spacing spacing; // of --every
  capture_guide guide;
  sv_linux_background background; // the thread of the cameras, when they are real
  sv_worker worker;
  _Atomic int started; // sv_status of it; 1: not yet known
  _Atomic bool is_ending, is_at_end;
  sv_err start_err;
  sv_camera_caps caps[SV_CAP_SUB_VIEWS]; // of what is written
  sv_convert convert;
  uint8_t *rgb16; // a frame, with --depth 16; else NULL
  sv_kernels kernels;
  sv_capture_writer writer;
  sv_linux_console console;
  char rig_dir[SV_CAPTURE_CAP_PATH];
  sv_coverage_names coverage;
  char text[64 * 1024];
  long n_exposures;
  // Exposures that could not be saved. After each, so many that come before retry_ns are left out.
  long n_lost;
  int n_lost_in_a_row;
  sv_ns retry_ns, lost_since_ns;
} cap;

static void wait_ns(sv_ns ns) {
  sv_clock m = sv_linux_clock();
  m.sleep_until_ns(m.self, m.now_ns(m.self) + ns);
}

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

// A raw frame, as RGB16.
static sv_status develop(sv_frame *f, sv_err *err) {
  sv_pool pool = sv_pool_serial();
  sv_image_u8 rgb;
  sv_status s = sv_convert_deep(&cap.convert, f, 1, &(sv_compute){&cap.kernels, &pool}, &rgb, err);
  if (s < 0) return s;
  sv_deep_encode(cap.convert.deep.linear, f->width_px, f->height_px, cap.rgb16, cap.convert.deep.scratch,
                 &cap.kernels);
  f->format = SV_PIX_RGB16;
  f->data = cap.rgb16;
  f->stride_bytes = 6 * f->width_px;
  f->data_bytes = 6 * (size_t)f->width_px * (size_t)f->height_px;
  return SV_OK;
}

static sv_status write_frame(const sv_frame *frame, sv_err *err) {
  sv_frame f = *frame;
  sv_image_u8 rgb;
  sv_pool pool = sv_pool_serial();
  if (cap.rgb16 && f.format != SV_PIX_RGB16) {
    const sv_status s = develop(&f, err);
    if (s < 0) return s;
  } else if (!is_kept(&cap.src.caps[f.i_camera])) {
    sv_status s = sv_convert_frame(&cap.convert, frame, &cap.kernels, &pool, &rgb, err);
    // A damaged picture: its gap stays visible
    if (s == SV_E_FORMAT || s == SV_E_CORRUPT) return SV_OK;
    if (s < 0) return s;
    f.format = SV_PIX_RGB8;
    f.data = rgb.px;
    f.stride_bytes = rgb.stride_bytes;
    f.data_bytes = (size_t)rgb.stride_bytes * (size_t)(rgb.height_px - 1) + 3 * (size_t)rgb.width_px;
  }
  return sv_capture_writer_add(&cap.writer, &f, err);
}

// A disk may refuse once. Where the source's time waits, so does the next try.
static bool is_tried_again(sv_status s, int n_tried) {
  if (s != SV_E_IO || n_tried >= (cap.src.is_virtual ? N_TRIES : N_TRIES_NOW)) return false;
  if (cap.src.is_virtual) wait_ns(FIRST_WAIT << (n_tried - 1));
  return true;
}

static sv_status write_surely(const sv_frame *f, sv_err *err) {
  sv_status s;
  int n = 0;
  do s = write_frame(f, err);
  while (is_tried_again(s, ++n));
  return s;
}

static sv_status save_exposure(sv_exposure_slot *t, sv_err *err) {
  sv_status s = SV_OK;
  for (int i = 0; s >= 0 && i < cap.src.source.n_cameras; i++)
    if (t->frames[i].i_camera >= 0) s = write_surely(&t->frames[i], err);
  sv_convert_forget(&cap.convert);
  int n = 0;
  if (s >= 0 && t->exposure.has_pose) do
      s = sv_capture_writer_add_pose(&cap.writer, t->exposure.time_ns, &t->exposure.rig_from_world, err);
    while (is_tried_again(s, ++n));
  sv_capture_queue_give_back(&cap.in, t, s >= 0);
  if (s >= 0) cap.n_exposures++;
  return s;
}

// Real cameras go on. What cannot be saved is left out, with longer and longer pauses; a disk that
// takes nothing for TIMEOUT_NS ends the capture.
static sv_status save_or_leave_out(sv_exposure_slot *t, const sv_console *con, sv_err *err) {
  sv_ns now = cap.src.clock.now_ns(cap.src.clock.self);
  if (cap.n_lost_in_a_row && now < cap.retry_ns) {
    cap.n_lost++;
    sv_capture_queue_give_back(&cap.in, t, false);
    return SV_OK;
  }
  sv_status s = save_exposure(t, err);
  if (s >= 0) cap.n_lost_in_a_row = 0;
  if (s != SV_E_IO || cap.src.is_virtual) return s;
  char line[400];
  sv_ns wait = FIRST_WAIT << (cap.n_lost_in_a_row < 6 ? cap.n_lost_in_a_row : 6);
  if (!cap.n_lost_in_a_row++) cap.lost_since_ns = now;
  cap.n_lost++;
  cap.retry_ns = now + (wait < CAP_WAIT ? wait : CAP_WAIT);
  if (now - cap.lost_since_ns > TIMEOUT_NS) return s;
  sv_fmt(line, sizeof line, "%s; exposures are left out until it can", err->text);
  con->log(con->self, SV_LOG_WARN, line);
  return SV_OK;
}

// capture.json on the way: the frames are in the folder without it.
static void tell_save(const sv_console *con) {
  if (cap.writer.saved < 0) con->log(con->self, SV_LOG_WARN, cap.writer.save_err.text);
  cap.writer.saved = SV_OK;
}

// True when a camera has come back: it gets the time that all had at the start.
static bool log_events(const sv_console *con) {
  char line[256];
  sv_camera_event e;
  bool is_back = false;
  while (sv_capture_queue_pop_event(&cap.in, &e) == SV_OK) {
    sv_str s = sv_str_make(line, sizeof line);
    sv_camera_event_line(&s, &e, cap.src.caps, cap.src.source.n_cameras);
    con->log(con->self, SV_LOG_WARN, line);
    is_back |= e.kind == SV_CAMERA_RETURNED;
  }
  return is_back;
}

static void log_live(const sv_console *con, double elapsed_s) {
  char line[640];
  sv_str s = sv_str_make(line, sizeof line);
  sv_str_add(&s, "capture  %ld exposures  %.1f s  ", cap.n_exposures, elapsed_s);
  sv_guidance_line(&cap.guide.guidance, &s);
  if (sv_capture_queue_line(&cap.in, &s) == SV_OK) con->log(con->self, SV_LOG_LIVE, line);
}

// Cameras are served the moment their frames come, however long a disk takes; what it cannot take
// is left out as whole exposures. Where time is the source's own there is no thread: nothing comes
// meanwhile.
static void capture_thread(void *arg) {
  sv_clock *clk = &cap.src.clock;
  (void)arg;
  atomic_store(&cap.started, sv_capture_queue_start(&cap.in, &cap.start_err));
  while (atomic_load(&cap.started) == SV_OK && !atomic_load(&cap.is_ending)) {
    sv_status s = sv_capture_queue_step(&cap.in, clk->now_ns(clk->self) + 20 * SV_NS_PER_MS);
    if (s == SV_END) break;
  }
  atomic_store(&cap.is_at_end, true);
}

static sv_status start(sv_err *err) {
  sv_clock *clk = &cap.src.clock;
  if (cap.src.is_virtual) return sv_capture_queue_start(&cap.in, err);
  cap.worker = sv_linux_worker_port(&cap.background);
  atomic_store(&cap.started, 1);
  sv_status s = cap.worker.start(cap.worker.self, capture_thread, NULL);
  if (s < 0) return sv_fail(err, s, "no thread for the cameras: %s", sv_status_text(s));
  while (atomic_load(&cap.started) == 1) clk->sleep_until_ns(clk->self, clk->now_ns(clk->self) + LOOK_NS);
  s = (sv_status)atomic_load(&cap.started);
  if (s < 0) {
    cap.worker.join(cap.worker.self);
    *err = cap.start_err;
  }
  return s;
}

static sv_status stop(sv_err *err) {
  atomic_store(&cap.is_ending, true);
  if (cap.worker.join) cap.worker.join(cap.worker.self);
  sv_status s = sv_capture_queue_stop(&cap.in);
  return s < 0 ? sv_fail(err, s, "the cameras did not stop: %s", sv_status_text(s)) : s;
}

// Lets time go on for a moment, unless an exposure is ready; END when there is none and the source
// is at its end.
static sv_status wait_a_moment(sv_ns now) {
  sv_clock *clk = &cap.src.clock;
  // Before the look at what is ready: the last ones are taken
  bool is_at_end = atomic_load(&cap.is_at_end);
  if (sv_capture_queue_n_ready(&cap.in)) return SV_OK;
  if (cap.src.is_virtual) return sv_capture_queue_step(&cap.in, now + 100 * SV_NS_PER_MS);
  if (is_at_end) return SV_END;
  clk->sleep_until_ns(clk->self, now + LOOK_NS);
  return SV_OK;
}

// One exposure at a time: where the disk is slower than the cameras one is always ready, and time
// goes on meanwhile, the capture's as well as that of the person who stops it.
static sv_status record(const capture_options *o, sv_err *err) {
  sv_clock *clk = &cap.src.clock;
  sv_console con = sv_linux_console_port(&cap.console);
  sv_ns begin = clk->now_ns(clk->self), end = begin + (sv_ns)(o->duration * 1e9), last_ns = begin;
  long max = o->exposures ? o->exposures : 1000000000;
  bool is_at_end = false;
  while (cap.n_exposures < max && !is_at_end && !con.is_stop_requested(con.self)) {
    sv_ns now = clk->now_ns(clk->self);
    if (o->duration > 0 && now >= end) break;
    is_at_end = wait_a_moment(now) == SV_END;
    if (log_events(&con)) last_ns = now;
    if (!cap.src.source.event && atomic_load(&cap.in.n_device_errors))
      return sv_fail(err, atomic_load(&cap.in.broken_status), "camera %d: %s", atomic_load(&cap.in.i_broken),
                     sv_status_text(atomic_load(&cap.in.broken_status)));
    sv_exposure_slot *slot;
    if (sv_capture_queue_take(&cap.in, &slot) == SV_OK) {
      const sv_ns time_ns = slot->exposure.time_ns;
      const sv_spacing_exposure judged = {time_ns, slot->frames[0].exposure_ns};
      if (!sv_spacing_is_due(&cap.spacing, &judged)) {
        sv_capture_queue_refuse(&cap.in, slot, SV_DROP_NOT_DUE);
        last_ns = now;
        continue;
      }
      sv_spacing_keep(&cap.spacing, &judged);
      guide_exposure(&cap.guide, slot, &cap.kernels);
      sv_status s = save_or_leave_out(slot, &con, err);
      if (s < 0) return s;
      tell_save(&con);
      last_ns = clk->now_ns(clk->self); // only from here on nothing comes: saving took its time
      log_live(&con, sv_ns_to_s(last_ns - begin));
    } else if (now - last_ns > TIMEOUT_NS)
      return sv_fail(err, SV_E_TIMEOUT,
                     "no synchronized exposure for %.0f s (%ld captured); check that every camera delivers "
                     "frames, or raise "
                     "--skew-limit (%ld ms)",
                     sv_ns_to_s(now - last_ns), cap.n_exposures, o->skew_ms);
  }
  return SV_OK;
}

static void print_ledger(const capture_options *o) {
  sv_ledger l = sv_sync_ledger_sum(&cap.in.sync);
  char trigger[400] = "", covered[40] = "";
  const double coverage = sv_guidance_coverage(&cap.guide.guidance);
  if (coverage >= 0) sv_fmt(covered, sizeof covered, ", \"coverage\": %.3f", coverage);
  sv_str t = sv_str_make(trigger, sizeof trigger);
  trigger_report(&t, &cap.src);
  if (o->is_json)
    say(1,
        "{\"exposures\": %ld, \"not_saved\": %ld, \"captured\": %llu, \"delivered\": %llu, "
        "\"dropped\": %llu, \"skew_us_p50\": %.1f, \"skew_us_p99\": %.1f, \"good_exposures\": %d%s%s%s}\n",
        cap.n_exposures, cap.n_lost, (unsigned long long)l.captured, (unsigned long long)l.delivered,
        (unsigned long long)sv_ledger_dropped(&l),
        (double)sv_skew_percentile_ns(&cap.in.sync.skew, 50) * 1e-3,
        (double)sv_skew_percentile_ns(&cap.in.sync.skew, 99) * 1e-3, cap.guide.guidance.n_good, covered,
        t.len ? ", " : "", trigger);
  else
    say(1,
        "%ld exposures in %s; frames: %llu captured = %llu delivered + %llu dropped; skew p99 %.1f us\n"
        "replay them with --source replay:%s\n",
        cap.n_exposures, o->out, (unsigned long long)l.captured, (unsigned long long)l.delivered,
        (unsigned long long)sv_ledger_dropped(&l),
        (double)sv_skew_percentile_ns(&cap.in.sync.skew, 99) * 1e-3, o->out);
  if (!o->is_quiet) trigger_say(&cap.src);
  if (o->is_json) return;
  if (coverage >= 0)
    say(1, "%d exposures are good; all cover %.0f %% of the directions around the scene\n",
        cap.guide.guidance.n_good, 100 * coverage);
  else if (cap.guide.guidance.n_good < cap.guide.guidance.n_kept)
    say(1, "%d exposures are good; the others are blurred, too dark or too bright\n",
        cap.guide.guidance.n_good);
  if (cap.n_lost) say(1, "%ld exposures could not be saved and were left out\n", cap.n_lost);
  for (int i = 0; i < cap.src.source.n_cameras; i++) {
    char line[512];
    sv_str s = sv_str_make(line, sizeof line);
    sv_camera_stats_line(&s, &cap.in.stats[i], sv_sync_ledger(&cap.in.sync, i), cap.src.caps[i].name);
    say(1, "  %s\n", line);
  }
  if (!cap.src.rig)
    say(1, "the capture has no rig: to train on it, calibrate the cameras and give --rig DIR\n");
}

static sv_status open_conversion(bool is_16_bit, sv_arena *arena, sv_err *err) {
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
  if (is_16_bit) {
    size_t bytes = 0;
    for (int i = 0; i < n; i++) {
      const sv_camera_caps *c = &cap.src.caps[i];
      const size_t b = 6 * (size_t)c->width_px * (size_t)c->height_px;
      if (b > bytes) bytes = b;
      cap.caps[i].format = SV_PIX_RGB16;
    }
    cap.rgb16 = SV_TAKE(arena, uint8_t, bytes);
  }
  sv_convert_cfg cc = {is_16_bit ? cap.src.caps : converted, n, 1, &cap.src.decoder, is_16_bit};
  return sv_convert_init(&cap.convert, &cc, arena, err);
}

static sv_status open_queue(const capture_options *o, sv_arena *arena, sv_err *err) {
  const int n = cap.src.source.n_cameras;
  const sv_capture_queue_cfg qc = {.n_cameras = n,
                                   .caps = cap.src.caps,
                                   .skew_limit_ns = o->skew_ms * SV_NS_PER_MS,
                                   .queue_len = QUEUE_LEN,
                                   .cap_ready = cap.src.is_virtual ? CAP_VIRTUAL : CAP_READY,
                                   .method = (sv_sync_method)o->i_sync};
  sv_arena_part_begin(arena, "sync");
  sv_status s = sv_capture_queue_init(&cap.in, &qc, &cap.src.source, &cap.src.clock, arena);
  if (s < 0) return sv_fail(err, s, "frame synchronization of %d cameras failed: %s", n, sv_status_text(s));
  return sv_capture_queue_check(&cap.in, err);
}

static void open_spacing(const capture_options *o) {
  double fps = 0;
  int n_brackets = 0;
  for (int i = 0; i < cap.src.source.n_cameras; i++) {
    fps = sv_maxd(fps, cap.src.caps[i].fps);
    n_brackets = sv_maxi(n_brackets, cap.src.caps[i].n_brackets);
  }
  sv_spacing_init(&cap.spacing,
                  &(sv_spacing_cfg){.every_ns = (sv_ns)(o->every_s * 1e9),
                                    .n_brackets = n_brackets,
                                    .early_ns = fps > 0 ? (sv_ns)(0.5e9 / fps) : 0},
                  NULL);
}

// With the source's rig, if it has one.
static sv_status open_writer(const capture_options *o, sv_arena *arena, sv_err *err) {
  double scene[6];
  for (int i = 0; i < 3; i++) {
    double h = (double)cap.src.bounds.radius / sqrt(3.0);
    scene[i] = (double)cap.src.bounds.centre[i] - h;
    scene[3 + i] = (double)cap.src.bounds.centre[i] + h;
  }
  const sv_capture_writer_cfg wc = {.dir = o->out,
                                    .name = "",
                                    .rig = cap.src.rig ? "rig" : NULL,
                                    .n_cameras = cap.src.source.n_cameras,
                                    .caps = cap.caps,
                                    .scene_m = cap.src.has_bounds ? scene : NULL};
  sv_arena_part_begin(arena, "writer");
  sv_status s = sv_capture_writer_open(&cap.writer, &wc, arena, err);
  if (s < 0) return s;
  // The writer holds the folder's lock: nothing of another capture is written over.
  for (int i = 0; cap.src.rig && i < N_CLOSE; i++) {
    s = write_rig(o->out, arena, err);
    if (s != SV_E_IO) break;
    wait_ns(FIRST_WAIT << i);
  }
  sv_err second; // the first one is told
  if (s < 0 && sv_capture_writer_close(&cap.writer, &second) < 0) return s;
  return s;
}

static sv_status open_all(const capture_options *o, sv_arena *arena, sv_err *err) {
  const source_cfg sc = {.spec = o->source,
                         .rig_path = o->rig,
                         .n_exposures = (int)o->exposures,
                         .is_triggered = o->i_sync == SV_SYNC_METHOD_TRIGGER};
  sv_status s = source_open(&cap.src, &sc, arena, err);
  if (s >= 0) s = open_queue(o, arena, err);
  if (s < 0) return s;
  open_spacing(o);
  if (sv_capture_has_frames(o->out))
    return sv_fail(err, SV_E_ARG, "%s: already holds a capture; choose another --out or remove it", o->out);
  s = open_conversion(is_deep(o), arena, err);
  if (s >= 0) s = guide_init(&cap.guide, &cap.src, o->arc_deg, &cap.kernels, arena, err);
  return s >= 0 ? open_writer(o, arena, err) : s;
}

// At the end there is no later try: several, over a few seconds.
static sv_status close_writer(sv_err *err) {
  for (int i = 0; i < N_CLOSE - 1; i++) {
    if (sv_capture_writer_finish(&cap.writer, err) >= 0) break;
    wait_ns(FIRST_WAIT << i);
  }
  sv_status s = sv_capture_writer_close(&cap.writer, err);
  if (s >= 0) return s;
  const sv_err why = *err;
  return sv_fail(err, s, "%s; the frames are saved, and the next program that reads the folder lists them",
                 why.text);
}

static int capture_all(const capture_options *o) {
  sv_err err = {0}, close_err = {0};
  sv_arena arena;
  sv_linux_console_init(&cap.console, 2, o->is_quiet);
  sv_linux_outlive_readers();
  if (board_arena(&arena, &err) < 0 || sv_linux_catch_signals(&err) < 0 || open_all(o, &arena, &err) < 0)
    return fail_with(&err);
  sv_arena_seal(&arena);
  sv_status s = start(&err);
  if (s >= 0) {
    s = record(o, &err);
    if (stop(&close_err) < 0 && s >= 0) {
      s = close_err.status;
      err = close_err;
    }
  }
  sv_linux_console_finish(&cap.console);
  if (close_writer(&close_err) < 0 && s >= 0) {
    s = close_err.status;
    err = close_err;
  }
  if (s >= 0 && !cap.n_exposures)
    s = sv_fail(&err, SV_E_NOT_FOUND, "the source ended without one synchronized exposure");
  if (s < 0) return fail_with(&err);
  print_ledger(o);
  return 0;
}

#define AT(field) offsetof(capture_options, field)

static const sv_option rows[] = {
    {"source", SV_OPT_TEXT, 1, 1, AT(source), "S",
     SOURCE_KINDS ", with options (see 'subview cameras --help')", 0, 0, NULL},
    {"rig", SV_OPT_TEXT, 1, 0, AT(rig), "DIR", "folder with rig.json, when the source has no rig of its own",
     0, 0, NULL},
    {"exposures", SV_OPT_INT, 1, 0, AT(exposures), "N", "end after N exposures", 1, 1000000, NULL},
    {"duration", SV_OPT_REAL, 1, 0, AT(duration), "SEC", "end after SEC seconds", 0.001, 1e6, NULL},
    {"every", SV_OPT_REAL, 1, 0, AT(every_s), "SEC", "time between exposures; 0: take each one [0]", 0, 3600,
     NULL},
    {"arc", SV_OPT_REAL, 1, 0, AT(arc_deg), "DEG",
     "azimuth around the scene that hints ask for, in degrees; the first exposure is in its middle [360]", 1,
     360, NULL},
    {"skew-limit", SV_OPT_INT, 1, 0, AT(skew_ms), "MS",
     "largest time skew between the cameras of an exposure, ms [20]", 1, 10000, NULL},
    {"sync", SV_OPT_WORD, 1, 0, AT(sync), "free|frame-length|trigger",
     "synchronization method: none (all sources), frame lengths set by software (sim, libcamera with fps=, "
     "V4L2 drivers that can), or pulses on a line (sim, V4L2 and libcamera with trigger=) [free]",
     0, 0, NULL},
    {"depth", SV_OPT_WORD, 1, 0, AT(depth), "8|16",
     "bits of each value that are kept; 16: raw frames of more than 8 bits, as PNG in linear light [8]", 0, 0,
     NULL},
    {"out", SV_OPT_TEXT, 1, 1, AT(out), "DIR", "the capture folder", 0, 0, NULL},
    {"json", SV_OPT_FLAG, 1, 0, AT(is_json), NULL, "print the results as one JSON object on stdout", 0, 0,
     NULL},
    {"quiet", SV_OPT_FLAG, 1, 0, AT(is_quiet), NULL, "no progress lines", 0, 0, NULL},
    OPTIONS_COMMON(capture_options)};

static const sv_tool_command command = {
    .name = "capture",
    .args = "--source S --out DIR [options]",
    .text = "Records synchronized exposures into a folder, which --source replay:DIR plays back.",
    .example = "  "
               "subview capture --source sim:textured,rig=stereo --exposures 8 --out out/capture",
    .bit = 1};

int cmd_capture(int argc, char **argv) {
  capture_options o = {.skew_ms = 20, .sync = "free"};
  int r = options_parse(&command, rows, sizeof rows / sizeof *rows, argc, argv, &o);
  if (r) return r < 0 ? 0 : r;
  o.i_sync = sync_mode_of(o.sync);
  if (!o.exposures && !(o.duration > 0))
    return usage_error("capture", "--exposures or --duration is missing");
  int code = capture_all(&o);
  source_close(&cap.src);
  return code;
}
