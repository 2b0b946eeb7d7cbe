// SPDX-License-Identifier: Apache-2.0
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tools/lab/bench.h"
#include "tools/lab/flops.h"
#include "tools/lab/report.h"

#define FLOP_PER_PAIR 74.0 // forward 27 and backward 47 of colour, opacity and depth of one pixel-splat pair
#define CASE_S        0.4
#define CAP_SAMPLES   200

static const int sizes[][2] = {{128, 128}, {320, 240}, {640, 480}};
static const int counts[] = {1000, 5000, 20000, 50000};

typedef struct {
  int n, width_px, height_px, n_threads;
  double step_ms, render_ms, bound_ms;
  unsigned long long pairs;
} result;

static sv_status time_case(lab_session *se, const sv_pool *pool, double flops, uint64_t seed, result *o,
                           sv_err *err) {
  lab_bench_scene b;
  double step_ms[CAP_SAMPLES], render_ms[CAP_SAMPLES], sum = 0;
  int n = 0;
  sv_status s = lab_bench_scene_make(&b, &se->k, pool, o->n, o->width_px, o->height_px, seed, err);
  sv_render_options ro = sv_train_render_options(&b.t, 1.0f, false);
  while (s == SV_OK && n < CAP_SAMPLES && (n < 4 || sum < CASE_S)) {
    double t0 = lab_seconds(se);
    if ((s = sv_render(&b.t.render, &se->k, pool, &b.t.g, &b.t.views[0].view, &ro)) < 0) break;
    double t1 = lab_seconds(se);
    if (n == 0) o->pairs = (unsigned long long)sv_render_count_pairs(&b.t.render); // before the scene moves
    double t2 = lab_seconds(se);
    sv_step_stats st;
    if ((s = sv_train_step(&b.t, 1.0f, &st)) < 0) break;
    double t3 = lab_seconds(se);
    render_ms[n] = 1e3 * (t1 - t0), step_ms[n] = 1e3 * (t3 - t2);
    sum += t3 - t0;
    n++;
  }
  if (s < 0)
    sv_fail(err, s, "%d Gaussians at %dx%d cannot be timed: %s", o->n, o->width_px, o->height_px,
            sv_status_text(s));
  lab_bench_scene_free(&b);
  // The first sample warms the caches up.
  o->step_ms = n > 1 ? lab_median(step_ms + 1, n - 1) : 0;
  o->render_ms = n > 1 ? lab_median(render_ms + 1, n - 1) : 0;
  o->bound_ms = 1e3 * (double)o->pairs * FLOP_PER_PAIR / flops;
  return s;
}

static void put_step(lab_report *j, const result *o, bool is_json) {
  if (!is_json) {
    printf(
        "%6d Gaussians %4dx%-4d %2d threads: step %8.2f ms, render %8.2f ms, bound %7.2f ms, %.2f M pairs\n",
        o->n, o->width_px, o->height_px, o->n_threads, o->step_ms, o->render_ms, o->bound_ms,
        1e-6 * (double)o->pairs);
    fflush(stdout);
    return;
  }
  lab_report_item_begin(j);
  lab_report_int(j, "gaussians", o->n);
  lab_report_int(j, "width", o->width_px);
  lab_report_int(j, "height", o->height_px);
  lab_report_int(j, "threads", o->n_threads);
  lab_report_num(j, "step_ms", o->step_ms);
  lab_report_num(j, "render_ms", o->render_ms);
  lab_report_num(j, "bound_ms", o->bound_ms);
  lab_report_int(j, "pairs", (long long)o->pairs);
  lab_report_item_end(j);
}

