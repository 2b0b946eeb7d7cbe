// SPDX-License-Identifier: Apache-2.0
// The field on vectors: of channels for the planes, of Gaussians for the layers. field_ref.c is the
// specification.
#include "kernels/field/field_tap.h"
#include "kernels/simd/v16.h"

static inline v16 blend(const float *plane, const field_taps *t, const float w[4]) {
  v16 s = v16_mul(v16_set1(w[0]), v16_load(plane + t->at[0]));
  for (int k = 1; k < 4; k++) s = v16_fma(v16_set1(w[k]), v16_load(plane + t->at[k]), s);
  return s;
}

void V(sv_planes)(const sv_planes_args *a, const float *c, float *feature) {
  const int n_f = 16 * a->n_vec;
  v16 f[SV_FIELD_CAP_VEC][16];
  for (int l = 0; l < a->n_levels; l++) {
    for (int k = 0; k < 16; k++)
      for (int p = 0; p < SV_FIELD_PLANES; p++) {
        field_taps t = field_taps_at(a, l, p, c, k);
        for (int v = 0; v < a->n_vec; v++) {
          v16 s = blend(a->plane[l][p] + 16 * v, &t, t.w);
          f[v][k] = p ? v16_mul(f[v][k], s) : s;
        }
      }
    for (int v = 0; v < a->n_vec; v++) {
      v16_transpose(f[v]);
      for (int ch = 0; ch < 16; ch++) v16_store(feature + 16 * (l * n_f + 16 * v + ch), f[v][ch]);
    }
  }
}

static inline void products(const v16 s[SV_FIELD_PLANES], v16 rest[SV_FIELD_PLANES]) {
  v16 left = v16_set1(1.0f), right = left;
  for (int p = 0; p < SV_FIELD_PLANES; p++) {
    rest[p] = left;
    left = v16_mul(left, s[p]);
  }
  for (int p = SV_FIELD_PLANES - 1; p >= 0; p--) {
    rest[p] = v16_mul(rest[p], right);
    right = v16_mul(right, s[p]);
  }
}

// One Gaussian at one level.
typedef struct {
  const float *c;
  const v16 *g; // gradient of its channels
  float *part;
  float *sum; // [3] dc of x y z
} one_gaussian;

// Not inlined: the vectors of both would fill more stack than a function may.
static __attribute__((noinline)) void one_bwd(const sv_planes_args *a, int l, int k, const one_gaussian *of) {
  const float *c = of->c;
  const v16 *g = of->g;
  float *part = of->part, *sum = of->sum;
  field_taps t[SV_FIELD_PLANES];
  v16 slope[SV_FIELD_PLANES][2];
  for (int p = 0; p < SV_FIELD_PLANES; p++) {
    t[p] = field_taps_at(a, l, p, c, k);
    slope[p][0] = slope[p][1] = v16_zero();
  }
  for (int v = 0; v < a->n_vec; v++) {
    v16 s[SV_FIELD_PLANES], rest[SV_FIELD_PLANES];
    for (int p = 0; p < SV_FIELD_PLANES; p++) s[p] = blend(a->plane[l][p] + 16 * v, &t[p], t[p].w);
    products(s, rest);
    for (int p = 0; p < SV_FIELD_PLANES; p++) {
      v16 d = v16_mul(g[v], rest[p]);
      v16_store(part + ((k * a->n_levels + l) * SV_FIELD_PLANES + p) * 16 * a->n_vec + 16 * v, d);
      slope[p][0] = v16_fma(d, blend(a->plane[l][p] + 16 * v, &t[p], t[p].d0), slope[p][0]);
      slope[p][1] = v16_fma(d, blend(a->plane[l][p] + 16 * v, &t[p], t[p].d1), slope[p][1]);
    }
  }
  for (int p = 0; p < SV_FIELD_PLANES; p++)
    for (int i = 0; i < 2; i++)
      if (field_axis[p][i] < 3) sum[field_axis[p][i]] += v16_sum(slope[p][i]);
}

void V(sv_planes_bwd)(const sv_planes_args *a, const float *c, const float *d_feature, float *part,
                      float *dc) {
  const int n_f = 16 * a->n_vec;
  float sum[16][3] = {{0}};
  for (int l = 0; l < a->n_levels; l++) {
    v16 g[SV_FIELD_CAP_VEC][16], one[SV_FIELD_CAP_VEC];
    for (int v = 0; v < a->n_vec; v++) {
      for (int ch = 0; ch < 16; ch++) g[v][ch] = v16_load(d_feature + 16 * (l * n_f + 16 * v + ch));
      v16_transpose(g[v]);
    }
    for (int k = 0; k < 16; k++) {
      for (int v = 0; v < a->n_vec; v++) one[v] = g[v][k];
      one_bwd(a, l, k, &(one_gaussian){c, one, part, sum[k]});
    }
  }
  for (int k = 0; k < 16; k++)
    for (int i = 0; i < 3; i++) dc[16 * i + k] = sum[k][i];
}

