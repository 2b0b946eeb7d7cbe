// SPDX-License-Identifier: Apache-2.0
// Where appearance starts: surface points that several views see tell how cameras and exposures
// differ, before a step is taken and again while training. Owns nothing. Never moves a Gaussian.
#ifndef SV_TRAIN_APPEARANCE_START_H
#define SV_TRAIN_APPEARANCE_START_H

#include "src/train/train.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_CAP_APPEARANCE_UNKNOWNS 256 // 3 a camera and 1 an exposure; with more all starts alike

size_t sv_appearance_start_bytes(const sv_train_cfg *cfg); // scratch; 0 without appearance
// Whether nothing is known of a camera, or, with one exposure, little of its falloff. (Several see
// surfaces from many sides: what trained Gaussians add is less than what gloss takes.)
bool sv_appearance_is_uncertain(const sv_trainer *t);
// For a trainer whose Gaussians stand on the surface, with its views added. Solves
//   log light(point, view) = color(point) + camera + exposure + f1 r^2 + f2 r^4
// for each channel, robustly, over points that several views see; then the cameras' color matrices
// (appearance_matrix.h). Sets the groups, which Adam moves on from there, and what was measured.
// Does nothing without appearance, with too many groups or with too few such points. *n_points:
// those used.
// Errors: of rendering.
sv_status sv_appearance_start(sv_trainer *t, sv_arena *scratch, int *n_points) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
