// SPDX-License-Identifier: Apache-2.0
// Four floats at once, written with the compiler's generic vectors: every operation is IEEE element
// by element, so x86 and aarch64 give the same bits. Comparisons give masks of all ones or all
// zeros.
#ifndef SV_SIM_V4_H
#define SV_SIM_V4_H

#include <math.h>
#include <stdbool.h>
#include <stdint.h>

typedef float v4f __attribute__((vector_size(16)));
typedef int32_t v4i __attribute__((vector_size(16)));
typedef uint32_t v4u __attribute__((vector_size(16)));
typedef int64_t v2l __attribute__((vector_size(16)));

typedef struct {
  v4f x, y, z;
} v4_vec;

static inline v4f v4_set(float a) { return (v4f){a, a, a, a}; }
static inline v4i v4_seti(int32_t a) { return (v4i){a, a, a, a}; }
static inline v4f v4_select(v4i mask, v4f a, v4f b) { return (v4f)((mask & (v4i)a) | (~mask & (v4i)b)); }
static inline v4i v4_selecti(v4i mask, v4i a, v4i b) { return (mask & a) | (~mask & b); }
static inline v4f v4_min(v4f a, v4f b) { // a loop that compilers turn into one instruction
  v4f r = b;
  for (int i = 0; i < 4; i++) r[i] = a[i] < b[i] ? a[i] : b[i];
  return r;
}
static inline v4f v4_max(v4f a, v4f b) {
  v4f r = b;
  for (int i = 0; i < 4; i++) r[i] = a[i] > b[i] ? a[i] : b[i];
  return r;
}
static inline v4f v4_abs(v4f a) { return (v4f)((v4i)a & v4_seti(0x7fffffff)); }
static inline v4f v4_clamp01(v4f a) { return v4_min(v4_max(a, v4_set(0)), v4_set(1)); }
static inline v4f v4_sqrt(v4f a) { return (v4f){sqrtf(a[0]), sqrtf(a[1]), sqrtf(a[2]), sqrtf(a[3])}; }
static inline v4f v4_dot(v4_vec a, v4_vec b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
static inline v4f v4_dotf(v4_vec a, const float b[3]) { return a.x * b[0] + a.y * b[1] + a.z * b[2]; }
static inline bool v4_any(v4i mask) {
  v2l m = (v2l)mask;
  return (m[0] | m[1]) != 0;
}

// floor for |a| < 2^31, as whole numbers. Lanes out of range hold anything: the caller masks them.
static inline v4i v4_floori(v4f a) {
  v4i i = __builtin_convertvector(a, v4i);
  // truncation went up below zero: mask is -1
  return i + (v4i)(__builtin_convertvector(i, v4f) > a);
}

#endif
