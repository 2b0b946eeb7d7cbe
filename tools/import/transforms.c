// SPDX-License-Identifier: Apache-2.0
// Transforms JSON: one file a split (blender), or one for all (nerfstudio).
#include <stdio.h>
#include <string.h>

#include "src/base/str.h"
#include "tools/import/import.h"

static sv_status add_views(lab_import *im, const lab_views *v, const char *mark, sv_err *err) {
  for (int i = 0; i < v->n; i++) {
    const sv_transforms_frame *f = &v->frames[i].f;
    lab_import_view *o = lab_import_add(im);
    if (!o) return sv_fail(err, SV_E_NOMEM, "no memory for %d views", im->n + 1);
    o->model = f->model;
    o->cam_from_world = f->cam_from_world;
    o->depth_kind = f->depth_kind;
    o->depth_unit = f->depth_unit;
    o->time = f->time;
    o->exposure = f->exposure;
    o->sub_view = f->sub_view;
    sv_copy(o->camera, sizeof o->camera, f->camera);
    sv_copy(o->split, sizeof o->split, *f->split ? f->split : mark);
    sv_copy(o->source, sizeof o->source, v->frames[i].path);
    sv_copy(o->depth_source, sizeof o->depth_source, v->frames[i].depth_path);
    // Folders stay as they are; names that would leave the dataset lose theirs.
    bool is_inside = f->file_path[0] != '/' && !strstr(f->file_path, "..");
    snprintf(o->name, sizeof o->name, "%.180s%.15s", is_inside ? f->file_path : sv_path_name(f->file_path),
             f->has_extension ? "" : sv_path_extension(o->source));
    if (strncmp(o->name, "images/", 7) == 0) memmove(o->name, o->name + 7, strlen(o->name) - 6);
    sv_copy(o->mask_source, sizeof o->mask_source, v->frames[i].mask_path);
    snprintf(o->mask_name, sizeof o->mask_name, "%.*s%.15s",
             (int)(strlen(o->name) - strlen(sv_path_extension(o->name))), o->name,
             sv_path_extension(o->mask_source));
  }
  return SV_OK;
}

static sv_status add_points(lab_import *im, const char *path, sv_err *err) {
  float centre[3], radius;
  if (im->points || !*path || !sv_path_exists(path)) return SV_OK;
  sv_status s = lab_points_read(path, &im->points, &im->n_points, centre, &radius, err);
  im->cap_points = im->n_points;
  return s;
}

sv_status lab_import_transforms_file(lab_import *im, const char *dir, const char *name, const char *mark,
                                     sv_err *err) {
  lab_views v;
  sv_pool serial = sv_pool_serial();
  lab_source src = {.folder = dir, .transforms = name, .split = "all", .scale = 1};
  sv_status s = lab_views_open(&v, &src, &serial, err);
  if (s == SV_OK) s = add_views(im, &v, mark, err);
  if (s == SV_OK) s = add_points(im, v.points, err);
  if (s == SV_OK) im->unit = v.unit;
  lab_views_free(&v);
  return s;
}

// The same, unless the file is not there.
static sv_status add_file(lab_import *im, const char *dir, const char *name, const char *mark, bool *is_found,
                          sv_err *err) {
  char path[SV_CAP_PATH];
  sv_status s = sv_path_join(path, sizeof path, dir, name, err);
  if (s != SV_OK || !sv_path_exists(path)) return s;
  *is_found = true;
  return lab_import_transforms_file(im, dir, name, mark, err);
}

sv_status lab_import_transforms(lab_import *im, const char *dir, sv_err *err) {
  static const struct {
    const char *name, *mark;
  } others[] = {{"transforms_val.json", "val"}, {"transforms_test_near.json", "test_near"}};
  // without training views there is no dataset
  bool is_found = false, is_test = false, is_any = false;
  sv_status s = add_file(im, dir, "transforms_train.json", "train", &is_found, err);
  const bool is_split = is_found;
  if (s == SV_OK && !is_found) s = add_file(im, dir, "transforms.json", "", &is_found, err);
  if (s == SV_OK && !is_found)
    return sv_fail(err, SV_E_NOT_FOUND, "%s: has neither transforms_train.json nor transforms.json", dir);
  if (s == SV_OK) s = add_file(im, dir, "transforms_test.json", "test", &is_test, err);
  // Beside transforms.json alone other marks would take the place of every 8th view, which is held
  // out then.
  for (size_t i = 0; i < sizeof others / sizeof *others && s == SV_OK && (is_split || is_test); i++)
    s = add_file(im, dir, others[i].name, others[i].mark, &is_any, err);
  return s;
}
