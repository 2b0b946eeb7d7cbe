// SPDX-License-Identifier: Apache-2.0
// Poses as networks write them: monocular poses of unknown scale become those of a stereo rig in
// meters, cameras are those of the full pictures, and wrong files get one sentence.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/mathx.h"
#include "src/track/pose.h"
#include "tests/common/lab_shell.h"
#include "tests/common/npz_write.h"
#include "tests/common/test.h"
#include "tools/import/import.h"

#define N      10
#define UNIT_M 0.37 // of the made monocular poses

static lab_shell shell = {.cwd = ""};
static sv_pose truth[2][N]; // of both cameras
static sv_camera_model lens;
static sv_err err;

static void in_root(char path[600], const char *name) { snprintf(path, 600, "%s/%s", shell.root, name); }

static void load(lab_import *im, const char *name) {
  char dir[600];
  memset(im, 0, sizeof *im);
  in_root(dir, name);
  assert_ok(lab_import_transforms(im, dir, &err), &err);
}

// Pictures as pics/left/00.png and pics/right/00.png, and their rig.
static void make_pictures(void) {
  static sv_sub_view subs[2];
  lab_import im;
  char path[600], name[40];
  lab_shell_run_well(&shell, "@ import --from sim textured,rig=stereo,exposures=10 --out sim --quiet && "
                             "mkdir -p pics/left pics/right");
  load(&im, "sim");
  for (int i = 0; i < im.n; i++) {
    const lab_import_view *v = &im.views[i];
    void *data;
    size_t bytes;
    if (strcmp(v->split, "train") != 0) continue;
    assert_true(v->exposure >= 0 && v->exposure < N && v->sub_view >= 0 && v->sub_view < 2);
    truth[v->sub_view][v->exposure] = v->cam_from_world;
    lens = v->model;
    snprintf(name, sizeof name, "pics/%s/%02d.png", v->sub_view ? "right" : "left", v->exposure);
    in_root(path, name);
    assert_ok(sv_file_read(v->source, &data, &bytes, &err), &err);
    assert_ok(sv_file_write(path, data, bytes, &err), &err);
    free(data);
    snprintf(subs[v->sub_view].name, sizeof subs[0].name, "%s", v->sub_view ? "right" : "left");
    subs[v->sub_view].model = v->model;
    subs[v->sub_view].i_camera = v->sub_view;
  }
  lab_import_free(&im);
  sv_pose back = sv_pose_inv(&truth[0][0]);
  subs[0].cam_from_rig = sv_pose_identity();
  subs[1].cam_from_rig = sv_pose_mul(&truth[1][0], &back);
  const sv_rig rig = {.name = "pair", .sub_views = subs, .n_sub_views = 2, .cap_sub_views = 2};
  in_root(path, "rig");
  assert_ok(lab_rig_write(&rig, path, &err), &err);
}

static int setup(void **state) {
  (void)state;
  const int r = lab_shell_open(&shell, "network");
  if (r < 0) return -1;
  shell.is_ready = r == 0;
  if (shell.is_ready) make_pictures();
  return 0;
}
static int teardown(void **state) {
  (void)state;
  return lab_shell_close(&shell);
}

// Camera to world, with the noise of a monocular network, in units of UNIT_M.
static void put_c2w(float m[16], const sv_pose *cam_from_world, sv_rng *rng) {
  double w[3], r[9];
  sv_pose p = sv_pose_inv(cam_from_world);
  for (int k = 0; k < 3; k++) w[k] = 0.03 * SV_PI / 180 * (double)sv_rng_normal(rng);
  sv_rodrigues(r, w);
  sv_mul33(p.r, r, p.r);
  for (int i = 0; i < 3; i++) {
    for (int k = 0; k < 3; k++) m[4 * i + k] = (float)p.r[3 * i + k];
    m[4 * i + 3] = (float)((p.t[i] + 0.004 * (double)sv_rng_normal(rng)) / UNIT_M);
  }
  for (int k = 0; k < 4; k++) m[12 + k] = k == 3;
}

