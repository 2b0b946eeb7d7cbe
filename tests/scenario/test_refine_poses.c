// SPDX-License-Identifier: Apache-2.0
// Training that corrects the rig's poses: a source that is off by a third of a degree and some
// millimetres.
#include <math.h>
#include <string.h>

#include "src/base/mathx.h"
#include "src/base/rng.h"
#include "src/track/pose.h"
#include "tests/common/test.h"
#include "tests/common/world.h"

enum { N = 10 };
#define SPEC "textured,rig=stereo,size=240x180,arc=90"

static world w;

static void true_pose(sv_ns host_ns, sv_pose *rig_from_world) {
  sv_sim_rig_pose(&w.sim, host_ns, rig_from_world);
}

// Half a degree and 1 cm, at most, different in each exposure.
static sv_status wrong_pose(void *self, sv_ns host_ns, sv_pose *rig_from_world) {
  (void)self;
  double twist[6];
  true_pose(host_ns, rig_from_world);
  for (uint32_t k = 0; k < 6; k++)
    twist[k] =
        (k < 3 ? 0.009 : 0.02) * ((double)sv_hash3((uint32_t)(host_ns / 1000000), k, 5) * 0x1p-32 - 0.5);
  sv_pose r;
  sv_rodrigues(r.r, twist);
  memcpy(r.t, twist + 3, sizeof r.t);
  if (host_ns > 0) *rig_from_world = sv_pose_mul(&r, rig_from_world);
  return SV_OK;
}

typedef struct {
  double psnr, rotation_deg, place_m; // poses: root mean square after alignment
  uint64_t digest;
} outcome;

static outcome run(bool is_wrong, bool is_refining, int n_threads) {
  static uint8_t rgb[240 * 180 * 3];
  outcome o = {0};
  sv_pose found[N], truth[N];
  world_open_well(&w, SPEC, N, ~0u, n_threads);
  if (is_wrong) w.port.source.rig_pose = wrong_pose;
  w.cfg.train.n_gaussians = 2500;
  w.cfg.steps = 700;
  w.cfg.is_refining = is_refining;
  world_run_well(&w);
  for (int e = 0; e < N; e++) {
    found[e] = w.app.exposures.exposure[e].rig_from_world;
    true_pose(w.app.exposures.exposure[e].time_ns, &truth[e]);
  }
  sv_similarity q = sv_align_trajectories(truth, found, N, true),
                back = sv_align_trajectories(found, truth, N, true);
  for (int e = 0; e < N; e++) {
    sv_pose p = sv_similarity_apply(&back, &found[e]), inv = sv_pose_inv(&truth[e]),
            d = sv_pose_mul(&p, &inv);
    double v[3], a[3], b[3];
    sv_rodrigues_inv(v, d.r);
    sv_pose_centre(a, &p);
    sv_pose_centre(b, &truth[e]);
    sv_sub3(a, a, b);
    o.rotation_deg += sv_dot3(v, v) / N;
    o.place_m += sv_dot3(a, a) / N;
  }
  o.rotation_deg = sqrt(o.rotation_deg) * 180 / SV_PI;
  o.place_m = sqrt(o.place_m);
  for (int i = 0; i < 8; i++) {
    sv_view v;
    double t, mse;
    sv_sim_heldout_view(&w.sim, i, 8, &v, &t);
    sv_sim_render(&w.sim, &v, t, rgb, NULL);
    v = sv_odometry_view(&q, &v);
    assert_int_equal(sv_driver_mse(&w.app.trainer, &v, rgb, &mse), SV_OK);
    o.psnr -= 10 * log10(mse) / 8;
  }
  o.digest = world_digest(&w);
  assert_int_equal(world_find(&w, "poses.json") != NULL, is_refining);
  world_close(&w);
  world_forget_files(&w);
  return o;
}

TEST(test_gain) {
  outcome right = run(false, false, 2), wrong = run(true, false, 2), refined = run(true, true, 2);
  print_message(
      "held-out PSNR %.2f dB with the true poses; %.2f dB with wrong ones (%.3f degrees, %.1f mm), %.2f dB "
      "refined (%.3f degrees, %.1f mm)\n",
      right.psnr, wrong.psnr, wrong.rotation_deg, 1e3 * wrong.place_m, refined.psnr, refined.rotation_deg,
      1e3 * refined.place_m);
  assert_true(wrong.psnr < right.psnr - 1);
  assert_true(refined.psnr > wrong.psnr + 0.5);
  assert_true(refined.rotation_deg < wrong.rotation_deg && refined.place_m < 0.95 * wrong.place_m);
  outcome unneeded = run(false, true, 2);
  print_message("true poses refined: %.2f dB (%.3f degrees, %.1f mm)\n", unneeded.psnr, unneeded.rotation_deg,
                1e3 * unneeded.place_m);
  assert_true(unneeded.psnr > right.psnr - 1.0); // what is right stays nearly so
  outcome again = run(true, true, 1);            // for any number of threads
  assert_true(again.digest == refined.digest);
}

// The twist's gradient by differences: of a linear function of cam_from_world's twist.
TEST(test_chain) {
  sv_pose cam, rig;
  sv_rodrigues(cam.r, (double[3]){0.3, -0.5, 0.9});
  sv_rodrigues(rig.r, (double[3]){-0.8, 0.2, 0.4});
  for (int k = 0; k < 3; k++) {
    cam.t[k] = 0.4 * k - 0.3;
    rig.t[k] = 1.7 - 0.9 * k;
  }
  const double g[6] = {0.3, -1.2, 0.7, 0.9, 0.1, -0.6};
  double out[6], h = 1e-6;
  sv_pose_twist_bwd(&cam, g, out);
  sv_pose at = sv_pose_mul(&cam, &rig), back = sv_pose_inv(&at);
  for (int k = 0; k < 6; k++) {
    double value[2];
    for (int side = 0; side < 2; side++) {
      sv_pose r = rig;
      double twist[6] = {0}, v[3];
      twist[k] = side ? h : -h;
      sv_pose_twist(&r, twist);
      r = sv_pose_mul(&cam, &r);
      r = sv_pose_mul(&r, &back); // the camera's twist: to first order (omega, t)
      sv_rodrigues_inv(v, r.r);
      value[side] = sv_dot3(g, v) + sv_dot3(g + 3, r.t);
    }
    assert_true(fabs((value[1] - value[0]) / (2 * h) - out[k]) < 1e-6);
  }
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_chain), cmocka_unit_test(test_gain)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
