// SPDX-License-Identifier: Apache-2.0
#include "tools/import/find.h"

#include <errno.h>
#include <limits.h>
#include <spawn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>
#include <sys/wait.h>

#include "src/base/str.h"
#include "tools/import/import.h"
#include "tools/import/recording.h"

#define NOTE_END ".from" // OUT/data.from tells what OUT/data comes from
#define CAP_NOTE (2 * PATH_MAX + 100)

extern char **environ;

typedef enum { NOTHING, DATASET, COLMAP, CAPTURE, BOARD, QCA, CLIPS, PICTURES } kind;

static const char *const kind_names[] = {"nothing",
                                         "a dataset",
                                         "a COLMAP folder",
                                         "a capture",
                                         "a recording with camera_array.toml",
                                         "a recording with a Qualisys calibration",
                                         "clips of several cameras",
                                         "pictures of a rig's cameras"};

static bool has(const char *dir, const char *name, char path[SV_CAP_PATH]) {
  return sv_path_join(path, SV_CAP_PATH, dir, name, NULL) == SV_OK && sv_path_exists(path);
}

static bool has_clips(const char *dir) {
  sv_names names;
  int n = 0;
  if (sv_folder_list(dir, &names, NULL) != SV_OK) return false;
  for (int i = 0; i < names.n; i++) n += lab_import_is_clip(names.names[i]);
  sv_names_free(&names);
  return n > 1;
}

static bool is_picture(const char *name) {
  const char *end = sv_path_extension(name);
  return !strcasecmp(end, ".jpg") || !strcasecmp(end, ".jpeg") || !strcasecmp(end, ".png");
}

static bool has_pictures(const char *dir) {
  sv_names names;
  bool is_found = false;
  if (sv_folder_list(dir, &names, NULL) != SV_OK) return false;
  for (int i = 0; i < names.n; i++) is_found |= is_picture(names.names[i]);
  sv_names_free(&names);
  return is_found;
}

static bool has_folders_of_pictures(const char *dir, char newest[SV_CAP_PATH]) {
  char path[SV_CAP_PATH], rig[SV_CAP_PATH];
  struct stat st, last = {0};
  sv_names names;
  int n = 0;
  if (sv_folder_list(dir, &names, NULL) != SV_OK) return false;
  for (int i = 0; i < names.n; i++) {
    if (!has(dir, names.names[i], path) || stat(path, &st) != 0 || !S_ISDIR(st.st_mode) ||
        has(path, "rig.json", rig) || !has_pictures(path))
      continue;
    if (n++ == 0 || st.st_mtim.tv_sec > last.st_mtim.tv_sec ||
        (st.st_mtim.tv_sec == last.st_mtim.tv_sec && st.st_mtim.tv_nsec > last.st_mtim.tv_nsec)) {
      last = st;
      sv_copy(newest, SV_CAP_PATH, path);
    }
  }
  sv_names_free(&names);
  return n > 1;
}

// What a folder holds, and the file that tells; of clips, the folder, of pictures, the camera's
// folder that changed last.
static kind kind_of(const char *dir, char mark[SV_CAP_PATH]) {
  if (has(dir, "transforms_train.json", mark) || has(dir, "transforms.json", mark)) return DATASET;
  if (has(dir, "capture.json", mark)) return CAPTURE;
  if (has(dir, "camera_array.toml", mark)) return BOARD;
  if (has(dir, "Calib.qca.txt", mark)) return QCA;
  if (lab_import_colmap_model(dir, mark)) return COLMAP;
  if (has_clips(dir) && sv_copy(mark, SV_CAP_PATH, dir)) return CLIPS;
  return has_folders_of_pictures(dir, mark) ? PICTURES : NOTHING;
}

// --- the note beside a folder of ours: is it of these files? ---------------------------------

// Kind, place and time of what it comes from.
static void note_of(kind k, const char *mark, char text[CAP_NOTE]) {
  struct stat st = {0};
  char real[PATH_MAX];
  (void)stat(mark, &st);
  snprintf(text, CAP_NOTE, "%s\n%s\n%lld.%09ld\n", kind_names[k], realpath(mark, real) ? real : mark,
           (long long)st.st_mtim.tv_sec, st.st_mtim.tv_nsec);
}

