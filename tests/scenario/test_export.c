// SPDX-License-Identifier: Apache-2.0
// Exports for viewers: upright where they stand, cropped, and SOG read back by the rules of its
// description, with ffmpeg's WebP decoder.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "src/base/vec.h"
#include "src/format/axes.h"
#include "src/format/ply.h"
#include "tests/common/lab_shell.h"
#include "tests/common/test.h"
#include "tools/lab/lab.h"
#include "tools/lab/sog_judge.h"
#include "tools/pictures/orbit.h"

#define N      300
#define SH_C0  0.28209479177387814
#define DECODE "ffmpeg -v error -y -i x/%s.webp -f rawvideo -pix_fmt rgba x/%s.rgba && "

static lab_shell shell = {.cwd = ""};
static lab_model model, other;

static int setup(void **state) {
  (void)state;
  const int r = lab_shell_open(&shell, "export");
  if (r < 0) return -1;
  shell.is_ready = r == 0;
  if (r == 0)
    lab_shell_run_well(&shell,
                       "@ import --from sim textured,rig=stereo,exposures=2,size=64x48 --out ds --quiet && "
                       "@ train --data ds --gaussians 300 --sh 2 --steps 60 --out m --quiet");
  return 0;
}
static int teardown(void **state) {
  (void)state;
  lab_model_free(&model);
  lab_model_free(&other);
  return lab_shell_close(&shell);
}

static void read_model(lab_model *m, const char *name) {
  char path[600];
  sv_err err;
  lab_model_free(m);
  *m = (lab_model){0};
  snprintf(path, sizeof path, "%s/%s", shell.root, name);
  if (lab_model_read(m, path, &err) != SV_OK) fail_msg("%s", err.text);
}

static void export(const char *args) {
  char line[300];
  snprintf(line, sizeof line, "@ export --model m/model.ply --quiet %s", args);
  lab_shell_run_well(&shell, line);
}

// The simulator's worlds have z up. Where that goes, and that lengths and rotations stay.
TEST(test_upright) {
  lab_shell_need(&shell);
  read_model(&model, "m/model.ply");
  assert_string_equal(model.up, "z");
  assert_true(model.unit.is_metric); // as the simulator's dataset says
  export("--format ply --for supersplat --out down.ply");
  read_model(&other, "down.ply");
  assert_string_equal(other.up, "-y");
  assert_true(other.unit.is_metric);
  lab_shell_run_well(&shell, "@ import --from nerfstudio ds --out again --quiet && "
                             "grep -q '\"world_unit\": \"m\"' again/transforms.json && "
                             "sed -i 's/\"world_unit\": \"m\",//' again/transforms.json && "
                             "@ train --data again --gaussians 50 --steps 2 --out bare --quiet && "
                             "! grep -a SplatUnit bare/model.ply");
  // How well the scale is known goes from the dataset to the model and to what is exported.
  lab_shell_run_well(&shell,
                     "@ import --from nerfstudio ds --out sized --quiet && "
                     "sed -i 's/\"world_unit\": \"m\",/\"world_unit\": \"m\", \"world_scale_sigma\": 0.02,/' "
                     "sized/transforms.json && "
                     "@ train --data sized --gaussians 50 --steps 2 --out sized_m --quiet && "
                     "grep -aq 'SplatScaleSigma: 0.02' sized_m/model.ply && "
                     "@ export --model sized_m/model.ply --format spz --out sized.spz --quiet && "
                     "@ export --model sized.spz --format ply --out sized.ply --quiet && "
                     "grep -aq 'SplatUnit: m' sized.ply && grep -aq 'SplatScaleSigma: 0.02' sized.ply && "
                     "@ export --model sized_m/model.ply --format glb --out sized.glb --quiet && "
                     "grep -aq '\"extras\":{\"unit\":\"m\",\"scale_sigma\":0.02}' sized.glb && "
                     "@ import --from nerfstudio sized --out sized_again --quiet && "
                     "grep -q '\"world_scale_sigma\": 0.02' sized_again/transforms.json");
  for (int i = 0; i < N; i++) {
    sv_gaussian a, b;
    sv_gaussians_get(&model.g, i, &a);
    sv_gaussians_get(&other.g, i, &b);
    assert_true(fabsf(b.mean[1] + a.mean[2]) < 1e-5f && fabsf(b.mean[0] - a.mean[0]) < 1e-5f);
    const float *q = b.quat_wxyz;
    assert_true(fabsf(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3] - 1) < 1e-5f);
    assert_true(a.opacity_logit == b.opacity_logit && a.sh[0][1] == b.sh[0][1]);
  }
  export("--format ply --for blender --out up.ply");
  lab_shell_run_well(&shell, "@ export --model down.ply --format ply --for blender --out again.ply --quiet");
  read_model(&model, "up.ply");
  read_model(&other, "again.ply");
  assert_string_equal(other.up, "z");
  for (int i = 0; i < N; i++) {
    sv_gaussian a, b;
    sv_gaussians_get(&model.g, i, &a);
    sv_gaussians_get(&other.g, i, &b);
    for (int k = 0; k < 3; k++) assert_true(fabsf(a.mean[k] - b.mean[k]) < 1e-5f);
    for (int k = 0; k < 9; k++) assert_true(fabsf(a.sh[k][0] - b.sh[k][0]) < 1e-4f);
  }
}

