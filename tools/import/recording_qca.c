// SPDX-License-Identifier: Apache-2.0
// Calib.qca.txt. Only a few attributes of a flat XML file are needed, so they are looked up by
// name.
#include <dirent.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tools/import/recording.h"

#define FPS 30

// The number of name="..." within a tag that starts at `tag`.
static bool attribute(const char *tag, const char *name, double *out) {
  char want[64];
  const char *end = tag ? strchr(tag, '>') : NULL;
  snprintf(want, sizeof want, " %s=\"", name);
  const char *p = end ? strstr(tag, want) : NULL;
  if (!p || p > end) return false;
  char *stop;
  *out = strtod(p + strlen(want), &stop);
  return *stop == '"';
}

static bool attributes(const char *tag, const char *const *names, int n, double *out) {
  for (int i = 0; i < n; i++)
    if (!attribute(tag, names[i], &out[i])) return false;
  return true;
}

// Rows right, up, backward -> OpenCV's right, down, forward; center in mm -> translation in meters.
static sv_pose pose_of(const double r[9], const double centre_mm[3]) {
  sv_pose p;
  double c[3];
  for (int i = 0; i < 9; i++) p.r[i] = i < 3 ? r[i] : -r[i];
  for (int i = 0; i < 3; i++) c[i] = centre_mm[i] * 1e-3;
  sv_apply33(p.t, p.r, c);
  for (int i = 0; i < 3; i++) p.t[i] = -p.t[i];
  return p;
}

static bool read_serial(const char *tag, char *out, size_t cap) {
  const char *end = strchr(tag, '>'), *p = strstr(tag, " serial=\"");
  if (!p || !end || p > end) return false;
  p += strlen(" serial=\"");
  size_t n = strcspn(p, "\"");
  // It becomes a folder's name and stands in JSON.
  if (n < 1 || n >= cap || strspn(p, "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-") < n)
    return false;
  memcpy(out, p, n);
  out[n] = 0;
  return true;
}

static bool read_camera(const char *tag, sv_import_camera *c) {
  static const char *const pose_names[] = {"r11", "r12", "r13", "r21", "r22", "r23",
                                           "r31", "r32", "r33", "x",   "y",   "z"};
  // The misspelling is the format's.
  static const char *const lens_names[] = {"focalLengthU",
                                           "focalLengthV",
                                           "centerPointU",
                                           "centerPointV",
                                           "radialDistortion1",
                                           "radialDistortion2",
                                           "tangentalDistortion1",
                                           "tangentalDistortion2",
                                           "radialDistortion3",
                                           "sensorMaxU",
                                           "sensorMaxV"};
  double p[12], l[11];
  *c = (sv_import_camera){0};
  const char *next = strstr(tag + 1, "<camera "), *pose = strstr(tag, "<transform "),
             *lens = strstr(tag, "<intrinsic ");
  if (!read_serial(tag, c->name, sizeof c->name) || !pose || !lens || (next && (pose > next || lens > next)))
    return false;
  if (!attributes(pose, pose_names, 12, p) || !attributes(lens, lens_names, 11, l)) return false;
  c->cam_from_world = pose_of(p, p + 9);
  // The sensor's last pixel is its width less one times 64: pixel centers lie at whole numbers.
  c->calib_width_px = (int)(l[9] / 64) + 1;
  c->calib_height_px = (int)(l[10] / 64) + 1;
  c->fx = l[0] / 64;
  c->fy = l[1] / 64;
  c->cx = l[2] / 64;
  c->cy = l[3] / 64;
  memcpy(c->dist, l + 4, 5 * sizeof(double));
  return c->calib_width_px > 1 && c->calib_width_px < 32768 && c->calib_height_px > 1 &&
         c->calib_height_px < 32768;
}

static int is_picture(const struct dirent *d) {
  return strlen(d->d_name) > 4 && strstr(d->d_name, ".jpg") != NULL;
}

static int make_times(const char *src, sv_import_camera *c, sv_err *err) {
  char path[1024];
  struct dirent **names = NULL;
  snprintf(path, sizeof path, "%s/%s", src, c->name);
  int n = scandir(path, &names, is_picture, NULL);
  for (int i = 0; i < n; i++) free(names[i]);
  free(names);
  if (n < 1) return sv_fail(err, SV_E_NOT_FOUND, "%s: expected a folder of JPEG images", path);
  c->n_times = n;
  c->times_ns = calloc((size_t)n, sizeof(sv_ns));
  if (!c->times_ns) return sv_fail(err, SV_E_NOMEM, "%s: no memory", path);
  for (int i = 0; i < n; i++) c->times_ns[i] = i * SV_NS_PER_S / FPS;
  return SV_OK;
}

int sv_import_qca(const sv_import_job *job, sv_err *err) {
  const char *src = job->src_dir;
  sv_import_camera cams[SV_IMPORT_CAP_CAMERAS];
  char *xml = sv_import_text(src, "Calib.qca.txt", err);
  if (!xml) return SV_E_NOT_FOUND;
  int n = 0, s = SV_OK;
  for (const char *p = strstr(xml, "<camera "); p && s == SV_OK && n < SV_IMPORT_CAP_CAMERAS;
       p = strstr(p + 1, "<camera ")) {
    if (!read_camera(p, &cams[n]))
      s = sv_fail(err, SV_E_FORMAT, "%s/Calib.qca.txt: camera %d: expected serial, transform and intrinsic",
                  src, n + 1);
    else {
      n++;
      s = make_times(src, &cams[n - 1], err);
    }
  }
  if (s == SV_OK && !n) s = sv_fail(err, SV_E_FORMAT, "%s/Calib.qca.txt: no camera in it", src);
  if (s == SV_OK) s = sv_import_write(job, "person", FPS, cams, n, err);
  else
    for (int i = 0; i < n; i++) free(cams[i].times_ns);
  free(xml);
  return s;
}
