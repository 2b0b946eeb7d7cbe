// SPDX-License-Identifier: Apache-2.0
// Wall-clock budgets, loose because machines are noisy: they catch a thing that became many times
// slower, not a few per cent. The figures are printed. Medians, so that one interruption does not
// count.
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "platform/codec/codec.h"
#include "tests/common/test.h"
#include "tests/common/world.h"

#define STEP_BUDGET_MS       40.0  // 20,000 Gaussians, 320x240, two threads
#define FRAME_BUDGET_MS      40.0  // one simulated frame, 320x240, one thread
#define SAVE_BUDGET_MS       400.0 // model and checkpoint of 20,000 Gaussians into memory
#define MJPEG_BUDGET_PERCENT 25.0  // of one core: three webcams

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define IS_SANITIZED 1
#else
#define IS_SANITIZED 0
#endif

static world w;

static double now_ms(void) {
  sv_clock c = sv_linux_clock();
  return sv_ns_to_ms(c.now_ns(c.self));
}

static int by_size(const void *a, const void *b) {
  double x = *(const double *)a, y = *(const double *)b;
  return (x > y) - (x < y);
}

static double median(double *x, size_t n) {
  qsort(x, n, sizeof *x, by_size);
  return x[n / 2];
}

TEST(test_step) {
  enum { N = 61 };
  double ms[N];
  world_open_well(&w, "textured,rig=stereo,size=320x240", 4, ~0u, 2);
  w.cfg.train.n_gaussians = 20000;
  w.cfg.train.start_scale = 1; // whole pictures from the start
  w.cfg.steps = 40;            // the scene takes shape
  world_run_well(&w);
  for (int i = 0; i < N; i++) {
    sv_step_stats st;
    double t = now_ms();
    assert_int_equal(sv_train_step(&w.app.trainer, 0.5f, &st), SV_OK);
    ms[i] = now_ms() - t;
  }
  double m = median(ms, N), t = now_ms();
  print_message("training step: median %.2f ms, fastest %.2f, slowest %.2f (budget %.0f)\n", m, ms[0],
                ms[N - 1], STEP_BUDGET_MS);
  assert_true(m < STEP_BUDGET_MS);
  assert_int_equal(sv_app_save_model(&w.app, &w.err), SV_OK);
  assert_int_equal(sv_app_save_checkpoint(&w.app, &w.err), SV_OK);
  t = now_ms() - t;
  print_message("model and checkpoint: %.1f ms (budget %.0f)\n", t, SAVE_BUDGET_MS);
  assert_true(t < SAVE_BUDGET_MS);
  world_close(&w);
}

TEST(test_frame) {
  enum { N = 41 };
  double ms[N];
  world_open_well(&w, "textured,rig=mono,size=320x240", 8, ~0u, 1);
  sv_source *src = &w.inner.source;
  assert_int_equal(src->start(src->self), SV_OK);
  for (int i = 0; i < N; i++) {
    sv_frame f;
    double t = now_ms();
    assert_int_equal(src->dequeue(src->self, &f, INT64_MAX), SV_OK);
    ms[i] = now_ms() - t;
    assert_int_equal(src->requeue(src->self, &f), SV_OK);
  }
  double m = median(ms, N);
  print_message("simulator frame: median %.2f ms, slowest %.2f (budget %.0f)\n", m, ms[N - 1],
                FRAME_BUDGET_MS);
  assert_true(m < FRAME_BUDGET_MS);
  world_close(&w);
}

// Motion JPEG of three webcams at 640x480 and 30 frames a second, in processor time.
TEST(test_mjpeg) {
  enum { N = 90, N_PICTURES = 6, W = 640, H = 480, CAP = 1 << 18 };
  static uint8_t rgb[W * H * 3], jpeg[N_PICTURES][CAP], block[8 << 20];
  size_t bytes[N_PICTURES], sum = 0;
  sv_codec codec;
  sv_codec_cfg cfg = {W, H, false};
  sv_arena a = sv_arena_make(block, sizeof block);
  sv_picture picture = {W, H, W * 3, SV_PIX_RGB8, rgb};
  world_open_well(&w, "textured,size=640x480", 1, ~0u, 1);
  assert_int_equal(sv_codec_init(&codec, &cfg, &a), SV_OK);
  for (int i = 0; i < N_PICTURES; i++) {
    sv_view v;
    double t;
    sv_sim_heldout_view(&w.sim, i, N_PICTURES, &v, &t);
    sv_sim_render(&w.sim, &v, t, rgb, NULL);
    for (int k = 0; k < W * H * 3; k++)
      rgb[k] = (uint8_t)(rgb[k] / 8 * 7 + (k * 2654435761u >> 28)); // a sensor's noise
    assert_int_equal(sv_codec_encode_jpeg(&codec, &picture, (sv_jpeg_options){85, false},
                                          (sv_codec_buffer){jpeg[i], CAP}, &bytes[i], NULL),
                     SV_OK);
    sum += bytes[i];
  }
  struct timespec from, to;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &from);
  for (int i = 0; i < N; i++)
    assert_int_equal(sv_codec_decode(&codec, jpeg[i % N_PICTURES], bytes[i % N_PICTURES], &picture, NULL),
                     SV_OK);
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &to);
  double ms = (double)(to.tv_sec - from.tv_sec) * 1e3 + (double)(to.tv_nsec - from.tv_nsec) * 1e-6;
  print_message(
      "motion JPEG: 90 pictures of 640x480 (%zu KiB each) in %.0f ms: %.0f %% of one core (budget %.0f)\n",
      sum / N_PICTURES / 1024, ms, ms / 10, MJPEG_BUDGET_PERCENT);
  if (!IS_SANITIZED) assert_true(ms / 10 < MJPEG_BUDGET_PERCENT);
  sv_codec_close(&codec);
  world_close(&w);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_step), cmocka_unit_test(test_frame),
                                     cmocka_unit_test(test_mjpeg)};
  const char *emulator = getenv("SV_EMULATE");
  if (IS_SANITIZED || (emulator && *emulator)) {
    printf("time says nothing about the program under a sanitizer or an emulator\n");
    return 77;
  }
  return cmocka_run_group_tests(tests, NULL, NULL);
}
