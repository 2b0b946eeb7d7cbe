// SPDX-License-Identifier: Apache-2.0
#include "tools/dataset/dataset.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "src/base/str.h"
#include "tools/dataset/measurement.h"

#define MOST_LISTED 4 // names in one sentence

void lab_transforms_free(lab_transforms_file *f) {
  free(f->text);
  free(f->tok);
  free(f->frames);
  memset(f, 0, sizeof *f);
}

static sv_status file_parse(lab_transforms_file *f, size_t bytes, sv_err *err) {
  int n_tok;
  sv_status s = sv_json_count(f->path, f->text, bytes, &n_tok, err);
  if (s != SV_OK) return s;
  f->tok = malloc(((size_t)n_tok + 1) * sizeof *f->tok);
  if (!f->tok) return sv_fail(err, SV_E_NOMEM, "%s: no memory for its %d JSON tokens", f->path, n_tok);
  s = sv_transforms_open(&f->t, &(sv_file_data){f->path, f->text, bytes}, f->tok, n_tok, err);
  if (s != SV_OK) return s;
  f->frames = calloc((size_t)f->t.n_frames, sizeof *f->frames);
  if (!f->frames) return sv_fail(err, SV_E_NOMEM, "%s: no memory for its %d frames", f->path, f->t.n_frames);
  return sv_transforms_read(&f->t, f->frames, f->t.n_frames, err);
}

sv_status lab_transforms_open(lab_transforms_file *f, const char *folder, const char *name, sv_err *err) {
  size_t bytes;
  memset(f, 0, sizeof *f);
  sv_status s = sv_path_join(f->path, sizeof f->path, folder, name, err);
  sv_path_folder(f->folder, sizeof f->folder, f->path);
  if (s == SV_OK) s = sv_file_read(f->path, &f->text, &bytes, err);
  if (s == SV_OK) s = file_parse(f, bytes, err);
  if (s != SV_OK) lab_transforms_free(f);
  return s;
}

static bool exists_in(const char *folder, const char *name) {
  char path[SV_CAP_PATH];
  return sv_path_join(path, sizeof path, folder, name, NULL) == SV_OK && sv_path_exists(path);
}

// Whether `transforms` was remembered rather than asked for.
static bool is_told(const lab_source *src) {
  return src->transforms && *src->transforms && src->told_by && *src->told_by;
}

// Names in a sentence: the first few, then "...".
typedef struct {
  char text[200];
  size_t room; // of it that may be used, with its end
  int n;       // -1: it ends in "..."
} listed;

static void list_name(listed *l, const char *name) {
  static const char more[] = ", ...";
  size_t at = strlen(l->text);
  if (l->n < 0) return;
  if (l->n < MOST_LISTED && at + strlen(name) + 2 + sizeof more <= l->room) {
    sv_fmt(l->text + at, l->room - at, "%s%s", l->n++ ? ", " : "", name);
    return;
  }
  if (l->n) sv_fmt(l->text + at, l->room - at, "%s", more);
  l->n = -1;
}

static bool is_training_file_name(const char *name) {
  size_t n = strlen(name);
  return strncmp(name, "transforms", 10) == 0 && strncmp(name, "transforms_test", 15) != 0 &&
         strncmp(name, "transforms_val", 14) != 0 && n > 15 && sv_str_eq(name + n - 5, ".json");
}

static sv_status no_training_file(const lab_source *src, sv_err *err) {
  sv_names names;
  char text[sizeof err->text];
  sv_str t = sv_str_make(text, sizeof text);
  listed l = {.room = 0};
  sv_str_add(&t, "%s: has neither transforms_train.json nor transforms.json", src->folder);
  if (is_told(src)) sv_str_add(&t, ", nor %s, which %s names", src->transforms, src->told_by);
  sv_str_add(&t, "; name another with --transforms");
  if (t.len + 2 < sizeof text) l.room = sizeof text - t.len - 2; // behind ": "
  if (sv_folder_list(src->folder, &names, NULL) == SV_OK) {
    for (int i = 0; i < names.n; i++)
      if (is_training_file_name(names.names[i])) list_name(&l, names.names[i]);
    sv_names_free(&names);
  }
  return sv_fail(err, SV_E_NOT_FOUND, "%s%s%s", text, *l.text ? ": " : "", l.text);
}

