// SPDX-License-Identifier: Apache-2.0
// Whole steps of all sizes.
#include "tools/bench/bench.h"

#include "src/base/str.h"

static const int sizes[][2] = {{128, 128}, {320, 240}, {640, 480}};
static const int counts[] = {1000, 5000, 20000, 50000};
#define N_SIZES ((int)(sizeof sizes / sizeof *sizes))
#define N_CASES ((int)(sizeof counts / sizeof *counts) * N_SIZES)
_Static_assert(N_CASES <= SV_BENCH_CAP_CASES, "more sizes than are kept");

static sv_bench_step case_of(int i, int n_threads) {
  const int *px = sizes[i % N_SIZES];
  sv_bench_step r = {
      .n_gaussians = counts[i / N_SIZES], .width_px = px[0], .height_px = px[1], .n_threads = n_threads};
  r.bytes = sv_bench_scene_bytes(&r);
  return r;
}

size_t sv_bench_bytes(int n_threads) {
  size_t most = sv_bench_kernel_bytes();
  for (int i = 0; i < N_CASES; i++) {
    sv_bench_step r = case_of(i, n_threads);
    if (r.bytes > most) most = r.bytes;
  }
  return most + SV_ARENA_ALIGN; // the block itself may begin anywhere
}

static sv_status time_case(sv_bench *b, const sv_pool *pool, sv_bench_step *r, sv_err *err) {
  size_t mark = sv_arena_mark(b->arena);
  sv_status s = sv_bench_scene_make(&b->scene, r, (sv_compute){b->cfg.k, pool}, b->cfg.seed, b->arena, err);
  if (s >= 0 && (s = sv_bench_time_scene(b, pool, r)) < 0)
    sv_fail(err, s, "%d Gaussians at %dx%d cannot be timed: %s", r->n_gaussians, r->width_px, r->height_px,
            sv_status_text(s));
  sv_arena_reset(b->arena, mark);
  return s < 0 ? s : SV_OK;
}

static double pairs_per_s(const sv_bench_step *r) {
  return r->step_ms.median > 0 ? 1e3 * (double)r->n.pairs / r->step_ms.median : 0;
}

static sv_status time_sizes(sv_bench *b, const sv_pool *pool, sv_err *err) {
  const sv_console *c = &b->cfg.console;
  char line[100];
  for (int i = 0; i < N_CASES; i++) {
    sv_bench_step r = case_of(i, pool->n_threads);
    if (c->is_stop_requested(c->self)) return sv_fail(err, SV_E_INTERRUPTED, "stopped by request");
    if (r.bytes > b->arena->cap_bytes - b->arena->used_bytes) {
      sv_bench_put_skipped(b, &r);
      continue;
    }
    sv_fmt(line, sizeof line, "timing %d Gaussians at %dx%d on %d threads", r.n_gaussians, r.width_px,
           r.height_px, r.n_threads);
    if (b->cfg.is_json) c->log(c->self, SV_LOG_LIVE, line);
    sv_status s = time_case(b, pool, &r, err);
    if (s < 0) return s;
    b->cases[b->n_cases++] = r;
  }
  return SV_OK;
}

// Of each rate the better one.
static void take_better(sv_bench_peak *p, const sv_bench_peak *q) {
  if (q->flop_per_s > p->flop_per_s) p->flop_per_s = q->flop_per_s;
  for (int i = 0; i < p->n_copy_sizes && i < q->n_copy_sizes; i++)
    if (q->copy_bytes_per_s[i] > p->copy_bytes_per_s[i]) p->copy_bytes_per_s[i] = q->copy_bytes_per_s[i];
}

sv_status sv_bench_steps(sv_bench *b, const sv_pool *pool, sv_err *err) {
  b->peak = sv_bench_peak_of(b->cfg.k, pool, &b->cfg.clock, b->arena);
  b->n_cases = 0;
  if (!b->cfg.is_json) sv_bench_put(b, "timing %d sizes on %d threads\n", N_CASES, pool->n_threads);
  sv_status s = time_sizes(b, pool, err);
  // Once more behind the steps: a peak that other programs disturbed would make the bound too long.
  sv_bench_peak again = sv_bench_peak_of(b->cfg.k, pool, &b->cfg.clock, b->arena);
  take_better(&b->peak, &again);
  sv_bench_put_peak(b, pool->n_threads);
  for (int i = 0; i < b->n_cases; i++) {
    sv_bench_bound(&b->cases[i], &b->peak);
    sv_bench_put_step(b, &b->cases[i]);
    if (pairs_per_s(&b->cases[i]) > pairs_per_s(&b->best)) b->best = b->cases[i];
  }
  if (s < 0) return s;
  sv_bench_growth g = sv_bench_growth_of(b->cases, b->n_cases);
  sv_bench_put_growth(b, &g, pool->n_threads);
  return SV_OK;
}