static void make_megasam(const char *name, const char *pose_name) {
  enum { W = 32, H = 24 };
  static float c2w[N][16], depth[N * W * H];
  char path[600];
  const double k[9] = {lens.p[0] * W / lens.width_px,
                       0,
                       lens.p[2] * W / lens.width_px,
                       0,
                       lens.p[1] * H / lens.height_px,
                       lens.p[3] * H / lens.height_px,
                       0,
                       0,
                       1};
  sv_rng rng = sv_rng_make(5, 1);
  npz_archive z = {.is_deflated = true};
  for (int i = 0; i < N; i++) put_c2w(c2w[i], &truth[0][i], &rng);
  for (int i = 0; i < N * W * H; i++) depth[i] = (float)(4 / UNIT_M);
  npz_add(&z, &(npz_array){pose_name, "<f4", "(10, 4, 4)", c2w, sizeof c2w});
  npz_add(&z, &(npz_array){"intrinsic", "<f8", "(3, 3)", k, sizeof k});
  npz_add(&z, &(npz_array){"depths", "<f4", "(10, 24, 32)", depth, sizeof depth});
  in_root(path, name);
  npz_save(&z, path);
  npz_free(&z);
}

// The mean error of orientation, and the scale of the positions, against the truth.
static double check_rig(const char *name, double *mean_deg) {
  lab_import im;
  sv_pose got[2 * N], right[2 * N];
  load(&im, name);
  assert_int_equal(im.n, 2 * N);
  for (int i = 0; i < im.n; i++) {
    got[i] = im.views[i].cam_from_world;
    right[i] = truth[im.views[i].sub_view][im.views[i].exposure];
  }
  lab_import_free(&im);
  const sv_similarity s = sv_align_trajectories(got, right, 2 * N, true);
  *mean_deg = 0;
  for (int i = 0; i < 2 * N; i++) {
    sv_pose p = sv_similarity_apply(&s, &got[i]), back = sv_pose_inv(&right[i]);
    double w[3];
    p = sv_pose_mul(&p, &back);
    sv_rodrigues_inv(w, p.r);
    *mean_deg += sv_norm3(w) * 180 / SV_PI / (2 * N);
  }
  return s.s;
}

TEST(test_megasam) {
  double deg;
  lab_shell_need(&shell);
  make_megasam("m.npz", "cam_c2w");
  int code =
      lab_shell_run(&shell, "@ import --from megasam m.npz --images pics --rig rig --stream left --out mono");
  assert_int_equal(code, 0);
  if (strstr(shell.said, "assuming")) skip(); // a build without OpenCV
  const char *p = strstr(shell.said, "poses is ");
  assert_non_null(p);
  print_message("unit %s m, truth %g\n", strtok((char *)(uintptr_t)p + 9, " "), UNIT_M);
  double scale = check_rig("mono", &deg);
  print_message("scale %.5f, mean %.3f degrees\n", scale, deg);
  assert_true(fabs(scale - 1) < 0.005 && deg < 0.1);
  lab_shell_run_well(
      &shell, "@ import --from megasam m.npz --images pics --rig rig --stream left --refine rig --out fine");
  scale = check_rig("fine", &deg);
  print_message("refined: scale %.5f, mean %.3f degrees\n", scale, deg);
  assert_true(fabs(scale - 1) < 0.002 && deg < 0.15); // ten exposures leave some drift
}

static void check_views(const char *name, int n, bool is_point) {
  lab_import im;
  load(&im, name);
  assert_int_equal(im.n, n);
  for (int i = 0; i < n; i++) {
    const double *p = im.views[i].model.p;
    assert_int_equal(im.views[i].model.width_px, lens.width_px);
    assert_near(p[0], lens.p[0], 0.003 * lens.p[0]);
    assert_near(p[1], lens.p[1], 0.003 * lens.p[1]);
    assert_near(p[2], lens.p[2], 0.5);
    assert_near(p[3], lens.p[3], 0.5);
    for (int k = 0; k < 9; k++) assert_near(im.views[i].cam_from_world.r[k], truth[0][i].r[k], 2e-3);
  }
  assert_true(!is_point || im.n_points > 1000);
  lab_import_free(&im);
}

