// SPDX-License-Identifier: Apache-2.0
// Rays against the four convex primitives, four rays at once, in the primitive's frame. A ray that
// starts inside does not hit. Directions need no unit length: t counts in lengths of d.
// Roots are taken about the ray's point of closest approach: with h = r^2 - |o - (o.d/d.d) d|^2 no
// large terms cancel (E. Haines et al., "Precision Improvements for Ray/Sphere Intersection",
// Ray Tracing Gems, chapter 7).
#ifndef SV_SIM_HIT_H
#define SV_SIM_HIT_H

#include "platform/sim/scene.h"
#include "platform/sim/v4.h"

typedef struct {
  v4f t;
  v4i face; // box: 2 axis + (on the positive side); cylinder: 0 side, 1 top, 2 bottom; else 0
  v4i mask;
} v4_hit;

static inline v4_hit v4_miss(void) { return (v4_hit){v4_set(0), v4_seti(0), v4_seti(0)}; }
static inline v4f v4_root(v4f h, v4f a) { return v4_sqrt(v4_max(h, v4_set(0)) / a); }

static inline __attribute__((always_inline)) v4_hit v4_hit_ellipsoid(const float *size, v4_vec o, v4_vec d,
                                                                     v4f near) {
  o.x /= size[0];
  o.y /= size[1];
  o.z /= size[2];
  d.x /= size[0];
  d.y /= size[1];
  d.z /= size[2];
  v4f a = v4_dot(d, d), b = v4_dot(o, d) / a;
  v4_vec q = {o.x - b * d.x, o.y - b * d.y, o.z - b * d.z};
  v4f h = 1.0f - v4_dot(q, q);
  if (!v4_any(h > 0.0f)) return v4_miss();
  v4f t = -b - v4_root(h, a);
  return (v4_hit){t, v4_seti(0), (h > 0.0f) & (t > near)};
}

static inline __attribute__((always_inline)) v4_hit v4_hit_box(const float *size, v4_vec o, v4_vec d,
                                                               v4f near) {
  const v4f *os = &o.x, *ds = &d.x;
  v4f enter = v4_set(-1e30f), leave = v4_set(1e30f);
  v4i face = v4_seti(0);
  for (int k = 0; k < 3; k++) {
    v4f dk = v4_select(v4_abs(ds[k]) < 1e-20f, v4_set(1e-20f), ds[k]); // keeps inf - inf away
    v4f inv = 1.0f / dk, mid = -os[k] * inv, half = v4_abs(size[k] * inv);
    v4f t0 = mid - half, t1 = mid + half;
    v4i is_later = t0 > enter;
    enter = v4_select(is_later, t0, enter);
    face = v4_selecti(is_later, 2 * k - (dk < 0.0f), face);
    leave = v4_min(t1, leave);
  }
  return (v4_hit){enter, face, (enter <= leave) & (enter > near)};
}

// The part of the infinite cylinder about z shared by capsule and cylinder.
static inline v4f v4_side(float r, v4_vec o, v4_vec d, v4f *mid, v4f *half) {
  v4f a = v4_max(d.x * d.x + d.y * d.y, v4_set(1e-12f)), b = (o.x * d.x + o.y * d.y) / a;
  v4f qx = o.x - b * d.x, qy = o.y - b * d.y, h = r * r - qx * qx - qy * qy;
  *mid = -b;
  *half = v4_any(h > 0.0f) ? v4_root(h, a) : v4_set(0);
  return h;
}

static inline __attribute__((always_inline)) v4_hit v4_hit_capsule(const float *size, v4_vec o, v4_vec d,
                                                                   v4f near) {
  v4f mid, half, h = v4_side(size[0], o, d, &mid, &half), t = mid - half, z = o.z + t * d.z;
  if (!v4_any(h > 0.0f)) return v4_miss();
  v4i mask = h > 0.0f, beyond = v4_abs(z) > size[1];
  if (v4_any(mask & beyond)) { // only the cap on the side where the ray enters can be met first
    v4_vec c = {o.x, o.y, o.z - v4_select(z > 0.0f, v4_set(size[1]), v4_set(-size[1]))};
    v4f a = v4_dot(d, d), b = v4_dot(c, d) / a;
    v4_vec q = {c.x - b * d.x, c.y - b * d.y, c.z - b * d.z};
    v4f k = size[0] * size[0] - v4_dot(q, q);
    t = v4_select(beyond, -b - v4_root(k, a), t);
    mask &= ~beyond | (k > 0.0f);
  }
  return (v4_hit){t, v4_seti(0), mask & (t > near)};
}

static inline __attribute__((always_inline)) v4_hit v4_hit_cylinder(const float *size, v4_vec o, v4_vec d,
                                                                    v4f near) {
  v4f mid, half, h = v4_side(size[0], o, d, &mid, &half), t = mid - half, z = o.z + t * d.z;
  if (!v4_any(h > 0.0f)) return v4_miss();
  v4i mask = h > 0.0f, beyond = v4_abs(z) > size[1], is_top = z > 0.0f;
  v4f cap = (v4_select(is_top, v4_set(size[1]), v4_set(-size[1])) - o.z) / d.z;
  mask &= ~beyond | ((cap > t) & (cap < mid + half));
  t = v4_select(beyond, cap, t);
  return (v4_hit){t, beyond & v4_selecti(is_top, v4_seti(1), v4_seti(2)), mask & (t > near)};
}

static inline __attribute__((always_inline)) v4_hit v4_hit_shape(sv_sim_shape shape, const float *size,
                                                                 v4_vec o, v4_vec d, v4f near) {
  switch (shape) {
  case SV_SIM_ELLIPSOID: return v4_hit_ellipsoid(size, o, d, near);
  case SV_SIM_BOX: return v4_hit_box(size, o, d, near);
  case SV_SIM_CAPSULE: return v4_hit_capsule(size, o, d, near);
  default: return v4_hit_cylinder(size, o, d, near);
  }
}

// Outward unit normal of a surface point.
static inline v4_vec v4_normal(sv_sim_shape shape, const float *size, v4_vec p, v4i face) {
  v4f zero = v4_set(0), one = v4_set(1);
  v4_vec n = p;
  if (shape == SV_SIM_BOX) {
    v4f sign = v4_select((face & 1) != 0, one, -one);
    v4i axis = face >> 1;
    return (v4_vec){v4_select(axis == 0, sign, zero), v4_select(axis == 1, sign, zero),
                    v4_select(axis == 2, sign, zero)};
  }
  if (shape == SV_SIM_ELLIPSOID) {
    n = (v4_vec){p.x / (size[0] * size[0]), p.y / (size[1] * size[1]), p.z / (size[2] * size[2])};
  } else if (shape == SV_SIM_CAPSULE) {
    n.z = p.z - v4_min(v4_max(p.z, v4_set(-size[1])), v4_set(size[1]));
  } else {
    v4i is_side = face == 0;
    n.x = v4_select(is_side, p.x, zero);
    n.y = v4_select(is_side, p.y, zero);
    n.z = v4_select(is_side, zero, v4_select(face == 1, one, -one));
  }
  v4f inv = 1.0f / v4_sqrt(v4_max(v4_dot(n, n), v4_set(1e-20f)));
  return (v4_vec){n.x * inv, n.y * inv, n.z * inv};
}

#endif
