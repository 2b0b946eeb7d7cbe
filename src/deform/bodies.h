// SPDX-License-Identifier: Apache-2.0
// Rigid bodies among Gaussians with per-Gaussian motion.
//
// At a knot, a time with images, body b is displaced by d_b and rotated by q_b about its center
// c_b:
//   x(t) = R(q_b) (x - c_b) + c_b + d_b,   quaternion(t) = q_b * quaternion,
// where x and the quaternion are body-local, with the Gaussian's own motion (motion.h) added.
// Between knots d and q are interpolated by the Lagrange polynomial through three knots on each
// side, fewer near the ends and where uneven knots would make it oscillate; q has its sign aligned
// and is normalized. Before the first and after the last knot bodies are at rest. Body 0 is static.
// Owns the bodies' arrays. Never decides which Gaussians form a body: src/dynamic does.
#ifndef SV_DEFORM_BODIES_H
#define SV_DEFORM_BODIES_H

#include <stdbool.h>
#include <stdint.h>

#include "src/base/arena.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_CAP_BODIES 16  // with number 0
#define SV_CAP_KNOTS  256 // distinct times

typedef struct {
  float q[4], d[3]; // unit quaternion w x y z; world units
} sv_rigid;

#define SV_RIGID_IDENTITY ((sv_rigid){.q = {1, 0, 0, 0}})

// y = R(q) (x - c) + c + d; y may be x.
void sv_rigid_apply(const sv_rigid *m, const float c[3], const float x[3], float y[3]);
// The reverse: x from y. x may be y.
void sv_rigid_undo(const sv_rigid *m, const float c[3], const float y[3], float x[3]);
// First a about c, then b about c + a->d, as one motion about c.
sv_rigid sv_rigid_then(const sv_rigid *a, const sv_rigid *b);
// out = a b; out may be neither.
void sv_quat_mul(const float a[4], const float b[4], float out[4]);

typedef struct {
  float m[6], v[6]; // Adam's moments of rotation (3) and displacement (3)
  uint32_t n_steps;
} sv_knot_adam;

typedef struct {
  int cap_knots, n_knots;
  int n;              // bodies in use are 1 .. n - 1; 0 when there can be none
  float (*centre)[3]; // [SV_CAP_BODIES]
  float *radius;      // [SV_CAP_BODIES] root mean square distance of the members from the center
  float *time;        // [cap_knots] rising
  sv_rigid *knot;     // [SV_CAP_BODIES][cap_knots]
  uint8_t *of;        // [cap] body of each Gaussian; NULL without knots
  sv_knot_adam *adam; // as knot; NULL without has_grad
  sv_rigid *now;      // [SV_CAP_BODIES] of the last sv_motion_at
} sv_bodies;

// cap: Gaussians. cap_knots 0: no bodies.
sv_status sv_bodies_init(sv_bodies *b, int cap, int cap_knots, bool has_grad, sv_arena *arena) SV_MUST_USE;
// Removes all bodies and knots.
void sv_bodies_reset(sv_bodies *b, int cap);
static inline sv_rigid *sv_bodies_knot(const sv_bodies *b, int body, int i_knot) {
  return b->knot + (long)body * b->cap_knots + i_knot;
}
// Index of the knot at exactly this time; -1: none.
int sv_bodies_find_knot(const sv_bodies *b, float time);
// Adds a knot, at which all bodies are extrapolated from the two nearest knots on one side (or at
// rest). Returns its index, that of an existing knot at this time, or -1 when all are in use.
int sv_bodies_add_knot(sv_bodies *b, float time);
// Pose of a body at a knot, interpolated from the knots on both sides; false: there are too few.
bool sv_bodies_among(const sv_bodies *b, int body, int i_knot, sv_rigid *out);
// Largest displacement of a body's members from rest, at a distance of about its radius.
float sv_bodies_reach(const sv_bodies *b, int body);
// Poses of all bodies in use at a time.
void sv_bodies_at(const sv_bodies *b, float time, sv_rigid out[SV_CAP_BODIES]);
// Bodies, knots and the members among Gaussians [0, n) of `from`. Both have the same caps.
void sv_bodies_copy(sv_bodies *to, const sv_bodies *from, int n, int cap);

// Transforms Gaussians [i0, i1) of moved [cap/16][n_rows][16] from body-local to world, by the
// poses `now`.
void sv_bodies_carry(const sv_bodies *b, const sv_rigid *now, float *moved, int n_rows, int i0, int i1);
// Its backward pass for one block, by the poses b->now: grad [n_rows][16] becomes body-local, in
// place. With sum, also the gradient of the bodies' poses: sum[body] += dL/d(rotation about the
// moved center in rad; displacement).
void sv_bodies_carry_bwd(const sv_bodies *b, const float *moved, int n_rows, int block, uint32_t touched,
                         float *grad, float (*sum)[6]);

#ifdef __cplusplus
}
#endif
#endif
