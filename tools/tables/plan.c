// SPDX-License-Identifier: Apache-2.0
// Which runs there are: each table is laid out as rows, and a row asks for the runs it averages
// over.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/str.h"
#include "tools/tables/tables.h"

// What a run takes on a nominal machine of two cores: only its share of the whole matters, for the
// time left.
#define NOMINAL_PX     (400.0 * 400.0)
#define NOMINAL_VIEW_S 0.16 // to score a view
#define NOMINAL_CALL_S 0.3
// 1000 steps, 20,000 Gaussians
static const double nominal_s[TABLES_N_DEVICES] = {6.5, 9.5, 6.5, 5.5, 17, 9};

const tables_file *tables_file_of(const tables *t, const tables_setting *s) {
  return &t->scenes[s->i_scene].of[s->device].files[s->i_file];
}

void tables_describe(const tables *t, const tables_run *r, char *out, size_t cap) {
  const tables_setting *s = &r->set;
  double theta = tables_file_of(t, s)->theta_deg;
  char angle[40] = "";
  if (theta > 0) snprintf(angle, sizeof angle, " of %g degrees", theta);
  snprintf(out, cap, "%s, %s%s, %d exposure%s, %ld Gaussians%s%s", t->scenes[s->i_scene].name,
           tables_device_words[s->device], angle, s->n_exposures, s->n_exposures == 1 ? "" : "s",
           s->n_gaussians, s->is_cube ? ", cube" : "", s->is_tv_off ? ", without TV" : "");
}

// --- runs ----------------------------------------------------------------------------------------

static void name_run(const tables *t, tables_run *r) {
  const tables_setting *s = &r->set;
  const tables_scene *sc = &t->scenes[s->i_scene];
  const tables_file *f = tables_file_of(t, s);
  char angle[40] = "", settings[TABLES_CAP_SETTINGS];
  if (f->theta_deg >= 0) snprintf(angle, sizeof angle, "_theta%g", f->theta_deg);
  snprintf(
      settings, sizeof settings,
      "scene %s; file %s %016llx; views %016llx; exposures %d; gaussians %ld; steps %ld; init %s; tv %s; "
      "noise %s%.9g %.9g; seed %ld",
      sc->name, f->transforms, (unsigned long long)f->digest, (unsigned long long)sc->digest, s->n_exposures,
      s->n_gaussians, t->n_steps, s->is_cube ? "cube" : "sphere", s->is_tv_off ? "off" : "on",
      t->o->is_noise_on_prediction ? "prediction " : "", (double)t->o->noise_read, (double)t->o->noise_shot,
      t->seed);
  uint64_t h = tables_hash(TABLES_HASH, settings, strlen(settings));
  snprintf(r->key, sizeof r->key, "%s_%s%s_e%d_g%ld_s%ld%s%s_%08x", sc->name, tables_device_names[s->device],
           angle, s->n_exposures, s->n_gaussians, t->n_steps, s->is_cube ? "_cube" : "",
           s->is_tv_off ? "_notv" : "", (unsigned)(h ^ h >> 32));
}

static bool is_same(const tables_setting *a, const tables_setting *b) {
  return a->i_scene == b->i_scene && a->device == b->device && a->i_file == b->i_file &&
         a->n_exposures == b->n_exposures && a->n_gaussians == b->n_gaussians && a->is_cube == b->is_cube &&
         a->is_tv_off == b->is_tv_off;
}

// The run of these settings, made when it is new; -1 without memory.
static int want_run(tables *t, const tables_setting *s, int split) {
  for (int i = 0; i < t->n_runs; i++)
    if (is_same(&t->runs[i].set, s)) {
      t->runs[i].needs[split] = true;
      return i;
    }
  if (t->n_runs == t->cap_runs) {
    int cap = 2 * t->cap_runs + 32;
    tables_run *p = realloc(t->runs, (size_t)cap * sizeof *p);
    if (!p) return -1;
    t->runs = p;
    t->cap_runs = cap;
  }
  tables_run *r = &t->runs[t->n_runs];
  memset(r, 0, sizeof *r);
  r->set = *s;
  r->needs[split] = true;
  name_run(t, r);
  return t->n_runs++;
}

static void estimate(const tables *t, tables_run *r) {
  const tables_scene *sc = &t->scenes[r->set.i_scene];
  double px = (double)sc->width_px * sc->height_px / NOMINAL_PX;
  double size = 0.4 + 0.6 * (double)r->set.n_gaussians / 20000;
  r->cost = NOMINAL_CALL_S + px * size * nominal_s[r->set.device] * 1e-3 * (double)t->n_steps;
  for (int i = 0; i < TABLES_N_SPLITS; i++)
    if (r->needs[i]) r->cost += NOMINAL_CALL_S + px * NOMINAL_VIEW_S * sc->n_views[i];
}

