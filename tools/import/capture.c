// SPDX-License-Identifier: Apache-2.0
// A capture folder, or folders of pictures, with a rig -> a dataset: frames of all cameras that
// belong together are one exposure. Odometry finds the poses that a capture does not tell.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "platform/replay/capture.h"
#include "src/base/str.h"
#include "src/capture/odometry.h"
#include "src/format/rig_file.h"
#include "src/rig/sizes.h"
#include "tools/import/import.h"
#include "tools/import/track.h"

#define RIG_SCRATCH_BYTES ((size_t)16 << 20)
#define ARENA_BYTES       ((size_t)1 << 30) // of address space; pages come when they are used

typedef struct {
  sv_capture capture;
  sv_rig rig;
  sv_coverage_names names; // of the rig's pictures
  char rig_dir[SV_CAP_PATH];
  sv_arena arena;
  // [n_exposures] of the first camera's frames
  int n_exposures;
  int *frame;        // [n_exposures][n_cameras] the frame nearest in time; -1: that camera lost it
  sv_pose *pose;     // rig_from_world
  bool *is_placed;   // false: odometry lost the rig
  bool is_unit_lost; // the path's scale is unknown
} source;

static sv_ns mid_exposure_ns(const sv_capture_camera *c, const sv_capture_frame *f) {
  if (c->caps.clock == SV_CLOCK_CAMERA) return f->arrival_ns; // its own clock cannot be compared
  return f->camera_ns + (c->caps.stamp == SV_STAMP_START ? f->exposure_ns / 2
                         : c->caps.stamp == SV_STAMP_END ? -f->exposure_ns / 2
                                                         : 0);
}

// The frame of camera c nearest in time; -1 when it is more than half a period away.
static int nearest(const sv_capture_camera *c, sv_ns t_ns) {
  double half_ns = c->caps.fps > 0 ? 0.5e9 / c->caps.fps : 0.5e9;
  int best = -1;
  for (int i = 0; i < c->n_frames; i++) {
    double d = fabs((double)(mid_exposure_ns(c, &c->frames[i]) - t_ns));
    if (d < half_ns) {
      half_ns = d;
      best = i;
    }
  }
  return best;
}

// A sub-view's frame of an exposure.
typedef struct {
  int i_sub_view, i_frame, i_exposure;
  double time; // 0..1 over the recording
  sv_pose rig_from_world;
} captured;

static sv_status add(lab_import *im, const char *dir, const source *src, const captured *t, sv_err *err) {
  const sv_sub_view *sub = &src->rig.sub_views[t->i_sub_view];
  const sv_capture_camera *c = &src->capture.cameras[sub->i_camera];
  const char *file = c->frames[t->i_frame].file;
  char inside[SV_CAP_PATH];
  lab_import_view *v = lab_import_add(im);
  if (!v) return sv_fail(err, SV_E_NOMEM, "%s: no memory for its frames", dir);
  snprintf(inside, sizeof inside, "%.500s/%.500s", c->folder, file);
  v->model = sub->model;
  v->cam_from_world = sv_pose_mul(&sub->cam_from_rig, &t->rig_from_world);
  v->exposure = t->i_exposure;
  v->sub_view = t->i_sub_view;
  v->time = t->time;
  sv_copy(v->camera, sizeof v->camera, sub->name);
  if (sub->footprint.width_px > 0 &&
      (sub->footprint.width_px != c->caps.width_px || sub->footprint.height_px != c->caps.height_px))
    v->crop = sub->footprint;
  snprintf(v->name, sizeof v->name, "%.31s/%06d%s", sub->name, t->i_exposure,
           v->crop.width_px ? ".png" : sv_path_extension(file));
  if (c->depth && !v->crop.width_px) {
    char depth[SV_CAP_PATH];
    snprintf(depth, sizeof depth, "%.480s/%.*s.pfm", c->depth,
             (int)(strlen(file) - strlen(sv_path_extension(file))), file);
    sv_status found = sv_path_join(v->prior_source, sizeof v->prior_source, dir, depth, err);
    if (found != SV_OK) return found;
    if (!sv_path_exists(v->prior_source)) *v->prior_source = 0; // of a frame without depth
  }
  const char *mask = src->names.mask[t->i_sub_view];
  snprintf(v->mask_name, sizeof v->mask_name, "%.31s%.15s", sub->name, sv_path_extension(mask));
  sv_status s = *mask ? sv_path_join(v->mask_source, sizeof v->mask_source, src->rig_dir, mask, err) : SV_OK;
  return s == SV_OK ? sv_path_join(v->source, sizeof v->source, dir, inside, err) : s;
}

