// SPDX-License-Identifier: Apache-2.0
// True depth of the release's synthetic test views. The authors' prepare-depth renders, for view N
// of transforms_test.json, the world position of each pixel: positions/position_{x,y,z}_NNNN.exr
// (channel V, 32-bit floats; 0 where there is no surface). Depth is along the optical axis.
#include <ctype.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/str.h"
#include "tools/common/exr.h"
#include "tools/import/release.h"

#define CHANNEL "V"

typedef struct {
  float *at[3], *depth; // positions x, y, z, and depth; each of cap pixels
  size_t cap;
} buffers;

static void stop(buffers *b) {
  for (int k = 0; k < 3; k++) free(b->at[k]);
  free(b->depth);
  *b = (buffers){0};
}

static sv_status room(buffers *b, size_t n, sv_err *err) {
  if (n <= b->cap) return SV_OK;
  stop(b);
  for (int k = 0; k < 3; k++) b->at[k] = malloc(n * sizeof(float));
  b->depth = malloc(n * sizeof(float));
  b->cap = n;
  if (b->at[0] && b->at[1] && b->at[2] && b->depth) return SV_OK;
  return sv_fail(err, SV_E_NOMEM, "no memory for positions of %zu pixels", n);
}

// The number behind the last _ of a picture's name: r_12.png is view 12. -1: there is none.
static int number_of(const char *name) {
  const char *at = strrchr(sv_path_name(name), '_');
  if (!at || !isdigit((unsigned char)at[1])) return -1;
  return atoi(at + 1);
}

static sv_status position_path(char out[SV_CAP_PATH], const char *scene, char axis, int number, sv_err *err) {
  char name[60];
  snprintf(name, sizeof name, "positions/position_%c_%04d.exr", axis, number);
  return sv_path_join(out, SV_CAP_PATH, scene, name, err);
}

// Depth of a view, 0 where there is no surface; *largest grows.
static sv_status read_depth(buffers *b, const char *scene, const lab_import_view *v, float *largest,
                            sv_err *err) {
  const lab_exr_want want = {CHANNEL, v->model.width_px, v->model.height_px};
  const size_t n = (size_t)want.width_px * (size_t)want.height_px;
  const double *r = v->cam_from_world.r + 6;
  char path[SV_CAP_PATH];
  sv_status s = room(b, n, err);
  for (int k = 0; k < 3 && s == SV_OK; k++) {
    s = position_path(path, scene, "xyz"[k], number_of(v->name), err);
    if (s == SV_OK) s = lab_exr_read(path, &want, b->at[k], err);
  }
  for (size_t i = 0; i < n && s == SV_OK; i++) {
    const double x = (double)b->at[0][i], y = (double)b->at[1][i], z = (double)b->at[2][i],
                 depth = r[0] * x + r[1] * y + r[2] * z + v->cam_from_world.t[2];
    const bool is_surface = isfinite(depth) && depth > 0 && (x != 0 || y != 0 || z != 0);
    b->depth[i] = is_surface ? (float)depth : 0;
    if (b->depth[i] > *largest) *largest = b->depth[i];
  }
  return s;
}

// 16 bits, in steps of `unit`.
static sv_status save_depth(const buffers *b, lab_import_view *v, const char *folder, double unit,
                            sv_err *err) {
  char up[SV_CAP_PATH], name[SV_TRANSFORMS_CAP_PATH + 20];
  const size_t n = (size_t)v->model.width_px * (size_t)v->model.height_px;
  uint16_t *steps = malloc(n * sizeof *steps);
  if (!steps) return sv_fail(err, SV_E_NOMEM, "%s: no memory for its depth", v->name);
  for (size_t i = 0; i < n; i++) steps[i] = (uint16_t)fmin(65535, (double)b->depth[i] / unit + 0.5);
  snprintf(name, sizeof name, "images/%.*s_depth.png",
           (int)(strlen(v->name) - strlen(sv_path_extension(v->name))), v->name);
  sv_status s = sv_path_join(v->depth_source, sizeof v->depth_source, folder, name, err);
  sv_path_folder(up, sizeof up, v->depth_source);
  if (s == SV_OK) s = sv_path_make_folder(up, err);
  const sv_bitmap bitmap = {v->model.width_px, v->model.height_px, 1, 16, NULL, steps};
  if (s == SV_OK) s = sv_bitmap_write_png(v->depth_source, &bitmap, err);
  free(steps);
  v->depth_kind = SV_DEPTH_Z;
  v->depth_unit = unit;
  return s;
}

sv_status lab_release_positions(const lab_release *r, lab_import *im, const char *scene, const char *folder,
                                sv_err *err) {
  buffers b = {0};
  char path[SV_CAP_PATH];
  float largest = 0;
  sv_status s = sv_path_join(path, sizeof path, scene, "positions", err);
  if (s != SV_OK || !sv_path_is_folder(path)) return s;
  if (!lab_has_exr()) {
    lab_say(r->se, "%s: left out, as this build reads no OpenEXR (libopenexr-dev was missing)", path);
    return SV_OK;
  }
  // One unit stands for all files, so the largest depth has to be known first.
  for (int i = 0; i < im->n && s == SV_OK; i++) s = read_depth(&b, scene, &im->views[i], &largest, err);
  if (s == SV_OK && !(largest > 0))
    s = sv_fail(err, SV_E_FORMAT, "%.150s: no position lies before its camera", path);
  for (int i = 0; i < im->n && s == SV_OK; i++) {
    if (lab_is_stopped(r->se)) s = SV_E_INTERRUPTED;
    if (s == SV_OK) s = read_depth(&b, scene, &im->views[i], &largest, err);
    if (s == SV_OK) s = save_depth(&b, &im->views[i], folder, (double)largest / 65535, err);
  }
  stop(&b);
  return s;
}
