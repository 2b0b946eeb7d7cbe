// SPDX-License-Identifier: Apache-2.0
// Solid value noise and soft patterns, four points at once, filtered to a footprint.
#ifndef SV_SIM_TEXTURE_H
#define SV_SIM_TEXTURE_H

#include "platform/sim/scene.h"
#include "platform/sim/v4.h"

// A hash of a lattice corner as a float in [0,1). The three products are summed up by the caller.
static inline v4f v4_corner(v4u h) {
  h = (h ^ (h >> 15)) * 0x2c1b3c6du;
  h ^= h >> 12;
  return __builtin_convertvector((v4i)(h >> 9), v4f) * 0x1p-23f;
}

static inline v4f v4_lerp(v4f a, v4f b, v4f t) { return a + (b - a) * t; }
static inline v4f v4_fade(v4f t) { return t * t * (3.0f - 2.0f * t); }

// Value noise in [0,1), one lattice cell a unit: random corners, cubic blend.
static inline __attribute__((always_inline)) v4f v4_noise(v4_vec q, uint32_t seed) {
  v4i xi = v4_floori(q.x), yi = v4_floori(q.y), zi = v4_floori(q.z);
  v4f fx = v4_fade(q.x - __builtin_convertvector(xi, v4f)),
      fy = v4_fade(q.y - __builtin_convertvector(yi, v4f));
  v4f fz = v4_fade(q.z - __builtin_convertvector(zi, v4f));
  v4u hx = (v4u)xi * 0x9e3779b1u + seed, hy = (v4u)yi * 0x85ebca77u, hz = (v4u)zi * 0xc2b2ae3du;
  v4u a = hx ^ hy, b = (hx + 0x9e3779b1u) ^ hy, hz1 = hz + 0xc2b2ae3du;
  v4u c = hx ^ (hy + 0x85ebca77u), d = (hx + 0x9e3779b1u) ^ (hy + 0x85ebca77u);
  v4f low = v4_lerp(v4_lerp(v4_corner(a ^ hz), v4_corner(b ^ hz), fx),
                    v4_lerp(v4_corner(c ^ hz), v4_corner(d ^ hz), fx), fy);
  v4f high = v4_lerp(v4_lerp(v4_corner(a ^ hz1), v4_corner(b ^ hz1), fx),
                     v4_lerp(v4_corner(c ^ hz1), v4_corner(d ^ hz1), fx), fy);
  return v4_lerp(low, high, fz);
}

static inline v4_vec v4_scaled(v4_vec q, float k) { return (v4_vec){q.x * k, q.y * k, q.z * k}; }

// Share of a detail of `cell` units that survives filtering, from 1 / (1.5 footprints): all above
// 3, none below 1.5.
static inline v4f v4_survives(float cell, v4f inv_fp) { return v4_clamp01(cell * inv_fp - 1.0f); }

// A square wave of period 2 in [-1,1] whose edges are 1/inv_soft units wide.
static inline v4f v4_wave(v4f x, v4f inv_soft) {
  v4f y = x - 2.0f * __builtin_convertvector(v4_floori(x * 0.5f), v4f);
  v4f edge = 0.5f - v4_abs(y - 1.0f);
  return v4_min(v4_max(2.0f * edge * inv_soft, v4_set(-1)), v4_set(1));
}

// The chessboard, at q with its center at (0.5, 0), which puts the squares' edges at the wave's.
static inline void v4_board(const sv_sim_material *m, v4_vec q, v4f sharp, v4f rgb[3]) {
  v4f half = v4_set(0.5f), in_x = SV_SIM_BOARD_COLS * half - v4_abs(q.x - half),
      in_y = SV_SIM_BOARD_ROWS * half - v4_abs(q.y);
  v4f is_in = v4_clamp01(half + sharp * v4_min(in_x, in_y));
  v4f mix = is_in * (half + half * v4_wave(q.x, sharp) * v4_wave(q.y, sharp));
  for (int k = 0; k < 3; k++) rgb[k] = v4_lerp(v4_set(m->a[k]), v4_set(m->b[k]), mix);
}

// Reflectance at q (in cells) with a footprint in cells. flat[k] is set where the surface is a face
// across axis k, so that a checker does not beat against the face's own plane.
static inline void v4_texture(const sv_sim_material *m, v4_vec q, v4f footprint, const v4i flat[3],
                              v4f rgb[3]) {
  v4f one = v4_set(1), inv = 1.0f / v4_max(footprint, v4_set(1e-4f)), inv_fp = inv * (1 / 1.5f);
  // pattern edges: a footprint wide, at least 0.08 cells
  v4f sharp = v4_min(inv, v4_set(1 / 0.08f));
  if (m->pattern == SV_SIM_BOARD) {
    v4_board(m, q, sharp, rgb);
    return;
  }
  v4f n1 = v4_noise(q, 1) - 0.5f, n2 = v4_noise(v4_scaled(q, 2.17f), 2) - 0.5f;
  v4f n3 = v4_noise(v4_scaled(q, 4.31f), 3) - 0.5f, tint = v4_noise(v4_scaled(q, 0.31f), 4);
  n1 *= v4_survives(1.0f, inv_fp);
  n2 *= v4_survives(1 / 2.17f, inv_fp);
  n3 *= v4_survives(1 / 4.31f, inv_fp);
  v4f sum = n1 * 0.8f + n2 * 0.65f + n3 * 0.5f, mix;
  if (m->pattern == SV_SIM_CHECKER) {
    v4f wx = v4_select(flat[0], one, v4_wave(q.x, sharp)), wy = v4_select(flat[1], one, v4_wave(q.y, sharp));
    mix = 0.5f + 0.5f * wx * wy * v4_select(flat[2], one, v4_wave(q.z, sharp));
  } else if (m->pattern == SV_SIM_STRIPES) {
    mix = 0.5f + 0.5f * v4_wave(q.z + 0.6f * q.x + n1 * 1.2f, v4_min(sharp, v4_set(4)));
  } else if (m->pattern == SV_SIM_SPOTS) {
    mix = v4_clamp01(0.5f + n1 * v4_min(2.0f * sharp, v4_set(11)));
  } else {
    mix = v4_clamp01(0.5f + 1.3f * sum);
  }
  v4f gain = v4_max(0.78f + 0.85f * sum, v4_set(0.12f)), t = v4_clamp01((tint - 0.35f) * 1.6f) * 0.7f;
  for (int k = 0; k < 3; k++) {
    v4f base = v4_lerp(v4_set(m->a[k]), v4_set(m->b[k]), mix);
    rgb[k] = v4_lerp(base, v4_set(m->c[k]), t) * gain;
  }
}

#endif
