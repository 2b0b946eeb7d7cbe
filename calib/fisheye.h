// SPDX-License-Identifier: Apache-2.0
// Fisheye lenses as kernels take them: their radial function as a polynomial, and its inverse.
// Rays are projected as far as the lens's distortion is one to one, and a little beyond the
// picture's edge, so that Gaussians that reach into it are drawn.
#ifndef SV_CALIB_FISHEYE_H
#define SV_CALIB_FISHEYE_H

#include "calib/model.h"
#include "kernels/project/project.h"

#ifdef __cplusplus
extern "C" {
#endif

// False when the model is not KB4, or when the polynomials would be off by more than 0.02 px
// anywhere in the picture: then the lens needs a pinhole view (calib/remap.h).
bool sv_fisheye_make(sv_fisheye *out, const sv_camera_model *m);

// Place in the picture, (u - cx) / fx and (v - cy) / fy, of a point in the camera's frame; false
// outside the lens's range.
bool sv_fisheye_project(const sv_fisheye *f, const float x_cam[3], float xy[2]);
// [2][3] derivatives of that place by the point, which is in range.
void sv_fisheye_jacobian(const sv_fisheye *f, const float x_cam[3], float j[6]);
// Unit ray of such a place; false outside the lens's range.
bool sv_fisheye_unproject(const sv_fisheye *f, const float xy[2], float ray[3]);

#ifdef __cplusplus
}
#endif
#endif
