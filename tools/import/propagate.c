// SPDX-License-Identifier: Apache-2.0
// Poses that are known for one camera of a rig -> views of all its sub-views, by the rig's fixed
// relative poses:
//   rig_from_world = inverse(stream_from_rig) stream_from_world
//   sub_from_world = sub_from_rig rig_from_world
// An image of another sub-view has the stream's path with the sub-view's name in the place of the
// stream's: images/left/0007.png and images/right/0007.png, or left_0007.png and right_0007.png.
#include <ctype.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/str.h"
#include "src/format/rig_file.h"
#include "tools/import/import.h"

#define SCRATCH_BYTES ((size_t)16 << 20)
#define ARENA_BYTES   ((size_t)256 << 20) // of address space; pages come when they are used

typedef struct {
  const char *folder, *stream;
  int i_stream;
  double unit_m;
  sv_rig rig;
  sv_arena arena;
  char first[SV_CAP_PATH]; // image that was missed first
} job;

static sv_status load_rig(job *j, sv_err *err) {
  sv_file_reader files = {(void *)(uintptr_t)j->folder, sv_folder_read};
  if (sv_rig_init(&j->rig, SV_CAP_SUB_VIEWS, &j->arena) != SV_OK)
    return sv_fail(err, SV_E_NOMEM, "%s: no memory for the rig", j->folder);
  sv_arena scratch = sv_arena_sub(&j->arena, SCRATCH_BYTES);
  sv_status s = sv_rig_read(&j->rig, &files, -1, &scratch, err);
  if (s != SV_OK) return s;
  if (j->rig.forward == SV_FORWARD_MULTIPLEXED)
    return sv_fail(err, SV_E_UNSUPPORTED, "%s: sub-views of a multiplexed sensor have no images of their own",
                   j->folder);
  for (j->i_stream = 0; j->i_stream < j->rig.n_sub_views; j->i_stream++)
    if (sv_str_eq(j->rig.sub_views[j->i_stream].name, j->stream)) return SV_OK;
  return sv_fail(err, SV_E_NOT_FOUND, "%s: the rig has no sub-view %.31s; its first of %d is %s", j->folder,
                 j->stream, j->rig.n_sub_views, j->rig.sub_views[0].name);
}

// Where `word` stands last in a path as a word of its own: not inside of others like "left" in
// "leftover".
static const char *find_word(const char *path, const char *word) {
  const char *last = NULL;
  size_t n = strlen(word);
  for (const char *p = strstr(path, word); p; p = strstr(p + 1, word))
    if ((p == path || !isalnum((unsigned char)p[-1])) && !isalnum((unsigned char)p[n])) last = p;
  return last;
}

// The path with the stream's name replaced. False when it does not stand there, or the result does
// not fit.
static bool rename_path(const job *j, const char *path, const char *name, char *out, size_t cap) {
  const char *p = find_word(path, j->stream);
  return p && snprintf(out, cap, "%.*s%s%s", (int)(p - path), path, name, p + strlen(j->stream)) < (int)cap;
}

// The stream's name is looked for in the part of the path that is inside the dataset, not in
// folders above it.
static bool rename_source(const job *j, const lab_import_view *v, const char *name, lab_import_view *out) {
  size_t n = strlen(v->source), tail = strlen(v->name);
  if (!rename_path(j, v->name, name, out->name, sizeof out->name)) return false;
  if (tail > n || strcmp(v->source + n - tail, v->name) != 0) return false;
  return snprintf(out->source, sizeof out->source, "%.*s%s", (int)(n - tail), v->source, out->name) <
         (int)sizeof out->source;
}

static sv_status check_size(const lab_import_view *v, sv_err *err) {
  lab_peek p;
  sv_status s = lab_picture_peek(v->source, &p, err);
  if (s == SV_OK && (p.width_px != v->model.width_px || p.height_px != v->model.height_px))
    s = sv_fail(err, SV_E_FORMAT, "%s: an image of %dx%d, the rig's sub-view %s has %dx%d", v->source,
                p.width_px, p.height_px, v->camera, v->model.width_px, v->model.height_px);
  return s;
}