static sv_status training_name(const lab_source *src, char out[SV_TRANSFORMS_CAP_PATH], sv_err *err) {
  if (!sv_path_is_folder(src->folder))
    return sv_fail(err, SV_E_NOT_FOUND, "%s: %s; expected the folder of a dataset", src->folder,
                   access(src->folder, F_OK) == 0 ? "not a folder" : "no such folder");
  const char *name = src->transforms && *src->transforms ? src->transforms : NULL;
  if (!name || (is_told(src) && !exists_in(src->folder, name)))
    name = exists_in(src->folder, "transforms_train.json") ? "transforms_train.json"
           : exists_in(src->folder, "transforms.json")     ? "transforms.json"
                                                           : NULL;
  if (!name) return no_training_file(src, err);
  if (!sv_copy(out, SV_TRANSFORMS_CAP_PATH, name))
    return sv_fail(err, SV_E_RANGE, "%.80s...: the name of the transforms file is too long", name);
  return SV_OK;
}

// --- which frames --------------------------------------------------------------------------------

static bool is_train_mark(const char *split) { return !*split || sv_str_eq(split, "train"); }

// Whether frame i of the training file is kept from training.
static bool is_held_out(const lab_transforms_file *f, const lab_source *src, const char *name, bool has_marks,
                        int i) {
  if (has_marks) return !is_train_mark(f->frames[i].split);
  if (sv_str_eq(sv_path_name(name), "transforms_train.json") ||
      exists_in(src->folder, "transforms_test.json"))
    return false;
  return i % 8 == 0;
}

// How near the split that a held-out frame is marked as comes to test: held-out times are a split
// of their own.
static int test_rank(const sv_transforms_frame *f) {
  return sv_str_eq(f->split, "test") ? 2 : sv_str_eq(f->split, "test_time") ? 0 : 1;
}

static bool has_marks(const lab_transforms_file *f) {
  for (int i = 0; i < f->t.n_frames; i++)
    if (*f->frames[i].split) return true;
  return false;
}

static int compare_ints(const void *a, const void *b) {
  int x = *(const int *)a, y = *(const int *)b;
  return (x > y) - (x < y);
}

// Takes away the mark of frames beyond the first n exposures. Without exposure numbers each frame
// is one, and the most dispersed stay.
static sv_status keep_exposures(const lab_transforms_file *f, int n, bool *is_in, sv_err *err) {
  int *id = malloc((size_t)f->t.n_frames * sizeof *id), n_id = 0;
  if (!id) return sv_fail(err, SV_E_NOMEM, "%s: no memory for its exposures", f->path);
  for (int i = 0; i < f->t.n_frames; i++)
    if (is_in[i] && f->frames[i].exposure >= 0) id[n_id++] = f->frames[i].exposure;
  qsort(id, (size_t)n_id, sizeof *id, compare_ints);
  int n_distinct = 0, last = -1;
  for (int i = 0; i < n_id; i++)
    if (i == 0 || id[i] != id[i - 1]) {
      if (++n_distinct > n) break;
      last = id[i];
    }
  free(id);
  if (!n_id) return lab_disperse_frames(f->frames, f->t.n_frames, n, is_in, err);
  for (int i = 0; i < f->t.n_frames; i++)
    if (is_in[i]) is_in[i] = f->frames[i].exposure >= 0 && f->frames[i].exposure <= last;
  return SV_OK;
}

// Leaves the frames of one camera.
static sv_status keep_camera(const lab_transforms_file *f, const lab_source *src, bool *is_in, sv_err *err) {
  listed l = {.room = 140};
  int n = 0;
  for (int i = 0; i < f->t.n_frames; i++) n += is_in[i] && sv_str_eq(f->frames[i].camera, src->camera);
  for (int i = 0; i < f->t.n_frames && n; i++)
    is_in[i] = is_in[i] && sv_str_eq(f->frames[i].camera, src->camera);
  if (n) return SV_OK;
  for (int i = 0; i < f->t.n_frames; i++) {
    int k = 0;
    while (k < i && !(is_in[k] && sv_str_eq(f->frames[k].camera, f->frames[i].camera))) k++;
    if (is_in[i] && k == i && *f->frames[i].camera) list_name(&l, f->frames[i].camera);
  }
  return sv_fail(err, SV_E_NOT_FOUND, "%s: split %s has no view of camera %.40s; %s%s", f->path, src->split,
                 src->camera, *l.text ? "there are " : "its views do not name cameras", l.text);
}

