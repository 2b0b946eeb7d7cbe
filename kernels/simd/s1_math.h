// SPDX-License-Identifier: Apache-2.0
// Scalar twins of v16_math.h and of the lane tree, for the reference kernels: same operations, same
// order, same bits.
#ifndef SV_S1_MATH_H
#define SV_S1_MATH_H

#include <math.h>
#include <stdint.h>
#include <string.h>

static inline uint32_t s1_bits(float x) {
  uint32_t b;
  memcpy(&b, &x, 4);
  return b;
}
static inline float s1_from_bits(uint32_t b) {
  float x;
  memcpy(&x, &b, 4);
  return x;
}
static inline float s1_from_high(uint16_t h) { return s1_from_bits((uint32_t)h << 16); }
static inline uint16_t s1_high(float x) { return (uint16_t)((s1_bits(x) + 0x8000u) >> 16); }
// Eleven numbers in 32 bytes: 0 to 9 to the nearest of 24 bits, a float's first, 10 cut to its
// first 16. Four numbers after the other (4, 4, 3): their upper halves, then their third bytes.
static inline int s1_third11(int i) { return 12 * (i / 4) + (i < 8 ? 8 : 6) + i % 4; }
static inline void s1_store11(uint8_t *p, const float *a) {
  for (int i = 0; i < 11; i++) {
    const uint32_t b = s1_bits(a[i]) + 0x80;
    uint8_t *upper = p + 12 * (i / 4) + 2 * (i % 4);
    upper[0] = (uint8_t)(b >> 16);
    upper[1] = (uint8_t)(b >> 24);
    if (i < 10) p[s1_third11(i)] = (uint8_t)(b >> 8);
  }
}
static inline void s1_load11(const uint8_t *p, float *a) {
  for (int i = 0; i < 11; i++) {
    const uint8_t *upper = p + 12 * (i / 4) + 2 * (i % 4);
    const uint32_t third = i < 10 ? p[s1_third11(i)] : 0;
    a[i] = s1_from_bits((uint32_t)upper[1] << 24 | (uint32_t)upper[0] << 16 | third << 8);
  }
}
static inline float s1_min(float a, float b) { return a < b ? a : b; }
static inline float s1_max(float a, float b) { return a > b ? a : b; }

static inline float s1_exp2_up8(float x) {
  float n = floorf(x), f = x - n;
  float p = 256 * 0.0135557475f;
  p = fmaf(p, f, 256 * 0.0520323701f);
  p = fmaf(p, f, 256 * 0.241379768f);
  p = fmaf(p, f, 256 * 0.693032146f);
  p = fmaf(p, f, 256.0f);
  // What lies below the range is masked; it must be convertible, too.
  return s1_from_bits(s1_bits(p) + ((uint32_t)(int32_t)s1_min(s1_max(n, -1000.0f), 1000.0f) << 23));
}

static inline float s1_exp2_fine(float x) {
  x = s1_min(s1_max(x, -126.0f), 126.0f);
  float t = x + 12582912.0f, f = x - (t - 12582912.0f);
  float p = 1.5403530e-4f;
  p = fmaf(p, f, 1.3333558e-3f);
  p = fmaf(p, f, 9.6181291e-3f);
  p = fmaf(p, f, 5.5504109e-2f);
  p = fmaf(p, f, 2.4022651e-1f);
  p = fmaf(p, f, 6.9314718e-1f);
  p = fmaf(p, f, 1.0f);
  return s1_from_bits(s1_bits(p) + (s1_bits(t) << 23));
}

static inline float s1_log2(float x) {
  uint32_t b = s1_bits(x) + (0x3f800000u - 0x3f3504f3u);
  float e = (float)(int32_t)(b >> 23) - 127.0f;
  float m = s1_from_bits((b & 0x007fffffu) + 0x3f3504f3u);
  float s = (m - 1.0f) / (m + 1.0f), z = s * s;
  float p = 0.41219858f;
  p = fmaf(p, z, 0.57707802f);
  p = fmaf(p, z, 0.96179669f);
  p = fmaf(p, z, 2.88539008f);
  return fmaf(p, s, e);
}

// Sum of 16 lanes by the one tree (i with i+8, +4, +2, +1). Destroys a.
static inline float s1_sum16(float a[16]) {
  for (int h = 8; h; h /= 2)
    for (int k = 0; k < h; k++) a[k] += a[k + h];
  return a[0];
}

#endif
