// SPDX-License-Identifier: Apache-2.0
// Moving scenes: what is learnt of motion, who is found to move, and what is saved of it.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "src/deform/deform_file.h"
#include "src/train/checkpoint.h"
#include "tests/common/moving_scene.h"

#define N_STEPS    600
#define N_GAUSS    500
#define HELD_OUT   3
#define BLOCK_SIZE (96u << 20)

static _Alignas(64) unsigned char block[BLOCK_SIZE], other[BLOCK_SIZE];
static unsigned char file[8 << 20];
static moving_scene scene;
static sv_trainer trainer, second;
static sv_kernels kernels;
static sv_pool pool;

static int setup(void **state) {
  (void)state;
  moving_scene_make(&scene, block, sizeof block);
  sv_kernels_init(&kernels, ~0u);
  pool = sv_pool_serial();
  return 0;
}

static void train(sv_trainer *t, int from, int to) {
  for (int i = from; i < to; i++) assert_true(sv_train_step(t, (float)i / N_STEPS, NULL) >= 0);
}

static void learn(sv_deform_kind kind, double least_psnr, double least_gain) {
  sv_train_cfg c = moving_scene_cfg(kind, N_GAUSS, N_STEPS);
  assert_true(moving_scene_start(&scene, &trainer, &c, &kernels, &pool, HELD_OUT, block, sizeof block));
  train(&trainer, 0, N_STEPS);
  int n_moving = sv_deform_n_moving(&trainer.deform);
  double seen = moving_scene_psnr(&scene, &trainer, 0, false),
         held = moving_scene_psnr(&scene, &trainer, HELD_OUT, false),
         still = moving_scene_psnr(&scene, &trainer, 0, true);
  print_message("kind %d: %d of %d move; time 0 %.2f dB (%.2f without motion), held-out time %.2f dB\n",
                (int)kind, n_moving, N_GAUSS, seen, still, held);
  assert_true(n_moving > 10 && n_moving < 4 * N_GAUSS / 5); // the wall has been found to be still
  assert_true(seen > least_psnr && held > least_psnr - 3);
  assert_true(seen > still + least_gain);
}

// The same bits come out there, which the golden digests see to.
static void skip_where_emulated(void) {
  const char *emulator = getenv("SV_EMULATE");
  if (emulator && *emulator) {
    print_message("skip hundreds of steps: they take minutes under emulation\n");
    skip();
  }
}

static void test_clip_learns(void **state) {
  (void)state;
  skip_where_emulated();
  learn(SV_DEFORM_CLIP, 26, 2);
}
static void test_field_learns(void **state) {
  (void)state;
  skip_where_emulated();
  learn(SV_DEFORM_FIELD, 24, 1);
}

// Who does not move is drawn from the stored values themselves.
static void test_still_is_still(void **state) {
  (void)state;
  skip_where_emulated();
  sv_train_cfg c = moving_scene_cfg(SV_DEFORM_CLIP, N_GAUSS, N_STEPS);
  assert_true(moving_scene_start(&scene, &trainer, &c, &kernels, &pool, -1, block, sizeof block));
  train(&trainer, 0, 200);
  sv_train_sort_moving(&trainer);
  sv_train_set_time(&trainer, 0.77f);
  int n = sv_deform_n_moving(&trainer.deform), end = (n + 15) / 16 * 16;
  for (int i = n; i < end; i++) // those that share a block with moving ones
    for (int r = 0; r < trainer.g.n_rows; r++) {
      long at = sv_gaussians_at(&trainer.g, i, r) - trainer.g.param;
      assert_true(trainer.g.moved[at] == trainer.g.param[at]);
    }
  for (int i = 0; i < N_GAUSS; i++) assert_int_equal(trainer.is_moving[i] != 0, i < n);
}

typedef struct {
  size_t n;
} mem_sink;
static sv_status append(void *self, const void *data, size_t bytes, sv_err *err) {
  mem_sink *m = self;
  if (m->n + bytes > sizeof file) return sv_fail(err, SV_E_FULL, "full");
  memcpy(file + m->n, data, bytes);
  m->n += bytes;
  return SV_OK;
}

