// SPDX-License-Identifier: Apache-2.0
#include "tools/train/poses.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/mathx.h"
#include "src/base/str.h"
#include "tools/import/refine.h"

// The first frame of frame i's exposure.
static int first_of(const lab_views *v, int i) {
  const int e = v->frames[i].f.exposure;
  for (int k = 0; e >= 0 && k < i; k++)
    if (v->frames[k].f.exposure == e) return k;
  return i;
}

// --- before training -----------------------------------------------------------------------------

static sv_status gather(const lab_views *v, lab_import *im, lab_refine_options *how, sv_err *err) {
  for (int i = 0; i < v->n; i++) {
    const sv_transforms_frame *f = &v->frames[i].f;
    lab_import_view *to = lab_import_add(im);
    if (!to) return sv_fail(err, SV_E_NOMEM, "no memory to match %d views", v->n);
    sv_copy(to->source, sizeof to->source, v->frames[i].path);
    sv_copy(to->name, sizeof to->name, f->file_path);
    sv_copy(to->camera, sizeof to->camera, f->camera);
    to->model = f->model;
    to->cam_from_world = f->cam_from_world;
    to->exposure = f->exposure;
    to->sub_view = f->sub_view;
    how->is_rig |= first_of(v, i) != i;
  }
  return SV_OK;
}

sv_status lab_poses_adjust(lab_views *v, lab_session *se, bool *is_right, sv_err *err) {
  lab_import im = {0};
  lab_matches m = {0};
  lab_refined r = {0};
  lab_refine_options how = {0};
  sv_status s = gather(v, &im, &how, err);
  if (s == SV_OK) s = lab_matches_find(&m, &im, se, err);
  if (s == SV_OK) s = lab_import_refine(&im, &m, &how, &r, err);
  for (int i = 0; s == SV_OK && i < v->n; i++) {
    v->frames[i].f.cam_from_world = im.views[i].cam_from_world;
    sv_view_set_pose(&v->frames[i].view, &im.views[i].cam_from_world);
  }
  *is_right = r.is_kept;
  if (s == SV_OK && r.is_kept)
    lab_say(se, "the poses are left as they are: they explain %d observations of %d points to %.2f px",
            r.n_obs, r.n_points, r.rms_before_px);
  else if (s == SV_OK)
    lab_say(se,
            "poses of %d of %d views by bundle adjustment%s: %.2f px before, %.2f px now; moved by %.3f "
            "degrees and %.4f units",
            r.n_placed, v->n, how.is_rig ? ", sub-views of an exposure together" : "", r.rms_before_px,
            r.rms_px, r.moved_deg, r.moved);
  lab_matches_free(&m);
  lab_import_free(&im);
  return s;
}

// --- while training ------------------------------------------------------------------------------

// Of the trainer's rates, for poses that matches have placed: larger ones would first move them
// farther off than they are.
#define RATE_ADJUSTED 0.03f

void lab_poses_plan(const lab_views *v, bool is_adjusted, sv_train_cfg *cfg) {
  cfg->poses = sv_train_poses_defaults();
  if (is_adjusted) {
    cfg->poses.rot_rad *= RATE_ADJUSTED;
    cfg->poses.place *= RATE_ADJUSTED;
  }
  for (int i = 0; i < v->n; i++) cfg->poses.cap_poses += first_of(v, i) == i;
}

void lab_poses_set(const lab_views *v, sv_trainer *t) {
  int n = 0;
  for (int i = 0; i < v->n; i++) {
    const int first = first_of(v, i);
    const sv_pose *rig = &v->frames[first].f.cam_from_world; // the rig's frame is its first view's
    const sv_pose back = sv_pose_inv(rig), mount = sv_pose_mul(&v->frames[i].f.cam_from_world, &back);
    const int pose = first == i ? n++ : t->poses.pose_of[first];
    sv_train_refine_view(t, i, pose, &mount, rig, pose == 0);
  }
}

lab_poses_moved lab_poses_measure(const sv_trainer *t) {
  lab_poses_moved m = {0};
  for (int i = 0; i < t->n_views; i++) {
    const int e = t->poses.pose_of[i];
    double w[3], a[3], b[3];
    if (e < m.n) continue; // counted: poses are numbered in order of their first views
    const sv_train_pose *p = &t->poses.pose[e];
    const sv_pose back = sv_pose_inv(&p->start), d = sv_pose_mul(&p->rig_from_world, &back);
    sv_rodrigues_inv(w, d.r);
    sv_pose_centre(a, &p->rig_from_world);
    sv_pose_centre(b, &p->start);
    sv_sub3(a, a, b);
    m.deg += sv_norm3(w) * 180 / SV_PI;
    m.shift += sv_norm3(a);
    m.n++;
  }
  if (m.n) {
    m.deg /= m.n;
    m.shift /= m.n;
  }
  return m;
}

// --- after training ------------------------------------------------------------------------------

static sv_pose trained_pose(const lab_views *v, const sv_trainer *t, int i) {
  const int e = t->poses.pose_of[i];
  return e < 0 ? v->frames[i].f.cam_from_world
               : sv_pose_mul(&t->poses.cam_from_rig[i], &t->poses.pose[e].rig_from_world);
}

// The text of the transforms file with other matrices. Views are frames of it, in its order.
static sv_status rewrite(FILE *out, const sv_transforms *file, const sv_transforms_frame *frames,
                         const lab_views *v, const sv_trainer *t, sv_err *err) {
  const sv_json *j = &file->json;
  int at = 0, i = 0, object = sv_json_first(j, sv_json_get(j, 0, "frames"));
  for (int k = 0; k < file->n_frames && i < v->n; k++, object = sv_json_next(j, object)) {
    const sv_transforms_frame *f = &v->frames[i].f;
    if (!sv_str_eq(frames[k].file_path, f->file_path) || frames[k].exposure != f->exposure ||
        frames[k].sub_view != f->sub_view || frames[k].time != f->time)
      continue;
    const jsmntok_t *matrix = &j->tok[sv_json_get(j, object, "transform_matrix")];
    const sv_pose pose = trained_pose(v, t, i++);
    fwrite(j->text + at, 1, (size_t)(matrix->start - at), out);
    lab_put_matrix(out, &pose);
    at = matrix->end;
  }
  fwrite(j->text + at, 1, j->bytes - (size_t)at, out);
  return i == v->n ? SV_OK : sv_fail(err, SV_E_FORMAT, "%s: has changed since training began", j->name);
}

sv_status lab_poses_begin(sv_file *f, const lab_views *v, const sv_trainer *t, const char *data,
                          const char *folder, sv_err *err) {
  char path[SV_CAP_PATH], *text = NULL;
  lab_transforms_file file;
  size_t bytes = 0;
  sv_status s = lab_transforms_open(&file, data, v->transforms, err);
  if (s != SV_OK) return s;
  FILE *out = open_memstream(&text, &bytes);
  if (out) s = rewrite(out, &file.t, file.frames, v, t, err);
  if (!out || fclose(out) != 0) s = sv_fail(err, SV_E_NOMEM, "%s: no memory for its text", v->transforms);
  if (s == SV_OK) s = sv_path_join(path, sizeof path, folder, LAB_POSES_NAME, err);
  if (s == SV_OK) s = sv_file_begin(f, path, err);
  if (s == SV_OK) s = sv_file_append(f, text, bytes, err);
  free(text);
  lab_transforms_free(&file);
  return s;
}
