// SPDX-License-Identifier: Apache-2.0
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/str.h"
#include "tools/tables/tables.h"

const char *const tables_device_names[TABLES_N_DEVICES] = {"mono",       "phone",       "stereo",
                                                           "lightfield", "multiplexed", "rig"};
const char *const tables_device_words[TABLES_N_DEVICES] = {"monocular",   "phone",       "stereo",
                                                           "light field", "multiplexed", "all cameras"};
const char *const tables_kind_names[TABLES_N_KINDS] = {"synthetic", "static", "casual", "dynamic",
                                                       "multiplexed"};
const char *const tables_split_names[TABLES_N_SPLITS] = {"test_near", "test"};
const char *const tables_figure_words[TABLES_N_FIGURES] = {"PSNR", "SSIM", "LPIPS", "AbsRel", "RMSE"};

uint64_t tables_hash(uint64_t h, const void *data, size_t bytes) {
  for (const uint8_t *p = data, *end = p + bytes; p < end; p++) h = (h ^ *p) * 0x100000001b3u;
  return h;
}

sv_status tables_hash_file(uint64_t *h, const char *path, sv_err *err) {
  void *data;
  size_t bytes;
  sv_status s = sv_file_read(path, &data, &bytes, err);
  if (s != SV_OK) return s;
  *h = tables_hash(*h, data, bytes);
  free(data);
  return SV_OK;
}

// --- transforms_train_DEVICE[_thetaT][_Nviews].json ----------------------------------------------

// Takes _Nviews from the end of a name.
static const char *take_views(const char *word, const char *end, int *n_only) {
  static const char tail[] = "views";
  const size_t n_tail = sizeof tail - 1;
  const char *digits = end - n_tail;
  *n_only = 0;
  if (digits < word || strncmp(digits, tail, n_tail) != 0) return end;
  const char *at = digits;
  while (at > word && at[-1] >= '0' && at[-1] <= '9') at--;
  long long n;
  if (at == word || at[-1] != '_' || !sv_parse_int(at, (size_t)(digits - at), &n) || n < 1 || n > 1000)
    return end;
  *n_only = (int)n;
  return at - 1;
}

// Which device a file is of, -1: none.
static int device_of(const char *name, double *theta_deg, int *n_only) {
  static const char head[] = "transforms_train_", tail[] = ".json", angle[] = "_theta";
  size_t n = strlen(name), n_head = sizeof head - 1, n_tail = sizeof tail - 1;
  if (n < n_head + n_tail || strncmp(name, head, n_head) != 0 || strcmp(name + n - n_tail, tail) != 0)
    return -1;
  const char *word = name + n_head, *end = take_views(word, name + n - n_tail, n_only);
  for (int i = 0; i < TABLES_N_DEVICES; i++) {
    size_t k = strlen(tables_device_names[i]);
    if ((size_t)(end - word) < k || strncmp(word, tables_device_names[i], k) != 0) continue;
    const char *rest = word + k;
    *theta_deg = -1;
    if (rest == end) return i;
    if ((size_t)(end - rest) < sizeof angle || strncmp(rest, angle, sizeof angle - 1) != 0) continue;
    rest += sizeof angle - 1;
    if (sv_parse_double(rest, (size_t)(end - rest), theta_deg) && *theta_deg >= 0) return i;
  }
  return -1;
}

static int compare_ints(const void *a, const void *b) {
  int x = *(const int *)a, y = *(const int *)b;
  return (x > y) - (x < y);
}

