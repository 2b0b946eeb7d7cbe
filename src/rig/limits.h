// SPDX-License-Identifier: Apache-2.0
// Bounds of cameras, poses and scenes, from one table with reasons (limits.inc). Each reader of
// files asks here. Owns nothing. Never corrects a value: what is outside is refused with a
// sentence.
#ifndef SV_RIG_LIMITS_H
#define SV_RIG_LIMITS_H

#include "calib/model.h"
#include "src/base/vec.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_CAP_IMAGE_SIDE_PX 32767 // sizes and footprints fit 16 bits

// All return E_RANGE when a value is outside or not finite; err begins with `where`, such as a
// file's name. Lengths in m (or the unit of poses), pixels and distortion terms as in the model.
sv_status sv_limits_check_camera(const sv_camera_model *m, const char *where, sv_err *err) SV_MUST_USE;
sv_status sv_limits_check_pose(const sv_pose *cam_from_world, const char *where, sv_err *err) SV_MUST_USE;
sv_status sv_limits_check_scene(const double centre[3], double radius, const char *where,
                                sv_err *err) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
