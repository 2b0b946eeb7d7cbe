// SPDX-License-Identifier: Apache-2.0
#include "kernels/correct/correct.h"
#include "kernels/ops.h"

static unsigned code_of(const int32_t *light, const uint8_t *in, uint32_t inverse_falloff) {
  const int32_t v = light[in[0]] + light[256 + in[1]] + light[512 + in[2]];
  const uint32_t limited = v < 0 ? 0u : v < 131072 ? (uint32_t)v : 131071u;
  const uint32_t code = (limited * inverse_falloff + 4096u) >> 13;
  return code < SV_CORRECT_CODES ? code : SV_CORRECT_CODES - 1;
}

void sv_correct_ref(const sv_correct_args *a) {
  for (int y = a->row0; y < a->row1; y++) {
    uint8_t *px = a->px + (size_t)y * a->stride_bytes;
    const size_t at = (size_t)y * (size_t)a->width_px;
    for (int x = 0; x < a->width_px; x++, px += 3) {
      const uint8_t in[3] = {px[0], px[1], px[2]};
      for (int i = 0; i < 3; i++)
        px[i] = a->display[code_of(a->light + 768 * i, in, a->inverse_falloff[at + (size_t)x])];
    }
  }
}
