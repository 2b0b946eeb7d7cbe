// SPDX-License-Identifier: Apache-2.0
#include "tools/import/release.h"

#include <ctype.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/str.h"

// --- names ---------------------------------------------------------------------------------------

static bool is_alone(const char *text, size_t at, size_t n) {
  return (at == 0 || !isalnum((unsigned char)text[at - 1])) && !isalnum((unsigned char)text[at + n]);
}

bool lab_release_has_word(const char *text, const char *word) {
  const size_t n = strlen(word), n_text = strlen(text);
  for (size_t at = 0; at + n <= n_text; at++) {
    size_t k = 0;
    while (k < n && tolower((unsigned char)text[at + k]) == word[k]) k++;
    if (k == n && is_alone(text, at, n)) return true;
  }
  return false;
}

bool lab_release_is_named(const sv_names *names, const char *name) {
  for (int i = 0; i < names->n; i++)
    if (sv_str_eq(names->names[i], name)) return true;
  return false;
}

// Adds a copy of n characters of text.
static bool add_name(sv_names *names, const char *text, size_t n) {
  char **more = realloc(names->names, ((size_t)names->n + 1) * sizeof *more);
  if (!more) return false;
  names->names = more;
  more[names->n] = strndup(text, n);
  return more[names->n++] != NULL;
}

sv_status lab_release_names(sv_names *out, const char *folder, const char *file, sv_err *err) {
  char path[SV_CAP_PATH];
  void *data;
  size_t bytes;
  bool is_good = true;
  *out = (sv_names){0};
  sv_status s = sv_path_join(path, sizeof path, folder, file, err);
  if (s != SV_OK || !sv_path_exists(path)) return s;
  s = sv_file_read(path, &data, &bytes, err);
  if (s != SV_OK) return s;
  const char *p = data, *end = p + bytes;
  while (p < end && is_good) {
    const char *line_end = memchr(p, '\n', (size_t)(end - p)), *last = line_end ? line_end : end;
    const char *next = last + 1;
    const char *comment = memchr(p, '#', (size_t)(last - p));
    if (comment) last = comment;
    while (p < last && isspace((unsigned char)*p)) p++;
    while (last > p && isspace((unsigned char)last[-1])) last--;
    if (last > p) is_good = add_name(out, p, (size_t)(last - p));
    p = next;
  }
  free(data);
  if (is_good) return SV_OK;
  sv_names_free(out);
  return sv_fail(err, SV_E_NOMEM, "%s: no memory for its names", path);
}

// --- views ---------------------------------------------------------------------------------------

void lab_release_reduce_model(sv_camera_model *m, int k) {
  for (int i = 0; i < 4; i++) m->p[i] /= k;
  m->width_px /= k;
  m->height_px /= k;
}

sv_status lab_release_copy(lab_import *to, const lab_import_view *v, sv_err *err) {
  lab_import_view *o = lab_import_add(to);
  if (!o) return sv_fail(err, SV_E_NOMEM, "no memory for %d views", to->n + 1);
  *o = *v;
  return SV_OK;
}

// --- folders -------------------------------------------------------------------------------------

sv_status lab_release_folder(const lab_release *r, char out[SV_CAP_PATH], const char *const name[3],
                             sv_err *err) {
  char folder[200];
  sv_str s = sv_str_make(folder, sizeof folder);
  for (int i = 0; i < 3 && name[i]; i++) sv_str_add(&s, "%s%s", i ? "_" : "", name[i]);
  if (s.is_cut) return sv_fail(err, SV_E_RANGE, "%.80s...: the name of the scene is too long", folder);
  sv_status st = sv_path_join(out, SV_CAP_PATH, r->out, folder, err);
  return st == SV_OK ? sv_path_make_folder(out, err) : st;
}

void lab_release_made(lab_release *r, const char *folder, const char *fmt, ...) {
  char text[200];
  va_list ap;
  va_start(ap, fmt);
  sv_vfmt(text, sizeof text, fmt, ap);
  va_end(ap);
  lab_say(r->se, "%s: %s", folder, text);
  r->n_made++;
}

sv_status lab_release_scenes(lab_release *r, const char *kind, lab_release_scene_fn *fn, sv_err *err) {
  char folder[SV_CAP_PATH], scene[SV_CAP_PATH];
  sv_names names;
  sv_status s = sv_path_join(folder, sizeof folder, r->data, kind, err);
  if (s != SV_OK || !sv_path_is_folder(folder)) return s;
  s = sv_folder_list(folder, &names, err);
  if (s != SV_OK) return s;
  for (int i = 0; i < names.n && s == SV_OK; i++) {
    s = sv_path_join(scene, sizeof scene, folder, names.names[i], err);
    if (s == SV_OK && lab_is_stopped(r->se)) s = SV_E_INTERRUPTED;
    if (s == SV_OK && sv_path_is_folder(scene)) s = fn(r, scene, names.names[i], err);
  }
  sv_names_free(&names);
  return s;
}

static bool is_release(const char *dir) {
  static const char *const kinds[] = {"casual", "dynamic", "multiplexed", "synthetic"};
  char path[SV_CAP_PATH];
  for (size_t i = 0; i < sizeof kinds / sizeof *kinds; i++)
    if (sv_path_join(path, sizeof path, dir, kinds[i], NULL) == SV_OK && sv_path_is_folder(path)) return true;
  return false;
}

sv_status lab_import_release(const lab_options *o, lab_session *se, sv_err *err) {
  sv_status (*const parts[])(lab_release *, sv_err *) = {lab_release_static, lab_release_casual,
                                                         lab_release_dynamic, lab_release_synthetic,
                                                         lab_release_multiplexed};
  char data[SV_CAP_PATH];
  lab_release r = {.se = se, .data = data, .out = o->out};
  sv_status s = sv_path_join(data, sizeof data, o->input, "data", err);
  if (s == SV_OK && !is_release(data)) sv_copy(data, sizeof data, o->input);
  if (s == SV_OK && !is_release(data))
    s = sv_fail(err, SV_E_NOT_FOUND, "%.150s: none of the folders casual, dynamic, multiplexed, synthetic",
                o->input);
  if (s == SV_OK) s = lab_session_folder(se, o->out, err);
  for (size_t i = 0; i < sizeof parts / sizeof *parts && s == SV_OK; i++) s = parts[i](&r, err);
  if (s == SV_OK && r.n_without_poses)
    lab_say(se,
            "%d captures have no poses yet and were left out: the authors' prepare, or COLMAP, finds them",
            r.n_without_poses);
  if (s == SV_OK && !r.n_made)
    s = sv_fail(err, SV_E_NOT_FOUND,
                "%.120s: no capture has poses yet; run the authors' prepare on it, or COLMAP", o->input);
  if (s == SV_OK) lab_say(se, "%d datasets; next: subview-lab tables --data %s --out DIR", r.n_made, o->out);
  return s;
}
