// SPDX-License-Identifier: Apache-2.0
// VGGT's predictions.npz (extrinsic [n][3][4] camera from world, intrinsic [n][3][3], depth or
// world_points at the network's size) and MegaSaM's *_sgd_cvd_hr.npz (cam_c2w [n][4][4], intrinsic
// [3][3], depths [n][h][w], images [n][h][w][3]). Cameras are OpenCV's in both.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/str.h"
#include "tools/import/network.h"

#define N_POINTS  100000
#define VGGT_SIDE 518 // VGGT's pictures are so wide; sides are multiples of 14
#define VGGT_STEP 14
#define SAM_AREA  (384.0 * 512.0) // MegaSaM's pictures have about so many pixels; sides: of 8
#define SAM_STEP  8

typedef struct {
  const char *file;
  sv_npz z;
  sv_npy pose, k, depth, colors, sure; // sure: confidence of depths; the last two may be absent
  size_t n, width, height;
  bool is_planar; // colors are [n][3][h][w] of 0 to 1, else [n][h][w][3] of 0 to 255
  lab_net_pictures pictures;
} archive;

static void close_archive(archive *a) {
  sv_npy_free(&a->pose);
  sv_npy_free(&a->k);
  sv_npy_free(&a->depth);
  sv_npy_free(&a->colors);
  sv_npy_free(&a->sure);
  sv_npz_close(&a->z);
  sv_names_free(&a->pictures.names);
}

static sv_status wrong_shape(const archive *a, const sv_npy *y, const char *want, sv_err *err) {
  return sv_fail(err, SV_E_FORMAT, "%s: array %s has %d dimensions or other lengths than expected: %s",
                 a->file, y->name, y->n_dims, want);
}

// The file itself, or the only .npz of the folder.
static sv_status find_file(const char *input, char path[SV_CAP_PATH], sv_err *err) {
  sv_names names;
  int n = 0, at = 0;
  if (!sv_path_is_folder(input)) return sv_path_join(path, SV_CAP_PATH, ".", input, err);
  sv_status s = sv_folder_list(input, &names, err);
  if (s != SV_OK) return s;
  for (int i = 0; i < names.n; i++) {
    if (!sv_str_eq(sv_path_extension(names.names[i]), ".npz")) continue;
    n++;
    at = i;
  }
  s = n == 1
          ? sv_path_join(path, SV_CAP_PATH, input, names.names[at], err)
          : sv_fail(err, SV_E_NOT_FOUND, "%s: has %d .npz files; expected one, or give the file", input, n);
  sv_names_free(&names);
  return s;
}

// An array that may be absent.
static sv_status get_if(const archive *a, const char *name, sv_npy *out, sv_err *err) {
  return sv_npz_has(&a->z, name) ? sv_npz_get(&a->z, name, out, err) : SV_OK;
}

static void matrix_at(const sv_npy *y, size_t i, size_t stride, int n, double *m) {
  for (int k = 0; k < n; k++) m[k] = sv_npy_real(y, i * stride + (size_t)k);
}

// --- points --------------------------------------------------------------------------------------

static int by_value(const void *p, const void *q) {
  double x = *(const double *)p, y = *(const double *)q;
  return x < y ? -1 : x > y;
}

// Half of the confidences are below; 0 without them.
static double least_sure(const archive *a, size_t step) {
  if (!a->sure.n_items) return 0;
  double *v = malloc((a->sure.n_items / step + 1) * sizeof *v), out = 0;
  size_t n = 0;
  for (size_t i = 0; v && i < a->sure.n_items; i += step) {
    v[n] = sv_npy_real(&a->sure, i);
    n += isfinite(v[n]);
  }
  if (n) qsort(v, n, sizeof *v, by_value);
  if (n) out = v[n / 2];
  free(v);
  return out;
}

static void color_at(const archive *a, size_t i, size_t pixel, float rgb[3]) {
  const size_t plane = a->width * a->height;
  for (size_t c = 0; c < 3; c++) {
    rgb[c] = 0.5f;
    if (!a->colors.n_items) continue;
    double v = a->is_planar ? sv_npy_real(&a->colors, (3 * i + c) * plane + pixel)
                            : sv_npy_real(&a->colors, 3 * (i * plane + pixel) + c) / 255;
    if (v >= 0 && v <= 1) rgb[c] = (float)v;
  }
}

