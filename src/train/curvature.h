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
// After the loss of an image whose mean |residual| is l1: `probe`, planes of the image's size whose
// values are free for reuse (t->target), becomes the Hutchinson probe, whose gradients are squared
// into the running means. Those of all tiles, from newton.half_from on of half.
sv_status sv_train_curvature(sv_trainer *t, double l1, bool is_supersampled, sv_planes *probe) SV_MUST_USE;
// The same of several renderings that together are one measurement, always of all tiles: the probe,
// then for each its gradients (sv_render_bwd) and collect, then apply.
void sv_train_make_probe(const sv_trainer *t, double l1, sv_planes *probe);
void sv_train_collect_curvature(sv_trainer *t);
void sv_train_apply_curvature(sv_trainer *t);

#ifdef __cplusplus
}
#endif
#endif
