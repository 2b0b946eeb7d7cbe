// SPDX-License-Identifier: Apache-2.0
// What the bench prints: lines of text, or the members of one JSON object.
#include "tools/bench/bench.h"

#include "src/base/str.h"

#define CAP_LINE 500

static const char *const stage_names[SV_N_STAGES] = {
    [SV_STAGE_TARGET] = "target",     [SV_STAGE_PROJECT] = "project",    [SV_STAGE_ORDER] = "order",
    [SV_STAGE_RASTER] = "raster",     [SV_STAGE_LOSS] = "loss",          [SV_STAGE_RASTER_BWD] = "raster_bwd",
    [SV_STAGE_OPTIMISE] = "optimise", [SV_STAGE_CURVATURE] = "curvature"};

static const struct {
  const char *name, *item;
} ops[SV_N_BENCH_OPS] = {[SV_BENCH_UNPACK] = {"unpack", "pixel"},
                         [SV_BENCH_PROJECT] = {"project", "Gaussian"},
                         [SV_BENCH_SORT] = {"sort", "splat"},
                         [SV_BENCH_BIN] = {"bin", "record"},
                         [SV_BENCH_RASTER] = {"raster", "pair"},
                         [SV_BENCH_SSIM] = {"ssim", "pixel"},
                         [SV_BENCH_SSIM_BWD] = {"ssim_bwd", "pixel"},
                         [SV_BENCH_RASTER_BWD] = {"raster_bwd", "pair"},
                         [SV_BENCH_PROJECT_BWD] = {"project_bwd", "Gaussian"},
                         [SV_BENCH_NEWTON] = {"newton", "Gaussian"}};

const char *sv_bench_op_name(sv_bench_op op) { return ops[op].name; }

void sv_bench_put(sv_bench *b, const char *fmt, ...) {
  char text[CAP_LINE];
  va_list ap;
  va_start(ap, fmt);
  sv_vfmt(text, sizeof text, fmt, ap);
  va_end(ap);
  b->cfg.write(b->cfg.out, text);
}

static double ratio(double a, double b) { return b > 0 ? a / b : 0; }

static double pairs_per_s(const sv_bench_step *r) {
  return ratio(1e3 * (double)r->n.pairs, r->step_ms.median);
}

void sv_bench_put_peak(sv_bench *b, int n_threads) {
  const int n = b->n_pools;
  if (n < SV_BENCH_CAP_POOLS)
    b->pools[n] = (sv_bench_pool){.n_threads = n_threads, .is_cpu_time = b->cfg.is_cpu_time, .peak = b->peak};
  if (b->cfg.is_json) return; // at the end
  sv_bench_put(b, "peak of %d threads (%s): %.1f GFLOP/s; copies at", n_threads,
               b->cfg.is_cpu_time ? "times are CPU times" : "times are real times",
               1e-9 * b->peak.flop_per_s);
  for (int i = 0; i < b->peak.n_copy_sizes; i++)
    sv_bench_put(b, "%s %.1f GB/s (%zu KiB)", i ? "," : "", 1e-9 * b->peak.copy_bytes_per_s[i],
                 b->peak.copy_bytes[i] >> 10);
  sv_bench_put(b, "\n");
}

static void put_size(sv_bench *b, const sv_bench_step *r) {
  sv_bench_put(b,
               b->cfg.is_json ? "{\"gaussians\": %d, \"width\": %d, \"height\": %d, \"threads\": %d, "
                              : "%6d Gaussians %4dx%-4d %2d threads: ",
               r->n_gaussians, r->width_px, r->height_px, r->n_threads);
}

// Of the undisturbed stages together.
static double share_of(const sv_bench_step *r, int stage) {
  double sum = 0;
  for (int i = 0; i < SV_N_STAGES; i++) sum += r->stage_ms[i].least;
  return ratio(r->stage_ms[stage].least, sum);
}

static void put_times(sv_bench *b, const char *name, const sv_bench_times *t) {
  sv_bench_put(b, "\"%s_ms\": %g, \"%s_least_ms\": %g, \"%s_quartiles_ms\": [%g, %g], ", name, t->median,
               name, t->least, name, t->q1, t->q3);
}

