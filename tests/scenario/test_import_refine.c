// SPDX-License-Identifier: Apache-2.0
// Poses that are off by half a degree and 1 % of the distance: `import --refine` puts them right by
// matches of the images, better with a rig's constraint than without, and leaves right ones alone.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/mathx.h"
#include "src/track/pose.h"
#include "tests/common/lab_shell.h"
#include "tests/common/test.h"
#include "tools/import/import.h"

#define OFF_DEG   0.5
#define DISTANCE  4.0 // of the simulator's cameras
#define CAP_VIEWS 64

static lab_shell shell = {.cwd = ""};
static lab_session session;
static sv_pose truth[CAP_VIEWS];
static int n_views;

static void direction(sv_rng *rng, double length, double v[3]) {
  for (int k = 0; k < 3; k++) v[k] = (double)sv_rng_normal(rng);
  const double n = sv_norm3(v);
  for (int k = 0; k < 3; k++) v[k] *= length / n;
}

static void load(lab_import *im, const char *name) {
  char dir[400];
  sv_err err;
  memset(im, 0, sizeof *im);
  snprintf(dir, sizeof dir, "%s/%s", shell.root, name);
  assert_ok(lab_import_transforms(im, dir, &err), &err);
}

static void save(lab_import *im, const char *name) {
  char dir[400];
  sv_err err;
  snprintf(dir, sizeof dir, "%s/%s", shell.root, name);
  assert_ok(lab_import_write(im, &session, dir, &err), &err);
  lab_import_free(im);
}

static void make_data(void) {
  lab_import im;
  sv_rng rng = sv_rng_make(3, 1);
  lab_shell_run_well(&shell, "@ import --from sim textured,rig=stereo,exposures=12 --out sim --quiet");
  load(&im, "sim");
  n_views = im.n;
  for (int i = 0; i < im.n; i++) {
    double w[3], v[3], c[3], r[9];
    sv_pose *p = &im.views[i].cam_from_world;
    truth[i] = *p;
    direction(&rng, OFF_DEG * SV_PI / 180, w);
    direction(&rng, 0.01 * DISTANCE, v);
    sv_pose_centre(c, p);
    sv_rodrigues(r, w);
    sv_mul33(p->r, r, p->r); // turned about its own center, which moves
    for (int k = 0; k < 3; k++) c[k] += v[k];
    sv_apply33(p->t, p->r, c);
    for (int k = 0; k < 3; k++) p->t[k] = -p->t[k];
  }
  save(&im, "off");
}

static int setup(void **state) {
  sv_err err;
  (void)state;
  const int r = lab_shell_open(&shell, "refine");
  if (r < 0 || lab_session_start(&session, 1, true, &err) != SV_OK) return -1;
  shell.is_ready = r == 0;
  if (shell.is_ready) make_data();
  return 0;
}
static int teardown(void **state) {
  (void)state;
  lab_session_stop(&session);
  return lab_shell_close(&shell);
}

// OpenCV finds the matches.
static void need_matches(void) {
  static bool is_known;
  lab_shell_need(&shell);
  if (is_known) return;
  if (lab_shell_run(&shell, "@ import --from nerfstudio off --refine views --out probe --quiet") != 0) {
    assert_contains(shell.said, "OpenCV");
    skip();
  }
  is_known = true;
}

typedef struct {
  double deg, share; // root mean squares; share: of the distance
} pose_error;

// After the similarity that no image tells.
static pose_error error_of(const char *name) {
  lab_import im;
  sv_pose got[CAP_VIEWS];
  pose_error e = {0};
  load(&im, name);
  assert_int_equal(im.n, n_views);
  for (int i = 0; i < im.n; i++) got[i] = im.views[i].cam_from_world;
  const sv_similarity world = sv_align_trajectories(got, truth, n_views, true);
  for (int i = 0; i < n_views; i++) {
    sv_pose p = sv_similarity_apply(&world, &got[i]), back = sv_pose_inv(&truth[i]);
    double w[3], a[3], b[3];
    p = sv_pose_mul(&p, &back);
    sv_rodrigues_inv(w, p.r);
    p = sv_similarity_apply(&world, &got[i]);
    sv_pose_centre(a, &p);
    sv_pose_centre(b, &truth[i]);
    sv_sub3(a, a, b);
    e.deg += sv_dot3(w, w) / n_views;
    e.share += sv_dot3(a, a) / n_views;
  }
  e.deg = sqrt(e.deg) * 180 / SV_PI;
  e.share = sqrt(e.share) / DISTANCE;
  lab_import_free(&im);
  return e;
}

static double psnr_of(const char *name) {
  char line[300];
  snprintf(line, sizeof line,
           "@ train --data %s --init stereo --steps 500 --gaussians 5000 --eval --quiet --out m_%s", name,
           name);
  lab_shell_run_well(&shell, line);
  const char *p = strstr(shell.said, "PSNR ");
  assert_non_null(p);
  return strtod(p + 5, NULL);
}

// With true poses.
static double right_psnr(void) {
  static double db;
  if (!(db > 0)) db = psnr_of("sim");
  return db;
}

