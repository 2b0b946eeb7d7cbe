// SPDX-License-Identifier: Apache-2.0
#include "kernels/raw/raw.h"
#include "kernels/ops.h"

static unsigned sample(sv_raw_container container, const uint8_t *s, int x) {
  const uint8_t *p;
  switch (container) {
  case SV_RAW_16LE: return (unsigned)s[2 * x] | (unsigned)s[2 * x + 1] << 8;
  case SV_RAW_10P:
    p = s + (size_t)(x / 4) * 5;
    return (unsigned)p[x & 3] << 2 | (unsigned)(p[4] >> 2 * (x & 3) & 3);
  case SV_RAW_12P:
    p = s + (size_t)(x / 2) * 3;
    return (unsigned)p[x & 1] << 4 | (unsigned)(p[2] >> 4 * (x & 1) & 15);
  default: return s[x];
  }
}

void sv_raw_ref(const sv_raw_args *a) {
  for (int y = a->row0; y < a->row1; y++) {
    const uint8_t *s = a->src + (size_t)y * a->src_stride_bytes;
    const uint8_t *const *table = a->table + 2 * (y & 1);
    uint8_t *dst = a->dst + (size_t)y * a->dst_stride_bytes;
    for (int x = 0; x < a->width_px; x++) {
      unsigned v = sample(a->container, s, x) >> a->shift;
      dst[x] = table[x & 1][v < SV_RAW_TABLE ? v : SV_RAW_TABLE - 1];
    }
  }
}
