// SPDX-License-Identifier: Apache-2.0
// What a length of 1 in a model's world means, and how well that is known. Owns nothing; a plain
// value that files and the page carry.
#ifndef SV_BASE_UNIT_H
#define SV_BASE_UNIT_H

#include <stdbool.h>

typedef struct {
  bool is_metric; // 1 is a meter; false: not known
  // One standard deviation of the scale, relative: a length of L is off by L x scale_sigma. From
  // the rig's calibration and odometry. 0: not known.
  float scale_sigma;
} sv_unit;

#endif
