// SPDX-License-Identifier: Apache-2.0
// Moving scenes: what is learnt of motion, who is found to move, and what is saved of it.
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "src/deform/deform_file.h"
#include "src/train/checkpoint.h"
#include "src/train/objective.h"
#include "src/dynamic/patch.h"
#include "src/dynamic/curriculum.h"
#include "src/dynamic/search.h"
#include "src/dynamic/update.h"
#include "src/train/step.h"
#include "tests/common/moving_scene.h"
#include "tests/common/test.h"

#define N_STEPS    600
#define N_GAUSS    500
#define HELD_OUT   3
#define BLOCK_SIZE (96u << 20)

static _Alignas(64) unsigned char block[BLOCK_SIZE], other[BLOCK_SIZE];
static unsigned char file[8 << 20];
static moving_scene scene;
static sv_trainer trainer, second;
static sv_dynamic dynamic, second_dynamic;
static sv_kernels kernels;
static sv_pool pool;

FIXTURE(setup) {
  moving_scene_make(&scene, block, sizeof block);
  sv_kernels_init(&kernels, ~0u);
  pool = sv_pool_serial();
  return 0;
}

static void train(sv_trainer *t, int from, int to) {
  for (int i = from; i < to; i++) assert_true(sv_train_step(t, (float)i / N_STEPS, NULL) >= 0);
}

static void learn(sv_deform_kind kind, float clip, double least_psnr, double least_gain) {
  moving_scene_settings c = moving_scene_cfg(kind, N_GAUSS, N_STEPS);
  c.dynamic.distil_at = clip;
  sv_dynamic_set_times(&c.dynamic, N_STEPS, MS_TIMES - 1);
  c.held_out = HELD_OUT;
  assert_true(moving_scene_start(&scene, &trainer, &dynamic, &c, (sv_compute){&kernels, &pool},
                                 sv_arena_make(block, sizeof block)));
  train(&trainer, 0, N_STEPS);
  int n_moving = sv_deform_n_moving(&dynamic.deform);
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
  if (is_emulated()) {
    print_message("skip hundreds of steps: they take minutes under emulation\n");
    skip();
  }
}

TEST(test_clip_learns) {
  skip_where_emulated();
  learn(SV_DEFORM_CLIP, 0, 26, 2);
}
TEST(test_field_learns) {
  skip_where_emulated();
  learn(SV_DEFORM_FIELD, 0, 26.5, 1);
  learn(SV_DEFORM_FIELD, 0.33f, 24.0, 1); // a per-Gaussian model of 200 steps is a poor teacher
}

// The number of points along time follows the data: smoothness alone would hold points without
// images. In longer runs the temporal curriculum is slower, and the last learning rates are lower
// and never above the first ones.
TEST(test_field_times) {
  static const int n[][2] = {{1, 4}, {19, 19}, {400, 150}}; // times, points
  sv_dynamic_cfg c = sv_dynamic_defaults();
  for (int i = 0; i < 3; i++) {
    sv_dynamic_set_times(&c, 3000, n[i][0]);
    assert_int_equal(c.field.n_times, n[i][1]);
    assert_int_equal(sv_field_check(&c.field, NULL), SV_OK);
  }
  float grow = 0, end = 1;
  for (int steps = 100; steps < 30000; steps *= 3) {
    c = sv_dynamic_defaults();
    c.kind = SV_DEFORM_FIELD;
    c.distil_at = 0;
    sv_dynamic_set_times(&c, steps, 20);
    const sv_field_cfg *f = &c.field;
    assert_true(c.grow_until >= grow && c.grow_until <= c.find_until);
    assert_true(f->lr_planes_end <= end && f->lr_planes_end <= f->lr_planes &&
                f->lr_layers_end <= f->lr_layers);
    grow = c.grow_until;
    end = f->lr_planes_end;
  }
  assert_true(grow < 0.8f && end > 0);
}