TEST(test_crop) {
  lab_shell_need(&shell);
  read_model(&model, "m/model.ply");
  export("--format ply --crop 0,0,0,0.5 --out ball.ply");
  read_model(&other, "ball.ply");
  int n = 0;
  for (int i = 0; i < N; i++) {
    sv_gaussian v;
    sv_gaussians_get(&model.g, i, &v);
    n += v.mean[0] * v.mean[0] + v.mean[1] * v.mean[1] + v.mean[2] * v.mean[2] <= 0.25f;
  }
  assert_true(n > 0 && n < N);
  assert_int_equal(other.g.n, n);
  export("--format ply --crop -9,-9,-9,9,9,0 --out half.ply");
  read_model(&other, "half.ply");
  assert_true(other.g.n > 0 && other.g.n < N);
  assert_int_equal(lab_shell_run(&shell, "@ export --model m/model.ply --format ply --crop 1,2 --out x.ply"),
                   1);
  assert_contains(shell.said, "expected x0,y0,z0,x1,y1,z1 or x,y,z,radius");
  assert_int_equal(
      lab_shell_run(&shell, "@ export --model m/model.ply --format ply --crop 9,9,9,0.1 --out x.ply"), 1);
  assert_contains(shell.said, "no Gaussian lies in it");
}

// Faint fog between the cameras and the scene goes, the scene stays.
TEST(test_keep_supported) {
  lab_shell_need(&shell);
  char path[600];
  sv_err err;
  sv_gaussian floater;
  read_model(&model, "m/model.ply");
  sv_gaussians_get(&model.g, 0, &floater);
  char *views = temp_read(shell.root, "ds/transforms_train.json");
  const char *at = strstr(views, "\"transform_matrix\"");
  assert_non_null(at);
  at = strchr(at, '[');
  for (int i = 0; i < 12; i++) { // three rows: the camera's place is the fourth column
    char *end;
    at += strcspn(at, "-0123456789");
    const double v = strtod(at, &end);
    at = end;
    if (i % 4 == 3) floater.mean[i / 4] = 0.6f * (float)v; // towards the origin
  }
  free(views);
  for (int k = 0; k < 3; k++) floater.log_scale[k] = -4;
  floater.opacity_logit = -3;
  sv_gaussians_put(&model.g, 0, &floater);
  snprintf(path, sizeof path, "%s/m/floater.ply", shell.root);
  const sv_model_notes notes = lab_model_notes(&model);
  assert_ok(lab_model_write(&model.g, &notes, path, &err), &err);
  lab_shell_run_well(&shell,
                     "@ export --model m/floater.ply --format ply --data ds --keep-supported --out kept.ply");
  assert_contains(shell.said, "of 300 Gaussians, which fewer than 2 views see on the surface");
  read_model(&other, "kept.ply");
  assert_in_range(other.g.n, N / 3, N - 1);
  for (int i = 0; i < other.g.n; i++) {
    sv_gaussian v;
    sv_gaussians_get(&other.g, i, &v);
    assert_true(v.mean[0] != floater.mean[0]);
  }
  assert_int_equal(
      lab_shell_run(&shell, "@ export --model m/model.ply --format ply --keep-supported --out x.ply"), 2);
  assert_contains(shell.said, "--keep-supported needs --data");
}

