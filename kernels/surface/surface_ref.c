// SPDX-License-Identifier: Apache-2.0
// The specification of `surface`: pixel after pixel inside each marked block. Pixel state is kept
// as [block][16], lane = 4 (y mod 4) + (x mod 4).
#include "kernels/surface/surface.h"

#include "kernels/simd/s1_math.h"
#include "kernels/ops.h"

#define N_PX (SV_TILE_PX * SV_TILE_PX)

typedef struct {
  float *trans, *weight, *sum, *depth; // [64][16]
} state;

static void add_pixel(const sv_surface_args *a, const sv_splat *s, const float p[2], int pass, state *st,
                      int i) {
  const float dx = s->u_px - p[0], dy = s->v_px - p[1];
  const float power = fmaf(fmaf(s->qc, dy, s->qb * dx), dy, fmaf(s->qa, dx * dx, s->lo));
  if (!(power >= SV_POWER_MIN)) return;
  const float t = st->trans[i], next = t - s1_min(SV_ALPHA_MAX, s1_exp2_up8(power)) * t;
  const float z = fmaf(-s->rgb[1], dy, fmaf(-s->rgb[0], dx, s->z));
  float w = s1_max(0.0f, s1_min(t, pass ? 1.0f : a->from) - s1_max(next, a->to));
  if (pass && !(fabsf(z - st->depth[i]) < a->near * st->depth[i])) w = 0.0f;
  st->weight[i] += w;
  st->sum[i] = fmaf(w, z, st->sum[i]);
  st->trans[i] = next;
}

static void run_pass(const sv_surface_args *a, const float corner[2], const uint32_t *list, uint32_t n,
                     int pass, state *st) {
  for (int i = 0; i < N_PX; i++) {
    st->trans[i] = 1.0f;
    st->weight[i] = st->sum[i] = 0.0f;
  }
  for (uint32_t i = 0; i < n; i++) {
    const sv_intersection *r = a->intersection + list[i];
    for (uint64_t mask = r->mask; mask; mask &= mask - 1) {
      const int b = __builtin_ctzll(mask);
      for (int k = 0; k < 16; k++) {
        const float p[2] = {corner[0] + (float)(4 * (b & 7) + (k & 3)) + 0.5f,
                            corner[1] + (float)(4 * (b >> 3) + (k >> 2)) + 0.5f};
        add_pixel(a, a->splat + r->id, p, pass, st, 16 * b + k);
      }
    }
  }
  for (int i = 0; i < N_PX; i++) {
    const float depth = st->sum[i] / st->weight[i];
    if (pass) st->depth[i] = st->weight[i] > 0.0f ? depth : st->depth[i];
    else st->depth[i] = st->trans[i] <= a->to ? depth : 0.0f;
  }
}

void sv_surface_ref(const sv_surface_args *a, uint32_t tile, const uint32_t *list, uint32_t n,
                    float *scratch) {
  const int x0 = SV_TILE_PX * ((int)tile % a->n_tiles_x), y0 = SV_TILE_PX * ((int)tile / a->n_tiles_x);
  state st = {scratch, scratch + N_PX, scratch + 2 * N_PX, scratch + 3 * N_PX};
  for (int pass = 0; pass < (a->near > 0.0f ? 2 : 1); pass++)
    run_pass(a, (const float[]){(float)x0, (float)y0}, list, n, pass, &st);
  for (int i = 0; i < N_PX; i++) {
    const int b = i / 16, x = x0 + 4 * (b & 7) + (i & 3), y = y0 + 4 * (b >> 3) + (i >> 2 & 3);
    a->depth[(long)y * a->stride + x] = st.depth[i];
  }
}
