// SPDX-License-Identifier: Apache-2.0
// checkpoint.bin into a small trainer, as it is and with its checksums made right.
#include <math.h>

#include "src/train/checkpoint.h"
#include "tests/fuzz/blob.h"
#include "tests/fuzz/fuzz.h"

enum { W = 32, H = 24, N = 20 };

static _Alignas(64) uint8_t block[16 << 20];
static uint8_t px[H * W * 3];
static sv_trainer trainer;

static void make(void) {
  static bool is_made;
  static sv_kernels k;
  static sv_pool pool;
  sv_err err;
  if (is_made) return;
  is_made = true;
  sv_arena a = sv_arena_make(block, sizeof block);
  sv_kernels_init(&k, 0);
  pool = sv_pool_serial();
  sv_train_cfg cfg = sv_train_defaults();
  cfg.n_gaussians = N;
  cfg.cap_views = 2;
  cfg.cap_width_px = W;
  cfg.cap_height_px = H;
  sv_arena scratch = sv_arena_sub(&a, sv_init_scratch_bytes(N, 0) + SV_ARENA_ALIGN);
  FUZZ_CHECK(sv_trainer_init(&trainer, &cfg, (sv_compute){&k, &pool}, &a, &err) == SV_OK);
  sv_pose pose = sv_pose_identity();
  pose.t[2] = 4;
  const sv_view view = sv_view_make(W, H, (const double[]){30, 30, W / 2.0, H / 2.0}, &pose);
  const sv_image_u8 im = {px, W, H, 3, W * 3};
  for (int i = 0; i < 2; i++) FUZZ_CHECK(sv_train_add_view(&trainer, &view, &im, &err) == SV_OK);
  const sv_init_cfg init = {
      .kind = SV_INIT_SPHERE, .radius = 1, .opacity = 0.3f, .scale_factor = 1, .seed = 1};
  FUZZ_CHECK(sv_train_start(&trainer, &init, NULL, 0, &scratch) == SV_OK);
}

size_t fuzz_seed(int i, uint8_t *buf, size_t cap) {
  blob m = {buf, 0, cap};
  sv_step_stats st;
  make();
  if (i > 1) return 0;
  if (i) FUZZ_CHECK(sv_train_step(&trainer, 0.1f, &st) == SV_OK);
  return sv_checkpoint_write(&trainer, (sv_sink){&m, blob_write}, NULL) == SV_OK ? m.n : 0;
}

static void read_one(const uint8_t *data, size_t bytes) {
  static uint8_t out[1 << 16];
  sv_err err = {0};
  const sv_status s = sv_checkpoint_read(&trainer, "f", data, bytes, &err);
  FUZZ_CHECK(s == SV_OK || (s < 0 && err.text[0]));
  if (s != SV_OK) return;
  // What was read can be written again, unless it is not finite.
  blob m = {out, 0, sizeof out};
  const sv_status w = sv_checkpoint_write(&trainer, (sv_sink){&m, blob_write}, &err);
  FUZZ_CHECK(w == SV_OK || w == SV_E_RANGE);
  sv_step_stats st;
  if (w == SV_OK) FUZZ_CHECK(sv_train_step(&trainer, 0.2f, &st) <= SV_OK);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t bytes) {
  static uint8_t sealed[1 << 16];
  make();
  read_one(data, bytes);
  if (bytes > sizeof sealed) return 0;
  if (bytes) memcpy(sealed, data, bytes);
  blob_seal(sealed, bytes);
  read_one(sealed, bytes);
  return 0;
}
