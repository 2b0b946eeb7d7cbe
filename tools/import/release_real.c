// SPDX-License-Identifier: Apache-2.0
// Static and casual scenes of the authors' release. Training and evaluation pictures are of one
// joint COLMAP model, so no registration is needed: train and test share one frame.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/str.h"
#include "tools/import/release.h"

// A capture of the release: its device and the stream that stands for one camera.
typedef struct {
  const char *name, *device; // in the release; of ours
  const char *prefix;        // of its pictures in static/shared
  const char *mono;          // word of the mono stream; NULL: the picture in the grid's middle
} capture;
static const capture captures[] = {{"iphone", "phone", "iphone__", "wide"},
                                   {"stereo", "stereo", "stereo__", "right"},
                                   {"lightfield", "lightfield", "lf__", NULL}};

static int compare_names(const void *a, const void *b) {
  return strcmp(((const lab_import_view *)a)->name, ((const lab_import_view *)b)->name);
}

static void sort_views(lab_import *im) {
  if (im->n > 1) qsort(im->views, (size_t)im->n, sizeof *im->views, compare_names);
}

// --- points --------------------------------------------------------------------------------------

static bool is_in_picture(const lab_import_view *v, const sv_point *p) {
  double x[3] = {(double)p->mean[0], (double)p->mean[1], (double)p->mean[2]}, uv[2];
  sv_pose_apply(x, &v->cam_from_world, x);
  return x[2] > 0 && sv_model_project(&v->model, x, uv, NULL, NULL) && uv[0] >= 0 && uv[1] >= 0 &&
         uv[0] < v->model.width_px && uv[1] < v->model.height_px;
}

// The points of `from` that a training view of `to` has in its picture: what others saw alone is
// not told to it.
static sv_status add_seen_points(lab_import *to, const lab_import *from, sv_err *err) {
  for (int i = 0; i < from->n_points; i++) {
    bool is_seen = false;
    for (int k = 0; k < to->n && !is_seen; k++)
      is_seen = (!*to->views[k].split || sv_str_eq(to->views[k].split, "train")) &&
                is_in_picture(&to->views[k], &from->points[i]);
    if (!is_seen) continue;
    sv_point *p = lab_import_add_point(to);
    if (!p) return sv_fail(err, SV_E_NOMEM, "no memory for %d points", to->n_points + 1);
    *p = from->points[i];
  }
  return SV_OK;
}

// Points with the tracks of a subset, where the release has them; else those of the whole model.
static sv_status subset_points(lab_import *sub, const char *folder, const char *name, sv_err *err) {
  char path[SV_CAP_PATH], dir[SV_CAP_PATH], part[80];
  snprintf(part, sizeof part, "subsets/%.60s", name);
  sv_status s = sv_path_join(dir, sizeof dir, folder, part, err);
  if (s != SV_OK || !lab_import_colmap_model(dir, path)) return s;
  return lab_import_colmap(sub, dir, err);
}

static sv_status add_points(lab_import *to, const lab_import *all, const char *folder, const char *subset,
                            sv_err *err) {
  lab_import sub = {0};
  sv_status s = subset_points(&sub, folder, subset, err);
  if (s == SV_OK) s = add_seen_points(to, sub.n_points ? &sub : all, err);
  lab_import_free(&sub);
  return s;
}

// --- static --------------------------------------------------------------------------------------

// RR_CC of lf__RR_CC.png.
static bool grid_place(const char *name, int *row, int *column) {
  return sscanf(sv_path_name(name), "lf__%d_%d", row, column) == 2;
}

// The view in the middle of the grid; the middle of the list when names do not tell.
static int middle_of_grid(const lab_import *im) {
  int lo[2] = {1 << 20, 1 << 20}, hi[2] = {-1, -1}, at[2], best = im->n / 2, least = 1 << 20;
  for (int i = 0; i < im->n; i++)
    if (grid_place(im->views[i].name, &at[0], &at[1]))
      for (int k = 0; k < 2; k++) {
        if (at[k] < lo[k]) lo[k] = at[k];
        if (at[k] > hi[k]) hi[k] = at[k];
      }
  for (int i = 0; i < im->n; i++)
    if (grid_place(im->views[i].name, &at[0], &at[1])) {
      int d = abs(2 * at[0] - lo[0] - hi[0]) + abs(2 * at[1] - lo[1] - hi[1]);
      if (d < least) {
        least = d;
        best = i;
      }
    }
  return best;
}