// --- rows ----------------------------------------------------------------------------------------

static tables_row *add_row(tables *t, tables_id id, int device, int n_exposures, sv_err *err) {
  tables_table *b = &t->tables[id];
  if (b->n == b->cap) {
    int cap = 2 * b->cap + 16;
    tables_row *p = realloc(b->rows, (size_t)cap * sizeof *p);
    if (!p) {
      sv_fail(err, SV_E_NOMEM, "no memory for %d rows", cap);
      return NULL;
    }
    b->rows = p;
    b->cap = cap;
  }
  tables_row *r = &b->rows[b->n++];
  memset(r, 0, sizeof *r);
  r->device = device;
  r->n_exposures = n_exposures;
  r->split = n_exposures == 1 ? TABLES_NEAR : TABLES_TEST;
  return r;
}

// Adds one scene's run to a row. Nothing is added when the scene has no such device or too few
// exposures.
static sv_status add_to_row(tables *t, tables_row *r, tables_setting s, sv_err *err) {
  const tables_capture *c = &t->scenes[s.i_scene].of[s.device];
  if (s.i_file < 0) s.i_file = tables_main_file(c, s.n_exposures);
  if (s.i_file < 0) return SV_OK;
  if (s.n_exposures > c->files[s.i_file].n_exposures || r->n_runs == TABLES_CAP_ROW_RUNS) return SV_OK;
  int i = want_run(t, &s, r->split);
  if (i < 0) return sv_fail(err, SV_E_NOMEM, "no memory for %d runs", t->n_runs + 1);
  r->runs[r->n_runs++] = i;
  return SV_OK;
}

// A row over all scenes with the main file of like.device, -1: of every device. A row without runs
// is taken back.
static sv_status add_mean_row(tables *t, tables_id id, tables_setting like, const char *label, sv_err *err) {
  const int device = like.device;
  tables_row *r = add_row(t, id, device, like.n_exposures, err);
  if (!r) return SV_E_NOMEM;
  sv_copy(r->label, sizeof r->label, label);
  like.i_file = -1;
  for (int i = 0; i < t->n_scenes; i++)
    for (int d = 0; d < TABLES_N_DEVICES; d++) {
      if (device >= 0 && d != device) continue;
      like.i_scene = i;
      like.device = d;
      sv_status s = add_to_row(t, r, like, err);
      if (s != SV_OK) return s;
    }
  r->has_paper = id == TABLE_SUMMARY || id == TABLE_DEPTH;
  if (r->n_runs == 0) t->tables[id].n--;
  return SV_OK;
}

static void list_names(const tables *t, const bool *is_in, char *out, size_t cap) {
  sv_str s = sv_str_make(out, cap);
  for (int i = 0; i < t->n_scenes; i++)
    if (is_in[i]) sv_str_add(&s, "%s%s", s.len ? ", " : "", t->scenes[i].name);
}

// --- the tables ----------------------------------------------------------------------------------

static sv_status plan_summary(tables *t, sv_err *err) {
  sv_status s = SV_OK;
  t->tables[TABLE_SUMMARY] = (tables_table){
      .name = "summary",
      .title = "Image quality, 1 and 3 exposures",
      .text =
          "Means over the scenes. One exposure is scored on the near views (test_near), three on all test "
          "views, as in the paper (its table synthetic-summary, in the last columns)."};
  t->tables[TABLE_DEPTH] = (tables_table){
      .name = "depth",
      .title = "Depth, 1 and 3 exposures",
      .text = "The same runs beside the depth errors of the paper (its table synthetic-depth)."};
  for (int id = TABLE_SUMMARY; id <= TABLE_DEPTH; id++)
    for (int e = 1; e <= 3; e += 2)
      for (int d = 0; d < TABLES_N_DEVICES && s == SV_OK; d++) {
        tables_setting like = {.n_gaussians = t->n_gaussians, .device = d, .n_exposures = e};
        s = add_mean_row(t, (tables_id)id, like, "", err);
      }
  for (int i = 0; i < t->n_runs; i++) t->runs[i].has_views = t->runs[i].set.n_exposures == 1;
  return s;
}

static int find_theta(const tables_capture *c, double theta_deg) {
  for (int i = 0; i < c->n; i++)
    if (fabs(c->files[i].theta_deg - theta_deg) < 1e-9) return i;
  return -1;
}

// Files of devices with several cameras at angles that their names tell.
static int n_angles(const tables_scene *sc) {
  int n = 0;
  for (int d = TABLES_MONO + 1; d < TABLES_N_DEVICES; d++)
    for (int f = 0; f < sc->of[d].n; f++) n += sc->of[d].files[f].theta_deg > 0;
  return n;
}

