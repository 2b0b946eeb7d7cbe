// SPDX-License-Identifier: Apache-2.0
// Views of a rolling shutter on a moving rig: each Gaussian is rendered as seen from where the
// camera is when the row on which it appears is read. Its mean is moved accordingly; its shape,
// and the direction of its color, are those at the view's pose. With the camera's motion
// (omega, v) and x0 the mean at the view's pose, the mean at the row's time s is, to the second
// order in omega,
//   x = x0 + s (omega x x0 + v) + s^2/2 omega x (omega x x0),  s = row time of x
// (src/rig/shutter.h).
// Owns a copy of the Gaussians, moved for one view, and the motion of each view. Never touches
// views without motion, whose renderings keep their bits.
#ifndef SV_TRAIN_ROLLING_H
#define SV_TRAIN_ROLLING_H

#include "src/base/arena.h"
#include "src/rig/rig.h"
#include "src/splat/gaussians.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct sv_trainer sv_trainer;

typedef struct {
  float time[SV_ROW_TIME_TERMS], max_s; // sv_row_time
  float omega[3], v[3];                 // rad/s and world units/s of cam_from_world
  bool is_on;                           // the camera moves while it reads
} sv_rolling_view;

typedef struct {
  sv_rolling_view *view; // [cap_views]
  float *moved;          // as sv_gaussians.param: of the last rolling view
  float *row_s;          // [cap] row time of each Gaussian in front of its camera
  sv_view at;            // it
  const sv_rolling_view *now;
  float near_z;
} sv_rolling;

// Takes its memory; a dry arena only counts.
void sv_rolling_carve(sv_rolling *r, const sv_gaussians *g, int cap_views, sv_arena *arena);
// How view i_view, added before, is read, and the motion of its camera (cam_from_world). NULL: it
// has a global shutter or stands still. Nothing without room for it (sv_train_cfg.is_rolling).
void sv_train_set_rolling(sv_trainer *t, int i_view, const sv_row_time *time, const double motion[6]);
// Until sv_train_unroll, renderings of `view`, which is that of i_view at any scale, show each row
// at its own time. Nothing for views without motion.
void sv_train_roll(sv_trainer *t, int i_view, const sv_view *view, float near_z);
void sv_train_unroll(sv_trainer *t);
// After a rendering that was rolled: gradients [rows][16] of a block's moved Gaussians become those
// of the stored ones; pose (may be NULL), dL/d(twist) of cam_from_world, is that of the whole.
void sv_train_roll_bwd(const sv_trainer *t, int block, uint32_t touched, float *grad, float pose[6]);

#ifdef __cplusplus
}
#endif
#endif
