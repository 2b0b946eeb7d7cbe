// SPDX-License-Identifier: Apache-2.0
#include "kernels/ops.h"
#include "kernels/sweep/sweep.h"

static float clamp(float v, float high) {
  const float low = v > 0 ? v : 0;
  return low < high ? low : high;
}

void sv_sweep_warp_ref(const sv_sweep_warp_args *a) {
  const float right = (float)a->width_px, bottom = (float)a->height_px;
  for (int r = 0; r < SV_SWEEP_ROWS; r++) {
    const int i = r - SV_SWEEP_RADIUS;
    const float y = (float)(a->y0 + r) + 0.5f;
    float base[3];
    for (int k = 0; k < 3; k++) base[k] = a->h[3 * k + 1] * y + a->h[3 * k + 2] + a->e[k];
    for (int x = a->x0; x < a->x1; x++) {
      const float c = (float)x + 0.5f, z = a->h[6] * c + base[2], f = 1.0f / (z > 1e-6f ? z : 1e-6f);
      const float u = (a->h[0] * c + base[0]) * f, v = (a->h[3] * c + base[1]) * f;
      const int is_in = z > 1e-6f && u >= 0 && u <= right && v >= 0 && v <= bottom;
      a->warped[r * a->stride + x] = sv_sweep_bilinear(a->src, a->width_px, clamp(u - 0.5f, right - 1.001f),
                                                       clamp(v - 0.5f, bottom - 1.001f));
      if (i >= 0 && i < SV_SWEEP_BAND) a->is_in[i * a->stride + x] = is_in ? 1.0f : 0.0f;
    }
  }
}

static float correlation(const sv_sweep_match_args *a, int k, int at) {
  const int from = at - SV_SWEEP_RADIUS; // the first row of a band has rows above it
  float s[3];
  if (!(a->is_in[k][at] > 0)) return SV_SWEEP_NOT_SEEN;
  sv_sweep_sum_window(a->warped[k] + from, a->ref + from, a->stride, s);
  const float dev = s[1] - s[0] * s[0] * (1 / SV_SWEEP_WINDOW), cov = s[2] - s[0] * a->mean[at];
  const float floor = 0.5f * SV_SWEEP_MIN_DEV;
  return cov * (cov < 0 ? -cov : cov) * a->norm[at] / (dev > floor ? dev : floor);
}

void sv_sweep_match_ref(const sv_sweep_match_args *a) {
  const float plane = (float)a->i_plane;
  for (int i = 0; i < SV_SWEEP_BAND; i++)
    for (int x = a->x0; x < a->x1; x++) {
      const int at = i * a->stride + x;
      float first = SV_SWEEP_NOT_SEEN, second = SV_SWEEP_NOT_SEEN;
      for (int k = 0; k < a->n_sources; k++) {
        const float c = correlation(a, k, at), low = c < first ? c : first;
        second = second > low ? second : low;
        first = first > c ? first : c;
      }
      // where one of the pictures does not see a place, the other has to do
      const float c = second > SV_SWEEP_NOT_SEEN ? 0.5f * (first + second) : first - SV_SWEEP_ALONE;
      if (a->plane[at] == plane - 1) a->after[at] = c;
      if (c > a->best[at]) {
        a->best[at] = c;
        a->plane[at] = plane;
        a->before[at] = a->last[at];
      }
      a->last[at] = c;
    }
}