// All cases of one thread count, on a pool of its own.
static sv_status time_threads(lab_session *se, int n_threads, const lab_options *o, lab_report *j,
                              sv_err *err) {
  sv_linux_pool threads;
  uint64_t seed = o->seed >= 0 ? (uint64_t)o->seed : 1;
  char line[100];
  sv_status s = sv_linux_pool_start(&threads, n_threads, -1, err);
  if (s != SV_OK) return s;
  sv_pool pool = sv_linux_pool_port(&threads);
  double flops = lab_peak_flops(se->k.isa, &pool, &se->clock);
  if (!o->is_json) printf("peak of %d threads: %.1f GFLOP/s\n", n_threads, 1e-9 * flops);
  for (size_t c = 0; c < sizeof counts / sizeof *counts && s == SV_OK; c++)
    for (size_t z = 0; z < sizeof sizes / sizeof *sizes && s == SV_OK; z++) {
      result r = {.n = counts[c], .width_px = sizes[z][0], .height_px = sizes[z][1], .n_threads = n_threads};
      snprintf(line, sizeof line, "timing %d Gaussians at %dx%d on %d threads", r.n, r.width_px, r.height_px,
               n_threads);
      if (o->is_json) se->console.log(se->console.self, SV_LOG_LIVE, line);
      if (se->console.is_stop_requested(se->console.self))
        s = sv_fail(err, SV_E_INTERRUPTED, "stopped by request");
      if (s == SV_OK) s = time_case(se, &pool, flops, seed, &r, err);
      if (s == SV_OK) put_step(j, &r, o->is_json);
    }
  sv_linux_pool_stop(&threads);
  return s;
}

static sv_status time_kernels(lab_session *se, const lab_options *o, lab_report *j, sv_err *err) {
  lab_kernel_time t[LAB_CAP_KERNEL_TIMES];
  int n;
  uint32_t mask = getenv("SV_ISA") && *getenv("SV_ISA") ? sv_isa_only(se->k.isa) : ~0u;
  sv_status s = lab_bench_kernels(mask, &se->clock, o->seed >= 0 ? (uint64_t)o->seed : 1, t, &n, err);
  if (s != SV_OK) return s;
  if (o->is_json) lab_report_array(j, "kernels");
  for (int i = 0; i < n; i++) {
    if (!o->is_json) {
      printf("%-12s %-7s %9.3f ns a %s\n", t[i].op, t[i].isa, t[i].ns_per_item, t[i].item);
      continue;
    }
    lab_report_item_begin(j);
    lab_report_text(j, "op", t[i].op);
    lab_report_text(j, "isa", t[i].isa);
    lab_report_num(j, "ns_per_item", t[i].ns_per_item);
    lab_report_text(j, "item", t[i].item);
    lab_report_item_end(j);
  }
  if (o->is_json) lab_report_array_end(j);
  return SV_OK;
}

static sv_status bench(lab_session *se, const lab_options *o, lab_report *j, sv_err *err) {
  int threads[] = {1, 2, se->n_threads}; // --threads lowers "all"
  sv_status s = SV_OK;
  lab_report_begin(j);
  lab_report_text(j, "isa", sv_isa_name(se->k.isa));
  lab_report_array(j, "steps");
  for (int i = 0; i < 3 && s == SV_OK; i++)
    if ((i == 0 || threads[i] > threads[i - 1]) && threads[i] <= se->n_threads)
      s = time_threads(se, threads[i], o, j, err);
  lab_report_array_end(j);
  if (s == SV_OK) s = time_kernels(se, o, j, err);
  lab_report_int(j, "peak_rss_bytes", lab_peak_rss_bytes());
  lab_report_end(j);
  return s;
}

int lab_cmd_bench(const lab_options *o) {
  sv_err err = {0};
  lab_session se;
  lab_report j = {0};
  int code = LAB_EXIT_OK;
  sv_status s = lab_session_start(&se, o->threads, o->is_quiet, &err);
  if (s == SV_OK) s = sv_linux_catch_signals(&err);
  if (s == SV_OK) s = bench(&se, o, &j, &err);
  sv_linux_console_finish(&se.lines);
  if (s == SV_OK && o->is_json) s = lab_report_print(&j, &err);
  if (s != SV_OK) code = lab_failed(&se, &err);
  lab_report_free(&j);
  lab_session_stop(&se);
  return code;
}