// Opens all of its training views, so that a missing image is found before the first run.
static sv_status read_file(tables_file *f, const char *folder, sv_err *err) {
  char path[SV_CAP_PATH];
  lab_views v;
  sv_pool serial = sv_pool_serial();
  lab_source src = {
      .folder = folder, .transforms = f->transforms, .split = "train", .is_multiplexed = true, .scale = 1};
  sv_status s = lab_views_open(&v, &src, &serial, err);
  if (s != SV_OK) return s;
  int *id = malloc((size_t)v.n * sizeof *id);
  if (id) {
    for (int i = 0; i < v.n; i++) id[i] = v.frames[i].f.exposure;
    qsort(id, (size_t)v.n, sizeof *id, compare_ints);
    for (int i = 0; i < v.n; i++) f->n_exposures += id[i] < 0 || i == 0 || id[i] != id[i - 1];
  } else s = sv_fail(err, SV_E_NOMEM, "%s: no memory for its exposures", f->transforms);
  free(id);
  lab_views_free(&v);
  f->digest = TABLES_HASH;
  if (s == SV_OK) s = sv_path_join(path, sizeof path, folder, f->transforms, err);
  return s == SV_OK ? tables_hash_file(&f->digest, path, err) : s;
}

static sv_status add_file(tables_scene *sc, int device, tables_file like, const char *name, sv_err *err) {
  tables_capture *c = &sc->of[device];
  const double theta_deg = like.theta_deg;
  if (c->n == TABLES_CAP_FILES)
    return sv_fail(err, SV_E_RANGE, "%s: more than %d files transforms_train_%s...json", sc->folder,
                   TABLES_CAP_FILES, tables_device_names[device]);
  int at = c->n++;
  for (; at > 0 && c->files[at - 1].theta_deg > theta_deg; at--) c->files[at] = c->files[at - 1];
  tables_file *f = &c->files[at];
  *f = like;
  if (!sv_copy(f->transforms, sizeof f->transforms, name))
    return sv_fail(err, SV_E_RANGE, "%.80s...: the name of the transforms file is too long", name);
  return read_file(f, sc->folder, err);
}

// Of two files for the same runs: the paper's angle goes before the widest, a file for just so many
// exposures before one for all.
static bool is_better(const tables_file *a, const tables_file *b) {
  const bool a_is_paper = fabs(a->theta_deg - TABLES_THETA_DEG) < 1e-9,
             b_is_paper = fabs(b->theta_deg - TABLES_THETA_DEG) < 1e-9;
  if (a_is_paper != b_is_paper) return a_is_paper;
  if (!a->n_only != !b->n_only) return a->n_only != 0;
  return a->theta_deg >= b->theta_deg;
}

int tables_main_file(const tables_capture *c, int n_exposures) {
  int best = -1;
  for (int i = 0; i < c->n; i++) {
    const tables_file *f = &c->files[i];
    if (f->n_exposures < n_exposures || (f->n_only && f->n_only != n_exposures)) continue;
    if (best < 0 || is_better(f, &c->files[best])) best = i;
  }
  return best;
}

static void choose_main(tables_capture *c) {
  c->i_main = tables_main_file(c, 1);
  if (c->i_main < 0) c->i_main = c->n - 1;
}

// --- held-out views ------------------------------------------------------------------------------

// transforms: a training file, by which views near it are found.
static sv_status read_split(tables_scene *sc, const char *transforms, const char *name, int split,
                            sv_err *err) {
  lab_views v;
  sv_pool serial = sv_pool_serial();
  lab_source src = {.folder = sc->folder,
                    .transforms = transforms,
                    .split = name,
                    .n_exposures = split == TABLES_NEAR ? 1 : 0,
                    .scale = 1};
  sv_status s = lab_views_open(&v, &src, &serial, err);
  if (s != SV_OK) return s;
  sc->n_views[split] = v.n;
  sc->width_px = v.cap_width_px;
  sc->height_px = v.cap_height_px;
  sc->has_depth = v.has_depth;
  for (int i = 1; i < v.n; i++)
    if (v.frames[i].f.time != v.frames[0].f.time) sc->kind = TABLES_DYNAMIC;
  s = tables_hash_file(&sc->digest, v.frames[0].path, err);
  lab_views_free(&v);
  return s;
}

static bool has_device_file(const char *folder) {
  sv_names names;
  double theta_deg;
  int n_only;
  bool is_found = false;
  if (sv_folder_list(folder, &names, NULL) != SV_OK) return false;
  for (int i = 0; i < names.n; i++) is_found |= device_of(names.names[i], &theta_deg, &n_only) >= 0;
  sv_names_free(&names);
  return is_found;
}

