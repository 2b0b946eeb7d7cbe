// SPDX-License-Identifier: Apache-2.0
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/str.h"
#include "src/format/bytes.h"
#include "tools/import/import.h"
#include "tools/common/report.h"

static void *grow(void *block, int n, int *cap, size_t size) {
  if (n < *cap) return block;
  int bigger = *cap ? 2 * *cap : 64;
  void *p = realloc(block, (size_t)bigger * size);
  if (p) *cap = bigger;
  return p;
}

lab_import_view *lab_import_add(lab_import *im) {
  void *p = grow(im->views, im->n, &im->cap, sizeof *im->views);
  if (!p) return NULL;
  im->views = p;
  lab_import_view *v = &im->views[im->n++];
  memset(v, 0, sizeof *v);
  v->time = -1;
  v->exposure = v->sub_view = -1;
  return v;
}

sv_point *lab_import_add_point(lab_import *im) {
  void *p = grow(im->points, im->n_points, &im->cap_points, sizeof *im->points);
  if (!p) return NULL;
  im->points = p;
  return &im->points[im->n_points++];
}

void lab_import_free(lab_import *im) {
  free(im->views);
  free(im->points);
  memset(im, 0, sizeof *im);
}

// --- images ------------------------------------------------------------------------------------

static sv_status copy_whole(const char *from, const char *to, sv_err *err) {
  void *data;
  size_t bytes;
  sv_status s = sv_file_read(from, &data, &bytes, err);
  if (s != SV_OK) return s;
  s = sv_file_write(to, data, bytes, err);
  free(data);
  return s;
}

static sv_status copy_crop(const char *from, const sv_footprint *c, const char *to, sv_err *err) {
  sv_bitmap b;
  sv_status s = sv_bitmap_read(from, &b, err);
  if (s != SV_OK) return s;
  if (c->x0_px + c->width_px > b.width_px || c->y0_px + c->height_px > b.height_px) {
    s = sv_fail(err, SV_E_RANGE, "%s: an image of %dx%d; the sub-view's %dx%d at %d,%d is not inside", from,
                b.width_px, b.height_px, c->width_px, c->height_px, c->x0_px, c->y0_px);
  } else {
    size_t sample = (size_t)(b.bits / 8 * b.n_channels), stride = sample * (size_t)b.width_px;
    uint8_t *px = b.bits == 8 ? b.u8 : (uint8_t *)b.u16;
    for (size_t y = 0; y < (size_t)c->height_px; y++)
      memmove(px + y * sample * (size_t)c->width_px,
              px + (y + (size_t)c->y0_px) * stride + sample * (size_t)c->x0_px, sample * (size_t)c->width_px);
    b.width_px = c->width_px;
    b.height_px = c->height_px;
    s = sv_bitmap_write_png(to, &b, err);
  }
  sv_bitmap_free(&b);
  return s;
}

// The name of a view's depth, or of its depth prior.
static void name_beside(const lab_import_view *v, const char *what, const char *source, char *out,
                        size_t cap) {
  snprintf(out, cap, "%.190s", v->name);
  out[strlen(out) - strlen(sv_path_extension(out))] = 0;
  size_t n = strlen(out);
  snprintf(out + n, cap - n, "_%s%s", what, sv_path_extension(source));
}

static sv_status copy_beside(const lab_import_view *v, const char *what, const char *source,
                             const char *folder, sv_err *err) {
  char to[SV_CAP_PATH], name[SV_TRANSFORMS_CAP_PATH + 16];
  if (!*source) return SV_OK;
  name_beside(v, what, source, name, sizeof name);
  sv_status s = sv_path_join(to, sizeof to, folder, name, err);
  if (s == SV_OK && strcmp(source, to) == 0) return SV_OK; // made in place
  return s == SV_OK ? copy_whole(source, to, err) : s;
}

static sv_status copy_view(const lab_import_view *v, const char *folder, sv_err *err) {
  char to[SV_CAP_PATH], up[SV_CAP_PATH];
  sv_status s = sv_path_join(to, sizeof to, folder, v->name, err);
  if (s != SV_OK) return s;
  // made in place
  if (strcmp(v->source, to) == 0 && !v->crop.width_px && !*v->depth_source) return SV_OK;
  sv_path_folder(up, sizeof up, to);
  if ((s = sv_path_make_folder(up, err)) != SV_OK) return s;
  s = v->crop.width_px ? copy_crop(v->source, &v->crop, to, err) : copy_whole(v->source, to, err);
  if (s == SV_OK) s = copy_beside(v, "depth", v->depth_source, folder, err);
  return s == SV_OK ? copy_beside(v, "prior", v->prior_source, folder, err) : s;
}

