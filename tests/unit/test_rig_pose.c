// SPDX-License-Identifier: Apache-2.0
// OpenGV's absolute pose of a rig: found without a start, with outliers, by cameras in different
// places.
#include <math.h>
#include <stdint.h>

#include "calib/solve/rig_pose.h"
#include "tests/common/test.h"

#define N 120

TEST(test_finds) {
  if (!sv_rig_pose_has_opengv()) {
    print_message("skipped: built without OpenGV\n");
    skip();
  }
  static sv_pose_match m[N];
  sv_rng rng = sv_rng_make(5, 5);
  sv_bundle_camera cam[2] = {{sv_pose_identity(), 500, 500, 320, 240},
                             {sv_pose_identity(), 900, 900, 320, 240}};
  double place[6] = {0, -0.1, 0.02, -0.3, 0, 0}, far[6] = {0.4, -0.9, 1.2, 1, -2, 3};
  sv_pose_twist(&cam[1].cam_from_rig, place);
  sv_pose truth = sv_pose_identity(), world;
  sv_pose_twist(&truth, far);
  world = sv_pose_inv(&truth);
  for (int i = 0; i < N; i++) {
    int c = i & 1;
    double q[3] = {(double)sv_rng_f(&rng) - 0.5, (double)sv_rng_f(&rng) - 0.5,
                   3 + 2 * (double)sv_rng_f(&rng)},
           x[3];
    for (int k = 0; k < 2; k++)
      m[i].uv_px[k] =
          (float)((k ? cam[c].cy : cam[c].cx) + cam[c].fx * q[k] / q[2]) + 0.2f * sv_rng_normal(&rng);
    sv_pose rig_from_cam = sv_pose_inv(&cam[c].cam_from_rig);
    sv_pose_apply(x, &rig_from_cam, q);
    sv_pose_apply(m[i].x, &world, x);
    m[i].i_camera = c;
    m[i].sigma_px = 1;
    if (i % 5 < 2) m[i].uv_px[i % 2] += 25;
  }
  sv_pose found;
  assert_true(sv_rig_pose_opengv(NULL, cam, m, N, 2, &found));
  sv_pose inv = sv_pose_inv(&truth), d = sv_pose_mul(&found, &inv);
  double w[3];
  sv_rodrigues_inv(w, d.r);
  print_message("off by %.4f degrees and %.2f mm\n", sv_norm3(w) * 57.29578, 1e3 * sv_norm3(d.t));
  assert_true(sv_norm3(w) * 57.29578 < 0.1 && sv_norm3(d.t) < 0.01);
  // The tracker's own search fails from so far away, and finds it with this one's help.
  sv_pose pose = sv_pose_identity();
  sv_pose_solver solver = {NULL, sv_rig_pose_opengv};
  sv_pose_problem p = {.cameras = cam, .matches = m, .n = N, .limit_px = 2, .solver = &solver};
  assert_true(sv_pose_find(&p, &pose) >= 60);
  assert_false(sv_rig_pose_opengv(NULL, cam, m, 5, 2, &found));
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_finds)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
