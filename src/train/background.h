// SPDX-License-Identifier: Apache-2.0
// The color behind the model when pictures have no alpha: what no Gaussian covers, because no
// picture shows it, has it from elsewhere. Black there is a bad guess in a room
// (docs/notes/few-exposures.md).
#ifndef SV_TRAIN_BACKGROUND_H
#define SV_TRAIN_BACKGROUND_H

#include "src/train/train.h"

#ifdef __cplusplus
extern "C" {
#endif

// Of the trainer's views, as its settings want it: the color of a flat backdrop, which is on a
// quarter of the pixels that count or, where it is black, on an eighth; without one their mean
// color, which is a guess. Black without views, with images with alpha, measurements, or pictures
// in 16 bits. Always the same for the same pictures.
sv_train_background sv_train_background_of_views(const sv_trainer *t);
// Whether this step has a random color instead: before a guess, what has about its color may stay
// transparent, to players that lay it over black and to meshes. Drawn, after the last relocation;
// earlier it would be closed by Gaussians before the cameras (docs/notes/few-exposures.md).
bool sv_train_is_background_drawn(sv_trainer *t, float progress);
// What a finished model is rendered over, RGB in 0..1: black for RANDOM. color: of the pictures.
void sv_train_background_color(sv_background b, uint32_t color, float bg[3]);

#ifdef __cplusplus
}
#endif
#endif
