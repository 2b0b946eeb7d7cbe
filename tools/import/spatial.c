// SPDX-License-Identifier: Apache-2.0
// Spatial video: one file with a left and a right eye, as layers of one MV-HEVC stream, as two
// tracks, or packed into one picture -> a capture folder with a rig of two pinhole cameras.
#include "tools/import/spatial.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tools/import/clips.h"
#include "tools/import/import.h"

typedef struct {
  const lab_options *o;
  lab_session *se;
  sv_import_job job;
  lab_spatial file;
  lab_spatial_track eye; // what is said of both
  char stream[2][40], filter[2][64];
  lab_clip clips[2];
  lab_clips all;
  sv_import_camera cams[2];
} job;

// --- where the eyes are --------------------------------------------------------------------------

static sv_status find_layers(job *j, int i_track, sv_err *err) {
  char version[40];
  bool has = false;
  sv_status s = lab_media_has_views(&has, version, sizeof version, err);
  if (s != SV_OK) return s;
  if (!has)
    return sv_fail(
        err, SV_E_UNSUPPORTED,
        "%s: its eyes are layers of MV-HEVC, which needs ffmpeg 7.1 or newer (Debian 13); this is %s",
        j->o->input, version);
  // The base layer is the left eye unless the file says that they are reversed.
  for (int e = 0; e < 2; e++)
    snprintf(j->stream[e], sizeof j->stream[e], "0:v:%d:vidx:%d", i_track, e ^ (int)j->eye.is_reversed);
  return SV_OK;
}

static void find_halves(job *j, int i_track) {
  const bool is_side = j->eye.packing == LAB_PACKING_SIDE;
  for (int e = 0; e < 2; e++) {
    const bool is_second = e ^ (int)j->eye.is_reversed;
    snprintf(j->stream[e], sizeof j->stream[e], "0:v:%d", i_track);
    snprintf(j->filter[e], sizeof j->filter[e], is_side ? "crop=iw/2:ih:%s:0" : "crop=iw:ih/2:0:%s",
             !is_second ? "0"
             : is_side  ? "iw/2"
                        : "ih/2");
  }
}

// Two tracks, each of one eye.
static bool find_tracks(job *j) {
  int left = -1, right = -1;
  for (int i = 0; i < j->file.n; i++) {
    const lab_spatial_track *t = &j->file.tracks[i];
    if (t->has_left && !t->has_right) left = i;
    if (t->has_right && !t->has_left) right = i;
  }
  if (left < 0 || right < 0) return false;
  const lab_spatial_track *l = &j->file.tracks[left], *r = &j->file.tracks[right];
  j->eye = *l;
  if (!(l->baseline_m > 0)) j->eye.baseline_m = r->baseline_m;
  if (!(l->fov_rad > 0)) j->eye.fov_rad = r->fov_rad;
  j->eye.is_rectilinear = l->is_rectilinear && r->is_rectilinear;
  snprintf(j->stream[0], sizeof j->stream[0], "0:v:%d", left);
  snprintf(j->stream[1], sizeof j->stream[1], "0:v:%d", right);
  return true;
}

static sv_status find_eyes(job *j, sv_err *err) {
  for (int i = 0; i < j->file.n; i++) {
    const lab_spatial_track *t = &j->file.tracks[i];
    if (!t->has_left || !t->has_right) continue;
    j->eye = *t;
    if (t->is_layered) return find_layers(j, i, err);
    if (t->packing == LAB_PACKING_NONE) continue;
    find_halves(j, i);
    return SV_OK;
  }
  return find_tracks(j)
             ? SV_OK
             : sv_fail(err, SV_E_FORMAT,
                       "%s: no spatial video: its boxes (vexu) tell of no left and right eye", j->o->input);
}

// --- the cameras ---------------------------------------------------------------------------------

static sv_status check_said(job *j, sv_err *err) {
  if (!j->eye.is_rectilinear)
    return sv_fail(err, SV_E_UNSUPPORTED, "%s: its projection (prji) is not rectilinear; only that is read",
                   j->o->input);
  if (j->o->baseline_m > 0) j->eye.baseline_m = j->o->baseline_m;
  if (!(j->eye.baseline_m > 0))
    return sv_fail(err, SV_E_NOT_FOUND, "%s: says no baseline (blin); give --baseline M", j->o->input);
  return j->eye.fov_rad > 0 || j->o->focal_px > 0
             ? SV_OK
             : sv_fail(err, SV_E_NOT_FOUND, "%s: says no field of view (hfov); give --focal PX", j->o->input);
}

static sv_status make_cameras(job *j, sv_err *err) {
  static const char *const names[2] = {"left", "right"};
  for (int e = 0; e < 2; e++) {
    int size[2];
    sv_import_camera *c = &j->cams[e];
    sv_status s = lab_media_size(&j->clips[e].stream, size, err);
    if (s != SV_OK) return s;
    snprintf(c->name, sizeof c->name, "%s", names[e]);
    c->calib_width_px = size[0];
    c->calib_height_px = size[1];
    c->fx = c->fy = j->o->focal_px > 0 ? j->o->focal_px : 0.5 * size[0] / tan(0.5 * j->eye.fov_rad);
    c->cx = 0.5 * size[0] - 0.5;
    c->cy = 0.5 * size[1] - 0.5;
    c->cam_from_world = sv_pose_identity();
    c->cam_from_world.t[0] = e ? -j->eye.baseline_m : 0;
  }
  return SV_OK;
}

static sv_status decode(job *j, sv_err *err) {
  for (int e = 0; e < 2; e++) {
    j->clips[e].stream =
        (lab_media_stream){j->o->input, j->stream[e], *j->filter[e] ? j->filter[e] : NULL, &j->se->console};
    sv_status s = lab_media_scan(&j->clips[e].stream, &j->clips[e].frames, err);
    if (s != SV_OK) return s;
  }
  j->all = (lab_clips){.clips = j->clips, .n = 2};
  sv_status s = lab_clips_pair(&j->all, j->o->every_s, err);
  if (s == SV_OK) s = make_cameras(j, err);
  return s == SV_OK ? lab_clips_write(&j->job, &j->all, j->cams, err) : s;
}

sv_status lab_import_spatial(const lab_options *o, lab_session *se, sv_err *err) {
  job *j = calloc(1, sizeof *j);
  if (!j) return sv_fail(err, SV_E_NOMEM, "%s: no memory", o->input);
  *j = (job){.o = o, .se = se, .job = {o->input, o->out, se->console}};
  sv_status s = lab_spatial_read(&j->file, o->input, err);
  if (s == SV_OK) s = find_eyes(j, err);
  if (s == SV_OK) s = check_said(j, err);
  if (s == SV_OK) s = sv_import_begin(&j->job, err);
  if (s == SV_OK) s = decode(j, err);
  if (s == SV_OK) {
    lab_say(se, "%s: %d exposures of two eyes, baseline %.4f m, focal length %.2f px", o->out,
            j->all.n_exposures, j->eye.baseline_m, j->cams[0].fx);
    s = sv_import_write(&j->job, "spatial", j->all.fps, j->cams, 2, err);
  } else
    for (int e = 0; e < 2; e++) free(j->cams[e].times_ns);
  lab_clips_free(&j->all);
  free(j);
  return s;
}