TEST(test_mesh) {
  lab_shell_need(&shell);
  lab_shell_run_well(
      &shell, "@ mesh --data ds --model m/model.ply --min-views 1 --out mesh.ply --quiet && "
              "@ mesh --data ds --model m/model.ply --min-views 1 --threads 1 --out again.ply --quiet && "
              "cmp mesh.ply again.ply && head -c 400 mesh.ply | grep -q 'element face [1-9]'");
  lab_shell_run_well(&shell, "@ mesh --data ds --model m/model.ply --min-views 1 --out mesh.obj --quiet && "
                             "grep -q '^v ' mesh.obj && grep -q '^f ' mesh.obj");
  lab_shell_run_well(&shell, "@ mesh --data ds --model m/model.ply --min-views 1 --out mesh.glb --quiet && "
                             "head -c 4 mesh.glb | grep -q glTF");
  assert_int_equal(lab_shell_run(&shell, "@ mesh --data ds --model m/model.ply --out mesh.stl"), 1);
  assert_contains(shell.said, "ends in .ply, .obj or .glb");
  assert_int_equal(
      lab_shell_run(&shell, "@ mesh --data ds --model m/model.ply --min-views 200 --out mesh.ply"), 1);
  assert_contains(shell.said, "no surface was seen by enough views");
}

// From a pixel to itself nothing, there and back the same; places without a surface are refused.
TEST(test_measure) {
#define MEASURE "@ measure --data ds --model m/model.ply --view 0 --quiet "
  lab_shell_need(&shell);
  double there[2];
  for (int i = 0; i < 2; i++) {
    lab_shell_run_well(&shell, i ? MEASURE "--json --from 34.5,30.5 --to 28.5,24.5"
                                 : MEASURE "--json --from 28.5,24.5 --to 34.5,30.5");
    const char *at = strstr(shell.said, "\"distance\": ");
    assert_non_null(at);
    there[i] = strtod(at + strlen("\"distance\": "), NULL);
    assert_contains(shell.said, "\"uncertainty_90\": ");
  }
  assert_true(there[0] > 0.05 && there[0] < 3 && there[0] == there[1]);
  lab_shell_run_well(&shell, MEASURE "--from 28.5,24.5 --to 28.5,24.5");
  assert_contains(shell.said, "0 m +- ");
  assert_int_equal(lab_shell_run(&shell, MEASURE "--from 28,24 --to 64,3"), 1);
  assert_contains(shell.said, "--to 64,3: expected X,Y in the view's 64x48 pixels");
  assert_int_equal(lab_shell_run(&shell, MEASURE "--from 1,1 --to 28,24"), 1);
  assert_contains(shell.said, "--from 1,1: no surface is seen there");
  assert_int_equal(
      lab_shell_run(&shell, "@ measure --data ds --model m/model.ply --view 99 --from 1,1 --to 2,2"), 1);
  assert_contains(shell.said, "--view 99: split train has 4 views");
}

// --- SOG -----------------------------------------------------------------------------------------

static uint8_t *image(const char *name) {
  char line[300];
  snprintf(line, sizeof line, DECODE "true", name, name);
  lab_shell_run_well(&shell, line);
  snprintf(line, sizeof line, "x/%s.rgba", name);
  return (uint8_t *)temp_read(shell.root, line);
}

static void numbers(const char *meta, const char *part, const char *key, double *out, int n) {
  const char *at = strstr(meta, part);
  at = at ? strstr(at, key) : NULL;
  at = at ? strchr(at, '[') : NULL;
  for (int i = 0; i < n; i++) {
    char *end = NULL;
    if (!at) fail_msg("no %s of %s in: %s", key, part, meta);
    out[i] = strtod(at + 1, &end);
    at = end;
  }
}

static double unlog(double x) { return copysign(exp(fabs(x)) - 1, x); }

static void covariance(double out[9], const double q[4], const double log_scale[3]) {
  double r[9];
  sv_quat_to_mat(r, q);
  for (int row = 0; row < 3; row++)
    for (int column = 0; column < 3; column++) {
      out[3 * row + column] = 0;
      for (int k = 0; k < 3; k++)
        out[3 * row + column] += r[3 * row + k] * r[3 * column + k] * exp(2 * log_scale[k]);
    }
}

