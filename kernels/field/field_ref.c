// SPDX-License-Identifier: Apache-2.0
#include "kernels/field/field_tap.h"
#include "kernels/simd/s1_math.h"
#include "kernels/ops.h"

static float blend(const float *plane, const field_taps *t, const float w[4], int ch) {
  float s = w[0] * plane[t->at[0] + ch];
  for (int k = 1; k < 4; k++) s = fmaf(w[k], plane[t->at[k] + ch], s);
  return s;
}

void sv_planes_ref(const sv_planes_args *a, const float *c, float *feature) {
  const int n_f = 16 * a->n_vec;
  for (int l = 0; l < a->n_levels; l++)
    for (int k = 0; k < 16; k++) {
      field_taps t[SV_FIELD_PLANES];
      for (int p = 0; p < SV_FIELD_PLANES; p++) t[p] = field_taps_at(a, l, p, c, k);
      for (int ch = 0; ch < n_f; ch++) {
        float f = blend(a->plane[l][0], &t[0], t[0].w, ch);
        for (int p = 1; p < SV_FIELD_PLANES; p++) f *= blend(a->plane[l][p], &t[p], t[p].w, ch);
        feature[16 * (l * n_f + ch) + k] = f;
      }
    }
}

// Products of all but one of six: from the left times from the right.
static void products(const float s[SV_FIELD_PLANES], float rest[SV_FIELD_PLANES]) {
  float left = 1.0f, right = 1.0f;
  for (int p = 0; p < SV_FIELD_PLANES; p++) {
    rest[p] = left;
    left *= s[p];
  }
  for (int p = SV_FIELD_PLANES - 1; p >= 0; p--) {
    rest[p] *= right;
    right *= s[p];
  }
}

void sv_planes_bwd_ref(const sv_planes_args *a, const float *c, const float *d_feature, float *part,
                       float *dc) {
  const int n_f = 16 * a->n_vec;
  for (int k = 0; k < 16; k++) {
    float sum[3] = {0};
    for (int l = 0; l < a->n_levels; l++) {
      float slope[SV_FIELD_PLANES][2][16]; // per channel of a vector, folded by the one tree
      field_taps t[SV_FIELD_PLANES];
      memset(slope, 0, sizeof slope);
      for (int p = 0; p < SV_FIELD_PLANES; p++) t[p] = field_taps_at(a, l, p, c, k);
      for (int ch = 0; ch < n_f; ch++) {
        float s[SV_FIELD_PLANES], rest[SV_FIELD_PLANES], g = d_feature[16 * (l * n_f + ch) + k];
        for (int p = 0; p < SV_FIELD_PLANES; p++) s[p] = blend(a->plane[l][p], &t[p], t[p].w, ch);
        products(s, rest);
        for (int p = 0; p < SV_FIELD_PLANES; p++) {
          float d = g * rest[p];
          part[((k * a->n_levels + l) * SV_FIELD_PLANES + p) * n_f + ch] = d;
          slope[p][0][ch & 15] = fmaf(d, blend(a->plane[l][p], &t[p], t[p].d0, ch), slope[p][0][ch & 15]);
          slope[p][1][ch & 15] = fmaf(d, blend(a->plane[l][p], &t[p], t[p].d1, ch), slope[p][1][ch & 15]);
        }
      }
      for (int p = 0; p < SV_FIELD_PLANES; p++)
        for (int i = 0; i < 2; i++)
          if (field_axis[p][i] < 3) sum[field_axis[p][i]] += s1_sum16(slope[p][i]);
    }
    for (int i = 0; i < 3; i++) dc[16 * i + k] = sum[i];
  }
}

void sv_planes_add_ref(const sv_planes_args *a, int level, int plane, const sv_planes_block *block,
                       float *grad) {
  const int n_f = 16 * a->n_vec;
  for (int k = 0; k < 16; k++) {
    if (!(block->touched >> k & 1)) continue;
    field_taps t = field_taps_at(a, level, plane, block->c, k);
    const float *d = block->part + ((k * a->n_levels + level) * SV_FIELD_PLANES + plane) * n_f;
    for (int i = 0; i < 4; i++)
      for (int ch = 0; ch < n_f; ch++) grad[t.at[i] + ch] = fmaf(t.w[i], d[ch], grad[t.at[i] + ch]);
  }
}

void sv_linear_ref(const sv_linear_args *a, const float *x, float *y) {
  for (int o = 0; o < a->n_out; o++)
    for (int k = 0; k < 16; k++) {
      float s = a->b[o];
      for (int i = 0; i < a->n_in; i++) {
        float v = x[16 * i + k];
        s = fmaf(a->w[o * a->n_in + i], a->is_relu ? s1_max(v, 0.0f) : v, s);
      }
      y[16 * o + k] = s;
    }
}

void sv_linear_bwd_ref(const sv_linear_args *a, const float *x, const float *dy, float *dx, float *dw,
                       float *db) {
  float lanes[16];
  for (int i = 0; i < a->n_in; i++)
    for (int k = 0; k < 16; k++) {
      float s = 0;
      for (int o = 0; o < a->n_out; o++) s = fmaf(a->w[o * a->n_in + i], dy[16 * o + k], s);
      dx[16 * i + k] = !a->is_relu || x[16 * i + k] > 0.0f ? s : 0.0f;
    }
  for (int o = 0; o < a->n_out; o++) {
    memcpy(lanes, dy + 16 * o, sizeof lanes);
    db[o] += s1_sum16(lanes);
    for (int i = 0; i < a->n_in; i++) {
      float s = dw[o * a->n_in + i];
      for (int k = 0; k < 16; k++) {
        float v = x[16 * i + k];
        s = fmaf(dy[16 * o + k], a->is_relu ? s1_max(v, 0.0f) : v, s);
      }
      dw[o * a->n_in + i] = s;
    }
  }
}
