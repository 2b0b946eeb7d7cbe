// SPDX-License-Identifier: Apache-2.0
#include <math.h>
#include <string.h>

#include "src/metric/metric.h"

#define TAPS   SV_SSIM_TAPS
#define HALF   (TAPS / 2)
#define C1     1e-4
#define C2     9e-4
#define N_MAPS 5 // blurred: a, b, a a, b b, a b

// exp(-d^2 / (2 1.5^2)), divided by their sum
static const double window[TAPS] = {0.0010283800844791092, 0.007598758135239185, 0.03600077212843083,
                                    0.10936068950970002,   0.2130055377112537,   0.26601172486179436,
                                    0.2130055377112537,    0.10936068950970002,  0.03600077212843083,
                                    0.007598758135239185,  0.0010283800844791092};

size_t sv_ssim_scratch_doubles(int width) {
  return width > 0 ? (size_t)TAPS * (N_MAPS + 1) * (size_t)width : 0;
}

static double ssim_of(double m1, double m2, double s1, double s2, double s12) {
  return (2 * m1 * m2 + C1) * (2 * s12 + C2) / ((m1 * m1 + m2 * m2 + C1) * (s1 + s2 + C2));
}

// The images of a channel, and where they are compared; NULL: everywhere.
typedef struct {
  const float *a, *b;
  const uint8_t *mask;
  int w, h;
} channel;

// The five maps of row y blurred down the columns; rows outside the image are zero.
static void blur_columns(const channel *c, int y, double *rows) {
  const int w = c->w, h = c->h;
  memset(rows, 0, sizeof(double) * N_MAPS * (size_t)w);
  double *r0 = rows, *r1 = rows + w, *r2 = r1 + w, *r3 = r2 + w, *r4 = r3 + w;
  for (int t = 0; t < TAPS; t++) {
    int yy = y + t - HALF;
    if (yy < 0 || yy >= h) continue;
    const float *pa = c->a + (size_t)yy * (size_t)w, *pb = c->b + (size_t)yy * (size_t)w;
    const uint8_t *mask = c->mask ? c->mask + (size_t)yy * (size_t)w : NULL;
    double g = window[t];
    for (int x = 0; x < w; x++) {
      double va = (double)pa[x], vb = mask && !mask[x] ? va : (double)pb[x];
      r0[x] += g * va;
      r1[x] += g * vb;
      r2[x] += g * (va * va);
      r3[x] += g * (vb * vb);
      r4[x] += g * (va * vb);
    }
  }
}

static double sum_row(const double *rows, const uint8_t *mask, int w, int x0, int x1) {
  double sum = 0;
  for (int x = x0; x < x1; x++) {
    double m[N_MAPS] = {0};
    if (mask && !mask[x]) continue;
    int t0 = x < HALF ? HALF - x : 0, t1 = x + HALF >= w ? w - 1 - x + HALF : TAPS - 1;
    for (int t = t0; t <= t1; t++) {
      const double *p = rows + x + t - HALF, g = window[t];
      for (int k = 0; k < N_MAPS; k++) m[k] += g * p[(size_t)k * (size_t)w];
    }
    sum += ssim_of(m[0], m[1], m[2] - m[0] * m[0], m[3] - m[1] * m[1], m[4] - m[0] * m[1]);
  }
  return sum;
}

sv_status sv_ssim(const sv_image_pair *im, sv_ssim_padding padding, double *scratch, double *out) {
  int w = im->width, h = im->height, edge = padding == SV_SSIM_VALID ? HALF : 0;
  if (w <= 2 * edge || h <= 2 * edge || im->n_channels < 1) return SV_E_RANGE;
  double sum = 0;
  for (int c = 0; c < im->n_channels; c++) {
    size_t plane = (size_t)c * (size_t)w * (size_t)h;
    for (int y = edge; y < h - edge; y++) {
      blur_columns(&(channel){im->a + plane, im->b + plane, NULL, w, h}, y, scratch);
      sum += sum_row(scratch, NULL, w, edge, w - edge);
    }
  }
  *out = sum / ((double)im->n_channels * (w - 2 * edge) * (h - 2 * edge));
  return SV_OK;
}

