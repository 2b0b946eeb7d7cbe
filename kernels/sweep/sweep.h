// SPDX-License-Identifier: Apache-2.0
// Plane sweep (Collins 1996), one band of rows of a depth map on one plane of inverse depth: other
// pictures as the map's camera would see them if all surfaces lay on the plane (sweep_warp), and
// how well they match the map's own (sweep_match): zero-mean normalized cross-correlation over 5x5
// pixels, squared with its sign. No fused multiply-add, so all variants give the same bits, SSE4.1
// included.
#ifndef SV_KERNELS_SWEEP_H
#define SV_KERNELS_SWEEP_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define SV_SWEEP_RADIUS      2  // of the windows
#define SV_SWEEP_BAND        16 // rows of a band
#define SV_SWEEP_ROWS        (SV_SWEEP_BAND + 2 * SV_SWEEP_RADIUS)
#define SV_SWEEP_CAP_SOURCES 4 // pictures that a map is compared with
// Least sum of squared deviations of a window, levels of 255: less is noise
#define SV_SWEEP_MIN_DEV  100.0f
#define SV_SWEEP_NOT_SEEN (-2.0f) // a correlation where the other picture does not reach
#define SV_SWEEP_ALONE    0.05f   // less for a place that one other picture sees alone

// Pixel (x + 0.5, y + 0.5) of the map lies at (h (x, y, 1) + e) in the other picture, homogeneous;
// e holds the plane's part.
typedef struct {
  const uint16_t *src; // [height][width] luma x 256, at least 2x2
  int width_px, height_px;
  float h[9], e[3]; // rows
  int x0, x1;       // columns to fill, 16 or a multiple of it; may lie outside the map
  int y0;           // row of the map that row 0 of warped shows
  int stride;       // of the planes below, whose column 0 is that of the map
  float *warped;    // [SV_SWEEP_ROWS] levels - 128; beyond the picture its border
  float *is_in;     // [SV_SWEEP_BAND] 1 where the picture reaches, else 0: of the rows between
} sv_sweep_warp_args;

typedef struct {
  int n_sources; // 1 to SV_SWEEP_CAP_SOURCES
  // [SV_SWEEP_ROWS][stride], read from x0 - 2 to x1 + 1
  const float *warped[SV_SWEEP_CAP_SOURCES];
  const float *ref; // the map's own picture
  // [SV_SWEEP_BAND][stride]
  const float *is_in[SV_SWEEP_CAP_SOURCES];
  const float *mean; // of the window in ref
  const float *norm; // 1 / (sum of squared deviations) there; 0: without structure
  // The mean of the best two sources' correlations: on the best plane so far, on the planes before
  // and after it, and on the plane before this one. Planes come in rising order.
  float *best, *before, *after, *last;
  float *plane;       // the best one, as a number
  int i_plane;        // this one
  int x0, x1, stride; // columns, multiples of 16
} sv_sweep_match_args;

// --- one place, for the reference and for callers with places of their own ----------------------

#define SV_SWEEP_WINDOW ((float)((2 * SV_SWEEP_RADIUS + 1) * (2 * SV_SWEEP_RADIUS + 1)))

// Level - 128 of a picture [][w] of luma x 256 between its pixels, 0 being the first one's center.
// The pixel to the right of the place and those below both are read, too.
static inline float sv_sweep_bilinear(const uint16_t *src, int w, float x, float y) {
  const int x0 = (int)x, y0 = (int)y;
  const float fx = x - (float)x0, fy = y - (float)y0;
  const uint16_t *p = src + y0 * w + x0;
  const float a = (float)p[0] + fx * ((float)p[1] - (float)p[0]),
              b = (float)p[w] + fx * ((float)p[w + 1] - (float)p[w]);
  return (a + fy * (b - a)) * (1.0f / 256.0f) - 128.0f;
}

// The sums of p, p p and p q over the window whose first pixels p and q point to: of each row
// first, then of these.
static inline void sv_sweep_sum_window(const float *p, const float *q, int stride, float sum[3]) {
  for (int r = 0; r <= 2 * SV_SWEEP_RADIUS; r++, p += stride, q += stride) {
    float row[3] = {p[0], p[0] * p[0], p[0] * q[0]};
    for (int i = 1; i <= 2 * SV_SWEEP_RADIUS; i++) {
      row[0] += p[i];
      row[1] += p[i] * p[i];
      row[2] += p[i] * q[i];
    }
    for (int k = 0; k < 3; k++) sum[k] = r ? sum[k] + row[k] : row[k];
  }
}

typedef void sv_sweep_warp_fn(const sv_sweep_warp_args *a);
typedef void sv_sweep_match_fn(const sv_sweep_match_args *a);

#ifdef __cplusplus
}
#endif
#endif