static int mono_of(const capture *c, const lab_import *device) {
  if (!c->mono) return middle_of_grid(device);
  for (int i = 0; i < device->n; i++)
    if (lab_release_has_word(device->views[i].name, c->mono)) return i;
  return 0;
}

// All sub-views of a grid together get the pixels of one: 1/k of the pixels a side, k^2 >= n. The
// reduced pictures lie in the dataset.
static sv_status reduce(lab_import *im, const char *folder, sv_err *err) {
  int k = 1;
  while (k * k < im->n) k++;
  for (int i = 0; i < im->n; i++) {
    lab_import_view *v = &im->views[i];
    char path[SV_CAP_PATH], up[SV_CAP_PATH], name[SV_TRANSFORMS_CAP_PATH + 8];
    sv_bitmap b;
    snprintf(name, sizeof name, "images/%s", v->name);
    sv_status s = sv_path_join(path, sizeof path, folder, name, err);
    if (s != SV_OK) return s;
    sv_path_folder(up, sizeof up, path);
    s = sv_path_make_folder(up, err);
    if (s == SV_OK) s = sv_bitmap_read(v->source, &b, err);
    if (s == SV_OK) s = sv_bitmap_to_8(&b, err);
    if (s != SV_OK) return s;
    if (b.width_px != v->model.width_px || b.height_px != v->model.height_px ||
        b.width_px / k < LAB_MIN_SIDE_PX || b.height_px / k < LAB_MIN_SIDE_PX) {
      sv_bitmap_free(&b);
      return sv_fail(err, SV_E_RANGE, "%s: cannot be reduced to 1/%d: it is %dx%d, its camera %dx%d",
                     v->source, k, b.width_px, b.height_px, v->model.width_px, v->model.height_px);
    }
    lab_reduce(b.u8, b.width_px, b.height_px, b.n_channels, k, b.u8);
    b.width_px /= k;
    b.height_px /= k;
    s = sv_bitmap_write_png(path, &b, err);
    sv_bitmap_free(&b);
    if (s != SV_OK) return s;
    sv_copy(v->source, sizeof v->source, path);
    lab_release_reduce_model(&v->model, k);
  }
  return SV_OK;
}

// Views whose names begin with a prefix; where the list of a split is there, only those on it.
static sv_status choose(lab_import *to, const lab_import *from, const char *prefix, const sv_names *list,
                        sv_err *err) {
  sv_status s = SV_OK;
  for (int i = 0; i < from->n && s == SV_OK; i++) {
    const char *name = from->views[i].name;
    if (strncmp(name, prefix, strlen(prefix)) == 0 && (list->n == 0 || lab_release_is_named(list, name)))
      s = lab_release_copy(to, &from->views[i], err);
  }
  return s;
}

// Names of one split: those of the capture, else of all.
static sv_status eval_names(sv_names *out, const char *shared, const char *capture_name, sv_err *err) {
  char file[80];
  snprintf(file, sizeof file, "splits/%.40s_eval.txt", capture_name);
  sv_status s = lab_release_names(out, shared, file, err);
  if (s == SV_OK && out->n == 0) s = lab_release_names(out, shared, "splits/iphone_eval.txt", err);
  return s;
}

typedef struct {
  lab_import device, mono, test;
} split_views;

static void free_split(split_views *v) {
  lab_import_free(&v->device);
  lab_import_free(&v->mono);
  lab_import_free(&v->test);
}

static sv_status write_split(lab_release *r, split_views *v, const char *folder, const char *device,
                             sv_err *err) {
  char name[60];
  snprintf(name, sizeof name, "transforms_train_%s.json", device);
  sv_status s = lab_import_write_as(&v->test, r->se, folder, "transforms_test.json", err);
  if (s == SV_OK) s = lab_import_write_as(&v->mono, r->se, folder, "transforms_train_mono.json", err);
  return s == SV_OK ? lab_import_write_as(&v->device, r->se, folder, name, err) : s;
}

