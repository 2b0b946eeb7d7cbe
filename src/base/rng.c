// SPDX-License-Identifier: Apache-2.0
#include "src/base/rng.h"

#include <math.h>

#include "src/base/mathx.h"

sv_rng sv_rng_make(uint64_t seed, uint64_t stream) {
  sv_rng r = {0, (stream << 1) | 1};
  sv_rng_u32(&r);
  r.state += seed;
  sv_rng_u32(&r);
  return r;
}

uint32_t sv_rng_u32(sv_rng *r) {
  uint64_t old = r->state;
  r->state = old * 6364136223846793005ull + r->inc;
  uint32_t x = (uint32_t)(((old >> 18) ^ old) >> 27);
  uint32_t rot = (uint32_t)(old >> 59);
  return (x >> rot) | (x << ((32 - rot) & 31));
}

uint32_t sv_rng_below(sv_rng *r, uint32_t n) {
  if (!n) return 0;
  uint32_t low = (uint32_t)(-n) % n, x;
  do x = sv_rng_u32(r);
  while (x < low);
  return x % n;
}

float sv_rng_f(sv_rng *r) { return (float)(sv_rng_u32(r) >> 8) * 0x1p-24f; }

float sv_rng_normal(sv_rng *r) {
  double u = ((double)(sv_rng_u32(r) >> 8) + 0.5) * 0x1p-24;
  double v = (double)(sv_rng_u32(r) >> 8) * 0x1p-24;
  return (float)(sqrt(-2.0 * sv_log(u)) * sv_cos(2.0 * SV_PI * v));
}
