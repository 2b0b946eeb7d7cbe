// SPDX-License-Identifier: Apache-2.0
// Photometric calibration of a sub-view: what its camera makes of the light that the reference
// camera would show, in linear light:
//   shown = falloff(r^2) color x        falloff = 1 + k1 r^2 + k2 r^4 + k3 r^6
// Owns nothing. Never touches a frame (src/capture/correction.h does).
#ifndef SV_RIG_PHOTOMETRY_H
#define SV_RIG_PHOTOMETRY_H

#include <stdbool.h>

#include "calib/model.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  bool is_known;
  double color[9];   // row-major; the identity for the reference camera
  double falloff[3]; // k1, k2, k3
  // Distance of r = 1 from the principal point, in focal lengths: it holds at every size and crop.
  double corner;
  double color_sigma[3]; // of each row, relative: one standard deviation
  // Of the color's terms off the diagonal, as shares of the row's gain. 0: they were not measured,
  // and are taken as none.
  double mix_sigma;
  double falloff_sigma; // of the light at r = 1, as a share of that at the principal point
} sv_photometry;

// No difference to the reference, r = 1 at the farthest corner of a lens's images.
sv_photometry sv_photometry_none(const sv_camera_model *m);
// r^2 of a place in the images of a lens.
double sv_photometry_r2(const sv_photometry *p, const sv_camera_model *m, double u_px, double v_px);
// Share of the light at r^2, as at 1 beyond it.
double sv_photometry_falloff(const sv_photometry *p, double r2);
// k1, k2, k3 so that the falloff is light[0..2] at r^2 = 1/3, 2/3 and 1.
void sv_photometry_fit(const double light[3], double falloff[3]);
// The inverse of the color matrix; false where there is none that a camera can have: it would make
// some light more than ten times as bright.
bool sv_photometry_inverse(const sv_photometry *p, double out[9]);
// Green of grey light over the reference's, at the same exposure time and gain; 1 where it is not
// known.
double sv_photometry_response(const sv_photometry *p);
// Whether it is of a lens: at least 5 % and at most 150 % of the light everywhere up to r = 1.
bool sv_photometry_has_light(const sv_photometry *p);

#ifdef __cplusplus
}
#endif
#endif