// The norm of the difference from the Gaussian's covariance, relative: axes come in another order.
static double covariance_error(const double q[4], const double log_scale[3], const sv_gaussian *g) {
  double got[9], want[9], wanted_q[4], wanted_scale[3], error2 = 0, size2 = 0;
  for (int k = 0; k < 4; k++) wanted_q[k] = (double)g->quat_wxyz[k];
  for (int k = 0; k < 3; k++) wanted_scale[k] = (double)g->log_scale[k];
  covariance(got, q, log_scale);
  covariance(want, wanted_q, wanted_scale);
  for (int k = 0; k < 9; k++) {
    error2 += (got[k] - want[k]) * (got[k] - want[k]);
    size2 += want[k] * want[k];
  }
  return sqrt(error2 / size2);
}

static double distance2(const double x[3], const sv_gaussian *g) {
  double d = 0;
  for (int k = 0; k < 3; k++) d += (x[k] - (double)g->mean[k]) * (x[k] - (double)g->mean[k]);
  return d;
}

// The Gaussian of `model` that is nearest.
static sv_gaussian nearest(const double x[3]) {
  sv_gaussian g, v;
  sv_gaussians_get(&model.g, 0, &g);
  for (int j = 1; j < N; j++) {
    sv_gaussians_get(&model.g, j, &v);
    if (distance2(x, &v) < distance2(x, &g)) g = v;
  }
  return g;
}

// PSNR of `back` against `model`, from around it.
static double psnr_of(const sv_gaussians *back) {
  lab_session se;
  lab_settings st;
  sv_err err;
  double psnr = 0;
  assert_ok(lab_session_start(&se, 1, true, &err), &err);
  assert_ok(lab_settings_for(&st, &(lab_options){.model = "none/model.ply"}, &model, &err), &err);
  const lab_orbit orbit = lab_orbit_of_model(&model, &st, 160);
  sog_judge judge = {
      .session = &se, .n_views = 5, .render = lab_render_options(&st, model.g.sh_degree, false)};
  for (int v = 0; v < judge.n_views; v++)
    assert_ok(lab_orbit_view(&orbit, v / 5.0, &judge.view[v], &err), &err);
  assert_ok(sog_judge_start(&judge, &model.g, &err), &err);
  assert_ok(sog_judge_ask(&judge, back, &psnr, &err), &err);
  sog_judge_stop(&judge);
  lab_session_stop(&se);
  return psnr;
}

