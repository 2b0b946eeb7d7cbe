// SPDX-License-Identifier: Apache-2.0
#include "platform/sim/trace.h"

#include <math.h>
#include <string.h>

#include "platform/sim/hit.h"
#include "platform/sim/texture.h"
#include "platform/sim/v4.h"
#include "src/base/mathx.h"

// A strip of columns is rendered from top to bottom. Three rows of visibility are kept, so that a
// row is shaded when its neighbours are known. A strip covers 30 columns and one more on each side.
#define QUADS     8
#define LANES     (4 * QUADS)
#define SHOWN     (LANES - 2)
#define N_SAMPLES 16
#define NEAR_M    0.05f // near plane, camera z; of a fisheye, distance
#define SUN_GAP_M 0.01f // a shadow ray ignores nearer hits: the surface that it starts on

typedef struct {
  v4f t;       // camera z; of a fisheye, distance
  v4i key;     // 0: background; else (primitive * 8 + face + 1) * 2 + in shadow
  v4i is_near; // a fine part is within about a pixel
} look;

typedef struct {
  look quad[QUADS];
} look_row;

typedef struct {
  const sv_sim_shot *shot;
  int x0_px;                        // first column shown by the strip
  uint8_t active[SV_SIM_CAP_PRIMS]; // primitives that this row and strip may meet, nearest first
  int n_active;
} strip;

// ray: (x, y, 1), of a fisheye a unit vector.
static v4_vec local_ray(const sv_sim_seen *s, v4_vec ray) {
  const float *m = s->m;
  const v4f x = ray.x, y = ray.y, z = ray.z;
  return (v4_vec){m[0] * x + m[1] * y + m[2] * z, m[3] * x + m[4] * y + m[5] * z,
                  m[6] * x + m[7] * y + m[8] * z};
}

static v4_vec local_camera(const sv_sim_seen *s) {
  return (v4_vec){v4_set(s->o[0]), v4_set(s->o[1]), v4_set(s->o[2])};
}

// Local position of the point at depth t on a ray.
static v4_vec local_point(const sv_sim_seen *s, v4_vec ray, v4f t) {
  return (v4_vec){s->o[0] + t * ray.x, s->o[1] + t * ray.y, s->o[2] + t * ray.z};
}

static v4f along(const float *row, v4_vec ray) { return row[0] * ray.x + row[1] * ray.y + row[2] * ray.z; }

static uint64_t shade_mask(const sv_sim_shot *s, v4_vec ray, v4f t, v4i is_hit) {
  const float *u = s->grid_u, *v = s->grid_v;
  v4f lo = v4_set(0), hi = v4_set(SV_SIM_GRID - 1);
  v4f cu = v4_min(v4_max(t * along(u, ray) + u[3], lo), hi);
  v4f cv = v4_min(v4_max(t * along(v, ray) + v[3], lo), hi);
  v4i cell = __builtin_convertvector(cv, v4i) * SV_SIM_GRID + __builtin_convertvector(cu, v4i);
  uint64_t mask = 0;
  for (int i = 0; i < 4; i++)
    if (is_hit[i]) mask |= s->grid[cell[i]];
  return mask;
}

// Which of four surface points lie in the shadow of another primitive.
static v4i in_shadow(const sv_sim_shot *s, v4_vec ray, v4f t, v4i prim, v4i is_hit) {
  const float *gw = s->grid_w;
  v4i dark = v4_seti(0);
  v4f w = t * along(gw, ray) + gw[3];
  for (uint64_t todo = shade_mask(s, ray, t, is_hit); todo; todo &= todo - 1) {
    int i = __builtin_ctzll(todo);
    const sv_sim_seen *p = &s->seen[i];
    v4i other = is_hit & ~dark & (prim != i) & (w < p->sunward_m);
    if (!v4_any(other)) continue;
    v4_vec o = local_point(p, local_ray(p, ray), t);
    v4_vec d = {v4_set(p->sun[0]), v4_set(p->sun[1]), v4_set(p->sun[2])};
    dark |= other & v4_hit_shape(s->scene->prims[i].shape, p->half, o, d, v4_set(SUN_GAP_M)).mask;
  }
  return dark;
}