// Of two pictures: 518 wide, the height to the nearest multiple of 14.
TEST(test_vggt) {
  lab_shell_need(&shell);
  const int h = (int)nearbyint(lens.height_px * 518.0 / lens.width_px / 14) * 14;
  float pose[2][12], k[2][9] = {{0}};
  char path[600], shape[40];
  float *depth = malloc((size_t)(2 * h * 518) * sizeof *depth);
  assert_non_null(depth);
  for (int i = 0; i < 2 * h * 518; i++) depth[i] = 4;
  for (int i = 0; i < 2; i++) {
    for (int r = 0; r < 3; r++) {
      for (int c = 0; c < 3; c++) pose[i][4 * r + c] = (float)truth[0][i].r[3 * r + c];
      pose[i][4 * r + 3] = (float)truth[0][i].t[r];
    }
    k[i][0] = (float)(lens.p[0] * 518 / lens.width_px);
    k[i][4] = (float)(lens.p[1] * h / lens.height_px);
    k[i][2] = 259;
    k[i][5] = 0.5f * (float)h;
    k[i][8] = 1;
  }
  npz_archive z = {.is_deflated = true};
  npz_add(&z, &(npz_array){"extrinsic", "<f4", "(2, 3, 4)", pose, sizeof pose});
  npz_add(&z, &(npz_array){"intrinsic", "<f4", "(2, 3, 3)", k, sizeof k});
  snprintf(shape, sizeof shape, "(2, %d, 518, 1)", h);
  npz_add(&z, &(npz_array){"depth", "<f4", shape, depth, (size_t)(2 * h * 518) * sizeof *depth});
  lab_shell_run_well(&shell, "mkdir -p v/images && cp pics/left/00.png pics/left/01.png v/images");
  in_root(path, "v/predictions.npz");
  npz_save(&z, path);
  npz_free(&z);
  free(depth);
  lab_shell_run_well(&shell, "@ import --from vggt v --out vggt --quiet");
  check_views("vggt", 2, true);
}

static void put_json(FILE *f, int n, const char *more) {
  fprintf(f, "{%s\"cams2world\": [", more);
  for (int i = 0; i < n; i++) {
    sv_pose p = sv_pose_inv(&truth[0][i]);
    fprintf(f, "%s[", i ? ", " : "");
    for (int r = 0; r < 3; r++)
      fprintf(f, "[%.9g, %.9g, %.9g, %.9g], ", p.r[3 * r], p.r[3 * r + 1], p.r[3 * r + 2], p.t[r]);
    fprintf(f, "[0, 0, 0, 1]]");
  }
  fprintf(f, "], \"focals\": [");
  for (int i = 0; i < n; i++) fprintf(f, "%s[%.9g]", i ? ", " : "", lens.p[0] * 512 / lens.width_px);
  fprintf(f, "]}\n");
}

static void save_json(const char *name, int n, const char *more) {
  char path[600];
  in_root(path, name);
  FILE *f = fopen(path, "w");
  assert_non_null(f);
  put_json(f, n, more);
  fclose(f);
}

TEST(test_dust3r) {
  lab_shell_need(&shell);
  save_json("d.json", 3, "\"filelist\": [\"/x/00.png\", \"/x/01.png\", \"/x/02.png\"], ");
  lab_shell_run_well(&shell, "mkdir -p three && cp pics/left/0[012].png three && "
                             "@ import --from dust3r d.json --images three --out dust3r --quiet");
  check_views("dust3r", 3, false);
}

static void refuse(const char *args, const char *part) {
  char line[300];
  snprintf(line, sizeof line, "@ import --quiet --out x %s", args);
  assert_int_equal(lab_shell_run(&shell, line), 1);
  assert_contains(shell.said, part);
  assert_int_equal(strchr(shell.said, '\n') - shell.said, (long)strlen(shell.said) - 1);
}

TEST(test_refused) {
  lab_shell_need(&shell);
  make_megasam("other.npz", "poses");
  make_megasam("m.npz", "cam_c2w");
  save_json("two.json", 2, "");
  save_json("names.json", 3, "\"filelist\": [\"a\", \"b\", \"c\"], ");
  lab_shell_run_well(&shell, "mkdir -p three && cp pics/left/0[012].png three; head -c 500 m.npz > cut.npz; "
                             "echo '{\"cams2world\": []}' > none.json");
  refuse("--from megasam other.npz --images three", "has no array cam_c2w");
  refuse("--from megasam m.npz --images three", "has 3 pictures");
  refuse("--from megasam m.npz", "--images");
  refuse("--from megasam cut.npz --images three", "cut off");
  refuse("--from vggt m.npz --images three", "no array extrinsic");
  refuse("--from dust3r two.json --images three", "has 3 pictures");
  refuse("--from dust3r names.json --images three", "picture a is not in");
  refuse("--from dust3r none.json --images three", "cams2world");
  refuse("--from dust3r absent.json --images three", "absent.json");
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_megasam),
      cmocka_unit_test(test_vggt),
      cmocka_unit_test(test_dust3r),
      cmocka_unit_test(test_refused),
  };
  return cmocka_run_group_tests(tests, setup, teardown);
}
