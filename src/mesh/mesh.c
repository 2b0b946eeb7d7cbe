// SPDX-License-Identifier: Apache-2.0
#include "src/mesh/mesh.h"

#include <math.h>
#include <string.h>

#include "src/base/mathx.h"

#define MAX_WEIGHT 255
#define EDGE       0.015f // neighbours that differ by this share of the depth are at an edge
#define PER_BLOCK  4      // samples across a block when blocks are looked for

// --- memory --------------------------------------------------------------------------------------

static int n_slots_of(int cap_blocks) {
  int n = 1024;
  while (n < 2 * cap_blocks) n *= 2;
  return n;
}

static void carve(sv_mesh *m, const sv_mesh_cfg *cfg, sv_arena *a) {
  m->cfg = *cfg;
  m->n_slots = n_slots_of(cfg->cap_blocks);
  m->slot = SV_TAKE(a, int32_t, m->n_slots);
  m->block = sv_arena_take(a, (size_t)cfg->cap_blocks, sizeof *m->block);
  m->voxel = sv_arena_take(a, (size_t)cfg->cap_blocks, sizeof *m->voxel);
  m->cell = sv_arena_take(a, (size_t)cfg->cap_blocks, sizeof *m->cell);
  m->vertex = SV_TAKE(a, sv_mesh_vertex, cfg->cap_vertices);
  m->group = SV_TAKE(a, int32_t, cfg->cap_vertices);
  m->size = SV_TAKE(a, int32_t, cfg->cap_vertices);
  m->triangle = SV_TAKE(a, sv_triangle, cfg->cap_triangles);
}

size_t sv_mesh_bytes(const sv_mesh_cfg *cfg) {
  sv_arena dry = sv_arena_dry();
  sv_mesh m = {0};
  carve(&m, cfg, &dry);
  return dry.used_bytes;
}

sv_status sv_mesh_init(sv_mesh *m, const sv_mesh_cfg *cfg, sv_arena *arena) {
  memset(m, 0, sizeof *m);
  if (cfg->cap_blocks < 1 || cfg->cap_blocks > 1 << 24 || cfg->cap_vertices < 1 || cfg->cap_triangles < 1 ||
      !(cfg->voxel > 0) || !(cfg->radius > 0) || !(cfg->radius / cfg->voxel < (float)(1 << 28)))
    return SV_E_ARG;
  carve(m, cfg, arena);
  if (arena->status < 0) return arena->status;
  for (int i = 0; i < m->n_slots; i++) m->slot[i] = -1;
  return SV_OK;
}

// --- blocks --------------------------------------------------------------------------------------

static uint32_t hash_of(const int32_t x[3]) {
  return (uint32_t)x[0] * 73856093u ^ (uint32_t)x[1] * 19349669u ^ (uint32_t)x[2] * 83492791u;
}

// The place of a block in the hash: its own, or the free one where it belongs.
static int place_of(const sv_mesh *m, const int32_t x[3]) {
  uint32_t h = hash_of(x);
  for (h ^= h >> 15;; h++) {
    const int i = (int)(h & (uint32_t)(m->n_slots - 1));
    if (m->slot[i] < 0 || !memcmp(m->block[m->slot[i]].x, x, sizeof m->block->x)) return i;
  }
}

static int find_block(const sv_mesh *m, const int32_t x[3]) { return m->slot[place_of(m, x)]; }

static void want_block(sv_mesh *m, const int32_t x[3]) {
  const int place = place_of(m, x);
  if (m->slot[place] >= 0) return;
  if (m->n_blocks == m->cfg.cap_blocks) {
    m->is_full = true;
    return;
  }
  const int b = m->n_blocks++;
  m->slot[place] = b;
  memcpy(m->block[b].x, x, sizeof m->block[b].x);
  memset(m->voxel[b], 0, sizeof m->voxel[b]);
}

// --- fusing --------------------------------------------------------------------------------------

// Depth at the border and at edges becomes negative: the sign is a mark, which leaves the magnitude
// to the neighbours.
static void mark_edges(const sv_mesh_image *im) {
  const int w = im->view->width_px, h = im->view->height_px;
  const long stride = im->rgb->stride;
  for (int y = 0; y < h; y++)
    for (int x = 0; x < w; x++) {
      float *p = im->depth + y * stride + x;
      const float d = *p;
      if (!(d > 0)) continue;
      bool is_edge = x == 0 || y == 0 || x == w - 1 || y == h - 1;
      for (int i = 0; i < 4 && !is_edge; i++) {
        const float near = p[i == 0 ? -1 : i == 1 ? 1 : i == 2 ? -stride : stride];
        is_edge = !(fabsf(fabsf(near) - d) < EDGE * d);
      }
      if (is_edge) *p = -d;
    }
}

