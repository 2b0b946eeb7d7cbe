// SPDX-License-Identifier: Apache-2.0
// Odometry: the rig's poses, for sources without them, tracked over the pool of exposures between
// capture and training. The world is then about the rig's frame at the first exposure, turned so
// that -y is up. Owns the tracker
// and its workspace; poses that were found are written into the pool. Never captures, and never
// runs while training does.
#ifndef SV_CAPTURE_ODOMETRY_H
#define SV_CAPTURE_ODOMETRY_H

#include "src/capture/exposures.h"
#include "src/capture/imu.h"
#include "src/rig/bounds.h"
#include "src/splat/gaussians.h"
#include "src/track/tracker.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  sv_remap map;
  uint8_t *px, *mask; // [height][width][3] and [height][width] of the pinhole
} sv_odometry_crop;

typedef struct {
  bool is_on;      // carved
  bool is_tracked; // the poses are the tracker's: the rig moved
  sv_tracker tracker;
  sv_track_summary summary;
  sv_camera_model *model; // [n_sub_views] of the undistorted pictures
  sv_row_time *row_time;  // [n_sub_views] of rolling shutters, or NULL
  sv_image_u8 *image;     // [n_sub_views] of one exposure
  // [n_sub_views] The tracker knows pinholes only: a fisheye's picture is undistorted to the widest
  // one. px NULL: not a fisheye.
  sv_odometry_crop *crop;
  const sv_imu *imu; // may be NULL
  float *work;       // [points of the tracker]
  sv_ns start_ns;    // time of the first exposure
  sv_pose *a, *b;    // [cap_exposures] two trajectories
} sv_odometry;

// Which rigs can be tracked: those whose sub-views have pictures of their own.
bool sv_odometry_can(const sv_rig *rig, int n_exposures);
typedef struct {
  const sv_rig *rig;
  int cap_exposures;
  const sv_exposures *pool; // where the images will be; NULL on a dry arena
  const sv_kernels *k;      // likewise
  bool is_rolling;          // the rig's readout times count
  uint64_t seed;
  const sv_imu *imu;                // tells which way is up; NULL: what the cameras see does
  struct sv_heartbeats *heartbeats; // may be NULL
} sv_odometry_cfg;

// On a dry arena only counts.
sv_status sv_odometry_init(sv_odometry *o, const sv_odometry_cfg *cfg, sv_arena *arena,
                           sv_err *err) SV_MUST_USE;

// Exposure e of the pool, in order; then the end. E_FULL as sv_tracker_add; AGAIN: not placed.
sv_status sv_odometry_add(sv_odometry *o, const sv_exposures *pool, int e) SV_MUST_USE;
// Fills in summary. When the rig moved and was found, poses go into the pool and is_tracked is set:
// an exposure that was not placed keeps has_pose false.
void sv_odometry_finish(sv_odometry *o, sv_exposures *pool);

// Relative standard deviation of the scale from which on lengths are not called meters.
#define SV_ODOMETRY_SCALE_DOUBT 0.02

// A ball about the points that were found: medians of their places, and 1.2 x the distance that
// nine of ten keep.
sv_bounds sv_odometry_bounds(sv_odometry *o);
// Up to n points of the sparse cloud, spread over it; returns how many.
int sv_odometry_cloud(const sv_odometry *o, sv_point *point, int n);

// The similarity from a world in which the rig's poses are known (pose_at of each exposure's time)
// to this one.
sv_similarity sv_odometry_from(sv_odometry *o, const sv_exposures *pool,
                               void (*pose_at)(void *self, sv_ns time_ns, sv_pose *rig_from_world),
                               void *self);
// A view of that world in this one.
sv_view sv_odometry_view(const sv_similarity *q, const sv_view *view);

#ifdef __cplusplus
}
#endif
#endif
