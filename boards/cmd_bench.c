// SPDX-License-Identifier: Apache-2.0
// subview bench: whole training steps and single kernels, on this machine and inside the board's block.
#include "boards/board_main.h"
#include "tools/bench/bench.h"

#define SPIN_US 200 // as `run` does

typedef struct {
  long threads, seed;
  bool is_json, is_quiet;
} bench_options;

static struct {
  sv_bench bench;
  sv_arena arena;
  sv_kernels k;
  uint32_t isa_mask;
  sv_linux_pool pool;
  sv_linux_console console;
} b;

static void print(void *out, const char *text) {
  (void)out;
  say(1, "%s", text);
}

static sv_status time_threads(int n_threads, sv_err *err) {
  sv_status s = sv_linux_pool_start(&b.pool, n_threads, SPIN_US, err);
  if (s < 0) return s;
  sv_pool pool = sv_linux_pool_port(&b.pool);
  s = sv_bench_steps(&b.bench, &pool, err);
  sv_linux_pool_stop(&b.pool);
  return s;
}

static sv_status time_all(const bench_options *o, sv_err *err) {
  char extra[80];
  sv_bench_cfg cfg = {.k = &b.k,
                      .isa_mask = b.isa_mask,
                      .clock = sv_linux_clock(),
                      .console = sv_linux_console_port(&b.console),
                      .seed = (uint64_t)o->seed,
                      .is_json = o->is_json,
                      .write = print};
  sv_status s = sv_linux_catch_signals(err);
  if (s < 0) return s;
  sv_bench_begin(&b.bench, &cfg, &b.arena);
  s = time_threads(1, err);
  if (s >= 0 && o->threads > 1) s = time_threads((int)o->threads, err);
  if (s >= 0) s = sv_bench_kernels(&b.bench, err);
  sv_linux_console_finish(&b.console);
  if (s < 0) return s;
  sv_fmt(extra, sizeof extra, "\"arena_bytes\": %zu, \"high_bytes\": %zu", b.arena.cap_bytes,
         b.arena.high_bytes);
  sv_bench_end(&b.bench, extra);
  return SV_OK;
}

int cmd_bench(int argc, char **argv) {
  sv_err err = {0};
  bench_options o = {.threads = BOARD_THREADS, .seed = 1};
  const opt list[] = {
      {"--threads", OPT_INT, &o.threads, 1, BOARD_CAP_THREADS, "N",
       "threads, timed beside a single one (" TEXT_OF(BOARD_THREADS) ")"},
      {"--seed", OPT_INT, &o.seed, 0, 4294967295.0, "N", "of the made-up scene (1)"},
      {"--json", OPT_FLAG, &o.is_json, 0, 0, NULL, "print one JSON object"},
      {"--quiet", OPT_FLAG, &o.is_quiet, 0, 0, NULL, "no progress on stderr"},
  };
  int r =
      options_parse("bench",
                    "Times training steps of several sizes and the kernels of a step, in the board's block.\n"
                    "bound is what a step takes at the measured peaks of multiply-adds and of copying;\n"
                    "by ports counts all instructions of blending, not its multiply-adds alone.",
                    "subview bench --json", list, sizeof list / sizeof *list, argc, argv);
  if (r) return r < 0 ? 0 : r;
  if (!board_kernels(&b.k, &b.isa_mask)) return EXIT_USAGE;
  sv_linux_console_init(&b.console, 2, o.is_quiet);
  b.arena = board_arena();
  return time_all(&o, &err) < 0 ? fail_with(&err) : 0;
}
