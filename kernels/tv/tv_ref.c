// SPDX-License-Identifier: Apache-2.0
#include <math.h>
#include <stddef.h>

#include "kernels/simd/s1_math.h"
#include "kernels/tv/tv.h"
#include "kernels/ops.h"

static float slope(sv_tv_form form, float d) {
  return form == SV_TV_SQUARED ? d : (d > 0.0f ? 1.0f : 0.0f) - (d < 0.0f ? 1.0f : 0.0f);
}
static float add_phi(sv_tv_form form, float d, float sum) {
  return form == SV_TV_SQUARED ? fmaf(d, d, sum) : sum + fabsf(d);
}

void sv_tv_ref(const sv_tv_args *a) {
  const int w = a->width_px, h = a->height_px;
  const float k = a->form == SV_TV_SQUARED ? 2.0f : 1.0f, gv = k * a->w_v, gh = k * a->w_h;
  for (int r = a->row0; r < a->row1; r++) {
    const float *x = a->x + (size_t)r * (size_t)a->stride;
    const float *up = r > 0 ? x - a->stride : x, *down = r + 1 < h ? x + a->stride : x;
    float *grad = a->grad ? a->grad + (size_t)r * (size_t)a->stride : NULL;
    float lv[16] = {0}, lh[16] = {0};
    for (int i = 0; i < w; i++) {
      // the borders repeat, so a difference over the border is 0
      float left = x[i > 0 ? i - 1 : 0], right = x[i + 1 < w ? i + 1 : i];
      float d0 = x[i] - left, d1 = right - x[i], e0 = x[i] - up[i], e1 = down[i] - x[i];
      lh[i & 15] = add_phi(a->form, d1, lh[i & 15]);
      lv[i & 15] = add_phi(a->form, e1, lv[i & 15]);
      if (!grad) continue;
      float sh = slope(a->form, d0) - slope(a->form, d1), sv = slope(a->form, e0) - slope(a->form, e1);
      grad[i] = fmaf(gh, sh, fmaf(gv, sv, grad[i]));
    }
    a->row_v[r] = s1_sum16(lv);
    a->row_h[r] = s1_sum16(lh);
  }
}
