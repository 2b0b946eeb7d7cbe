// SPDX-License-Identifier: Apache-2.0
#include "src/train/reach.h"

#include "src/base/mathx.h"
#include "src/splat/constants.h"
#include "src/splat/gaussians.h"

uint32_t sv_reach_beyond(const sv_trainer *t, const float *p, float factor[16]) {
  const float reach = SV_REACH_RADII * t->radius;
  float d2[16];
  uint32_t beyond = 0;
  for (int k = 0; k < 16; k++) {
    const float x = p[k] - t->centre[0], y = p[16 + k] - t->centre[1], z = p[32 + k] - t->centre[2];
    d2[k] = x * x + y * y + z * z;
  }
  int n = 0;
  for (int k = 0; k < 16; k++) n += d2[k] > reach * reach;
  if (n == 0) return 0;
  for (int k = 0; k < 16; k++) beyond |= (uint32_t)(d2[k] > reach * reach) << k;
  for (int k = 0; k < 16; k++)
    factor[k] = beyond >> k & 1 ? sv_maxf((float)sqrt((double)d2[k]) / reach, 1.0f) : 1.0f;
  return beyond;
}

void sv_reach_scale(uint32_t beyond, const float factor[16], float *grad) {
  for (int row = SV_ROW_MEAN; beyond && row < SV_ROW_MEAN + 3; row++)
    for (int k = 0; k < 16; k++) grad[16 * row + k] *= factor[k];
}
