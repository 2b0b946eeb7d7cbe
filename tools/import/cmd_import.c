// SPDX-License-Identifier: Apache-2.0
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/str.h"
#include "src/format/ply.h"
#include "tools/import/recording.h"
#include "tools/import/import.h"

// --- transforms JSON: one file a split (blender), or one for all (nerfstudio) --------------------

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

// All frames of one file, unless it is not there.
static sv_status add_file(lab_import *im, const char *dir, const char *name, const char *mark, bool *is_found,
                          sv_err *err) {
  char path[SV_CAP_PATH];
  lab_views v;
  sv_pool serial = sv_pool_serial();
  sv_status s = sv_path_join(path, sizeof path, dir, name, err);
  if (s != SV_OK || !sv_path_exists(path)) return s;
  lab_source src = {.folder = dir, .transforms = name, .split = "all", .scale = 1};
  s = lab_views_open(&v, &src, &serial, err);
  if (s == SV_OK) s = add_views(im, &v, mark, err);
  if (s == SV_OK) s = add_points(im, v.points, err);
  if (s == SV_OK) im->is_metric = v.is_metric;
  lab_views_free(&v);
  *is_found = true;
  return s;
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

// --- dispatch ------------------------------------------------------------------------------------

static sv_status import(const lab_options *o, lab_session *se, sv_err *err) {
  if (sv_str_eq(o->from, "sim")) {
    sv_status s = lab_import_sim(o->input, se, o->out, err);
    if (s == SV_OK)
      lab_say(se, "%s: simulated images of %s, with held-out views and depth", o->out,
              strstr(o->input, ",rig=") ? "one rig" : "several devices");
    return s;
  }
  if (sv_str_eq(o->from, "kalibr")) {
    int n = 0;
    sv_status s = lab_import_kalibr(o->input, o->out, &n, err);
    if (s == SV_OK) lab_say(se, "%s: a rig of %d cameras; 'subview run --rig' reads it", o->out, n);
    return s;
  }
  if (!sv_path_is_folder(o->input)) return sv_fail(err, SV_E_NOT_FOUND, "%s: no such folder", o->input);
  if (sv_str_eq(o->from, "4cam-board") || sv_str_eq(o->from, "qca")) {
    sv_import_job job = {o->input, o->out, se->console};
    sv_status s = sv_str_eq(o->from, "qca") ? sv_import_qca(&job, err) : sv_import_4cam_board(&job, err);
    if (s == SV_OK)
      lab_say(se,
              "%s: a capture folder with its rig; 'subview-lab import --from capture' or a replay reads it",
              o->out);
    return s;
  }
  lab_import im = {0};
  sv_status s = sv_str_eq(o->from, "colmap")    ? lab_import_colmap(&im, o->input, err)
                : sv_str_eq(o->from, "lenslet") ? lab_import_lenslet(&im, o, se, err)
                : sv_str_eq(o->from, "capture") ? lab_import_capture(&im, o->input, err)
                                                : lab_import_transforms(&im, o->input, err);
  if (s == SV_OK && im.n == 0) s = sv_fail(err, SV_E_NOT_FOUND, "%s: contains no views", o->input);
  double unit_m = o->unit_m > 0 ? o->unit_m : 1;
  if (s == SV_OK && o->rig) s = lab_import_propagate(&im, o->rig, o->stream, unit_m, err);
  if (s == SV_OK && o->rig)
    lab_say(se, "assuming that one unit of %s's poses is %.6g m (override with --unit)", o->stream, unit_m);
  if (s == SV_OK) s = lab_import_write(&im, se, o->out, err);
  if (s == SV_OK) lab_say(se, "%s: %d views, %d points", o->out, im.n, im.n_points);
  if (s == SV_OK && im.n_from_rig) lab_say(se, "%d views take their pose from the rig", im.n_from_rig);
  if (s == SV_OK && im.n_lost) lab_say(se, "%d images of the rig were not found", im.n_lost);
  lab_import_free(&im);
  return s;
}

int lab_cmd_import(const lab_options *o) {
  sv_err err = {0};
  lab_session se;
  int code = LAB_EXIT_OK;
  bool has_stream =
      sv_str_eq(o->from, "colmap") || sv_str_eq(o->from, "nerfstudio") || sv_str_eq(o->from, "blender");
  if (!o->rig != !o->stream || (o->unit_m > 0 && !o->rig))
    return lab_usage("import", "--rig and --stream must be given together; --unit needs both");
  if (o->rig && !has_stream)
    return lab_usage("import", "--rig and --stream need --from colmap, nerfstudio or blender");
  sv_status s = lab_session_start(&se, 0, o->is_quiet, &err);
  if (s == SV_OK) s = sv_linux_catch_signals(&err);
  if (s == SV_OK) s = import(o, &se, &err);
  if (s == SV_E_INTERRUPTED)
    s = sv_fail(&err, s, "stopped by request: %s is incomplete; run the same command again", o->out);
  if (s != SV_OK) code = lab_failed(&se, &err);
  lab_session_stop(&se);
  return code;
}
