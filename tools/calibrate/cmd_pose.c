// SPDX-License-Identifier: Apache-2.0
// subview-calibrate pose: where a rig was for each exposure of a capture. The runtime's own tracker
// (src/track), with OpenGV's absolute pose as a second opinion where it is installed.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "calib/solve/rig_pose.h"
#include "platform/linux/linux.h"
#include "platform/replay/replay.h"
#include "src/capture/odometry.h"
#include "src/base/str.h"
#include "src/format/rig_file.h"
#include "src/rig/sizes.h"
#include "src/sync/capture_queue.h"
#include "tools/calibrate/calibrate.h"
#include "tools/common/fileio.h"

#define BLOCK_BYTES ((size_t)6 << 30) // of address space; pages come when they are used
#define POOL_BYTES  ((size_t)1 << 30) // captures beyond keep one exposure, and do not look back
#define SKEW_NS     (20 * SV_NS_PER_MS)
#define LINE_BYTES  256

static struct {
  sv_arena arena;
  sv_replay replay;
  sv_source source;
  sv_clock clock;
  sv_rig rig;
  sv_camera_caps *caps;
  sv_capture_queue queue;
  sv_exposures pool; // of all exposures, or of one
  sv_odometry odometry;
  sv_tracker *tracker;
  sv_kernels k;
  sv_pool threads;
  sv_ns *time_ns; // [n]
  int n;
  sv_linux_console console;
} p;

static int fail(const sv_err *e) {
  fprintf(stderr, "subview-calibrate: %s\n", e->text);
  return CAL_EXIT_FAILED;
}

static sv_status stopped(sv_err *err) {
  sv_console c = sv_linux_console_port(&p.console);
  return c.is_stop_requested(c.self)
             ? sv_fail(err, SV_E_INTERRUPTED, "stopped by request: no result was written")
             : SV_OK;
}

// --- opening -------------------------------------------------------------------------------------

static sv_status open_capture(const cal_options *o, sv_err *err) {
  sv_replay_cfg cfg = {.speed = 0};
  if (strlen(o->capture) >= sizeof cfg.dir) return sv_fail(err, SV_E_ARG, "--capture: the name is too long");
  sv_copy(cfg.dir, sizeof cfg.dir, o->capture);
  sv_status s = sv_replay_init(&p.replay, &cfg, &p.arena, err);
  if (s < 0) return s;
  p.source = sv_replay_source(&p.replay);
  p.clock = sv_replay_clock(&p.replay);
  p.caps = SV_TAKE(&p.arena, sv_camera_caps, p.source.n_cameras);
  if (!p.caps) return sv_fail(err, SV_E_NOMEM, "%s: no memory for its cameras", o->capture);
  for (int i = 0; i < p.source.n_cameras; i++) {
    if ((s = p.source.caps(p.source.self, i, &p.caps[i])) < 0)
      return sv_fail(err, s, "%s: camera %d does not report its capabilities", o->capture, i);
    int n = p.replay.capture.cameras[i].n_frames;
    p.n = i == 0 || n < p.n ? n : p.n;
  }
  return p.n > 1 ? SV_OK : sv_fail(err, SV_E_RANGE, "%s: %d exposures, expected at least 2", o->capture, p.n);
}

static sv_status open_rig(const cal_options *o, sv_err *err) {
  sv_file_reader files = {(void *)(uintptr_t)o->rig, sv_folder_read};
  if (sv_rig_init(&p.rig, SV_CAP_SUB_VIEWS, &p.arena) < 0)
    return sv_fail(err, SV_E_NOMEM, "%s: no memory for the rig", o->rig);
  sv_status s = sv_rig_read(&p.rig, &files, p.source.n_cameras, &p.arena, err);
  if (s < 0) return s;
  for (int i = 0; i < p.rig.n_sub_views; i++) { // at the size that was captured
    sv_sub_view *v = &p.rig.sub_views[i];
    const sv_camera_caps *c = &p.caps[v->i_camera];
    sv_size_fit how;
    sv_image_map map;
    if ((s = sv_sub_view_fit(v, &(sv_image_mode){c->width_px, c->height_px, c->area}, &how, &map, err)) < 0)
      return s;
  }
  return sv_odometry_can(&p.rig, p.n)
             ? SV_OK
             : sv_fail(err, SV_E_UNSUPPORTED,
                       "%s: the lens images of a multiplexed rig overlap and cannot be tracked", o->rig);
}

