// SPDX-License-Identifier: Apache-2.0
// patch_sums and patch_compare over the vocabulary: nine vectors of 4x4 pixels.
#include <stddef.h>

#include "kernels/patch/patch.h"
#include "kernels/simd/v16.h"

static inline v16 mix(v16 f, v16 a, v16 b) { return v16_fma(f, v16_sub(b, a), a); }

static void sums_at(const sv_patch_sums_args *a, float at_x, float at_y, float out[5]) {
  float x = at_x - SV_PATCH_REACH, y = at_y - SV_PATCH_REACH;
  int ix = (int)x, iy = (int)y;
  const float *p = a->src + (size_t)iy * (size_t)a->stride + ix;
  const v16 fx = v16_set1(x - (float)ix), fy = v16_set1(y - (float)iy);
  v16 s0 = v16_zero(), s1 = v16_zero(), s2 = v16_zero(), s3 = v16_zero(), s4 = v16_zero();
  for (int b = 0; b < 9; b++) {
    const float *q = p + (ptrdiff_t)(b / 3 * 4) * a->stride + b % 3 * 4;
    v16 top = mix(fx, v16_load4x4(q, a->stride), v16_load4x4(q + 1, a->stride));
    q += a->stride;
    v16 low = mix(fx, v16_load4x4(q, a->stride), v16_load4x4(q + 1, a->stride));
    v16 v = mix(fy, top, low);
    s0 = v16_add(s0, v);
    s1 = v16_fma(v, v, s1);
    s2 = v16_fma(v, v16_load(a->patch->v[0] + 16 * b), s2);
    s3 = v16_fma(v, v16_load(a->patch->v[1] + 16 * b), s3);
    s4 = v16_fma(v, v16_load(a->patch->v[2] + 16 * b), s4);
  }
  out[0] = v16_sum(s0);
  out[1] = v16_sum(s1);
  out[2] = v16_sum(s2);
  out[3] = v16_sum(s3);
  out[4] = v16_sum(s4);
}

void V(sv_patch_sums)(const sv_patch_sums_args *a) {
  for (int n = 0; n < a->n; n++) sums_at(a, a->x[n], a->y[n], a->out[n]);
}

void V(sv_patch_compare)(sv_patch_compare_args *a) {
  static const float col[16] = {0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3};
  static const float row[16] = {0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3};
  v16 s[8];
  for (int c = 0; c < 8; c++) s[c] = v16_zero();
  for (int b = 0; b < 9; b++) {
    v16 v = v16_load(a->v + 16 * b);
    v16 x = v16_add(v16_load(col), v16_set1((float)(b % 3 * 4) - 5.5f));
    v16 y = v16_add(v16_load(row), v16_set1((float)(b / 3 * 4) - 5.5f));
    v16 vx = v16_mul(v, v16_load(a->patch->v[1] + 16 * b)),
        vy = v16_mul(v, v16_load(a->patch->v[2] + 16 * b));
    s[0] = v16_fma(v, v16_load(a->patch->v[0] + 16 * b), s[0]);
    s[1] = v16_fma(v, v, s[1]);
    s[2] = v16_add(s[2], vx);
    s[3] = v16_add(s[3], vy);
    s[4] = v16_fma(vx, x, s[4]);
    s[5] = v16_fma(vy, x, s[5]);
    s[6] = v16_fma(vx, y, s[6]);
    s[7] = v16_fma(vy, y, s[7]);
  }
  for (int c = 0; c < 8; c++) a->out[c] = v16_sum(s[c]);
}
