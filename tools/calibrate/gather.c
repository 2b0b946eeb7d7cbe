// SPDX-License-Identifier: Apache-2.0
#include <ctype.h>
#include <glob.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "src/base/str.h"
#include "tools/calibrate/calibrate.h"

// --- names ---------------------------------------------------------------------------------------
// A camera's name: the pattern's file name up to the first wildcard without what separates, else
// its folder's.
static void name_camera(cal_boards *b, int i_camera, const char *pattern) {
  char folder[SV_CAP_PATH], *name = b->cameras[i_camera].name;
  const char *file = sv_path_name(pattern);
  size_t n = sv_path_is_folder(pattern) ? strlen(file) : strcspn(file, "*?[");
  while (n && !isalnum((unsigned char)file[n - 1])) n--;
  if (n) sv_fmt(name, 32, "%.*s", (int)(n < 31 ? n : 31), file);
  else {
    sv_path_folder(folder, sizeof folder, pattern);
    sv_fmt(name, 32, "%.31s", sv_path_name(folder));
  }
  for (char *p = name; *p; p++)
    if (!isalnum((unsigned char)*p) && !strchr("-_.", *p)) *p = '_';
  bool is_taken = !isalnum((unsigned char)name[0]);
  for (int k = 0; k < i_camera; k++) is_taken = is_taken || strcmp(b->cameras[k].name, name) == 0;
  if (is_taken) sv_fmt(name, 32, "cam%d", i_camera);
}

// What the wildcards stand for in a path: the part that the pattern does not fix at its ends.
static char *key_of(const char *pattern, const char *path, bool is_folder) {
  if (is_folder) return strdup(sv_path_name(path));
  size_t first = strcspn(pattern, "*?["), last = strlen(pattern), n = strlen(path);
  size_t tail = last;
  while (tail > first && !strchr("*?]", pattern[tail - 1])) tail--;
  size_t after = last - tail;
  if (first + after > n) return strdup(path);
  char *key = strdup(path + first);
  if (key) key[n - first - after] = 0;
  return key;
}

static bool is_picture(const char *path) {
  const char *ext = sv_path_extension(path);
  return strcasecmp(ext, ".png") == 0 || strcasecmp(ext, ".jpg") == 0 || strcasecmp(ext, ".jpeg") == 0;
}

static sv_status expand(const char *pattern, glob_t *g, sv_err *err) {
  char all[SV_CAP_PATH];
  bool is_folder = sv_path_is_folder(pattern);
  sv_status s = is_folder ? sv_path_join(all, sizeof all, pattern, "*", err) : SV_OK;
  if (s != SV_OK) return s;
  int code = glob(is_folder ? all : pattern, 0, NULL, g);
  if (code == GLOB_NOMATCH) return sv_fail(err, SV_E_NOT_FOUND, "%s: no image matches", pattern);
  return code == 0 ? SV_OK : sv_fail(err, SV_E_IO, "%s: cannot search for images", pattern);
}

typedef struct {
  char *key, *path;
  int camera;
} entry;

static int by_key(const void *a, const void *b) {
  const entry *x = a, *y = b;
  int c = strcmp(x->key, y->key);
  return c ? c : x->camera - y->camera;
}

typedef struct {
  entry *all;
  int n, cap;
} entries;