static bool has_room_for_all(void) {
  size_t bytes = 0;
  for (int i = 0; i < p.rig.n_sub_views; i++) {
    const sv_camera_model *m = &p.rig.sub_views[i].model;
    bytes += 3 * (size_t)m->width_px * (size_t)m->height_px;
  }
  return (size_t)p.n <= POOL_BYTES / bytes;
}

static sv_status open_tracker(sv_err *err) {
  sv_capture_queue_cfg ic = {.n_cameras = p.source.n_cameras,
                             .caps = p.caps,
                             .skew_limit_ns = SKEW_NS,
                             .queue_len = 4,
                             .cap_ready = 4};
  sv_exposures_cfg ec = {.rig = &p.rig,
                         .cap_exposures = has_room_for_all() ? p.n : 1,
                         .caps = p.caps,
                         .n_cameras = p.source.n_cameras,
                         .n_threads = 1};
  sv_status s = sv_capture_queue_init(&p.queue, &ic, &p.source, &p.clock, &p.arena);
  if (s < 0) return sv_fail(err, s, "no synchronization for %d cameras", p.source.n_cameras);
  if ((s = sv_exposures_init(&p.pool, &ec, &p.arena, err)) < 0) return s;
  sv_kernels_init(&p.k, ~0u);
  p.threads = sv_pool_serial();
  p.time_ns = SV_TAKE(&p.arena, sv_ns, p.n);
  const sv_odometry_cfg oc = {.rig = &p.rig,
                              .cap_exposures = p.n,
                              .pool = &p.pool,
                              .k = &p.k,
                              .seed = 1,
                              .is_rolling = sv_rig_is_rolling(&p.rig)};
  s = sv_odometry_init(&p.odometry, &oc, &p.arena, err);
  p.tracker = &p.odometry.tracker;
  p.tracker->cfg.has_extrinsics = false;
  if (sv_rig_pose_has_opengv()) p.tracker->cfg.solver.absolute = sv_rig_pose_opengv;
  return s;
}

// --- tracking ------------------------------------------------------------------------------------

static sv_status take(const cal_options *o, int *n, sv_err *err) {
  sv_exposure_slot *slot;
  sv_status s = stopped(err);
  if (s == SV_OK) s = sv_capture_queue_take(&p.queue, &slot);
  if (s != SV_OK) return s;
  if (p.pool.cfg.cap_exposures == 1) p.pool.i_next = 0;
  s = sv_exposures_add(&p.pool, &slot->exposure, slot->frames, &p.k, &p.threads, err);
  p.time_ns[*n] = slot->exposure.time_ns;
  sv_capture_queue_give_back(&p.queue, slot, true);
  if (s < 0) return s == SV_E_FORMAT || s == SV_E_CORRUPT ? SV_DROPPED : s;
  s = sv_odometry_add(&p.odometry, &p.pool, p.pool.n - 1);
  if (s < 0) return sv_fail(err, s, "exposure %d: %s", *n, sv_status_text(s));
  if (!o->is_quiet && (++*n % 10 == 0 || *n == p.n)) fprintf(stderr, "pose  %d/%d exposures\n", *n, p.n);
  else if (o->is_quiet) ++*n;
  return SV_OK;
}

