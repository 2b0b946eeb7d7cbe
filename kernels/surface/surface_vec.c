// SPDX-License-Identifier: Apache-2.0
// `surface` on 4x4 pixel blocks. surface_ref.c is the specification: same operations, same order.
#include "kernels/surface/surface.h"

#include <math.h>

#include "kernels/simd/v16.h"

// State of a block, 16 lanes each.
enum { TRANS = 0, WEIGHT = 16, SUM = 32, DEPTH = 48, STATE = 64 };

// Pixel centres of a block's lanes.
typedef struct {
  v16 x, y;
} lanes;

static inline lanes lanes_of(float x0, float y0, long block) {
  static const float in_x[4] = {0.5f, 1.5f, 2.5f, 3.5f};
  static const float in_y[16] = {0.5f, 0.5f, 0.5f, 0.5f, 1.5f, 1.5f, 1.5f, 1.5f,
                                 2.5f, 2.5f, 2.5f, 2.5f, 3.5f, 3.5f, 3.5f, 3.5f};
  return (lanes){v16_add(v16_set1(x0 + (float)(4 * (block & 7))), v16_load_quad(in_x)),
                 v16_add(v16_set1(y0 + (float)(4 * (block >> 3))), v16_load(in_y))};
}

typedef struct {
  v16 from, to, near; // near: in the first pass infinite
} limits;

// Whether the block may need more splats.
static inline int add_block(const limits *l, const sv_splat *s, lanes p, float *st) {
  const v16 dx = v16_sub(v16_set1(s->u_px), p.x), dy = v16_sub(v16_set1(s->v_px), p.y);
  const v16 b = v16_mul(v16_set1(s->qb), dx), c = v16_fma(v16_set1(s->qa), v16_mul(dx, dx), v16_set1(s->lo)),
            power = v16_fma(v16_fma(v16_set1(s->qc), dy, b), dy, c);
  const v16 alpha =
      v16_keep(v16_ge(power, v16_set1(SV_POWER_MIN)), v16_min(v16_set1(SV_ALPHA_MAX), v16_exp2_up8(power)));
  const v16 t = v16_load(st + TRANS), next = v16_sub(t, v16_mul(alpha, t)), depth = v16_load(st + DEPTH);
  const v16 z = v16_fnma(v16_set1(s->rgb[1]), dy, v16_fnma(v16_set1(s->rgb[0]), dx, v16_set1(s->z)));
  const v16m is_near = v16_lt(v16_abs(v16_sub(z, depth)), v16_mul(l->near, depth));
  const v16 w = v16_keep(is_near, v16_max(v16_zero(), v16_sub(v16_min(t, l->from), v16_max(next, l->to))));
  v16_store(st + TRANS, next);
  v16_store(st + WEIGHT, v16_add(v16_load(st + WEIGHT), w));
  v16_store(st + SUM, v16_fma(w, z, v16_load(st + SUM)));
  return v16m_bits(v16_gt(next, l->to)) != 0;
}

typedef struct {
  const uint32_t *entry;
  uint32_t n;
} tile_list;

static void add_all(const sv_surface_args *a, const limits *l, const tile_list *list, const float corner[2],
                    float *scratch) {
  uint64_t open = ~0ull;
  for (int b = 0; b < SV_TILE_BLOCKS; b++) {
    v16_store(scratch + STATE * b + TRANS, v16_set1(1.0f));
    v16_store(scratch + STATE * b + WEIGHT, v16_zero());
    v16_store(scratch + STATE * b + SUM, v16_zero());
  }
  for (uint32_t i = 0; i < list->n && open; i++) {
    const sv_intersection *r = a->intersection + list->entry[i];
    for (uint64_t mask = r->mask & open; mask; mask &= mask - 1) {
      const long b = __builtin_ctzll(mask);
      if (!add_block(l, a->splat + r->id, lanes_of(corner[0], corner[1], b), scratch + STATE * b))
        open &= ~(1ull << b);
    }
  }
}

static inline v16 quotient(const float *st) { return v16_div(v16_load(st + SUM), v16_load(st + WEIGHT)); }

void V(sv_surface)(const sv_surface_args *a, uint32_t tile, const uint32_t *list, uint32_t n,
                   float *scratch) {
  const int x0 = SV_TILE_PX * ((int)tile % a->n_tiles_x), y0 = SV_TILE_PX * ((int)tile / a->n_tiles_x);
  const float corner[2] = {(float)x0, (float)y0};
  const tile_list l = {list, n};
  limits limit = {v16_set1(a->from), v16_set1(a->to), v16_set1(INFINITY)};
  for (int b = 0; b < SV_TILE_BLOCKS; b++) v16_store(scratch + STATE * b + DEPTH, v16_set1(1.0f));
  add_all(a, &limit, &l, corner, scratch);
  for (int b = 0; b < SV_TILE_BLOCKS; b++) {
    float *st = scratch + STATE * b;
    v16_store(st + DEPTH, v16_keep(v16_le(v16_load(st + TRANS), limit.to), quotient(st)));
  }
  if (a->near > 0.0f) {
    limit.from = v16_set1(1.0f);
    limit.near = v16_set1(a->near);
    add_all(a, &limit, &l, corner, scratch);
    for (int b = 0; b < SV_TILE_BLOCKS; b++) {
      float *st = scratch + STATE * b;
      v16_store(st + DEPTH,
                v16_sel(v16_gt(v16_load(st + WEIGHT), v16_zero()), quotient(st), v16_load(st + DEPTH)));
    }
  }
  for (int b = 0; b < SV_TILE_BLOCKS; b++)
    v16_store4x4(a->depth + (long)(y0 + 4 * (b >> 3)) * a->stride + x0 + 4 * (b & 7), a->stride,
                 v16_load(scratch + STATE * b + DEPTH));
}
