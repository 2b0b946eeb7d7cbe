// SPDX-License-Identifier: Apache-2.0
#include "tools/import/recording.h"

#include <dirent.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "platform/codec/codec.h"
#include "platform/linux/linux.h"
#include "src/base/str.h"
#include "tools/common/fileio.h"

#define CAP_PATH 1024

char *sv_import_text(const char *dir, const char *file, sv_err *err) {
  char path[CAP_PATH];
  snprintf(path, sizeof path, "%s/%s", dir, file);
  FILE *f = fopen(path, "rb");
  char *text = f ? malloc((1u << 24) + 1) : NULL;
  size_t n = text ? fread(text, 1, 1u << 24, f) : 0;
  if (f) fclose(f);
  if (!n) {
    free(text);
    sv_fail(err, SV_E_NOT_FOUND, "%s: cannot be read or is empty", path);
    return NULL;
  }
  text[n] = 0;
  return text;
}

// --- images ------------------------------------------------------------------------------------
static int is_picture(const struct dirent *d) {
  const char *dot = strrchr(d->d_name, '.');
  return dot && (!strcmp(dot, ".jpg") || !strcmp(dot, ".jpeg") || !strcmp(dot, ".png"));
}

static int copy_file(const char *from, const char *to, sv_err *err) {
  if (unlink(to) < 0 && errno != ENOENT) return sv_fail(err, SV_E_IO, "%s: %s", to, sv_linux_reason(errno));
  if (link(from, to) == 0) return SV_OK;
  void *data;
  size_t bytes;
  sv_status s = sv_file_read(from, &data, &bytes, err);
  if (s != SV_OK) return s;
  s = sv_file_write(to, data, bytes, err);
  free(data);
  return s;
}

static int picture_size(const char *path, int *w, int *h, sv_err *err) {
  static uint8_t head[65536];
  size_t bytes;
  int fd;
  sv_status s = sv_file_open(path, &fd, &bytes, err);
  if (s < 0) return s;
  ssize_t n = read(fd, head, sizeof head);
  close(fd);
  sv_codec_info info;
  sv_err why = {.text = ""};
  s = sv_codec_probe(head, n > 0 ? (size_t)n : 0, &info, &why);
  if (s < 0) return sv_fail(err, s, "%s: %s", path, why.text);
  *w = info.width_px;
  *h = info.height_px;
  return SV_OK;
}

typedef struct {
  struct dirent **names;
  int n, width_px, height_px;
} pictures_t;

static void free_pictures(pictures_t *p) {
  for (int i = 0; i < p->n; i++) free(p->names[i]);
  free(p->names);
}

static int take_pictures(const sv_import_job *job, const sv_import_camera *c, pictures_t *p, sv_err *err) {
  const char *src = job->src_dir, *out = job->out_dir;
  const sv_console *con = &job->console;
  char from[CAP_PATH], to[CAP_PATH];
  if (c->is_made) src = out;
  snprintf(from, sizeof from, "%s/%s", src, c->name);
  *p = (pictures_t){0};
  p->n = scandir(from, &p->names, is_picture, alphasort);
  if (p->n < 1) {
    p->n = 0;
    return sv_fail(err, SV_E_NOT_FOUND, "%s: expected a folder of JPEG or PNG images", from);
  }
  if (p->n != c->n_times)
    return sv_fail(err, SV_E_FORMAT, "%s: %d images but %d timestamps", from, p->n, c->n_times);
  snprintf(to, sizeof to, "%s/%s", out, c->name);
  int s = sv_linux_make_dir(to, err);
  for (int i = 0; i < p->n && s == SV_OK; i++) {
    int w = 0, h = 0;
    if (con->is_stop_requested(con->self)) return SV_E_INTERRUPTED;
    snprintf(from, sizeof from, "%s/%s/%s", src, c->name, p->names[i]->d_name);
    snprintf(to, sizeof to, "%s/%s/%s", out, c->name, p->names[i]->d_name);
    s = picture_size(from, &w, &h, err);
    if (i == 0) {
      p->width_px = w;
      p->height_px = h;
    } else if (s == SV_OK && (w != p->width_px || h != p->height_px))
      s = sv_fail(err, SV_E_FORMAT, "%s: %dx%d, but the camera's first image is %dx%d", from, w, h,
                  p->width_px, p->height_px);
    if (s == SV_OK && !c->is_made) s = copy_file(from, to, err);
  }
  return s;
}

