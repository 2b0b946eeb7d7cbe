// SPDX-License-Identifier: Apache-2.0
// px_x86.h on AArch64 NEON.
#ifndef SV_PX_NEON_H
#define SV_PX_NEON_H
#include <arm_neon.h>
#include <stdint.h>

static inline void px_split3(const uint8_t *p, uint8_t *out) {
  uint8x16x3_t v = vld3q_u8(p);
  vst1q_u8(out, v.val[0]);
  vst1q_u8(out + 16, v.val[1]);
  vst1q_u8(out + 32, v.val[2]);
}
static inline void px_split4(const uint8_t *p, uint8_t *out) {
  uint8x16x4_t v = vld4q_u8(p);
  vst1q_u8(out, v.val[0]);
  vst1q_u8(out + 16, v.val[1]);
  vst1q_u8(out + 32, v.val[2]);
  vst1q_u8(out + 48, v.val[3]);
}
static inline void px_split2(const uint8_t *p, uint8_t *out) {
  uint8x16x2_t v = vld2q_u8(p);
  vst1q_u8(out, v.val[0]);
  vst1q_u8(out + 16, v.val[1]);
}
static inline void px_zip2(const uint8_t *even, const uint8_t *odd, uint8_t *low, uint8_t *high) {
  uint8x16x2_t v = vzipq_u8(vld1q_u8(even), vld1q_u8(odd));
  vst1q_u8(low, v.val[0]);
  vst1q_u8(high, v.val[1]);
}
static inline void px_join3(const uint8_t *in, uint8_t *p) {
  uint8x16x3_t v;
  v.val[0] = vld1q_u8(in);
  v.val[1] = vld1q_u8(in + 16);
  v.val[2] = vld1q_u8(in + 32);
  vst3q_u8(p, v);
}
static inline void px_pair_sum(const float *p, float *out) {
  for (int i = 0; i < 16; i += 4)
    vst1q_f32(out + i, vpaddq_f32(vld1q_f32(p + 2 * i), vld1q_f32(p + 2 * i + 4)));
}
#endif