TEST(test_sog) {
  lab_shell_need(&shell);
  if (lab_shell_run(&shell, "command -v unzip && command -v ffmpeg") != 0) {
    print_message("no unzip or ffmpeg here\n");
    skip();
  }
  export("--format ply --for supersplat --out flat.ply");
  if (lab_shell_run(&shell, "@ export --model m/model.ply --quiet --format sog --out m.sog") != 0) {
    assert_contains(shell.said, "no libwebp");
    skip();
  }
  lab_shell_run_well(&shell,
                     "unzip -tq m.sog && unzip -qo m.sog -d x && mkdir -p y && @ export --model m/model.ply "
                     "--format sog --out y/meta.json --quiet && cmp x/meta.json y/meta.json && "
                     "cmp x/shN_labels.webp y/shN_labels.webp");
  read_model(&model, "flat.ply");
  char *meta = temp_read(shell.root, "x/meta.json");
  uint8_t *low = image("means_l"), *high = image("means_u"), *quats = image("quats"),
          *scales = image("scales"), *sh0 = image("sh0"), *labels = image("shN_labels"),
          *sets = image("shN_centroids");
  double lo[3], hi[3], scale_code[256], color_code[256], sh_code[256];
  numbers(meta, "means", "mins", lo, 3);
  numbers(meta, "means", "maxs", hi, 3);
  numbers(meta, "scales", "codebook", scale_code, 256);
  numbers(meta, "sh0", "codebook", color_code, 256);
  numbers(meta, "shN", "codebook", sh_code, 256);
  assert_contains(meta, "\"count\":300");
  assert_contains(meta, "\"bands\":2");
  read_model(&other, "flat.ply");
  for (int i = 0; i < N; i++) {
    double x[3], q[4];
    for (int k = 0; k < 3; k++)
      x[k] = unlog(lo[k] + (hi[k] - lo[k]) * (low[4 * i + k] + 256.0 * high[4 * i + k]) / 65535.0);
    const sv_gaussian g = nearest(x);
    const double smallest =
        exp(fmin((double)g.log_scale[0], fmin((double)g.log_scale[1], (double)g.log_scale[2])));
    assert_true(sqrt(distance2(x, &g)) < 1e-3 + 0.5 / 2 * sqrt(3) * smallest);
    sv_gaussian back;
    assert_int_equal(quats[4 * i + 3], 252);
    double rest = 1, scale[3];
    for (int k = 0; k < 3; k++) {
      q[1 + k] = (quats[4 * i + k] / 255.0 - 0.5) * sqrt(2.0);
      rest -= q[1 + k] * q[1 + k];
      scale[k] = scale_code[scales[4 * i + k]];
    }
    q[0] = sqrt(fmax(rest, 0));
    assert_true(covariance_error(q, scale, &g) < 0.15);
    for (int k = 0; k < 3; k++) assert_true(fabs(color_code[sh0[4 * i + k]] - (double)g.sh[0][k]) < 0.0313);
    assert_true(fabs(sh0[4 * i + 3] / 255.0 - 1 / (1 + exp(-(double)g.opacity_logit))) < 0.003);
    const double alpha = fmin(fmax(sh0[4 * i + 3] / 255.0, 1e-6), 1 - 1e-6);
    const int label = labels[4 * i] + 256 * labels[4 * i + 1];
    back = g;
    back.opacity_logit = (float)log(alpha / (1 - alpha));
    for (int k = 0; k < 4; k++) back.quat_wxyz[k] = (float)q[k];
    for (int k = 0; k < 3; k++) {
      back.mean[k] = (float)x[k];
      back.log_scale[k] = (float)scale[k];
      back.sh[0][k] = (float)color_code[sh0[4 * i + k]];
      for (int c = 0; c < 8; c++)
        back.sh[1 + c][k] = (float)sh_code[sets[4 * (label / 64 * 64 * 8 + label % 64 * 8 + c) + k]];
    }
    sv_gaussians_put(&other.g, i, &back);
  }
  const double psnr = psnr_of(&other.g);
  print_message("read back: %.1f dB against the model\n", psnr);
  assert_true(psnr > 50); // 52 dB are wanted in other views
  uint8_t *images[] = {low, high, quats, scales, sh0, labels, sets};
  for (int i = 0; i < 7; i++) free(images[i]);
  free(meta);
}

// Mean square error of the colors in which the training views see the Gaussians of x/.
static double seen_error(double eye[][3], int n_eyes) {
  char *meta = temp_read(shell.root, "x/meta.json");
  uint8_t *low = image("means_l"), *high = image("means_u"), *sh0 = image("sh0"),
          *labels = image("shN_labels"), *sets = image("shN_centroids");
  double lo[3], hi[3], color_code[256], sh_code[256], sum = 0;
  numbers(meta, "means", "mins", lo, 3);
  numbers(meta, "means", "maxs", hi, 3);
  numbers(meta, "sh0", "codebook", color_code, 256);
  numbers(meta, "shN", "codebook", sh_code, 256);
  for (int i = 0; i < N; i++) {
    double x[3];
    for (int k = 0; k < 3; k++)
      x[k] = unlog(lo[k] + (hi[k] - lo[k]) * (low[4 * i + k] + 256.0 * high[4 * i + k]) / 65535.0);
    const sv_gaussian g = nearest(x);
    const int label = labels[4 * i] + 256 * labels[4 * i + 1];
    for (int v = 0; v < n_eyes; v++) {
      double d[3], y[15];
      for (int k = 0; k < 3; k++) d[k] = (double)g.mean[k] - eye[v][k];
      const double length = sv_norm3(d);
      for (int k = 0; k < 3; k++) d[k] /= length;
      sv_sh_basis(y, d);
      for (int k = 0; k < 3; k++) {
        double e = SH_C0 * (color_code[sh0[4 * i + k]] - (double)g.sh[0][k]);
        for (int c = 0; c < 8; c++)
          e += y[c] *
               (sh_code[sets[4 * (label / 64 * 64 * 8 + label % 64 * 8 + c) + k]] - (double)g.sh[1 + c][k]);
        sum += e * e / (3 * N * n_eyes);
      }
    }
  }
  uint8_t *images[] = {low, high, sh0, labels, sets};
  for (int i = 0; i < 5; i++) free(images[i]);
  free(meta);
  return sum;
}

