// SPDX-License-Identifier: Apache-2.0
// Capture devices by name: from a few numbers to a rig. The devices are data (devices.inc).
//
// All sub-views lie on the sphere of distance_m about the scene's centre, which is at (0, 0,
// distance_m) of the rig's frame, and look at it (toed in); image x is the rig's x. Layouts for an
// angular baseline:
//   SINGLE    on the axis; the angle is not used
//   ROW       along x; the angle lies between the first and the last camera
//   TRIANGLE  the angle lies between any two of three cameras
//   GRID      evenly on a plane across the axis, row-major from the top left; the angle lies
//             between
//             opposite corners; all lens images share one sensor
// Lens images of a grid: pitch = floor(sensor side / (lenses - 1 + overlap)), side = overlap pitch,
// rounded.
#ifndef SV_RIG_DEVICE_H
#define SV_RIG_DEVICE_H

#include "src/rig/rig.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_DEVICE_CAP_ANGLE_DEG 90.0
#define SV_DEVICE_CAP_OVERLAP   16.0

typedef enum {
#define X(id, name, text, angle_deg, forward, layout, rows, cols, overlap) SV_DEVICE_##id,
#include "src/rig/devices.inc"
  SV_N_DEVICES
} sv_device_id;

typedef enum { SV_LAYOUT_SINGLE, SV_LAYOUT_ROW, SV_LAYOUT_TRIANGLE, SV_LAYOUT_GRID } sv_device_layout;

typedef struct {
  const char *name, *text;
  double angle_deg; // default angular baseline
  sv_forward_kind forward;
  sv_device_layout layout;
  int rows, cols; // default grid, 1 x 1 without one
  double overlap; // default
} sv_device_info;

const sv_device_info *sv_device_info_of(sv_device_id id); // id below SV_N_DEVICES

typedef struct {
  sv_device_id device;
  int width_px, height_px; // of each sensor
  double focal_per_width;  // focal length / width of a picture (of a lens image in a grid), at zoom
                           // 1
  double distance_m;       // to the scene's centre
  double angle_rad;        // angular baseline as seen from there
  int rows, cols;          // of lenses; 1 x 1 without a grid
  double overlap;          // >= 1; 1 unless the lens images may overlap
} sv_device_params;

// The list's defaults of a device; the caller sets sensor, focal length and distance.
sv_device_params sv_device_defaults(sv_device_id id);
int sv_device_n_cameras(sv_device_id id); // sensors
int sv_device_n_sub_views(const sv_device_params *p);
// E_ARG or E_RANGE with a sentence when the device cannot be built.
sv_status sv_device_check(const sv_device_params *p, sv_err *err) SV_MUST_USE;
// Fills in an initialised rig: name, forward model, sub-views. E_RANGE when it has too few
// sub-views.
sv_status sv_device_build(sv_rig *rig, const sv_device_params *p, sv_err *err) SV_MUST_USE;
// The maximum overlap of a camera: lens images in one pixel, M_max of footprints without coverage
// images. 0 when no sub-view of that camera has a footprint.
int sv_device_largest_overlap(const sv_rig *rig, int i_camera);

#ifdef __cplusplus
}
#endif
#endif