static sv_status copy_mask(const lab_import_view *v, const char *folder, sv_err *err) {
  char to[SV_CAP_PATH], up[SV_CAP_PATH], name[SV_TRANSFORMS_CAP_PATH + 16];
  snprintf(name, sizeof name, "masks/%s", v->mask_name);
  sv_status s = sv_path_join(to, sizeof to, folder, name, err);
  if (s != SV_OK) return s;
  sv_path_folder(up, sizeof up, to);
  s = sv_path_make_folder(up, err);
  return s == SV_OK ? copy_whole(v->mask_source, to, err) : s;
}

typedef struct {
  const lab_import *im;
  const lab_session *session;
  const char *out, *folder; // folder: of the images
  sv_err *errs;
} copy_job;

// The first view whose image is written under view i's name: frames may share a picture.
static int first_of_name(const lab_import *im, int i) {
  int k = 0;
  while (strcmp(im->views[k].name, im->views[i].name) != 0) k++;
  return k;
}

static bool is_first_of_mask(const lab_import *im, int i) {
  int k = 0;
  while (!*im->views[k].mask_source || strcmp(im->views[k].mask_name, im->views[i].mask_name) != 0) k++;
  return k == i;
}

static void copy_task(void *arg, int i_task, int i_thread) {
  copy_job *j = arg;
  const lab_import_view *v = &j->im->views[i_task], *first = &j->im->views[first_of_name(j->im, i_task)];
  sv_err *err = &j->errs[i_task];
  (void)i_thread;
  if (lab_is_stopped(j->session)) err->status = SV_E_INTERRUPTED;
  else if (first == v) err->status = copy_view(v, j->folder, err);
  else if (strcmp(first->source, v->source) != 0 || memcmp(&first->crop, &v->crop, sizeof v->crop) != 0)
    err->status =
        sv_fail(err, SV_E_FORMAT, "%s and %s would both be written as %s", first->source, v->source, v->name);
  if (err->status == SV_OK && *v->mask_source && is_first_of_mask(j->im, i_task))
    err->status = copy_mask(v, j->out, err);
}

static sv_status copy_all(const lab_import *im, lab_session *se, const char *out, const char *folder,
                          sv_err *err) {
  copy_job j = {im, se, out, folder, calloc((size_t)im->n, sizeof(sv_err))};
  sv_status s = SV_OK;
  if (!j.errs) return sv_fail(err, SV_E_NOMEM, "no memory to copy %d images", im->n);
  sv_pool_run(&se->pool, copy_task, &j, im->n);
  for (int i = 0; i < im->n && s == SV_OK; i++)
    if ((s = j.errs[i].status) != SV_OK && err) *err = j.errs[i];
  free(j.errs);
  return s;
}

// --- points --------------------------------------------------------------------------------------

static uint8_t to_byte(float x) { return (uint8_t)(x <= 0 ? 0 : x >= 1 ? 255 : x * 255.0f + 0.5f); }

sv_status lab_import_write_points(const lab_import *im, const char *path, sv_err *err) {
  char head[300];
  int n = snprintf(
      head, sizeof head,
      "ply\nformat binary_little_endian 1.0\nelement vertex %d\nproperty float x\nproperty float y\n"
      "property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n",
      im->n_points);
  size_t bytes = (size_t)n + 15 * (size_t)im->n_points;
  uint8_t *data = malloc(bytes), *p = data + n;
  if (!data) return sv_fail(err, SV_E_NOMEM, "%s: no memory for %d points", path, im->n_points);
  memcpy(data, head, (size_t)n);
  for (int i = 0; i < im->n_points; i++) {
    for (int k = 0; k < 3; k++, p += 4) sv_put_lef32(p, im->points[i].mean[k]);
    for (int k = 0; k < 3; k++) *p++ = to_byte(im->points[i].rgb[k]);
  }
  sv_status s = sv_file_write(path, data, bytes, err);
  free(data);
  return s;
}

// --- transforms.json -----------------------------------------------------------------------------

typedef struct {
  char *text;
  size_t bytes;
  FILE *f;
} memory;

