// SPDX-License-Identifier: Apache-2.0
// The specification of `raster`: pixel after pixel inside each marked block. Pixel state is kept as
// [block][16], lane = 4 (y mod 4) + (x mod 4).
#include "kernels/raster/raster.h"

#include "kernels/simd/s1_math.h"
#include "kernels/ops.h"

typedef struct {
  float dx, dy, power, a_raw, a;
} pair_eval;

// x0, y0: the tile's corner.
static pair_eval evaluate(const sv_splat *s, float x0, float y0, int block, int lane) {
  pair_eval e;
  e.dx = s->u_px - (x0 + ((float)(4 * (block & 7) + (lane & 3)) + 0.5f));
  e.dy = s->v_px - (y0 + ((float)(4 * (block >> 3) + (lane >> 2)) + 0.5f));
  e.power = fmaf(fmaf(s->qc, e.dy, s->qb * e.dx), e.dy, fmaf(s->qa, e.dx * e.dx, s->lo));
  e.a_raw = s1_exp2_up8(e.power);
  e.a = s1_min(SV_ALPHA_MAX, e.a_raw);
  return e;
}

static long pixel_offset(int block, int lane, int stride) {
  return (long)(4 * (block >> 3) + (lane >> 2)) * stride + 4 * (block & 7) + (lane & 3);
}

static void tile_origin(const sv_raster_args *a, uint32_t tile, float *x, float *y, long *offset) {
  int tx = (int)tile % a->n_tiles_x, ty = (int)tile / a->n_tiles_x;
  *x = (float)(tx * SV_TILE_PX);
  *y = (float)(ty * SV_TILE_PX);
  *offset = (long)ty * SV_TILE_PX * a->stride + tx * SV_TILE_PX;
}

// Blocks of which no pixel goes on.
static uint64_t find_ended(const float *trans) {
  uint64_t goes_on = 0;
  for (int i = 0; i < 1024; i++) goes_on |= (uint64_t)(trans[i] >= SV_T_MIN) << (i / 16);
  return ~goes_on;
}

void sv_raster_ref(const sv_raster_args *a, uint32_t tile, const uint32_t *list, uint32_t n, float *scratch) {
  float *trans = scratch, *acc[4], x0, y0;
  long at;
  for (int c = 0; c < 4; c++) acc[c] = scratch + (c + 1) * 1024;
  for (int i = 0; i < 1024; i++) trans[i] = 1.0f;
  for (int i = 0; i < 4 * 1024; i++) acc[0][i] = 0.0f;
  tile_origin(a, tile, &x0, &y0, &at);
  uint64_t saturated = 0;
  for (uint32_t i = 0; i < n; i++) {
    sv_intersection *r = a->intersection + list[i];
    const sv_splat *s = a->splat + r->id;
    if (i % SV_RASTER_GROUP == 0) saturated = find_ended(trans);
    uint64_t mask = r->mask & ~saturated;
    r->mask = mask;
    for (; mask; mask &= mask - 1) {
      int b = __builtin_ctzll(mask);
      for (int k = 0; k < 16; k++) {
        float *t = trans + 16 * b + k;
        pair_eval e = evaluate(s, x0, y0, b, k);
        if (!(e.power >= SV_POWER_MIN)) continue;
        float w = e.a * *t;
        for (int c = 0; c < 3; c++) acc[c][16 * b + k] = fmaf(w, s->rgb[c], acc[c][16 * b + k]);
        acc[3][16 * b + k] = fmaf(w, s->z, acc[3][16 * b + k]);
        *t = *t - w;
      }
    }
  }
  for (int i = 0; i < 1024; i++) {
    long o = at + pixel_offset(i / 16, i % 16, a->stride);
    float t = trans[i];
    for (int c = 0; c < 3; c++) a->rgb[c][o] = fmaf(t, a->bg[c], acc[c][i]);
    if (a->depth) {
      a->depth[o] = acc[3][i];
      a->trans[o] = t;
    }
  }
}

typedef struct {
  float *trans, *suffix, *g[3], *g_depth, *err; // [64][16]
  float x0, y0;                                 // the tile's corner
} tile_state;

static void load_state(const sv_raster_bwd_args *a, long at, tile_state *st) {
  const sv_raster_args *f = a->fwd;
  for (int i = 0; i < 1024; i++) {
    long o = at + pixel_offset(i / 16, i % 16, f->stride);
    float s = 0.0f;
    for (int c = 0; c < 3; c++) {
      st->g[c][i] = a->g_rgb[c][o];
      s = fmaf(f->rgb[c][o], st->g[c][i], s);
    }
    st->g_depth[i] = a->g_depth ? a->g_depth[o] : 0.0f;
    if (a->g_depth) s = fmaf(f->depth[o], st->g_depth[i], s);
    if (a->g_trans) s = fmaf(f->trans[o], a->g_trans[o], s);
    st->err[i] = a->err ? a->err[o] : 0.0f;
    st->suffix[i] = s;
    st->trans[i] = 1.0f;
  }
}

