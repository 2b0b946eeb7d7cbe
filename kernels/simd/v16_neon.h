// SPDX-License-Identifier: Apache-2.0
// The 16-lane vocabulary on AArch64 NEON: four 128-bit quarters. v16_ref.h states what every word
// means.
#ifndef SV_V16_NEON_H
#define SV_V16_NEON_H
#include <arm_neon.h>
#include <stdint.h>

#define V16_PARTS     4 // machine registers that a vector takes
#define V16_REGISTERS 8 // vectors that the register file holds

typedef struct {
  float32x4_t q[4];
} v16;
typedef struct {
  int32x4_t q[4];
} v16i;
typedef struct {
  uint32x4_t q[4]; // all ones or all zeros per lane
} v16m;

// -O2 leaves four-step loops rolled, and a rolled loop keeps the vector in memory: five times
// slower.
#define V16_UNROLL _Pragma("GCC unroll 4")
#define V16_EACH(type, expr)                                                                                 \
  type r;                                                                                                    \
  V16_UNROLL                                                                                                 \
  for (int i = 0; i < 4; i++) r.q[i] = (expr);                                                               \
  return r

static inline v16 v16_set1(float x) { V16_EACH(v16, vdupq_n_f32(x)); }
static inline v16 v16_zero(void) { V16_EACH(v16, vdupq_n_f32(0.0f)); }
static inline v16 v16_iota(void) {
  static const float n[16] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15};
  V16_EACH(v16, vld1q_f32(n + 4 * i));
}
static inline v16 v16_load(const float *p) { V16_EACH(v16, vld1q_f32(p + 4 * i)); }
static inline void v16_store(float *p, v16 x) {
  V16_UNROLL
  for (int i = 0; i < 4; i++) vst1q_f32(p + 4 * i, x.q[i]);
}
static inline v16 v16_load4x4(const float *p, long stride) { V16_EACH(v16, vld1q_f32(p + i * stride)); }
static inline v16 v16_load_quad(const float *p) { V16_EACH(v16, vld1q_f32(p)); }
static inline v16 v16_load_quads(const float *p0, const float *p1, const float *p2, const float *p3) {
  v16 r = {{vld1q_f32(p0), vld1q_f32(p1), vld1q_f32(p2), vld1q_f32(p3)}};
  return r;
}
static inline v16 v16_dup4_0(v16 x) { V16_EACH(v16, vdupq_laneq_f32(x.q[i], 0)); }
static inline v16 v16_dup4_1(v16 x) { V16_EACH(v16, vdupq_laneq_f32(x.q[i], 1)); }
static inline v16 v16_dup4_2(v16 x) { V16_EACH(v16, vdupq_laneq_f32(x.q[i], 2)); }
static inline v16 v16_dup4_3(v16 x) { V16_EACH(v16, vdupq_laneq_f32(x.q[i], 3)); }
static inline void v16_store4x4(float *p, long stride, v16 x) {
  V16_UNROLL
  for (int i = 0; i < 4; i++) vst1q_f32(p + i * stride, x.q[i]);
}
static inline v16 v16_load_u8(const uint8_t *p) {
  uint8x16_t b = vld1q_u8(p);
  uint16x8_t lo = vmovl_u8(vget_low_u8(b)), hi = vmovl_u8(vget_high_u8(b));
  v16 r;
  r.q[0] = vcvtq_f32_u32(vmovl_u16(vget_low_u16(lo)));
  r.q[1] = vcvtq_f32_u32(vmovl_u16(vget_high_u16(lo)));
  r.q[2] = vcvtq_f32_u32(vmovl_u16(vget_low_u16(hi)));
  r.q[3] = vcvtq_f32_u32(vmovl_u16(vget_high_u16(hi)));
  return r;
}
static inline v16 v16_min(v16 x, v16 y) {
  V16_EACH(v16, vbslq_f32(vcltq_f32(x.q[i], y.q[i]), x.q[i], y.q[i]));
}
static inline v16 v16_max(v16 x, v16 y) {
  V16_EACH(v16, vbslq_f32(vcgtq_f32(x.q[i], y.q[i]), x.q[i], y.q[i]));
}
static inline void v16_store_u8(uint8_t *p, v16 x) {
  uint16x4_t c[4];
  x = v16_min(v16_max(x, v16_zero()), v16_set1(255.0f));
  V16_UNROLL
  for (int i = 0; i < 4; i++) c[i] = vmovn_u32(vcvtnq_u32_f32(x.q[i]));
  vst1q_u8(p, vcombine_u8(vmovn_u16(vcombine_u16(c[0], c[1])), vmovn_u16(vcombine_u16(c[2], c[3]))));
}
static inline v16 v16_add(v16 x, v16 y) { V16_EACH(v16, vaddq_f32(x.q[i], y.q[i])); }
static inline v16 v16_sub(v16 x, v16 y) { V16_EACH(v16, vsubq_f32(x.q[i], y.q[i])); }
static inline v16 v16_mul(v16 x, v16 y) { V16_EACH(v16, vmulq_f32(x.q[i], y.q[i])); }
static inline v16 v16_div(v16 x, v16 y) { V16_EACH(v16, vdivq_f32(x.q[i], y.q[i])); }
static inline v16 v16_fma(v16 x, v16 y, v16 z) { V16_EACH(v16, vfmaq_f32(z.q[i], x.q[i], y.q[i])); }
static inline v16 v16_fnma(v16 x, v16 y, v16 z) { V16_EACH(v16, vfmsq_f32(z.q[i], x.q[i], y.q[i])); }
static inline v16 v16_fms(v16 x, v16 y, v16 z) {
  V16_EACH(v16, vfmaq_f32(vnegq_f32(z.q[i]), x.q[i], y.q[i]));
}
static inline v16 v16_fnms(v16 x, v16 y, v16 z) {
  V16_EACH(v16, vfmsq_f32(vnegq_f32(z.q[i]), x.q[i], y.q[i]));
}
static inline v16 v16_sqrt(v16 x) { V16_EACH(v16, vsqrtq_f32(x.q[i])); }
static inline v16 v16_floor(v16 x) { V16_EACH(v16, vrndmq_f32(x.q[i])); }
static inline v16 v16_abs(v16 x) { V16_EACH(v16, vabsq_f32(x.q[i])); }
static inline v16 v16_neg(v16 x) { V16_EACH(v16, vnegq_f32(x.q[i])); }
static inline v16m v16_lt(v16 x, v16 y) { V16_EACH(v16m, vcltq_f32(x.q[i], y.q[i])); }
static inline v16m v16_le(v16 x, v16 y) { V16_EACH(v16m, vcleq_f32(x.q[i], y.q[i])); }
static inline v16m v16_gt(v16 x, v16 y) { V16_EACH(v16m, vcgtq_f32(x.q[i], y.q[i])); }
static inline v16m v16_ge(v16 x, v16 y) { V16_EACH(v16m, vcgeq_f32(x.q[i], y.q[i])); }
static inline v16m v16m_and(v16m x, v16m y) { V16_EACH(v16m, vandq_u32(x.q[i], y.q[i])); }
static inline v16m v16m_or(v16m x, v16m y) { V16_EACH(v16m, vorrq_u32(x.q[i], y.q[i])); }
static inline v16m v16m_andnot(v16m x, v16m y) { V16_EACH(v16m, vbicq_u32(x.q[i], y.q[i])); }
static inline uint32_t v16m_bits(v16m x) {
  static const uint32_t w[4] = {1, 2, 4, 8};
  uint32x4_t n = vld1q_u32(w);
  return vaddvq_u32(vandq_u32(x.q[0], n)) | vaddvq_u32(vandq_u32(x.q[1], n)) << 4 |
         vaddvq_u32(vandq_u32(x.q[2], n)) << 8 | vaddvq_u32(vandq_u32(x.q[3], n)) << 12;
}
static inline int v16m_all(v16m x) {
  return vminvq_u32(vandq_u32(vandq_u32(x.q[0], x.q[1]), vandq_u32(x.q[2], x.q[3]))) != 0;
}
static inline v16m v16m_from_bits(uint32_t bits) {
  static const uint32_t w[4] = {1, 2, 4, 8};
  V16_EACH(v16m, vtstq_u32(vdupq_n_u32(bits >> (4 * i)), vld1q_u32(w)));
}
static inline v16 v16_sel(v16m m, v16 x, v16 y) { V16_EACH(v16, vbslq_f32(m.q[i], x.q[i], y.q[i])); }
static inline v16 v16_keep(v16m m, v16 x) {
  V16_EACH(v16, vreinterpretq_f32_u32(vandq_u32(m.q[i], vreinterpretq_u32_f32(x.q[i]))));
}
static inline v16i v16i_set1(int32_t x) { V16_EACH(v16i, vdupq_n_s32(x)); }
static inline v16i v16_bits(v16 x) { V16_EACH(v16i, vreinterpretq_s32_f32(x.q[i])); }
static inline v16 v16_from_bits(v16i x) { V16_EACH(v16, vreinterpretq_f32_s32(x.q[i])); }
static inline v16i v16i_add(v16i x, v16i y) { V16_EACH(v16i, vaddq_s32(x.q[i], y.q[i])); }
static inline v16i v16i_and(v16i x, v16i y) { V16_EACH(v16i, vandq_s32(x.q[i], y.q[i])); }
static inline v16i v16i_andnot(v16i x, v16i y) { V16_EACH(v16i, vbicq_s32(x.q[i], y.q[i])); }
static inline v16i v16i_or(v16i x, v16i y) { V16_EACH(v16i, vorrq_s32(x.q[i], y.q[i])); }
static inline v16i v16i_shl8(v16i x) { V16_EACH(v16i, vshlq_n_s32(x.q[i], 8)); }
static inline v16i v16i_shr8(v16i x) {
  V16_EACH(v16i, vreinterpretq_s32_u32(vshrq_n_u32(vreinterpretq_u32_s32(x.q[i]), 8)));
}
static inline v16i v16i_shl16(v16i x) { V16_EACH(v16i, vshlq_n_s32(x.q[i], 16)); }
#define V16_HAS_SHL_BY 1
static inline v16i v16i_shl_by(v16i x, v16 n) { V16_EACH(v16i, vshlq_s32(x.q[i], vcvtq_s32_f32(n.q[i]))); }
static inline v16i v16i_shl23(v16i x) { V16_EACH(v16i, vshlq_n_s32(x.q[i], 23)); }
static inline v16i v16i_shr23(v16i x) {
  V16_EACH(v16i, vreinterpretq_s32_u32(vshrq_n_u32(vreinterpretq_u32_s32(x.q[i]), 23)));
}
static inline v16 v16i_to_f(v16i x) { V16_EACH(v16, vcvtq_f32_s32(x.q[i])); }
static inline v16i v16_trunc_i(v16 x) { V16_EACH(v16i, vcvtq_s32_f32(x.q[i])); }
static inline void v16i_store(int32_t *p, v16i x) {
  V16_UNROLL
  for (int i = 0; i < 4; i++) vst1q_s32(p + 4 * i, x.q[i]);
}
static inline v16 v16_load_high(const uint16_t *p) {
  V16_EACH(v16, vreinterpretq_f32_u32(vshll_n_u16(vld1_u16(p + 4 * i), 16)));
}
static inline void v16i_store_high(uint16_t *p, v16i x) {
  V16_UNROLL
  for (int i = 0; i < 4; i++) vst1_u16(p + 4 * i, vshrn_n_u32(vreinterpretq_u32_s32(x.q[i]), 16));
}
#define V16_HAS_STORE_HIGH 1
static inline void v16_store_high(uint16_t *p, v16 x) {
  V16_UNROLL
  for (int i = 0; i < 4; i++) vst1_u16(p + 4 * i, vrshrn_n_u32(vreinterpretq_u32_f32(x.q[i]), 16));
}
static inline void v16_store11(uint8_t *p, v16 x) {
  static const uint8_t four[16] = {2, 3, 6, 7, 10, 11, 14, 15, 1, 5, 9, 13, 255, 255, 255, 255},
                       three[8] = {2, 3, 6, 7, 10, 11, 1, 5};
  uint8x16_t q[3], m = vld1q_u8(four);
  V16_UNROLL
  for (int i = 0; i < 3; i++)
    q[i] = vreinterpretq_u8_u32(vaddq_u32(vreinterpretq_u32_f32(x.q[i]), vdupq_n_u32(0x80)));
  vst1q_u8(p, vqtbl1q_u8(q[0], m)); // each store leaves four bytes for the next
  vst1q_u8(p + 12, vqtbl1q_u8(q[1], m));
  vst1_u8(p + 24, vqtbl1_u8(q[2], vld1_u8(three)));
}
static inline v16 v16_load11(const uint8_t *p) {
  static const uint8_t four[16] = {255, 8, 0, 1, 255, 9, 2, 3, 255, 10, 4, 5, 255, 11, 6, 7},
                       three[16] = {255, 6, 0, 1, 255, 7, 2, 3, 255, 255, 4, 5, 255, 255, 255, 255};
  uint8x16_t m = vld1q_u8(four), last = vcombine_u8(vld1_u8(p + 24), vdup_n_u8(0));
  v16 r = {{vreinterpretq_f32_u8(vqtbl1q_u8(vld1q_u8(p), m)),
            vreinterpretq_f32_u8(vqtbl1q_u8(vld1q_u8(p + 12), m)),
            vreinterpretq_f32_u8(vqtbl1q_u8(last, vld1q_u8(three))), vdupq_n_f32(0.0f)}};
  return r;
}
static inline v16 v16_min4(v16 x) { V16_EACH(v16, vdupq_n_f32(vminvq_f32(x.q[i]))); }
static inline v16 v16_max4(v16 x) { V16_EACH(v16, vdupq_n_f32(vmaxvq_f32(x.q[i]))); }
static inline float32x4_t v16_fold4_(v16 x) {
  return vaddq_f32(vaddq_f32(x.q[0], x.q[2]), vaddq_f32(x.q[1], x.q[3]));
}
static inline float v16_sum(v16 x) {
  float32x4_t q = v16_fold4_(x);
  float32x2_t h = vadd_f32(vget_low_f32(q), vget_high_f32(q));
  return vget_lane_f32(h, 0) + vget_lane_f32(h, 1);
}
static inline float32x4_t v16_sum_(v16 x) {
  float32x4_t q = v16_fold4_(x);
  q = vaddq_f32(q, vextq_f32(q, q, 2));
  return vaddq_f32(q, vrev64q_f32(q));
}
static inline v16 v16_sum4(v16 a, v16 b, v16 c, v16 d) {
  v16 r = {{v16_sum_(a), v16_sum_(b), v16_sum_(c), v16_sum_(d)}};
  return r;
}
static inline void v16_tr4_(float32x4_t *a, float32x4_t *b, float32x4_t *c, float32x4_t *d) {
  float32x4x2_t ab = vtrnq_f32(*a, *b), cd = vtrnq_f32(*c, *d);
  *a = vcombine_f32(vget_low_f32(ab.val[0]), vget_low_f32(cd.val[0]));
  *b = vcombine_f32(vget_low_f32(ab.val[1]), vget_low_f32(cd.val[1]));
  *c = vcombine_f32(vget_high_f32(ab.val[0]), vget_high_f32(cd.val[0]));
  *d = vcombine_f32(vget_high_f32(ab.val[1]), vget_high_f32(cd.val[1]));
}
static inline void v16_tr4(v16 a, v16 b, v16 c, v16 d, v16 out[4]) {
  V16_UNROLL
  for (int i = 0; i < 4; i++) v16_tr4_(&a.q[i], &b.q[i], &c.q[i], &d.q[i]);
  out[0] = a;
  out[1] = b;
  out[2] = c;
  out[3] = d;
}
static inline float32x4_t v16_sum4_(const v16 *x) {
  float32x4_t a = v16_fold4_(x[0]), b = v16_fold4_(x[1]), c = v16_fold4_(x[2]), d = v16_fold4_(x[3]);
  v16_tr4_(&a, &b, &c, &d);
  return vaddq_f32(vaddq_f32(a, c), vaddq_f32(b, d));
}
static inline v16 v16_sum16(const v16 x[16]) { V16_EACH(v16, v16_sum4_(x + 4 * i)); }
static __attribute__((noinline, unused)) void v16_transpose(v16 x[16]) {
  V16_UNROLL
  for (int g = 0; g < 4; g++) V16_UNROLL
  for (int k = 0; k < 4; k++)
    v16_tr4_(&x[4 * g].q[k], &x[4 * g + 1].q[k], &x[4 * g + 2].q[k], &x[4 * g + 3].q[k]);
  V16_UNROLL
  for (int g = 0; g < 4; g++) V16_UNROLL
  for (int k = g + 1; k < 4; k++) V16_UNROLL
  for (int i = 0; i < 4; i++) {
    float32x4_t t = x[4 * g + i].q[k];
    x[4 * g + i].q[k] = x[4 * k + i].q[g];
    x[4 * k + i].q[g] = t;
  }
}
#include "kernels/simd/v16_math.h"
#endif
