// SPDX-License-Identifier: Apache-2.0
// Runs on pictures of 16 bits, on the simulator with noise: brackets of exposures of a scene with
// more light than the sensor's range, against the same frames of 8 bits; the same digest for any
// threads and kernels; memory; what is refused.
#include <string.h>

#include "tests/common/test.h"
#include "tests/common/world.h"

#define USUAL  "textured,rig=stereo,size=128x96,exposures=6,noise=read:1e-6:shot:1e-4"
#define BRIGHT USUAL ",light=8,bracket=0.03"
#define DARK   "textured,rig=stereo,size=128x96,exposures=6,noise=read:1e-9:shot:1e-6,light=0.05"

static world w;

static void open_run(const char *spec, bool is_deep, uint32_t isa_mask, int n_threads) {
  char text[200];
  sv_fmt(text, sizeof text, "%s%s", spec, is_deep ? ",depth=16" : "");
  world_open_well(&w, text, 6, isa_mask, n_threads);
  w.cfg.train.n_gaussians = 2000;
  w.cfg.steps = 500;
  w.cfg.is_deep = is_deep;
}

static double psnr_of(const char *spec, bool is_deep) {
  open_run(spec, is_deep, ~0u, 2);
  world_run_well(&w);
  const double psnr = world_heldout_psnr(&w, 6);
  world_close(&w);
  world_forget_files(&w);
  return psnr;
}

TEST(test_high_range) {
  const double bright8 = psnr_of(BRIGHT, false), bright16 = psnr_of(BRIGHT, true),
               dark8 = psnr_of(DARK, false), dark16 = psnr_of(DARK, true), usual8 = psnr_of(USUAL, false),
               usual16 = psnr_of(USUAL, true);
  print_message("8 times the range %.2f dB in 8 bits, %.2f dB in 16; a dark scene %.2f dB, %.2f dB; as usual "
                "%.2f dB, %.2f dB\n",
                bright8, bright16, dark8, dark16, usual8, usual16);
  assert_true(bright16 > bright8 + 5 && dark16 > dark8 + 0.5 && usual16 > usual8 - 1);
}

static uint64_t digest_of(uint32_t isa_mask, int n_threads) {
  open_run(BRIGHT, true, isa_mask, n_threads);
  w.cfg.steps = 60;
  world_run_well(&w);
  const uint64_t digest = world_digest(&w);
  world_close(&w);
  world_forget_files(&w);
  return digest;
}

TEST(test_digest) {
  const uint64_t one = digest_of(~0u, 1);
  assert_true(digest_of(~0u, 2) == one);
  assert_true(digest_of(SV_ISA_BIT(SV_ISA_REF), 2) == one);
  assert_true(digest_of(sv_isa_only(SV_ISA_AVX2), 2) == one);
}

// Six bytes more a pixel, and the planes in which renderings are compared.
TEST(test_memory) {
  size_t bytes[2];
  for (int i = 0; i < 2; i++) {
    open_run(USUAL, i == 1, ~0u, 1);
    bytes[i] = world_app_bytes(&w);
    world_close(&w);
  }
  const size_t pictures = (size_t)6 * 2 * 128 * 96 * 6;
  assert_true(bytes[1] > bytes[0] + pictures && bytes[1] < bytes[0] + pictures + (1u << 20));
}

// Runs to the end, stops on the way, or goes on, with so much of the exposure time.
static double part_of(int stop_at, bool is_resume, double share, uint64_t *digest) {
  double psnr = 0;
  open_run(USUAL ",light=0.99", true, ~0u, 1);
  w.stop_at_step = (uint32_t)stop_at;
  w.cfg.is_resume = is_resume;
  for (int i = 0; i < 2; i++) w.sim.exposure[i] = share;
  assert_int_equal(world_run(&w), stop_at ? SV_E_INTERRUPTED : SV_OK);
  if (!stop_at) {
    for (int i = 0; i < 2; i++) w.sim.exposure[i] = 1;
    psnr = world_heldout_psnr(&w, 6);
    *digest = world_digest(&w);
  }
  world_close(&w);
  return psnr;
}

// A run that goes on counts light as the one before it, also when its pictures are darker.
TEST(test_resume) {
  uint64_t whole, resumed, darker;
  const double psnr = part_of(0, false, 1, &whole);
  world_forget_files(&w);
  (void)part_of(400, false, 1, NULL);
  (void)part_of(0, true, 1, &resumed);
  assert_true(resumed == whole);
  world_forget_files(&w);
  (void)part_of(400, false, 1, NULL);
  const double with_darker = part_of(0, true, 0.7, &darker);
  print_message("whole %.2f dB; the last fifth with 70 %% of the exposure time %.2f dB\n", psnr, with_darker);
  assert_true(darker != whole && with_darker > psnr - 0.6);
  open_run(USUAL ",light=0.99", false, ~0u, 1);
  w.cfg.is_resume = true;
  w.cfg.source_name = USUAL ",light=0.99,depth=16";
  assert_int_equal(world_run(&w), SV_E_RANGE);
  assert_contains(w.err.text, "made with --depth 16");
  world_close(&w);
  world_forget_files(&w);
}

TEST(test_refused) {
  open_run(USUAL, false, ~0u, 1);
  w.cfg.is_deep = true;
  assert_int_equal(world_init(&w), SV_E_UNSUPPORTED);
  assert_non_null(strstr(w.err.text, "rgb8; 16 bits a value come from raw frames"));
  world_close(&w);
  open_run(USUAL, true, ~0u, 1);
  w.cfg.is_dynamic = true;
  assert_int_equal(world_init(&w), SV_E_UNSUPPORTED);
  assert_non_null(strstr(w.err.text, "16 bits a value are for still scenes"));
  world_close(&w);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_high_range), cmocka_unit_test(test_digest),
                                     cmocka_unit_test(test_memory), cmocka_unit_test(test_resume),
                                     cmocka_unit_test(test_refused)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