static bool has_several_angles(const tables_scene *sc) {
  for (int d = TABLES_MONO + 1; d < TABLES_N_DEVICES; d++)
    if (sc->of[d].n > 1 && sc->of[d].files[sc->of[d].n - 2].theta_deg > 0) return true;
  return false;
}

// The scenes that have every angle of the scene with the most; that scene, or -1 when none has two
// of a device.
static int choose_angle_scenes(const tables *t, bool *is_in) {
  int best = -1;
  for (int i = 0; i < t->n_scenes; i++)
    if (has_several_angles(&t->scenes[i]))
      if (best < 0 || n_angles(&t->scenes[i]) > n_angles(&t->scenes[best])) best = i;
  for (int i = 0; i < t->n_scenes; i++) {
    is_in[i] = best >= 0;
    for (int d = TABLES_MONO + 1; d < TABLES_N_DEVICES && is_in[i]; d++) {
      const tables_capture *c = &t->scenes[best].of[d];
      for (int f = 0; f < c->n && is_in[i]; f++)
        is_in[i] = c->files[f].theta_deg <= 0 || find_theta(&t->scenes[i].of[d], c->files[f].theta_deg) >= 0;
    }
  }
  return best;
}

// One point of the curve of a device over the angle.
static sv_status add_angle(tables *t, const bool *is_in, int device, int n_exposures, double theta_deg,
                           sv_err *err) {
  tables_row *r = add_row(t, TABLE_ANGLE, device, n_exposures, err);
  sv_status s = SV_OK;
  if (!r) return SV_E_NOMEM;
  r->x = device == TABLES_MONO ? 0 : theta_deg;
  snprintf(r->label, sizeof r->label, "%g", r->x);
  for (int i = 0; i < t->n_scenes && s == SV_OK; i++) {
    if (!is_in[i] || !t->scenes[i].of[device].n) continue;
    tables_setting set = {.i_scene = i,
                          .device = device,
                          .i_file =
                              device == TABLES_MONO ? -1 : find_theta(&t->scenes[i].of[device], theta_deg),
                          .n_exposures = n_exposures,
                          .n_gaussians = t->n_gaussians};
    s = add_to_row(t, r, set, err);
  }
  if (r->n_runs == 0) t->tables[TABLE_ANGLE].n--;
  return s;
}

static sv_status plan_angles(tables *t, sv_err *err) {
  bool is_in[TABLES_CAP_SCENES];
  char names[300];
  tables_table *b = &t->tables[TABLE_ANGLE];
  sv_status s = SV_OK;
  int best = choose_angle_scenes(t, is_in);
  *b = (tables_table){.name = "angle", .title = "Angular baseline"};
  if (best < 0) {
    sv_copy(b->text, sizeof b->text,
            "No dataset has a device at several angles (transforms_train_DEVICE_thetaT.json).");
    return SV_OK;
  }
  list_names(t, is_in, names, sizeof names);
  snprintf(b->text, sizeof b->text,
           "Angle in degrees between the outermost views of an exposure; 0: monocular. Scenes: %s. The paper "
           "shows these curves without numbers.",
           names);
  for (int e = 1; e <= (t->o->is_quick ? 1 : 3); e += 2)
    for (int d = 0; d < TABLES_N_DEVICES; d++) {
      const tables_capture *c = &t->scenes[best].of[d];
      for (int f = 0; f < c->n && s == SV_OK; f++) {
        bool is_kept = !t->o->is_quick || f == 0 || f == c->n / 2 || f == c->i_main;
        if (d == TABLES_MONO ? f == c->i_main : is_kept && c->files[f].theta_deg > 0)
          s = add_angle(t, is_in, d, e, c->files[f].theta_deg, err);
      }
    }
  return s;
}

// The most exposures that a file of a scene has.
static int most_exposures(const tables_scene *sc) {
  int most = 0;
  for (int d = 0; d < TABLES_N_DEVICES; d++)
    for (int i = 0; i < sc->of[d].n; i++)
      if (sc->of[d].files[i].n_exposures > most) most = sc->of[d].files[i].n_exposures;
  return most;
}

// Points of the curve over the exposures: about evenly spaced by their ratio, and the last.
static bool is_point(const tables *t, int n, int most) {
  static const int points[] = {1, 2, 3, 4, 6, 8, 12, 17, 24, 35, 50, 70, 100};
  if (t->o->is_quick) return n == 1 || n == 3 || n == (most < 8 ? most : 8);
  for (size_t i = 0; i < sizeof points / sizeof *points; i++)
    if (n == points[i]) return true;
  return n == most;
}