// The nearest surfaces along four rays that lie in columns [lo_px, hi_px]. is_near is
// found only for is_centre, the rays through pixel centres.
static look see(const strip *st, v4_vec ray, int lo_px, int hi_px, bool is_centre) {
  const sv_sim_shot *s = st->shot;
  look out = {v4_set(1e30f), v4_seti(0), v4_seti(0)};
  v4f near = v4_set(NEAR_M);
  for (int k = 0; k < st->n_active; k++) {
    int i = st->active[k];
    const sv_sim_seen *p = &s->seen[i];
    if (p->x0_px > hi_px || p->x1_px <= lo_px) continue;
    if (!v4_any(out.t > p->near_m)) break; // sorted by near_m: the rest lies behind
    v4_vec d = local_ray(p, ray), o = local_camera(p);
    sv_sim_shape shape = s->scene->prims[i].shape;
    v4_hit h = v4_hit_shape(shape, p->half, o, d, near);
    v4i is_nearer = h.mask & (h.t < out.t);
    out.t = v4_select(is_nearer, h.t, out.t);
    out.key = v4_selecti(is_nearer, (i * 8 + 1 + h.face) * 2, out.key);
    if (p->is_fine && is_centre) {
      v4_hit wide = v4_hit_shape(shape, p->wide, o, d, near);
      out.is_near |= wide.mask;
    }
  }
  v4i is_hit = out.key != 0;
  if (v4_any(is_hit)) out.key -= in_shadow(s, ray, out.t, ((out.key >> 1) - 1) >> 3, is_hit);
  return out;
}

// Through another place of the lens, to the point at the distance that is sharp.
static void lean(const sv_sim_shot *s, float ray[3]) {
  if (s->lean[0] == 0 && s->lean[1] == 0) return;
  ray[0] -= s->lean[0];
  ray[1] -= s->lean[1];
  const float inv = 1 / sqrtf(ray[0] * ray[0] + ray[1] * ray[1] + ray[2] * ray[2]);
  for (int k = 0; k < 3; k++) ray[k] *= inv;
}

// Rays of four places in the picture. Beyond the lens's range they are NaN and hit nothing.
static v4_vec ray_at(const sv_sim_shot *s, v4f px, v4f py) {
  v4_vec r = {(px - s->view.cx) * (1.0f / s->view.fx), (py - s->view.cy) * (1.0f / s->view.fy), v4_set(1)};
  if (!s->view.fisheye) return r;
  for (int i = 0; i < 4; i++) {
    float ray[3] = {NAN, NAN, NAN};
    (void)sv_view_ray(&s->view, px[i], py[i], ray);
    lean(s, ray);
    r.x[i] = ray[0];
    r.y[i] = ray[1];
    r.z[i] = ray[2];
  }
  return r;
}

// Four points of one primitive, at depth t on rays. is_dark: in the shadow.
typedef struct {
  v4_vec ray;
  v4f t;
  v4i face, is_dark;
} points4;

// Linear radiance of four points: a Lambertian surface under a sun and a sky that is brighter
// above, and a highlight (Blinn's half vector, power 16).
static void shade(const sv_sim_shot *s, int i, const points4 *points, v4f rgb[3]) {
  const v4f t = points->t;
  const v4i face = points->face;
  const sv_sim_seen *p = &s->seen[i];
  const sv_sim_prim *prim = &s->scene->prims[i];
  v4_vec ray = local_ray(p, points->ray), at = local_point(p, ray, t);
  v4_vec n = v4_normal(prim->shape, p->half, at, face);
  v4f inv_len = 1.0f / v4_sqrt(v4_dot(ray, ray));
  v4f facing = v4_max(-v4_dot(n, ray) * inv_len, v4_set(0.15f));
  float inv_cell = 1.0f / prim->material.cell_m;
  v4f footprint = t * (inv_cell / s->view.fx) / facing;
  v4_vec q = {at.x * inv_cell + p->texture_origin[0], at.y * inv_cell + p->texture_origin[1],
              at.z * inv_cell + p->texture_origin[2]};
  v4i is_box = v4_seti(prim->shape == SV_SIM_BOX ? -1 : 0), axis = face >> 1;
  v4i flat[3] = {is_box & (axis == 0), is_box & (axis == 1), is_box & (axis == 2)};
  if (prim->shape == SV_SIM_CYLINDER) flat[2] = face != 0;
  v4_texture(&prim->material, q, footprint, flat, rgb);
  v4f lit = v4_select(points->is_dark, v4_set(0), v4_max(v4_dotf(n, p->sun), v4_set(0)));
  v4f light = s->scene->sun * lit + s->scene->sky * (0.65f + 0.35f * v4_dotf(n, p->up));
  v4f shine = v4_set(0);
  if (prim->material.gloss > 0) {
    v4_vec h = {p->sun[0] - ray.x * inv_len, p->sun[1] - ray.y * inv_len, p->sun[2] - ray.z * inv_len};
    v4f c = v4_max(v4_dot(n, h), v4_set(0)) / v4_sqrt(v4_max(v4_dot(h, h), v4_set(1e-12f)));
    c *= c;
    c *= c;
    c *= c;
    c *= c;
    shine = prim->material.gloss * c * v4_select(lit > 0.0f, v4_set(1), v4_set(0));
  }
  for (int k = 0; k < 3; k++) rgb[k] = v4_clamp01(rgb[k] * light + shine);
}

