// SPDX-License-Identifier: Apache-2.0
// sweep_warp and sweep_match over the vocabulary, sixteen columns at a time.
#include <string.h>

#include "kernels/simd/v16.h"
#include "kernels/sweep/sweep.h"

static inline v16 clamp(v16 v, float high) { return v16_min(v16_max(v, v16_zero()), v16_set1(high)); }

// The two pixels at each place, as floats.
static inline void load_pairs(const uint16_t *src, const int32_t at[16], v16 *left, v16 *right) {
  float bits[16];
  for (int i = 0; i < 16; i++) memcpy(&bits[i], src + at[i], 4);
  const v16i both = v16_bits(v16_load(bits));
  *left = v16i_to_f(v16i_and(both, v16i_set1(0xffff)));
  *right = v16i_to_f(v16i_shr8(v16i_shr8(both)));
}

static inline v16 bilinear(const sv_sweep_warp_args *a, v16 x, v16 y) {
  const v16i xi = v16_trunc_i(x), yi = v16_trunc_i(y);
  const v16 x0 = v16i_to_f(xi), y0 = v16i_to_f(yi), fx = v16_sub(x, x0), fy = v16_sub(y, y0);
  v16 p0, p1, q0, q1;
  int32_t at[16], row[16];
  v16i_store(at, xi);
  v16i_store(row, yi);
  for (int i = 0; i < 16; i++) at[i] += row[i] * a->width_px;
  load_pairs(a->src, at, &p0, &p1);
  load_pairs(a->src + a->width_px, at, &q0, &q1);
  const v16 p = v16_add(p0, v16_mul(fx, v16_sub(p1, p0))), q = v16_add(q0, v16_mul(fx, v16_sub(q1, q0)));
  const v16 v = v16_add(p, v16_mul(fy, v16_sub(q, p)));
  return v16_sub(v16_mul(v, v16_set1(1.0f / 256.0f)), v16_set1(128.0f));
}

void V(sv_sweep_warp)(const sv_sweep_warp_args *a) {
  const float right = (float)a->width_px, bottom = (float)a->height_px;
  const v16 zero = v16_zero(), half = v16_set1(0.5f), one = v16_set1(1.0f), near = v16_set1(1e-6f);
  for (int r = 0; r < SV_SWEEP_ROWS; r++) {
    const int i = r - SV_SWEEP_RADIUS;
    const float row = (float)(a->y0 + r) + 0.5f;
    v16 base[3];
    for (int k = 0; k < 3; k++) base[k] = v16_set1(a->h[3 * k + 1] * row + a->h[3 * k + 2] + a->e[k]);
    for (int x = a->x0; x < a->x1; x += 16) {
      const v16 c = v16_add(v16_add(v16_set1((float)x), v16_iota()), half);
      const v16 z = v16_add(v16_mul(v16_set1(a->h[6]), c), base[2]), f = v16_div(one, v16_max(z, near));
      const v16 u = v16_mul(v16_add(v16_mul(v16_set1(a->h[0]), c), base[0]), f),
                v = v16_mul(v16_add(v16_mul(v16_set1(a->h[3]), c), base[1]), f);
      v16_store(a->warped + r * a->stride + x, bilinear(a, clamp(v16_sub(u, half), right - 1.001f),
                                                        clamp(v16_sub(v, half), bottom - 1.001f)));
      if (i < 0 || i >= SV_SWEEP_BAND) continue;
      v16m is_in = v16m_and(v16_gt(z, near), v16_ge(u, zero));
      is_in = v16m_and(v16m_and(is_in, v16_le(u, v16_set1(right))), v16_ge(v, zero));
      is_in = v16m_and(is_in, v16_le(v, v16_set1(bottom)));
      v16_store(a->is_in + i * a->stride + x, v16_keep(is_in, one));
    }
  }
}

typedef struct {
  v16 p, pp, pq;
} sums;

// Of a row of windows' pixels.
static inline sums sum_row(const float *p, const float *q) {
  v16 v = v16_load(p);
  sums s = {v, v16_mul(v, v), v16_mul(v, v16_load(q))};
  for (int i = 1; i <= 2 * SV_SWEEP_RADIUS; i++) {
    v = v16_load(p + i);
    s.p = v16_add(s.p, v);
    s.pp = v16_add(s.pp, v16_mul(v, v));
    s.pq = v16_add(s.pq, v16_mul(v, v16_load(q + i)));
  }
  return s;
}

