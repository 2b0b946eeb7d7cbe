// SPDX-License-Identifier: Apache-2.0
// Moving scenes of the authors' release. Frames whose number is a multiple of eight are held out,
// of all cameras; the score is that of the reference stream.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/str.h"
#include "tools/import/release.h"

#define HELD_OUT_EVERY 8

static const struct {
  const char *name, *device, *mono;
} captures[] = {{"iphone", "phone", "wide"}, {"stereo", "stereo", "right"}};

static int compare_frames(const void *a, const void *b) {
  const lab_import_view *x = a, *y = b;
  return x->exposure != y->exposure ? (x->exposure > y->exposure) - (x->exposure < y->exposure)
                                    : strcmp(x->name, y->name);
}

// CAMERA/frame_00012.png: the camera, and the frame's number from 1.
static sv_status take_name(lab_import_view *v, sv_err *err) {
  char folder[SV_TRANSFORMS_CAP_PATH];
  const char *digits = sv_path_name(v->name);
  sv_path_folder(folder, sizeof folder, v->name);
  digits += strcspn(digits, "0123456789");
  if (!*folder || sscanf(digits, "%d", &v->exposure) != 1 || v->exposure < 1)
    return sv_fail(err, SV_E_FORMAT, "%.150s: a frame CAMERA/frame_NUMBER.png was expected", v->name);
  sv_copy(v->camera, sizeof v->camera, sv_path_name(folder));
  return SV_OK;
}

// The picture lies beside the model, in the folder of its camera.
static sv_status find_picture(lab_import_view *v, const char *dir, sv_err *err) {
  static const char *const places[] = {"", "images/", "frames/"};
  char name[SV_TRANSFORMS_CAP_PATH + 8];
  for (size_t i = 0; i < sizeof places / sizeof *places; i++) {
    snprintf(name, sizeof name, "%s%s", places[i], v->name);
    if (sv_path_join(v->source, sizeof v->source, dir, name, NULL) == SV_OK && sv_path_exists(v->source))
      return SV_OK;
  }
  return sv_fail(err, SV_E_NOT_FOUND, "%s/%s: image not found (listed in the COLMAP model)", dir, v->name);
}

static bool has_view(const lab_import *im, const char *name) {
  for (int i = 0; i < im->n; i++)
    if (sv_str_eq(im->views[i].name, name)) return true;
  return false;
}

// sparse_train and sparse_test together, each frame once.
static sv_status read_models(lab_import *all, const char *dir, sv_err *err) {
  static const char *const models[] = {"sparse_train", "sparse_test"};
  sv_status s = SV_OK;
  for (int i = 0; i < 2 && s == SV_OK; i++) {
    char path[SV_CAP_PATH], images[SV_CAP_PATH];
    lab_import part = {0};
    s = sv_path_join(path, sizeof path, dir, models[i], err);
    if (s != SV_OK || !lab_import_colmap_model(path, images)) continue;
    s = lab_import_colmap(i ? &part : all, path, err);
    for (int k = 0; k < part.n && s == SV_OK; k++)
      if (!has_view(all, part.views[k].name)) s = lab_release_copy(all, &part.views[k], err);
    lab_import_free(&part);
  }
  for (int i = 0; i < all->n && s == SV_OK; i++) {
    s = take_name(&all->views[i], err);
    if (s == SV_OK) s = find_picture(&all->views[i], dir, err);
  }
  if (s == SV_OK && all->n > 1) qsort(all->views, (size_t)all->n, sizeof *all->views, compare_frames);
  return s;
}

// Points of the depth images go before those of the model.
static sv_status read_points(lab_import *all, const char *dir, sv_err *err) {
  char path[SV_CAP_PATH];
  float centre[3], radius;
  sv_point *points;
  int n;
  sv_status s = sv_path_join(path, sizeof path, dir, "points3D_multipleview.ply", err);
  if (s != SV_OK || !sv_path_exists(path)) return s;
  s = lab_points_read(path, &points, &n, centre, &radius, err);
  if (s != SV_OK) return s;
  free(all->points);
  all->points = points;
  all->n_points = all->cap_points = n;
  return SV_OK;
}

static void set_times(lab_import *im) {
  const int first = im->views[0].exposure, last = im->views[im->n - 1].exposure;
  for (int i = 0; i < im->n; i++) {
    lab_import_view *v = &im->views[i];
    v->sub_view = 0;
    for (int k = 0; k < im->n; k++) { // by the order of the cameras' names
      bool is_new = strcmp(im->views[k].camera, v->camera) < 0;
      for (int m = 0; m < k && is_new; m++) is_new = !sv_str_eq(im->views[m].camera, im->views[k].camera);
      v->sub_view += is_new;
    }
    v->time = last > first ? (double)(v->exposure - first) / (last - first) : 0;
    sv_copy(v->split, sizeof v->split, v->exposure % HELD_OUT_EVERY == 0 ? "test_time" : "train");
  }
}

static sv_status dynamic_capture(lab_release *r, const char *dir, const char *scene, int i_capture,
                                 sv_err *err) {
  char folder[SV_CAP_PATH], name[60];
  lab_import all = {0}, mono = {0};
  int n_held = 0;
  snprintf(name, sizeof name, "transforms_train_%s.json", captures[i_capture].device);
  sv_status s = read_models(&all, dir, err);
  if (s == SV_OK) s = read_points(&all, dir, err);
  if (s == SV_OK && all.n) set_times(&all);
  for (int i = 0; i < all.n && s == SV_OK; i++)
    if (lab_release_has_word(all.views[i].camera, captures[i_capture].mono))
      s = lab_release_copy(&mono, &all.views[i], err);
  for (int i = 0; i < mono.n; i++) n_held += sv_str_eq(mono.views[i].split, "test_time");
  if (s == SV_OK && !n_held)
    s = sv_fail(err, SV_E_FORMAT, "%.150s: no camera '%s' with a frame 8, 16, ... to score", dir,
                captures[i_capture].mono);
  if (s == SV_OK)
    s = lab_release_folder(r, folder, (const char *const[]){"dynamic", scene, captures[i_capture].name}, err);
  // one point cloud for both
  mono.points = all.points;
  mono.n_points = all.n_points;
  if (s == SV_OK) s = lab_import_write_as(&mono, r->se, folder, "transforms_train_mono.json", err);
  mono.points = NULL;
  if (s == SV_OK) s = lab_import_write_as(&all, r->se, folder, name, err);
  if (s == SV_OK)
    lab_release_made(r, folder, "%d frames, %d of one camera, of which %d are held out", all.n, mono.n,
                     n_held);
  lab_import_free(&mono);
  lab_import_free(&all);
  return s;
}

static sv_status dynamic_scene(lab_release *r, const char *folder, const char *scene, sv_err *err) {
  char dir[SV_CAP_PATH], path[SV_CAP_PATH], images[SV_CAP_PATH];
  sv_status s = SV_OK;
  for (int i = 0; i < 2 && s == SV_OK; i++) {
    s = sv_path_join(dir, sizeof dir, folder, captures[i].name, err);
    if (s == SV_OK) s = sv_path_join(path, sizeof path, dir, "sparse_train", err);
    if (s != SV_OK || !sv_path_is_folder(dir)) continue;
    if (lab_import_colmap_model(path, images)) s = dynamic_capture(r, dir, scene, i, err);
    else r->n_without_poses++;
  }
  return s;
}

sv_status lab_release_dynamic(lab_release *r, sv_err *err) {
  return lab_release_scenes(r, "dynamic", dynamic_scene, err);
}
