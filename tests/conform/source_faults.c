// SPDX-License-Identifier: Apache-2.0
// Faults on cameras that are there, through the capture side of the runtime: the first camera
// fails, by what its driver can inject; it must say so by name, be back within three frames of the
// fault's end, and leave the others and the ledger alone. Runs on the virtual board.
//
//   source-faults v4l2:/dev/video0,/dev/video1[,...]     vivid's fault controls, unplugging
//   source-faults hdmi:/dev/video3,/dev/video0[,...]     the first one's signal changes, goes,
//   comes back
//   source-faults loop:/dev/video20,/dev/video21[,...]   frames played into v4l2loopback: short, of
//   another size, none
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "platform/linux/linux.h"
#include "platform/v4l2/v4l2.h"
#include "src/sync/capture_queue.h"
#include "tests/conform/inject.h"

#define CAP_CAMERAS 4
// from the fault's end to the first good frame, of the other cameras
#define MOST_FRAMES 3
#define WARM_FRAMES 6 // of each camera, before the fault
// more between two frames are another start, no wrap of the numbers
#define WRAP_FRAMES 1000
#define GIVE_UP_NS  (18 * SV_NS_PER_S)   // an emulated board can be slow
#define HOLD_NS     (700 * SV_NS_PER_MS) // of faults that last until they are taken away

typedef struct {
  const char *name;
  bool (*begin)(inject *j);
  bool (*end)(inject *j); // NULL: it ends by itself, at once
  int camera_event;       // that must be told; -1: none
  int sync_event;         // the same of src/sync; -1: none
  const char *options;    // of the source
  bool keeps_running;     // the first camera is not started again either
  bool has_wrap;          // lasts until the first camera's numbers have wrapped
} fault;

#define NONE (-1)
#define CONTROL_FAULT(word, control, on, off)                                                                \
  static bool word##_on(inject *j) { return inject_control(j, control, on); }                                \
  static bool word##_off(inject *j) { return inject_control(j, control, off); }
CONTROL_FAULT(drops, "percentage_of_dropped_buffers", 60, 0)
CONTROL_FAULT(stall, "percentage_of_dropped_buffers", 100, 0)
CONTROL_FAULT(stamps, "timestamp_source", 0, 1)
CONTROL_FAULT(slower, "reduced_framerate", 1, 0)
CONTROL_FAULT(no_signal, "dv_timings_signal_mode", 1, 4)
CONTROL_FAULT(no_lock, "dv_timings_signal_mode", 2, 4)
CONTROL_FAULT(out_of_range, "dv_timings_signal_mode", 3, 4)
CONTROL_FAULT(other_timings, "dv_timings", 2, 0)

static bool flag(inject *j) { return inject_control(j, "inject_v4l2_buf_flag_error", 1); }
static bool unplug_at_once(inject *j) { return inject_control(j, "disconnect", 1); }
static bool fatal(inject *j) { return inject_control(j, "inject_fatal_streaming_error", 1); }
static bool no_streamon(inject *j) {
  return inject_control(j, "inject_vidioc_streamon_error", 1) && fatal(j);
}
static bool no_reqbufs(inject *j) { return inject_control(j, "inject_vidioc_reqbufs_error", 1) && fatal(j); }
// These two count from the start of a stream, which the error makes.
static bool time_wrap_on(inject *j) { return inject_control(j, "wrap_timestamp", 2) && fatal(j); }
static bool time_wrap_off(inject *j) { return inject_control(j, "wrap_timestamp", 0) && fatal(j); }
static bool number_wrap_on(inject *j) { return inject_control(j, "wrap_sequence_number", 1) && fatal(j); }
static bool number_wrap_off(inject *j) { return inject_control(j, "wrap_sequence_number", 0) && fatal(j); }
static bool no_qbuf(inject *j) { return inject_control(j, "inject_vidioc_qbuf_error", 1); }
static bool no_request(inject *j) { return inject_control(j, "inject_req_validate_error", 1); }

