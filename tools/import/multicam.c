// SPDX-License-Identifier: Apache-2.0
// Clips of several cameras, one file each, or several files of one phone -> a capture folder on one
// clock: that of the sound, of flashes of light, or of the containers' creation times.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "src/base/str.h"
#include "tools/import/align.h"
#include "tools/import/clips.h"
#include "tools/import/import.h"

#define CAP           SV_IMPORT_CAP_CAMERAS
#define SOUND_HZ      8000
#define SOUND_CAP     (300 * SOUND_HZ) // the first five minutes are enough
#define BRIGHTNESS_HZ 240.0

typedef struct {
  const lab_options *o;
  lab_session *se;
  sv_import_job job;
  lab_clips all;
  lab_clip clips[CAP];
  lab_media media[CAP];
  sv_import_camera cams[CAP];
  char paths[CAP][SV_CAP_PATH];
  double sigma_s; // of the offsets, the largest
} job;

// --- the clips -----------------------------------------------------------------------------------

bool lab_import_is_clip(const char *name) {
  static const char *const ends[] = {".mp4", ".mov", ".m4v", ".mkv", ".webm", ".avi", ".mts", ".3gp"};
  for (size_t i = 0; i < sizeof ends / sizeof *ends; i++)
    if (strcasecmp(sv_path_extension(name), ends[i]) == 0) return true;
  return false;
}

static sv_status add_clip(job *j, const char *name, sv_err *err) {
  const int k = j->all.n;
  if (k == CAP) return sv_fail(err, SV_E_RANGE, "%s: more than %d clips", j->o->input, CAP);
  sv_status s = sv_path_join(j->paths[k], sizeof j->paths[k], j->o->input, name, err);
  if (s == SV_OK) s = lab_media_probe(j->paths[k], &j->media[k], err);
  if (s != SV_OK) return s;
  sv_import_name(j->cams[k].name, name);
  for (int i = 0; i < k; i++)
    if (sv_str_eq(j->cams[i].name, j->cams[k].name))
      return sv_fail(err, SV_E_FORMAT, "%s: the clips' names must differ before the extension", j->paths[k]);
  j->clips[k].stream = (lab_media_stream){j->paths[k], "0:v:0", NULL, &j->se->console};
  j->all.n++;
  return SV_OK;
}

static sv_status find_clips(job *j, sv_err *err) {
  sv_names names;
  sv_status s = sv_folder_list(j->o->input, &names, err);
  if (s != SV_OK) return s;
  for (int i = 0; s == SV_OK && i < names.n; i++)
    if (lab_import_is_clip(names.names[i])) s = add_clip(j, names.names[i], err);
  sv_names_free(&names);
  if (s == SV_OK && j->all.n < 2)
    s = sv_fail(err, SV_E_NOT_FOUND,
                "%s: holds %d clips (.mp4, .mov, .mkv, ...); expected one for each camera", j->o->input,
                j->all.n);
  for (int k = 0; s == SV_OK && k < j->all.n; k++)
    s = lab_media_scan(&j->clips[k].stream, &j->clips[k].frames, err);
  return s;
}

// --- clocks --------------------------------------------------------------------------------------

// Delays of all clips to the first one, by signals of one rate.
static sv_status by_signals(job *j, const lab_signal *signals, double rate_hz, bool is_sound, sv_err *err) {
  for (int k = 1; k < j->all.n; k++) {
    lab_delay d;
    sv_err why = {.text = ""};
    sv_status s = lab_delay_find(&d, &signals[0], &signals[k], rate_hz, is_sound, &why);
    if (s != SV_OK)
      return sv_fail(err, s, "%.60s and %.60s: %s: %s", sv_path_name(j->paths[0]), sv_path_name(j->paths[k]),
                     is_sound ? "sound" : "brightness", why.text);
    j->clips[k].offset_s = -d.delay_s;
    j->sigma_s = fmax(j->sigma_s, d.sigma_s);
  }
  return SV_OK;
}

static sv_status by_sound(job *j, sv_err *err) {
  lab_media_sound sounds[CAP] = {{0}};
  lab_signal signals[CAP];
  sv_status s = SV_OK;
  for (int k = 0; s == SV_OK && k < j->all.n; k++) {
    s = j->media[k].has_sound ? lab_media_listen(j->paths[k], SOUND_HZ, SOUND_CAP, &sounds[k], err)
                              : sv_fail(err, SV_E_NOT_FOUND, "%s: has no sound", j->paths[k]);
    signals[k] = (lab_signal){sounds[k].samples, sounds[k].n};
  }
  if (s == SV_OK) s = by_signals(j, signals, SOUND_HZ, true, err);
  for (int k = 0; k < j->all.n; k++) free(sounds[k].samples);
  return s;
}

// Changes of brightness from frame to frame, on even times from 0 on.
static sv_status sample_brightness(const lab_media_frames *f, lab_signal *out, sv_err *err) {
  const double end_s = f->times_s[f->n - 1];
  const int n = end_s > 0 && end_s * BRIGHTNESS_HZ < 1e7 ? (int)(end_s * BRIGHTNESS_HZ) + 1 : 0;
  float *x = calloc((size_t)n + 1, sizeof *x);
  *out = (lab_signal){x, n};
  if (!x) return sv_fail(err, SV_E_NOMEM, "no memory for the brightness of %d frames", f->n);
  for (int i = 0, k = 0; i < n; i++) {
    const double t = i / BRIGHTNESS_HZ;
    while (k + 1 < f->n && f->times_s[k + 1] <= t) k++;
    if (k + 1 == f->n || t < f->times_s[k]) continue;
    // The light changed at some time between the two frames.
    x[i] = (float)((f->brightness[k + 1] - f->brightness[k]) / (f->times_s[k + 1] - f->times_s[k]));
  }
  return SV_OK;
}

