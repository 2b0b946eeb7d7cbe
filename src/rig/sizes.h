// SPDX-License-Identifier: Apache-2.0
// Sizes of images: a lens that was calibrated at one mode of its sensor (crop, binning, scaling)
// at another one, and at a smaller size for training. Pixel centers are at i + 0.5, so all of these
// are u' = a u + b along each axis: focal lengths and principal point change, distortion does not.
// Owns nothing. Never touches a frame.
#ifndef SV_RIG_SIZES_H
#define SV_RIG_SIZES_H

#include "src/rig/rig.h"

#ifdef __cplusplus
extern "C" {
#endif

// What a camera delivers.
typedef struct {
  int width_px, height_px;
  sv_sensor_area area; // that its frames show; sensor size 0: not reported
} sv_image_mode;

// u' = a u + b, from the image that was, to the image that is.
typedef struct {
  double a[2], b[2];
} sv_image_map;

// Makes a lens that of images of another size, which show the same. False, and m is as before: they
// have another shape, by more than the rounding of a pixel.
bool sv_model_resize(sv_camera_model *m, int width_px, int height_px, sv_image_map *map);

typedef enum {
  SV_FIT_SAME = 0, // the frames are as they were calibrated
  SV_FIT_REPORTED, // by areas that the camera or the rig tells
  SV_FIT_ASSUMED   // nobody tells: by their shape, the images are taken to show all there is
} sv_size_fit;

// Makes a sub-view's lens that of the camera's frames. The frames' area is the one reported, else
// that of the rig's mode of this size (v->modes). The area of the calibrated images is v->area,
// else the whole sensor where it has the shape of the images. E_RANGE, with both sizes in the
// sentence, when the two sizes cannot be explained. Sub-views with a footprint stay as they are.
sv_status sv_sub_view_fit(sv_sub_view *v, const sv_image_mode *frame, sv_size_fit *how, sv_image_map *map,
                          sv_err *err) SV_MUST_USE;

// Images for training of 1/k of the size, columns and rows that remain left out, or of another
// smaller size and the same shape (within the rounding of a pixel).
typedef struct {
  int k;                   // 1: not smaller; 0: width_px x height_px
  int width_px, height_px; // with k 0
} sv_reduction;

// Makes a sub-view's images smaller; its source_width_px and source_height_px are then the size
// that they are averaged from. E_RANGE with both sizes: larger, or of another shape; nothing left.
sv_status sv_sub_view_reduce(sv_sub_view *v, const sv_reduction *r, sv_image_map *map,
                             sv_err *err) SV_MUST_USE;

sv_image_map sv_image_map_then(const sv_image_map *first, const sv_image_map *second);

// A mask [src_height][src_width] at another size: a pixel counts where all that it shows did.
typedef struct {
  const uint8_t *px;
  int width_px, height_px;
} sv_mask_image;
void sv_mask_map(const sv_mask_image *src, const sv_image_map *map, const sv_mask_image *dst, uint8_t *out);

#ifdef __cplusplus
}
#endif
#endif