static void to_world(const sv_view *v, const float c[3], float out[3]) {
  const float d[3] = {c[0] - v->t[0], c[1] - v->t[1], c[2] - v->t[2]};
  for (int k = 0; k < 3; k++) out[k] = v->r[k] * d[0] + v->r[3 + k] * d[1] + v->r[6 + k] * d[2];
}

// The blocks along a pixel's ray within the truncation of its depth.
static void want_along(sv_mesh *m, const sv_view *v, int x, int y, float d) {
  const float reach = SV_MESH_TRUNCATION * m->cfg.voxel, side = SV_MESH_SIDE * m->cfg.voxel;
  const float *c = m->cfg.centre;
  float ray[3];
  if (!sv_view_ray(v, (float)x + 0.5f, (float)y + 0.5f, ray)) return;
  for (float z = d - reach; z <= d + reach; z += side / 4) {
    const float cam[3] = {ray[0] * z, ray[1] * z, ray[2] * z};
    float p[3];
    int32_t at[3];
    to_world(v, cam, p);
    const float q[3] = {p[0] - c[0], p[1] - c[1], p[2] - c[2]};
    if (!(z > 0) || q[0] * q[0] + q[1] * q[1] + q[2] * q[2] > m->cfg.radius * m->cfg.radius) continue;
    for (int k = 0; k < 3; k++) at[k] = (int32_t)floorf(q[k] / side);
    want_block(m, at);
  }
}

typedef struct {
  sv_mesh *m;
  const sv_mesh_image *im;
} fuse_job;

static void add_to(sv_voxel *o, float distance, const sv_planes *rgb, long at) {
  const float w = (float)o->weight;
  for (int k = 0; k < 3; k++) {
    const float c = 255.0f * sv_clampf(rgb->c[k][at], 0, 1);
    o->rgb[k] = (uint8_t)(((float)o->rgb[k] * w + c) / (w + 1) + 0.5f);
  }
  o->distance = (o->distance * w + distance) / (w + 1);
  if (o->weight < MAX_WEIGHT) o->weight++;
}

// Whether a ball lies beside a pinhole's picture or behind the camera as a whole. c: its center in
// the camera's frame.
static bool is_outside(const sv_view *v, const float c[3], float radius) {
  const float focal[2] = {v->fx, v->fy}, centre[2] = {v->cx, v->cy},
              size[2] = {(float)v->width_px, (float)v->height_px};
  if (c[2] < -radius) return true;
  for (int k = 0; k < 2; k++) {
    const float low = centre[k], high = size[k] - centre[k], f = focal[k];
    if (f * c[k] + low * c[2] < -radius * sqrtf(f * f + low * low)) return true;
    if (high * c[2] - f * c[k] < -radius * sqrtf(f * f + high * high)) return true;
  }
  return false;
}

static void fuse_voxel(const fuse_job *j, sv_voxel *o, const float cam[3], float reach) {
  const sv_view *v = j->im->view;
  float uv[2], z;
  if (!sv_view_project(v, cam, uv, &z)) return;
  if (!(uv[0] >= 0 && uv[1] >= 0 && uv[0] < (float)v->width_px && uv[1] < (float)v->height_px)) return;
  const long at = (long)(int)uv[1] * j->im->rgb->stride + (int)uv[0];
  const float d = j->im->depth[at], behind = z - d;
  if (d > 0 && behind <= reach) add_to(o, sv_clampf(-behind / reach, -1, 1), j->im->rgb, at);
}

