// SPDX-License-Identifier: Apache-2.0
// appearance over the vocabulary: sixteen pixels of a row at a time.
#include <stddef.h>

#include "kernels/appearance/appearance.h"
#include "kernels/simd/v16.h"

static inline v16m lanes_below(int n) { return v16m_from_bits(n >= 16 ? 0xffffu : (1u << n) - 1u); }

typedef struct {
  v16 m[9], b[3], k[3], dx0, inv_r2;
} constants;

static inline constants constants_of(const sv_appearance_args *a) {
  constants c;
  for (int i = 0; i < 9; i++) c.m[i] = v16_set1(a->m[i]);
  for (int i = 0; i < 3; i++) c.b[i] = v16_set1(a->b[i]);
  for (int i = 0; i < 3; i++) c.k[i] = v16_set1(a->k[i]);
  c.dx0 = v16_set1(0.5f - a->cx);
  c.inv_r2 = v16_set1(a->inv_r2);
  return c;
}

static inline v16 square_of(const constants *c, v16 dy2, int i) {
  const v16 dx = v16_add(v16_add(v16_iota(), v16_set1((float)i)), c->dx0);
  return v16_mul(v16_fma(dx, dx, dy2), c->inv_r2);
}

static inline v16 falloff(const constants *c, v16 r2) {
  return v16_fma(r2, v16_fma(r2, v16_fma(r2, c->k[2], c->k[1]), c->k[0]), v16_set1(1.0f));
}

static inline void affine(const constants *c, const v16 x[3], v16 y[3]) {
  for (int i = 0; i < 3; i++)
    y[i] =
        v16_fma(c->m[3 * i], x[0], v16_fma(c->m[3 * i + 1], x[1], v16_fma(c->m[3 * i + 2], x[2], c->b[i])));
}

static inline v16 dy2_of(const sv_appearance_args *a, int row) {
  const float dy = ((float)row + 0.5f) - a->cy;
  return v16_set1(dy * dy);
}

// NaN in the padding must not reach the sums: all is taken through the lanes of the image.
static inline void load(const sv_appearance_args *a, size_t at, v16m keep, v16 x[3]) {
  for (int k = 0; k < 3; k++) x[k] = v16_keep(keep, v16_load(a->x[k] + at));
}

void V(sv_appearance)(const sv_appearance_args *a) {
  const constants c = constants_of(a);
  for (int r = a->row0; r < a->row1; r++) {
    const size_t row = (size_t)r * (size_t)a->stride;
    const v16 dy2 = dy2_of(a, r);
    for (int i = 0; i < a->stride; i += 16) {
      const v16m keep = lanes_below(i < a->width_px ? a->width_px - i : 0);
      v16 x[3], y[3];
      load(a, row + (size_t)i, keep, x);
      const v16 f = falloff(&c, square_of(&c, dy2, i));
      affine(&c, x, y);
      for (int k = 0; k < 3; k++) v16_store(a->out[k] + row + i, v16_keep(keep, v16_mul(f, y[k])));
    }
  }
}

void V(sv_appearance_bwd)(const sv_appearance_args *a) {
  const constants c = constants_of(a);
  for (int r = a->row0; r < a->row1; r++) {
    const size_t row = (size_t)r * (size_t)a->stride;
    const v16 dy2 = dy2_of(a, r);
    v16 sum[SV_APPEARANCE_SUMS];
    for (int s = 0; s < SV_APPEARANCE_SUMS; s++) sum[s] = v16_zero();
    for (int i = 0; i < a->stride; i += 16) {
      const v16m keep = lanes_below(i < a->width_px ? a->width_px - i : 0);
      v16 x[3], y[3], g[3], h[3];
      load(a, row + (size_t)i, keep, x);
      const v16 r2 = square_of(&c, dy2, i), f = falloff(&c, r2);
      affine(&c, x, y);
      for (int k = 0; k < 3; k++) {
        g[k] = v16_keep(keep, v16_load(a->out[k] + row + i));
        h[k] = v16_mul(f, g[k]);
      }
      for (int k = 0; k < 3; k++) {
        for (int j = 0; j < 3; j++) sum[3 * k + j] = v16_fma(h[k], x[j], sum[3 * k + j]);
        sum[9 + k] = v16_add(sum[9 + k], h[k]);
      }
      v16 q = v16_fma(g[0], y[0], v16_fma(g[1], y[1], v16_mul(g[2], y[2])));
      for (int k = 0; k < 3; k++) {
        q = v16_mul(q, r2);
        sum[12 + k] = v16_add(sum[12 + k], q);
      }
      for (int k = 0; k < 3; k++)
        v16_store(
            a->out[k] + row + i,
            v16_keep(keep, v16_fma(c.m[k], h[0], v16_fma(c.m[3 + k], h[1], v16_mul(c.m[6 + k], h[2])))));
    }
    for (int s = 0; s < SV_APPEARANCE_SUMS; s++) a->row_sum[r * SV_APPEARANCE_SUMS + s] = v16_sum(sum[s]);
  }
}