static sv_status add_camera(entries *e, cal_boards *b, int camera, const char *pattern, sv_err *err) {
  glob_t g;
  sv_status s = expand(pattern, &g, err);
  if (s != SV_OK) return s;
  name_camera(b, camera, pattern);
  bool is_folder = sv_path_is_folder(pattern);
  for (size_t i = 0; i < g.gl_pathc && s == SV_OK; i++) {
    if (!is_picture(g.gl_pathv[i])) continue;
    if (e->n == e->cap) {
      int cap = e->cap ? 2 * e->cap : 256;
      entry *more = realloc(e->all, (size_t)cap * sizeof *more);
      if (!more) s = sv_fail(err, SV_E_NOMEM, "%s: no memory for its list", pattern);
      else {
        e->all = more;
        e->cap = cap;
      }
    }
    if (s == SV_OK) {
      entry *x = &e->all[e->n];
      *x = (entry){key_of(pattern, g.gl_pathv[i], is_folder), strdup(g.gl_pathv[i]), camera};
      e->n++;
      if (!x->key || !x->path) s = sv_fail(err, SV_E_NOMEM, "%s: no memory for its list", pattern);
      else b->cameras[camera].n_pictures++;
    }
  }
  globfree(&g);
  if (s == SV_OK && !b->cameras[camera].n_pictures)
    s = sv_fail(err, SV_E_NOT_FOUND, "%s: no .png or .jpg file matches", pattern);
  return s;
}

static sv_status sort_frames(entries *e, cal_boards *b, sv_err *err) {
  qsort(e->all, (size_t)e->n, sizeof *e->all, by_key);
  b->frames = calloc((size_t)e->n + 1, sizeof *b->frames);
  for (int c = 0; c < b->n_cameras; c++) {
    cal_camera *q = &b->cameras[c];
    q->pictures = calloc((size_t)q->n_pictures + 1, sizeof *q->pictures);
    if (!q->pictures || !b->frames) return sv_fail(err, SV_E_NOMEM, "no memory for the list of images");
    q->n_pictures = 0;
    b->names[c] = q->name;
  }
  for (int i = 0; i < e->n; i++) {
    entry *x = &e->all[i];
    if (!i || strcmp(x->key, b->frames[b->n_frames - 1]) != 0) {
      b->frames[b->n_frames] = strdup(x->key);
      if (!b->frames[b->n_frames++]) return sv_fail(err, SV_E_NOMEM, "no memory for the list of images");
    }
    cal_camera *q = &b->cameras[x->camera];
    q->pictures[q->n_pictures++] = (cal_picture){x->path, b->n_frames - 1};
    x->path = NULL;
  }
  return SV_OK;
}

sv_status cal_boards_list(cal_boards *b, const cal_options *o, sv_err *err) {
  entries e = {0};
  size_t nc = (size_t)o->images.n;
  *b = (cal_boards){.n_cameras = o->images.n, .n_cols = o->n_cols, .n_rows = o->n_rows};
  b->cameras = calloc(nc, sizeof *b->cameras);
  b->names = calloc(nc, sizeof *b->names);
  b->size_px = calloc(nc, sizeof *b->size_px);
  sv_status s =
      b->cameras && b->names && b->size_px ? SV_OK : sv_fail(err, SV_E_NOMEM, "no memory for cameras");
  for (int c = 0; c < o->images.n && s == SV_OK; c++) s = add_camera(&e, b, c, o->images.of[c], err);
  if (s == SV_OK) s = sort_frames(&e, b, err);
  size_t n = (size_t)b->n_cols * (size_t)b->n_rows;
  if (s == SV_OK) {
    b->uv_px = calloc(nc * (size_t)b->n_frames * n * 2, sizeof(double));
    b->is_seen = calloc(nc * (size_t)b->n_frames, 1);
    if (!b->uv_px || !b->is_seen) s = sv_fail(err, SV_E_NOMEM, "no memory for corners");
  }
  for (int i = 0; i < e.n; i++) {
    free(e.all[i].key);
    free(e.all[i].path);
  }
  free(e.all);
  return s;
}

void cal_boards_free(cal_boards *b) {
  for (int c = 0; c < b->n_cameras && b->cameras; c++) {
    for (int i = 0; i < b->cameras[c].n_pictures && b->cameras[c].pictures; i++)
      free(b->cameras[c].pictures[i].path);
    free(b->cameras[c].pictures);
  }
  for (int f = 0; f < b->n_frames && b->frames; f++) free(b->frames[f]);
  free(b->cameras);
  free(b->frames);
  free(b->names);
  free(b->size_px);
  free(b->uv_px);
  free(b->is_seen);
  memset(b, 0, sizeof *b);
}
