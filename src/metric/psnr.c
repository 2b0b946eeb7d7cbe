// SPDX-License-Identifier: Apache-2.0
#include <float.h>
#include <math.h>

#include "src/base/mathx.h"
#include "src/metric/metric.h"

double sv_psnr_of_mse(double mse) { return -10 / 2.30258509299404568402 * sv_log(mse > 1e-10 ? mse : 1e-10); }

double sv_psnr_masked(const sv_image_pair *im, const uint8_t *mask) {
  size_t n = (size_t)im->width * (size_t)im->height, n_used = 0;
  double sum = 0;
  for (int c = 0; c < im->n_channels; c++) {
    const float *a = im->a + (size_t)c * n, *b = im->b + (size_t)c * n;
    for (size_t i = 0; i < n; i++) {
      if (mask && !mask[i]) continue;
      double e = (double)a[i] - (double)b[i];
      sum += e * e;
      n_used++;
    }
  }
  return sv_psnr_of_mse(n_used ? sum / (double)n_used : 0);
}

double sv_psnr(const sv_image_pair *im) { return sv_psnr_masked(im, NULL); }

double sv_psnr_u8(const uint8_t *a, const uint8_t *b, size_t n) {
  uint64_t sum = 0; // exact: 2^16 n stays below 2^64
  for (size_t i = 0; i < n; i++) {
    int e = a[i] - b[i];
    sum += (uint64_t)(e * e);
  }
  return sv_psnr_of_mse(n ? (double)sum / (65025.0 * (double)n) : 0);
}

static int is_depth(float d) { return d > 0 && d <= FLT_MAX; }

sv_depth_error sv_depth_compare(const float *d, const float *d_true, const uint8_t *mask, size_t n) {
  double rel = 0, sq = 0;
  size_t n_true = 0, n_both = 0;
  for (size_t i = 0; i < n; i++) {
    if ((mask && !mask[i]) || !is_depth(d_true[i])) continue;
    n_true++;
    if (!is_depth(d[i])) continue;
    n_both++;
    double e = (double)d[i] - (double)d_true[i];
    rel += fabs(e) / (double)d_true[i];
    sq += e * e;
  }
  sv_depth_error r = {0, 0, 0, n_both};
  if (n_both) {
    r.abs_rel = rel / (double)n_both;
    r.rmse = sqrt(sq / (double)n_both);
  }
  if (n_true) r.coverage = (double)n_both / (double)n_true;
  return r;
}