// Who does not move is drawn from the stored values themselves.
TEST(test_still_is_still) {
  skip_where_emulated();
  moving_scene_settings c = moving_scene_cfg(SV_DEFORM_CLIP, N_GAUSS, N_STEPS);
  assert_true(moving_scene_start(&scene, &trainer, &dynamic, &c, (sv_compute){&kernels, &pool},
                                 sv_arena_make(block, sizeof block)));
  train(&trainer, 0, 200);
  sv_dynamic_sort(&dynamic);
  sv_train_set_time(&trainer, 0.77f);
  int n = sv_deform_n_moving(&dynamic.deform), end = (n + 15) / 16 * 16;
  for (int i = n; i < end; i++) // those that share a block with moving ones
    for (int r = 0; r < trainer.g.n_rows; r++) {
      long at = sv_gaussians_at(&trainer.g, i, r) - trainer.g.param;
      assert_true(trainer.g.moved[at] == trainer.g.param[at]);
    }
  for (int i = 0; i < N_GAUSS; i++) assert_int_equal(dynamic.is_moving[i] != 0, i < n);
}

// The temporal curriculum adds times on both sides of the middle one, at reduced size first; the
// frontier frames get half of the steps.
TEST(test_temporal_curriculum) {
  moving_scene_settings c = moving_scene_cfg(SV_DEFORM_CLIP, N_GAUSS, 4000);
  c.dynamic.from = 0.1f;
  c.dynamic.grow_until = 0.5f;
  c.dynamic.grow_start = 0.02f;
  c.dynamic.coarse_for = 0.1f;
  c.train.start_scale = 4;
  c.train.relocate_every = 0;
  c.dynamic.find_until = 0;
  assert_true(moving_scene_start(&scene, &trainer, &dynamic, &c, (sv_compute){&kernels, &pool},
                                 sv_arena_make(block, sizeof block)));
  const sv_trainer *t = &trainer;
  assert_true(sv_dynamic_has_time(&dynamic, 0.5f, 0.0f) && !sv_dynamic_has_time(&dynamic, 0.65f, 0.1f));
  assert_true(sv_dynamic_has_time(&dynamic, 0.65f, 0.22f) && sv_dynamic_has_time(&dynamic, 0.35f, 0.22f));
  assert_false(sv_dynamic_has_time(&dynamic, 0.8f, 0.22f));
  assert_int_equal(sv_dynamic_min_scale(&dynamic, 0.5f, 0.11f), 1); // was there before
  assert_int_equal(sv_dynamic_min_scale(&dynamic, 0.65f, 0.22f), 4);
  assert_int_equal(sv_dynamic_min_scale(&dynamic, 0.65f, 0.28f), 2);
  assert_int_equal(sv_dynamic_min_scale(&dynamic, 0.65f, 0.32f), 1);
  assert_int_equal(sv_dynamic_min_scale(&dynamic, 1.0f, 0.7f), 1);
  int n_front = 0;
  for (int i = 0; i < 60; i++) { // five of seven times are there, those 1/3 from the middle are new
    sv_step_stats st;
    assert_true(sv_train_step(&trainer, 0.4f, &st) >= 0);
    float away = fabsf(t->views[st.i_view].view.time - 0.5f);
    assert_true(away < 0.34f);
    n_front += away > 0.3f;
  }
  assert_in_range(n_front, 34, 54); // every second step, and two fifths of the others
}

// The long lens of a phone sees a 25th: it gets fewer turns, in which it counts less, the others
// the same.
TEST(test_long_lens) {
  moving_scene_settings c = moving_scene_cfg(SV_DEFORM_CLIP, N_GAUSS, 4000);
  static moving_scene phone;
  phone = scene;
  for (int i = 0; i < MS_TIMES; i++) {
    phone.view[i][1].fx *= 5;
    phone.view[i][1].fy *= 5;
  }
  c.train.relocate_every = 0;
  c.dynamic.find_until = 0;
  assert_true(moving_scene_start(&phone, &trainer, &dynamic, &c, (sv_compute){&kernels, &pool},
                                 sv_arena_make(block, sizeof block)));
  assert_true(fabsf(sv_dynamic_turn_share(&dynamic, &phone.view[0][1]) - 0.2f) < 1e-6f);
  assert_true(fabsf(sv_dynamic_weight(&dynamic, &phone.view[0][1]) - 0.2f) < 1e-6f);
  assert_true(sv_dynamic_turn_share(&dynamic, &phone.view[0][0]) == 1.0f);
  assert_true(sv_dynamic_weight(&dynamic, &phone.view[0][0]) == 1.0f);
  int n_long = 0;
  for (int i = 0; i < 120; i++) {
    sv_step_stats st;
    assert_true(sv_train_step(&trainer, 0.9f, &st) >= 0);
    n_long += trainer.views[st.i_view].view.i_sub_view == 1;
  }
  assert_in_range(n_long, 8, 35); // a sixth of them
  float before[4], *const at[4] = {trainer.grad.c[0], trainer.grad.c[1], trainer.grad.c[2],
                                   trainer.err_plane};
  for (int k = 0; k < 4; k++) at[k][5] = before[k] = (float)k - 1.5f;
  sv_train_weigh(&trainer, 1.0f, trainer.err_plane);
  sv_train_weigh(&trainer, 0.5f, trainer.err_plane);
  for (int k = 0; k < 4; k++) assert_true(at[k][5] == 0.5f * before[k]);
}

