// SPDX-License-Identifier: Apache-2.0
// Rolling shutters: when a sensor reads what a place of a view shows, and where a moving rig is
// then. Owns nothing.
// Never knows which exposures or images there are.
#ifndef SV_RIG_SHUTTER_H
#define SV_RIG_SHUTTER_H

#include "calib/fisheye.h"
#include "src/base/vec.h"

#ifdef __cplusplus
extern "C" {
#endif

// The way in which the lines of an image are read: rows downwards or upwards, columns to the right
// or to the left, as the image is seen.
typedef enum {
  SV_SHUTTER_DOWN,
  SV_SHUTTER_UP,
  SV_SHUTTER_RIGHT,
  SV_SHUTTER_LEFT,
  SV_N_SHUTTERS
} sv_shutter_direction;
const char *sv_shutter_name(sv_shutter_direction d);
int sv_shutter_by_name(const char *name); // -1 when unknown

typedef struct {
  double readout_s; // from the first line of the sensor to the last; 0: a global shutter
  sv_shutter_direction direction;
} sv_shutter;

#define SV_ROW_TIME_TERMS 10

// When a place of a view is read, in seconds after the middle of the frame:
// c . (1, x, y, xx, xy, yy, xxx, xxy, xyy, yyy) with x = (u - cx) / fx and y = (v - cy) / fy, so
// that it holds for images of any size. In a pinhole view these are the direction (x/z, y/z). All 0
// for a global shutter.
typedef struct {
  double c[SV_ROW_TIME_TERMS];
  double max_s; // places outside of the image are never more than this from the middle
} sv_row_time;

typedef struct {
  sv_shutter shutter;
  const sv_camera_model *lens; // of the sub-view's image
  const sv_fisheye *fisheye;   // of the view, NULL: a pinhole
  int x0_px, y0_px;            // the image's place on its sensor
  int sensor_width_px, sensor_height_px;
  double half_x, half_y; // places of the view up to these are looked at
} sv_row_time_cfg;

// Least squares over the places of the view. E_RANGE when the lens sees too few of them.
sv_status sv_row_time_make(sv_row_time *out, const sv_row_time_cfg *cfg) SV_MUST_USE;
double sv_row_time_at(const sv_row_time *t, double x, double y);

// A rig's or camera's motion: twists a second (omega, v) of its frame from the world's. The point
// that it has at x is at exp(s omega) x + s v after s seconds. turn: exp(s omega).
void sv_motion_apply(double out[3], const double twist_per_s[6], double s, const double x[3], double turn[9]);
// The same motion in the frame of a camera of the rig.
void sv_motion_of_camera(double out[6], const double rig[6], const sv_pose *cam_from_rig);
// The motion at a pose is slope[0] log(a) + slope[1] log(b), where a and b are the twists from it
// to two other poses, a_s and b_s seconds later (negative: earlier; 0: there is none). Exact for a
// twist that grows evenly.
void sv_motion_slopes(double slope[2], double a_s, double b_s);
void sv_motion_from(double out[6], const double slope[2], const sv_pose *at, const sv_pose *a,
                    const sv_pose *b);

#ifdef __cplusplus
}
#endif
#endif