// Sample positions in a pixel, in sixteenths: one in each column and each row, the first four close
// to the pixel's corners, the others on a lattice.
static const uint8_t SAMPLE_X[N_SAMPLES] = {0, 1, 14, 15, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13};
static const uint8_t SAMPLE_Y[N_SAMPLES] = {1, 15, 0, 14, 4, 9, 2, 7, 12, 5, 10, 3, 8, 13, 6, 11};

typedef struct {
  int n_shares;
  struct share {
    int32_t key;
    float n, x, y, z, t; // sums over the samples that see this surface
  } shares[N_SAMPLES];
} pixel_shares;

// Traces samples 4q..4q+3 of a pixel and adds them to its surfaces, except background.
// Returns whether all four see `key`.
static bool sample_four(const strip *st, int x_px, int y_px, int q, int32_t key, pixel_shares *out) {
  v4f dx, dy;
  for (int i = 0; i < 4; i++) {
    dx[i] = ((float)SAMPLE_X[q * 4 + i] + 0.5f) / N_SAMPLES;
    dy[i] = ((float)SAMPLE_Y[q * 4 + i] + 0.5f) / N_SAMPLES;
  }
  const v4_vec ray = ray_at(st->shot, (float)x_px + dx, (float)y_px + dy);
  look l = see(st, ray, x_px, x_px, false);
  for (int i = 0; i < 4; i++) {
    if (!l.key[i]) continue;
    int k = 0;
    while (k < out->n_shares && out->shares[k].key != l.key[i]) k++;
    if (k == out->n_shares) out->shares[out->n_shares++] = (struct share){.key = l.key[i]};
    struct share *s = &out->shares[k];
    s->n += 1;
    s->x += ray.x[i];
    s->y += ray.y[i];
    s->z += ray.z[i];
    s->t += l.t[i];
  }
  return !v4_any(l.key != key);
}

// The mean over the samples: each surface is shaded once, in the middle of its samples. Surfaces of
// one primitive (faces, lit and dark parts) go through together.
static void shade_shares(const sv_sim_shot *shot, const pixel_shares *px, float rgb[3]) {
  bool is_done[N_SAMPLES] = {false};
  rgb[0] = rgb[1] = rgb[2] = 0;
  for (int k = 0; k < px->n_shares; k++) {
    if (is_done[k]) continue;
    int prim = ((px->shares[k].key >> 1) - 1) >> 3, n = 0;
    v4f weight = v4_set(0), c[3];
    points4 at = {{weight, weight, v4_set(1)}, v4_set(1), v4_seti(0), v4_seti(0)};
    for (int j = k; j < px->n_shares && n < 4; j++) {
      const struct share *s = &px->shares[j];
      if (is_done[j] || ((s->key >> 1) - 1) >> 3 != prim) continue;
      float inv = 1.0f / s->n;
      is_done[j] = true;
      at.ray.x[n] = s->x * inv;
      at.ray.y[n] = s->y * inv;
      if (shot->view.fisheye) at.ray.z[n] = s->z * inv;
      at.t[n] = s->t * inv;
      weight[n] = s->n / N_SAMPLES;
      at.face[n] = ((s->key >> 1) - 1) & 7;
      at.is_dark[n] = -(s->key & 1);
      n++;
    }
    shade(shot, prim, &at, c);
    for (int i = 0; i < 3; i++)
      for (int j = 0; j < n; j++) rgb[i] += c[i][j] * weight[j];
  }
}

// Shades a pixel that may hold an edge. False: all corners see the same surface as the centre
// (key), so it is an inner pixel and rgb is untouched. A fine part may fall between five samples.
static bool edge_pixel(const strip *st, int x_px, int y_px, int32_t key, bool is_near, float rgb[3]) {
  pixel_shares px = {.n_shares = 0};
  if (sample_four(st, x_px, y_px, 0, key, &px) && !is_near) return false;
  for (int q = 1; q < N_SAMPLES / 4; q++) (void)sample_four(st, x_px, y_px, q, key, &px);
  shade_shares(st->shot, &px, rgb);
  return true;
}

