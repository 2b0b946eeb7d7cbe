// SPDX-License-Identifier: Apache-2.0
// Lens distortion is taken out once, while loading.
#include <stdlib.h>
#include <string.h>

#include "tools/dataset/dataset.h"

bool lab_is_same_lens(const sv_camera_model *a, const sv_camera_model *b) {
  return a->kind == b->kind && a->width_px == b->width_px && a->height_px == b->height_px &&
         memcmp(a->p, b->p, sizeof a->p) == 0 && a->spline.control == b->spline.control;
}

sv_status lab_undistort_map(lab_loader *l, const lab_frame *f, sv_err *err) {
  if (l->map.entries && lab_is_same_lens(&l->lens, &f->f.model)) return SV_OK;
  lab_loader_free(l);
  size_t n = (size_t)f->lens.model.width_px * (size_t)f->lens.model.height_px;
  sv_remap_tap *entries = malloc(n * sizeof *entries);
  if (!entries) return sv_fail(err, SV_E_NOMEM, "%s: no memory for its undistortion table", f->path);
  sv_status s = sv_remap_build(&l->map, &f->f.model, &f->lens.model, entries);
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
