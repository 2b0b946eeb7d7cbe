// SPDX-License-Identifier: Apache-2.0
#include "tools/lab/flops.h"

#include <stdbool.h>

#define CHAINS  12 // enough independent sums to hide the latency of two units
#define ROUNDS  20000
#define REPEATS 5

// Each returns a number that depends on all sums, so that none is left out.
typedef float (*burn_fn)(float x, long *flops);

#define BURN(vec, lanes, set1, fma, add, first)                                                              \
  {                                                                                                          \
    vec s[CHAINS], a = set1(x), b = set1(0.999f);                                                            \
    for (int k = 0; k < CHAINS; k++) s[k] = set1((float)k);                                                  \
    for (int i = 0; i < ROUNDS; i++)                                                                         \
      for (int k = 0; k < CHAINS; k++) s[k] = fma(s[k], b, a);                                               \
    for (int k = 1; k < CHAINS; k++) s[0] = add(s[0], s[k]);                                                 \
    *flops = 2L * (lanes)*CHAINS * ROUNDS;                                                                   \
    return first(s[0]);                                                                                      \
  }

#if defined(__x86_64__) && defined(__GNUC__)
#include <immintrin.h>
#define MULADD(s, b, a) _mm_add_ps(_mm_mul_ps(s, b), a)
__attribute__((optimize("unroll-loops"))) static float
burn_sse(float x, long *flops) BURN(__m128, 4, _mm_set1_ps, MULADD, _mm_add_ps, _mm_cvtss_f32)
    __attribute__((target("avx2,fma"), optimize("unroll-loops"))) static float burn_avx2(float x, long *flops)
        BURN(__m256, 8, _mm256_set1_ps, _mm256_fmadd_ps, _mm256_add_ps, _mm256_cvtss_f32)
            __attribute__((target("avx512f"), optimize("unroll-loops"))) static float burn_avx512(float x,
                                                                                                  long *flops)
                BURN(__m512, 16, _mm512_set1_ps, _mm512_fmadd_ps, _mm512_add_ps,
                     _mm512_cvtss_f32) static burn_fn choose(sv_isa isa) {
  return isa == SV_ISA_AVX512 ? burn_avx512 : isa == SV_ISA_AVX2 ? burn_avx2 : burn_sse;
}
#elif defined(__aarch64__)
#include <arm_neon.h>
#define FMA(s, b, a) vfmaq_f32(a, s, b)
#define FIRST(v)     vgetq_lane_f32(v, 0)
static float burn_neon(float x, long *flops)
    BURN(float32x4_t, 4, vdupq_n_f32, FMA, vaddq_f32, FIRST) static burn_fn choose(sv_isa isa) {
  (void)isa;
  return burn_neon;
}
#else
#define SAME(x)         (x)
#define MULADD(s, b, a) ((s) * (b) + (a))
#define ADD(a, b)       ((a) + (b))
static float burn_plain(float x, long *flops) BURN(float, 1, SAME, MULADD, ADD, SAME) static burn_fn
    choose(sv_isa isa) {
  (void)isa;
  return burn_plain;
}
#endif

typedef struct {
  burn_fn burn;
  float sum[64];
  long flops;
} job;

static void task(void *arg, int i_task, int i_thread) {
  job *j = arg;
  long flops = 0;
  (void)i_thread;
  j->sum[i_task] = j->burn(0.5f + (float)i_task, &flops);
  if (i_task == 0) j->flops = flops;
}

double lab_peak_flops(sv_isa isa, const sv_pool *pool, const sv_clock *clock) {
  job j = {.burn = choose(isa)};
  int n = pool->n_threads < 64 ? pool->n_threads : 64;
  double best = 0;
  for (int r = 0; r < REPEATS; r++) { // the best: other programs only slow it down
    sv_ns t0 = clock->now_ns(clock->self);
    for (int k = 0; k < 8; k++) sv_pool_run(pool, task, &j, n);
    double dt = 1e-9 * (double)(clock->now_ns(clock->self) - t0);
    double rate = dt > 0 ? 8.0 * (double)j.flops * n / dt : 0;
    if (rate > best) best = rate;
  }
  return best;
}