static sv_status static_capture(lab_release *r, const capture *c, const lab_import *all, const char *shared,
                                const char *scene, sv_err *err) {
  split_views v = {0};
  sv_names train = {0}, eval = {0};
  char file[80], folder[SV_CAP_PATH];
  snprintf(file, sizeof file, "splits/%s.txt", c->name);
  sv_status s = lab_release_names(&train, shared, file, err);
  if (s == SV_OK) s = eval_names(&eval, shared, c->name, err);
  if (s == SV_OK) s = choose(&v.device, all, c->prefix, &train, err);
  if (s == SV_OK) s = choose(&v.test, all, "eval__", &eval, err);
  sv_names_free(&train);
  sv_names_free(&eval);
  if (s == SV_OK && (v.device.n == 0 || v.test.n == 0)) {
    free_split(&v);
    return SV_OK;
  }
  for (int i = 0; i < v.device.n; i++) {
    v.device.views[i].exposure = 0;
    v.device.views[i].sub_view = i;
  }
  if (s == SV_OK) s = lab_release_copy(&v.mono, &v.device.views[mono_of(c, &v.device)], err);
  if (s == SV_OK) s = lab_release_folder(r, folder, (const char *const[]){"static", scene, c->name}, err);
  // the picture of the mono file keeps its size, under a name of its own
  if (s == SV_OK && !c->mono) {
    snprintf(v.mono.views[0].name, sizeof v.mono.views[0].name, "middle%s",
             sv_path_extension(v.mono.views[0].source));
    s = reduce(&v.device, folder, err);
  }
  if (s == SV_OK) s = add_points(&v.mono, all, shared, c->name, err);
  if (s == SV_OK) s = add_points(&v.device, all, shared, c->name, err);
  if (s == SV_OK) s = write_split(r, &v, folder, c->device, err);
  if (s == SV_OK)
    lab_release_made(r, folder, "%d sub-views of %dx%d, %d evaluation views", v.device.n,
                     v.device.views[0].model.width_px, v.device.views[0].model.height_px, v.test.n);
  free_split(&v);
  return s;
}

static sv_status static_scene(lab_release *r, const char *folder, const char *scene, sv_err *err) {
  char shared[SV_CAP_PATH], path[SV_CAP_PATH];
  lab_import all = {0};
  sv_status s = sv_path_join(path, sizeof path, folder, "static", err);
  if (s != SV_OK || !sv_path_is_folder(path)) return s;
  s = sv_path_join(shared, sizeof shared, folder, "static/shared", err);
  if (s != SV_OK) return s;
  if (!lab_import_colmap_model(shared, path)) {
    r->n_without_poses++;
    return SV_OK;
  }
  s = lab_import_colmap(&all, shared, err);
  if (s == SV_OK) sort_views(&all);
  for (size_t i = 0; i < sizeof captures / sizeof *captures && s == SV_OK; i++)
    s = static_capture(r, &captures[i], &all, shared, scene, err);
  lab_import_free(&all);
  return s;
}

sv_status lab_release_static(lab_release *r, sv_err *err) {
  return lab_release_scenes(r, "casual", static_scene, err);
}

// --- casual video --------------------------------------------------------------------------------

// PREFIX__STEM__frame_000123.png -> its stream and number; false for other names.
static bool take_frame_name(const char *name, char stem[32], int *number) {
  const char *first = strstr(name, "__"), *last = NULL;
  for (const char *p = name; (p = strstr(p, "__frame_")); p++) last = p;
  if (!first || !last || last < first + 2 || sscanf(last, "__frame_%d", number) != 1) return false;
  snprintf(stem, 32, "%.*s", (int)(last - first - 2), first + 2);
  return true;
}

// Where the stem stands among those of all views, by name.
static int stream_of(const lab_import *im, const char *stem) {
  int n = 0;
  for (int i = 0; i < im->n; i++) {
    bool is_new = strcmp(im->views[i].camera, stem) < 0;
    for (int k = 0; k < i && is_new; k++) is_new = !sv_str_eq(im->views[k].camera, im->views[i].camera);
    n += is_new;
  }
  return n;
}