static void put_step_json(sv_bench *b, const sv_bench_step *r) {
  if (b->n_steps) sv_bench_put(b, ",\n    ");
  put_size(b, r);
  sv_bench_put(b, "\"samples\": %d, ", r->n_samples);
  put_times(b, "step", &r->step_ms);
  put_times(b, "render", &r->render_ms);
  sv_bench_put(b,
               "\"bound_ms\": %g, \"pixel_bound_ms\": %g, \"slot_bound_ms\": %g, \"step_per_bound\": %g, "
               "\"step_per_slot_bound\": %g, \"step_per_render\": %g, ",
               r->bound_ms, r->pixel_bound_ms, r->slot_bound_ms, ratio(r->step_ms.least, r->bound_ms),
               ratio(r->step_ms.least, r->slot_bound_ms), ratio(r->step_ms.least, r->render_ms.least));
  sv_bench_put(b,
               "\"pairs\": %llu, \"useful_pairs\": %llu, \"visible\": %u, \"records\": %u, \"touched\": %u, "
               "\"pairs_per_s\": %.0f,\n      \"stages\": [",
               (unsigned long long)r->n.pairs, (unsigned long long)r->n.useful, r->n.n_visible,
               r->n.n_intersections, r->n.n_touched, pairs_per_s(r));
  for (int i = 0; i < SV_N_STAGES; i++)
    sv_bench_put(b, "%s{\"stage\": \"%s\", \"ms\": %g, \"least_ms\": %g, \"share\": %.3f, \"bound_ms\": %g}",
                 i ? ", " : "", stage_names[i], r->stage_ms[i].median, r->stage_ms[i].least, share_of(r, i),
                 r->stage_bound_ms[i]);
  sv_bench_put(b, "]}");
}

static void put_step_text(sv_bench *b, const sv_bench_step *r) {
  put_size(b, r);
  sv_bench_put(
      b,
      "step %7.2f ms (%.2f to %.2f, least %.2f), render %7.2f (least %.2f), bound %6.2f, step/bound %.1f, "
      "by ports %.2f, %.1f\n",
      r->step_ms.median, r->step_ms.q1, r->step_ms.q3, r->step_ms.least, r->render_ms.median,
      r->render_ms.least, r->bound_ms, ratio(r->step_ms.least, r->bound_ms), r->slot_bound_ms,
      ratio(r->step_ms.least, r->slot_bound_ms));
  sv_bench_put(b, "      %llu pairs, %.0f %% of them useful, %.0f pairs/s;", (unsigned long long)r->n.pairs,
               100 * ratio((double)r->n.useful, (double)r->n.pairs), pairs_per_s(r));
  for (int i = 0; i < SV_N_STAGES; i++) sv_bench_put(b, " %s %.0f %%", stage_names[i], 100 * share_of(r, i));
  sv_bench_put(b, "\n");
}

void sv_bench_put_step(sv_bench *b, const sv_bench_step *r) {
  if (b->cfg.is_json) put_step_json(b, r);
  else put_step_text(b, r);
  b->n_steps++;
}

void sv_bench_put_growth(sv_bench *b, const sv_bench_growth *g, int n_threads) {
  if (b->n_pools < SV_BENCH_CAP_POOLS) b->pools[b->n_pools++].growth = *g;
  if (b->cfg.is_json || g->worst <= 0) return;
  sv_bench_put(
      b,
      "growth of a step on %d threads: %.2f ms + %.1f ns a Gaussian + %.1f ns a pixel, within %.0f %%; "
      "about N^%.2f, pixels^%.2f\n",
      n_threads, g->fixed_ms, g->ns_per_gaussian, g->ns_per_pixel, 100 * g->worst, g->by_gaussians,
      g->by_pixels);
}

void sv_bench_put_skipped(sv_bench *b, const sv_bench_step *size) {
  if (b->n_skipped < SV_BENCH_CAP_SKIPPED) b->skipped[b->n_skipped++] = *size;
  if (b->cfg.is_json) return; // at the end
  put_size(b, size);
  sv_bench_put(b, "skipped, it takes %zu MiB of memory and %zu are free\n", (size->bytes >> 20) + 1,
               (b->arena->cap_bytes - b->arena->used_bytes) >> 20);
}

void sv_bench_put_kernels_begin(sv_bench *b) {
  if (b->cfg.is_json) sv_bench_put(b, "\n  ],\n  \"kernels\": [\n    ");
}

