// SPDX-License-Identifier: Apache-2.0
// Dense optical flow by inverse search (after Kroeger et al., ECCV 2016, "Fast Optical Flow using
// Dense Inverse Search"): on each level of a pyramid overlapping patches are aligned by
// inverse-compositional Gauss-Newton, start from the coarser level or from what a neighbor found,
// and are blended by how well they fit. One thread, fixed order: results depend on the images only.
#ifndef SV_TOOLS_METRIC_FLOW_H
#define SV_TOOLS_METRIC_FLOW_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "src/base/status.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_FLOW_CAP_LEVELS  10
#define SV_FLOW_MIN_SIDE_PX 16 // of the images

// A gray image at 1, 1/2, 1/4, ... of its size; each level has a border that repeats its outermost
// pixels.
typedef struct {
  int n_levels;
  int width[SV_FLOW_CAP_LEVELS], height[SV_FLOW_CAP_LEVELS];
  int stride[SV_FLOW_CAP_LEVELS];
  float *px[SV_FLOW_CAP_LEVELS]; // pixel (0, 0)
  float *block;
} sv_flow_pyramid;

// gray [height][width], 0..255. E_RANGE (too small), E_NOMEM. Free also takes an empty (zeroed)
// one.
sv_status sv_flow_pyramid_make(sv_flow_pyramid *p, const float *grey, int width, int height) SV_MUST_USE;
void sv_flow_pyramid_free(sv_flow_pyramid *p);

// What one thread needs; grows, starts zeroed.
typedef struct {
  float *block;
  size_t cap_floats;
} sv_flow_work;
void sv_flow_work_free(sv_flow_work *w);

// flow [2][height][width] of a: pixel (x, y) of a is found at (x + flow[0], y + flow[1]) of b,
// pixels. The images may have different sizes. start: a homography [3][3] that takes pixel
// coordinates (centers at .5) of a to about where they are in b; NULL: the images on top of each
// other.
sv_status sv_flow_dense(const sv_flow_pyramid *a, const sv_flow_pyramid *b, const double *start,
                        sv_flow_work *work, float *flow) SV_MUST_USE;

// A flow field and its image's size.
typedef struct {
  const float *uv; // [2][height][width]
  int width, height;
} sv_flow_field;

// Forward-backward check (Sundaram et al., ECCV 2010; Brox): seen[i] = 1 where pixel i of the first
// image is also in the second: its place is inside, and |fw + bw|^2 <= 0.01 (|fw|^2 + |bw|^2) +
// 0.5, bw taken (bilinearly) where fw leads. unit: size of these pixels in those that the 0.5 is
// meant for (2 when images of half size were compared).
void sv_flow_check(const sv_flow_field *fw, const sv_flow_field *bw, double unit, uint8_t *seen);

#ifdef __cplusplus
}
#endif
#endif
