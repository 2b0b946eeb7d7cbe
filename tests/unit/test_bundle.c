// SPDX-License-Identifier: Apache-2.0
// Bundle adjustment of a rig: derivatives against central differences, the reduced step against a
// dense solve of the whole system, convergence, outliers, held calibration; the absolute pose;
// aligned trajectories.
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/mathx.h"
#include "src/base/rng.h"
#include "src/track/pose.h"
#include "tests/common/test.h"

#define N_POSES  4
#define N_CAMS   3
#define N_POINTS 20
#define N_DENSE  (6 * (N_POSES - 1 + N_CAMS - 1) + 3 * N_POINTS)

static uint8_t block[8 << 20];
static sv_bundle b;
static sv_pose true_pose[N_POSES], true_cam[N_CAMS];
static double true_point[N_POINTS][3];
static sv_rng rng;

static const sv_bundle_options plain = {
    .max_iterations = 50, .huber_px = 1e6, .sigma_rot_rad = 0.01, .sigma_trans_m = 0.01};

static double uniform(double lo, double hi) { return lo + (hi - lo) * (double)sv_rng_f(&rng); }

static void random_twist(double t[6], double rot, double trans) {
  for (int i = 0; i < 3; i++) {
    t[i] = uniform(-rot, rot);
    t[3 + i] = uniform(-trans, trans);
  }
}

// A rig of three cameras `base` apart that looks at points about (0, 0, 4), all seen from
// everywhere.
static void make_problem(double base, double noise_px) {
  sv_arena a = sv_arena_make(block, sizeof block);
  sv_bundle_cfg cfg = {N_POSES, N_CAMS, N_POINTS, N_POSES * N_CAMS * N_POINTS, true};
  assert_int_equal(sv_bundle_init(&b, &cfg, &a), SV_OK);
  rng = sv_rng_make(7, 1);
  b.n_poses = N_POSES;
  b.n_cameras = N_CAMS;
  b.n_points = N_POINTS;
  for (int i = 0; i < N_CAMS; i++) {
    double t[6] = {0.02 * i, -0.03 * i, 0.01, -base * i, 0.1 * base * i * i, 0};
    true_cam[i] = sv_pose_identity();
    sv_pose_twist(&true_cam[i], t);
    b.camera[i] = (sv_bundle_camera){true_cam[i], 500 + 50 * i, 510, 320, 240};
    b.calibrated[i] = true_cam[i];
  }
  for (int i = 0; i < N_POSES; i++) {
    double t[6];
    random_twist(t, 0.2, 0.5);
    true_pose[i] = sv_pose_identity();
    if (i) sv_pose_twist(&true_pose[i], t);
    b.pose[i] = true_pose[i];
    b.is_fixed[i] = i == 0;
  }
  int n = 0;
  for (int i = 0; i < N_POINTS; i++) {
    for (int k = 0; k < 3; k++) true_point[i][k] = uniform(-1, 1) + (k == 2 ? 4 : 0);
    memcpy(b.point[i], true_point[i], sizeof true_point[i]);
    b.first[i] = n;
    for (int p = 0; p < N_POSES; p++)
      for (int c = 0; c < N_CAMS; c++) {
        sv_bundle_obs o = {(int16_t)p, (int16_t)c, {0, 0}, 1.0f};
        double r[2];
        assert_true(sv_bundle_residual(&b, &o, true_point[i], r, NULL));
        for (int k = 0; k < 2; k++) o.uv_px[k] = (float)(r[k] + noise_px * (double)sv_rng_normal(&rng));
        b.obs[n++] = o;
      }
  }
  b.first[N_POINTS] = n;
}

static void disturb(double rot, double trans, bool has_cams) {
  double t[6];
  for (int i = 1; i < N_POSES; i++) {
    random_twist(t, rot, trans);
    sv_pose_twist(&b.pose[i], t);
  }
  for (int i = 1; i < N_CAMS && has_cams; i++) {
    random_twist(t, 0.1 * rot, 0.1 * trans);
    sv_pose_twist(&b.camera[i].cam_from_rig, t);
  }
  for (int i = 0; i < N_POINTS; i++)
    for (int k = 0; k < 3; k++) b.point[i][k] += uniform(-trans, trans);
}

static double pose_error(const sv_pose *p, const sv_pose *q) {
  double e = 0;
  for (int i = 0; i < 9; i++) e = fmax(e, fabs(p->r[i] - q->r[i]));
  for (int i = 0; i < 3; i++) e = fmax(e, fabs(p->t[i] - q->t[i]));
  return e;
}

