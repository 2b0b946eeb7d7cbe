// SPDX-License-Identifier: Apache-2.0
// Selftest: a few training steps on a synthetic scene and the image kernels on noise, with the
// reference and with each instruction set of this CPU, must give the same bits (SSE4.1, which has
// no fused multiply-add: nearly the same loss). Owns its results; everything else comes from the
// arena and goes back. Never needs a camera, a file or a thread.
#ifndef SV_RUN_SELFTEST_H
#define SV_RUN_SELFTEST_H

#include "src/train/train.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  sv_isa isa;
  const char *what; // "training" or "pictures"
  uint64_t digest, expected;
  double loss, expected_loss; // of the last training step
  bool is_exact, is_ok;
} sv_selftest_line;

#define SV_SELFTEST_CAP_LINES (2 * SV_N_ISAS)

typedef struct {
  sv_trainer trainer; // workspace
  int n_lines, n_failed;
  sv_selftest_line line[SV_SELFTEST_CAP_LINES];
} sv_selftest;

// Takes about 16 MiB of the arena. The line list says what was compared; n_failed counts the bad
// ones.
sv_status sv_selftest_run(sv_selftest *t, sv_arena *arena, sv_err *err) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
