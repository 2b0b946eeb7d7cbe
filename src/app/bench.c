// SPDX-License-Identifier: Apache-2.0
// Whole steps of all sizes, and what is printed.
#include "src/app/bench.h"

#include "src/base/str.h"

#define FLOP_PER_PAIR 74.0 // forward 27 and backward 47 of colour, opacity and depth of one pixel-splat pair
#define CASE_S        0.4  // a case is repeated for so long,
#define LEAST         4    // and at least so often
#define CAP_LINE      400

static const int sizes[][2] = {{128, 128}, {320, 240}, {640, 480}};
static const int counts[] = {1000, 5000, 20000, 50000};
#define N_SIZES ((int)(sizeof sizes / sizeof *sizes))
#define N_CASES ((int)(sizeof counts / sizeof *counts) * N_SIZES)

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

// --- output --------------------------------------------------------------------------------------

static void put(sv_bench *b, const char *fmt, ...) SV_PRINTF(2, 3);
static void put(sv_bench *b, const char *fmt, ...) {
  char text[CAP_LINE];
  va_list ap;
  va_start(ap, fmt);
  sv_vfmt(text, sizeof text, fmt, ap);
  va_end(ap);
  b->cfg.write(b->cfg.out, text);
}

static double pairs_per_s(const sv_bench_step *r) {
  return r->step_ms > 0 ? 1e3 * (double)r->pairs / r->step_ms : 0;
}

static void put_size(sv_bench *b, const sv_bench_step *r) {
  put(b,
      b->cfg.is_json ? "{\"gaussians\": %d, \"width\": %d, \"height\": %d, \"threads\": %d, "
                     : "%6d Gaussians %4dx%-4d %2d threads: ",
      r->n_gaussians, r->width_px, r->height_px, r->n_threads);
}

static void put_step(sv_bench *b, const sv_bench_step *r) {
  if (b->cfg.is_json && b->n_steps) put(b, ",\n    ");
  put_size(b, r);
  put(b,
      b->cfg.is_json
          ? "\"step_ms\": %g, \"render_ms\": %g, \"bound_ms\": %g, \"pairs\": %llu, \"pairs_per_s\": %.0f}"
          : "step %8.2f ms, render %8.2f ms, bound %7.2f ms, %llu pairs, %.0f pairs/s\n",
      r->step_ms, r->render_ms, r->bound_ms, (unsigned long long)r->pairs, pairs_per_s(r));
  b->n_steps++;
}

void sv_bench_put_skipped(sv_bench *b, const sv_bench_step *size) {
  if (b->n_skipped < SV_BENCH_CAP_SKIPPED) b->skipped[b->n_skipped++] = *size;
  if (b->cfg.is_json) return; // at the end
  put_size(b, size);
  put(b, "skipped, it takes %zu MiB of memory and %zu are free\n", (size->bytes >> 20) + 1,
      (b->arena->cap_bytes - b->arena->used_bytes) >> 20);
}

void sv_bench_put_kernels_begin(sv_bench *b) {
  if (b->cfg.is_json) put(b, "\n  ],\n  \"kernels\": [\n    ");
}

void sv_bench_put_kernel(sv_bench *b, const sv_bench_kernel *r) {
  bool is_rate = r->is_pairs && r->ns_per_item > 0;
  if (b->cfg.is_json) {
    put(b, "%s{\"op\": \"%s\", \"isa\": \"%s\", \"ns_per_item\": %g, \"item\": \"%s\"",
        b->n_kernels ? ",\n    " : "", r->op, sv_isa_name(r->isa), r->ns_per_item, r->item);
    if (is_rate) put(b, ", \"gpair_per_s\": %g", 1 / r->ns_per_item);
    put(b, "}");
  } else {
    put(b, "%-12s %-7s %9.3f ns a %s", r->op, sv_isa_name(r->isa), r->ns_per_item, r->item);
    if (is_rate) put(b, ", %.3f Gpair/s", 1 / r->ns_per_item);
    put(b, "\n");
  }
  b->n_kernels++;
}