static const fault vivid_faults[] = {
    {"dropped_buffers", drops_on, drops_off, NONE, SV_SYNC_EVENT_SEQUENCE_GAP, ""},
    {"buf_flag_error", flag, NULL, SV_CAMERA_DAMAGED, SV_SYNC_EVENT_BAD_FRAME, ""},
    {"disconnect", unplug_at_once, NULL, SV_CAMERA_LOST, NONE, ""},
    {"unplug_replug", inject_unplug, inject_replug, SV_CAMERA_LOST, NONE, ""},
    {"fatal_streaming_error", fatal, NULL, SV_CAMERA_LOST, NONE, ""},
    {"streamon_error", no_streamon, NULL, SV_CAMERA_LOST, NONE, ""},
    {"reqbufs_error", no_reqbufs, NULL, SV_CAMERA_LOST, NONE, ""},
    {"qbuf_error", no_qbuf, NULL, SV_CAMERA_LOST, NONE, ""},
    // A setting of requests, which are not used: nothing may happen.
    {"req_validate_error", no_request, NULL, NONE, NONE, "", true},
    {"stall", stall_on, stall_off, SV_CAMERA_STALLED, NONE, ",stall=300"},
    {"wrap_timestamp", time_wrap_on, time_wrap_off, NONE, SV_SYNC_EVENT_CLOCK_STEP, ""},
    // Numbers that start 128 frames before the end of 32 bits: the start is told, the wrap is none.
    // 9 s at this rate, which is one at which the others send no four frames while the first one
    // starts again.
    {"wrap_sequence_number", number_wrap_on, number_wrap_off, NONE, SV_SYNC_EVENT_SEQUENCE_RESET, ",fps=15",
     false, true},
    {"timestamp_source", stamps_on, stamps_off, NONE, NONE, "", true},
};
static const fault hdmi_faults[] = {
    {"no_signal", no_signal_on, no_signal_off, SV_CAMERA_SIGNAL, NONE, ""},
    {"no_lock", no_lock_on, no_lock_off, SV_CAMERA_SIGNAL, NONE, ""},
    {"out_of_range", out_of_range_on, out_of_range_off, SV_CAMERA_SIGNAL, NONE, ""},
    {"other_timings", other_timings_on, other_timings_off, SV_CAMERA_WRONG_SIZE, NONE, ""},
    {"reduced_framerate", slower_on, slower_off, NONE, NONE, "", true},
};
static const fault loop_faults[] = {
    {"short_frame", inject_short, inject_good, SV_CAMERA_SHORT_FRAME, SV_SYNC_EVENT_BAD_FRAME,
     ",format=MJPG"},
    {"wrong_size", inject_other_size, inject_good, SV_CAMERA_WRONG_SIZE, SV_SYNC_EVENT_BAD_FRAME,
     ",format=MJPG"},
    {"no_frames", inject_silence, inject_good, SV_CAMERA_STALLED, NONE, ",format=MJPG,stall=300"},
};

// --- one capture ---------------------------------------------------------------------------------
static _Alignas(64) uint8_t block[8 << 20];
static struct {
  sv_v4l2 v4l2;
  sv_capture_queue in;
  sv_clock clock;
  inject inject;
  int n_cameras;
  uint32_t sequence; // of the first camera's newest frame
  bool has_wrapped;
  // since the fault's end
  bool is_ended;
  sv_ns end_ns, back_ns; // back: of the first camera's first good frame
  uint64_t n_frames[CAP_CAMERAS], n_at_end[CAP_CAMERAS], n_at_back[CAP_CAMERAS], n_good_first, n_lost;
  uint64_t n_events[SV_N_CAMERA_EVENTS], n_events_of_others, n_errors_of_others;
} t;

static sv_ns now(void) { return t.clock.now_ns(t.clock.self); }

static void on_frame(void *self, const sv_frame *f) {
  (void)self;
  int c = f->i_camera;
  t.n_frames[c]++;
  if (c > 0) t.n_errors_of_others += f->is_error;
  if (c == 0) {
    t.has_wrapped |= t.sequence >> 31 && !(f->sequence >> 31) && f->sequence - t.sequence < WRAP_FRAMES;
    t.sequence = f->sequence;
  }
  if (!t.is_ended || c > 0) return;
  uint64_t n_lost = sv_v4l2_camera_stats(&t.v4l2, 0)->n_lost;
  // what came since the end had been on its way before the fault
  if (n_lost != t.n_lost) t.n_good_first = 0;
  t.n_lost = n_lost;
  if (f->is_error || f->arrival_ns < t.end_ns || t.n_good_first++) return;
  t.back_ns = f->arrival_ns;
  memcpy(t.n_at_back, t.n_frames, sizeof t.n_at_back);
}

