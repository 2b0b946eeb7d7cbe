// SPDX-License-Identifier: Apache-2.0
// A capture folder with its rig -> a dataset: frames of all cameras that belong together are one
// exposure.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "platform/replay/capture.h"
#include "src/base/str.h"
#include "src/format/rig_file.h"
#include "tools/import/import.h"

#define RIG_SCRATCH_BYTES ((size_t)16 << 20)
#define ARENA_BYTES       ((size_t)1 << 30) // of address space; pages come when they are used

typedef struct {
  sv_capture capture;
  sv_rig rig;
  sv_coverage_names names; // of the rig's pictures
  char rig_dir[SV_CAP_PATH];
  sv_arena arena;
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

static sv_status add_exposures(lab_import *im, const char *dir, const source *src, sv_err *err) {
  const sv_capture_camera *c0 = &src->capture.cameras[src->rig.sub_views[0].i_camera];
  sv_ns first_ns = 0, last_ns = 0;
  for (int e = 0; e < c0->n_frames; e++) {
    last_ns = mid_exposure_ns(c0, &c0->frames[e]);
    if (e == 0) first_ns = last_ns;
  }
  for (int e = 0; e < c0->n_frames; e++) {
    sv_ns t_ns = mid_exposure_ns(c0, &c0->frames[e]);
    double time = last_ns > first_ns ? (double)(t_ns - first_ns) / (double)(last_ns - first_ns) : 0;
    captured t = {.i_exposure = e, .time = time < 0 ? 0 : time > 1 ? 1 : time};
    sv_status s = sv_capture_pose_at(&src->capture, c0->frames[e].arrival_ns, &t.rig_from_world);
    if (s == SV_E_NOT_FOUND) t.rig_from_world = sv_pose_identity(); // the rig stood still
    else if (s < 0) return sv_fail(err, s, "%s: its poses cannot be used", dir);
    for (int k = 0; k < src->rig.n_sub_views; k++) {
      t.i_sub_view = k;
      t.i_frame = nearest(&src->capture.cameras[src->rig.sub_views[k].i_camera], t_ns);
      if (t.i_frame < 0) continue; // that camera lost the frame
      if ((s = add(im, dir, src, &t, err)) != SV_OK) return s;
    }
  }
  return SV_OK;
}

static sv_status load(source *src, const char *dir, sv_err *err) {
  char *rig_dir = src->rig_dir;
  sv_status s = sv_capture_load(&src->capture, dir, &src->arena, err);
  if (s != SV_OK) return s;
  if (!*src->capture.rig)
    return sv_fail(err, SV_E_NOT_FOUND, "%s/capture.json: names no rig, so its camera poses are unknown",
                   dir);
  s = sv_path_join(rig_dir, sizeof src->rig_dir, dir, src->capture.rig, err);
  if (s == SV_OK && sv_rig_init(&src->rig, SV_CAP_SUB_VIEWS, &src->arena) != SV_OK)
    s = sv_fail(err, SV_E_NOMEM, "%s: no memory for its rig", dir);
  sv_arena scratch = sv_arena_sub(&src->arena, RIG_SCRATCH_BYTES);
  sv_file_reader files = {rig_dir, sv_folder_read};
  if (s == SV_OK)
    s = sv_rig_read_coverage(&src->rig, &src->names, &files, src->capture.n_cameras, &scratch, err);
  if (s == SV_OK && src->rig.forward == SV_FORWARD_MULTIPLEXED)
    s = sv_fail(err, SV_E_UNSUPPORTED, "%s: sub-views of a multiplexed sensor overlap and cannot be cropped",
                rig_dir);
  return s;
}

sv_status lab_import_capture(lab_import *im, const char *dir, sv_err *err) {
  source *src = calloc(1, sizeof *src);
  void *block = malloc(ARENA_BYTES);
  sv_status s = src && block ? SV_OK : sv_fail(err, SV_E_NOMEM, "%s: no memory to read the capture", dir);
  if (s == SV_OK) {
    src->arena = sv_arena_make(block, ARENA_BYTES);
    s = load(src, dir, err);
  }
  if (s == SV_OK) s = add_exposures(im, dir, src, err);
  if (s == SV_OK && src->rig.n_sub_views > 1)
    im->unit = (sv_unit){.is_metric = true,
                         .scale_sigma = (float)hypot(src->rig.scale_sigma, src->capture.scale_sigma)};
  im->is_rig_known = s == SV_OK && src->rig.n_sub_views > 1;
  free(block);
  free(src);
  return s;
}
