// SPDX-License-Identifier: Apache-2.0
// What an external prior program writes: an image, a depth map (PFM or PNG) or a disparity map. The
// first byte picks the file; its content follows.
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "platform/codec/codec.h"
#include "tests/fuzz/fuzz.h"
#include "tools/train/prior.h"

enum { W = 16, H = 16, N = 20 };

static _Alignas(64) uint8_t block[16 << 20];
static uint8_t px[H * W * 3];
static sv_trainer trainer;
static sv_prior prior;
static float map[W * H];
static sv_view view;
static lab_prior answers;
static lab_options options;

static const char *const names[] = {"answer_000.png", "answer_000_depth.pfm", "answer_000_depth.png",
                                    "answer_000_disparity.png"};

static void remove_dir(void) {
  char path[1100];
  for (int i = 0; i < 4; i++) {
    snprintf(path, sizeof path, "%s/%s", answers.folder, names[i]);
    (void)unlink(path);
  }
  (void)rmdir(answers.folder);
}

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
  cfg.has_images = true;
  const sv_prior_cfg rings = {.cap_pseudo = 3, .cap_depths = 2, .every = 2};
  sv_arena scratch = sv_arena_sub(&a, sv_init_scratch_bytes(N, 0) + SV_ARENA_ALIGN);
  FUZZ_CHECK(sv_trainer_init(&trainer, &cfg, (sv_compute){&k, &pool}, &a, &err) == SV_OK);
  FUZZ_CHECK(sv_prior_init(&prior, &rings, &trainer, &a, &err) == SV_OK);
  sv_pose pose = sv_pose_identity();
  pose.t[2] = 4;
  view = sv_view_make(W, H, (const double[]){20, 20, W / 2.0, H / 2.0}, &pose);
  const sv_image_u8 im = {px, W, H, 3, W * 3};
  for (int i = 0; i < 2; i++) FUZZ_CHECK(sv_train_add_view(&trainer, &view, &im, &err) == SV_OK);
  const sv_init_cfg init = {
      .kind = SV_INIT_SPHERE, .radius = 1, .opacity = 0.3f, .scale_factor = 1, .seed = 1};
  FUZZ_CHECK(sv_train_start(&trainer, &init, NULL, 0, &scratch) == SV_OK);
  options.prior_weight = -1;
  answers = (lab_prior){.o = &options, .trainer = &trainer, .prior = &prior, .map = map, .request = &view};
  snprintf(answers.folder, sizeof answers.folder, "%s/fuzz_answer_XXXXXX",
           access("/dev/shm", W_OK) == 0 ? "/dev/shm" : "/tmp");
  FUZZ_CHECK(mkdtemp(answers.folder) != NULL);
  atexit(remove_dir);
}

size_t fuzz_seed(int i, uint8_t *buf, size_t cap) {
  static uint8_t memory[2 << 20], rgb[H * W * 6];
  size_t n = 0;
  buf[0] = (uint8_t)i;
  if (i > 3 || cap < 8192) return 0;
  if (i == 1) {
    n = (size_t)snprintf((char *)buf + 1, 100, "Pf\n%d %d\n-1.0\n", W, H);
    for (int k = 0; k < W * H; k++) {
      const float z = 2 + (float)k / 100;
      memcpy(buf + 1 + n + sizeof z * (size_t)k, &z, sizeof z);
    }
    return 1 + n + sizeof(float) * W * H;
  }
  sv_arena a = sv_arena_make(memory, sizeof memory);
  sv_codec codec;
  const sv_codec_cfg cfg = {W, H, false};
  for (size_t k = 0; k < sizeof rgb; k++) rgb[k] = (uint8_t)(k * 5);
  const sv_picture in = {W, H, i ? W : 3 * W, i ? SV_PIX_GREY8 : SV_PIX_RGB8, rgb};
  FUZZ_CHECK(sv_codec_init(&codec, &cfg, &a) == SV_OK);
  FUZZ_CHECK(sv_codec_encode_png(&codec, &in, buf + 1, cap - 1, &n, NULL) == SV_OK);
  sv_codec_close(&codec);
  return 1 + n;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t bytes) {
  char path[1100];
  sv_err err = {0};
  if (!bytes) return 0;
  make();
  const int kind = data[0] % 4;
  snprintf(path, sizeof path, "%s/%s", answers.folder, names[kind]);
  const int fd = open(path, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
  FUZZ_CHECK(fd >= 0 && write(fd, data + 1, bytes - 1) == (ssize_t)(bytes - 1));
  close(fd);
  // A depth map without an image is one of a training view.
  const sv_status s = lab_prior_take(&answers, 0, kind ? 0 : -1, 1, &err);
  FUZZ_CHECK(s == SV_OK || (s < 0 && err.text[0]));
  unlink(path);
  return 0;
}
