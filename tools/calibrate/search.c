// SPDX-License-Identifier: Apache-2.0
// The search for corners, spread over the threads, and its memory: corners.txt.
//   corners 1 COLUMNS ROWS
//   image FOUND WIDTH HEIGHT BYTES CHANGED_NS PATH      then, when found, a line "u v" per corner
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "calib/solve/corners.h"
#include "src/base/str.h"
#include "tools/calibrate/calibrate.h"
#include "tools/common/imageio.h"

typedef struct {
  int64_t bytes, changed_ns;
} stamp;

typedef struct {
  const char *path;
  int camera, frame;
  stamp at;
  int width_px, height_px;
  bool is_known; // from the cache
  bool is_found;
  double *uv; // in cal_boards
  sv_err err;
} job;

typedef struct {
  job *jobs;
  int n, n_cols, n_rows;
  const lab_session *session;
} search;

static stamp stamp_of(const char *path) {
  struct stat st;
  if (stat(path, &st) != 0) return (stamp){-1, -1};
  return (stamp){(int64_t)st.st_size, (int64_t)st.st_mtim.tv_sec * 1000000000 + st.st_mtim.tv_nsec};
}

static void search_one(void *arg, int i_task, int i_thread) {
  search *se = arg;
  job *j = &se->jobs[i_task];
  sv_bitmap image;
  (void)i_thread;
  if (j->is_known) return;
  if (lab_is_stopped(se->session)) {
    j->err.status = SV_E_INTERRUPTED;
    return;
  }
  sv_status s = sv_bitmap_read(j->path, &image, &j->err);
  if (s == SV_OK) s = sv_bitmap_to_8(&image, &j->err);
  if (s == SV_OK && image.n_channels != 1) {
    if (image.n_channels == 2)
      s = sv_fail(&j->err, SV_E_FORMAT, "%s: gray with alpha is not a camera image", j->path);
    else s = sv_bitmap_to_channels(&image, 1, &j->err);
  }
  if (s == SV_OK) {
    j->width_px = image.width_px;
    j->height_px = image.height_px;
    sv_corners_job c = {se->n_cols, se->n_rows, image.width_px, image.height_px, image.u8};
    j->is_found = sv_corners_find(&c, j->uv);
  }
  sv_bitmap_free(&image);
  j->err.status = s;
}

// --- corners.txt ---------------------------------------------------------------------------------
static int by_path(const void *a, const void *b) {
  return strcmp((*(job *const *)a)->path, (*(job *const *)b)->path);
}

static bool read_corners(FILE *f, double *uv, int n) {
  for (int k = 0; k < n; k++)
    if (fscanf(f, "%lf %lf\n", &uv[2 * k], &uv[2 * k + 1]) != 2) return false;
  return true;
}

// A cache that cannot be read, or is of another board, is none.
static void read_cache(search *se, const char *path) {
  FILE *f = fopen(path, "r");
  job **sorted = malloc((size_t)se->n * sizeof *sorted);
  double *uv = malloc(2 * (size_t)(se->n_cols * se->n_rows) * sizeof *uv);
  int cols, rows, found, w, h;
  char name[SV_CAP_PATH];
  stamp at;
  if (f && sorted && uv && fscanf(f, "corners 1 %d %d\n", &cols, &rows) == 2 && cols == se->n_cols &&
      rows == se->n_rows) {
    for (int i = 0; i < se->n; i++) sorted[i] = &se->jobs[i];
    qsort(sorted, (size_t)se->n, sizeof *sorted, by_path);
    while (fscanf(f, "image %d %d %d %" SCNd64 " %" SCNd64 " %1023[^\n]\n", &found, &w, &h, &at.bytes,
                  &at.changed_ns, name) == 6) {
      if (found && !read_corners(f, uv, cols * rows)) break;
      job probe = {.path = name}, *key = &probe, **hit;
      hit = bsearch(&key, sorted, (size_t)se->n, sizeof *sorted, by_path);
      if (!hit || (*hit)->at.bytes != at.bytes || (*hit)->at.changed_ns != at.changed_ns) continue;
      (*hit)->is_known = true;
      (*hit)->is_found = found != 0;
      (*hit)->width_px = w;
      (*hit)->height_px = h;
      if (found) memcpy((*hit)->uv, uv, 2 * (size_t)(cols * rows) * sizeof *uv);
    }
  }
  if (f) fclose(f);
  free(sorted);
  free(uv);
}

static sv_status append(sv_file *f, sv_err *err, const char *fmt, ...) SV_PRINTF(3, 4);
static sv_status append(sv_file *f, sv_err *err, const char *fmt, ...) {
  char line[SV_CAP_PATH + 200];
  va_list ap;
  va_start(ap, fmt);
  size_t n = sv_vfmt(line, sizeof line, fmt, ap);
  va_end(ap);
  return sv_file_append(f, line, n < sizeof line ? n : sizeof line - 1, err);
}