// A change of the light falls somewhere into a frame's period.
static double frame_sigma_s(const job *j) {
  double most = 0;
  for (int k = 0; k < j->all.n; k++) {
    const lab_media_frames *f = &j->clips[k].frames;
    if (f->n > 1) most = fmax(most, (f->times_s[f->n - 1] - f->times_s[0]) / (f->n - 1));
  }
  return most / sqrt(6); // of the difference of two
}

static sv_status by_flash(job *j, sv_err *err) {
  lab_signal signals[CAP] = {{0}};
  sv_status s = SV_OK;
  for (int k = 0; s == SV_OK && k < j->all.n; k++)
    s = sample_brightness(&j->clips[k].frames, &signals[k], err);
  if (s == SV_OK) s = by_signals(j, signals, BRIGHTNESS_HZ, false, err);
  j->sigma_s = hypot(j->sigma_s, frame_sigma_s(j));
  for (int k = 0; k < j->all.n; k++) free((void *)(uintptr_t)signals[k].samples);
  return s;
}

static sv_status by_container(job *j, sv_err *err) {
  bool is_whole = true;
  for (int k = 0; k < j->all.n; k++) {
    if (!j->media[k].has_created)
      return sv_fail(err, SV_E_NOT_FOUND, "%s: its container tells no creation time", j->paths[k]);
    is_whole = is_whole && floor(j->media[k].created_s) == j->media[k].created_s;
    j->clips[k].offset_s = j->media[k].created_s - j->media[0].created_s;
  }
  // Of the difference of two times in whole seconds, or milliseconds.
  j->sigma_s = (is_whole ? 1 : 1e-3) / sqrt(6);
  return SV_OK;
}

typedef struct {
  const char *word, *told;
  sv_status (*find)(job *j, sv_err *err);
} clock_kind;

static const clock_kind clocks[] = {{"sound", "sound", by_sound},
                                    {"flash", "changes of the light", by_flash},
                                    {"container", "creation times of the containers", by_container}};

static sv_status find_clock(job *j, sv_err *err) {
  const char *word = j->o->clock ? j->o->clock : "auto";
  sv_err why = {.text = ""};
  for (size_t i = 0; i < sizeof clocks / sizeof *clocks; i++) {
    const bool is_asked = sv_str_eq(word, clocks[i].word);
    if (!is_asked && !sv_str_eq(word, "auto")) continue;
    j->sigma_s = 0;
    sv_status s = clocks[i].find(j, is_asked ? err : &why);
    if (s == SV_OK) {
      for (int k = 0; k < j->all.n; k++)
        lab_say(j->se, "%s: starts at %.4f s +- %.2f ms by the %s", j->cams[k].name, j->clips[k].offset_s,
                k ? 1e3 * j->sigma_s : 0, clocks[i].told);
      return SV_OK;
    }
    if (is_asked || (s != SV_E_NOT_FOUND && s != SV_E_FORMAT))
      return is_asked ? s : sv_fail(err, s, "%s", why.text);
    lab_say(j->se, "not by the %s: %s", clocks[i].told, why.text);
  }
  return sv_fail(
      err, SV_E_NOT_FOUND,
      "%s: nothing tells a common clock of the clips: clap or switch the light on and off while all "
      "cameras record",
      j->o->input);
}

// --- all of it -----------------------------------------------------------------------------------

sv_status lab_import_multicam(const lab_options *o, lab_session *se, sv_err *err) {
  job *j = calloc(1, sizeof *j);
  if (!j) return sv_fail(err, SV_E_NOMEM, "%s: no memory", o->input);
  *j = (job){.o = o, .se = se, .job = {o->input, o->out, se->console}};
  j->all.clips = j->clips;
  sv_status s = sv_import_begin(&j->job, err);
  if (s == SV_OK) s = find_clips(j, err);
  if (s == SV_OK) s = find_clock(j, err);
  if (s == SV_OK) s = lab_clips_pair(&j->all, o->every_s, err);
  if (s == SV_OK && o->rig) s = lab_clips_take_rig(o, j->cams, j->all.n, err);
  if (s == SV_OK) s = lab_clips_write(&j->job, &j->all, j->cams, err);
  if (s == SV_OK) {
    lab_say(se,
            "%d exposures of %d cameras; frames of one exposure are up to %.1f ms apart, +- %.2f ms of the "
            "clocks",
            j->all.n_exposures, j->all.n, 1e3 * j->all.max_skew_s, 1e3 * j->sigma_s);
    if (j->all.max_skew_s > 0.02)
      lab_say(se, "'subview run' needs --skew-limit %.0f", ceil(1e3 * j->all.max_skew_s));
    s = sv_import_write(&j->job, "multicam", j->all.fps, j->cams, j->all.n, err);
  } else
    for (int k = 0; k < CAP; k++) free(j->cams[k].times_ns);
  lab_clips_free(&j->all);
  free(j);
  return s;
}
