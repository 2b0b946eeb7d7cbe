// SPDX-License-Identifier: Apache-2.0
// The curves and pack over the vocabulary.
#include <math.h>
#include <string.h>

#include "kernels/color/color.h"
#include "kernels/simd/v16.h"
#include "kernels/simd/px.h"

static inline v16 to_linear(v16 v, v16 *slope) {
  v16 u = v16_mul(v16_add(v, v16_set1(0.055f)), v16_set1(1.0f / 1.055f));
  u = v16_max(u, v16_set1(0.09f));
  v16 p = v16_exp2_fine(v16_mul(v16_log2(u), v16_set1(2.4f)));
  v16m is_curve = v16_gt(v, v16_set1(0.04045f));
  if (slope)
    *slope = v16_sel(is_curve, v16_mul(v16_div(p, u), v16_set1(2.4f / 1.055f)), v16_set1(1.0f / 12.92f));
  return v16_sel(is_curve, p, v16_mul(v, v16_set1(1.0f / 12.92f)));
}

static inline v16 to_srgb(v16 l, v16 *slope) {
  v16 u = v16_max(l, v16_set1(0.003f));
  v16 p = v16_exp2_fine(v16_mul(v16_log2(u), v16_set1(1.0f / 2.4f)));
  v16m is_curve = v16_gt(l, v16_set1(0.0031308f));
  if (slope) *slope = v16_sel(is_curve, v16_mul(v16_div(p, u), v16_set1(1.055f / 2.4f)), v16_set1(12.92f));
  return v16_sel(is_curve, v16_fma(p, v16_set1(1.055f), v16_set1(-0.055f)), v16_mul(l, v16_set1(12.92f)));
}

// Whole vectors in place, the rest through a small copy.
#define CURVE(name, one)                                                                                     \
  void V(name)(const sv_curve_args *a) {                                                                     \
    int i = 0;                                                                                               \
    v16 s;                                                                                                   \
    for (; i + 16 <= a->n; i += 16) {                                                                        \
      v16_store(a->dst + i, one(v16_load(a->src + i), a->slope ? &s : NULL));                                \
      if (a->slope) v16_store(a->slope + i, s);                                                              \
    }                                                                                                        \
    if (i == a->n) return;                                                                                   \
    float t[16] = {0}, ts[16];                                                                               \
    size_t bytes = sizeof(float) * (size_t)(a->n - i);                                                       \
    memcpy(t, a->src + i, bytes);                                                                            \
    v16_store(t, one(v16_load(t), &s));                                                                      \
    v16_store(ts, s);                                                                                        \
    memcpy(a->dst + i, t, bytes);                                                                            \
    if (a->slope) memcpy(a->slope + i, ts, bytes);                                                           \
  }
CURVE(sv_srgb_to_linear, to_linear)
CURVE(sv_linear_to_srgb, to_srgb)

typedef struct {
  v16 read, shot, dark, sum;
} noise;

static inline v16 noise_one(const noise *n, v16 x, v16 *slope) {
  const v16 sigma = v16_sqrt(v16_fma(n->shot, v16_max(x, v16_zero()), n->read));
  *slope = v16_div(v16_mul(v16_set1(0.5f), n->sum), sigma);
  return v16_mul(x, v16_div(n->sum, v16_add(sigma, n->dark)));
}

void V(sv_noise_curve)(const sv_noise_curve_args *a) {
  const float dark = sqrtf(a->read), sum = sqrtf(a->read + a->shot) + dark;
  const noise k = {v16_set1(a->read), v16_set1(a->shot), v16_set1(dark), v16_set1(sum)};
  v16 s;
  int i = 0;
  for (; i + 16 <= a->n; i += 16) {
    v16_store(a->dst + i, noise_one(&k, v16_load(a->src + i), &s));
    if (a->slope) v16_store(a->slope + i, s);
  }
  if (i == a->n) return;
  float t[16] = {0}, ts[16];
  const size_t bytes = sizeof(float) * (size_t)(a->n - i);
  memcpy(t, a->src + i, bytes);
  v16_store(t, noise_one(&k, v16_load(t), &s));
  v16_store(ts, s);
  memcpy(a->dst + i, t, bytes);
  if (a->slope) memcpy(a->slope + i, ts, bytes);
}

void V(sv_pack)(const sv_pack_args *a) {
  for (int y = a->row0; y < a->row1; y++) {
    uint8_t *dst = a->dst + (size_t)y * a->dst_stride_bytes, planes[48], tail[48];
    size_t at = (size_t)y * (size_t)a->stride;
    for (int x = 0; x < a->width_px; x += 16, dst += 48) {
      int n = a->width_px - x;
      for (int c = 0; c < 3; c++)
        v16_store_u8(planes + 16 * c, v16_mul(v16_load(a->src[c] + at + (size_t)x), v16_set1(255.0f)));
      px_join3(planes, n >= 16 ? dst : tail);
      if (n < 16) memcpy(dst, tail, (size_t)(3 * n));
    }
  }
}
