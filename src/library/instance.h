// SPDX-License-Identifier: Apache-2.0
// The installed library: the public API of include/subview over exposures, synchronizer and
// trainer.
// Owns: struct subview, the first thing in the caller's block.
// Never: implements training. What a call needs beyond translation belongs to the room that it
// calls.
#ifndef SV_LIBRARY_INSTANCE_H
#define SV_LIBRARY_INSTANCE_H

#include <string.h>

#include "include/subview/subview.h"
#include "src/capture/exposures.h"
#include "src/rig/bounds.h"
#include "src/splat/model_file.h"
#include "src/sync/sync.h"
#include "src/train/train.h"

#ifdef __cplusplus
extern "C" {
#endif

struct subview {
  sv_arena arena;
  sv_kernels kernels;
  sv_pool pool;
  sv_rig rig;
  sv_camera_caps *caps; // [n_cameras]
  sv_exposures exposures;
  sv_sync sync;
  sv_frame *frames; // [n_cameras] of one exposure
  sv_trainer trainer;
  sv_point *points; // [n_gaussians] starting points
  sv_view *views;   // [n_exposures n_cameras] for the scene's bounds
  sv_arena scratch; // of the start
  sv_ply_writer ply;
  int n_steps;
  bool has_bounds, is_started;
  sv_bounds bounds;
  uint32_t n_pushed;
};

// Both are a status and its sentence.
static inline sv_err *err_of(subview_error *e) { return (sv_err *)(void *)e; }

static inline sv_status explain(subview_error *e, sv_status s, const char *what) {
  return s < 0 ? sv_fail(err_of(e), s, "%s: %s", what, sv_status_text(s)) : s;
}

static inline sv_pose pose_in(const subview_pose *p) {
  sv_pose out = sv_pose_identity();
  if (p) memcpy(&out, p, sizeof out);
  return out;
}

#ifdef __cplusplus
}
#endif
#endif
