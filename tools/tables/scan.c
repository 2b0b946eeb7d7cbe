// SPDX-License-Identifier: Apache-2.0
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/str.h"
#include "tools/tables/tables.h"

const char *const tables_device_names[TABLES_N_DEVICES] = {"mono", "phone", "stereo", "lightfield",
                                                           "multiplexed"};
const char *const tables_device_words[TABLES_N_DEVICES] = {"monocular", "phone", "stereo", "light field",
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

// --- transforms_train_DEVICE[_thetaT].json -------------------------------------------------------

// Which device a file is of, -1: none.
static int device_of(const char *name, double *theta_deg) {
  static const char head[] = "transforms_train_", tail[] = ".json", angle[] = "_theta";
  size_t n = strlen(name), n_head = sizeof head - 1, n_tail = sizeof tail - 1;
  if (n < n_head + n_tail || strncmp(name, head, n_head) != 0 || strcmp(name + n - n_tail, tail) != 0)
    return -1;
  const char *word = name + n_head, *end = name + n - n_tail;
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

static sv_status add_file(tables_scene *sc, int device, double theta_deg, const char *name, sv_err *err) {
  tables_capture *c = &sc->of[device];
  if (c->n == TABLES_CAP_FILES)
    return sv_fail(err, SV_E_RANGE, "%s: more than %d files transforms_train_%s...json", sc->folder,
                   TABLES_CAP_FILES, tables_device_names[device]);
  int at = c->n++;
  for (; at > 0 && c->files[at - 1].theta_deg > theta_deg; at--) c->files[at] = c->files[at - 1];
  tables_file *f = &c->files[at];
  *f = (tables_file){.theta_deg = theta_deg};
  if (!sv_copy(f->transforms, sizeof f->transforms, name))
    return sv_fail(err, SV_E_RANGE, "%.80s...: the name of the transforms file is too long", name);
  return read_file(f, sc->folder, err);
}

// The paper's angle if it is there, else the widest.
static void choose_main(tables_capture *c) {
  c->i_main = c->n - 1;
  for (int i = 0; i < c->n; i++)
    if (fabs(c->files[i].theta_deg - TABLES_THETA_DEG) < 1e-9) c->i_main = i;
}

// --- held-out views ------------------------------------------------------------------------------

static sv_status read_split(tables_scene *sc, const char *transforms, int split, sv_err *err) {
  lab_views v;
  sv_pool serial = sv_pool_serial();
  lab_source src = {.folder = sc->folder,
                    .transforms = transforms,
                    .split = tables_split_names[split],
                    .n_exposures = split == TABLES_NEAR ? 1 : 0,
                    .scale = 1};
  sv_status s = lab_views_open(&v, &src, &serial, err);
  if (s != SV_OK) return s;
  sc->n_views[split] = v.n;
  sc->width_px = v.cap_width_px;
  sc->height_px = v.cap_height_px;
  sc->has_depth = v.has_depth;
  for (int i = 1; i < v.n; i++) sc->is_dynamic |= v.frames[i].f.time != v.frames[0].f.time;
  s = tables_hash_file(&sc->digest, v.frames[0].path, err);
  lab_views_free(&v);
  return s;
}

static sv_status read_scene(tables_scene *sc, sv_err *err) {
  sv_names names;
  int n = 0;
  const char *any = NULL;
  sv_status s = sv_folder_list(sc->folder, &names, err);
  if (s != SV_OK) return s;
  for (int i = 0; i < names.n && s == SV_OK; i++) {
    double theta_deg;
    int device = device_of(names.names[i], &theta_deg);
    if (device < 0) continue;
    s = add_file(sc, device, theta_deg, names.names[i], err);
    n++;
  }
  sv_names_free(&names);
  if (s != SV_OK) return s;
  if (n == 0)
    return sv_fail(err, SV_E_NOT_FOUND,
                   "%s: has no file transforms_train_DEVICE.json or transforms_train_DEVICE_thetaT.json "
                   "(mono, phone, stereo, lightfield, multiplexed)",
                   sc->folder);
  for (int i = 0; i < TABLES_N_DEVICES; i++) {
    choose_main(&sc->of[i]);
    if (sc->of[i].n && !any) any = sc->of[i].files[sc->of[i].i_main].transforms;
  }
  // Without it views would be taken from the training file, and each device would be scored on
  // others.
  char test[SV_CAP_PATH];
  s = sv_path_join(test, sizeof test, sc->folder, "transforms_test.json", err);
  if (s == SV_OK && !sv_path_exists(test))
    return sv_fail(err, SV_E_NOT_FOUND, "%s: has no transforms_test.json to score the devices on",
                   sc->folder);
  sc->digest = TABLES_HASH;
  for (int i = 0; i < TABLES_N_SPLITS && s == SV_OK; i++) s = read_split(sc, any, i, err);
  return s;
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

static sv_status add_scene(tables *t, const char *name, size_t n, sv_err *err) {
  char given[SV_CAP_PATH];
  tables_scene *sc = &t->scenes[t->n_scenes];
  if (n == 0)
    return sv_fail(err, SV_E_RANGE, "--data is a list of folders separated by commas; one of them is empty");
  if (n >= sizeof given) return sv_fail(err, SV_E_RANGE, "%.80s...: the path is too long", name);
  memcpy(given, name, n);
  given[n] = 0;
  char *real = realpath(given, NULL);
  bool is_good = real && sv_path_is_folder(real), is_short = real && sv_copy(sc->folder, SV_CAP_PATH, real);
  free(real);
  if (!is_good) return sv_fail(err, SV_E_NOT_FOUND, "%.150s: no such folder; expected a dataset", given);
  if (!is_short) return sv_fail(err, SV_E_RANGE, "%.80s...: the path is too long", given);
  for (int i = 0; i < t->n_scenes; i++)
    if (sv_str_eq(t->scenes[i].folder, sc->folder))
      return sv_fail(err, SV_E_RANGE, "--data names the folder %.150s twice", given);
  name_scene(t, sc);
  t->n_scenes++;
  return read_scene(sc, err);
}

sv_status tables_scan(tables *t, const char *list, sv_err *err) {
  t->scenes = calloc(TABLES_CAP_SCENES, sizeof *t->scenes);
  if (!t->scenes) return sv_fail(err, SV_E_NOMEM, "no memory for the list of datasets");
  for (const char *p = list;;) {
    size_t n = strcspn(p, ",");
    if (t->n_scenes == TABLES_CAP_SCENES)
      return sv_fail(err, SV_E_RANGE, "--data names more than %d folders", TABLES_CAP_SCENES);
    sv_status s = add_scene(t, p, n, err);
    if (s != SV_OK) return s;
    if (!p[n]) break;
    p += n + 1;
    if (t->o->is_quick) break; // one scene: the first
  }
  return SV_OK;
}