sv_status sv_ssim_counted(const sv_image_pair *im, const uint8_t *mask, double *scratch, double *out) {
  const int w = im->width, h = im->height;
  if (w < 1 || h < 1 || im->n_channels < 1) return SV_E_RANGE;
  const size_t n = (size_t)w * (size_t)h;
  size_t n_counted = 0;
  double sum = 0;
  for (size_t i = 0; i < n; i++) n_counted += mask[i] != 0;
  for (int c = 0; c < im->n_channels; c++)
    for (int y = 0; y < h; y++) {
      blur_columns(&(channel){im->a + (size_t)c * n, im->b + (size_t)c * n, mask, w, h}, y, scratch);
      sum += sum_row(scratch, mask + (size_t)y * (size_t)w, w, 0, w);
    }
  *out = n_counted ? sum / ((double)im->n_channels * (double)n_counted) : 1;
  return SV_OK;
}

// One input row blurred along x over its mask: five maps and the mask of positions that saw any
// pixel.
static void masked_row(const float *a, const float *b, const uint8_t *mask, int w, double *row) {
  int n = w - 2 * HALF;
  for (int x = 0; x < n; x++) {
    double m[N_MAPS] = {0}, count = 0;
    for (int t = 0; t < TAPS; t++) {
      if (!mask[x + t]) continue;
      double va = (double)a[x + t], vb = (double)b[x + t], g = window[t];
      m[0] += g * va;
      m[1] += g * vb;
      m[2] += g * (va * va);
      m[3] += g * (vb * vb);
      m[4] += g * (va * vb);
      count += 1;
    }
    double scale = count > 0 ? TAPS / count : 0;
    for (int k = 0; k < N_MAPS; k++) row[(size_t)k * (size_t)w + (size_t)x] = m[k] * scale;
    row[(size_t)N_MAPS * (size_t)w + (size_t)x] = count > 0;
  }
}

// The second blur, down the columns, over the masks of the rows; ring row i holds image row y0 + i.
static double masked_sum(const double *ring, int w, int y0) {
  size_t row_doubles = (size_t)(N_MAPS + 1) * (size_t)w;
  double sum = 0;
  for (int x = 0; x < w - 2 * HALF; x++) {
    double m[N_MAPS] = {0}, count = 0;
    for (int t = 0; t < TAPS; t++) {
      const double *p = ring + (size_t)((y0 + t) % TAPS) * row_doubles + x;
      if (p[(size_t)N_MAPS * (size_t)w] == 0) continue;
      for (int k = 0; k < N_MAPS; k++) m[k] += window[t] * p[(size_t)k * (size_t)w];
      count += 1;
    }
    double scale = count > 0 ? TAPS / count : 0;
    for (int k = 0; k < N_MAPS; k++) m[k] *= scale;
    double s1 = m[2] - m[0] * m[0], s2 = m[3] - m[1] * m[1], s12 = m[4] - m[0] * m[1];
    s1 = s1 > 0 ? s1 : 0;
    s2 = s2 > 0 ? s2 : 0;
    double max = sqrt(s1 * s2);
    s12 = s12 > max ? max : s12 < -max ? -max : s12;
    sum += ssim_of(m[0], m[1], s1, s2, s12);
  }
  return sum;
}

sv_status sv_ssim_masked(const sv_image_pair *im, const uint8_t *mask, double *scratch, double *out) {
  int w = im->width, h = im->height;
  if (w < TAPS || h < TAPS || im->n_channels < 1) return SV_E_RANGE;
  size_t row_doubles = (size_t)(N_MAPS + 1) * (size_t)w;
  double sum = 0;
  for (int c = 0; c < im->n_channels; c++) {
    size_t plane = (size_t)c * (size_t)w * (size_t)h;
    for (int y = 0; y < h; y++) {
      size_t at = (size_t)y * (size_t)w;
      masked_row(im->a + plane + at, im->b + plane + at, mask + at, w,
                 scratch + (size_t)(y % TAPS) * row_doubles);
      if (y >= TAPS - 1) sum += masked_sum(scratch, w, y - (TAPS - 1));
    }
  }
  *out = sum / ((double)im->n_channels * (w - TAPS + 1) * (h - TAPS + 1));
  return SV_OK;
}
