// SPDX-License-Identifier: Apache-2.0
// Metrics: PSNR, SSIM and depth errors between a rendering and its ground truth.
// Owns nothing: callers bring the images and the scratch. Sums are in double, row by row from the
// top. Never renders, trains or reads files, and holds no state: a result depends on its input
// alone.
#ifndef SV_METRIC_METRIC_H
#define SV_METRIC_METRIC_H

#include <stddef.h>
#include <stdint.h>

#include "src/base/status.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_SSIM_TAPS 11 // Gaussian, sigma 1.5 (Wang et al. 2004), C1 = 0.01^2, C2 = 0.03^2

typedef struct {
  const float *a, *b; // [n_channels][height][width], values in [0, 1]
  int width, height, n_channels;
} sv_image_pair;

// -10 log10(mse) in dB, for values in [0, 1]. The error counts as 1e-10 at least: identical images
// give 100.
double sv_psnr_of_mse(double mse);
double sv_psnr(const sv_image_pair *im);
// Values 0 to 255, any layout of n values.
double sv_psnr_u8(const uint8_t *a, const uint8_t *b, size_t n);
// Over the pixels with mask != 0 only ([height][width]); an empty mask gives 100.
double sv_psnr_masked(const sv_image_pair *im, const uint8_t *mask);

typedef enum {
  SV_SSIM_SAME = 0, // zero padding: every pixel counts, as in 3DGS trainers
  SV_SSIM_VALID     // whole windows only: a border of 5 pixels does not count
} sv_ssim_padding;

// Doubles of scratch for images of this width; enough for sv_ssim and sv_ssim_masked.
size_t sv_ssim_scratch_doubles(int width);
// Mean SSIM over channels and pixels. E_RANGE when the image is smaller than the window (VALID).
sv_status sv_ssim(const sv_image_pair *im, sv_ssim_padding padding, double *scratch, double *out) SV_MUST_USE;
// The same with zero padding over the pixels with mask != 0 only; where it is 0, b counts as equal
// to a. 1 for an empty mask.
sv_status sv_ssim_counted(const sv_image_pair *im, const uint8_t *mask, double *scratch,
                          double *out) SV_MUST_USE;
// DyCheck's masked SSIM (Gao et al. 2022): "valid", each 1-D blur a partial convolution over the
// mask, variances clamped at 0 and the covariance at their geometric mean, plain mean over all
// positions. Windows without a mask pixel count as 1, so it grows with the masked-out area (kept
// for comparability).
sv_status sv_ssim_masked(const sv_image_pair *im, const uint8_t *mask, double *scratch,
                         double *out) SV_MUST_USE;

typedef struct {
  double abs_rel;  // mean |d - d*| / d*
  double rmse;     // sqrt(mean (d - d*)^2), scene units
  double coverage; // share of the pixels with true depth where the rendering has depth, too
  size_t n;        // pixels that the means are over
} sv_depth_error;

// d: rendered, d_true: [n], scene units; 0, negative and non-finite values mean "no depth". mask
// [n] may be NULL. The means are over pixels with both depths; all zero when there are none.
sv_depth_error sv_depth_compare(const float *d, const float *d_true, const uint8_t *mask, size_t n);

#ifdef __cplusplus
}
#endif
#endif
