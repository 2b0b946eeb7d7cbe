// SPDX-License-Identifier: Apache-2.0
// corner over the vocabulary: products of gradients of five rows in a ring, summed down, then
// across. A cell is one vector wide, so each lane keeps the best of its column until the cell ends.
#include <stddef.h>

#include "kernels/corner/corner.h"
#include "kernels/simd/v16.h"

typedef struct {
  // [3][5][pitch], [3][pitch], [pitch], [pitch]; a pitch starts with 16 spare
  float *ring, *sum, *best, *row;
  int pitch;
} corner_rows;

static corner_rows rows_of(const sv_corner_args *a) {
  corner_rows r;
  r.pitch = a->stride + 32;
  r.ring = a->scratch + 16;
  r.sum = r.ring + 15 * r.pitch;
  r.best = r.sum + 3 * r.pitch;
  r.row = r.best + r.pitch;
  return r;
}

static float *ring_at(const corner_rows *r, int k, int y) { return r->ring + (k * 5 + y % 5) * r->pitch; }

static void products(const sv_corner_args *a, const corner_rows *r, int y) {
  const float *s = a->src + (size_t)y * (size_t)a->stride;
  float *xx = ring_at(r, 0, y), *xy = ring_at(r, 1, y), *yy = ring_at(r, 2, y);
  for (int x = 0; x < a->width_px; x += 16) {
    v16 gx = v16_sub(v16_load(s + x + 1), v16_load(s + x - 1));
    v16 gy = v16_sub(v16_load(s + x + a->stride), v16_load(s + x - a->stride));
    v16_store(xx + x, v16_mul(gx, gx));
    v16_store(xy + x, v16_mul(gx, gy));
    v16_store(yy + x, v16_mul(gy, gy));
  }
}

static inline v16 sum5(v16 a, v16 b, v16 c, v16 d, v16 e) {
  return v16_add(v16_add(v16_add(a, b), v16_add(d, e)), c);
}

static void sum_down(const sv_corner_args *a, const corner_rows *r, int y) {
  for (int k = 0; k < 3; k++) {
    const float *p0 = ring_at(r, k, y - 2), *p1 = ring_at(r, k, y - 1), *p2 = ring_at(r, k, y);
    const float *p3 = ring_at(r, k, y + 1), *p4 = ring_at(r, k, y + 2);
    float *sum = r->sum + k * r->pitch;
    for (int x = 0; x < a->width_px; x += 16)
      v16_store(sum + x, sum5(v16_load(p0 + x), v16_load(p1 + x), v16_load(p2 + x), v16_load(p3 + x),
                              v16_load(p4 + x)));
  }
}

static inline v16 across(const float *p) {
  return sum5(v16_load(p - 2), v16_load(p - 1), v16_load(p), v16_load(p + 1), v16_load(p + 2));
}

static void take_best(const sv_corner_args *a, const corner_rows *r, int y) {
  const v16 half = v16_set1(0.5f), at = v16_set1((float)y);
  const v16 lo = v16_set1((float)a->margin_px), hi = v16_set1((float)(a->width_px - a->margin_px));
  for (int x = 0; x < a->width_px; x += 16) {
    v16 xx = across(r->sum + x), xy = across(r->sum + r->pitch + x), yy = across(r->sum + 2 * r->pitch + x);
    v16 d = v16_mul(v16_sub(xx, yy), half);
    v16 root = v16_sqrt(v16_add(v16_mul(d, d), v16_mul(xy, xy)));
    v16 score = v16_sub(v16_mul(v16_add(xx, yy), half), root);
    v16 best = v16_load(r->best + x), px = v16_add(v16_set1((float)x), v16_iota());
    v16m is_better = v16m_and(v16_gt(score, best), v16m_and(v16_ge(px, lo), v16_lt(px, hi)));
    if (!v16m_bits(is_better)) continue;
    v16_store(r->best + x, v16_sel(is_better, score, best));
    v16_store(r->row + x, v16_sel(is_better, at, v16_load(r->row + x)));
  }
}

static void end_cells(const sv_corner_args *a, const corner_rows *r, int cy) {
  const int n_x = (a->width_px + SV_CORNER_CELL - 1) / SV_CORNER_CELL;
  for (int cx = 0; cx < n_x; cx++) {
    sv_corner best = {0.0f, -1, -1};
    for (int x = cx * SV_CORNER_CELL; x < (cx + 1) * SV_CORNER_CELL; x++) {
      float s = r->best[x];
      int y = (int)r->row[x];
      if (s > best.score || (s == best.score && s > 0.0f && y < best.y)) {
        best.score = s;
        best.x = (int16_t)x;
        best.y = (int16_t)y;
      }
    }
    a->out[cy * n_x + cx] = best;
  }
}

void V(sv_corner)(const sv_corner_args *a) {
  const corner_rows r = rows_of(a);
  int n_done = -1; // rows up to this one are in the ring
  // The five rows about a pixel at the border hold spare floats: whatever they are, they are
  // masked.
  for (int i = 0; i < SV_CORNER_SCRATCH_FLOATS(a->stride); i++) a->scratch[i] = 0.0f;
  for (int cy = a->cell0; cy < a->cell1; cy++) {
    for (int x = 0; x < a->stride; x += 16) v16_store(r.best + x, v16_zero());
    for (int y = cy * SV_CORNER_CELL; y < (cy + 1) * SV_CORNER_CELL; y++) {
      if (y < a->margin_px || y >= a->height_px - a->margin_px) continue;
      for (int k = n_done < y - 2 ? y - 2 : n_done + 1; k <= y + 2; k++) products(a, &r, k);
      n_done = y + 2;
      sum_down(a, &r, y);
      take_best(a, &r, y);
    }
    end_cells(a, &r, cy);
  }
}