// Points of the depth maps, spread evenly over all of them.
static sv_status add_points(archive *a, lab_import *im, const lab_net_camera *cameras, sv_err *err) {
  const size_t plane = a->width * a->height, all = a->n * plane;
  size_t step = all / N_POINTS + 1;
  while (step > 1 && a->width % step == 0) step++; // not the same columns in each row
  const double least = least_sure(a, step);
  for (size_t at = 0; at < all; at += step) {
    const size_t i = at / plane, pixel = at % plane;
    const lab_net_camera *c = &cameras[i];
    double d = sv_npy_real(&a->depth, at), x[3];
    if (!(d > 1e-6 && d < 1e6) || (least > 0 && !(sv_npy_real(&a->sure, at) >= least))) continue;
    x[0] = d * ((double)(pixel % a->width) + 0.5 - c->k[2]) / c->k[0];
    x[1] = d * ((double)(pixel / a->width) + 0.5 - c->k[5]) / c->k[4];
    x[2] = d;
    sv_point *p = lab_import_add_point(im);
    if (!p) return sv_fail(err, SV_E_NOMEM, "%s: no memory for its points", a->file);
    sv_pose world_from_cam = sv_pose_inv(&c->cam_from_world);
    sv_pose_apply(x, &world_from_cam, x);
    for (int k = 0; k < 3; k++) p->mean[k] = (float)x[k];
    color_at(a, i, pixel, p->rgb);
  }
  return SV_OK;
}

// --- VGGT ----------------------------------------------------------------------------------------

static double whole_steps(double x) { return nearbyint(x / VGGT_STEP) * VGGT_STEP; }

// Whether a portrait picture was padded with white at its sides: then the first column is white.
static bool is_padded(const archive *a, size_t i) {
  for (size_t y = 0; a->colors.n_items && y < a->height; y++)
    if (sv_npy_real(&a->colors, 3 * i * a->width * a->height + y * a->width) < 0.999) return false;
  return a->colors.n_items > 0;
}

// Its pictures are 518 wide, and cut or padded about their middle.
static lab_net_fit fit_vggt(const archive *a, size_t i, const lab_peek *p) {
  double w = VGGT_SIDE, h = whole_steps(p->height_px * (w / p->width_px));
  if (p->height_px > p->width_px && is_padded(a, i)) {
    h = VGGT_SIDE;
    w = whole_steps(p->width_px * (h / p->height_px));
  }
  lab_net_fit fit = {.scale = {p->width_px / w, p->height_px / h}};
  fit.shift[0] = 0.5 * ((double)a->width - w);
  fit.shift[1] = floor(0.5 * ((double)a->height - h));
  return fit;
}

static sv_status open_vggt(archive *a, sv_err *err) {
  const size_t pose_shape[3] = {0, 3, 4}, k_shape[3] = {0, 3, 3};
  sv_status s = sv_npz_get(&a->z, "extrinsic", &a->pose, err);
  if (s == SV_OK) s = sv_npz_get(&a->z, "intrinsic", &a->k, err);
  if (s == SV_OK) s = sv_npz_get(&a->z, "depth", &a->depth, err);
  if (s == SV_OK) s = get_if(a, "images", &a->colors, err);
  if (s == SV_OK) s = get_if(a, "depth_conf", &a->sure, err);
  if (s != SV_OK) return s;
  a->n = a->pose.dim[0];
  const size_t depth_shape[4] = {a->n, 0, VGGT_SIDE, 1};
  if (!sv_npy_is_shape(&a->pose, 3, pose_shape) || !a->n)
    return wrong_shape(a, &a->pose, "poses x 3 x 4", err);
  if (!sv_npy_is_shape(&a->k, 3, k_shape) || a->k.dim[0] != a->n)
    return wrong_shape(a, &a->k, "poses x 3 x 3", err);
  if (!sv_npy_is_shape(&a->depth, 4, depth_shape))
    return wrong_shape(a, &a->depth, "poses x height x 518 x 1", err);
  a->height = a->depth.dim[1];
  a->width = a->depth.dim[2];
  const size_t image_shape[4] = {a->n, 3, a->height, a->width}, sure_shape[3] = {a->n, a->height, a->width};
  if (a->colors.n_items && !sv_npy_is_shape(&a->colors, 4, image_shape))
    return wrong_shape(a, &a->colors, "poses x 3 x height x width", err);
  if (a->sure.n_items && !sv_npy_is_shape(&a->sure, 3, sure_shape))
    return wrong_shape(a, &a->sure, "poses x height x width", err);
  a->is_planar = true;
  return SV_OK;
}

// --- MegaSaM -------------------------------------------------------------------------------------

