// SPDX-License-Identifier: Apache-2.0
#include "tools/import/track.h"

#include <stdlib.h>
#include <string.h>

#include "src/base/str.h"
#include "src/capture/odometry.h"
#include "tools/common/imageio.h"

#define BLOCK_BYTES ((size_t)6 << 30) // of address space; pages come when they are used
#define POOL_BYTES  ((size_t)1 << 30) // captures beyond keep one exposure, and find no loops
#define MIN_LOCATED 2
#define MIN_POINTS  40 // of a trajectory that is trusted

typedef struct {
  const lab_track_job *job;
  lab_session *se;
  sv_arena arena;
  sv_camera_caps *caps; // [n_cameras]
  sv_bitmap *pictures;  // [n_cameras] of one exposure
  sv_frame *frames;     // [n_cameras]
  sv_exposures pool;    // of all exposures, or of one
  sv_odometry odometry;
} tracking;

static sv_status carve(tracking *t, sv_err *err) {
  const lab_track_job *j = t->job;
  const int n_cameras = j->capture->n_cameras;
  size_t bytes = 0;
  t->caps = SV_TAKE(&t->arena, sv_camera_caps, n_cameras);
  t->pictures = SV_TAKE(&t->arena, sv_bitmap, n_cameras);
  t->frames = SV_TAKE(&t->arena, sv_frame, n_cameras);
  if (t->arena.status < 0) return sv_fail(err, t->arena.status, "%s: no memory for its cameras", j->dir);
  for (int c = 0; c < n_cameras; c++) {
    t->caps[c] = j->capture->cameras[c].caps;
    t->caps[c].format = SV_PIX_RGB8;
    t->pictures[c] = (sv_bitmap){0};
    bytes += 3 * (size_t)t->caps[c].width_px * (size_t)t->caps[c].height_px;
  }
  const sv_exposures_cfg ec = {.rig = j->rig,
                               .cap_exposures =
                                   (size_t)j->n_exposures <= POOL_BYTES / bytes ? j->n_exposures : 1,
                               .caps = t->caps,
                               .n_cameras = n_cameras,
                               .n_threads = t->se->n_threads};
  const sv_odometry_cfg oc = {.rig = j->rig,
                              .cap_exposures = j->n_exposures,
                              .pool = &t->pool,
                              .k = &t->se->k,
                              .seed = 1,
                              .is_rolling = sv_rig_is_rolling(j->rig)};
  sv_status s = sv_exposures_init(&t->pool, &ec, &t->arena, err);
  if (s == SV_OK) s = sv_odometry_init(&t->odometry, &oc, &t->arena, err);
  t->odometry.tracker.cfg.has_extrinsics = false; // the dataset keeps the rig's
  return s;
}

static sv_status read_picture(tracking *t, int c, int i_frame, sv_err *err) {
  const sv_capture_camera *cc = &t->job->capture->cameras[c];
  const sv_capture_frame *f = &cc->frames[i_frame];
  sv_bitmap *b = &t->pictures[c];
  char folder[SV_CAP_PATH], path[SV_CAP_PATH];
  sv_bitmap_free(b);
  sv_status s = sv_path_join(folder, sizeof folder, t->job->dir, cc->folder, err);
  if (s == SV_OK) s = sv_path_join(path, sizeof path, folder, f->file, err);
  if (s == SV_OK) s = sv_bitmap_read(path, b, err);
  if (s == SV_OK) s = sv_bitmap_to_8(b, err);
  if (s == SV_OK) s = sv_bitmap_to_channels(b, 3, err);
  if (s != SV_OK) return s;
  if (b->width_px != cc->caps.width_px || b->height_px != cc->caps.height_px)
    return sv_fail(err, SV_E_RANGE, "%s: %dx%d, expected %dx%d as the camera's other pictures", path,
                   b->width_px, b->height_px, cc->caps.width_px, cc->caps.height_px);
  t->frames[c] = (sv_frame){.i_camera = c,
                            .camera_ns = f->camera_ns,
                            .arrival_ns = f->arrival_ns,
                            .exposure_ns = f->exposure_ns,
                            .width_px = b->width_px,
                            .height_px = b->height_px,
                            .stride_bytes = 3 * b->width_px,
                            .format = SV_PIX_RGB8,
                            .data = b->u8,
                            .data_bytes = 3 * (size_t)b->width_px * (size_t)b->height_px};
  return SV_OK;
}

