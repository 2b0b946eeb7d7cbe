// SPDX-License-Identifier: Apache-2.0
// Undistortion as a table: for each pixel of a pinhole view, where it lies in the camera's image. The
// table is built once per sub-view (floating point); applying it is integer arithmetic only.
#ifndef SV_CALIB_REMAP_H
#define SV_CALIB_REMAP_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "calib/model.h"
#include "src/base/status.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_REMAP_OUTSIDE INT16_MIN // x of an entry whose ray the camera does not see

// 6 bytes. Taps are the pixels (x, y), (x+1, y), (x, y+1), (x+1, y+1), counted from 0 at the corner, with
// weights (256-fx)(256-fy) ... / 65536; a tap beyond the last column or row has weight 0.
typedef struct {
  int16_t x, y;
  uint8_t fx, fy; // 1/256 px: places are off by at most 1/512 px
} sv_remap_entry;

typedef struct {
  int src_width_px, src_height_px;
  int width_px, height_px; // of the pinhole view
  long n_outside;          // entries marked SV_REMAP_OUTSIDE
  sv_remap_entry *entries; // [height_px][width_px], the caller's
} sv_remap;

typedef enum {
  SV_PINHOLE_KEEP_FOCAL = 0, // fx, fy, cx, cy of the lens: the centre keeps its scale, corners may be black
  SV_PINHOLE_CROP_TO_VALID   // the widest view of the same size and aspect without a black pixel
} sv_pinhole_choice;

// The pinhole view that stands for a lens, of the same size in pixels. A pinhole comes back unchanged.
// Crop scales fx and fy by one factor in [0.5, 4] about the principal point: below 0.5 a corner would
// be stretched over a quarter of the picture. False when the lens sees no such view.
bool sv_pinhole_for_model(const sv_camera_model *m, sv_pinhole_choice choice, sv_camera_model *out);

// Fills entries[height][width] for `view` (a pinhole) of the camera `lens`. E_RANGE for sizes outside
// 1..32767, E_ARG when view is not a pinhole.
sv_status sv_remap_build(sv_remap *map, const sv_camera_model *lens, const sv_camera_model *view,
                         sv_remap_entry *entries) SV_MUST_USE;

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

#ifdef __cplusplus
}
#endif
#endif