// Training pictures by name; each eighth of all streams together is for validation.
static sv_status casual_train(lab_import *device, const lab_import *all, const sv_names *train, sv_err *err) {
  sv_status s = choose(device, all, train->n ? "" : "train__", train, err);
  if (s != SV_OK) return s;
  sort_views(device);
  for (int i = 0; i < device->n; i++) {
    lab_import_view *v = &device->views[i];
    sv_copy(v->split, sizeof v->split, i % 8 == 0 ? "val" : "train");
    if (!take_frame_name(v->name, v->camera, &v->exposure)) *v->camera = 0;
  }
  for (int i = 0; i < device->n; i++) device->views[i].sub_view = stream_of(device, device->views[i].camera);
  return SV_OK;
}

static sv_status casual_mono(lab_import *mono, const lab_import *device, const capture *c, sv_err *err) {
  sv_status s = SV_OK;
  for (int i = 0; i < device->n && s == SV_OK; i++)
    if (lab_release_has_word(device->views[i].camera, c->mono))
      s = lab_release_copy(mono, &device->views[i], err);
  return s;
}

static sv_status casual_capture(lab_release *r, const capture *c, const char *dir, const char *scene,
                                sv_err *err) {
  split_views v = {0};
  lab_import all = {0};
  sv_names train = {0}, eval = {0};
  char folder[SV_CAP_PATH];
  sv_status s = lab_import_colmap(&all, dir, err);
  if (s == SV_OK) s = lab_release_names(&train, dir, "splits/train.txt", err);
  if (s == SV_OK) s = lab_release_names(&eval, dir, "splits/eval.txt", err);
  if (s == SV_OK) s = casual_train(&v.device, &all, &train, err);
  if (s == SV_OK) s = casual_mono(&v.mono, &v.device, c, err);
  if (s == SV_OK) s = choose(&v.test, &all, eval.n ? "" : "eval__", &eval, err);
  if (s == SV_OK && (v.device.n == 0 || v.mono.n == 0 || v.test.n == 0))
    s = sv_fail(err, SV_E_FORMAT, "%.120s: its model has %d training pictures, %d of '%s', and %d to score",
                dir, v.device.n, v.mono.n, c->mono, v.test.n);
  if (s == SV_OK) s = add_points(&v.mono, &all, dir, "train", err);
  if (s == SV_OK) s = add_points(&v.device, &all, dir, "train", err);
  if (s == SV_OK) s = lab_release_folder(r, folder, (const char *const[]){"casual", scene, c->name}, err);
  if (s == SV_OK) s = write_split(r, &v, folder, c->device, err);
  if (s == SV_OK)
    lab_release_made(r, folder, "%d frames to train on or validate, %d of one camera, %d evaluation views%s",
                     v.device.n, v.mono.n, v.test.n,
                     v.device.n + v.test.n < train.n + eval.n ? "; frames without a pose left out" : "");
  sv_names_free(&train);
  sv_names_free(&eval);
  lab_import_free(&all);
  free_split(&v);
  return s;
}

// Prepared folders are those with a list of training frames; their names have the device in them.
static sv_status casual_scene(lab_release *r, const char *folder, const char *scene, sv_err *err) {
  char dir[SV_CAP_PATH], path[SV_CAP_PATH];
  sv_names names;
  sv_status s = sv_folder_list(folder, &names, err);
  if (s != SV_OK) return s;
  for (int k = 0; k < 2 && s == SV_OK; k++) {
    int n_made = 0, n_seen = 0;
    for (int i = 0; i < names.n && s == SV_OK; i++) {
      if (!lab_release_has_word(names.names[i], captures[k].name)) continue;
      n_seen++;
      s = sv_path_join(dir, sizeof dir, folder, names.names[i], err);
      if (s != SV_OK) break;
      const bool has_model = lab_import_colmap_model(dir, path);
      s = sv_path_join(path, sizeof path, dir, "splits/train.txt", err);
      if (s != SV_OK || !has_model || !sv_path_exists(path)) continue;
      s = casual_capture(r, &captures[k], dir, scene, err);
      n_made++;
    }
    r->n_without_poses += n_seen && !n_made;
  }
  sv_names_free(&names);
  return s;
}

sv_status lab_release_casual(lab_release *r, sv_err *err) {
  return lab_release_scenes(r, "casual", casual_scene, err);
}
