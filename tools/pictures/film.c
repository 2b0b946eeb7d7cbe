// SPDX-License-Identifier: Apache-2.0
#include "tools/pictures/film.h"

#include <string.h>

#define EYES_APART (1.0f / 30) // of the distance: what stereo photography calls the 1/30 rule

lab_film_kind lab_film_kind_of(const char *word) {
  if (word && strcmp(word, "depth") == 0) return LAB_FILM_DEPTH;
  return word && strcmp(word, "stereo") == 0 ? LAB_FILM_STEREO : LAB_FILM_COLOR;
}

void lab_film_eyes(const sv_view *v, float distance, sv_view eyes[2]) {
  for (int i = 0; i < 2; i++) {
    const float right = (i ? 0.5f : -0.5f) * EYES_APART * distance; // of the camera between them
    eyes[i] = *v;
    eyes[i].t[0] -= right;
    eyes[i].cx += v->fx * right / distance;
  }
}

void lab_film_depth(const float *depth, const int size_px[2], size_t stride, const float near_far[2],
                    uint8_t *out) {
  const float white = 1 / near_far[0], black = 1 / near_far[1];
  for (int y = 0; y < size_px[1]; y++)
    for (int x = 0; x < size_px[0]; x++, out += 3) {
      const float z = depth[(size_t)y * stride + (size_t)x];
      const float grey = z > 0 ? 255 * (1 / z - black) / (white - black) : 0;
      memset(out, grey <= 0 ? 0 : grey >= 255 ? 255 : (int)(grey + 0.5f), 3);
    }
}