// Marks the frames of a split; f is the file that `name` names.
static sv_status choose_frames(const lab_transforms_file *f, const lab_source *src, const char *name,
                               bool is_training_file, bool *is_in, sv_err *err) {
  bool marks = has_marks(f), is_train = sv_str_eq(src->split, "train"), is_all = sv_str_eq(src->split, "all");
  int n = 0, best = 0;
  for (int i = 0; i < f->t.n_frames; i++)
    if (is_training_file && is_held_out(f, src, name, marks, i) && test_rank(&f->frames[i]) > best)
      best = test_rank(&f->frames[i]);
  for (int i = 0; i < f->t.n_frames; i++) {
    bool held = is_training_file && is_held_out(f, src, name, marks, i);
    if (!is_training_file || is_all) is_in[i] = true;
    else if (is_train) is_in[i] = !held;
    else if (sv_str_eq(src->split, "test")) is_in[i] = held && test_rank(&f->frames[i]) == best;
    else is_in[i] = marks && sv_str_eq(f->frames[i].split, src->split);
    n += is_in[i];
  }
  if (n == 0)
    return sv_fail(err, SV_E_NOT_FOUND, "%s: none of its %d views belongs to split %s", f->path,
                   f->t.n_frames, src->split);
  sv_status s = src->camera ? keep_camera(f, src, is_in, err) : SV_OK;
  return s == SV_OK && is_train && src->n_exposures > 0 ? keep_exposures(f, src->n_exposures, is_in, err) : s;
}

// --- their files ---------------------------------------------------------------------------------

static sv_status find_picture(lab_frame *f, const char *folder, sv_err *err) {
  static const char *const extensions[] = {".png", ".jpg", ".jpeg", ".PNG", ".JPG", ".JPEG"};
  sv_status s = sv_path_join(f->path, sizeof f->path, folder, f->f.file_path, err);
  if (s != SV_OK) return s;
  size_t n = strlen(f->path);
  if (!f->f.has_extension)
    for (int i = 0; i < 6 && n + 6 < sizeof f->path; i++) {
      strcpy(f->path + n, extensions[i]);
      if (sv_path_exists(f->path)) return SV_OK;
    }
  f->path[n] = 0;
  if (sv_path_exists(f->path)) return SV_OK;
  return sv_fail(err, SV_E_NOT_FOUND, "%s: image not found (listed in the transforms file)", f->path);
}

// Finds the image, reads its size and completes the camera.
static sv_status find_frame(lab_frame *f, const lab_source *src, const char *folder, int scale, sv_err *err) {
  lab_peek peek;
  sv_status s = f->i_measurement < 0 ? find_picture(f, folder, err) : SV_OK;
  if (s == SV_OK && f->f.depth_kind)
    s = sv_path_join(f->depth_path, sizeof f->depth_path, folder, f->f.depth_path, err);
  if (f->i_measurement >= 0) // its size is that of its place on the sensor
    peek = (lab_peek){f->f.footprint.width_px, f->f.footprint.height_px, 3};
  else if (s == SV_OK) s = lab_picture_peek(f->path, &peek, err);
  if (s == SV_OK) s = sv_transforms_finish(&f->f, peek.width_px, peek.height_px, err);
  if (s != SV_OK) return s;
  if ((s = lab_mask_find(f, src, folder, err)) != SV_OK) return s;
  f->n_channels = peek.n_channels;
  int w = peek.width_px / scale, h = peek.height_px / scale;
  if (w < LAB_MIN_SIDE_PX || h < LAB_MIN_SIDE_PX || w > 16384 || h > 16384)
    return sv_fail(err, SV_E_RANGE, "%s: image is %dx%d pixels%s; expected sides from %d to 16384", f->path,
                   w, h, scale > 1 ? " after --scale" : "", LAB_MIN_SIDE_PX);
  return SV_OK;
}

