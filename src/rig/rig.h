// SPDX-License-Identifier: Apache-2.0
// Rigs, sub-views and exposures (the paper, section 3.1): a rig is a fixed set of sub-views, an
// exposure is one instant seen by all of them, each with intrinsics K and pose R, t. A monocular
// camera is a rig of one. Owns the list of sub-views in the caller's arena.
// Never talks to cameras and never touches pixels.
#ifndef SV_RIG_RIG_H
#define SV_RIG_RIG_H

#include <stdbool.h>
#include <stdint.h>

#include "calib/model.h"
#include "src/base/area.h"
#include "src/base/arena.h"
#include "src/base/time.h"
#include "src/base/vec.h"
#include "src/rig/photometry.h"
#include "src/rig/shutter.h"
#include "src/rig/trigger.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_CAP_SUB_VIEWS 256 // a 16 x 16 sub-aperture grid

// How the sub-views reach the sensor(s). direct: one sensor (or sensor region) per sub-view.
typedef enum { SV_FORWARD_DIRECT = 0, SV_FORWARD_LIGHT_FIELD, SV_FORWARD_MULTIPLEXED } sv_forward_kind;

// Where a sub-view's image lies on its sensor; all zero for a camera of its own.
typedef struct {
  int x0_px, y0_px, width_px, height_px;
  const uint8_t *coverage; // [height_px][width_px] share of 255 that the lens lights; NULL: all of
                           // each pixel
} sv_footprint;

// A mode of a sensor: what its frames of a size show.
typedef struct {
  int width_px, height_px;
  sv_sensor_area area;
} sv_sensor_mode;
#define SV_CAP_SENSOR_MODES 6

// Noise of a sensor's values in linear light of [0, 1]: variance = read + shot x (photon transfer).
// Both 0: not known.
typedef struct {
  double read, shot;
} sv_sensor_noise;

typedef struct {
  char name[32];
  int i_camera; // the camera (sensor) of the source that sees it
  sv_camera_model model;
  sv_pose cam_from_rig;
  sv_footprint footprint;
  // [height][width] of the model: 0 where its image is ignored (housing, own shadow); NULL: nowhere
  const uint8_t *mask;
  sv_shutter shutter; // of its sensor
  sv_sensor_noise noise;
  sv_photometry photometric; // of its camera and lens; not known by default
  // What the calibrated images show of their sensor, and other modes of it, where the camera does
  // not report them (src/rig/sizes.h).
  sv_sensor_area area; // sensor size 0: not known
  int n_modes;
  sv_sensor_mode modes[SV_CAP_SENSOR_MODES];
  // The frame's pixels that its image is averaged from, at its footprint's corner; 0: the image has
  // the frame's pixels.
  int source_width_px, source_height_px;
} sv_sub_view;

typedef struct {
  char name[32];
  sv_forward_kind forward;
  int n_sub_views, cap_sub_views;
  sv_sub_view *sub_views; // [cap_sub_views], in the arena
  sv_arena *splines;      // memory for control points of splined lenses; NULL: such lenses are
                          // refused
  sv_trigger trigger;     // of all cameras; kind NONE: none
  double scale_sigma;     // one standard deviation of its lengths, relative; 0: not known
} sv_rig;

// `arena` is also where a reader puts control points of splined lenses (rig->splines).
sv_status sv_rig_init(sv_rig *rig, int cap_sub_views, sv_arena *arena) SV_MUST_USE;

bool sv_rig_is_rolling(const sv_rig *rig); // some sub-view has a rolling shutter

// The largest angle between two sub-views as seen from a point in the rig's frame, radians:
// max acos(v_i . v_j) (the paper, section 3.1), computed with atan2. 0 for one sub-view.
double sv_rig_angular_baseline_rad(const sv_rig *rig, const double point_rig[3]);

// A view for the renderer, in floats, with the pose of one instant: an undistorted pinhole, or a
// fisheye.
typedef struct {
  int width_px, height_px;
  float fx, fy, cx, cy; // px, centre of the first pixel at 0.5
  float r[9], t[3];     // cam_from_world, row-major
  float time;           // 0..1 over the recording
  int i_exposure, i_sub_view;
  // NULL: a pinhole. Else its radial function, which the view's maker keeps; the depth of a point
  // is then its distance from the camera.
  const struct sv_fisheye *fisheye;
} sv_view;

// pinhole: fx, fy, cx, cy in px, as a camera model's first parameters.
sv_view sv_view_make(int width_px, int height_px, const double pinhole[4], const sv_pose *cam_from_world);
void sv_view_centre(float out[3], const sv_view *v);              // camera centre in the world
float sv_view_distance(const sv_view *v, const float x_world[3]); // from the camera
// The same view with 1/k of the pixels a side (k >= 1); sizes are rounded down, at least 1.
sv_view sv_view_scaled(const sv_view *v, int k);
// The same view with k times the pixels a side.
sv_view sv_view_enlarged(const sv_view *v, int k);

// Place in the picture and depth (z, of a fisheye the distance) of a point in the camera's frame;
// false: behind a pinhole, or outside the lens's range.
bool sv_view_project(const sv_view *v, const float x_cam[3], float uv_px[2], float *depth);
// [2][3] derivatives of the place by the point, which projects. Of a pinhole without clamps.
void sv_view_jacobian(const sv_view *v, const float x_cam[3], float j[6]);
// The point of depth 1 at a place in the picture, in the camera's frame; false outside the lens's
// range.
bool sv_view_ray(const sv_view *v, float u_px, float v_px, float ray[3]);

// One synchronized set of frames. Missing sub-views (a drop policy that allows them) have bit 0.
typedef struct {
  uint32_t id;
  // host time of mid-exposure, mean over the cameras present
  sv_ns time_ns;
  sv_ns skew_ns;                           // largest difference between two cameras
  uint64_t present[SV_CAP_SUB_VIEWS / 64]; // one bit per camera
  sv_pose rig_from_world;
  bool has_pose;    // known from the source; else the identity until odometry finds it
  double motion[6]; // of rig_from_world (src/rig/shutter.h)
  bool has_motion;  // likewise; else 0
} sv_exposure;

#ifdef __cplusplus
}
#endif
#endif
