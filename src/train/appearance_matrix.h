// SPDX-License-Identifier: Apache-2.0
// The color matrix of a camera, from surface points that it and camera 0 see, in linear light:
//   light(point, camera) / (falloff exposure) = M light(point, camera 0) / (falloff exposure)
// Terms off the diagonal take scenes of several colors: grey tells only the sum of a row. Owns and
// changes nothing.
#ifndef SV_TRAIN_APPEARANCE_MATRIX_H
#define SV_TRAIN_APPEARANCE_MATRIX_H

#include "src/train/appearance_points.h"

#ifdef __cplusplus
extern "C" {
#endif

// Observations of one scene have errors in common: as many count as one.
#define SV_APPEARANCE_ALIKE 40

// What is known of a view: of which camera it is, and the logarithms of its falloff, f1 r^2 + f2
// r^4, and of its exposure.
typedef struct {
  int i_camera;
  double f1, f2, exposure[3];
} sv_appearance_view;

typedef struct {
  double m[9];     // row-major
  double sigma[9]; // one standard deviation
  int n;           // observations
} sv_appearance_matrix;

// gain: of the camera, for each channel; what the points do not tell stays the diagonal matrix of
// these. view: [p->n_views]. False: too few points.
bool sv_appearance_matrix_solve(const sv_appearance_points *p, const sv_appearance_view *view, int i_camera,
                                const double gain[3], sv_appearance_matrix *out);

#ifdef __cplusplus
}
#endif
#endif