static bool is_noted(const char *folder, const char *note) {
  char path[SV_CAP_PATH + 8], text[CAP_NOTE] = "";
  snprintf(path, sizeof path, "%s" NOTE_END, folder);
  FILE *f = sv_path_is_folder(folder) ? fopen(path, "r") : NULL;
  if (!f) return false;
  text[fread(text, 1, sizeof text - 1, f)] = 0;
  fclose(f);
  return sv_str_eq(text, note);
}

static sv_status put_note(const char *folder, const char *note, sv_err *err) {
  char path[SV_CAP_PATH + 8];
  snprintf(path, sizeof path, "%s" NOTE_END, folder);
  return sv_file_write(path, note, strlen(note), err);
}

// --- .zip ----------------------------------------------------------------------------------------

static bool is_zip(const char *path) {
  return !sv_path_is_folder(path) && sv_str_eq(sv_path_extension(path), ".zip");
}

// unzip refuses names that lead out of the folder.
static sv_status unpack(const char *zip, const char *to, sv_err *err) {
  char note[CAP_NOTE];
  const char *const argv[] = {"unzip", "-q", "-o", zip, "-d", to, NULL};
  pid_t pid;
  int status;
  note_of(NOTHING, zip, note);
  if (is_noted(to, note)) return SV_OK;
  if (posix_spawnp(&pid, argv[0], NULL, NULL, (char *const *)(uintptr_t)argv, environ) != 0)
    return sv_fail(err, SV_E_UNSUPPORTED,
                   "%s: unpacking needs the program unzip; install it, or unpack the file", zip);
  while (waitpid(pid, &status, 0) < 0) continue;
  if (WIFEXITED(status) && WEXITSTATUS(status) == 0) return put_note(to, note, err);
  return sv_fail(err, SV_E_FORMAT, "%s: unzip could not unpack it", zip);
}

// Many archives hold one folder with all the rest.
static sv_status step_inside(char dir[SV_CAP_PATH], sv_err *err) {
  char mark[SV_CAP_PATH], inner[SV_CAP_PATH];
  sv_names names;
  if (kind_of(dir, mark) != NOTHING) return SV_OK;
  sv_status s = sv_folder_list(dir, &names, err);
  if (s != SV_OK) return s;
  if (names.n == 1 && sv_path_join(inner, sizeof inner, dir, names.names[0], NULL) == SV_OK &&
      sv_path_is_folder(inner))
    sv_copy(dir, SV_CAP_PATH, inner);
  sv_names_free(&names);
  return SV_OK;
}

// --- import --------------------------------------------------------------------------------------

// Training files of other names: --transforms chooses among them.
static bool has_other_transforms(const char *dir) {
  sv_names names;
  bool is_found = false;
  if (sv_folder_list(dir, &names, NULL) != SV_OK) return false;
  for (int i = 0; i < names.n; i++) is_found |= strncmp(names.names[i], "transforms_train_", 17) == 0;
  sv_names_free(&names);
  return is_found;
}

static sv_status no_dataset(const char *dir, sv_err *err) {
  char list[56] = "", mark[SV_CAP_PATH];
  if (has_pictures(dir) || (has(dir, "images", mark) && has_pictures(mark)))
    return sv_fail(
        err, SV_E_NOT_FOUND,
        "%.80s: holds pictures of one camera without poses; run COLMAP on them and give its folder "
        "(images/ and sparse/0/), or pictures of a rig in one folder a camera with --rig",
        dir);
  sv_str t = sv_str_make(list, sizeof list);
  sv_names names;
  if (sv_folder_list(dir, &names, NULL) == SV_OK) {
    for (int i = 0; i < names.n && t.len + strlen(names.names[i]) + 8 < sizeof list; i++)
      sv_str_add(&t, "%s%s", i ? ", " : "", names.names[i]);
    sv_names_free(&names);
  }
  return sv_fail(
      err, SV_E_NOT_FOUND,
      "%.50s: holds %s; expected transforms.json, sparse/0/ (COLMAP), capture.json, camera_array.toml, "
      "Calib.qca.txt, or clips or folders of pictures, one a camera, with --rig",
      dir, *list ? list : "nothing");
}

