// SPDX-License-Identifier: Apache-2.0
// Training of a moving scene gives the same bits for any number of threads, for every instruction
// set with a fused multiply-add, and on every machine, in both forms of motion.
#include <stdio.h>

#include "platform/linux/linux.h"
#include "src/train/objective.h"
#include "tests/common/moving_scene.h"
#include "tests/common/test.h"

#define N_STEPS      20
#define CLIP_DIGEST  0xdcac4820afd36658ull
#define BODY_DIGEST  0x6ecb89911b57e0ecull
#define FIELD_DIGEST 0x0f3f3a2dcab15765ull
#define START_DIGEST 0x8d2ffdb302dae188ull // of a field that begins with a clip's motion

static _Alignas(64) unsigned char block[64u << 20];
static moving_scene scene;
static sv_trainer trainer;
static sv_dynamic dynamic;

static uint64_t run(sv_deform_kind kind, float clip, bool has_body, uint32_t isa_mask, int n_threads) {
  sv_linux_pool threads;
  sv_kernels k;
  sv_err err;
  sv_kernels_init(&k, isa_mask);
  assert_int_equal(sv_linux_pool_start(&threads, n_threads, 0, &err), SV_OK);
  sv_pool pool = sv_linux_pool_port(&threads);
  moving_scene_settings c = moving_scene_cfg(kind, 700, N_STEPS);
  c.train.relocate_every = 5;
  c.dynamic.distil_at = clip;
  sv_dynamic_set_times(&c.dynamic, N_STEPS, MS_TIMES - 1);
  c.train.lr.logit = 0.3f;
  c.dynamic.find_every = 0.4f; // two searches: each renders every view, which takes its time on the
                               // reference
  assert_true(moving_scene_start(&scene, &trainer, &dynamic, &c, (sv_compute){&k, &pool},
                                 sv_arena_make(block, sizeof block)));
  for (int i = 0; i < N_STEPS; i++) {
    if (has_body && i == N_STEPS / 2) moving_scene_plant_body(&dynamic);
    assert_true(sv_train_step(&trainer, (float)i / N_STEPS, NULL) >= 0);
  }
  assert_true(trainer.n_relocated > 0);
  assert_true(sv_deform_n_moving(&dynamic.deform) > 0);
  sv_linux_pool_stop(&threads);
  return sv_train_digest(&trainer);
}

static void expect(uint64_t digest, uint64_t expected, const char *what, int n) {
  if (digest != expected)
    fail_msg("%s %d: digest 0x%016llxull, expected 0x%016llxull", what, n, (unsigned long long)digest,
             (unsigned long long)expected);
}

// An emulator is asked once: it is a hundred times slower, and one thread and the reference are the
// native run's.
static void check(sv_deform_kind kind, float clip, bool has_body, uint64_t expected) {
  if (is_emulated()) {
    expect(run(kind, clip, has_body, ~0u, 2), expected, "emulated, threads", 2);
    return;
  }
  for (int n = 1; n <= 4; n *= 2) expect(run(kind, clip, has_body, ~0u, n), expected, "threads", n);
  for (int isa = 0; isa < SV_N_ISAS; isa++)
    if ((sv_cpu_isas() & SV_ISA_BIT(isa)) && isa != SV_ISA_SSE41)
      expect(run(kind, clip, has_body, sv_isa_only((sv_isa)isa), 2), expected, "instruction set", isa);
}

TEST(test_clip) { check(SV_DEFORM_CLIP, 0, false, CLIP_DIGEST); }
TEST(test_bodies) { check(SV_DEFORM_CLIP, 0, true, BODY_DIGEST); }
TEST(test_field) { check(SV_DEFORM_FIELD, 0, false, FIELD_DIGEST); }
TEST(test_field_start) { check(SV_DEFORM_FIELD, 0.7f, true, START_DIGEST); }

FIXTURE(setup) {
  moving_scene_make(&scene, block, sizeof block);
  return 0;
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_clip), cmocka_unit_test(test_bodies),
                                     cmocka_unit_test(test_field), cmocka_unit_test(test_field_start)};
  return cmocka_run_group_tests(tests, setup, NULL);
}