// The short lens shows small what another shows large: it gets fewer turns, and counts in full.
TEST(test_short_lens) {
  moving_scene_settings c = moving_scene_cfg(SV_DEFORM_CLIP, N_GAUSS, 4000);
  static moving_scene phone;
  phone = scene;
  for (int i = 0; i < MS_TIMES; i++) {
    phone.view[i][1].fx *= 0.5f;
    phone.view[i][1].fy *= 0.5f;
  }
  assert_true(moving_scene_start(&phone, &trainer, &dynamic, &c, (sv_compute){&kernels, &pool},
                                 sv_arena_make(block, sizeof block)));
  const float short_share = sv_dynamic_turn_share(&dynamic, &phone.view[0][1]);
  const float long_share = sv_dynamic_turn_share(&dynamic, &phone.view[0][0]);
  assert_true(fabsf(short_share * long_share - 0.5f) < 1e-6f); // one of them is the usual one
  assert_true(sv_dynamic_weight(&dynamic, &phone.view[0][1]) == 1.0f);
  sv_view v = phone.view[0][0]; // for patches it is reduced until its pixels are as coarse as the
                                // usual one's
  v.width_px = 800;
  v.height_px = 600;
  v.fx = 1000;
  assert_int_equal(sv_patch_scale(&v, 0), 4);
  assert_int_equal(sv_patch_scale(&v, 1000), 4);
  assert_int_equal(sv_patch_scale(&v, 3000), 2);
  assert_int_equal(sv_patch_scale(&v, 500), 4);
  v.fx = 250;
  assert_int_equal(sv_patch_scale(&v, 1000), 1);
}