static sv_status track(const cal_options *o, int *n, sv_err *err) {
  sv_status s = sv_capture_queue_start(&p.queue, err), got = SV_OK;
  if (s < 0) return s;
  while (*n < p.n && s != SV_END) {
    s = sv_capture_queue_step(&p.queue, p.clock.now_ns(p.clock.self) + SV_NS_PER_S);
    while (*n < p.n && ((got = take(o, n, err)) == SV_OK || got == SV_DROPPED)) {
    }
    if (got < 0) break;
  }
  s = sv_capture_queue_stop(&p.queue);
  if (got < 0) return got;
  if (s < 0) return sv_fail(err, s, "%s: the replay did not stop", o->capture);
  return *n > 1 ? SV_OK
                : sv_fail(err, SV_E_NOT_FOUND,
                          "%s: %d synchronized exposures (skew limit %g ms), expected at least 2", o->capture,
                          *n, sv_ns_to_ms(SKEW_NS));
}

// --- writing -------------------------------------------------------------------------------------

static sv_status begin(sv_file *f, const cal_options *o, const char *name, sv_err *err) {
  char path[SV_CAP_PATH];
  sv_file_init(f);
  sv_status s = sv_path_join(path, sizeof path, o->out, name, err);
  return s < 0 ? s : sv_file_begin(f, path, err);
}

// s: how writing went; half a file does not stay.
static sv_status end(sv_file *f, sv_status s, sv_err *err) {
  if (s >= 0) return sv_file_commit(f, err);
  sv_file_abandon(f);
  return s;
}

// The member "poses" of a capture.json, on its own.
static sv_status write_poses(const cal_options *o, int n, double scale_sigma, sv_err *err) {
  sv_file f;
  char buf[LINE_BYTES * 2];
  bool has = false;
  sv_status s = begin(&f, o, "poses.json", err);
  sv_str head = sv_str_make(buf, sizeof buf);
  sv_str_add(&head, "{\"version\": 1, ");
  if (scale_sigma > 0) sv_str_add(&head, "\"scale_sigma\": %.3g, ", scale_sigma);
  sv_str_add(&head, "\"poses\": [");
  if (s >= 0) s = sv_file_append(&f, head.buf, head.len, err);
  for (int i = 0; i < n && s >= 0; i++) {
    const sv_pose *pose = &p.tracker->pose[i];
    double q[4];
    sv_str t = sv_str_make(buf, sizeof buf);
    if (!p.tracker->is_placed[i]) continue;
    sv_quat_from_mat(q, pose->r);
    sv_str_add(
        &t,
        "%s\n  {\"time_ns\": %lld, \"rig_from_world\": [%.17g, %.17g, %.17g, %.17g, %.17g, %.17g, %.17g]}",
        has ? "," : "", (long long)p.time_ns[i], q[0], q[1], q[2], q[3], pose->t[0], pose->t[1], pose->t[2]);
    has = true;
    s = sv_file_append(&f, t.buf, t.len, err);
  }
  if (s >= 0) s = sv_file_append(&f, "\n]}\n", 4, err);
  return end(&f, s, err);
}

static sv_status write_cloud(const cal_options *o, const sv_track_summary *m, sv_err *err) {
  sv_file f;
  char buf[LINE_BYTES];
  sv_str t = sv_str_make(buf, sizeof buf);
  sv_status s = begin(&f, o, "points.ply", err);
  sv_str_add(
      &t,
      "ply\nformat ascii 1.0\nelement vertex %d\nproperty float x\nproperty float y\nproperty float z\n"
      "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n",
      m->n_points);
  if (s >= 0) s = sv_file_append(&f, t.buf, t.len, err);
  for (int i = 0; i < p.tracker->n_points && s >= 0; i++) {
    const sv_track_point *x = &p.tracker->point[i];
    if (!x->has_depth) continue;
    t = sv_str_make(buf, sizeof buf);
    sv_str_add(&t, "%.9g %.9g %.9g %d %d %d\n", x->x[0], x->x[1], x->x[2], x->rgb[0], x->rgb[1], x->rgb[2]);
    s = sv_file_append(&f, t.buf, t.len, err);
  }
  return end(&f, s, err);
}