void sv_bench_begin(sv_bench *b, const sv_bench_cfg *cfg, sv_arena *arena) {
  b->cfg = *cfg;
  b->arena = arena;
  b->n_steps = b->n_skipped = b->n_kernels = 0;
  b->best = (sv_bench_step){0};
  if (cfg->is_json) put(b, "{\n  \"isa\": \"%s\",\n  \"steps\": [\n    ", sv_isa_name(cfg->k->isa));
}

void sv_bench_end(sv_bench *b, const char *extra) {
  if (!b->cfg.is_json) {
    if (!b->n_steps) return;
    put(b, "figure of merit: %.0f pixel-splat pairs/s forward and backward in whole steps, of\n",
        pairs_per_s(&b->best));
    put_step(b, &b->best);
    return;
  }
  put(b, "\n  ],\n  \"skipped\": [");
  for (int i = 0; i < b->n_skipped; i++) {
    if (i) put(b, ", ");
    put_size(b, &b->skipped[i]);
    put(b, "\"bytes\": %zu}", b->skipped[i].bytes);
  }
  put(b, "],\n  \"pairs_per_s\": %.0f", pairs_per_s(&b->best));
  if (extra) put(b, ",\n  %s", extra);
  put(b, "\n}\n");
}

// --- whole steps ---------------------------------------------------------------------------------

static double median(double *v, int n) { // sorts v
  for (int i = 1; i < n; i++) {
    double x = v[i];
    int k = i;
    for (; k > 0 && v[k - 1] > x; k--) v[k] = v[k - 1];
    v[k] = x;
  }
  if (n < 1) return 0;
  return n & 1 ? v[n / 2] : 0.5 * (v[n / 2 - 1] + v[n / 2]);
}

static double now_ms(const sv_bench *b) { return sv_ns_to_ms(b->cfg.clock.now_ns(b->cfg.clock.self)); }

// Times renderings and steps of the scene in turn.
static sv_status time_scene(sv_bench *b, const sv_pool *pool, sv_bench_step *out) {
  sv_trainer *t = &b->scene.t;
  sv_render_options o = sv_train_render_options(t, 1.0f, false);
  double sum_ms = 0;
  int n = 0;
  for (; n < SV_BENCH_CAP_SAMPLES && (n < LEAST || sum_ms < 1e3 * CASE_S); n++) {
    sv_step_stats st;
    double t0 = now_ms(b);
    sv_status s = sv_render(&t->render, b->cfg.k, pool, &t->g, &t->views[0].view, &o);
    double t1 = now_ms(b);
    if (s < 0) return s;
    if (n == 0) out->pairs = sv_render_count_pairs(&t->render); // before the scene moves
    double t2 = now_ms(b);
    s = sv_train_step(t, 1.0f, &st);
    double t3 = now_ms(b);
    if (s < 0) return s;
    b->render_ms[n] = t1 - t0, b->step_ms[n] = t3 - t2;
    sum_ms += t3 - t0;
  }
  out->step_ms = median(b->step_ms + 1, n - 1); // the first sample warms the caches up
  out->render_ms = median(b->render_ms + 1, n - 1);
  return SV_OK;
}

static sv_status time_case(sv_bench *b, const sv_pool *pool, sv_bench_step *r, sv_err *err) {
  size_t mark = sv_arena_mark(b->arena);
  sv_status s = sv_bench_scene_make(&b->scene, r, b->cfg.k, pool, b->cfg.seed, b->arena, err);
  if (s >= 0 && (s = time_scene(b, pool, r)) < 0)
    sv_fail(err, s, "%d Gaussians at %dx%d cannot be timed: %s", r->n_gaussians, r->width_px, r->height_px,
            sv_status_text(s));
  sv_arena_reset(b->arena, mark);
  return s < 0 ? s : SV_OK;
}

sv_status sv_bench_steps(sv_bench *b, const sv_pool *pool, sv_err *err) {
  const sv_console *c = &b->cfg.console;
  char line[100];
  double flops = sv_bench_peak_flops(b->cfg.k, pool, &b->cfg.clock);
  if (!b->cfg.is_json) put(b, "peak of %d threads: %.1f GFLOP/s\n", pool->n_threads, 1e-9 * flops);
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
    r.bound_ms = 1e3 * (double)r.pairs * FLOP_PER_PAIR / flops;
    put_step(b, &r);
    if (pairs_per_s(&r) > pairs_per_s(&b->best)) b->best = r;
  }
  return SV_OK;
}