// What gradients do not ask for comes to rest, the higher functions first.
TEST(test_motion_shrinks) {
  enum { N_POS = 3, N_MOTION = SV_N_MROWS(N_POS, 1, 1) };
  moving_scene_settings c = moving_scene_cfg(SV_DEFORM_CLIP, N_GAUSS, N_STEPS);
  c.dynamic.n_pos = N_POS;
  c.dynamic.n_rot = c.dynamic.n_colour = 1;
  c.dynamic.reg_pos = 0;
  assert_true(moving_scene_start(&scene, &trainer, &dynamic, &c, (sv_compute){&kernels, &pool},
                                 sv_arena_make(block, sizeof block)));
  sv_motion *mo = &dynamic.deform.motion;
  sv_deform_set_moving(&dynamic.deform, 16);
  for (int i = 0; i < 16; i++)
    for (int j = 0; j < N_POS; j++) *sv_motion_row(mo, i, SV_MROW_FUNCTIONS + 3 * j) = 0.1f;
  float lr[SV_CAP_MROWS] = {0}, grad[SV_CAP_ROWS * 16] = {0}, scratch[SV_CAP_MROWS * 16];
  lr[SV_MROW_FUNCTIONS] = 0.01f;
  sv_motion_values f = sv_motion_values_at(&mo->cfg, 0.3f);
  sv_motion_args a = sv_motion_args_of(mo, &trainer.g, 0.3f, &f);
  const sv_adam_args adam = {
      .beta1 = 0.9f, .beta2 = 0.999f, .eps = 1e-15f, .rsqrt_bias2 = 1, .lr = lr, .n_rows = N_MOTION};
  dynamic.update.args = a;
  dynamic.update.adam = adam;
  sv_dynamic_move_block(&dynamic, 0, 0x7fff, grad, scratch);
  float first = *sv_motion_row(mo, 0, SV_MROW_FUNCTIONS),
        third = *sv_motion_row(mo, 0, SV_MROW_FUNCTIONS + 6);
  // by = 0.1 x 0.01 of the length 0.1 sqrt(1 + 4 + 9), times 1 and 9
  assert_true(fabsf(first - (0.1f - 0.1f * 1e-3f / 0.374166f)) < 1e-7f);
  assert_true(fabsf(third - (0.1f - 0.9f * 1e-3f / 0.374166f)) < 1e-7f);
  assert_true(*sv_motion_row(mo, 15, SV_MROW_FUNCTIONS) == 0.1f); // was not touched
  for (int n = 0; n < 2000; n++) sv_dynamic_move_block(&dynamic, 0, 0xffff, grad, scratch);
  for (int i = 0; i < 16; i++)
    for (int r = 0; r < 3 * N_POS; r++)
      assert_true(fabsf(*sv_motion_row(mo, i, SV_MROW_FUNCTIONS + r)) < 2e-3f);
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

static void resume(sv_deform_kind kind, float clip) {
  moving_scene_settings c = moving_scene_cfg(kind, N_GAUSS, N_STEPS);
  c.dynamic.distil_at = clip;
  sv_dynamic_set_times(&c.dynamic, N_STEPS, MS_TIMES - 1);
  mem_sink m = {0};
  sv_err err;
  assert_true(moving_scene_start(&scene, &trainer, &dynamic, &c, (sv_compute){&kernels, &pool},
                                 sv_arena_make(block, sizeof block)));
  train(&trainer, 0, 90);
  const sv_motion *mo = &dynamic.deform.motion;
  if (sv_dynamic_has_clip(&dynamic.cfg)) moving_scene_plant_body(&dynamic);
  if (dynamic.deform.kind == SV_DEFORM_FIELD && mo->bodies.n > 1)
    sv_bodies_copy(&dynamic.deform.field.bodies, &mo->bodies, mo->n_moving, mo->cap);
  assert_int_equal(sv_checkpoint_write(&trainer, (sv_sink){&m, append}, &err), SV_OK);
  assert_true(m.n <= sv_checkpoint_bytes(&trainer));
  assert_true(moving_scene_start(&scene, &second, &second_dynamic, &c, (sv_compute){&kernels, &pool},
                                 sv_arena_make(other, sizeof other)));
  assert_int_equal(sv_checkpoint_read(&second, "memory", file, m.n, &err), SV_OK);
  train(&trainer, 90, 130);
  train(&second, 90, 130);
  assert_true(sv_train_digest(&trainer) == sv_train_digest(&second));
  c.dynamic.kind = SV_DEFORM_NONE; // a still run does not take it
  assert_true(moving_scene_start(&scene, &second, &second_dynamic, &c, (sv_compute){&kernels, &pool},
                                 sv_arena_make(other, sizeof other)));
  assert_int_equal(sv_checkpoint_read(&second, "memory", file, m.n, &err), SV_E_RANGE);
}

// What an older version wrote is laid out in another way.
TEST(test_old_checkpoint) {
  mem_sink m = {0};
  sv_sections_writer w;
  sv_err err;
  assert_int_equal(
      sv_sections_begin(&w, (sv_sink){&m, append}, SV_CHECKPOINT_KIND, SV_CHECKPOINT_VERSION - 1, &err),
      SV_OK);
  assert_int_equal(sv_sections_end(&w, &err), SV_OK);
  assert_int_equal(sv_checkpoint_read(&trainer, "memory", file, m.n, &err), SV_E_UNSUPPORTED);
  assert_string_equal(err.text, "memory: a checkpoint of version 7, expected 8; begin a new run");
}

TEST(test_resume) {
  skip_where_emulated();
  resume(SV_DEFORM_CLIP, 0);
  resume(SV_DEFORM_FIELD, 0);
  resume(SV_DEFORM_FIELD, 0.5f);  // while it is a clip
  resume(SV_DEFORM_FIELD, 0.18f); // which is distilled at the next steps
  resume(SV_DEFORM_FIELD, 0.14f); // while it is fitted
  resume(SV_DEFORM_FIELD, 0.1f);  // afterwards
}

static void round_trip(sv_deform_kind kind) {
  moving_scene_settings c = moving_scene_cfg(kind, N_GAUSS, N_STEPS);
  mem_sink m = {0};
  sv_err err;
  sv_deform_file f;
  sv_deform d;
  assert_true(moving_scene_start(&scene, &trainer, &dynamic, &c, (sv_compute){&kernels, &pool},
                                 sv_arena_make(block, sizeof block)));
  train(&trainer, 0, 120);
  assert_int_equal(sv_deform_write(&dynamic.deform, &trainer.g, (sv_sink){&m, append}, &err), SV_OK);
  assert_int_equal(sv_deform_open(&f, &(sv_file_data){"memory", file, m.n}, &err), SV_OK);
  sv_arena a = sv_arena_make(other, sizeof other);
  assert_int_equal(sv_deform_read(&d, &f, &trainer.g, 1, &a, &err), SV_OK);
  sv_gaussians g = trainer.g;
  sv_train_set_time(&trainer, 0.4f);
  sv_deform_at(&d, &(sv_compute){&kernels, &pool}, &g, 0.4f);
  assert_int_equal(g.n_moved, trainer.g.n_moved);
  size_t n = (size_t)(g.n_moved + 15) / 16 * 16 * (size_t)g.n_rows * sizeof(float);
  assert_memory_equal(g.moved, trainer.g.moved, n);
  trainer.g.param[0] += 1.0f; // another model
  a = sv_arena_make(other, sizeof other);
  assert_int_equal(sv_deform_read(&d, &f, &trainer.g, 1, &a, &err), SV_E_RANGE);
  file[m.n / 2] ^= 1;
  assert_int_equal(sv_deform_open(&f, &(sv_file_data){"memory", file, m.n}, &err), SV_E_CORRUPT);
}

// A few of the moving Gaussians made two bodies by hand, at three knots.
static void make_bodies(sv_bodies *b, int n_moving) {
  b->n = 3;
  for (int i = 0; i < 3; i++) assert_int_equal(sv_bodies_add_knot(b, 0.5f * (float)i), i);
  for (int body = 1; body < 3; body++)
    for (int i = 0; i < 3; i++) {
      b->centre[body][i] = 0.1f * (float)(body + i);
      *sv_bodies_knot(b, body, i) = (sv_rigid){{0.8f, 0, 0.6f, 0}, {0.1f * (float)i, 0, 0.2f * (float)body}};
    }
  for (int i = 0; i < n_moving; i++) b->of[i] = (uint8_t)(i % 3);
}

static sv_status reread(sv_deform *d, size_t bytes, sv_err *err) {
  sv_deform_file f;
  sv_arena a = sv_arena_make(other, sizeof other);
  sv_status s = sv_deform_open(&f, &(sv_file_data){"memory", file, bytes}, err);
  return s < 0 ? s : sv_deform_read(d, &f, &trainer.g, 1, &a, err);
}

static void check_refused(const sv_deform *d, const char *sentence) {
  mem_sink m = {0};
  sv_deform out;
  sv_err err;
  assert_int_equal(sv_deform_write(d, &trainer.g, (sv_sink){&m, append}, &err), SV_OK);
  assert_int_equal(reread(&out, m.n, &err), SV_E_FORMAT);
  assert_contains(err.text, sentence);
}

// What has bodies is of a later version; what has none is as it was. What no bodies are is refused.
static void check_bodies_file(sv_deform_kind kind) {
  enum { AT_VERSION = 12 };
  moving_scene_settings c = moving_scene_cfg(kind, N_GAUSS, N_STEPS);
  mem_sink m = {0}, without = {0};
  sv_deform d, *of = &dynamic.deform;
  sv_err err;
  assert_true(moving_scene_start(&scene, &trainer, &dynamic, &c, (sv_compute){&kernels, &pool},
                                 sv_arena_make(block, sizeof block)));
  train(&trainer, 0, N_STEPS);
  assert_int_equal(of->kind, kind);
  assert_true(sv_deform_n_moving(of) > 3);
  sv_bodies *b = sv_deform_bodies(of);
  sv_bodies_reset(b, trainer.g.cap);
  assert_int_equal(sv_deform_write(of, &trainer.g, (sv_sink){&without, append}, &err), SV_OK);
  assert_int_equal(file[AT_VERSION], 1);
  assert_int_equal(reread(&d, without.n, &err), SV_OK);
  assert_true(sv_deform_bodies(&d)->n < 2);
  make_bodies(b, sv_deform_n_moving(of));
  assert_int_equal(sv_deform_write(of, &trainer.g, (sv_sink){&m, append}, &err), SV_OK);
  assert_int_equal(file[AT_VERSION], 2);
  assert_int_equal(reread(&d, m.n, &err), SV_OK);
  sv_gaussians g = trainer.g;
  sv_train_set_time(&trainer, 0.3f);
  sv_deform_at(&d, &(sv_compute){&kernels, &pool}, &g, 0.3f);
  size_t n = (size_t)(g.n_moved + 15) / 16 * 16 * (size_t)g.n_rows * sizeof(float);
  assert_memory_equal(g.moved, trainer.g.moved, n);
  b->of[1] = 3;
  check_refused(of, "is of body 3");
  b->of[1] = 1;
  b->time[2] = 0.5f;
  check_refused(of, "knot 2 of its bodies is not later");
  b->time[2] = 1;
  sv_bodies_knot(b, 2, 1)->q[0] = NAN;
  check_refused(of, "knot 1 of body 2 is no rigid motion");
  sv_bodies_knot(b, 2, 1)->q[0] = 0.8f;
  b->centre[1][2] = 1e30f;
  check_refused(of, "numbers that no bodies have");
  b->centre[1][2] = 0.3f;
  *(kind == SV_DEFORM_FIELD ? of->field.param : of->motion.param) = NAN; // never gets into a file
  mem_sink none = {0};
  assert_error(sv_deform_write(of, &trainer.g, (sv_sink){&none, append}, &err), SV_E_RANGE, &err,
               "a value is not finite");
  assert_int_equal(none.n, 0);
}

TEST(test_bodies_file) {
  check_bodies_file(SV_DEFORM_CLIP);
  check_bodies_file(SV_DEFORM_FIELD);
}

TEST(test_motion_file) {
  round_trip(SV_DEFORM_CLIP);
  round_trip(SV_DEFORM_FIELD);
}

// One byte short is refused, the exact size is enough; forms that do not go together are refused
// with a sentence.
TEST(test_memory) {
  for (int kind = SV_DEFORM_CLIP; kind <= SV_DEFORM_FIELD; kind++) {
    moving_scene_settings c = moving_scene_cfg((sv_deform_kind)kind, N_GAUSS, N_STEPS);
    c.train.n_threads = 1;
    const size_t own = sv_trainer_bytes(&c.train), n = own + sv_dynamic_bytes(&c.dynamic, &c.train);
    sv_err err;
    assert_true(own > 0 && n > own);
    for (size_t less = 0; less < 2; less++) {
      sv_arena a = sv_arena_make(block, n - less);
      assert_int_equal(sv_trainer_init(&trainer, &c.train, (sv_compute){&kernels, &pool}, &a, &err), SV_OK);
      assert_int_equal(sv_dynamic_init(&dynamic, &c.dynamic, &trainer, &a, &err), less ? SV_E_NOMEM : SV_OK);
    }
    sv_arena small = sv_arena_make(block, own - 1);
    assert_int_equal(sv_trainer_init(&trainer, &c.train, (sv_compute){&kernels, &pool}, &small, &err),
                     SV_E_NOMEM);
    c.train.n_novel = 1;
    sv_arena a = sv_arena_make(block, sizeof block);
    assert_int_equal(sv_trainer_init(&trainer, &c.train, (sv_compute){&kernels, &pool}, &a, &err),
                     SV_E_UNSUPPORTED);
  }
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_clip_learns),
      cmocka_unit_test(test_field_learns),
      cmocka_unit_test(test_field_times),
      cmocka_unit_test(test_still_is_still),
      cmocka_unit_test(test_resume),
      cmocka_unit_test(test_old_checkpoint),
      cmocka_unit_test(test_temporal_curriculum),
      cmocka_unit_test(test_long_lens),
      cmocka_unit_test(test_short_lens),
      cmocka_unit_test(test_motion_shrinks),
      cmocka_unit_test(test_motion_file),
      cmocka_unit_test(test_bodies_file),
      cmocka_unit_test(test_memory),
  };
  return cmocka_run_group_tests(tests, setup, NULL);
}
