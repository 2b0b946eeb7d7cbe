// SPDX-License-Identifier: Apache-2.0
// subview bench: whole training steps and single kernels, on this machine and inside the board's
// block.
#include "boards/board_main.h"
#include "tools/bench/bench.h"

#define SPIN_US 200 // as `run` does

typedef struct {
  options_common common;
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

#define AT(field) offsetof(bench_options, field)

static const sv_option rows[] = {
    {"threads", SV_OPT_INT, 1, 0, AT(threads), "N",
     "threads, timed beside a single one [" SV_TEXT_OF(BOARD_THREADS) "]", 1, BOARD_CAP_THREADS, NULL},
    {"seed", SV_OPT_INT, 1, 0, AT(seed), "N", "seed of the synthetic scene [1]", 0, 4294967295.0, NULL},
    {"json", SV_OPT_FLAG, 1, 0, AT(is_json), NULL, "print one JSON object", 0, 0, NULL},
    {"quiet", SV_OPT_FLAG, 1, 0, AT(is_quiet), NULL, "no progress on stderr", 0, 0, NULL},
    OPTIONS_COMMON(bench_options)};

static const sv_tool_command command = {
    .name = "bench",
    .args = "[options]",
    .text = "Times training steps of several sizes and the kernels of a step, in the board's block.\n"
            "bound: the time of a step at the measured peaks of multiply-adds and of copying;\n"
            "by ports: the same counting all instructions of blending, not its multiply-adds alone.",
    .example = "  "
               "subview bench --json",
    .bit = 1};

int cmd_bench(int argc, char **argv) {
  sv_err err = {0};
  bench_options o = {.threads = BOARD_THREADS, .seed = 1};
  int r = options_parse(&command, rows, sizeof rows / sizeof *rows, argc, argv, &o);
  if (r) return r < 0 ? 0 : r;
  if (!board_kernels(&b.k, &b.isa_mask)) return EXIT_USAGE;
  sv_linux_console_init(&b.console, 2, o.is_quiet);
  if (board_arena(&b.arena, &err) < 0) return fail_with(&err);
  return time_all(&o, &err) < 0 ? fail_with(&err) : 0;
}