static sv_status write_cache(const search *se, const char *path, sv_err *err) {
  sv_file f;
  sv_status s = sv_file_begin(&f, path, err);
  if (s != SV_OK) return s;
  s = append(&f, err, "corners 1 %d %d\n", se->n_cols, se->n_rows);
  for (int i = 0; i < se->n && s == SV_OK; i++) {
    const job *j = &se->jobs[i];
    if (j->err.status != SV_OK) continue; // was not looked at
    s = append(&f, err, "image %d %d %d %lld %lld %s\n", j->is_found, j->width_px, j->height_px,
               (long long)j->at.bytes, (long long)j->at.changed_ns, j->path);
    for (int k = 0; k < se->n_cols * se->n_rows && j->is_found && s == SV_OK; k++)
      s = append(&f, err, "%.17g %.17g\n", j->uv[2 * k], j->uv[2 * k + 1]);
  }
  if (s == SV_OK) return sv_file_commit(&f, err);
  sv_file_abandon(&f);
  return s;
}

// --- all of it -----------------------------------------------------------------------------------
static sv_status settle(cal_boards *b, const search *se, sv_err *err) {
  for (int i = 0; i < se->n; i++) {
    const job *j = &se->jobs[i];
    cal_camera *q = &b->cameras[j->camera];
    if (j->err.status != SV_OK) return sv_fail(err, j->err.status, "%s", j->err.text);
    if (!j->is_found) { // another image that the pattern catches, of whatever size
      b->n_cached += j->is_known;
      b->n_searched += !j->is_known;
      continue;
    }
    if (!q->size_px[0]) {
      q->size_px[0] = j->width_px;
      q->size_px[1] = j->height_px;
    }
    if (q->size_px[0] != j->width_px || q->size_px[1] != j->height_px)
      return sv_fail(err, SV_E_FORMAT,
                     "%s: %dx%d pixels, but %s has %dx%d: all images of a camera must have one size", j->path,
                     j->width_px, j->height_px, q->name, q->size_px[0], q->size_px[1]);
    b->is_seen[(size_t)j->camera * (size_t)b->n_frames + (size_t)j->frame] = j->is_found;
    b->n_cached += j->is_known;
    b->n_searched += !j->is_known;
  }
  for (int c = 0; c < b->n_cameras; c++) {
    if (!b->cameras[c].size_px[0])
      return sv_fail(err, SV_E_NOT_FOUND, "%s: no board of %dx%d inner corners in its %d images",
                     b->cameras[c].name, b->n_cols, b->n_rows, b->cameras[c].n_pictures);
    for (int k = 0; k < 2; k++) b->size_px[c][k] = b->cameras[c].size_px[k];
  }
  return SV_OK;
}

sv_status cal_stopped(const lab_session *session, const char *kept, sv_err *err) {
  if (!lab_is_stopped(session)) return SV_OK;
  return sv_fail(err, SV_E_INTERRUPTED, "stopped by request: no result was written%s%s",
                 kept ? "; found corners are cached in " : "", kept ? kept : "");
}

sv_status cal_boards_find(cal_boards *b, lab_session *session, const char *cache, sv_err *err) {
  size_t n_uv = 2 * (size_t)b->n_cols * (size_t)b->n_rows;
  search se = {.n_cols = b->n_cols, .n_rows = b->n_rows, .session = session};
  sv_status s = sv_corners_available(b->n_cols, b->n_rows, err);
  if (s != SV_OK) return s;
  for (int c = 0; c < b->n_cameras; c++) se.n += b->cameras[c].n_pictures;
  se.jobs = calloc((size_t)se.n, sizeof *se.jobs);
  if (!se.jobs) return sv_fail(err, SV_E_NOMEM, "no memory for %d images", se.n);
  job *j = se.jobs;
  for (int c = 0; c < b->n_cameras; c++)
    for (int i = 0; i < b->cameras[c].n_pictures; i++, j++) {
      const cal_picture *p = &b->cameras[c].pictures[i];
      *j = (job){.path = p->path, .camera = c, .frame = p->i_frame, .at = stamp_of(p->path)};
      j->uv = b->uv_px + n_uv * ((size_t)c * (size_t)b->n_frames + (size_t)p->i_frame);
    }
  if (cache) read_cache(&se, cache);
  sv_pool_run(&session->pool, search_one, &se, se.n);
  bool is_stopped = lab_is_stopped(session);
  if (!is_stopped) s = settle(b, &se, err);
  // What was found is kept, also when a camera has no board yet
  sv_err failed;
  const bool is_kept = cache && (s == SV_OK || (s == SV_E_NOT_FOUND && !is_stopped));
  const sv_status kept = is_kept ? write_cache(&se, cache, &failed) : SV_OK;
  if (s == SV_OK && kept != SV_OK) s = sv_fail(err, kept, "%s", failed.text);
  if (s == SV_OK && is_stopped) s = cal_stopped(session, cache, err);
  free(se.jobs);
  return s;
}