void sv_bench_put_kernel(sv_bench *b, const sv_bench_kernel *r) {
  const char *op = ops[r->op].name, *item = ops[r->op].item;
  double per_s = ratio(1e9, r->ns.median), gflop = ratio(r->cost.flop, r->ns.median),
         bytes = r->cost.bytes * per_s;
  if (b->cfg.is_json)
    sv_bench_put(b,
                 "%s{\"op\": \"%s\", \"isa\": \"%s\", \"item\": \"%s\", \"ns_per_item\": %g, "
                 "\"ns_per_item_least\": %g, \"ns_per_item_quartiles\": [%g, %g], \"items_per_s\": %.0f, "
                 "\"gflop_per_s\": %g, \"bytes_per_s\": %.0f}",
                 b->n_kernels ? ",\n    " : "", op, sv_isa_name(r->isa), item, r->ns.median, r->ns.least,
                 r->ns.q1, r->ns.q3, per_s, gflop, bytes);
  else
    sv_bench_put(b, "%-12s %-7s %9.3f ns a %-9s (%.3f to %.3f) %8.1f M/s %8.2f GFLOP/s %7.2f GB/s\n", op,
                 sv_isa_name(r->isa), r->ns.median, item, r->ns.q1, r->ns.q3, 1e-6 * per_s, gflop,
                 1e-9 * bytes);
  b->n_kernels++;
}

void sv_bench_begin(sv_bench *b, const sv_bench_cfg *cfg, sv_arena *arena) {
  b->cfg = *cfg;
  b->arena = arena;
  b->n_steps = b->n_skipped = b->n_kernels = b->n_pools = b->n_cases = 0;
  b->best = (sv_bench_step){0};
  if (cfg->is_json) sv_bench_put(b, "{\n  \"isa\": \"%s\",\n  \"steps\": [\n    ", sv_isa_name(cfg->k->isa));
}

static void put_pool(sv_bench *b, const sv_bench_pool *p) {
  const sv_bench_growth *g = &p->growth;
  sv_bench_put(b, "{\"threads\": %d, \"clock\": \"%s\", \"flop_per_s\": %.0f, \"copies\": [", p->n_threads,
               p->is_cpu_time ? "cpu" : "real", p->peak.flop_per_s);
  for (int i = 0; i < p->peak.n_copy_sizes; i++)
    sv_bench_put(b, "%s{\"bytes\": %zu, \"bytes_per_s\": %.0f}", i ? ", " : "", p->peak.copy_bytes[i],
                 p->peak.copy_bytes_per_s[i]);
  sv_bench_put(b,
               "],\n     \"growth\": {\"fixed_ms\": %g, \"ns_per_gaussian\": %g, \"ns_per_pixel\": %g, "
               "\"largest_error\": %.3f, \"exponent_gaussians\": %.3f, \"exponent_pixels\": %.3f}}",
               g->fixed_ms, g->ns_per_gaussian, g->ns_per_pixel, g->worst, g->by_gaussians, g->by_pixels);
}

void sv_bench_end(sv_bench *b, const char *extra) {
  if (!b->cfg.is_json) {
    if (!b->n_steps) return;
    sv_bench_put(b, "figure of merit: %.0f pixel-splat pairs/s forward and backward in whole steps, of\n",
                 pairs_per_s(&b->best));
    put_step_text(b, &b->best);
    return;
  }
  sv_bench_put(b, "\n  ],\n  \"pools\": [\n    ");
  for (int i = 0; i < b->n_pools; i++) {
    if (i) sv_bench_put(b, ",\n    ");
    put_pool(b, &b->pools[i]);
  }
  sv_bench_put(b, "\n  ],\n  \"skipped\": [");
  for (int i = 0; i < b->n_skipped; i++) {
    if (i) sv_bench_put(b, ", ");
    put_size(b, &b->skipped[i]);
    sv_bench_put(b, "\"bytes\": %zu}", b->skipped[i].bytes);
  }
  sv_bench_put(b, "],\n  \"pairs_per_s\": %.0f", pairs_per_s(&b->best));
  if (extra) sv_bench_put(b, ",\n  %s", extra);
  sv_bench_put(b, "\n}\n");
}