static void fuse_task(void *arg, int b, int i_thread) {
  const fuse_job *j = arg;
  const sv_mesh_cfg *c = &j->m->cfg;
  const sv_view *v = j->im->view;
  const float half = 0.5f * SV_MESH_SIDE;
  float middle[3], cam[3];
  (void)i_thread;
  for (int k = 0; k < 3; k++)
    middle[k] = c->centre[k] + c->voxel * ((float)(SV_MESH_SIDE * j->m->block[b].x[k]) + half);
  for (int k = 0; k < 3; k++)
    cam[k] = v->r[3 * k] * middle[0] + v->r[3 * k + 1] * middle[1] + v->r[3 * k + 2] * middle[2] + v->t[k];
  if (!v->fisheye && is_outside(v, cam, 1.74f * half * c->voxel)) return; // half of its diagonal
  for (int i = 0; i < SV_MESH_BLOCK_VOXELS; i++) {
    const float at[3] = {(float)(i & 7) + 0.5f - half, (float)(i >> 3 & 7) + 0.5f - half,
                         (float)(i >> 6) + 0.5f - half};
    float p[3];
    for (int k = 0; k < 3; k++)
      p[k] = cam[k] + c->voxel * (v->r[3 * k] * at[0] + v->r[3 * k + 1] * at[1] + v->r[3 * k + 2] * at[2]);
    fuse_voxel(j, &j->m->voxel[b][i], p, SV_MESH_TRUNCATION * c->voxel);
  }
}

void sv_mesh_fuse(sv_mesh *m, const sv_mesh_image *im, const sv_pool *pool) {
  const sv_view *v = im->view;
  mark_edges(im);
  for (int y = 1; y + 1 < v->height_px; y++)
    for (int x = 1; x + 1 < v->width_px; x++) {
      const float d = im->depth[(long)y * im->rgb->stride + x];
      if (!(d > 0)) continue;
      // Enough pixels that no block between two of them is missed.
      const int step = (int)(v->fx * SV_MESH_SIDE * m->cfg.voxel / (PER_BLOCK * d));
      if (step > 1 && (x % step || y % step)) continue;
      want_along(m, v, x, y, d);
    }
  fuse_job j = {m, im};
  sv_pool_run(pool, fuse_task, &j, m->n_blocks);
}

// --- surface -------------------------------------------------------------------------------------

typedef struct {
  int b, i; // block, voxel in it; b -1: there is none
} place;

// The voxel at an offset from voxel i of block b.
static place moved(const sv_mesh *m, int b, int i, const int d[3]) {
  int at[3] = {(i & 7) + d[0], (i >> 3 & 7) + d[1], (i >> 6) + d[2]};
  int32_t x[3];
  bool is_same = true;
  for (int k = 0; k < 3; k++) {
    const int over = at[k] < 0 ? -1 : at[k] >= SV_MESH_SIDE;
    x[k] = m->block[b].x[k] + over;
    at[k] -= over * SV_MESH_SIDE;
    is_same &= !over;
  }
  return (place){is_same ? b : find_block(m, x), at[0] + SV_MESH_SIDE * (at[1] + SV_MESH_SIDE * at[2])};
}

static const sv_voxel *voxel_at(const sv_mesh *m, place p) { return p.b < 0 ? NULL : &m->voxel[p.b][p.i]; }

// The vertex of the cell between voxel i and its neighbours above: the mean of where the cell's
// edges cross the surface. False: it is not crossed, or not all is known.
static bool vertex_of(const sv_mesh *m, int b, int i, int min_weight, sv_mesh_vertex *out) {
  const sv_voxel *corner[8];
  float sum[3] = {0}, rgb[3] = {0};
  int n = 0;
  for (int k = 0; k < 8; k++) {
    const int d[3] = {k & 1, k >> 1 & 1, k >> 2};
    corner[k] = voxel_at(m, moved(m, b, i, d));
    if (!corner[k] || corner[k]->weight < min_weight) return false;
  }
  for (int k = 0; k < 8; k++)
    for (int axis = 0; axis < 3; axis++) {
      const int to = k | 1 << axis;
      const float from = corner[k]->distance, d = corner[to]->distance;
      if (to == k || (from < 0) == (d < 0)) continue;
      const float u = from / (from - d);
      for (int c = 0; c < 3; c++) {
        sum[c] += (float)(k >> c & 1) + (c == axis ? u : 0);
        rgb[c] += (1 - u) * (float)corner[k]->rgb[c] + u * (float)corner[to]->rgb[c];
      }
      n++;
    }
  if (!n) return false;
  for (int c = 0; c < 3; c++) {
    const int at = SV_MESH_SIDE * m->block[b].x[c] + (i >> (3 * c) & 7);
    out->x[c] = m->cfg.centre[c] + m->cfg.voxel * ((float)at + 0.5f + sum[c] / (float)n);
    out->rgb[c] = (uint8_t)(rgb[c] / (float)n + 0.5f);
  }
  return true;
}

