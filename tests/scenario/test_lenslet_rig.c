// SPDX-License-Identifier: Apache-2.0
// A multiplexed sensor from its calibration to its reconstruction: isolated pictures of a simulated
// scene make a rig, and a run with that rig is compared with one with the true one.
#include <stdio.h>

#include "calib/solve/structure.h"
#include "tests/common/isolated.h"
#include "tests/common/test.h"
#include "tests/common/world.h"
#include "tools/calibrate/calibrate.h"
#include "tools/common/coverage.h"

#define SPEC "room,rig=multiplexed,size=360x360,grid=3x3"

static isolated set;
static world w;

typedef struct {
  double held_out, measured; // mean PSNR: of views that were not taken, of the sensor's own
                             // pictures
} quality;

static quality reconstruct(const sv_rig *rig) {
  quality q;
  world_open_well(&w, SPEC, 3, ~0u, 2);
  if (rig) w.cfg.rig = rig;
  w.cfg.train.n_gaussians = 3000;
  w.cfg.train.region_px = 96;
  w.cfg.steps = 400;
  world_run_well(&w);
  q.held_out = world_heldout_psnr(&w, 8);
  assert_int_equal(sv_driver_training_psnr(&w.app.trainer, &q.measured), SV_OK);
  world_close(&w);
  return q;
}

// The calibration's world is its first lens's: the simulator's rig has its place elsewhere.
static void move_rig(sv_rig *rig, const sv_rig *truth) {
  for (int i = 0; i < rig->n_sub_views; i++)
    rig->sub_views[i].cam_from_rig =
        sv_pose_mul(&rig->sub_views[i].cam_from_rig, &truth->sub_views[0].cam_from_rig);
}

TEST(test_reconstruction) {
  static uint8_t block[1 << 20], room[1 << 20];
  if (!sv_structure_available()) {
    printf("skip  this build has no OpenCV to match pictures with (libopencv-dev)\n");
    skip();
  }
  isolated_open(&set, SPEC, true, 3);
  isolated_scene(&set, 3);
  const sv_rig *truth = &set.sim.rig;
  double a[3], b[3];
  sv_pose_centre(a, &truth->sub_views[0].cam_from_rig);
  sv_pose_centre(b, &truth->sub_views[1].cam_from_rig);
  sv_sub3(a, a, b);
  cal_options o = {.isolated = set.isolated,
                   .white = set.white,
                   .out = set.out,
                   .dark = -1,
                   .threads = 2,
                   .spacing_m = -1,
                   .focal_px = -1,
                   .pitch_m = sv_norm3(a),
                   .is_quiet = true};
  assert_int_equal(cal_cmd_lenslets(&o), CAL_EXIT_OK);
  sv_rig rig;
  sv_arena arena = sv_arena_make(block, sizeof block), scratch = sv_arena_make(room, sizeof room);
  isolated_read_rig(&set, &rig, &arena, &scratch);
  isolated_errors e = isolated_compare(&rig, truth);
  move_rig(&rig, truth);
  quality with_truth = reconstruct(NULL), with_calibration = reconstruct(&rig);
  for (int i = 0; i < rig.n_sub_views; i++) rig.sub_views[i].model.p[2] += i % 2 ? 5 : -5;
  quality with_errors = reconstruct(&rig);
  print_message(
      "directions to %.3f degrees; held-out and measured PSNR %.2f and %.2f dB with the true rig, %.2f and "
      "%.2f dB with the calibrated one, %.2f and %.2f dB with lenses 5 px off\n",
      e.rotation_deg, with_truth.held_out, with_truth.measured, with_calibration.held_out,
      with_calibration.measured, with_errors.held_out, with_errors.measured);
  assert_true(with_truth.held_out > 20);
  // The sharper the model, the more a remaining error of 0.02 degrees costs: 0.7 dB of 28.
  assert_true(with_calibration.held_out > with_truth.held_out - 1.0);
  assert_true(with_calibration.measured > with_truth.measured - 0.5);
  assert_true(with_errors.measured < with_truth.measured - 0.5); // it would be noticed
  sv_coverage_free(&rig);
  isolated_close(&set);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_reconstruction)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