static void resume(sv_deform_kind kind) {
  sv_train_cfg c = moving_scene_cfg(kind, N_GAUSS, N_STEPS);
  mem_sink m = {0};
  sv_err err;
  assert_true(moving_scene_start(&scene, &trainer, &c, &kernels, &pool, -1, block, sizeof block));
  train(&trainer, 0, 90);
  assert_int_equal(sv_checkpoint_write(&trainer, (sv_sink){&m, append}, &err), SV_OK);
  assert_true(m.n <= sv_checkpoint_bytes(&trainer));
  assert_true(moving_scene_start(&scene, &second, &c, &kernels, &pool, -1, other, sizeof other));
  assert_int_equal(sv_checkpoint_read(&second, "memory", file, m.n, &err), SV_OK);
  train(&trainer, 90, 130);
  train(&second, 90, 130);
  assert_true(sv_train_digest(&trainer) == sv_train_digest(&second));
  c.dynamic.kind = SV_DEFORM_NONE; // a still run does not take it
  assert_true(moving_scene_start(&scene, &second, &c, &kernels, &pool, -1, other, sizeof other));
  assert_int_equal(sv_checkpoint_read(&second, "memory", file, m.n, &err), SV_E_RANGE);
}

static void test_resume(void **state) {
  (void)state;
  skip_where_emulated();
  resume(SV_DEFORM_CLIP);
  resume(SV_DEFORM_FIELD);
}

static void round_trip(sv_deform_kind kind) {
  sv_train_cfg c = moving_scene_cfg(kind, N_GAUSS, N_STEPS);
  mem_sink m = {0};
  sv_err err;
  sv_sections r;
  sv_deform_head h;
  sv_deform d;
  assert_true(moving_scene_start(&scene, &trainer, &c, &kernels, &pool, -1, block, sizeof block));
  train(&trainer, 0, 120);
  assert_int_equal(sv_deform_write(&trainer.deform, &trainer.g, (sv_sink){&m, append}, &err), SV_OK);
  assert_int_equal(sv_deform_open(&r, &h, "memory", file, m.n, &err), SV_OK);
  sv_arena a = sv_arena_make(other, sizeof other);
  assert_int_equal(sv_deform_read(&d, &r, &h, &trainer.g, 1, &a, &err), SV_OK);
  sv_gaussians g = trainer.g;
  sv_train_set_time(&trainer, 0.4f);
  sv_deform_at(&d, &kernels, &pool, &g, 0.4f);
  assert_int_equal(g.n_moved, trainer.g.n_moved);
  size_t n = (size_t)(g.n_moved + 15) / 16 * 16 * (size_t)g.n_rows * sizeof(float);
  assert_memory_equal(g.moved, trainer.g.moved, n);
  trainer.g.param[0] += 1.0f; // another model
  a = sv_arena_make(other, sizeof other);
  assert_int_equal(sv_deform_read(&d, &r, &h, &trainer.g, 1, &a, &err), SV_E_RANGE);
  file[m.n / 2] ^= 1;
  assert_int_equal(sv_deform_open(&r, &h, "memory", file, m.n, &err), SV_E_CORRUPT);
}

static void test_motion_file(void **state) {
  (void)state;
  round_trip(SV_DEFORM_CLIP);
  round_trip(SV_DEFORM_FIELD);
}

// One byte short is refused, the exact size is enough; forms that do not go together are refused with a sentence.
static void test_memory(void **state) {
  (void)state;
  for (int kind = SV_DEFORM_CLIP; kind <= SV_DEFORM_FIELD; kind++) {
    sv_train_cfg c = moving_scene_cfg((sv_deform_kind)kind, N_GAUSS, N_STEPS);
    c.n_threads = 1;
    size_t n = sv_trainer_bytes(&c);
    sv_err err;
    assert_true(n > 0);
    for (size_t less = 0; less < 2; less++) {
      sv_arena a = sv_arena_make(block, n - less);
      assert_int_equal(sv_trainer_init(&trainer, &c, &kernels, &pool, &a, &err), less ? SV_E_NOMEM : SV_OK);
    }
    c.n_unseen = 1;
    sv_arena a = sv_arena_make(block, sizeof block);
    assert_int_equal(sv_trainer_init(&trainer, &c, &kernels, &pool, &a, &err), SV_E_UNSUPPORTED);
  }
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_clip_learns),    cmocka_unit_test(test_field_learns),
      cmocka_unit_test(test_still_is_still), cmocka_unit_test(test_resume),
      cmocka_unit_test(test_motion_file),    cmocka_unit_test(test_memory),
  };
  return cmocka_run_group_tests(tests, setup, NULL);
}