// One block of a splat: sums per lane into row and m[SLOT][16].
static void block_bwd(const sv_splat *s, int b, const tile_state *st, int is_small, float row[2][16],
                      float m[11][16]) {
  const int is_free = s->lo <= SV_POWER_FREE;
  for (int k = 0; k < 16; k++) {
    int i = 16 * b + k;
    pair_eval e = evaluate(s, st->x0, st->y0, b, k);
    float t = st->trans[i];
    if (is_free) e.a = e.a_raw;
    if (!(e.power >= SV_POWER_MIN && t >= SV_T_MIN)) continue;
    float w = e.a * t;
    for (int c = 0; c < 3; c++) m[SV_IGRAD_RGB + c][k] = fmaf(w, st->g[c][i], m[SV_IGRAD_RGB + c][k]);
    m[SV_IGRAD_Z][k] = fmaf(w, st->g_depth[i], m[SV_IGRAD_Z][k]);
    m[SV_IGRAD_ERR][k] = fmaf(w, st->err[i], m[SV_IGRAD_ERR][k]);
    float dot = fmaf(s->rgb[2], st->g[2][i], fmaf(s->rgb[1], st->g[1][i], s->rgb[0] * st->g[0][i]));
    dot = fmaf(s->z, st->g_depth[i], dot);
    float suffix = fmaf(-w, dot, st->suffix[i]);
    float g = fmaf(-suffix, 1.0f / (1.0f - e.a), st->suffix[i]);
    if (!is_free && !(e.a_raw <= SV_ALPHA_MAX)) g = 0.0f;
    st->suffix[i] = suffix;
    st->trans[i] = t - w;
    m[SV_IGRAD_GXX][k] = fmaf(g, e.dx * e.dx, m[SV_IGRAD_GXX][k]);
    if (is_small) {
      float gy = g * e.dy;
      m[SV_IGRAD_G][k] += g;
      m[SV_IGRAD_GX][k] = fmaf(g, e.dx, m[SV_IGRAD_GX][k]);
      m[SV_IGRAD_GY][k] += gy;
      m[SV_IGRAD_GXY][k] = fmaf(gy, e.dx, m[SV_IGRAD_GXY][k]);
      m[SV_IGRAD_GYY][k] = fmaf(gy, e.dy, m[SV_IGRAD_GYY][k]);
    } else {
      row[0][k] += g;
      row[1][k] = fmaf(g, e.dx, row[1][k]);
    }
  }
}

static void splat_bwd(const sv_splat *s, uint64_t mask, const tile_state *st, uint8_t *igrad) {
  const int is_small = __builtin_popcountll(mask) <= SV_RASTER_SMALL;
  float m[11][16] = {{0}};
  for (int by = 0; by < 8; by++) {
    float row[2][16] = {{0}};
    uint64_t bits = mask >> (8 * by) & 255;
    if (!bits) continue;
    for (; bits; bits &= bits - 1) block_bwd(s, 8 * by + __builtin_ctzll(bits), st, is_small, row, m);
    for (int k = 0; k < 16 && !is_small; k++) { // within a lane's row dy is constant
      float dy = s->v_px - (st->y0 + ((float)(4 * by + (k >> 2)) + 0.5f));
      m[SV_IGRAD_G][k] += row[0][k];
      m[SV_IGRAD_GX][k] += row[1][k];
      m[SV_IGRAD_GY][k] = fmaf(row[0][k], dy, m[SV_IGRAD_GY][k]);
      m[SV_IGRAD_GXY][k] = fmaf(row[1][k], dy, m[SV_IGRAD_GXY][k]);
      m[SV_IGRAD_GYY][k] = fmaf(row[0][k] * dy, dy, m[SV_IGRAD_GYY][k]);
    }
  }
  float sum[SV_IGRAD_VALUES];
  for (int i = 0; i < SV_IGRAD_VALUES; i++) sum[i] = s1_sum16(m[i]);
  s1_store11(igrad, sum);
}

void sv_raster_bwd_ref(const sv_raster_bwd_args *a, uint32_t tile, const uint32_t *list, uint32_t n,
                       float *scratch) {
  tile_state st = {scratch,
                   scratch + 1024,
                   {scratch + 2048, scratch + 3072, scratch + 4096},
                   scratch + 5120,
                   scratch + 6144,
                   0,
                   0};
  long at;
  tile_origin(a->fwd, tile, &st.x0, &st.y0, &at);
  load_state(a, at, &st);
  for (uint32_t i = 0; i < n; i++) {
    const sv_intersection *r = a->fwd->intersection + list[i];
    const sv_splat *s = a->fwd->splat + r->id;
    if (r->mask) splat_bwd(s, r->mask, &st, a->igrad + (long)list[i] * SV_IGRAD_BYTES);
  }
}
