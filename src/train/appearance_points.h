// SPDX-License-Identifier: Apache-2.0
// Surface points that several views see, and the light that each view shows of them: what
// appearance starts from (appearance_start.h). Owns nothing: all lies in the scratch. Never moves
// a Gaussian.
#ifndef SV_TRAIN_APPEARANCE_POINTS_H
#define SV_TRAIN_APPEARANCE_POINTS_H

#include "src/train/train.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_APPEARANCE_CAP_POINTS 4096
#define SV_APPEARANCE_CAP_VIEWS  64 // of more, as many are taken at even distances

typedef struct {
  float log_value[3]; // of the light, which is 0 to 1
  float r2;           // as of the falloff (appearance.h); below 0: the view does not show the point
} sv_appearance_seen;

typedef struct {
  int n_points, n_views;
  int n_shared; // points that at least two views show
  int view[SV_APPEARANCE_CAP_VIEWS];
  sv_appearance_seen *seen; // [n_points][n_views]
  // Of the search.
  float (*point)[3]; // [n_points]
  float *reach;      // [n_points] half the side of the square that is averaged, in the scene's unit
  float light[256];  // of display values
} sv_appearance_points;

size_t sv_appearance_points_bytes(const sv_train_cfg *cfg); // scratch that it takes
// Of a trainer whose Gaussians stand on the surface, with its views added. Errors: of rendering,
// E_NOMEM.
sv_status sv_appearance_points_find(sv_appearance_points *p, sv_trainer *t, sv_arena *scratch) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