static void make_view(lab_frame *f, int scale) {
  const double *p = f->lens.model.p;
  sv_view full = sv_view_make(f->lens.model.width_px, f->lens.model.height_px, p, &f->f.cam_from_world);
  f->view = sv_view_scaled(&full, scale);
  f->view.time = f->f.time >= 0 ? (float)f->f.time : 0.0f;
  f->view.i_exposure = f->f.exposure;
  f->view.i_sub_view = f->f.sub_view;
  f->view.fisheye = f->lens.is_fisheye ? &f->lens.fisheye : NULL;
}

typedef struct {
  lab_views *v;
  const lab_source *src;
  const char *folder;
  int *first_of; // [n lenses] the first frame of each
  sv_err *errs;
} prepare_job;

static void find_task(void *arg, int i_task, int i_thread) {
  prepare_job *j = arg;
  (void)i_thread;
  j->errs[i_task].status =
      find_frame(&j->v->frames[i_task], j->src, j->folder, j->v->scale, &j->errs[i_task]);
}

static void choose_task(void *arg, int i_task, int i_thread) {
  prepare_job *j = arg;
  lab_frame *f = &j->v->frames[j->first_of[i_task]];
  (void)i_thread;
  if (!sv_lens_view_make(&f->lens, &f->f.model))
    j->errs[i_task].status = sv_fail(&j->errs[i_task], SV_E_RANGE,
                                     "%s: no view fits this lens (%s, fx %g px); check its distortion",
                                     f->path, sv_model_name(f->f.model.kind), f->f.model.p[0]);
}

static sv_status run_tasks(prepare_job *j, sv_task_fn fn, int n, const sv_pool *pool, sv_err *err) {
  sv_pool_run(pool, fn, j, n);
  for (int i = 0; i < n; i++)
    if (j->errs[i].status != SV_OK) { // the first by order, on any number of threads
      if (err) *err = j->errs[i];
      return j->errs[i].status;
    }
  return SV_OK;
}

// Numbers the lenses in the order of their first frames; returns how many there are.
static int number_lenses(lab_views *v, int *first_of) {
  int n = 0;
  for (int i = 0; i < v->n; i++) {
    int k =
        i && lab_is_same_lens(&v->frames[i].f.model, &v->frames[i - 1].f.model) ? v->frames[i - 1].i_lens : 0;
    while (k < n && !lab_is_same_lens(&v->frames[i].f.model, &v->frames[first_of[k]].f.model)) k++;
    if (k == n) first_of[n++] = i;
    v->frames[i].i_lens = k;
  }
  int at = 0;
  for (int k = 0; k < n; k++)
    for (int i = first_of[k]; i < v->n; i++)
      if (v->frames[i].i_lens == k) v->by_lens[at++] = i;
  return n;
}

static sv_status prepare_views(prepare_job *j, const sv_pool *pool, sv_err *err) {
  lab_views *v = j->v;
  sv_status s = run_tasks(j, find_task, v->n, pool, err);
  if (s != SV_OK) return s;
  s = run_tasks(j, choose_task, number_lenses(v, j->first_of), pool, err);
  if (s != SV_OK) return s;
  v->has_depth = true;
  for (int i = 0; i < v->n; i++) {
    lab_frame *f = &v->frames[i];
    f->lens = v->frames[j->first_of[f->i_lens]].lens;
    f->is_masked = *f->mask_path || sv_lens_view_has_dark(&f->lens);
    make_view(f, v->scale);
    size_t px = sv_plane_floats(f->view.width_px, f->view.height_px);
    if (px > v->cap_floats) v->cap_floats = px;
    if (f->view.width_px > v->cap_width_px) v->cap_width_px = f->view.width_px;
    if (f->view.height_px > v->cap_height_px) v->cap_height_px = f->view.height_px;
    v->is_undistorted |= f->lens.is_remapped;
    v->n_masked += f->is_masked;
    v->has_depth &= f->f.depth_kind != SV_DEPTH_NONE;
  }
  return SV_OK;
}