// Sub-view k of the exposure that v is the stream's view of; SV_END when it has no picture.
static sv_status make_view(job *j, const lab_import_view *v, int k, lab_import_view *out, sv_err *err) {
  const sv_sub_view *sub = &j->rig.sub_views[k];
  sv_pose rig_from_stream = sv_pose_inv(&j->rig.sub_views[j->i_stream].cam_from_rig);
  sv_pose rig_from_world = sv_pose_mul(&rig_from_stream, &v->cam_from_world);
  *out = *v;
  out->sub_view = k;
  sv_copy(out->camera, sizeof out->camera, sub->name);
  if (k == j->i_stream) return SV_OK; // pose and lens as they were given
  out->cam_from_world = sv_pose_mul(&sub->cam_from_rig, &rig_from_world);
  out->model = sub->model;
  if (!rename_source(j, v, sub->name, out))
    return sv_fail(err, SV_E_RANGE, "%s: the path of sub-view %s is too long", v->source, sub->name);
  *out->mask_source = 0; // of the stream's view, no other's
  if (*v->depth_source &&
      (!rename_path(j, v->depth_source, sub->name, out->depth_source, sizeof out->depth_source) ||
       !sv_path_exists(out->depth_source))) {
    *out->depth_source = 0;
    out->depth_kind = SV_DEPTH_NONE;
  }
  if (!sv_path_exists(out->source)) {
    if (!*j->first) sv_copy(j->first, sizeof j->first, out->source);
    return SV_END;
  }
  return check_size(out, err);
}

static sv_status add_exposure(job *j, const lab_import_view *v, lab_import *to, sv_err *err) {
  lab_import_view *out = malloc(sizeof *out);
  sv_status s = out ? SV_OK : sv_fail(err, SV_E_NOMEM, "no memory for %d views", to->n + 1);
  for (int k = 0; s == SV_OK && k < j->rig.n_sub_views; k++) {
    s = make_view(j, v, k, out, err);
    if (s == SV_END) {
      to->n_lost++;
      s = SV_OK;
      continue;
    }
    lab_import_view *view = s == SV_OK ? lab_import_add(to) : NULL;
    if (s == SV_OK && !view) s = sv_fail(err, SV_E_NOMEM, "no memory for %d views", to->n + 1);
    if (s != SV_OK) break;
    *view = *out;
    to->n_from_rig += k != j->i_stream;
  }
  free(out);
  return s;
}

static sv_status propagate(job *j, const lab_import *im, lab_import *to, sv_err *err) {
  int n_exposures = 0, last = -1; // last: the highest number that is taken
  for (int i = 0; i < im->n; i++)
    if (im->views[i].exposure > last) last = im->views[i].exposure;
  for (int i = 0; i < im->n; i++) {
    lab_import_view v = im->views[i];
    lab_import_view probe;
    // of another camera: placed by the stream
    if (!rename_source(j, &v, j->stream, &probe)) continue;
    for (int k = 0; k < 3; k++) v.cam_from_world.t[k] *= j->unit_m;
    v.depth_unit = (v.depth_unit > 0 ? v.depth_unit : LAB_DEPTH_UNIT) * j->unit_m;
    if (v.exposure < 0) v.exposure = ++last;
    n_exposures++;
    sv_status s = add_exposure(j, &v, to, err);
    if (s != SV_OK) return s;
  }
  if (!n_exposures)
    return sv_fail(err, SV_E_NOT_FOUND,
                   "no image of the stream: expected a path that contains %s, as in %s/0000.png, not %.80s",
                   j->stream, j->stream, im->n ? im->views[0].name : "");
  if (!to->n_from_rig && j->rig.n_sub_views > 1)
    return sv_fail(err, SV_E_NOT_FOUND, "%s: not found, nor any other image of the rig's other sub-views",
                   j->first);
  return SV_OK;
}

sv_status lab_import_propagate(lab_import *im, const char *rig_folder, const char *stream, double unit_m,
                               sv_err *err) {
  lab_import to = {0};
  job *j = calloc(1, sizeof *j);
  void *block = malloc(ARENA_BYTES);
  sv_status s = j && block ? SV_OK : sv_fail(err, SV_E_NOMEM, "%s: no memory to read the rig", rig_folder);
  if (s == SV_OK) {
    *j = (job){.folder = rig_folder, .stream = stream, .unit_m = unit_m};
    j->arena = sv_arena_make(block, ARENA_BYTES);
    s = load_rig(j, err);
  }
  if (s == SV_OK) s = propagate(j, im, &to, err);
  if (s == SV_OK) {
    for (int i = 0; i < im->n_points; i++)
      for (int k = 0; k < 3; k++) im->points[i].mean[k] *= (float)unit_m;
    free(im->views);
    im->views = to.views;
    im->n = to.n;
    im->cap = to.cap;
    im->n_from_rig = to.n_from_rig;
    im->n_lost = to.n_lost;
  } else {
    lab_import_free(&to);
  }
  free(block);
  free(j);
  return s;
}