TEST(test_refined) {
  need_matches();
  lab_shell_run_well(&shell, "@ import --from nerfstudio off --refine views --out views");
  assert_contains(shell.said, "views refined");
  lab_shell_run_well(&shell, "@ import --from nerfstudio off --refine rig --out rig");
  const pose_error off = error_of("off"), views = error_of("views"), rig = error_of("rig");
  // What remains is slow drift from view to view, which neighbors hardly see.
  print_message("off %.4f deg %.5f; views %.4f deg %.5f; rig %.4f deg %.5f\n", off.deg, off.share, views.deg,
                views.share, rig.deg, rig.share);
  assert_true(off.deg > 0.4 && off.share > 0.008);
  assert_true(views.deg < 0.2 && views.share < 0.003);
  assert_true(rig.deg < views.deg && rig.share < views.share);
  const double right_db = right_psnr(), off_db = psnr_of("off"), rig_db = psnr_of("rig");
  print_message("PSNR %.2f dB with true poses, %.2f off, %.2f refined\n", right_db, off_db, rig_db);
  assert_true(off_db < right_db - 8);
  assert_true(rig_db > right_db - 0.3);
}

TEST(test_right_poses_stay) {
  need_matches();
  lab_shell_run_well(&shell, "@ import --from nerfstudio sim --refine views --out same");
  assert_contains(shell.said, "left as they are");
  const pose_error e = error_of("same");
  assert_true(e.deg < 1e-4 && e.share < 1e-6);
}

// A focal length that is 1.5 % off.
TEST(test_free_lenses) {
  lab_import im;
  need_matches();
  load(&im, "sim");
  const double f = im.views[0].model.p[0];
  for (int i = 0; i < im.n; i++) im.views[i].model.p[0] = im.views[i].model.p[1] = 1.015 * f;
  save(&im, "long");
  lab_shell_run_well(&shell, "@ import --from nerfstudio long --refine rig --free-lenses all --out lens");
  load(&im, "lens");
  for (int i = 0; i < im.n; i++) assert_near(im.views[i].model.p[0], f, 0.006 * f);
  lab_import_free(&im);
}

static double psnr_after(const char *line) {
  lab_shell_run_well(&shell, line);
  const char *p = strstr(shell.said, "PSNR ");
  assert_non_null(p);
  return strtod(p + 5, NULL);
}

// Held-out PSNR of t1, whose poses were refined in training, sub-views of an exposure together.
// Held-out poses are as wrong as the others.
static double refined_psnr(void) {
  static double db;
  if (db > 0) return db;
  db = psnr_after(
      "@ train --data off --init stereo --steps 500 --gaussians 5000 --eval --refine-poses --out t1");
  assert_contains(shell.said, "by bundle adjustment, sub-views of an exposure together");
  assert_contains(shell.said, "poses refined: moved by 0.");
  assert_contains(shell.said, "held-out poses refined against the model");
  return db;
}

TEST(test_in_training) {
  need_matches();
  const double right = right_psnr(), refined = refined_psnr();
  print_message("PSNR %.2f dB with true poses, %.2f refined\n", right, refined);
  assert_true(refined > right - 0.3);
  lab_shell_run_well(&shell, "@ train --data sim --steps 5 --gaussians 500 --refine-poses --out t2");
  assert_contains(shell.said, "left as they are");
  assert_int_not_equal(lab_shell_run(&shell, "ls t2/transforms_refined.json"), 0);
}

// The poses that training ended with are in a file of their own, which is read with the model.
TEST(test_saved) {
  need_matches();
  (void)refined_psnr();
  lab_shell_run_well(&shell, "cp -r off kept && cp t1/transforms_refined.json kept/transforms.json");
  const pose_error off = error_of("off"), kept = error_of("kept");
  print_message("off %.4f deg %.5f; saved %.4f deg %.5f\n", off.deg, off.share, kept.deg, kept.share);
  const double own = psnr_after("@ eval --data off --model t1/model.ply --split train");
  const double same =
      psnr_after("@ eval --data kept --model t1/model.ply --split train --transforms transforms.json");
  const double wrong =
      psnr_after("@ eval --data off --model t1/model.ply --split train --transforms transforms.json");
  print_message("training views %.2f dB by the saved poses, %.2f in a copy, %.2f by the old ones\n", own,
                same, wrong);
  assert_true(own == same && own > wrong + 8 && kept.deg < 0.7 * off.deg);
}

// Views that are placed against a model that stays: by half a degree, and back to the digit nearly.
TEST(test_held_out) {
  lab_shell_need(&shell);
  const double right = right_psnr(), off = psnr_after("@ eval --data off --model m_sim/model.ply");
  const double placed = psnr_after("@ eval --data off --model m_sim/model.ply --refine-poses");
  print_message("held-out PSNR %.2f dB, %.2f of wrong poses, %.2f placed\n", right, off, placed);
  assert_true(off < right - 8);
  assert_near(placed, right, 0.15);
}

TEST(test_refused) {
  lab_shell_need(&shell);
  assert_int_equal(lab_shell_run(&shell, "@ import --from nerfstudio sim --free-lenses all --out x"), 2);
  assert_contains(shell.said, "--free-lenses needs --refine");
  assert_int_equal(lab_shell_run(&shell, "@ import --from nerfstudio sim --refine both --out x"), 2);
  assert_int_equal(lab_shell_run(&shell, "@ import --from kalibr sim --refine rig --out x"), 2);
  assert_contains(shell.said, "--refine needs --from");
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_refined),          cmocka_unit_test(test_saved),
      cmocka_unit_test(test_right_poses_stay), cmocka_unit_test(test_free_lenses),
      cmocka_unit_test(test_in_training),      cmocka_unit_test(test_held_out),
      cmocka_unit_test(test_refused),
  };
  return cmocka_run_group_tests(tests, setup, teardown);
}