// --- derivatives ---------------------------------------------------------------------------------

static void check_numeric(sv_bundle_obs *o, double x[3], const sv_bundle_jacobian *j) {
  const double h = 1e-6;
  for (int k = 0; k < 15; k++) {
    double r[2][2], t[6] = {0};
    for (int side = 0; side < 2; side++) {
      double d = side ? h : -h, y[3] = {x[0], x[1], x[2]};
      sv_pose pose = b.pose[o->i_pose], cam = b.camera[o->i_camera].cam_from_rig;
      memset(t, 0, sizeof t);
      if (k < 12) t[k % 6] = d;
      if (k < 6) sv_pose_twist(&b.pose[o->i_pose], t);
      else if (k < 12) sv_pose_twist(&b.camera[o->i_camera].cam_from_rig, t);
      else y[k - 12] += d;
      assert_true(sv_bundle_residual(&b, o, y, r[side], NULL));
      b.pose[o->i_pose] = pose;
      b.camera[o->i_camera].cam_from_rig = cam;
    }
    for (int i = 0; i < 2; i++) {
      double want = (r[1][i] - r[0][i]) / (2 * h);
      double have = k < 6 ? j->pose[6 * i + k] : k < 12 ? j->camera[6 * i + k - 6] : j->point[3 * i + k - 12];
      if (fabs(want - have) > 1e-5 * fmax(1, fabs(want)))
        fail_msg("derivative %d of residual %d: %.9g, by differences %.9g", k, i, have, want);
    }
  }
}

TEST(test_derivatives) {
  make_problem(0.2, 0.3);
  disturb(0.05, 0.1, true);
  for (int i = 0; i < N_POINTS; i += 3)
    for (int k = b.first[i]; k < b.first[i + 1]; k++) {
      double r[2];
      sv_bundle_jacobian j;
      assert_true(sv_bundle_residual(&b, &b.obs[k], b.point[i], r, &j));
      check_numeric(&b.obs[k], b.point[i], &j);
    }
}

// Rows that are read before and after the pose, of a rig that moves.
TEST(test_derivatives_of_rows) {
  double most = 0;
  make_problem(0.2, 0.3);
  disturb(0.05, 0.1, true);
  for (int i = 0; i < N_POSES; i++) random_twist(b.motion[i], 1.0, 2.0);
  for (int i = 0; i < N_POINTS; i += 3)
    for (int k = b.first[i]; k < b.first[i + 1]; k++) {
      double r[2], still[2];
      sv_bundle_jacobian j;
      assert_true(sv_bundle_residual(&b, &b.obs[k], b.point[i], still, NULL));
      b.obs[k].row_s = 0.05f * (float)uniform(-1, 1);
      assert_true(sv_bundle_residual(&b, &b.obs[k], b.point[i], r, &j));
      check_numeric(&b.obs[k], b.point[i], &j);
      most = fmax(most, hypot(r[0] - still[0], r[1] - still[1]));
    }
  assert_true(most > 5); // px
}

// --- against a dense solve -----------------------------------------------------------------------

static double dense_h[N_DENSE][N_DENSE + 1];

static void dense_add(const int at[15], double j[2][15], const double r[2], double w) {
  for (int a = 0; a < 15; a++) {
    if (at[a] < 0) continue;
    dense_h[at[a]][N_DENSE] -= w * (j[0][a] * r[0] + j[1][a] * r[1]);
    for (int c = 0; c < 15; c++)
      if (at[c] >= 0) dense_h[at[a]][at[c]] += w * (j[0][a] * j[0][c] + j[1][a] * j[1][c]);
  }
}