static sv_status prepare_all(lab_views *v, const lab_source *src, const char *folder, const sv_pool *pool,
                             sv_err *err) {
  size_t n = (size_t)v->n;
  prepare_job j = {v, src, folder, malloc(n * sizeof(int)), calloc(n, sizeof(sv_err))};
  v->by_lens = malloc(n * sizeof(int));
  sv_status s = j.errs && j.first_of && v->by_lens
                    ? prepare_views(&j, pool, err)
                    : sv_fail(err, SV_E_NOMEM, "%s: no memory for %d views", folder, v->n);
  free(j.first_of);
  free(j.errs);
  return s;
}

// The frames that are in, in the file's order.
static sv_status collect(lab_views *v, const lab_transforms_file *f, const bool *is_in, const lab_source *src,
                         const sv_pool *pool, sv_err *err) {
  for (int i = 0; i < f->t.n_frames; i++) v->n += is_in[i];
  v->frames = calloc((size_t)v->n, sizeof *v->frames);
  if (!v->frames) return sv_fail(err, SV_E_NOMEM, "%s: no memory for %d views", f->path, v->n);
  for (int i = 0, k = 0; i < f->t.n_frames; i++)
    if (is_in[i]) v->frames[k++] = (lab_frame){.f = f->frames[i], .i_measurement = -1};
  v->scale = src->scale > 1 ? src->scale : 1;
  v->unit = f->t.unit;
  if (*f->t.ply_file_path) {
    sv_status s = sv_path_join(v->points, sizeof v->points, f->folder, f->t.ply_file_path, err);
    if (s != SV_OK) return s;
  }
  if (src->is_multiplexed) {
    sv_status s = lab_measurements_find(v, &f->t, f->folder, src->is_white, err);
    if (s != SV_OK) return s;
  }
  return prepare_all(v, src, f->folder, pool, err);
}

// The training file, or that with refined poses in its place; pictures are the dataset's.
static sv_status open_training(lab_transforms_file *f, const lab_source *src, const char *name, sv_err *err) {
  char path[SV_CAP_PATH];
  if (!src->refined || !*src->refined) return lab_transforms_open(f, src->folder, name, err);
  sv_status s = sv_path_join(path, sizeof path, src->folder, name, err);
  if (s == SV_OK) s = lab_transforms_open(f, "", src->refined, err);
  if (s == SV_OK) sv_path_folder(f->folder, sizeof f->folder, path);
  return s;
}

// The file that holds a split: the training file, or one of its own.
static sv_status open_split(lab_transforms_file *f, const lab_source *src, char name[SV_TRANSFORMS_CAP_PATH],
                            bool *is_training_file, sv_err *err) {
  char own[SV_TRANSFORMS_CAP_PATH];
  sv_fmt(own, sizeof own, "transforms_%.100s.json", src->split);
  bool is_train = sv_str_eq(src->split, "train"), has_own = !is_train && exists_in(src->folder, own);
  bool is_test = sv_str_eq(src->split, "test") || sv_str_eq(src->split, "test_near");
  *is_training_file = !(is_test && has_own);
  sv_status s = SV_OK;
  if (*is_training_file) s = training_name(src, name, err);
  else sv_copy(name, SV_TRANSFORMS_CAP_PATH, own);
  if (s == SV_OK)
    s = *is_training_file ? open_training(f, src, name, err) : lab_transforms_open(f, src->folder, name, err);
  if (s != SV_OK || is_train || is_test || !has_own) return s;
  // marks inside the training file go before a file of the name
  for (int i = 0; i < f->t.n_frames; i++)
    if (sv_str_eq(f->frames[i].split, src->split)) return SV_OK;
  lab_transforms_free(f);
  *is_training_file = false;
  sv_copy(name, SV_TRANSFORMS_CAP_PATH, own);
  return lab_transforms_open(f, src->folder, name, err);
}