static void step(sv_ns ns) {
  sv_exposure_slot *e;
  sv_camera_event ev;
  for (sv_ns end = now() + ns; now() < end;) {
    sv_ns until = inject_feed(&t.inject, now());
    sv_status s = sv_capture_queue_step(&t.in, until < end ? until : end);
    (void)s; // failures are counted; what they are is told by events
    while (sv_capture_queue_take(&t.in, &e) == SV_OK) sv_capture_queue_give_back(&t.in, e, true);
    while (sv_capture_queue_pop_event(&t.in, &ev) == SV_OK) {
      // A camera that is only slow to be asked has lost nothing of itself.
      if (ev.i_camera > 0 && ev.kind != SV_CAMERA_STARVED) t.n_events_of_others++;
      if (ev.i_camera == 0) t.n_events[ev.kind]++;
    }
  }
}

static sv_status open_all(const char *cameras, const char *options, sv_err *err) {
  static char spec[512];
  static sv_camera_caps caps[CAP_CAMERAS];
  sv_camera_options o;
  sv_v4l2_sys sys = sv_v4l2_linux();
  sv_arena arena = sv_arena_make(block, sizeof block);
  sv_fmt(spec, sizeof spec, "%s,settle=0%s", cameras, options);
  sv_status s = sv_camera_parse("v4l2", spec, &o, err);
  if (s >= 0 && o.n_cameras > CAP_CAMERAS) s = sv_fail(err, SV_E_ARG, "at most %d cameras", CAP_CAMERAS);
  if (s >= 0) s = sv_v4l2_init(&t.v4l2, &o, &sys, &t.clock, &arena, err);
  if (s < 0) return s;
  sv_source src = sv_v4l2_source(&t.v4l2);
  t.n_cameras = src.n_cameras;
  for (int i = 0; i < t.n_cameras; i++)
    if ((s = src.caps(src.self, i, &caps[i])) < 0) return s;
  sv_capture_queue_cfg cfg = {.n_cameras = t.n_cameras,
                              .caps = caps,
                              .skew_limit_ns = 200 * SV_NS_PER_MS,
                              .queue_len = 4,
                              .cap_ready = 2,
                              .on_frame = on_frame};
  s = sv_capture_queue_init(&t.in, &cfg, &src, &t.clock, &arena);
  return s < 0 ? sv_fail(err, s, "no capture side for %d cameras", t.n_cameras)
               : sv_capture_queue_start(&t.in, err);
}

static bool all_have(uint64_t n) {
  for (int i = 0; i < t.n_cameras; i++)
    if (t.n_frames[i] < n) return false;
  return true;
}

static uint64_t frames_until_back(void) {
  uint64_t most = 0;
  for (int i = 1; t.back_ns && i < t.n_cameras; i++)
    if (t.n_at_back[i] - t.n_at_end[i] > most) most = t.n_at_back[i] - t.n_at_end[i];
  return most;
}

static bool is_told(const fault *f) {
  return (f->camera_event < 0 || t.n_events[f->camera_event]) &&
         (f->sync_event < 0 || t.in.sync.streams[0].events[f->sync_event]);
}

// What is wrong, or NULL.
static const char *judge(const fault *f, sv_status stopped) {
  const sv_sync *sync = &t.in.sync;
  if (!t.back_ns) return "the camera did not come back";
  if (frames_until_back() > MOST_FRAMES) return "it took longer than three frames of the others";
  if (f->camera_event >= 0 && !t.n_events[f->camera_event]) return "the event was not told";
  if (f->sync_event >= 0 && !sync->streams[0].events[f->sync_event]) return "the event was not counted";
  if (f->keeps_running && (t.n_events[SV_CAMERA_LOST] || t.n_events[SV_CAMERA_RESTARTED]))
    return "the camera was started again without need";
  if (t.n_events_of_others || t.n_errors_of_others) return "another camera noticed";
  for (int i = 1; i < t.n_cameras; i++) {
    const sv_v4l2_stats *v = sv_v4l2_camera_stats(&t.v4l2, i);
    if (v->n_lost || v->n_restarts) return "another camera was started again";
    if (sync->streams[i].events[SV_SYNC_EVENT_CLOCK_STEP]) return "another camera's clock seemed to step";
  }
  for (int i = 0; i < t.n_cameras; i++) {
    const sv_ledger *l = sv_sync_ledger(sync, i);
    if (!sv_ledger_is_exact(l) || l->pending || !l->captured) return "the ledger does not add up";
  }
  return stopped < 0 ? "the cameras did not stop" : NULL;
}

