// SPDX-License-Identifier: Apache-2.0
// What the frames of a film show: color, depth as grey values, or two eyes side by side.
#ifndef SV_TOOLS_PICTURES_FILM_H
#define SV_TOOLS_PICTURES_FILM_H

#include "tools/lab/lab.h"

typedef enum { LAB_FILM_COLOR, LAB_FILM_DEPTH, LAB_FILM_STEREO } lab_film_kind;
lab_film_kind lab_film_kind_of(const char *word); // of --film; NULL: color

// Views of the two eyes: 1/30 of the distance apart, both look at what lies at that distance.
void lab_film_eyes(const sv_view *v, float distance, sv_view eyes[2]);
// Depth as grey: white at near, black at far and where there is none, linear in 1/depth.
// depth: [height][stride], out: [height][width][3].
void lab_film_depth(const float *depth, const int size_px[2], size_t stride, const float near_far[2],
                    uint8_t *out);

#endif
