// SPDX-License-Identifier: Apache-2.0
// A moving scene live, five hundred exposures long: no heap, the memory block as it was to the byte, a ledger that
// adds up, and a model that stays good.
// clang-format off
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <cmocka.h>
// clang-format on
#include <stdio.h>
#include <stdlib.h>

#include "tests/common/world.h"
#include "tests/fault/heap_count.h"

#define N_EXPOSURES 500
#define N_STEPS     6000

static world w;

static void test_live_long(void **state) {
  const char *emulator = getenv("SV_EMULATE");
  (void)state;
  if (emulator && *emulator) {
    print_message("skip thousands of steps: they take minutes under emulation\n");
    skip();
  }
  if (!world_open(&w, "moving,rig=stereo,size=64x48,arc=0,fps=20", 4, ~0u, 1)) fail_msg("%s", w.err.text);
  w.cfg.is_dynamic = w.cfg.is_live = true;
  w.cfg.exposure_s = 0.05;
  w.cfg.train.n_gaussians = 400;
  w.cfg.train.sh_degree = 0;
  w.cfg.steps = N_STEPS;
  if (world_init(&w) < 0) fail_msg("%s", w.err.text); // seals
  const size_t used = w.arena.used_bytes, high = w.arena.high_bytes;
  sv_heap_arm();
  sv_status s = sv_app_run(&w.app, &w.err);
  sv_heap_disarm();
  sv_heap_report();
  if (s < 0) fail_msg("%s", w.err.text);
  sv_ledger l = sv_sync_ledger_sum(&w.app.intake.sync);
  print_message("%d exposures, newest %.2f dB, late %.2f dB; %d of %d Gaussians move\n",
                (int)w.app.exposures.n_replaced, w.app.psnr_sum / (double)w.app.n_scored, w.app.psnr_late,
                sv_deform_n_moving(&w.app.trainer.deform), w.app.trainer.g.n);
  assert_int_equal(sv_heap_count(), 0);
  assert_true(w.arena.used_bytes == used && w.arena.high_bytes == high && w.arena.is_sealed);
  assert_true(w.app.exposures.n_replaced >= N_EXPOSURES);
  assert_true(sv_ledger_is_exact(&l));
  assert_int_equal(w.app.trainer.g.n, 400);
  assert_true(w.app.psnr_late > 20); // 13 dB is an empty picture
  world_close(&w);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_live_long)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