// --- rig -----------------------------------------------------------------------------------------
static int put_model(const char *out, const sv_import_camera *c, int w, int h, sv_err *err) {
  char path[CAP_PATH];
  double kx = (double)w / c->calib_width_px, ky = (double)h / c->calib_height_px, r[3];
  if (kx / ky > 1.005 || kx / ky < 0.995)
    return sv_fail(err, SV_E_FORMAT, "%s: calibrated for %dx%d, but its images are %dx%d", c->name,
                   c->calib_width_px, c->calib_height_px, w, h);
  if (sv_rotation_error(c->cam_from_world.r) > 1e-4)
    return sv_fail(err, SV_E_FORMAT, "%s: its rotation matrix deviates by %g from a rotation", c->name,
                   sv_rotation_error(c->cam_from_world.r));
  sv_rodrigues_inv(r, c->cam_from_world.r);
  const double *t = c->cam_from_world.t, *d = c->dist;
  snprintf(path, sizeof path, "%s/rig/%s.cameramodel", out, c->name);
  FILE *f = sv_stream_open(path, err);
  if (!f) return SV_E_IO;
  const bool is_rational = d[5] != 0 || d[6] != 0 || d[7] != 0;
  fprintf(f, "{\n    'lensmodel':  'LENSMODEL_OPENCV%d',\n", is_rational ? 8 : 5);
  fprintf(f, "    'extrinsics': [ %.12g, %.12g, %.12g, %.12g, %.12g, %.12g ],\n", r[0], r[1], r[2], t[0],
          t[1], t[2]);
  // A pixel's center at integer i covers i-0.5..i+0.5: scaling keeps the edges, not the centers.
  fprintf(f, "    'intrinsics': [ %.12g, %.12g, %.12g, %.12g", c->fx * kx, c->fy * ky,
          (c->cx + 0.5) * kx - 0.5, (c->cy + 0.5) * ky - 0.5);
  for (int i = 0; i < (is_rational ? 8 : 5); i++) fprintf(f, ", %.12g", d[i]);
  fprintf(f, " ],\n");
  fprintf(f, "    'imagersize': [ %d, %d ]\n}\n", w, h);
  return sv_stream_save(f, err);
}

static int put_rig(const char *out, const char *name, const sv_import_camera *cams, int n, sv_err *err) {
  char path[CAP_PATH];
  snprintf(path, sizeof path, "%s/rig/rig.json", out);
  FILE *f = sv_stream_open(path, err);
  if (!f) return SV_E_IO;
  fprintf(f, "{\"version\": 1, \"name\": \"%s\", \"forward\": \"direct\", \"sub_views\": [\n", name);
  for (int i = 0; i < n; i++)
    fprintf(f, "  {\"name\": \"%s\", \"model\": \"%s.cameramodel\", \"camera\": %d}%s\n", cams[i].name,
            cams[i].name, i, i + 1 < n ? "," : "");
  fprintf(f, "]}\n");
  return sv_stream_save(f, err);
}

// --- capture.json --------------------------------------------------------------------------------
static void put_camera(FILE *f, const sv_import_camera *c, const pictures_t *p, double fps, const char *end) {
  fprintf(f, "{\"name\":\"%s\",\"folder\":\"%s\",\"width\":%d,\"height\":%d,\"fps\":%.9g,", c->name, c->name,
          p->width_px, p->height_px, fps);
  if (*c->depth) fprintf(f, "\"depth\":\"%s\",", c->depth);
  fprintf(f, "\"clock\":\"monotonic\",\"stamp\":\"start\",\"frames\":[\n");
  for (int i = 0; i < p->n; i++)
    fprintf(f,
            "%s{\"file\":\"%s\",\"sequence\":%d,\"camera_ns\":%lld,\"arrival_ns\":%lld,\"exposure_ns\":0}\n",
            i ? "," : "", p->names[i]->d_name, i, (long long)c->times_ns[i], (long long)c->times_ns[i]);
  fprintf(f, "]}%s\n", end);
}