// Its pictures have about 384x512 pixels; what exceeds multiples of 8 is cut off at the right and
// below. Other sizes: the whole picture, reduced.
static lab_net_fit fit_megasam(const archive *a, const lab_peek *p) {
  const double ratio = sqrt(SAM_AREA / ((double)p->width_px * p->height_px));
  const size_t w = (size_t)(p->width_px * ratio), h = (size_t)(p->height_px * ratio);
  bool is_cut = w - w % SAM_STEP == a->width && h - h % SAM_STEP == a->height;
  return (lab_net_fit){
      {p->width_px / (double)(is_cut ? w : a->width), p->height_px / (double)(is_cut ? h : a->height)},
      {0, 0}};
}

static sv_status open_megasam(archive *a, sv_err *err) {
  const size_t pose_shape[3] = {0, 4, 4}, k_shape[2] = {3, 3};
  sv_status s = sv_npz_get(&a->z, "cam_c2w", &a->pose, err);
  if (s == SV_OK) s = sv_npz_get(&a->z, "intrinsic", &a->k, err);
  if (s == SV_OK) s = sv_npz_get(&a->z, "depths", &a->depth, err);
  if (s == SV_OK) s = get_if(a, "images", &a->colors, err);
  if (s != SV_OK) return s;
  a->n = a->pose.dim[0];
  const size_t depth_shape[3] = {a->n, 0, 0};
  if (!sv_npy_is_shape(&a->pose, 3, pose_shape) || !a->n)
    return wrong_shape(a, &a->pose, "poses x 4 x 4", err);
  if (!sv_npy_is_shape(&a->k, 2, k_shape)) return wrong_shape(a, &a->k, "3 x 3", err);
  if (!sv_npy_is_shape(&a->depth, 3, depth_shape) || !a->depth.n_items)
    return wrong_shape(a, &a->depth, "poses x height x width", err);
  a->height = a->depth.dim[1];
  a->width = a->depth.dim[2];
  const size_t image_shape[4] = {a->n, a->height, a->width, 3};
  if (a->colors.n_items && !sv_npy_is_shape(&a->colors, 4, image_shape))
    return wrong_shape(a, &a->colors, "poses x height x width x 3", err);
  return SV_OK;
}

// --- both ----------------------------------------------------------------------------------------

static sv_status read_camera(const archive *a, size_t i, bool is_vggt, lab_net_camera *c, sv_err *err) {
  double m[12];
  lab_peek size;
  sv_status s = lab_net_size(&a->pictures, i, &size, err);
  if (s != SV_OK) return s;
  matrix_at(&a->pose, i, is_vggt ? 12 : 16, 12, m);
  matrix_at(&a->k, is_vggt ? i : 0, 9, 9, c->k);
  c->fit = is_vggt ? fit_vggt(a, i, &size) : fit_megasam(a, &size);
  s = lab_net_pose(a->file, m, i, &c->cam_from_world, err);
  if (s == SV_OK && !is_vggt) c->cam_from_world = sv_pose_inv(&c->cam_from_world);
  return s;
}

static sv_status import_archive(lab_import *im, const lab_options *o, bool is_vggt, sv_err *err) {
  char path[SV_CAP_PATH];
  archive *a = calloc(1, sizeof *a);
  lab_net_camera *cameras = NULL;
  sv_status s = a ? find_file(o->input, path, err) : sv_fail(err, SV_E_NOMEM, "%s: no memory", o->input);
  if (s == SV_OK) {
    a->file = path;
    s = sv_npz_open(&a->z, path, err);
  }
  if (s == SV_OK) s = is_vggt ? open_vggt(a, err) : open_megasam(a, err);
  if (s == SV_OK) s = lab_net_list(&a->pictures, o, path, a->n, err);
  if (s == SV_OK && !(cameras = calloc(a->n, sizeof *cameras)))
    s = sv_fail(err, SV_E_NOMEM, "%s: no memory for its poses", path);
  for (size_t i = 0; s == SV_OK && i < a->n; i++) {
    s = read_camera(a, i, is_vggt, &cameras[i], err);
    if (s == SV_OK) s = lab_net_add(im, &a->pictures, i, &cameras[i], err);
    if (s == SV_OK && !is_vggt && a->n > 1) // a video
      im->views[im->n - 1].time = (double)i / (double)(a->n - 1);
  }
  if (s == SV_OK) s = add_points(a, im, cameras, err);
  free(cameras);
  if (a) close_archive(a);
  free(a);
  return s;
}

sv_status lab_import_vggt(lab_import *im, const lab_options *o, sv_err *err) {
  char list[SV_CAP_PATH];
  if (sv_path_is_folder(o->input) && lab_import_colmap_model(o->input, list))
    return lab_import_colmap(im, o->input, err);
  return import_archive(im, o, true, err);
}

sv_status lab_import_megasam(lab_import *im, const lab_options *o, sv_err *err) {
  return import_archive(im, o, false, err);
}
