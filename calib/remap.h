// SPDX-License-Identifier: Apache-2.0
// Undistortion as a table: for each pixel of a view (calib/lens_view.h), where it lies in the
// camera's image.
// The table is built once per sub-view (floating point) for the kernel of kernels/remap/remap.h,
// which says what an entry is. Places are off by at most 1/512 px.
#ifndef SV_CALIB_REMAP_H
#define SV_CALIB_REMAP_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "calib/model.h"
#include "kernels/remap/remap.h"
#include "src/base/status.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  int src_width_px, src_height_px;
  int width_px, height_px; // of the view
  long n_outside;          // entries marked SV_REMAP_NONE
  sv_remap_tap *entries;   // [height_px][width_px], the caller's
} sv_remap;

typedef enum {
  // fx, fy, cx, cy of the lens: the center keeps its scale, corners may be black
  SV_PINHOLE_KEEP_FOCAL = 0,
  SV_PINHOLE_CROP_TO_VALID // the widest view of the same size and aspect without a black pixel
} sv_pinhole_choice;

// The pinhole view that stands for a lens, of the same size in pixels. A pinhole comes back
// unchanged. Crop scales fx and fy by one factor in [0.5, 4] about the principal point: below 0.5 a
// corner would be stretched over a quarter of the picture. False when the lens sees no such view.
bool sv_pinhole_for_model(const sv_camera_model *m, sv_pinhole_choice choice, sv_camera_model *out);

// Fills entries[height][width] for `view` (PINHOLE or KB4) of the camera `lens`. E_RANGE for sizes
// outside 1..32767, E_ARG for views of other models.
sv_status sv_remap_build(sv_remap *map, const sv_camera_model *lens, const sv_camera_model *view,
                         sv_remap_tap *entries) SV_MUST_USE;

typedef struct {
  const uint8_t *src; // [src_height][src_stride_bytes], interleaved
  size_t src_stride_bytes;
  int n_channels; // 1..4
  uint8_t *dst;   // [height][width][n_channels]; outside pixels become 0
  uint8_t *mask;  // [height][width] 255 inside, 0 outside; may be NULL
  int y0, y1;     // rows of the view to do, so that threads can share the work
} sv_remap_job;

// Bilinear, rounded to nearest. src and dst must not overlap.
void sv_remap_apply(const sv_remap *map, const sv_remap_job *job);

// Whether all that pixel (x, y) of the view is interpolated from has mask != 0; mask is
// [src_height][src_width], or NULL: then whether the pixel is not outside.
bool sv_remap_counts(const sv_remap *map, const uint8_t *mask, int x, int y);

#ifdef __cplusplus
}
#endif
#endif