static void dense_build(const sv_bundle_options *o, double lambda) {
  memset(dense_h, 0, sizeof dense_h);
  for (int i = 0; i < N_POINTS; i++)
    for (int k = b.first[i]; k < b.first[i + 1]; k++) {
      const sv_bundle_obs *ob = &b.obs[k];
      double r[2], j[2][15];
      sv_bundle_jacobian d_r;
      int at[15];
      assert_true(sv_bundle_residual(&b, ob, b.point[i], r, &d_r));
      double w2 = (double)ob->weight * (double)ob->weight, n = sqrt(w2 * (r[0] * r[0] + r[1] * r[1]));
      for (int c = 0; c < 15; c++) {
        for (int d = 0; d < 2; d++)
          j[d][c] = c < 6    ? d_r.pose[6 * d + c]
                    : c < 12 ? d_r.camera[6 * d + c - 6]
                             : d_r.point[3 * d + c - 12];
        at[c] = c < 6    ? (ob->i_pose > 0 ? 6 * (ob->i_pose - 1) + c : -1)
                : c < 12 ? (ob->i_camera > 0 ? 6 * (N_POSES - 1 + ob->i_camera - 1) + c - 6 : -1)
                         : 6 * (N_POSES - 1 + N_CAMS - 1) + 3 * i + c - 12;
      }
      dense_add(at, j, r, n > o->huber_px ? w2 * o->huber_px / n : w2);
    }
  for (int i = 1; i < N_CAMS; i++)
    for (int k = 0; k < 6; k++) { // calibration, from where it is
      int at = 6 * (N_POSES - 1 + i - 1) + k;
      double s = k < 3 ? o->sigma_rot_rad : o->sigma_trans_m, e[6];
      sv_pose inv = sv_pose_inv(&b.calibrated[i]), d = sv_pose_mul(&b.camera[i].cam_from_rig, &inv);
      sv_rodrigues_inv(e, d.r);
      memcpy(e + 3, d.t, sizeof d.t);
      dense_h[at][at] += 1 / (s * s);
      dense_h[at][N_DENSE] -= e[k] / (s * s);
    }
  for (int i = 0; i < N_DENSE; i++) dense_h[i][i] *= 1 + lambda;
}

static void dense_solve(double x[N_DENSE]) { // Gauss-Jordan with pivots
  for (int i = 0; i < N_DENSE; i++) {
    int p = i;
    for (int k = i + 1; k < N_DENSE; k++)
      if (fabs(dense_h[k][i]) > fabs(dense_h[p][i])) p = k;
    for (int c = 0; c <= N_DENSE; c++) {
      double t = dense_h[i][c];
      dense_h[i][c] = dense_h[p][c];
      dense_h[p][c] = t;
    }
    for (int k = 0; k < N_DENSE; k++) {
      double f = k == i ? 0 : dense_h[k][i] / dense_h[i][i];
      for (int c = i; f != 0 && c <= N_DENSE; c++) dense_h[k][c] -= f * dense_h[i][c];
    }
  }
  for (int i = 0; i < N_DENSE; i++) x[i] = dense_h[i][N_DENSE] / dense_h[i][i];
}

TEST(test_dense) {
  static double x[N_DENSE];
  for (int c = 0; c < 4; c++) {
    sv_bundle_options o = plain;
    o.is_extrinsics = true;
    o.huber_px = c & 1 ? 2 : 1e6; // with and without weights
    double lambda = c & 2 ? 1e-2 : 1e-6, largest = 0;
    make_problem(0.2, 0.3);
    disturb(0.01, 0.02, true);
    for (int i = 0; i < b.first[N_POINTS]; i += 7) b.obs[i].weight = 0.5f;
    dense_build(&o, lambda);
    dense_solve(x);
    assert_true(sv_bundle_linear_step(&b, &o, lambda));
    assert_int_equal(b.n_params, 6 * (N_POSES - 1 + N_CAMS - 1));
    for (int i = 0; i < N_DENSE; i++) {
      double have = i < b.n_params ? b.step[i] : b.point_step[(i - b.n_params) / 3][(i - b.n_params) % 3];
      largest = fmax(largest, fabs(x[i]));
      if (fabs(have - x[i]) > 1e-6 * fmax(1e-3, fabs(x[i])))
        fail_msg("case %d, parameter %d: step %.12g, dense %.12g", c, i, have, x[i]);
    }
    assert_true(largest > 1e-3);
  }
}

// --- solving -------------------------------------------------------------------------------------

TEST(test_converges) {
  sv_bundle_result r;
  make_problem(0.2, 0);
  disturb(0.05, 0.1, false);
  assert_int_equal(sv_bundle_solve(&b, &plain, &r), SV_OK);
  assert_true(r.cost_before > 1e4 && r.cost < 1e-3 && r.rms_px < 1e-3);
  for (int i = 0; i < N_POSES; i++) assert_true(pose_error(&b.pose[i], &true_pose[i]) < 1e-4);
  // Cameras that are off by little are put right, those of a trusted calibration are not.
  sv_bundle_options o = plain;
  o.is_extrinsics = true;
  for (int trust = 0; trust < 2; trust++) {
    o.sigma_rot_rad = trust ? 1e-7 : 0.1;
    o.sigma_trans_m = trust ? 1e-7 : 0.1;
    make_problem(0.2, 0);
    for (int i = 1; i < N_CAMS; i++) {
      double t[6] = {0.002, -0.001, 0.001, 0, 0, 0};
      sv_pose_twist(&b.camera[i].cam_from_rig, t);
      b.calibrated[i] = b.camera[i].cam_from_rig;
    }
    assert_int_equal(sv_bundle_solve(&b, &o, &r), SV_OK);
    double off = pose_error(&b.camera[1].cam_from_rig, &b.calibrated[1]);
    if (trust ? !(off < 1e-5 && r.rms_px > 1e-3) : !(off > 5e-4 && r.rms_px < 0.02))
      fail_msg("trust %d: camera moved by %g, rms %g px", trust, off, r.rms_px);
  }
}