static sv_status add(tracking *t, int e, sv_err *err) {
  const int n_cameras = t->job->capture->n_cameras;
  const int *frame = t->job->frame + (size_t)e * (size_t)n_cameras;
  sv_exposure exposure = {.id = (uint32_t)e, .rig_from_world = sv_pose_identity()};
  sv_status s = SV_OK;
  for (int c = 0; c < n_cameras && s == SV_OK; c++) {
    exposure.present[c / 64] |= (uint64_t)1 << (c % 64);
    s = read_picture(t, c, frame[c], err);
  }
  if (s != SV_OK) return s;
  exposure.time_ns = t->frames[0].arrival_ns;
  if (t->pool.cfg.cap_exposures == 1) t->pool.i_next = 0;
  s = sv_exposures_add(&t->pool, &exposure, t->frames, &t->se->k, &t->se->pool, err);
  if (s != SV_OK) return s;
  s = sv_odometry_add(&t->odometry, &t->pool, t->pool.n - 1);
  return s < 0 ? sv_fail(err, s, "%s: odometry, exposure %d: %s", t->job->dir, e, sv_status_text(s)) : SV_OK;
}

static bool is_complete(const lab_track_job *j, int e) {
  for (int c = 0; c < j->capture->n_cameras; c++)
    if (j->frame[e * j->capture->n_cameras + c] < 0) return false;
  return true;
}

static void finish(tracking *t, lab_tracked *out) {
  sv_odometry *o = &t->odometry;
  sv_track_summary *m = &o->summary;
  if (t->pool.cfg.cap_exposures > 1) {
    sv_odometry_finish(o, &t->pool);
    out->is_moving = o->is_tracked;
  } else {
    sv_tracker_finish(&o->tracker, NULL, m);
    out->is_moving = !m->is_still && m->n_placed >= MIN_LOCATED && m->n_points >= MIN_POINTS;
  }
  out->scale_sigma = !out->is_moving || m->is_still ? 0 : m->scale_sigma;
  if (m->is_still) lab_say(t->se, "odometry: stationary rig (images move by %.2f px)", m->still_px);
  else if (!out->is_moving)
    lab_say(t->se,
            "odometry: located only %d of %d exposures from %d points; assuming a stationary rig; of a rig "
            "that moved, expected a textured scene and exposures at most about 12 degrees apart",
            m->n_placed, m->n_exposures, m->n_points);
  else {
    lab_say(t->se, "odometry: located %d of %d exposures over a %.2f m path, %d points, reprojection %.2f px",
            m->n_placed, m->n_exposures, m->path_m, m->n_points, m->rms_px);
    if (m->n_placed < m->n_exposures)
      lab_say(t->se, "odometry: the other %d are left out; expected exposures at most about 12 degrees apart",
              m->n_exposures - m->n_placed);
    if (m->scale_sigma < 0 || m->scale_sigma > SV_ODOMETRY_SCALE_DOUBT)
      lab_say(t->se, "odometry: the rig's baseline is too small to measure the scale of this scene");
  }
}

static sv_status track(tracking *t, sv_pose *pose, bool *is_placed, lab_tracked *out, sv_err *err) {
  const lab_track_job *j = t->job;
  const sv_tracker *tracker = &t->odometry.tracker;
  sv_status s = carve(t, err);
  for (int e = 0; e < j->n_exposures && s == SV_OK; e++)
    if (lab_is_stopped(t->se)) s = SV_E_INTERRUPTED;
    else if (is_complete(j, e)) s = add(t, e, err);
  if (s != SV_OK) return s;
  finish(t, out);
  for (int e = 0, i = 0; e < j->n_exposures; e++) {
    const bool has = is_complete(j, e);
    is_placed[e] = !out->is_moving || (has && tracker->is_placed[i]);
    pose[e] = out->is_moving && is_placed[e] ? tracker->pose[i] : sv_pose_identity();
    i += has;
  }
  return SV_OK;
}

sv_status lab_track(const lab_track_job *job, lab_session *se, sv_pose *rig_from_world, bool *is_placed,
                    lab_tracked *out, sv_err *err) {
  tracking *t = calloc(1, sizeof *t);
  void *block = malloc(BLOCK_BYTES);
  *out = (lab_tracked){0};
  sv_status s = t && block ? SV_OK : sv_fail(err, SV_E_NOMEM, "%s: no memory for odometry", job->dir);
  if (s == SV_OK) {
    *t = (tracking){.job = job, .se = se, .arena = sv_arena_make(block, BLOCK_BYTES)};
    s = track(t, rig_from_world, is_placed, out, err);
    for (int c = 0; t->pictures && c < job->capture->n_cameras; c++) sv_bitmap_free(&t->pictures[c]);
  }
  free(block);
  free(t);
  return s;
}
