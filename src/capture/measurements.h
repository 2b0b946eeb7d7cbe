// SPDX-License-Identifier: Apache-2.0
// The part of the exposure pool for sensors on which lens images overlap (src/rig/forward.h).
// Owns each sensor's whole measurement, once per exposure, and the poses of its lenses at that
// instant. Never cuts out or undistorts: lens images that add up on a sensor cannot be undistorted
// one by one.
#ifndef SV_CAPTURE_MEASUREMENTS_H
#define SV_CAPTURE_MEASUREMENTS_H

#include "src/port/port.h"
#include "src/rig/forward.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  const sv_rig *rig;          // multiplexed; coverage pictures included, it must outlive the pool
  const sv_camera_caps *caps; // [n_cameras] the sensors' sizes
  int n_cameras, cap_exposures;
} sv_measurements_cfg;

typedef struct {
  int i_camera, width_px, height_px;
  int i_lens, n_lenses; // of an exposure's lenses
  size_t at;            // of an exposure's values
  float max_overlap;
} sv_sensor;

typedef struct {
  sv_measurements_cfg cfg;
  sv_sensor *sensor; // [n_sensors] cameras with a lens, in the order of the cameras
  int n_sensors;
  size_t exposure_values;
  uint16_t *px;  // [cap_exposures][exposure_values] display values of 65535
  sv_lens *lens; // [cap_exposures][n_sub_views] sensor by sensor
  float *row;    // [widest sensor] for the sum of the footprints
} sv_measurements;

// Cameras that have at least one lens.
int sv_measurements_n_sensors(const sv_rig *rig, int n_cameras);
bool sv_measurements_has_lens(const sv_rig *rig, int i_camera);

// E_UNSUPPORTED with a sentence for a lens with distortion, E_RANGE for a footprint that is not on
// its sensor. On a dry arena nothing is checked.
sv_status sv_measurements_init(sv_measurements *c, const sv_measurements_cfg *cfg, sv_arena *arena,
                               sv_err *err) SV_MUST_USE;

// Keeps one exposure's frames (frame[i_camera]; RGB16, or RGB8 times 257) and lenses in a slot.
// E_UNSUPPORTED for other pixel formats, E_RANGE when a frame's size is not the sensor's; the slot
// is then as it was.
sv_status sv_measurements_put(sv_measurements *c, int i_slot, const sv_exposure *exposure,
                              const sv_frame *frame, const sv_pool *pool, sv_err *err) SV_MUST_USE;

// Model and measurement px[height][width][3] of a sensor in a slot.
void sv_measurements_get(const sv_measurements *c, int i_slot, int i_sensor, sv_multiplexed *model,
                         const uint16_t **px);

#ifdef __cplusplus
}
#endif
#endif