static bool try_fault(const fault *f, const char *cameras) {
  sv_err err;
  const char *why = NULL;
  bool is_seen = true;
  inject kept = t.inject;
  memset(&t, 0, sizeof t);
  t.inject = kept;
  t.clock = sv_linux_clock();
  if (open_all(cameras, f->options, &err) < 0) {
    printf("FAIL %s: %s\n", f->name, err.text);
    sv_v4l2_close(&t.v4l2);
    return false;
  }
  for (sv_ns end = now() + GIVE_UP_NS; !all_have(WARM_FRAMES) && now() < end;) step(20 * SV_NS_PER_MS);
  if (!all_have(WARM_FRAMES)) why = "there was not one camera too few before the fault";
  if (!why && !f->begin(&t.inject)) why = "the fault could not be made";
  if (f->end && !why) {
    for (sv_ns end = now() + GIVE_UP_NS, least = now() + HOLD_NS; now() < end;) {
      step(20 * SV_NS_PER_MS);
      if ((!f->has_wrap || t.has_wrapped) && now() >= least && is_told(f)) break;
    }
    if (f->has_wrap && t.in.sync.streams[0].events[f->sync_event] > 1)
      why = "the wrap was taken for a new start";
    is_seen = !f->has_wrap || t.has_wrapped;
    if (!f->end(&t.inject)) why = "the fault could not be ended";
  }
  t.end_ns = now();
  t.is_ended = true;
  t.n_lost = sv_v4l2_camera_stats(&t.v4l2, 0)->n_lost;
  memcpy(t.n_at_end, t.n_frames, sizeof t.n_at_end);
  sv_ns give_up = t.end_ns + GIVE_UP_NS;
  while (!why && (t.n_good_first < 4 || !is_told(f)) && now() < give_up) step(20 * SV_NS_PER_MS);
  sv_status stopped = sv_capture_queue_stop(&t.in);
  if (!why) why = judge(f, stopped);
  sv_ledger l = *sv_sync_ledger(&t.in.sync, 0);
  printf("%s %s: back after %llu frames of the others (%lld ms); %llu captured = %llu delivered + %llu "
         "dropped%s%s\n",
         why       ? "FAIL"
         : is_seen ? "ok  "
                   : "note",
         f->name, (unsigned long long)frames_until_back(),
         (long long)((t.back_ns ? t.back_ns - t.end_ns : 0) / SV_NS_PER_MS), (unsigned long long)l.captured,
         (unsigned long long)l.delivered, (unsigned long long)sv_ledger_dropped(&l), why ? ": " : "",
         why ? why : "");
  if (!why && !is_seen)
    printf("skip %s: the numbers did not wrap within %lld s\n", f->name,
           (long long)(GIVE_UP_NS / SV_NS_PER_S));
  sv_v4l2_close(&t.v4l2);
  inject_restore(&t.inject);
  return !why;
}

int main(int argc, char **argv) {
  static const struct {
    const char *kind;
    const fault *list;
    size_t n;
  } kinds[] = {{"v4l2:", vivid_faults, sizeof vivid_faults / sizeof *vivid_faults},
               {"hdmi:", hdmi_faults, sizeof hdmi_faults / sizeof *hdmi_faults},
               {"loop:", loop_faults, sizeof loop_faults / sizeof *loop_faults}};
  int n_failed = 0;
  setvbuf(stdout, NULL, _IOLBF, 0);
  for (int k = 0; argc == 2 && k < 3; k++) {
    if (strncmp(argv[1], kinds[k].kind, 5) != 0) continue;
    const char *cameras = argv[1] + 5;
    if (!inject_open(&t.inject, cameras, k == 2)) return 1;
    if (k == 1 && !(inject_control(&t.inject, "dv_timings", 0) &&
                    inject_control(&t.inject, "dv_timings_signal_mode", 4)))
      return 1;
    for (size_t i = 0; i < kinds[k].n; i++) n_failed += !try_fault(&kinds[k].list[i], cameras);
    inject_close(&t.inject);
    return n_failed != 0;
  }
  fprintf(stderr, "usage: source-faults v4l2:|hdmi:|loop:/dev/videoN,/dev/videoM[,...]\n");
  return 2;
}
