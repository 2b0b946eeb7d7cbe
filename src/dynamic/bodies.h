// SPDX-License-Identifier: Apache-2.0
// Rigid bodies of a scene: detection and matching (bodies.c), tracking (track_bodies.c), assignment
// of Gaussians (body_assignment.c), refinement of poses.
// Owns nothing: bodies are part of the motion, scratch is sv_dynamic's.
// Never moves a static Gaussian.
#ifndef SV_DYNAMIC_BODIES_H
#define SV_DYNAMIC_BODIES_H

#include "src/dynamic/dynamic.h"
#include "src/deform/bodies.h"

#ifdef __cplusplus
extern "C" {
#endif

static inline int sv_dynamic_body_of(const sv_dynamic *dyn, int i) {
  const sv_bodies *b = &dyn->deform.motion.bodies;
  return b->n > 1 ? b->of[i] : 0;
}
// Adds what one camera saw of a displacement: r pixels, with dpixel/dposition jac [2][3].
void sv_match_add(sv_match_sum *s, const float jac[6], const float r[2]);
// Body-local position (of body 0: world) and quaternion (or NULL) of Gaussian i by its own
// functions, whose values are f.
void sv_dynamic_local_position(const sv_dynamic *dyn, int i, const sv_motion_values *f, float x[3],
                               float q[4]);
// Attaches Gaussian i to a body, at x and q of its frame and with no motion of its own; to body 0:
// at rest.
void sv_dynamic_attach(sv_dynamic *dyn, int i, int body, const float x[3], const float q[4]);

// Knots for all times trained on before, and for a new one, at which bodies are extrapolated.
void sv_dynamic_extrapolate_bodies(sv_dynamic *dyn, float to, float before);
// Tracks the bodies in the images of a time, from their extrapolated poses (track_bodies.c).
sv_status sv_dynamic_track_bodies(sv_dynamic *dyn, float time, float progress) SV_MUST_USE;
// From dyn->near, positions at time `from` and displacements to `to`: the bodies' poses at `to`,
// and new bodies.
void sv_dynamic_match_bodies(sv_dynamic *dyn, float from, float to, float px_per_unit);

// Body assignment (body_assignment.c): before the first image of a search, after each was rendered
// with depth and with its target, after the last.
void sv_dynamic_begin_assignment(sv_dynamic *dyn);
void sv_dynamic_compare_assignment(sv_dynamic *dyn, int i_view);
void sv_dynamic_end_assignment(sv_dynamic *dyn);

// One step of the bodies' poses at the time of the last rendering, from dyn->body_sum, which is
// cleared before.
void sv_dynamic_clear_body_sums(sv_dynamic *dyn);
void sv_dynamic_step_bodies(sv_dynamic *dyn, float mean_lr);

#ifdef __cplusplus
}
#endif
#endif