static sv_status check_model(const lab_import_view *v, sv_err *err) {
  int n = sv_model_n_params(v->model.kind);
  if (v->model.kind == SV_MODEL_SPLINED)
    return sv_fail(err, SV_E_UNSUPPORTED, "%s: transforms.json cannot represent its splined lens model",
                   v->source);
  for (int i = 9; i < n; i++)
    if (v->model.p[i] != 0)
      return sv_fail(err, SV_E_UNSUPPORTED,
                     "%s: transforms.json cannot represent its rational lens terms (k4 to k6)", v->source);
  return SV_OK;
}

void lab_put_matrix(FILE *f, const sv_pose *cam_from_world) {
  sv_pose w = sv_pose_inv(cam_from_world);
  fprintf(f, "[");
  for (int i = 0; i < 3; i++)
    fprintf(f, "[%.17g, %.17g, %.17g, %.17g], ", w.r[3 * i], -w.r[3 * i + 1], -w.r[3 * i + 2], w.t[i]);
  fprintf(f, "[0, 0, 0, 1]]");
}

static void put_view(FILE *f, const lab_import_view *v) {
  static const char *const opencv[] = {"fl_x", "fl_y", "cx", "cy", "k1", "k2", "p1", "p2", "k3"},
                           *const fisheye[] = {"fl_x", "fl_y", "cx", "cy", "k1", "k2", "k3", "k4"};
  const char *const *names = v->model.kind == SV_MODEL_KB4 ? fisheye : opencv;
  char text[6 * SV_TRANSFORMS_CAP_PATH], name[SV_TRANSFORMS_CAP_PATH + 16];
  sv_str s = sv_str_make(text, sizeof text);
  sv_str_add_json(&s, v->name);
  fprintf(f, "  {\"file_path\": \"images/%s\"", text);
  fprintf(f, ", \"w\": %d, \"h\": %d", v->model.width_px, v->model.height_px);
  int n = sv_model_n_params(v->model.kind);
  if (v->model.kind == SV_MODEL_KB4) fprintf(f, ", \"camera_model\": \"OPENCV_FISHEYE\"");
  for (int i = 0; i < n && i < 9; i++) fprintf(f, ", \"%s\": %.17g", names[i], v->model.p[i]);
  if (v->exposure >= 0) fprintf(f, ", \"exposure\": %d", v->exposure);
  if (v->sub_view >= 0) fprintf(f, ", \"sub_view\": %d", v->sub_view);
  if (v->time >= 0) fprintf(f, ", \"time\": %.9g", v->time);
  if (*v->camera) {
    s = sv_str_make(text, sizeof text);
    sv_str_add_json(&s, v->camera);
    fprintf(f, ", \"camera\": \"%s\"", text);
  }
  if (*v->split) {
    s = sv_str_make(text, sizeof text);
    sv_str_add_json(&s, v->split);
    fprintf(f, ", \"split\": \"%s\"", text);
  }
  if (*v->mask_source) {
    s = sv_str_make(text, sizeof text);
    sv_str_add_json(&s, v->mask_name);
    fprintf(f, ", \"mask_path\": \"masks/%s\"", text);
  }
  if (*v->depth_source) {
    name_beside(v, "depth", v->depth_source, name, sizeof name);
    s = sv_str_make(text, sizeof text);
    sv_str_add_json(&s, name);
    fprintf(f, ", \"%s\": \"images/%s\"", v->depth_kind == SV_DEPTH_RAY ? "ray_distance_path" : "depth_path",
            text);
  }
  if (*v->prior_source) {
    name_beside(v, "prior", v->prior_source, name, sizeof name);
    s = sv_str_make(text, sizeof text);
    sv_str_add_json(&s, name);
    fprintf(f, ", \"depth_prior\": \"images/%s\"", text);
  }
  fprintf(f, ", \"transform_matrix\": ");
  lab_put_matrix(f, &v->cam_from_world);
  fprintf(f, "}");
}

// Of the points that belong to a transforms file: transforms_train_mono.json has
// points3d_mono.ply, others points3d.ply.
static void points_name(const char *transforms, char *out, size_t cap) {
  static const char train[] = "transforms_train";
  const bool is_own = strncmp(transforms, train, sizeof train - 1) == 0;
  const char *rest = is_own ? transforms + sizeof train - 1 : "";
  snprintf(out, cap, "points3d%.*s.ply", (int)(strlen(rest) - strlen(sv_path_extension(rest))), rest);
}