static sv_status plan_exposures(tables *t, sv_err *err) {
  bool is_in[TABLES_CAP_SCENES];
  char names[300];
  tables_table *b = &t->tables[TABLE_EXPOSURES];
  sv_status s = SV_OK;
  int most = 0;
  for (int i = 0; i < t->n_scenes; i++)
    if (most_exposures(&t->scenes[i]) > most) most = most_exposures(&t->scenes[i]);
  for (int i = 0; i < t->n_scenes; i++) is_in[i] = most_exposures(&t->scenes[i]) == most;
  list_names(t, is_in, names, sizeof names);
  *b = (tables_table){.name = "exposures", .title = "Number of exposures"};
  snprintf(b->text, sizeof b->text,
           "All on the split test, also a single exposure, so that the curve is one. Scenes: %s. The paper "
           "shows these curves without numbers.",
           names);
  for (int d = 0; d < TABLES_N_DEVICES; d++)
    for (int n = 1; n <= most && s == SV_OK; n++) {
      if (!is_point(t, n, most)) continue;
      tables_row *r = add_row(t, TABLE_EXPOSURES, d, n, err);
      if (!r) return SV_E_NOMEM;
      r->split = TABLES_TEST;
      r->x = n;
      for (int i = 0; i < t->n_scenes && s == SV_OK; i++) {
        tables_setting set = {i, d, -1, n, t->n_gaussians, false, false};
        if (is_in[i]) s = add_to_row(t, r, set, err);
      }
      if (r->n_runs == 0) b->n--;
    }
  return s;
}

static sv_status plan_init(tables *t, sv_err *err) {
  static const int devices[] = {TABLES_MONO, TABLES_LIGHTFIELD, TABLES_STEREO};
  sv_status s = SV_OK;
  t->tables[TABLE_INIT] = (tables_table){
      .name = "init",
      .title = "Start: sphere or cube",
      .text = "One exposure, near views. Random points in a sphere around the object, or in the cube around "
              "the sphere. The paper shows the difference as an image (more floaters from the cube)."};
  for (int k = 0; k < (t->o->is_quick ? 2 : 3) && s == SV_OK; k++)
    for (int is_cube = 0; is_cube < 2 && s == SV_OK; is_cube++) {
      tables_setting like = {
          .n_gaussians = t->n_gaussians, .device = devices[k], .n_exposures = 1, .is_cube = is_cube != 0};
      s = add_mean_row(t, TABLE_INIT, like, is_cube ? "cube" : "sphere", err);
    }
  return s;
}

static sv_status plan_tv(tables *t, sv_err *err) {
  sv_status s = SV_OK;
  t->tables[TABLE_TV] = (tables_table){
      .name = "tv",
      .title = "Total variation",
      .text = "One exposure, near views. With the objective's weights for the device, and with TV off on "
              "training and novel views."};
  for (int d = TABLES_LIGHTFIELD; d <= TABLES_MULTIPLEXED; d++)
    for (int is_off = 0; is_off < 2 && s == SV_OK; is_off++) {
      tables_setting like = {
          .n_gaussians = t->n_gaussians, .device = d, .n_exposures = 1, .is_tv_off = is_off != 0};
      s = add_mean_row(t, TABLE_TV, like, is_off ? "off" : "on", err);
    }
  return s;
}

static sv_status plan_count(tables *t, sv_err *err) {
  sv_status s = SV_OK;
  tables_table *b = &t->tables[TABLE_COUNT];
  *b = (tables_table){.name = "count", .title = "Number of Gaussians"};
  snprintf(b->text, sizeof b->text,
           "One exposure, near views, the same number of steps: %ld Gaussians against %ld. The rows \"all "
           "devices\" are the means over devices and scenes.",
           t->n_gaussians, TABLES_MANY * t->n_gaussians);
  for (int d = 0; d <= TABLES_N_DEVICES; d++) // the last: all of them
    for (int is_many = 0; is_many < 2 && s == SV_OK; is_many++) {
      tables_setting like = {.n_gaussians = t->n_gaussians * (is_many ? TABLES_MANY : 1),
                             .device = d == TABLES_N_DEVICES ? -1 : d,
                             .n_exposures = 1};
      char label[32];
      snprintf(label, sizeof label, "%ld", like.n_gaussians);
      s = add_mean_row(t, TABLE_COUNT, like, label, err);
    }
  return s;
}

sv_status tables_plan(tables *t, sv_err *err) {
  sv_status (*const plans[])(tables *, sv_err *) = {plan_summary, plan_angles, plan_exposures,
                                                    plan_init,    plan_tv,     plan_count};
  sv_status s = SV_OK;
  for (size_t i = 0; i < sizeof plans / sizeof *plans && s == SV_OK; i++) s = plans[i](t, err);
  for (int i = 0; i < t->n_runs; i++) estimate(t, &t->runs[i]);
  return s;
}

void tables_free(tables *t) {
  for (int i = 0; i < N_TABLES; i++) free(t->tables[i].rows);
  free(t->runs);
  free(t->scenes);
}