static sv_status read_devices(tables_scene *sc, sv_err *err) {
  sv_names names;
  sv_status s = sv_folder_list(sc->folder, &names, err);
  if (s != SV_OK) return s;
  for (int i = 0; i < names.n && s == SV_OK; i++) {
    tables_file like = {.n_exposures = 0};
    const int device = device_of(names.names[i], &like.theta_deg, &like.n_only);
    if (device >= 0) s = add_file(sc, device, like, names.names[i], err);
  }
  sv_names_free(&names);
  return s;
}

// What is scored, and with it the kind of the scene. Without transforms_test.json views would be
// taken from the training file, and each device would be scored on others; held-out times of the
// one camera that all devices share are told by their marks.
static sv_status read_held_out(tables_scene *sc, const char *any, sv_err *err) {
  char test[SV_CAP_PATH];
  sv_err why;
  sv_status s = sv_path_join(test, sizeof test, sc->folder, "transforms_test.json", err);
  if (s != SV_OK) return s;
  const bool has_test = sv_path_exists(test);
  if (!has_test && sc->of[TABLES_MONO].n) {
    s = read_split(sc, any, "test_time", TABLES_TEST, &why);
    sc->n_views[TABLES_TEST] = 0;
    sc->kind = TABLES_DYNAMIC;
    if (s == SV_OK) return s;
  }
  int n_others = 0;
  for (int i = 0; i < TABLES_N_DEVICES; i++) n_others += i != TABLES_MULTIPLEXED && sc->of[i].n;
  if (!has_test && !n_others) {
    sc->kind = TABLES_SENSOR;
    return SV_OK;
  }
  if (!has_test)
    return sv_fail(err, SV_E_NOT_FOUND, "%s: has no transforms_test.json to score the devices on",
                   sc->folder);
  const bool is_real = sc->kind == TABLES_STATIC || sc->kind == TABLES_CASUAL;
  if (!is_real) s = read_split(sc, any, tables_split_names[TABLES_NEAR], TABLES_NEAR, err);
  return s == SV_OK ? read_split(sc, any, tables_split_names[TABLES_TEST], TABLES_TEST, err) : s;
}

static sv_status read_scene(tables_scene *sc, sv_err *err) {
  const char *any = NULL;
  sv_status s = read_devices(sc, err);
  if (s != SV_OK) return s;
  for (int i = 0; i < TABLES_N_DEVICES; i++) {
    choose_main(&sc->of[i]);
    if (sc->of[i].n && !any) any = sc->of[i].files[sc->of[i].i_main].transforms;
  }
  sc->digest = TABLES_HASH;
  if (any) return read_held_out(sc, any, err);
  return sv_fail(err, SV_E_NOT_FOUND,
                 "%s: has no file transforms_train_DEVICE.json or transforms_train_DEVICE_thetaT.json "
                 "(mono, phone, stereo, lightfield, multiplexed), nor datasets that do",
                 sc->folder);
}

// --- the list ------------------------------------------------------------------------------------

// The folder's name, made different from those before it; without what would trouble a table or a
// file name.
static void name_scene(tables *t, tables_scene *sc) {
  char base[TABLES_CAP_NAME];
  const char *name = sv_path_name(sc->folder);
  if (strncmp(name, "blender_", 8) == 0 && name[8]) name += 8;
  sv_copy(base, sizeof base - 4, *name ? name : "dataset");
  for (char *p = base; *p; p++)
    if (!strchr("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789-.", *p)) *p = '_';
  sv_copy(sc->name, sizeof sc->name, base);
  for (int k = 2, i = 0; i < t->n_scenes; i++)
    if (&t->scenes[i] != sc && sv_str_eq(t->scenes[i].name, sc->name)) {
      sv_fmt(sc->name, sizeof sc->name, "%.40s-%d", base, k++);
      i = -1;
    }
}

