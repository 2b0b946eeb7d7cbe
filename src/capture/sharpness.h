// SPDX-License-Identifier: Apache-2.0
// Sharpness of exposures, to leave out those that are blurred by motion: the mean squared slopes of
// luma at half size along x and along y, over its squared mean, so that exposure time and gain
// cancel. Motion along one axis takes that axis's slopes alone, so each is compared by itself.
// Owns rows of scratch and the newest values. Never judges one image alone: an exposure is blurred
// when it is clearly less sharp than the median of those before it, and than the last one that was
// sharp: what comes into view may have less texture, but hands jerk at once.
#ifndef SV_CAPTURE_SHARPNESS_H
#define SV_CAPTURE_SHARPNESS_H

#include "kernels/kernels.h"
#include "src/base/arena.h"
#include "src/image/planes.h"
#include "src/port/compute.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_SHARPNESS_RECENT 7    // exposures that the next one is compared with
#define SV_SHARPNESS_FEWEST 3    // with fewer there is no judgment
#define SV_SHARPNESS_SHARE  0.5  // of their median: below it an exposure is blurred
#define SV_SHARPNESS_DARK   0.01 // mean luma (0 to 1) below which an image is not judged

// Of one image or one exposure: sums of squared slopes along x and y, of luma, and of pixels.
typedef struct {
  double dx2, dy2, luma, n;
} sv_sharpness_sums;

typedef struct {
  float *rows;                           // [n_threads][rows of a task, at full and half size]
  sv_sharpness_sums *band;               // [bands of the largest image]
  size_t cap_rows;                       // floats of a thread
  double recent[2][SV_SHARPNESS_RECENT]; // along x, y
  double last_sharp[2];                  // of the last that was not blurred
  int n_seen;                            // exposures that were not too dark
} sv_sharpness;

// Takes memory for images up to this size; a dry arena only counts.
void sv_sharpness_carve(sv_sharpness *s, int cap_width_px, int cap_height_px, int n_threads, sv_arena *a);
// Adds an image (3 channels) to the sums of its exposure; pixels that its mask leaves out do not
// count. The same bits for all kernels and any number of threads.
void sv_sharpness_add(sv_sharpness *s, const sv_image_u8 *im, const sv_compute *c, sv_sharpness_sums *sums);
// The sharpness of an exposure with these sums over the median of those before or, if that is less,
// the last sharp one, along the axis where it is less sharp; 1: not judged. It counts among those
// that later ones are compared with, blurred or not: who goes on moving fast is not left without
// exposures.
double sv_sharpness_share(sv_sharpness *s, const sv_sharpness_sums *sums);
// Whether that makes it a blurred one.
bool sv_sharpness_is_blurred(sv_sharpness *s, const sv_sharpness_sums *sums);

#ifdef __cplusplus
}
#endif
#endif
