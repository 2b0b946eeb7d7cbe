// SPDX-License-Identifier: Apache-2.0
// Runs on a moving scene: a clip, and live, exposure by exposure, both on virtual clocks.
#include <stdio.h>
#include <string.h>

#include "src/base/mathx.h"
#include "tests/common/test.h"
#include "tests/common/world.h"

#define SPEC  "moving,rig=stereo,size=96x72,arc=0,fps=8"
#define STEPS 500

static world w;

static void open_world(int n_exposures, int n_threads) {
  world_open_well(&w, SPEC, n_exposures, ~0u, n_threads);
  w.cfg.train.n_gaussians = 1200;
  w.cfg.train.sh_degree = 0;
  w.cfg.steps = STEPS;
}

TEST(test_clip_beats_still) {
  double psnr[2];
  uint64_t digest[2];
  for (int i = 0; i < 2; i++) {
    open_world(10, 2);
    w.cfg.is_dynamic = i;
    world_run_well(&w);
    psnr[i] = world_training_psnr(&w);
    assert_true((world_find(&w, "motion.bin") != NULL) == (i == 1));
    digest[0] = world_digest(&w);
    world_close(&w);
    world_forget_files(&w);
  }
  open_world(10, 1);
  w.cfg.is_dynamic = true;
  world_run_well(&w);
  digest[1] = world_digest(&w);
  world_close(&w);
  world_forget_files(&w);
  print_message("clip: %.2f dB, taken as still %.2f dB\n", psnr[1], psnr[0]);
  assert_true(psnr[1] > psnr[0] + 1.5);
  assert_true(digest[0] == digest[1]); // one thread or two
}

// Every exposure gets its time, what comes meanwhile is left out and counted, and the memory stays
// what it was.
TEST(test_live) {
  open_world(3, 2);
  w.cfg.is_dynamic = w.cfg.is_continuous = true;
  w.cfg.exposure_s = 0.3;
  w.cfg.steps = 900;
  assert_ok(world_init(&w), &w.err);
  size_t high = w.arena.high_bytes;
  if (sv_app_run(&w.app, &w.err) < 0) fail_msg("%s", w.err.text);
  assert_true(w.arena.high_bytes == high && w.arena.is_sealed);
  sv_ledger l = sv_sync_ledger_sum(&w.app.queue.sync);
  print_message("live: %d replaced, PSNR %.2f dB; %d frames captured, %d dropped\n",
                (int)w.app.exposures.n_replaced, w.app.moving.psnr_sum / (double)w.app.moving.n_scored,
                (int)l.captured, (int)sv_ledger_dropped(&l));
  assert_true(sv_ledger_is_exact(&l) && sv_ledger_dropped(&l) > 0);
  assert_true(w.app.exposures.n_replaced >= 5 && w.app.moving.n_scored == w.app.exposures.n_replaced);
  assert_int_equal(world_stats(&w).n_gaussians, 1200);
  assert_true(w.app.moving.psnr_sum / (double)w.app.moving.n_scored > 25);
  assert_true(world_find(&w, "motion.bin") != NULL);
  world_close(&w);
  world_forget_files(&w);
}

// Of slot i of one block of 16 Gaussians.
static float length_of_quaternion(const float *block, int i) {
  float sum = 0;
  for (int k = 0; k < 4; k++) sum += block[16 * (SV_ROW_QUAT + k) + i] * block[16 * (SV_ROW_QUAT + k) + i];
  return sqrtf(sum);
}

// A quaternion's length has no effect.
static void normalize_quaternions(float *block) {
  for (int i = 0; i < 16; i++) {
    const float len = length_of_quaternion(block, i);
    for (int k = 0; k < 4; k++) block[16 * (SV_ROW_QUAT + k) + i] /= len;
  }
}

