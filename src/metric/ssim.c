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

// From the means, the sum of the variances and the covariance.
static double ssim_of(double m1, double m2, double s, double s12) {
  return (2 * m1 * m2 + C1) * (2 * s12 + C2) / ((m1 * m1 + m2 * m2 + C1) * (s + C2));
}

// --- blurred with zeros outside ------------------------------------------------------------------

#define N_SUMS 4 // blurred: a, b, a a + b b, a b

// The images of a channel, and where they are compared; NULL: everywhere.
typedef struct {
  const float *a, *b;
  const uint8_t *mask;
  int w, h;
  double *ring;    // [TAPS][N_SUMS][w] of the rows around that one, by row modulo TAPS
  double *blurred; // [N_SUMS][w]
} channel;

static channel channel_of(const sv_image_pair *im, int c, const uint8_t *mask, double *scratch) {
  const size_t plane = (size_t)c * (size_t)im->width * (size_t)im->height;
  return (channel){im->a + plane,
                   im->b + plane,
                   mask,
                   im->width,
                   im->height,
                   scratch,
                   scratch + (size_t)TAPS * N_SUMS * (size_t)im->width};
}

static double *ring_row(const channel *c, int y) {
  return c->ring + (size_t)((y + TAPS) % TAPS) * N_SUMS * (size_t)c->w;
}

static void load_row(const channel *c, int y) {
  const size_t w = (size_t)c->w;
  double *restrict r = ring_row(c, y);
  if (y < 0 || y >= c->h) {
    memset(r, 0, sizeof *r * N_SUMS * w);
    return;
  }
  const float *restrict a = c->a + (size_t)y * w, *restrict b = c->b + (size_t)y * w;
  const uint8_t *mask = c->mask ? c->mask + (size_t)y * w : NULL;
  for (size_t x = 0; x < w; x++) {
    r[x] = (double)a[x];
    r[w + x] = mask && !mask[x] ? (double)a[x] : (double)b[x];
  }
  for (size_t x = 0; x < w; x++) {
    r[2 * w + x] = r[x] * r[x] + r[w + x] * r[w + x];
    r[3 * w + x] = r[x] * r[w + x];
  }
}

// n sums over TAPS values each, p[HALF] of those at the same place. Both sides have the same
// weights.
static void blur(const double *const p[TAPS], size_t n, double *restrict out) {
  for (size_t x = 0; x < n; x++) {
    double sum = window[HALF] * p[HALF][x];
    for (int t = 0; t < HALF; t++) sum += window[t] * (p[t][x] + p[TAPS - 1 - t][x]);
    out[x] = sum;
  }
}

static void blur_columns(const channel *c, int y) {
  const double *row[TAPS];
  for (int t = 0; t < TAPS; t++) row[t] = ring_row(c, y + t - HALF);
  blur(row, N_SUMS * (size_t)c->w, c->blurred);
}

// Of one place, where the window may reach beyond the row.
static double blurred_at(const double *row, int w, int x) {
  double sum = 0;
  for (int t = 0; t < TAPS; t++)
    if (x + t >= HALF && x + t - HALF < w) sum += window[t] * row[x + t - HALF];
  return sum;
}

// Along the row, in place of its first sums.
static void blur_row(const channel *c, double *restrict out) {
  const int w = c->w;
  for (int k = 0; k < N_SUMS; k++, out += w) {
    const double *row = c->blurred + (size_t)k * (size_t)w, *p[TAPS];
    for (int t = 0; t < TAPS; t++) p[t] = row + t;
    if (w > 2 * HALF) blur(p, (size_t)(w - 2 * HALF), out + HALF);
    for (int x = 0; x < w; x++)
      if (x < HALF || x >= w - HALF) out[x] = blurred_at(row, w, x);
  }
}

// SSIM of the row's pixels from x0 to x1 - 1 that count.
static double sum_row(const channel *c, int y, int x0, int x1) {
  const size_t w = (size_t)c->w;
  double *m = ring_row(c, y - HALF), sum = 0; // the oldest row is no longer needed
  blur_row(c, m);
  for (int x = x0; x < x1; x++) {
    const double m1 = m[x], m2 = m[w + (size_t)x], square = m[2 * w + (size_t)x],
                 cross = m[3 * w + (size_t)x];
    if (c->mask && !c->mask[(size_t)y * w + (size_t)x]) continue;
    sum += ssim_of(m1, m2, square - m1 * m1 - m2 * m2, cross - m1 * m2);
  }
  return sum;
}

static double channel_sum(const channel *c, int edge) {
  double sum = 0;
  for (int y = edge - HALF; y < edge + HALF; y++) load_row(c, y);
  for (int y = edge; y < c->h - edge; y++) {
    load_row(c, y + HALF);
    blur_columns(c, y);
    sum += sum_row(c, y, edge, c->w - edge);
  }
  return sum;
}

sv_status sv_ssim(const sv_image_pair *im, sv_ssim_padding padding, double *scratch, double *out) {
  int w = im->width, h = im->height, edge = padding == SV_SSIM_VALID ? HALF : 0;
  if (w <= 2 * edge || h <= 2 * edge || im->n_channels < 1) return SV_E_RANGE;
  double sum = 0;
  for (int c = 0; c < im->n_channels; c++) {
    const channel one = channel_of(im, c, NULL, scratch);
    sum += channel_sum(&one, edge);
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
  for (int c = 0; c < im->n_channels; c++) {
    const channel one = channel_of(im, c, mask, scratch);
    sum += channel_sum(&one, 0);
  }
  *out = n_counted ? sum / ((double)im->n_channels * (double)n_counted) : 1;
  return SV_OK;
}

// --- blurred over a mask -------------------------------------------------------------------------

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
    sum += ssim_of(m[0], m[1], s1 + s2, s12);
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
