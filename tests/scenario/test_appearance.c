// SPDX-License-Identifier: Apache-2.0
// Runs with cameras that differ in exposure, white balance and falloff, on the simulator: measured
// on held-out views of the reference camera without falloff.
#include <string.h>

#include "tests/common/test.h"
#include "tests/common/world.h"

#define IDEAL     "textured,rig=stereo,size=128x96,exposures=6"
#define DIFFERENT ",gain=0.3,white=4500,vignetting=-0.4"
#define REAL      IDEAL DIFFERENT
#define OPEN      "field,rig=stereo,size=128x96,exposures=6"
#define DRIFT     IDEAL ",auto_exposure=0.5"

static world w;

static double psnr_of(const char *spec, sv_appearance_mode mode, int n_threads, uint64_t *digest) {
  world_open_well(&w, spec, 6, ~0u, n_threads);
  w.cfg.train.n_gaussians = 2000;
  w.cfg.steps = 500;
  w.cfg.appearance = mode;
  world_run_well(&w);
  const double psnr = world_heldout_psnr(&w, 6);
  if (digest) *digest = world_digest(&w);
  world_close(&w);
  world_forget_files(&w);
  return psnr;
}

TEST(test_cameras_that_differ) {
  uint64_t digest[2];
  const double ideal = psnr_of(IDEAL, SV_APPEARANCE_AUTO, 2, NULL),
               off = psnr_of(REAL, SV_APPEARANCE_OFF, 2, NULL),
               on = psnr_of(REAL, SV_APPEARANCE_AUTO, 2, &digest[0]);
  print_message("ideal %.2f dB; real cameras %.2f dB, with appearance %.2f dB\n", ideal, off, on);
  assert_true(off < ideal - 2 && on > ideal - 0.6);
  (void)psnr_of(REAL, SV_APPEARANCE_AUTO, 1, &digest[1]);
  assert_true(digest[0] == digest[1]); // two threads or one
}

// Depth maps of the start find too little that cameras could be compared by: training has to.
TEST(test_measured_while_training) {
  const double ideal = psnr_of(OPEN, SV_APPEARANCE_AUTO, 2, NULL),
               on = psnr_of(OPEN DIFFERENT, SV_APPEARANCE_AUTO, 2, NULL);
  print_message("open scene: ideal %.2f dB, real cameras with appearance %.2f dB\n", ideal, on);
  // What no picture shows has the mean color of pictures that vignetting and white balance changed.
  assert_true(on > ideal - 0.7);
}

TEST(test_exposure_that_drifts) {
  const double ideal = psnr_of(IDEAL, SV_APPEARANCE_AUTO, 2, NULL),
               off = psnr_of(DRIFT, SV_APPEARANCE_OFF, 2, NULL),
               on = psnr_of(DRIFT, SV_APPEARANCE_AUTO, 2, NULL);
  print_message("ideal %.2f dB; drifting exposure %.2f dB, with appearance %.2f dB\n", ideal, off, on);
  assert_true(off < ideal - 3 && on > ideal - 1);
}

// Where all cameras are alike and locked nothing is learned, and nothing changes.
TEST(test_off_by_itself) {
  uint64_t digest[2];
  (void)psnr_of(IDEAL, SV_APPEARANCE_AUTO, 2, &digest[0]);
  (void)psnr_of(IDEAL, SV_APPEARANCE_OFF, 2, &digest[1]);
  assert_true(digest[0] == digest[1]);
}

// A run that was stopped goes on with what it knew of the cameras.
TEST(test_resume) {
  uint64_t whole;
  (void)psnr_of(REAL, SV_APPEARANCE_AUTO, 1, &whole);
  for (int part = 0; part < 2; part++) {
    world_open_well(&w, REAL, 6, ~0u, 1);
    w.cfg.train.n_gaussians = 2000;
    w.cfg.steps = 500;
    w.cfg.is_resume = part == 1;
    w.stop_at_step = part == 0 ? 200 : 0;
    const sv_status s = world_run(&w);
    assert_int_equal(s, part == 0 ? SV_E_INTERRUPTED : SV_OK);
    if (part == 1) assert_true(world_digest(&w) == whole);
    world_close(&w);
  }
  world_forget_files(&w);
}

// What is learned of many exposures does not make the report too long.
TEST(test_many_exposures) {
  world_open_well(&w, "textured,rig=mono,size=32x32,exposures=1000,auto_exposure=0.5", 1000, ~0u, 1);
  w.cfg.train.n_gaussians = 200;
  w.cfg.steps = 2;
  world_run_well(&w);
  assert_ok(sv_app_save_report(&w.app, NULL, &w.err), &w.err);
  world_close(&w);
  world_forget_files(&w);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_cameras_that_differ),
                                     cmocka_unit_test(test_measured_while_training),
                                     cmocka_unit_test(test_exposure_that_drifts),
                                     cmocka_unit_test(test_off_by_itself),
                                     cmocka_unit_test(test_resume),
                                     cmocka_unit_test(test_many_exposures)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
