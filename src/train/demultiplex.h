// SPDX-License-Identifier: Apache-2.0
// Lens images of multiplexed sensors, told apart by a model of the scene, for depth maps. Owns
// nothing: images lie in the caller's scratch. Never changes the model.
//
// A pixel of the sensor that one lens alone lights is that lens's own. Where several overlap, each
// is rendered, and what the sum of the renderings lacks of the measurement is shared out between
// them: the images closest to the renderings whose sum is the measurement (a projection, Kaczmarz
// 1937),
//   L_m = R_m + w_m (M y - sum_n w_n R_n) / sum_n w_n^2      in the light that the sensor adds.
#ifndef SV_TRAIN_DEMULTIPLEX_H
#define SV_TRAIN_DEMULTIPLEX_H

#include "src/train/train.h"

#ifdef __cplusplus
extern "C" {
#endif

// Scratch for the lens images; 0 without lenses in cfg.
size_t sv_demultiplex_bytes(const sv_train_cfg *cfg);
// The settings by which depth maps of lens images are planned: each lens image is a view.
sv_train_cfg sv_demultiplex_cfg(const sv_train_cfg *cfg);
typedef struct {
  // Has the lens images of all measurements as its views, and otherwise what the given one has: for
  // depth maps and points from them (stereo.h), not for training.
  sv_trainer *lenses;
  float *const *depth; // [view][height][width] of the model, world units; 0: it has none there
} sv_lens_images;

// *out lies in scratch. E_RANGE: the lens images exceed the caps of the trainer's settings.
sv_status sv_demultiplex(sv_trainer *t, sv_arena *scratch, sv_lens_images *out) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