// Opens the file of a split and marks its frames; *is_in is malloc'ed.
static sv_status open_marked(lab_transforms_file *f, bool **is_in, const lab_source *src,
                             char name[SV_TRANSFORMS_CAP_PATH], sv_err *err) {
  bool is_training_file;
  *is_in = NULL;
  sv_status s = open_split(f, src, name, &is_training_file, err);
  if (s != SV_OK) return s;
  *is_in = calloc((size_t)f->t.n_frames, sizeof **is_in);
  s = *is_in ? choose_frames(f, src, name, is_training_file, *is_in, err)
             : sv_fail(err, SV_E_NOMEM, "%s: no memory for its frames", f->path);
  if (s != SV_OK) {
    free(*is_in);
    *is_in = NULL;
    lab_transforms_free(f);
  }
  return s;
}

// The test views near to what was trained on, in place of transforms_test_near.json.
static sv_status open_near(lab_transforms_file *f, bool **is_in, const lab_source *src,
                           char name[SV_TRANSFORMS_CAP_PATH], sv_err *err) {
  lab_source part = *src;
  double centre[3];
  sv_status s = open_marked(f, is_in, &part, name, err); // so marked in the training file
  if (s != SV_E_NOT_FOUND) return s;
  part.split = "train";
  part.camera = NULL; // the center is that of all that was trained on
  s = open_marked(f, is_in, &part, name, err);
  if (s != SV_OK) return s;
  lab_mean_centre(f->frames, f->t.n_frames, *is_in, centre);
  free(*is_in);
  lab_transforms_free(f);
  part.split = "test";
  part.camera = src->camera;
  if ((s = open_marked(f, is_in, &part, name, err)) == SV_E_NOT_FOUND && !src->camera)
    return sv_fail(err, s, "%s: has neither transforms_test_near.json nor test views, so no split test_near",
                   src->folder);
  if (s != SV_OK) return s;
  lab_keep_nearest(f->frames, f->t.n_frames, centre, LAB_N_NEAR, *is_in);
  char all[SV_TRANSFORMS_CAP_PATH];
  sv_copy(all, sizeof all, name);
  // for messages; it is not that split
  sv_fmt(name, SV_TRANSFORMS_CAP_PATH, "%.180s (nearest)", all);
  return SV_OK;
}

sv_status lab_views_open(lab_views *v, const lab_source *src, const sv_pool *pool, sv_err *err) {
  lab_transforms_file f;
  bool *is_in;
  memset(v, 0, sizeof *v);
  bool is_near = sv_str_eq(src->split, "test_near") && !exists_in(src->folder, "transforms_test_near.json");
  sv_status s = (is_near ? open_near : open_marked)(&f, &is_in, src, v->transforms, err);
  if (s != SV_OK) return s;
  s = collect(v, &f, is_in, src, pool, err);
  free(is_in);
  lab_transforms_free(&f);
  if (s != SV_OK) lab_views_free(v);
  return s;
}

// The name of a frame's image, or its path in one word.
static void name_frame(const lab_frame *f, bool is_path, char *out, size_t cap) {
  const char *path = f->f.file_path;
  sv_fmt(out, cap, "%s", is_path ? path : sv_path_name(path));
  if (f->f.has_extension) out[strlen(out) - strlen(sv_path_extension(out))] = 0;
  for (char *p = out; *p; p++)
    if (*p == '/') *p = '_';
}

static bool is_name_taken(const lab_views *v, int i, bool is_path, const char *name) {
  char other[SV_TRANSFORMS_CAP_PATH];
  bool is_taken = false;
  for (int k = 0; k < v->n && !is_taken; k++) {
    name_frame(&v->frames[k], is_path, other, sizeof other);
    is_taken = k != i && sv_str_eq(other, name);
  }
  return is_taken;
}

void lab_view_name(const lab_views *v, int i, char *out, size_t cap) {
  char name[SV_TRANSFORMS_CAP_PATH];
  name_frame(&v->frames[i], false, name, sizeof name);
  bool is_path = is_name_taken(v, i, false, name);
  if (is_path) name_frame(&v->frames[i], true, name, sizeof name);
  if (is_path && is_name_taken(v, i, true, name)) sv_fmt(out, cap, "%.180s_%d", name, i);
  else sv_fmt(out, cap, "%s", name);
}

void lab_views_free(lab_views *v) {
  for (int i = 0; v->frames && i < v->n; i++) free(v->frames[i].coverage);
  free(v->frames);
  free(v->by_lens);
  free(v->measurements);
  memset(v, 0, sizeof *v);
}