static void tell(const cal_options *o, const sv_track_summary *m) {
  if (o->is_json) {
    printf("{\"exposures\": %d, \"placed\": %d, \"points\": %d, \"seen_again\": %d, \"is_still\": %s, "
           "\"still_px\": %.3f, "
           "\"path_m\": %.5f, "
           "\"rms_px\": %.4f, \"scale_sigma\": %.6f, \"has_opengv\": %s}\n",
           m->n_exposures, m->n_placed, m->n_points, m->n_seen_again, m->is_still ? "true" : "false",
           m->still_px, m->path_m, m->rms_px, m->scale_sigma, sv_rig_pose_has_opengv() ? "true" : "false");
    return;
  }
  if (m->is_still)
    printf("stationary rig (background moves by %.2f px): %d exposures, %d points, reprojection RMS "
           "%.2f px\n",
           m->still_px, m->n_exposures, m->n_points, m->rms_px);
  else {
    char scale[32] = "unknown";
    if (m->scale_sigma >= 0) sv_fmt(scale, sizeof scale, "+- %.2f %%", 100 * m->scale_sigma);
    printf("located %d of %d exposures over a %.3f m path, %d points (%d times seen again), reprojection RMS "
           "%.2f px, "
           "scale %s\n",
           m->n_placed, m->n_exposures, m->path_m, m->n_points, m->n_seen_again, m->rms_px, scale);
  }
  if (!m->is_still && (m->scale_sigma < 0 || m->scale_sigma > 0.02))
    printf("warning: the rig's baseline is too small to determine the scale of this scene well\n");
  if (m->n_placed < m->n_exposures)
    printf("warning: %d exposures could not be located and are skipped: %s\n", m->n_exposures - m->n_placed,
           m->is_still ? "they overlap too little with the first one"
                       : "move more slowly, or record more exposures along the same path (at most about 12 "
                         "degrees apart)");
  printf("saved: %s/poses.json %s/points.ply\n", o->out, o->out);
}

static int run(const cal_options *o) {
  sv_err err = {0};
  sv_track_summary m;
  int n = 0;
  sv_linux_console_init(&p.console, 2, o->is_quiet);
  sv_status s = sv_linux_catch_signals(&err);
  if (s >= 0) s = open_capture(o, &err);
  if (s >= 0) s = open_rig(o, &err);
  if (s >= 0) s = open_tracker(&err);
  if (s >= 0) s = track(o, &n, &err);
  if (s < 0) return fail(&err);
  if (p.pool.cfg.cap_exposures > 1) {
    sv_odometry_finish(&p.odometry, &p.pool);
    m = p.odometry.summary;
  } else sv_tracker_finish(p.tracker, NULL, &m);
  if (stopped(&err) < 0) return fail(&err);
  if (!m.is_still && m.n_placed < 2) {
    s = sv_fail(&err, SV_E_NOT_FOUND,
                "%s: located only %d of %d exposures, from %d points: expected a textured scene, overlapping "
                "cameras, and exposures at most about 12 degrees apart; record more exposures along the same "
                "path, or move more slowly",
                o->capture, m.n_placed, n, m.n_points);
    return fail(&err);
  }
  s = sv_path_make_folder(o->out, &err);
  if (s >= 0) s = write_poses(o, n, m.scale_sigma, &err);
  if (s >= 0) s = write_cloud(o, &m, &err);
  if (s < 0) return fail(&err);
  tell(o, &m);
  return CAL_EXIT_OK;
}

int cal_cmd_pose(const cal_options *o) {
  void *block = malloc(BLOCK_BYTES);
  if (!block) {
    fprintf(stderr, "subview-calibrate: no memory\n");
    return CAL_EXIT_FAILED;
  }
  memset(&p, 0, sizeof p);
  p.arena = sv_arena_make(block, BLOCK_BYTES);
  int code = run(o);
  sv_replay_close(&p.replay);
  free(block);
  return code;
}