static sv_status add_vertices(sv_mesh *m, int min_weight) {
  for (int b = 0; b < m->n_blocks; b++)
    for (int i = 0; i < SV_MESH_BLOCK_VOXELS; i++) {
      sv_mesh_vertex v;
      m->cell[b][i] = -1;
      if (!m->voxel[b][i].weight || !vertex_of(m, b, i, min_weight, &v)) continue;
      if (m->n_vertices == m->cfg.cap_vertices) return SV_E_FULL;
      m->vertex[m->n_vertices] = v;
      m->cell[b][i] = m->n_vertices++;
    }
  return SV_OK;
}

// The quad of the four cells about the edge from voxel i along an axis, as two triangles that face
// the side in front.
static sv_status add_quad(sv_mesh *m, int b, int i, int axis) {
  const int b1 = (axis + 1) % 3, c1 = (axis + 2) % 3;
  static const int cells[4][2] = {{-1, -1}, {0, -1}, {0, 0}, {-1, 0}};
  int32_t v[4];
  int up[3] = {0};
  up[axis] = 1;
  const sv_voxel *from = &m->voxel[b][i], *to = voxel_at(m, moved(m, b, i, up));
  if (!to || !to->weight || (from->distance < 0) == (to->distance < 0)) return SV_OK;
  for (int k = 0; k < 4; k++) {
    int d[3] = {0};
    d[b1] = cells[k][0];
    d[c1] = cells[k][1];
    const place p = moved(m, b, i, d);
    v[k] = p.b < 0 ? -1 : m->cell[p.b][p.i];
    if (v[k] < 0) return SV_OK;
  }
  if (m->n_triangles + 2 > m->cfg.cap_triangles) return SV_E_FULL;
  const bool is_up = from->distance < 0;
  m->triangle[m->n_triangles++] = (sv_triangle){{v[0], v[is_up ? 1 : 2], v[is_up ? 2 : 1]}};
  m->triangle[m->n_triangles++] = (sv_triangle){{v[0], v[is_up ? 2 : 3], v[is_up ? 3 : 2]}};
  return SV_OK;
}

sv_status sv_mesh_extract(sv_mesh *m, int min_weight) {
  m->n_vertices = m->n_triangles = 0;
  sv_status s = add_vertices(m, sv_maxi(min_weight, 1));
  for (int b = 0; b < m->n_blocks && s == SV_OK; b++)
    for (int i = 0; i < SV_MESH_BLOCK_VOXELS && s == SV_OK; i++)
      for (int axis = 0; axis < 3 && s == SV_OK && m->voxel[b][i].weight; axis++) s = add_quad(m, b, i, axis);
  return s;
}

// --- connected parts -----------------------------------------------------------------------------

static int32_t root_of(int32_t *group, int32_t v) {
  while (group[v] != v) v = group[v] = group[group[v]];
  return v;
}

void sv_mesh_drop_small(sv_mesh *m, float share) {
  int32_t *group = m->group, *size = m->size;
  int largest = 0, n_vertices = 0, n_triangles = 0;
  for (int v = 0; v < m->n_vertices; v++) {
    group[v] = v;
    size[v] = 0;
  }
  for (int t = 0; t < m->n_triangles; t++)
    for (int k = 0; k < 2; k++) {
      const int32_t a = root_of(group, m->triangle[t].v[k]), b = root_of(group, m->triangle[t].v[k + 1]);
      group[a < b ? b : a] = a < b ? a : b;
    }
  for (int v = 0; v < m->n_vertices; v++) {
    const int32_t r = root_of(group, v);
    if (++size[r] > largest) largest = size[r];
  }
  for (int v = 0; v < m->n_vertices; v++) group[v] = root_of(group, v);
  // Now group becomes the new place of each vertex, -1: dropped. Roots come first, so their sizes
  // are read before.
  for (int v = 0; v < m->n_vertices; v++) {
    const bool is_kept = (float)size[group[v]] >= share * (float)largest;
    if (is_kept) m->vertex[n_vertices] = m->vertex[v];
    group[v] = is_kept ? n_vertices++ : -1;
  }
  for (int t = 0; t < m->n_triangles; t++) {
    sv_triangle to;
    for (int k = 0; k < 3; k++) to.v[k] = group[m->triangle[t].v[k]];
    if (to.v[0] >= 0) m->triangle[n_triangles++] = to;
  }
  m->n_vertices = n_vertices;
  m->n_triangles = n_triangles;
}