// KIND_SCENE[_CAPTURE], as `import --from lightfield-release` names them.
static void split_name(tables_scene *sc) {
  const char *name = sv_path_name(sc->folder);
  sv_copy(sc->subject, sizeof sc->subject, sc->name);
  for (int k = 0; k < TABLES_N_KINDS; k++) {
    const size_t n = strlen(tables_kind_names[k]);
    if (strncmp(name, tables_kind_names[k], n) != 0 || name[n] != '_') continue;
    sc->kind = (tables_kind)k;
    const char *last = strrchr(name + n + 1, '_');
    if (!last || k == TABLES_SYNTHETIC) last = name + strlen(name);
    snprintf(sc->subject, sizeof sc->subject, "%.*s", (int)(last - name - (ptrdiff_t)n - 1), name + n + 1);
    snprintf(sc->capture, sizeof sc->capture, "%.15s", *last ? last + 1 : "");
  }
}

static sv_status add_dataset(tables *t, const char *folder, const char *given, sv_err *err) {
  if (t->n_scenes == TABLES_CAP_SCENES)
    return sv_fail(err, SV_E_RANGE, "--data names more than %d datasets", TABLES_CAP_SCENES);
  tables_scene *sc = &t->scenes[t->n_scenes];
  sv_copy(sc->folder, sizeof sc->folder, folder);
  for (int i = 0; i < t->n_scenes; i++)
    if (sv_str_eq(t->scenes[i].folder, sc->folder))
      return sv_fail(err, SV_E_RANGE, "--data names the folder %.150s twice", given);
  name_scene(t, sc);
  split_name(sc);
  t->n_scenes++;
  return read_scene(sc, err);
}

// The datasets in a folder, or the folder itself.
static sv_status add_folder(tables *t, const char *folder, const char *given, sv_err *err) {
  char inner[SV_CAP_PATH];
  sv_names names;
  int n = 0;
  if (has_device_file(folder)) return add_dataset(t, folder, given, err);
  sv_status s = sv_folder_list(folder, &names, err);
  if (s != SV_OK) return s;
  for (int i = 0; i < names.n && s == SV_OK; i++) {
    s = sv_path_join(inner, sizeof inner, folder, names.names[i], err);
    if (s != SV_OK || !sv_path_is_folder(inner) || !has_device_file(inner)) continue;
    s = add_dataset(t, inner, given, err);
    n++;
  }
  sv_names_free(&names);
  return s == SV_OK && !n ? add_dataset(t, folder, given, err) : s;
}

static sv_status add_scene(tables *t, const char *name, size_t n, sv_err *err) {
  char given[SV_CAP_PATH], folder[SV_CAP_PATH];
  if (n == 0)
    return sv_fail(err, SV_E_RANGE, "--data is a list of folders separated by commas; one of them is empty");
  if (n >= sizeof given) return sv_fail(err, SV_E_RANGE, "%.80s...: the path is too long", name);
  memcpy(given, name, n);
  given[n] = 0;
  char *real = realpath(given, NULL);
  bool is_good = real && sv_path_is_folder(real), is_short = real && sv_copy(folder, SV_CAP_PATH, real);
  free(real);
  if (!is_good) return sv_fail(err, SV_E_NOT_FOUND, "%.150s: no such folder; expected a dataset", given);
  if (!is_short) return sv_fail(err, SV_E_RANGE, "%.80s...: the path is too long", given);
  return add_folder(t, folder, given, err);
}

sv_status tables_scan(tables *t, const char *list, sv_err *err) {
  t->scenes = calloc(TABLES_CAP_SCENES, sizeof *t->scenes);
  if (!t->scenes) return sv_fail(err, SV_E_NOMEM, "no memory for the list of datasets");
  for (const char *p = list;;) {
    size_t n = strcspn(p, ",");
    sv_status s = add_scene(t, p, n, err);
    if (s != SV_OK) return s;
    if (!p[n]) break;
    p += n + 1;
    if (t->o->is_quick) break; // one scene: the first
  }
  return SV_OK;
}
