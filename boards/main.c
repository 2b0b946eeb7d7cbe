// SPDX-License-Identifier: Apache-2.0
// `subview`: the runtime on this board. One block of memory, taken from the system at start, carved
// and sealed; no heap after.
#include <stdlib.h>
#include <string.h>

#include "boards/board_main.h"
#include "src/run/isa.h"

sv_status board_arena(sv_arena *arena, sv_err *err) {
  static void *block; // of the program: a second run in it takes the same
  if (!block) block = sv_linux_block(BOARD_ARENA_BYTES, err);
  if (!block) return SV_E_NOMEM;
  sv_linux_large_pages(block, BOARD_ARENA_BYTES);
  *arena = sv_arena_make(block, BOARD_ARENA_BYTES);
  return SV_OK;
}

bool board_kernels(sv_kernels *k, uint32_t *mask) {
  sv_err err;
  if (sv_isa_choose(getenv("SV_ISA"), mask, &err) < 0) {
    fail_with(&err);
    return false;
  }
  sv_kernels_init(k, *mask);
  return true;
}

typedef struct {
  const char *name, *text;
  int (*run)(int argc, char **argv);
} command;

static const command commands[] = {
    {"run", "capture synchronized exposures, train Gaussians on them, save the model", cmd_run},
    {"capture", "record synchronized exposures into a folder that replays", cmd_capture},
    {"cameras", "list the cameras that this machine has, with the source string to use", cmd_cameras},
    {"plan", "print the memory map of this board and what fits into it", cmd_plan},
#ifdef BOARD_HAS_BENCH
    {"bench", "time whole training steps on this machine", cmd_bench},
#endif
    {"status", "print what the service of this machine does", cmd_status},
    {"selftest", "check every kernel against its reference on this CPU", cmd_selftest},
};

static void help(int fd) {
  say(fd,
      "subview: synchronized cameras in, 3D Gaussians out, in one fixed block of memory (board " BOARD_NAME
      ").\n\n"
      "usage: subview COMMAND [options]\n\n");
  for (size_t i = 0; i < sizeof commands / sizeof *commands; i++)
    say(fd, "  %-10s %s\n", commands[i].name, commands[i].text);
  say(fd,
      "\n'subview COMMAND --help' explains a command. SV_ISA=ref|sse41|avx2|avx512|neon pins the kernels.\n\n"
      "example:\n  subview run --source sim:textured,rig=stereo --out out/demo\n");
}

static int run_command(int argc, char **argv) {
  if (argc < 2) {
    help(2);
    return EXIT_USAGE;
  }
  if (!strcmp(argv[1], "--help") || !strcmp(argv[1], "-h") || !strcmp(argv[1], "help")) {
    help(1);
    return 0;
  }
  if (!strcmp(argv[1], "--version")) {
    print_version();
    return 0;
  }
  for (size_t i = 0; i < sizeof commands / sizeof *commands; i++)
    if (!strcmp(argv[1], commands[i].name)) return commands[i].run(argc - 1, argv + 1);
  sv_near_name near = sv_near_make(argv[1], strlen(argv[1]));
  for (size_t i = 0; i < sizeof commands / sizeof *commands; i++) sv_near_try(&near, commands[i].name);
  if (near.name)
    say(2, "subview: unknown command '%s' (did you mean %s?); try 'subview --help'\n", argv[1], near.name);
  else say(2, "subview: unknown command '%s'; try 'subview --help'\n", argv[1]);
  return EXIT_USAGE;
}

int main(int argc, char **argv) {
  sv_linux_begin_program();
  return sv_linux_end_program("subview", run_command(argc, argv));
}