TEST(test_outliers) {
  sv_bundle_result r;
  sv_bundle_options o = plain;
  o.huber_px = 1;
  make_problem(0.2, 0.2);
  for (int i = 0; i < b.first[N_POINTS]; i += 12) b.obs[i + i / 12 % 12].uv_px[i & 1] += 60;
  disturb(0.03, 0.05, false);
  assert_int_equal(sv_bundle_solve(&b, &o, &r), SV_OK);
  for (int i = 0; i < N_POSES; i++) assert_true(pose_error(&b.pose[i], &true_pose[i]) < 0.01);
}

TEST(test_refuses) {
  sv_bundle_result r;
  make_problem(0.2, 0.2);
  b.is_fixed[0] = false;
  assert_int_equal(sv_bundle_solve(&b, &plain, &r), SV_E_ARG);
  sv_arena small = sv_arena_make(block, 4096);
  sv_bundle_cfg cfg = {N_POSES, N_CAMS, N_POINTS, 400, true};
  assert_int_equal(sv_bundle_init(&b, &cfg, &small), SV_E_NOMEM);
  // All points behind the cameras: nothing explodes.
  make_problem(0.2, 0.2);
  for (int i = 0; i < N_POINTS; i++) b.point[i][2] -= 10;
  assert_int_equal(sv_bundle_solve(&b, &plain, &r), SV_OK);
  for (int i = 0; i < N_POSES; i++) assert_true(isfinite(b.pose[i].t[0]));
}

// A hundred noises: the scatter of the trajectory's size is what scale_sigma says, and it grows as
// the baseline shrinks.
TEST(test_scale_sigma) {
  double told[2], seen[2];
  for (int c = 0; c < 2; c++) {
    double sum = 0, sum2 = 0, sigma = 0;
    const int n = 100;
    for (int k = 0; k < n; k++) {
      sv_bundle_result r;
      double size = 0, mean[3] = {0}, p[3];
      make_problem(c ? 0.02 : 0.2, 0);
      rng = sv_rng_make(100 + (uint64_t)k, 5);
      for (int i = 0; i < b.first[N_POINTS]; i++)
        for (int d = 0; d < 2; d++) b.obs[i].uv_px[d] += 0.3f * sv_rng_normal(&rng);
      assert_int_equal(sv_bundle_solve(&b, &plain, &r), SV_OK);
      sigma += sv_bundle_scale_sigma(&b, &plain) / n;
      for (int i = 0; i < N_POSES; i++) {
        sv_pose_centre(p, &b.pose[i]);
        for (int d = 0; d < 3; d++) mean[d] += p[d] / N_POSES;
      }
      for (int i = 0; i < N_POSES; i++) {
        sv_pose_centre(p, &b.pose[i]);
        for (int d = 0; d < 3; d++) size += (p[d] - mean[d]) * (p[d] - mean[d]);
      }
      double s = 0.5 * log(size);
      sum += s;
      sum2 += s * s;
    }
    told[c] = sigma;
    seen[c] = sqrt(sum2 / n - sum / n * (sum / n));
  }
  print_message("scale: told %.5f and %.5f, seen %.5f and %.5f\n", told[0], told[1], seen[0], seen[1]);
  for (int c = 0; c < 2; c++) assert_true(told[c] > 0.7 * seen[c] && told[c] < 1.4 * seen[c]);
  assert_true(told[1] > 2 * told[0]);
  // A pose that saw nothing, wherever it is, says nothing.
  double near = 0;
  for (int is_far = 0; is_far < 2; is_far++) {
    make_problem(0.2, 0.2);
    for (int i = 0; i < b.first[N_POINTS]; i++)
      if (b.obs[i].i_pose == N_POSES - 1) b.obs[i].weight = 0;
    b.is_fixed[N_POSES - 1] = true;
    if (is_far) b.pose[N_POSES - 1].t[0] = 1000;
    double sigma = sv_bundle_scale_sigma(&b, &plain);
    if (!is_far) near = sigma;
    assert_true(sigma > 0 && sigma == near);
  }
  // Nor do places tell a size that are one.
  for (int i = 0; i < b.first[N_POINTS]; i++) b.obs[i].weight *= b.obs[i].i_pose == 0;
  assert_true(sv_bundle_scale_sigma(&b, &plain) == -1);
}

