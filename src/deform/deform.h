// SPDX-License-Identifier: Apache-2.0
// Deformation of a moving scene: the Gaussians of a time from the stored ones, by per-Gaussian
// motion (motion.h) or by a shared field (field.h).
// Owns both models' arrays. Never trains: src/dynamic does.
#ifndef SV_DEFORM_DEFORM_H
#define SV_DEFORM_DEFORM_H

#include "src/deform/field.h"
#include "src/deform/motion.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef enum { SV_DEFORM_NONE, SV_DEFORM_CLIP, SV_DEFORM_FIELD } sv_deform_kind;

typedef struct {
  sv_deform_kind kind;
  sv_motion motion; // of CLIP
  sv_field field;   // of FIELD
} sv_deform;

// Gaussians [0, n) move.
static inline int sv_deform_n_moving(const sv_deform *d) {
  return d->kind == SV_DEFORM_FIELD ? d->field.n_moving : d->motion.n_moving;
}
// As constant as what d is of.
static inline sv_bodies *sv_deform_bodies(const sv_deform *d) {
  const sv_bodies *b = d->kind == SV_DEFORM_FIELD ? &d->field.bodies : &d->motion.bodies;
  return (sv_bodies *)(uintptr_t)b;
}
static inline void sv_deform_set_moving(sv_deform *d, int n) { d->field.n_moving = d->motion.n_moving = n; }

static inline void sv_deform_at(sv_deform *d, const sv_compute *c, sv_gaussians *g, float t) {
  if (d->kind == SV_DEFORM_CLIP) sv_motion_at(&d->motion, c, g, t);
  if (d->kind == SV_DEFORM_FIELD) sv_field_at(&d->field, c, g, t);
}

#ifdef __cplusplus
}
#endif
#endif