// Moving on to another time changes nothing of what is drawn.
TEST(test_advance) {
  static _Alignas(64) unsigned char block[1 << 20];
  sv_arena a = sv_arena_make(block, sizeof block);
  sv_kernels k;
  sv_gaussians g;
  sv_motion mo;
  sv_pool pool = sv_pool_serial();
  sv_rng rng = sv_rng_make(2, 2);
  float before[16 * 14];
  sv_motion_cfg c = {.functions = SV_MOTION_POWERS, .n_pos = 3, .n_rot = 2, .n_colour = 1, .t0 = 4.0f};
  sv_kernels_init(&k, ~0u);
  assert_int_equal(sv_gaussians_init(&g, 16, 0, &a), SV_OK);
  assert_int_equal(sv_motion_init(&mo, &c, &g, &a), SV_OK);
  sv_motion_reset(&mo, 16);
  for (int i = 0; i < 16 * g.n_rows; i++) g.param[i] = sv_rng_f(&rng);
  for (int i = 0; i < 16; i++)
    for (int r = SV_MROW_FUNCTIONS; r < mo.n_rows; r++) *sv_motion_row(&mo, i, r) = sv_rng_f(&rng) - 0.5f;
  sv_motion_at(&mo, &(sv_compute){&k, &pool}, &g, 4.4f);
  normalize_quaternions(mo.moved);
  for (int i = 0; i < 16 * 14; i++) before[i] = g.moved[i];
  sv_motion_advance(&mo, &g, 5.5f);
  sv_motion_at(&mo, &(sv_compute){&k, &pool}, &g, 4.4f);
  normalize_quaternions(mo.moved);
  for (int i = 0; i < 16 * 14; i++) assert_true(fabsf(g.moved[i] - before[i]) < 1e-4f);
  for (int i = 0; i < 16; i++) assert_true(fabsf(length_of_quaternion(g.param, i) - 1) < 1e-6f);
}

// A long run ends with what a short one ends with: no schedule cools down or begins late, and no
// Gaussian is lost (make soak-sim has 10,000 exposures).
TEST(test_steady_state) {
  const uint32_t steps[2] = {2000, 16000};
  double psnr[2];
  for (int i = 0; i < 2; i++) {
    open_world(4, 2);
    w.cfg.is_dynamic = w.cfg.is_continuous = true;
    w.cfg.exposure_s = 0.12;
    w.cfg.steps = steps[i];
    world_run_well(&w);
    psnr[i] = w.app.moving.psnr_late;
    print_message("%u steps, %d exposures: %.2f dB, usually %.2f dB\n", steps[i], (int)w.app.moving.n_scored,
                  psnr[i], w.app.moving.psnr_usual);
    assert_true(psnr[i] <= w.app.moving.psnr_usual && !sv_app_has_quality_fallen(&w.app.moving));
    world_close(&w);
    world_forget_files(&w);
  }
  assert_true(psnr[1] > psnr[0] - 1);
}

TEST(test_fall_of_quality) {
  sv_app_moving m = {.n_scored = 200, .psnr_late = 30, .psnr_usual = 32.9};
  assert_false(sv_app_has_quality_fallen(&m));
  m.psnr_usual = 33.1;
  assert_true(sv_app_has_quality_fallen(&m));
  m.n_scored = 50; // nothing is usual yet
  assert_false(sv_app_has_quality_fallen(&m));
}

// What lies in the block from a run before is in no file of this one.
TEST(test_block_of_before) {
  static uint8_t first[4 << 20];
  size_t n_first = 0;
  for (int i = 0; i < 2; i++) {
    open_world(4, 1);
    w.cfg.is_dynamic = true;
    w.cfg.steps = 40;
    memset(w.arena.base + w.arena.used_bytes, i ? 0xa5 : 0, w.arena.cap_bytes - w.arena.used_bytes);
    world_run_well(&w);
    const world_file *f = world_find(&w, "checkpoint.bin");
    assert_true(f->bytes <= sizeof first);
    if (i == 0) memcpy(first, f->data, n_first = f->bytes);
    assert_int_equal(f->bytes, n_first);
    assert_memory_equal(f->data, first, n_first);
    world_close(&w);
    world_forget_files(&w);
  }
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_clip_beats_still), cmocka_unit_test(test_live),
      cmocka_unit_test(test_steady_state),     cmocka_unit_test(test_fall_of_quality),
      cmocka_unit_test(test_block_of_before),  cmocka_unit_test(test_advance)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