// Which frames are one exposure.
static sv_status pair(source *src, const char *dir, sv_err *err) {
  const int n_cameras = src->capture.n_cameras;
  const sv_capture_camera *c0 = &src->capture.cameras[src->rig.sub_views[0].i_camera];
  src->n_exposures = c0->n_frames;
  src->frame = SV_TAKE(&src->arena, int, (size_t)c0->n_frames *(size_t)n_cameras);
  src->pose = SV_TAKE(&src->arena, sv_pose, c0->n_frames);
  src->is_placed = SV_TAKE(&src->arena, bool, c0->n_frames);
  if (src->arena.status < 0)
    return sv_fail(err, src->arena.status, "%s: no memory for its %d exposures", dir, c0->n_frames);
  for (int e = 0; e < c0->n_frames; e++)
    for (int c = 0; c < n_cameras; c++)
      src->frame[e * n_cameras + c] = nearest(&src->capture.cameras[c], mid_exposure_ns(c0, &c0->frames[e]));
  return SV_OK;
}

// The capture's poses, else those of odometry. A single camera is taken as standing still.
static sv_status find_poses(source *src, const char *dir, lab_session *se, sv_err *err) {
  const sv_capture_camera *c0 = &src->capture.cameras[src->rig.sub_views[0].i_camera];
  if (!src->capture.n_poses && src->rig.n_sub_views > 1 && sv_odometry_can(&src->rig, src->n_exposures)) {
    const lab_track_job job = {dir, &src->capture, &src->rig, src->n_exposures, src->frame};
    lab_tracked found;
    sv_status s = lab_track(&job, se, src->pose, src->is_placed, &found, err);
    if (s != SV_OK) return s;
    if (found.scale_sigma > 0) src->capture.scale_sigma = found.scale_sigma;
    src->is_unit_lost = found.scale_sigma < 0;
    return SV_OK;
  }
  for (int e = 0; e < src->n_exposures; e++) {
    sv_status s = sv_capture_pose_at(&src->capture, c0->frames[e].arrival_ns, &src->pose[e]);
    if (s == SV_E_NOT_FOUND) src->pose[e] = sv_pose_identity();
    else if (s < 0) return sv_fail(err, s, "%s: its poses cannot be used", dir);
    src->is_placed[e] = true;
  }
  return SV_OK;
}

static sv_status add_exposures(lab_import *im, const char *dir, const source *src, sv_err *err) {
  const sv_capture_camera *c0 = &src->capture.cameras[src->rig.sub_views[0].i_camera];
  sv_ns first_ns = 0, last_ns = 0;
  for (int e = 0; e < c0->n_frames; e++) {
    last_ns = mid_exposure_ns(c0, &c0->frames[e]);
    if (e == 0) first_ns = last_ns;
  }
  for (int e = 0; e < src->n_exposures; e++) {
    sv_ns t_ns = mid_exposure_ns(c0, &c0->frames[e]);
    double time = last_ns > first_ns ? (double)(t_ns - first_ns) / (double)(last_ns - first_ns) : 0;
    captured t = {.i_exposure = e, .time = fmin(fmax(time, 0), 1), .rig_from_world = src->pose[e]};
    if (!src->is_placed[e]) continue;
    for (int k = 0; k < src->rig.n_sub_views; k++) {
      t.i_sub_view = k;
      t.i_frame = src->frame[e * src->capture.n_cameras + src->rig.sub_views[k].i_camera];
      if (t.i_frame < 0) continue; // that camera lost the frame
      sv_status s = add(im, dir, src, &t, err);
      if (s != SV_OK) return s;
    }
  }
  return SV_OK;
}

// --- the rig -------------------------------------------------------------------------------------