static long size_of(const char *name) {
  char path[600];
  struct stat st;
  snprintf(path, sizeof path, "%s/%s", shell.root, name);
  assert_int_equal(stat(path, &st), 0);
  return (long)st.st_size;
}

// With --data, colors are right where its views, here of one exposure, see them.
TEST(test_sog_seen) {
  lab_shell_need(&shell);
  char path[600], folder[600];
  sv_err err;
  read_model(&model, "m/model.ply");
  for (int i = 0; i < N; i++) { // colors that change much with the direction
    sv_gaussian g;
    sv_gaussians_get(&model.g, i, &g);
    for (int c = 1; c < 9; c++)
      for (int k = 0; k < 3; k++)
        g.sh[c][k] = (float)(0.6 * fmod(fabs(sin(97.0 * i + 31.0 * c + 7.0 * k)) * 9973, 1) - 0.3);
    sv_gaussians_put(&model.g, i, &g);
  }
  const sv_model_notes notes = lab_model_notes(&model);
  snprintf(path, sizeof path, "%s/m/colored.ply", shell.root);
  assert_ok(lab_model_write(&model.g, &notes, path, &err), &err);
  lab_shell_run_well(&shell,
                     "@ import --from sim textured,rig=stereo,exposures=1,size=64x48 --out one --quiet");
#define COLORED "@ export --model m/colored.ply --quiet --format "
  if (lab_shell_run(&shell, "command -v unzip && command -v ffmpeg && " COLORED
                            "sog --data one --out seen.sog") != 0) {
    print_message("no unzip, ffmpeg or libwebp here\n");
    skip();
  }
  lab_shell_run_well(&shell, COLORED "sog --out m.sog && " COLORED "ply --for supersplat --out flat.ply");
  read_model(&model, "flat.ply");
  lab_session se;
  lab_views v;
  double eye[2][3];
  sv_turn turn;
  snprintf(folder, sizeof folder, "%s/one", shell.root);
  sv_turn_between(&turn, "z", SV_UP_DEFAULT);
  assert_ok(lab_session_start(&se, 1, true, &err), &err);
  assert_ok(lab_views_open(&v, &(lab_source){.folder = folder, .split = "train"}, &se.pool, &err), &err);
  assert_int_equal(v.n, 2);
  for (int i = 0; i < v.n; i++) {
    double p[3];
    sv_pose_centre(p, &v.frames[i].f.cam_from_world);
    sv_apply33(eye[i], turn.r, p);
  }
  lab_views_free(&v);
  lab_session_stop(&se);
  lab_shell_run_well(&shell, "unzip -qo m.sog -d x");
  const double without = seen_error(eye, 2);
  lab_shell_run_well(&shell, "unzip -qo seen.sog -d x");
  const double with = seen_error(eye, 2);
  print_message("colors as seen: RMS error %.4f without views, %.4f with them\n", sqrt(without), sqrt(with));
  assert_true(with < 0.04 * 0.04);
  print_message("bytes: %ld without views, %ld with them\n", size_of("m.sog"), size_of("seen.sog"));
  // Fewer bytes for as little loss.
  assert_true(size_of("seen.sog") < 0.9 * (double)size_of("m.sog"));
  assert_int_equal(lab_shell_run(&shell, "@ export --model m/model.ply --format ply --data ds --out x.ply"),
                   2);
  assert_contains(shell.said, "--data needs --keep-supported or --format sog");
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_upright),        cmocka_unit_test(test_crop),
                                     cmocka_unit_test(test_keep_supported), cmocka_unit_test(test_mesh),
                                     cmocka_unit_test(test_measure),        cmocka_unit_test(test_sog),
                                     cmocka_unit_test(test_sog_seen)};
  return cmocka_run_group_tests(tests, setup, teardown);
}