static void activate(strip *st, int y_px) {
  const sv_sim_shot *s = st->shot;
  st->n_active = 0;
  for (int k = 0; k < s->n_order; k++) {
    const sv_sim_seen *p = &s->seen[s->order[k]];
    // a row of slack: neighbours share the list
    if (p->y0_px > y_px + 1 || p->y1_px < y_px) continue;
    if (p->x0_px > st->x0_px + SHOWN || p->x1_px < st->x0_px) continue;
    st->active[st->n_active++] = s->order[k];
  }
}

static void look_along(strip *st, int y_px, look_row *row) {
  activate(st, y_px);
  const v4f py = v4_set((float)y_px + 0.5f);
  for (int q = 0; q < QUADS; q++) {
    int x_px = st->x0_px - 1 + 4 * q;
    v4f px = (float)x_px + (v4f){0.5f, 1.5f, 2.5f, 3.5f};
    row->quad[q] = see(st, ray_at(st->shot, px, py), x_px, x_px + 3, true);
  }
}

// Shades four pixels, one primitive after another; lanes that are background or an edge stay as
// they are.
static void shade_quad(const strip *st, int q, int y_px, const look *l, const uint8_t *is_edge, float *rgb) {
  v4f px = (float)(st->x0_px - 1 + 4 * q) + (v4f){0.5f, 1.5f, 2.5f, 3.5f};
  const v4_vec ray = ray_at(st->shot, px, v4_set((float)y_px + 0.5f));
  // the background has no depth to look up a texture at
  v4f t = v4_select(l->key != 0, l->t, v4_set(1));
  v4i id = (l->key >> 1) - 1;
  const points4 at = {ray, t, id & 7, -(l->key & 1)};
  bool is_done[4];
  for (int i = 0; i < 4; i++) is_done[i] = is_edge[i] || !l->key[i];
  for (int i = 0; i < 4; i++) {
    if (is_done[i]) continue;
    v4f c[3];
    shade(st->shot, id[i] >> 3, &at, c);
    for (int k = i; k < 4; k++) {
      if (is_done[k] || id[k] >> 3 != id[i] >> 3) continue;
      is_done[k] = true;
      for (int j = 0; j < 3; j++) rgb[3 * k + j] = c[j][k];
    }
  }
}

static void shade_row(strip *st, int y_px, const look_row *above, const look_row *row, const look_row *below,
                      const sv_sim_sink *sink) {
  float rgb[3 * LANES] = {0}, depth[LANES];
  int32_t key[LANES], up[LANES], down[LANES], near[LANES];
  uint8_t is_edge[LANES] = {0};
  int n = st->shot->view.width_px - st->x0_px < SHOWN ? st->shot->view.width_px - st->x0_px : SHOWN;
  for (int q = 0; q < QUADS; q++)
    for (int i = 0; i < 4; i++) {
      int k = 4 * q + i;
      key[k] = row->quad[q].key[i];
      up[k] = above->quad[q].key[i];
      down[k] = below->quad[q].key[i];
      near[k] = row->quad[q].is_near[i];
      depth[k] = key[k] ? row->quad[q].t[i] : 0;
    }
  activate(st, y_px);
  for (int k = 1; k <= n; k++) {
    bool may_be = key[k] != key[k - 1] || key[k] != key[k + 1] || key[k] != up[k] || key[k] != down[k];
    if (may_be || near[k])
      is_edge[k] = edge_pixel(st, st->x0_px + k - 1, y_px, key[k], near[k] != 0, rgb + 3 * k);
  }
  for (int q = 0; q < QUADS; q++) shade_quad(st, q, y_px, &row->quad[q], is_edge + 4 * q, rgb + 12 * q);
  sink->put(sink->self, st->x0_px, y_px, n, rgb + 3, depth + 1);
}

void sv_sim_shot_rows(const sv_sim_shot *shot, int y0, int y1, const sv_sim_sink *sink) {
  y0 = sv_maxi(y0, 0);
  y1 = sv_mini(y1, shot->view.height_px);
  if (y0 >= y1) return;
  for (int x0 = 0; x0 < shot->view.width_px; x0 += SHOWN) {
    strip st = {.shot = shot, .x0_px = x0};
    look_row rows[3];
    look_along(&st, y0 - 1, &rows[0]);
    look_along(&st, y0, &rows[1]);
    for (int y = y0; y < y1; y++) {
      int i = y - y0;
      look_along(&st, y + 1, &rows[(i + 2) % 3]);
      shade_row(&st, y, &rows[i % 3], &rows[(i + 1) % 3], &rows[(i + 2) % 3], sink);
    }
  }
}