// --- absolute pose -------------------------------------------------------------------------------

TEST(test_pose) {
  static sv_pose_match m[N_POINTS * N_CAMS];
  make_problem(0.2, 0.2);
  for (int wrong = 0; wrong < 3; wrong++) { // none, a third, nearly half
    int n = 0;
    for (int i = 0; i < N_POINTS; i++)
      for (int c = 0; c < N_CAMS; c++) {
        const sv_bundle_obs *o = &b.obs[b.first[i] + 2 * N_CAMS + c];
        m[n] = (sv_pose_match){{true_point[i][0], true_point[i][1], true_point[i][2]},
                               o->i_camera,
                               {o->uv_px[0], o->uv_px[1]},
                               1.0f};
        if (wrong == 1 ? n % 3 == 0 : wrong == 2 && n % 9 < 4) m[n].uv_px[0] += 30.0f + (float)(n * 13 % 50);
        n++;
      }
    sv_pose pose = sv_pose_identity();
    sv_pose_problem p = {
        .cameras = b.camera, .matches = m, .n = n, .limit_px = 2, .n_samples = 60, .rng = sv_rng_make(3, 3)};
    int n_in = sv_pose_find(&p, &pose);
    if (pose_error(&pose, &true_pose[2]) > 0.005)
      fail_msg("case %d: off by %g", wrong, pose_error(&pose, &true_pose[2]));
    int n_good = wrong == 0 ? n : wrong == 1 ? n - (n + 2) / 3 : n - 27;
    assert_in_range(n_in, n_good - 3, n_good + 1);
  }
  sv_pose pose = true_pose[1];
  sv_pose_problem few = {.cameras = b.camera, .matches = m, .n = 3, .limit_px = 2, .n_samples = 9};
  assert_int_equal(sv_pose_find(&few, &pose), 0);
  assert_memory_equal(&pose, &true_pose[1], sizeof pose);
}

TEST(test_alignment) {
  make_problem(0.2, 0);
  double w[3] = {0.4, -1.1, 2.0}, t[3] = {5, -2, 1};
  sv_similarity q = {.s = 1.7, .t = {t[0], t[1], t[2]}};
  sv_pose moved[N_POSES];
  sv_rodrigues(q.r, w);
  for (int i = 0; i < N_POSES; i++) moved[i] = sv_similarity_apply(&q, &true_pose[i]);
  sv_similarity found = sv_align_trajectories(true_pose, moved, N_POSES, true);
  assert_true(fabs(found.s - 1.7) < 1e-9);
  for (int i = 0; i < 9; i++) assert_true(fabs(found.r[i] - q.r[i]) < 1e-9);
  for (int i = 0; i < 3; i++) assert_true(fabs(found.t[i] - q.t[i]) < 1e-9);
  found = sv_align_trajectories(true_pose, moved, N_POSES, false);
  assert_true(found.s == 1);
  // One pose alone, and a straight way, are enough.
  found = sv_align_trajectories(true_pose, moved, 1, true);
  for (int i = 0; i < 9; i++) assert_true(fabs(found.r[i] - q.r[i]) < 1e-9);
  // Half turns about whatever axis.
  for (int c = 1; c < 27; c++) {
    double axis[3] = {c % 3 - 1, c / 3 % 3 - 1, c / 9 - 1}, len = sv_norm3(axis);
    if (len == 0) continue;
    for (int i = 0; i < 3; i++) w[i] = SV_PI * axis[i] / len;
    sv_rodrigues(q.r, w);
    for (int i = 0; i < N_POSES; i++) moved[i] = sv_similarity_apply(&q, &true_pose[i]);
    found = sv_align_trajectories(true_pose, moved, N_POSES, true);
    for (int i = 0; i < 9; i++) assert_true(fabs(found.r[i] - q.r[i]) < 1e-9);
  }
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_derivatives), cmocka_unit_test(test_derivatives_of_rows),
      cmocka_unit_test(test_dense),       cmocka_unit_test(test_converges),
      cmocka_unit_test(test_outliers),    cmocka_unit_test(test_refuses),
      cmocka_unit_test(test_scale_sigma), cmocka_unit_test(test_pose),
      cmocka_unit_test(test_alignment),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