static sv_status write_json(const lab_import *im, const char *path, sv_err *err) {
  char points[SV_CAP_PATH];
  memory m = {0};
  sv_status s = SV_OK;
  for (int i = 0; i < im->n && s == SV_OK; i++) s = check_model(&im->views[i], err);
  if (s != SV_OK) return s;
  if (!(m.f = open_memstream(&m.text, &m.bytes)))
    return sv_fail(err, SV_E_NOMEM, "%s: no memory for its text", path);
  fprintf(m.f, "{\n");
  if (im->unit.is_metric) fprintf(m.f, "\"world_unit\": \"m\",\n");
  if (im->unit.scale_sigma > 0) fprintf(m.f, "\"world_scale_sigma\": %.3g,\n", (double)im->unit.scale_sigma);
  points_name(sv_path_name(path), points, sizeof points);
  if (im->n_points) fprintf(m.f, "\"ply_file_path\": \"%s\",\n", points);
  for (int i = 0, has_unit = 0; i < im->n && !has_unit; i++)
    if ((has_unit = *im->views[i].depth_source && im->views[i].depth_unit > 0))
      fprintf(m.f, "\"%s\": %.17g,\n",
              im->views[i].depth_kind == SV_DEPTH_RAY ? "ray_distance_unit" : "depth_unit_scale_factor",
              im->views[i].depth_unit);
  fprintf(m.f, "\"frames\": [\n");
  for (int i = 0; i < im->n; i++) {
    put_view(m.f, &im->views[i]);
    fprintf(m.f, "%s\n", i + 1 < im->n ? "," : "");
  }
  fprintf(m.f, "]\n}\n");
  s = fclose(m.f) == 0 ? sv_file_write(path, m.text, m.bytes, err)
                       : sv_fail(err, SV_E_NOMEM, "%s: no memory for its text", path);
  free(m.text);
  return s;
}

// One unit stands for all files, so they must have the same.
static sv_status check_depth(const lab_import *im, sv_err *err) {
  const lab_import_view *first = NULL;
  for (int i = 0; i < im->n; i++) {
    const lab_import_view *v = &im->views[i];
    if (!*v->depth_source) continue;
    if (!first) first = v;
    if (v->depth_kind != first->depth_kind)
      return sv_fail(err, SV_E_UNSUPPORTED,
                     "%s: depth along the ray and %s: along the optical axis; expected one kind for all",
                     v->depth_kind == SV_DEPTH_RAY ? v->depth_source : first->depth_source,
                     v->depth_kind == SV_DEPTH_RAY ? first->depth_source : v->depth_source);
    if (v->depth_unit != first->depth_unit)
      return sv_fail(err, SV_E_UNSUPPORTED,
                     "%s: its depth unit is %g and that of %s is %g; expected one for all", v->depth_source,
                     v->depth_unit, first->depth_source, first->depth_unit);
  }
  return SV_OK;
}

sv_status lab_import_write_as(lab_import *im, lab_session *se, const char *folder, const char *transforms,
                              sv_err *err) {
  char images[SV_CAP_PATH], path[SV_CAP_PATH], points[SV_CAP_PATH];
  for (int i = 0; i < im->n; i++)
    sv_make_utf8(im->views[i].name); // the file is called as transforms.json says
  if (im->n < 1) return sv_fail(err, SV_E_NOT_FOUND, "no views to import");
  sv_status s = check_depth(im, err);
  if (s == SV_OK) s = sv_path_join(images, sizeof images, folder, "images", err);
  if (s == SV_OK) s = sv_path_make_folder(images, err);
  if (s == SV_OK) s = copy_all(im, se, folder, images, err);
  points_name(transforms, points, sizeof points);
  if (s == SV_OK) s = sv_path_join(path, sizeof path, folder, points, err);
  if (s == SV_OK && im->n_points) s = lab_import_write_points(im, path, err);
  if (s == SV_OK) s = sv_path_join(path, sizeof path, folder, transforms, err);
  return s == SV_OK ? write_json(im, path, err) : s;
}

sv_status lab_import_write(lab_import *im, lab_session *se, const char *out, sv_err *err) {
  if (im->n < 1) return sv_fail(err, SV_E_NOT_FOUND, "no views to import");
  sv_status s = lab_session_folder(se, out, err);
  return s == SV_OK ? lab_import_write_as(im, se, out, "transforms.json", err) : s;
}