// Folders of pictures are cameras by their names, in whatever order the rig has them. Several
// sub-views of one camera have names of their own.
static sv_status match_names(source *src, const char *dir, sv_err *err) {
  const sv_capture *c = &src->capture;
  char names[80] = "";
  sv_str list = sv_str_make(names, sizeof names);
  if (src->rig.n_sub_views != c->n_cameras) return SV_OK;
  for (int i = 0; i < c->n_cameras; i++) sv_str_add(&list, "%s%s", i ? ", " : "", c->cameras[i].caps.name);
  for (int k = 0; k < src->rig.n_sub_views; k++) {
    sv_sub_view *v = &src->rig.sub_views[k];
    int i = 0;
    while (i < c->n_cameras && !sv_str_eq(c->cameras[i].caps.name, v->name)) i++;
    if (i == c->n_cameras)
      return sv_fail(err, SV_E_NOT_FOUND,
                     "%.80s: its folders are %s; expected one named %s, as a camera of the rig", dir, names,
                     v->name);
    v->i_camera = i;
  }
  return SV_OK;
}

// Lenses of the size of the pictures.
static sv_status fit_sizes(source *src, sv_err *err) {
  sv_status s = SV_OK;
  for (int k = 0; k < src->rig.n_sub_views && s == SV_OK; k++) {
    sv_sub_view *v = &src->rig.sub_views[k];
    const sv_camera_caps *c = &src->capture.cameras[v->i_camera].caps;
    sv_size_fit how;
    sv_image_map map;
    s = sv_sub_view_fit(v, &(sv_image_mode){c->width_px, c->height_px, c->area}, &how, &map, err);
  }
  return s;
}

static sv_status load(source *src, const char *dir, const char *rig, sv_err *err) {
  char *rig_dir = src->rig_dir, json[SV_CAP_PATH];
  sv_status s = sv_capture_load(&src->capture, dir, &src->arena, err);
  if (s == SV_OK) s = sv_path_join(json, sizeof json, dir, "capture.json", err);
  if (s != SV_OK) return s;
  const bool is_pictures = !sv_path_exists(json);
  if (!rig && !*src->capture.rig)
    return is_pictures
               ? sv_fail(err, SV_E_NOT_FOUND,
                         "%.80s: pictures of %d cameras need --rig RIG, their rig ('subview-calibrate "
                         "board' makes one)",
                         dir, src->capture.n_cameras)
               : sv_fail(err, SV_E_NOT_FOUND,
                         "%s/capture.json: names no rig; 'subview-lab train --data %s --rig RIG' takes one",
                         dir, dir);
  s = rig ? sv_path_join(rig_dir, sizeof src->rig_dir, rig, "", err)
          : sv_path_join(rig_dir, sizeof src->rig_dir, dir, src->capture.rig, err);
  if (s == SV_OK && sv_rig_init(&src->rig, SV_CAP_SUB_VIEWS, &src->arena) != SV_OK)
    s = sv_fail(err, SV_E_NOMEM, "%s: no memory for its rig", dir);
  sv_arena scratch = sv_arena_sub(&src->arena, RIG_SCRATCH_BYTES);
  sv_file_reader files = {rig_dir, sv_folder_read};
  if (s == SV_OK)
    s = sv_rig_read_coverage(&src->rig, &src->names, &files, src->capture.n_cameras, &scratch, err);
  if (s == SV_OK && src->rig.forward == SV_FORWARD_MULTIPLEXED)
    s = sv_fail(err, SV_E_UNSUPPORTED, "%s: sub-views of a multiplexed sensor overlap and cannot be cropped",
                rig_dir);
  if (s == SV_OK && is_pictures) s = match_names(src, dir, err);
  return s == SV_OK ? fit_sizes(src, err) : s;
}

sv_status lab_import_capture(lab_import *im, const char *dir, const char *rig, lab_session *se, sv_err *err) {
  source *src = calloc(1, sizeof *src);
  void *block = malloc(ARENA_BYTES);
  sv_status s = src && block ? SV_OK : sv_fail(err, SV_E_NOMEM, "%s: no memory to read the capture", dir);
  if (s == SV_OK) {
    src->arena = sv_arena_make(block, ARENA_BYTES);
    s = load(src, dir, rig, err);
  }
  if (s == SV_OK) s = pair(src, dir, err);
  if (s == SV_OK) s = find_poses(src, dir, se, err);
  if (s == SV_OK) s = add_exposures(im, dir, src, err);
  if (s == SV_OK && src->rig.n_sub_views > 1 && !src->is_unit_lost)
    im->unit = (sv_unit){.is_metric = true,
                         .scale_sigma = (float)hypot(src->rig.scale_sigma, src->capture.scale_sigma)};
  im->is_rig_known = s == SV_OK && src->rig.n_sub_views > 1;
  free(block);
  free(src);
  return s;
}
