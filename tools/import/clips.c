// SPDX-License-Identifier: Apache-2.0
#include "tools/import/clips.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "src/base/str.h"

#define FIRST_NS SV_NS_PER_S // of a capture's clock

static double time_of(const lab_clip *c, int i) { return c->frames.times_s[i] + c->offset_s; }

static double period_of(const lab_clip *c) {
  const lab_media_frames *f = &c->frames;
  return f->n > 1 ? (f->times_s[f->n - 1] - f->times_s[0]) / (f->n - 1) : 1;
}

// The frame nearest to a time, from frame `from` on.
static int nearest(const lab_clip *c, int from, double t) {
  int i = from;
  while (i + 1 < c->frames.n && fabs(time_of(c, i + 1) - t) <= fabs(time_of(c, i) - t)) i++;
  return i;
}

static bool is_near(const lab_clip *c, int i, double t) {
  return fabs(time_of(c, i) - t) <= 0.505 * period_of(c);
}

// The exposure of frame i of the slowest clip; false: a clip has no frame there.
static bool pair(lab_clips *c, int i_slow, int i, int *from) {
  const double t = time_of(&c->clips[i_slow], i);
  double first = t, last = t;
  for (int k = 0; k < c->n; k++) {
    lab_clip *clip = &c->clips[k];
    const int at = k == i_slow ? i : nearest(clip, from[k], t);
    from[k] = at;
    if (!is_near(clip, at, t)) return false;
    clip->kept[c->n_exposures] = at;
    first = fmin(first, time_of(clip, at));
    last = fmax(last, time_of(clip, at));
  }
  if (last - first > c->max_skew_s) c->max_skew_s = last - first;
  c->n_exposures++;
  return true;
}

sv_status lab_clips_pair(lab_clips *c, double every_s, sv_err *err) {
  int i_slow = 0, from[SV_IMPORT_CAP_CAMERAS] = {0};
  double last_s = -INFINITY;
  for (int k = 1; k < c->n; k++)
    if (period_of(&c->clips[k]) > period_of(&c->clips[i_slow])) i_slow = k;
  const lab_clip *slow = &c->clips[i_slow];
  for (int k = 0; k < c->n; k++)
    if (!(c->clips[k].kept = calloc((size_t)slow->frames.n, sizeof(int))))
      return sv_fail(err, SV_E_NOMEM, "%s: no memory for its frames", slow->stream.path);
  c->n_exposures = 0;
  c->max_skew_s = 0;
  for (int i = 0; i < slow->frames.n; i++) {
    const double t = time_of(slow, i);
    // Frames do not come exactly in time.
    if (every_s > 0 && t - last_s < every_s - 0.25 * period_of(slow)) continue;
    if (pair(c, i_slow, i, from)) last_s = t;
  }
  c->fps = 1 / fmax(every_s, period_of(slow));
  return c->n_exposures > 0
             ? SV_OK
             : sv_fail(err, SV_E_NOT_FOUND, "%s and the other clips have no time in common by this clock",
                       slow->stream.path);
}

sv_status lab_clips_clear(const sv_import_job *job, const char *folder, sv_err *err) {
  char dir[SV_CAP_PATH], path[SV_CAP_PATH];
  sv_names names;
  sv_status s = sv_path_join(dir, sizeof dir, job->out_dir, folder, err);
  if (s == SV_OK) s = sv_path_make_folder(dir, err);
  if (s == SV_OK) s = sv_folder_list(dir, &names, err);
  if (s != SV_OK) return s;
  for (int i = 0; s == SV_OK && i < names.n; i++) {
    const char *end = sv_path_extension(names.names[i]);
    if (!sv_str_eq(end, ".png") && !sv_str_eq(end, ".jpg") && !sv_str_eq(end, ".jpeg")) continue;
    s = sv_path_join(path, sizeof path, dir, names.names[i], err);
    if (s == SV_OK) unlink(path);
  }
  sv_names_free(&names);
  return s;
}

typedef struct {
  const sv_import_job *job;
  const char *folder;
} target;

static sv_status put(void *self, int i, const sv_bitmap *b, sv_err *err) {
  const target *t = self;
  char path[SV_CAP_PATH], name[80];
  snprintf(name, sizeof name, "%.48s/%06d.png", t->folder, i);
  sv_status s = sv_path_join(path, sizeof path, t->job->out_dir, name, err);
  return s == SV_OK ? sv_bitmap_write_png(path, b, err) : s;
}

sv_status lab_clips_set_times(const sv_import_job *job, const lab_clips *c, int k, sv_import_camera *cam,
                              sv_err *err) {
  const lab_clip *clip = &c->clips[k];
  cam->is_made = true;
  cam->n_times = c->n_exposures;
  cam->times_ns = calloc((size_t)c->n_exposures, sizeof(sv_ns));
  if (!cam->times_ns) return sv_fail(err, SV_E_NOMEM, "%s: no memory for its times", clip->stream.path);
  double first_s = time_of(&c->clips[0], c->clips[0].kept[0]);
  for (int i = 1; i < c->n; i++) first_s = fmin(first_s, time_of(&c->clips[i], c->clips[i].kept[0]));
  for (int i = 0; i < c->n_exposures; i++)
    cam->times_ns[i] = FIRST_NS + (sv_ns)llrint((time_of(clip, clip->kept[i]) - first_s) * 1e9);
  return lab_clips_clear(job, cam->name, err);
}

static sv_status write_clip(const sv_import_job *job, const lab_clips *c, int k, sv_import_camera *cam,
                            sv_err *err) {
  target t = {job, cam->name};
  const lab_media_wanted want = {c->clips[k].kept, c->n_exposures, &t, put};
  sv_status s = lab_clips_set_times(job, c, k, cam, err);
  return s == SV_OK ? lab_media_decode(&c->clips[k].stream, &want, err) : s;
}

sv_status lab_clips_write(const sv_import_job *job, const lab_clips *c, sv_import_camera *cams, sv_err *err) {
  sv_status s = SV_OK;
  for (int k = 0; s == SV_OK && k < c->n; k++) s = write_clip(job, c, k, &cams[k], err);
  return s;
}

void lab_clips_free(lab_clips *c) {
  for (int k = 0; k < c->n; k++) {
    lab_media_frames_free(&c->clips[k].frames);
    free(c->clips[k].kept);
  }
}
