// SPDX-License-Identifier: Apache-2.0
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "tools/bench/bench.h"
#include "src/base/str.h"
#include "tools/lab/lab.h"

static void print(void *out, const char *text) {
  fputs(text, out);
  fflush(out);
}

// A single thread that waits for nobody is timed by its own CPU time: what other programs take does
// not count.
static sv_ns cpu_now_ns(void *self) {
  struct timespec t;
  (void)self;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return (sv_ns)t.tv_sec * SV_NS_PER_S + t.tv_nsec;
}

static void set_clock(sv_bench *b, const lab_session *se, int n_threads) {
  b->cfg.is_cpu_time = n_threads == 1;
  b->cfg.clock = se->clock;
  if (n_threads == 1) b->cfg.clock.now_ns = cpu_now_ns;
}

static sv_status time_threads(sv_bench *b, int n_threads, sv_err *err) {
  sv_linux_pool threads;
  sv_status s = sv_linux_pool_start(&threads, n_threads, -1, err);
  if (s != SV_OK) return s;
  sv_pool pool = sv_linux_pool_port(&threads);
  s = sv_bench_steps(b, &pool, err);
  sv_linux_pool_stop(&threads);
  return s;
}

static sv_status time_all(lab_session *se, const lab_options *o, sv_bench *b, sv_arena *arena, sv_err *err) {
  int threads[] = {1, 2, se->n_threads}; // --threads lowers "all"
  char extra[60];
  sv_bench_cfg cfg = {.k = &se->k,
                      .isa_mask = se->isa_mask,
                      .clock = se->clock,
                      .console = se->console,
                      .seed = o->seed >= 0 ? (uint64_t)o->seed : 1,
                      .is_json = o->is_json,
                      .out = stdout,
                      .write = print};
  sv_status s = SV_OK;
  sv_bench_begin(b, &cfg, arena);
  for (int i = 0; i < 3 && s == SV_OK; i++) {
    if ((i > 0 && threads[i] <= threads[i - 1]) || threads[i] > se->n_threads) continue;
    set_clock(b, se, threads[i]);
    s = time_threads(b, threads[i], err);
  }
  set_clock(b, se, 1);
  if (s == SV_OK) s = sv_bench_kernels(b, err);
  if (s != SV_OK) return s;
  sv_linux_console_finish(&se->lines);
  sv_fmt(extra, sizeof extra, "\"peak_rss_bytes\": %ld", lab_peak_rss_bytes());
  sv_bench_end(b, extra);
  return SV_OK;
}

static sv_status bench(lab_session *se, const lab_options *o, sv_err *err) {
  size_t bytes = sv_bench_bytes(se->n_threads);
  void *block = malloc(bytes);
  sv_bench *b = calloc(1, sizeof *b);
  if (block) sv_linux_large_pages(block, bytes);
  sv_arena arena = sv_arena_make(block, block ? bytes : 0);
  sv_status s = block && b
                    ? time_all(se, o, b, &arena, err)
                    : sv_fail(err, SV_E_NOMEM, "cannot allocate the %zu bytes of the benchmark", bytes);
  free(b);
  free(block);
  return s;
}

int lab_cmd_bench(const lab_options *o) {
  sv_err err = {0};
  lab_session se;
  int code = LAB_EXIT_OK;
  sv_status s = lab_session_start(&se, o->threads, o->is_quiet, &err);
  if (s == SV_OK) s = sv_linux_catch_signals(&err);
  if (s == SV_OK) s = bench(&se, o, &err);
  sv_linux_console_finish(&se.lines);
  if (s != SV_OK) code = lab_failed(&se, &err);
  lab_session_stop(&se);
  return code;
}
