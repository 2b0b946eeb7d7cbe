// SPDX-License-Identifier: Apache-2.0
// Hutchinson estimates of the loss's diagonal curvature, for Gauss-Newton (curvature.c, where the
// formulas are).
#ifndef SV_TRAIN_CURVATURE_H
#define SV_TRAIN_CURVATURE_H

#include "src/train/train.h"

#ifdef __cplusplus
extern "C" {
#endif

// Whether this step estimates the curvature.
bool sv_train_is_probe_due(const sv_trainer *t);
// What was rendered, and how far from its target it is.
typedef struct {
  double l1;                 // mean |residual| over the pixels that count
  const sv_image_u8 *masked; // has a mask or none; NULL: all pixels count
  int scale;                 // of that image
  bool is_supersampled;
  // Of a deep view, whose residuals are of what its camera shows; else rendered is NULL.
  int i_view;
  const sv_planes *rendered;
  const sv_view *view;
} sv_train_residual;

// After the loss of an image: `probe`, planes of the image's size whose values are free for reuse
// (t->target), becomes the Hutchinson probe, whose gradients are squared into the running means.
// Those of all tiles, from newton.half_from on of half.
sv_status sv_train_curvature(sv_trainer *t, const sv_train_residual *r, sv_planes *probe) SV_MUST_USE;
// The same of several renderings that together are one measurement, always of all tiles: the probe,
// then for each its gradients (sv_render_bwd) and collect, then apply.
void sv_train_make_probe(const sv_trainer *t, double l1, sv_planes *probe);
void sv_train_collect_curvature(sv_trainer *t);
void sv_train_apply_curvature(sv_trainer *t);

#ifdef __cplusplus
}
#endif
#endif
