// SPDX-License-Identifier: Apache-2.0
// Co-visibility: which pixels of a test image the training ("support") images have seen, too.
// Masked metrics look at these only (DyCheck, Gao et al., NeurIPS 2022). Two ways to tell for one
// support image: by depth (reprojection against what is known to stand in front) here, by flow
// (forward-backward check) in flow.h.
#ifndef SV_TOOLS_METRIC_COVISIBLE_H
#define SV_TOOLS_METRIC_COVISIBLE_H

#include <stdbool.h>
#include <stdint.h>

#include "src/rig/rig.h"

#ifdef __cplusplus
extern "C" {
#endif

// In how many of n support images a pixel must be seen: in all of at most 4, else in max(3, ceil(5
// %)).
int sv_covisible_needed(int n_support);

// What is known of the surfaces in front of one support camera.
typedef struct {
  sv_view view;
  float *z; // [height][width] depth along the axis, scene units; 0: nothing is known to stand there
} sv_zbuffer;

// Adds the surface that another camera (or the same one) measured: each of its pixels covers what
// it would cover when seen from here. depth [height][width] of `from`, along its axis, 0: none.
// Start with z all zero.
void sv_zbuffer_add(sv_zbuffer *zb, const sv_view *from, const float *depth);

typedef struct {
  const sv_view *view;
  const float *depth; // [height][width] along the axis; 0: none
  const uint8_t
      // [height][width], or NULL: nowhere. Pixels without depth through which one looks past
      // everything: they are infinitely far. Others without depth count as not seen.
      *is_sky;
} sv_covisible_test;

// seen [height][width] = 1 where the pixel's point lies inside the support image and is not behind
// a surface there: it is when everything in the 3x3 pixels around it is nearer by more than 0.5 %
// (edges of splatted surfaces are uncertain by a pixel).
void sv_covisible_by_depth(const sv_covisible_test *test, const sv_zbuffer *support, uint8_t *seen);

#ifdef __cplusplus
}
#endif
#endif
