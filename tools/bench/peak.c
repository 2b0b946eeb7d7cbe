// SPDX-License-Identifier: Apache-2.0
// The measured peaks of a pool: fused multiply-adds, and copying, for bounds on how fast a step can
// be.
#include <string.h>

#include "tools/bench/bench.h"

#define N_ROUNDS 200000
#define LEAST    4 // runs
#define LEAST_S  0.05
// bytes of a copy, read and written together; each size is twice the last
#define SMALLEST ((size_t)256 << 10)

static void fma_task(void *arg, int i_task, int i_thread) {
  const sv_kernels *k = arg;
  float out[16];
  (void)i_thread;
  k->fma_peak(N_ROUNDS, 0.5f + (float)i_task, out);
}

typedef struct {
  uint8_t *from, *to;
  size_t part_bytes; // of a thread
  int n_times;
} copy_job;

static void copy_task(void *arg, int i_task, int i_thread) {
  const copy_job *j = arg;
  size_t at = (size_t)i_task * j->part_bytes;
  (void)i_thread;
  for (int i = 0; i < j->n_times; i++) memcpy(j->to + at, j->from + at, j->part_bytes);
}

// The best of several: other programs only slow it down.
static double best_s(const sv_pool *pool, sv_task_fn task, void *arg, const sv_clock *clock) {
  double best = 1e30, sum = 0;
  for (int i = 0; i < LEAST || sum < LEAST_S; i++) {
    sv_ns t0 = clock->now_ns(clock->self);
    sv_pool_run(pool, task, arg, pool->n_threads);
    double dt = sv_ns_to_s(clock->now_ns(clock->self) - t0);
    if (dt > 0 && dt < best) best = dt;
    sum += dt > 0 ? dt : LEAST_S; // a clock that stands still must not hold us
  }
  return best;
}

sv_bench_peak sv_bench_peak_of(const sv_kernels *k, const sv_pool *pool, const sv_clock *clock,
                               sv_arena *arena) {
  sv_bench_peak p = {0};
  sv_kernels table = *k; // tasks take plain pointers
  size_t mark = sv_arena_mark(arena), bytes = SMALLEST;
  p.flop_per_s =
      (double)SV_FMA_PEAK_FLOPS * N_ROUNDS * pool->n_threads / best_s(pool, fma_task, &table, clock);
  for (int i = 0; i < SV_BENCH_COPY_SIZES; i++, bytes *= 2) {
    copy_job j = {.from = SV_TAKE(arena, uint8_t, bytes / 2), .to = SV_TAKE(arena, uint8_t, bytes / 2)};
    if (arena->status >= 0) {
      j.part_bytes = bytes / 2 / (size_t)pool->n_threads;
      j.n_times =
          // A run is longer than the pool's start
          bytes < SMALLEST * 64 ? (int)(SMALLEST * 64 / bytes) : 1;
      memset(j.from, 1, bytes / 2); // pages must be there
      memset(j.to, 2, bytes / 2);
      double moved = 2.0 * (double)j.part_bytes * pool->n_threads * j.n_times;
      p.copy_bytes[i] = bytes;
      p.copy_bytes_per_s[i] = moved / best_s(pool, copy_task, &j, clock);
      p.n_copy_sizes++;
    }
    sv_arena_reset(arena, mark);
  }
  return p;
}
