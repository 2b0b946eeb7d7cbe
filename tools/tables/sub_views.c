// SPDX-License-Identifier: Apache-2.0
// One's own recordings with several cameras as datasets that the tables of real cameras compare:
// the first sub-view alone against all sub-views of the same exposures.
#include <stdlib.h>
#include <string.h>

#include "src/base/str.h"
#include "tools/import/import.h"
#include "tools/tables/tables.h"

#define HELD_OUT_EVERY 8 // exposures

// What is trained on by the first camera, by all, and scored.
typedef struct {
  lab_import mono, rig, test;
} parts;

static void free_parts(parts *p) {
  lab_import_free(&p->mono);
  lab_import_free(&p->rig);
  lab_import_free(&p->test);
}

static sv_status copy(lab_import *to, const lab_import_view *v, sv_err *err) {
  lab_import_view *o = lab_import_add(to);
  if (!o) return sv_fail(err, SV_E_NOMEM, "no memory for %d views", to->n + 1);
  *o = *v;
  o->time = -1; // a still scene
  *o->split = 0;
  return SV_OK;
}

static int compare_exposures(const void *a, const void *b) {
  const lab_import_view *x = a, *y = b;
  if (x->exposure != y->exposure) return (x->exposure > y->exposure) - (x->exposure < y->exposure);
  return (x->sub_view > y->sub_view) - (x->sub_view < y->sub_view);
}

static bool is_held_out(const lab_import_view *v, bool has_marks, int i_exposure) {
  if (has_marks) return *v->split && !sv_str_eq(v->split, "train");
  return i_exposure % HELD_OUT_EVERY == 0;
}

// Whole exposures are held out: no other camera of theirs is trained on.
static sv_status divide(parts *p, lab_import *all, const char *given, sv_err *err) {
  bool has_marks = false;
  int first = all->n ? all->views[0].sub_view : 0, i_exposure = -1, n_others = 0;
  for (int i = 0; i < all->n; i++) {
    const lab_import_view *v = &all->views[i];
    if (v->exposure < 0 || v->sub_view < 0)
      return sv_fail(err, SV_E_FORMAT, "%.150s: frame %.60s has no \"exposure\" and \"sub_view\"", given,
                     v->name);
    has_marks |= *v->split && !sv_str_eq(v->split, "train");
    if (v->sub_view < first) first = v->sub_view;
  }
  qsort(all->views, (size_t)all->n, sizeof *all->views, compare_exposures);
  sv_status s = SV_OK;
  for (int i = 0; i < all->n && s == SV_OK; i++) {
    const lab_import_view *v = &all->views[i];
    i_exposure += i == 0 || v->exposure != all->views[i - 1].exposure;
    const bool is_test = is_held_out(v, has_marks, i_exposure);
    n_others += !is_test && v->sub_view != first;
    s = copy(is_test ? &p->test : &p->rig, v, err);
    if (s == SV_OK && !is_test && v->sub_view == first) s = copy(&p->mono, v, err);
  }
  if (s == SV_OK && (!p->mono.n || !n_others || !p->test.n))
    s = sv_fail(err, SV_E_NOT_FOUND,
                "%.150s: --sub-views needs two exposures of two sub-views, one of them to be held out",
                given);
  return s;
}

// All three have the points of the recording.
static sv_status write_parts(tables *t, parts *p, const lab_import *all, const char *folder, sv_err *err) {
  p->mono.unit = p->rig.unit = p->test.unit = all->unit;
  sv_status s = lab_import_write_as(&p->test, &t->session, folder, "transforms_test.json", err);
  for (int k = 0; k < 2 && s == SV_OK; k++) {
    lab_import part = k ? p->rig : p->mono; // without owning the points
    part.points = all->points;
    part.n_points = all->n_points;
    s = lab_import_write_as(&part, &t->session, folder,
                            k ? "transforms_train_rig.json" : "transforms_train_mono.json", err);
  }
  return s;
}

static sv_status add_recording(tables *t, const char *given, const char *out, sv_err *err) {
  char folder[SV_CAP_PATH], name[120];
  lab_import all = {0};
  parts p = {0};
  const char *end = given + strlen(given);
  while (end > given && end[-1] == '/') end--;
  const char *begin = end;
  while (begin > given && begin[-1] != '/') begin--;
  snprintf(name, sizeof name, "casual_%.*s_own", (int)(end - begin) < 80 ? (int)(end - begin) : 80, begin);
  sv_status s = lab_import_transforms(&all, given, err);
  if (s == SV_OK) s = divide(&p, &all, given, err);
  if (s == SV_OK) s = sv_path_join(folder, sizeof folder, out, name, err);
  if (s == SV_OK) s = sv_path_make_folder(folder, err);
  if (s == SV_OK) s = write_parts(t, &p, &all, folder, err);
  if (s == SV_OK)
    lab_say(&t->session, "%s: %d views of one camera, %d of all, %d held out", given, p.mono.n, p.rig.n,
            p.test.n);
  free_parts(&p);
  lab_import_free(&all);
  return s;
}

sv_status tables_sub_views(tables *t, char out[SV_CAP_PATH], sv_err *err) {
  sv_status s = sv_path_join(out, SV_CAP_PATH, t->out, "data", err);
  if (s == SV_OK) s = sv_path_make_folder(out, err);
  for (const char *p = t->o->data; s == SV_OK && *p;) {
    char given[SV_CAP_PATH];
    const size_t n = strcspn(p, ",");
    if (n == 0 || n >= sizeof given)
      return sv_fail(err, SV_E_RANGE, "--data is a list of folders separated by commas; one cannot be used");
    memcpy(given, p, n);
    given[n] = 0;
    s = add_recording(t, given, out, err);
    p += n + (p[n] == ',');
  }
  return s;
}
