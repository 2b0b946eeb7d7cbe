// SPDX-License-Identifier: Apache-2.0
#include <math.h>
#include <stddef.h>
#include <string.h>

#include "kernels/simd/s1_math.h"
#include "kernels/ssim/ssim.h"
#include "kernels/ssim/ssim_const.h"
#include "kernels/ops.h"

static const float g[6] = {SSIM_G0, SSIM_G1, SSIM_G2, SSIM_G3, SSIM_G4, SSIM_G5};

// Rows of the scratch block: [zeros: 16][data: width up to a multiple of 16][zeros: 16].
static float *scratch_row(float *scratch, int stride, int i) {
  return scratch + (size_t)i * (size_t)(stride + 2 * SSIM_BORDER) + SSIM_BORDER;
}

// The eleven rows around r of a plane; rows outside the image are the zero row.
static void rows_around(const float *row[11], const float *plane, int r, int height, int stride,
                        const float *zero) {
  for (int k = -SSIM_R; k <= SSIM_R; k++) {
    int j = r + k;
    row[k + SSIM_R] = j >= 0 && j < height ? plane + (size_t)j * (size_t)stride : zero;
  }
}

// Vertical half of the blur at column i: x, y, x^2 + y^2 and x y.
static void blur_column(const float *const xr[11], const float *const yr[11], int i, float out[4]) {
  float x = xr[5][i], y = yr[5][i];
  float mx = x * g[0], my = y * g[0], e = fmaf(y, y, x * x) * g[0], p = (x * y) * g[0];
  for (int k = 1; k <= SSIM_R; k++) {
    float a = xr[5 - k][i], b = xr[5 + k][i], c = yr[5 - k][i], d = yr[5 + k][i];
    mx = fmaf(a + b, g[k], mx);
    my = fmaf(c + d, g[k], my);
    e = fmaf(fmaf(c, c, a * a) + fmaf(d, d, b * b), g[k], e);
    p = fmaf(a * c + b * d, g[k], p);
  }
  out[0] = mx;
  out[1] = my;
  out[2] = e;
  out[3] = p;
}

static float blur_row(const float *p) {
  float s = p[0] * g[0];
  for (int k = 1; k <= SSIM_R; k++) s = fmaf(p[-k] + p[k], g[k], s);
  return s;
}

typedef struct {
  float ssim, dm1, ds1, ds12;
} ssim_point;

static ssim_point point(float m1, float m2, float e, float p) {
  float mm = m1 * m2, q = fmaf(m1, m1, m2 * m2);
  float A = q + SSIM_C1, B = (e - q) + SSIM_C2;
  float C = fmaf(2.0f, mm, SSIM_C1), D = fmaf(2.0f, p - mm, SSIM_C2);
  float r = 1.0f / (A * B);
  float ssim = (C * D) * r;
  return (ssim_point){
      .ssim = ssim,
      .dm1 = fmaf(-(m1 * ssim), B - A, m2 * (D - C)) * r,
      .ds1 = -(ssim * (A * r)),
      .ds12 = C * r,
  };
}

void sv_ssim_ref(const sv_ssim_args *a) {
  const int w = a->width_px, w16 = (w + 15) & ~15;
  float *t[7], *zero = a->scratch + (size_t)7 * (size_t)(a->stride + 2 * SSIM_BORDER);
  memset(a->scratch, 0, sizeof(float) * 8 * (size_t)(a->stride + 2 * SSIM_BORDER));
  for (int m = 0; m < 7; m++) t[m] = scratch_row(a->scratch, a->stride, m);
  for (int r = a->row0; r < a->row1; r++) {
    const float *xr[11], *yr[11];
    float lanes[16] = {0};
    size_t at = (size_t)(r - a->map_row0) * (size_t)a->stride;
    rows_around(xr, a->x, 2 * r + a->phase, a->height_px, a->stride, zero);
    rows_around(yr, a->y, 2 * r + a->phase, a->height_px, a->stride, zero);
    for (int i = 0; i < w; i++) {
      float v[4];
      blur_column(xr, yr, i, v);
      for (int m = 0; m < 4; m++) t[m][i] = v[m];
    }
    for (int i = 0; i < w16; i++) {
      ssim_point s = {0};
      if (i < w) s = point(blur_row(t[0] + i), blur_row(t[1] + i), blur_row(t[2] + i), blur_row(t[3] + i));
      lanes[i & 15] += s.ssim;
      t[4][i] = s.dm1;
      t[5][i] = s.ds1;
      t[6][i] = s.ds12;
    }
    for (int i = 0; i < w && a->dm1; i++) {
      a->dm1[at + (size_t)i] = blur_row(t[4] + i);
      a->ds1[at + (size_t)i] = blur_row(t[5] + i);
      a->ds12[at + (size_t)i] = blur_row(t[6] + i);
    }
    a->row_ssim[r] = s1_sum16(lanes);
  }
}

// --- gradient ----------------------------------------
// A map about column i of the image's row r, blurred along the column: windows at even distances
// when one stands on the row, else those at odd ones.
static float blur_map(const sv_ssim_bwd_args *a, const float *map, int r, int i) {
  const int n = (a->height_px - a->phase + 1) / 2, is_off = (r - a->phase) & 1;
  float s = 0;
  for (int k = is_off; k <= SSIM_R; k += 2) {
    const int up = (r - k - a->phase) / 2,
              down = (r + k - a->phase) / 2; // up is not used where it was cut to 0
    const float above =
        r - k >= a->phase ? map[(size_t)(up - a->map_row0) * (size_t)a->stride + (size_t)i] : 0;
    const float below = down < n ? map[(size_t)(down - a->map_row0) * (size_t)a->stride + (size_t)i] : 0;
    if (k == 0) s = above * g[0];
    else if (k == 1) s = (above + below) * g[1];
    else s = fmaf(above + below, g[k], s);
  }
  return s;
}

static void bwd_row(const sv_ssim_bwd_args *a, int r) {
  const size_t at = (size_t)r * (size_t)a->stride;
  const float w2 = 2.0f * a->w_ssim;
  float lanes[16] = {0};
  for (int i = 0; i < a->width_px; i++) {
    float x = a->x[at + (size_t)i], y = a->y[at + (size_t)i], d = x - y, e = fabsf(d);
    float grad = (d > 0.0f ? a->w_l1 : 0.0f) - (d < 0.0f ? a->w_l1 : 0.0f);
    if (a->dm1 && a->grad) {
      float b0 = blur_map(a, a->dm1, r, i), b1 = blur_map(a, a->ds1, r, i), b2 = blur_map(a, a->ds12, r, i);
      grad = fmaf(w2, fmaf(y, b2, fmaf(x, b1, b0)), grad);
    }
    lanes[i & 15] += e;
    float *pg = a->grad ? a->grad + at + (size_t)i : NULL, *pe = a->err ? a->err + at + (size_t)i : NULL;
    if (pg) *pg = a->is_grad_add ? *pg + grad : grad;
    if (pe) *pe = a->is_err_add ? fmaf(e, a->err_scale, *pe) : e * a->err_scale;
  }
  for (int i = a->width_px; i < a->stride; i++) {
    if (a->grad && !a->is_grad_add) a->grad[at + (size_t)i] = 0.0f;
    if (a->err && !a->is_err_add) a->err[at + (size_t)i] = 0.0f;
  }
  a->row_l1[r] = s1_sum16(lanes);
}

void sv_ssim_bwd_ref(const sv_ssim_bwd_args *a) {
  for (int r = a->row0; r < a->row1; r++) bwd_row(a, r);
}