typedef struct {
  const char *name;
  double fps;
  sv_import_camera *cams;
  int n;
} recording;

static int write_all(const sv_import_job *job, const recording *r, pictures_t *pics, sv_err *err) {
  const char *out = job->out_dir;
  sv_import_camera *cams = r->cams;
  const int n = r->n;
  char path[CAP_PATH];
  const bool has_rig = cams[0].fx > 0;
  snprintf(path, sizeof path, "%s/rig", out);
  int s = has_rig ? sv_linux_make_dir(path, err) : SV_OK;
  for (int i = 0; i < n && s == SV_OK; i++) {
    s = take_pictures(job, &cams[i], &pics[i], err);
    if (s == SV_OK && has_rig) s = put_model(out, &cams[i], pics[i].width_px, pics[i].height_px, err);
  }
  if (s == SV_OK && has_rig) s = put_rig(out, r->name, cams, n, err);
  if (s < 0) return s;
  snprintf(path, sizeof path, "%s/capture.json", out);
  FILE *f = sv_stream_open(path, err);
  if (!f) return SV_E_IO;
  // A rig of the user's may be there, too.
  snprintf(path, sizeof path, "%s/rig/rig.json", out);
  fprintf(f, "{\n\"version\":1,\n\"name\":\"%s\",\n", r->name);
  if (sv_path_exists(path)) fprintf(f, "\"rig\":\"rig\",\n");
  fprintf(f, "\"cameras\":[\n");
  for (int i = 0; i < n; i++) put_camera(f, &cams[i], &pics[i], r->fps, i + 1 < n ? "," : "");
  fprintf(f, "],\n\"poses\":[\n]\n}\n");
  return sv_stream_save(f, err);
}

// Images that are there are replaced, which must not be the ones that are read. An unfinished
// capture's frames would be folded into the list that is written here.
static int check_out(const sv_import_job *job, sv_err *err) {
  char path[CAP_PATH];
  struct stat from, to;
  if (stat(job->src_dir, &from) == 0 && stat(job->out_dir, &to) == 0 && from.st_dev == to.st_dev &&
      from.st_ino == to.st_ino)
    return sv_fail(err, SV_E_ARG, "%s: is the input folder; choose another --out", job->out_dir);
  snprintf(path, sizeof path, "%s/frames.0.part", job->out_dir);
  return sv_path_exists(path)
             ? sv_fail(err, SV_E_IO, "%s: contains an unfinished capture; choose another --out", job->out_dir)
             : SV_OK;
}

int sv_import_begin(const sv_import_job *job, sv_err *err) {
  int s = check_out(job, err);
  return s == SV_OK ? sv_linux_make_dir(job->out_dir, err) : s;
}

void sv_import_name(char out[48], const char *file) {
  const char *name = sv_path_name(file);
  size_t n = strlen(name) - strlen(sv_path_extension(name));
  if (n > 31) n = 31; // as sub-views have room for
  for (size_t i = 0; i < n; i++) {
    const char c = name[i];
    const bool is_plain = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9');
    out[i] = is_plain || c == '-' || c == '_' ? c : '_';
  }
  out[n] = 0;
}

int sv_import_write(const sv_import_job *job, const char *name, double fps, sv_import_camera *cams, int n,
                    sv_err *err) {
  pictures_t pics[SV_IMPORT_CAP_CAMERAS] = {{0}};
  const recording r = {name, fps, cams, n};
  int s = check_out(job, err);
  if (s == SV_OK)
    s = n >= 1 && n <= SV_IMPORT_CAP_CAMERAS ? write_all(job, &r, pics, err)
                                             : sv_fail(err, SV_E_RANGE, "%s: %d cameras, expected 1 to %d",
                                                       job->src_dir, n, SV_IMPORT_CAP_CAMERAS);
  for (int i = 0; i < n && i < SV_IMPORT_CAP_CAMERAS; i++) {
    free_pictures(&pics[i]);
    free(cams[i].times_ns);
    cams[i].times_ns = NULL;
  }
  return s;
}