#define N_RING (2 * SV_SWEEP_RADIUS + 1)

typedef struct {
  float px[SV_SWEEP_BAND][16];
} column;

// Source k in a band's column of sixteen, into the two best sources' correlations.
static inline void correlate(const sv_sweep_match_args *a, int k, int x, column *first, column *second) {
  const int stride = a->stride;
  const float *p = a->warped[k] + x - SV_SWEEP_RADIUS, *q = a->ref + x - SV_SWEEP_RADIUS;
  float ring[3][N_RING][16]; // sums of the last rows
  for (int r = 0; r < SV_SWEEP_ROWS; r++) {
    const sums row = sum_row(p + r * stride, q + r * stride);
    v16_store(ring[0][r % N_RING], row.p);
    v16_store(ring[1][r % N_RING], row.pp);
    v16_store(ring[2][r % N_RING], row.pq);
    const int i = r - 2 * SV_SWEEP_RADIUS, at = i * stride + x;
    if (i < 0) continue;
    v16 s[3];
    for (int m = 0; m < 3; m++) {
      s[m] = v16_load(ring[m][i % N_RING]);
      for (int d = 1; d < N_RING; d++) s[m] = v16_add(s[m], v16_load(ring[m][(i + d) % N_RING]));
    }
    const v16 dev = v16_sub(s[1], v16_mul(v16_mul(s[0], s[0]), v16_set1(1 / SV_SWEEP_WINDOW)));
    const v16 cov = v16_sub(s[2], v16_mul(s[0], v16_load(a->mean + at)));
    v16 c = v16_div(v16_mul(v16_mul(cov, v16_abs(cov)), v16_load(a->norm + at)),
                    v16_max(dev, v16_set1(0.5f * SV_SWEEP_MIN_DEV)));
    c = v16_sel(v16_gt(v16_load(a->is_in[k] + at), v16_zero()), c, v16_set1(SV_SWEEP_NOT_SEEN));
    const v16 best = v16_load(first->px[i]);
    v16_store(second->px[i], v16_max(v16_load(second->px[i]), v16_min(c, best)));
    v16_store(first->px[i], v16_max(best, c));
  }
}

static inline void keep_best(const sv_sweep_match_args *a, int at, v16 first, v16 second) {
  const v16 here = v16_set1((float)a->i_plane), last = v16_load(a->last + at), best = v16_load(a->best + at),
            plane = v16_load(a->plane + at);
  const v16 c =
      v16_sel(v16_gt(second, v16_set1(SV_SWEEP_NOT_SEEN)), v16_mul(v16_set1(0.5f), v16_add(first, second)),
              v16_sub(first, v16_set1(SV_SWEEP_ALONE)));
  const v16m is_next = v16_ge(plane, v16_set1((float)(a->i_plane - 1))), is_better = v16_gt(c, best);
  v16_store(a->after + at, v16_sel(is_next, c, v16_load(a->after + at)));
  v16_store(a->best + at, v16_sel(is_better, c, best));
  v16_store(a->plane + at, v16_sel(is_better, here, plane));
  v16_store(a->before + at, v16_sel(is_better, last, v16_load(a->before + at)));
  v16_store(a->last + at, c);
}

void V(sv_sweep_match)(const sv_sweep_match_args *a) {
  for (int x = a->x0; x < a->x1; x += 16) {
    column first, second;
    for (int i = 0; i < SV_SWEEP_BAND; i++) {
      v16_store(first.px[i], v16_set1(SV_SWEEP_NOT_SEEN));
      v16_store(second.px[i], v16_set1(SV_SWEEP_NOT_SEEN));
    }
    for (int k = 0; k < a->n_sources; k++) correlate(a, k, x, &first, &second);
    for (int i = 0; i < SV_SWEEP_BAND; i++)
      keep_best(a, i * a->stride + x, v16_load(first.px[i]), v16_load(second.px[i]));
  }
}