void V(sv_planes_add)(const sv_planes_args *a, int level, int plane, const sv_planes_block *block,
                      float *grad) {
  const int n_f = 16 * a->n_vec;
  const float *c = block->c, *part = block->part;
  for (uint32_t touched = block->touched; touched; touched &= touched - 1) {
    int k = __builtin_ctz(touched);
    field_taps t = field_taps_at(a, level, plane, c, k);
    const float *d = part + ((k * a->n_levels + level) * SV_FIELD_PLANES + plane) * n_f;
    for (int i = 0; i < 4; i++)
      for (int v = 0; v < n_f; v += 16) {
        float *to = grad + t.at[i] + v;
        v16_store(to, v16_fma(v16_set1(t.w[i]), v16_load(d + v), v16_load(to)));
      }
  }
}

static inline v16 input(const sv_linear_args *a, const float *x, int i) {
  v16 v = v16_load(x + 16 * i);
  return a->is_relu ? v16_max(v, v16_zero()) : v;
}

// Four outputs at a time share each input.
static inline void linear4(const sv_linear_args *a, const float *x, int o, float *y) {
  v16 s[4];
  const float *w = a->w + (long)o * a->n_in;
  for (int j = 0; j < 4; j++) s[j] = v16_set1(a->b[o + j]);
  for (int i = 0; i < a->n_in; i++) {
    v16 v = input(a, x, i);
    for (int j = 0; j < 4; j++) s[j] = v16_fma(v16_set1(w[(long)j * a->n_in + i]), v, s[j]);
  }
  for (int j = 0; j < 4; j++) v16_store(y + 16 * (o + j), s[j]);
}

void V(sv_linear)(const sv_linear_args *a, const float *x, float *y) {
  int o = 0;
  for (; o + 4 <= a->n_out; o += 4) linear4(a, x, o, y);
  for (; o < a->n_out; o++) {
    v16 s = v16_set1(a->b[o]);
    for (int i = 0; i < a->n_in; i++) s = v16_fma(v16_set1(a->w[(long)o * a->n_in + i]), input(a, x, i), s);
    v16_store(y + 16 * o, s);
  }
}

// Adds dy x^T to n rows of dw at 16 columns, Gaussian by Gaussian; xt: the inputs of each Gaussian.
// Four rows at a time hide the chain of sums.
static inline void outer(const v16 xt[16], const float *dy, int n, float *dw, long stride) {
  v16 s[4];
  for (int j = 0; j < n; j++) s[j] = v16_load(dw + j * stride);
  for (int k = 0; k < 16; k++)
    for (int j = 0; j < n; j++) s[j] = v16_fma(v16_set1(dy[16 * j + k]), xt[k], s[j]);
  for (int j = 0; j < n; j++) v16_store(dw + j * stride, s[j]);
}

void V(sv_linear_bwd)(const sv_linear_args *a, const float *x, const float *dy, float *dx, float *dw,
                      float *db) {
  for (int i = 0; i < a->n_in; i += 4) {
    v16 s[4] = {v16_zero(), v16_zero(), v16_zero(), v16_zero()};
    for (int o = 0; o < a->n_out; o++) {
      v16 g = v16_load(dy + 16 * o);
      const float *w = a->w + (long)o * a->n_in + i;
      for (int j = 0; j < 4; j++) s[j] = v16_fma(v16_set1(w[j]), g, s[j]);
    }
    for (int j = 0; j < 4; j++) {
      if (a->is_relu) s[j] = v16_keep(v16_gt(v16_load(x + 16 * (i + j)), v16_zero()), s[j]);
      v16_store(dx + 16 * (i + j), s[j]);
    }
  }
  for (int o = 0; o < a->n_out; o++) db[o] += v16_sum(v16_load(dy + 16 * o));
  for (int i = 0; i < a->n_in; i += 16) {
    v16 xt[16];
    int o = 0;
    for (int k = 0; k < 16; k++) xt[k] = input(a, x, i + k);
    v16_transpose(xt);
    for (; o + 4 <= a->n_out; o += 4) outer(xt, dy + 16 * o, 4, dw + (long)o * a->n_in + i, a->n_in);
    for (; o < a->n_out; o++) outer(xt, dy + 16 * o, 1, dw + (long)o * a->n_in + i, a->n_in);
  }
}