// A recording becomes a capture first, beside the dataset.
static sv_status make_capture(kind k, const lab_options *o, lab_session *se, char dir[SV_CAP_PATH],
                              sv_err *err) {
  char out[SV_CAP_PATH];
  sv_status s = sv_path_join(out, sizeof out, o->out, "capture", err);
  sv_import_job job = {dir, out, se->console};
  if (s == SV_OK && k == CLIPS) {
    lab_options clips = *o;
    clips.input = dir;
    clips.out = out;
    if (!o->rig) return sv_fail(err, SV_E_ARG, "%s: clips need --rig RIG, the rig of their cameras", dir);
    s = lab_import_multicam(&clips, se, err);
  } else if (s == SV_OK) s = k == QCA ? sv_import_qca(&job, err) : sv_import_4cam_board(&job, err);
  if (s == SV_OK) sv_copy(dir, SV_CAP_PATH, out);
  return s;
}

static sv_status import(kind k, const lab_options *o, lab_session *se, char dir[SV_CAP_PATH], const char *to,
                        sv_err *err) {
  lab_import im = {0};
  sv_status s = k == BOARD || k == QCA || k == CLIPS ? make_capture(k, o, se, dir, err) : SV_OK;
  if (s == SV_OK)
    s = k == COLMAP ? lab_import_colmap(&im, dir, err)
                    : lab_import_capture(&im, dir, k == CAPTURE || k == PICTURES ? o->rig : NULL, se, err);
  if (s == SV_OK) s = lab_import_write(&im, se, to, err);
  lab_import_free(&im);
  return s;
}

static sv_status import_to(kind k, const lab_options *o, char dir[SV_CAP_PATH], const char *mark,
                           const char *to, sv_err *err) {
  char note[CAP_NOTE];
  lab_session se;
  note_of(k, mark, note);
  const size_t len = strlen(note);
  if (k == CLIPS || k == PICTURES)
    sv_fmt(note + len, sizeof note - len, "%s %g\n", o->rig ? o->rig : "", o->every_s);
  sv_status s = lab_session_start(&se, 1, o->is_quiet, err);
  if (s != SV_OK) return s;
  const bool is_there = is_noted(to, note);
  lab_say(&se, "%s: %s; %s %s (--data for eval and render)", o->data, kind_names[k],
          is_there ? "imported before:" : "importing to", to);
  if (!is_there) s = import(k, o, &se, dir, to, err);
  if (s == SV_OK && !is_there) s = put_note(to, note, err);
  if (s == SV_E_INTERRUPTED)
    s = sv_fail(err, s, "stopped by request: %s is incomplete; run the same command again", to);
  sv_linux_console_finish(&se.lines);
  lab_session_stop(&se);
  return s;
}

sv_status lab_find_dataset(const lab_options *o, char folder[SV_CAP_PATH], sv_err *err) {
  char dir[SV_CAP_PATH], mark[SV_CAP_PATH];
  sv_copy(folder, SV_CAP_PATH, o->data);
  if (o->transforms || !sv_path_exists(o->data) || !sv_copy(dir, sizeof dir, o->data)) return SV_OK;
  sv_status s = SV_OK;
  const bool is_packed = is_zip(o->data);
  if (is_packed) {
    s = sv_path_make_folder(o->out, err);
    if (s == SV_OK) s = sv_path_join(dir, sizeof dir, o->out, "unpacked", err);
    if (s == SV_OK) s = unpack(o->data, dir, err);
    if (s == SV_OK) s = step_inside(dir, err);
  } else if (!sv_path_is_folder(o->data)) {
    return lab_import_is_clip(o->data)
               ? sv_fail(err, SV_E_ARG,
                         "%s is one clip; --data takes a folder of clips, one a camera, with --rig", o->data)
               : SV_OK;
  }
  if (s != SV_OK) return s;
  const kind k = kind_of(dir, mark);
  sv_copy(folder, SV_CAP_PATH, dir);
  if (k == DATASET || (k == NOTHING && has_other_transforms(dir))) return SV_OK;
  if (k == NOTHING) return no_dataset(dir, err);
  s = sv_path_make_folder(o->out, err);
  if (s == SV_OK) s = sv_path_join(folder, SV_CAP_PATH, o->out, "data", err);
  return s == SV_OK ? import_to(k, o, dir, mark, folder, err) : s;
}
