// SPDX-License-Identifier: Apache-2.0
// Lens distortion is taken out once, while loading: trainer and renderer know pinholes and fisheyes
// only.
#include <stdlib.h>
#include <string.h>

#include "tools/dataset/dataset.h"

sv_status lab_undistort_choose(lab_frame *f, sv_err *err) {
  // Pixels that the lens never saw must not be trained on, so the view is cropped to where it saw
  // all.
  if (sv_pinhole_for_model(&f->f.model, SV_PINHOLE_CROP_TO_VALID, &f->pinhole)) return SV_OK;
  return sv_fail(err, SV_E_RANGE,
                 "%s: no undistorted view fits this lens (%s, fx %g px); check its distortion", f->path,
                 sv_model_name(f->f.model.kind), f->f.model.p[0]);
}

bool lab_is_lit(const lab_frame *f, double u_px, double v_px) {
  const double *p = f->f.model.p;
  const float xy[2] = {(float)((u_px - p[2]) / p[0]), (float)((v_px - p[3]) / p[1])};
  float ray[3];
  return sv_fisheye_unproject(&f->fisheye, xy, ray);
}

bool lab_has_dark_corner(const lab_frame *f) {
  const double w = f->f.model.width_px, h = f->f.model.height_px;
  return !(lab_is_lit(f, 0, 0) && lab_is_lit(f, w, 0) && lab_is_lit(f, 0, h) && lab_is_lit(f, w, h));
}

bool lab_is_same_lens(const sv_camera_model *a, const sv_camera_model *b) {
  return a->kind == b->kind && a->width_px == b->width_px && a->height_px == b->height_px &&
         memcmp(a->p, b->p, sizeof a->p) == 0 && a->spline.control == b->spline.control;
}

sv_status lab_undistort_map(lab_loader *l, const lab_frame *f, sv_err *err) {
  if (l->map.entries && lab_is_same_lens(&l->lens, &f->f.model)) return SV_OK;
  lab_loader_free(l);
  size_t n = (size_t)f->pinhole.width_px * (size_t)f->pinhole.height_px;
  sv_remap_tap *entries = malloc(n * sizeof *entries);
  if (!entries) return sv_fail(err, SV_E_NOMEM, "%s: no memory for its undistortion table", f->path);
  sv_status s = sv_remap_build(&l->map, &f->f.model, &f->pinhole, entries);
  if (s != SV_OK) {
    free(entries);
    memset(l, 0, sizeof *l);
    return sv_fail(err, s, "%s: its lens cannot be undistorted", f->path);
  }
  l->lens = f->f.model;
  return SV_OK;
}

void lab_loader_free(lab_loader *l) {
  free(l->map.entries);
  memset(l, 0, sizeof *l);
}
