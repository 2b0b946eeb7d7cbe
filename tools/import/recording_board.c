// SPDX-License-Identifier: Apache-2.0
// camera_array.toml and timestamps.csv.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tools/import/recording.h"

// The numbers of "key = [[..], ..]" between `p` and `end`, brackets skipped. False unless there are
// n.
static bool numbers(const char *p, const char *end, const char *key, int n, double *out) {
  char want[64];
  snprintf(want, sizeof want, "\n%s", key);
  for (p = strstr(p, want); p && p < end; p = strstr(p + 1, want)) {
    const char *q = p + strlen(want);
    q += strspn(q, " ");
    if (*q != '=') continue; // a longer key that begins like this one
    int i = 0;
    for (q++; i < n; i++) {
      char *stop;
      q += strspn(q, " [],");
      out[i] = strtod(q, &stop);
      if (stop == q || stop > end) return false;
      q = stop;
    }
    return true;
  }
  return false;
}

static int read_camera(const char *toml, int i, sv_import_camera *c, sv_err *err) {
  char head[32];
  double size[2], k[9];
  snprintf(head, sizeof head, "[cameras.%d]", i);
  const char *p = strstr(toml, head);
  if (!p) return SV_END;
  const char *end = strstr(p + 1, "\n[cameras.");
  if (!end) end = p + strlen(p);
  *c = (sv_import_camera){0};
  snprintf(c->name, sizeof c->name, "cam%d", i);
  if (!numbers(p, end, "size", 2, size) || !numbers(p, end, "matrix", 9, k) ||
      !numbers(p, end, "distortions", 5, c->dist) || !numbers(p, end, "rotation", 9, c->cam_from_world.r) ||
      !numbers(p, end, "translation", 3, c->cam_from_world.t) || !(size[0] >= 1 && size[1] >= 1))
    return sv_fail(
        err, SV_E_FORMAT,
        "camera_array.toml: %s: expected size, matrix (9), distortions (5), rotation (9) and translation (3)",
        head);
  c->calib_width_px = (int)size[0];
  c->calib_height_px = (int)size[1];
  c->fx = k[0];
  c->cx = k[2];
  c->fy = k[4];
  c->cy = k[5];
  return SV_OK;
}

static int by_time(const void *a, const void *b) {
  sv_ns x = *(const sv_ns *)a, y = *(const sv_ns *)b;
  return x < y ? -1 : x > y;
}

static int read_times(const char *csv, sv_import_camera *cams, int n, sv_err *err) {
  size_t n_lines = 1;
  for (const char *p = csv; *p; p++) n_lines += *p == '\n';
  for (int i = 0; i < n; i++)
    if (!(cams[i].times_ns = calloc(n_lines, sizeof(sv_ns))))
      return sv_fail(err, SV_E_NOMEM, "timestamps.csv: no memory");
  int line = 1;
  for (const char *p = strchr(csv, '\n'); p && p[1]; p = strchr(p + 1, '\n')) {
    long i_sync;
    int i_cam;
    double t_s;
    line++;
    if (sscanf(p + 1, "%ld,%d,%lf", &i_sync, &i_cam, &t_s) != 3 || i_cam < 0 || i_cam >= n ||
        !(t_s >= 0 && t_s < 1e8))
      return sv_fail(err, SV_E_FORMAT,
                     "timestamps.csv: line %d: expected sync_index, cam_id below %d, seconds", line, n);
    cams[i_cam].times_ns[cams[i_cam].n_times++] = (sv_ns)(t_s * 1e9 + 0.5);
  }
  for (int i = 0; i < n; i++) qsort(cams[i].times_ns, (size_t)cams[i].n_times, sizeof(sv_ns), by_time);
  return SV_OK;
}

static double rate_of(const sv_import_camera *c) {
  if (c->n_times < 2) return 0;
  double span_s = (double)(c->times_ns[c->n_times - 1] - c->times_ns[0]) * 1e-9;
  return span_s > 0 ? (c->n_times - 1) / span_s : 0;
}

int sv_import_4cam_board(const sv_import_job *job, sv_err *err) {
  const char *src = job->src_dir;
  sv_import_camera cams[SV_IMPORT_CAP_CAMERAS];
  char *toml = sv_import_text(src, "camera_array.toml", err), *csv = NULL;
  int n = 0, s = toml ? SV_OK : SV_E_NOT_FOUND;
  while (s == SV_OK && n < SV_IMPORT_CAP_CAMERAS) {
    s = read_camera(toml, n, &cams[n], err);
    n += s == SV_OK;
  }
  if (s == SV_END) s = n ? SV_OK : sv_fail(err, SV_E_FORMAT, "%s/camera_array.toml: no [cameras.0]", src);
  if (s == SV_OK) csv = sv_import_text(src, "timestamps.csv", err);
  if (s == SV_OK && !csv) s = SV_E_NOT_FOUND;
  if (s == SV_OK) s = read_times(csv, cams, n, err);
  if (s == SV_OK) s = sv_import_write(job, "board", rate_of(&cams[0]), cams, n, err);
  else
    for (int i = 0; i < n; i++) free(cams[i].times_ns);
  free(toml);
  free(csv);
  return s;
}
