// SPDX-License-Identifier: Apache-2.0
// From raw pictures of a simulated lenslet camera to a dataset: a textured plane at a known
// distance must be where the rig of the result sees it, in all sub-views.
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "src/format/rig_file.h"
#include "src/rig/lenslet.h"
#include "tests/common/test.h"
#include "tools/common/imageio.h"
#include "tools/lab/lab.h"

enum { W = 300, H = 280, KEEP = 5 };
#define PITCH_PX   10.0
#define TURN_RAD   0.02
#define FOCAL_PX   40.0
#define BASELINE_M 0.004
#define FOCUS_M    0.5
#define PLANE_M    0.3

static char folder[256];
static sv_err err;

static double texture(double x_m, double y_m, int channel) {
  double k = 2 * 3.14159265358979 * FOCAL_PX / PLANE_M; // cycles per pixel of a sub-view
  return 0.45 + 0.2 * cos(k * (0.06 * x_m + 0.03 * y_m) + channel) + 0.1 * cos(k * (0.09 * y_m - 0.04 * x_m));
}

// A lenslet's pixel sees the plane along the ray through its place in the aperture.
static void expose(const char *name, int n_channels, bool is_white) {
  sv_bitmap b = {.width_px = W, .height_px = H, .n_channels = n_channels, .bits = 16};
  char path[440];
  double cs = cos(TURN_RAD), sn = sin(TURN_RAD);
  b.u16 = malloc(2 * (size_t)(W * H * n_channels));
  for (int i = 0; i < W * H * n_channels; i++) {
    int px = i / n_channels, channel = i % n_channels;
    double sum = 0;
    for (int k = 0; k < 16; k++) {
      double x = px % W + (k % 4 + 0.5) / 4 - W / 2.0, y = px / W + (k / 4 + 0.5) / 4 - H / 2.0;
      double s = (cs * x + sn * y) / PITCH_PX, t = (cs * y - sn * x) / PITCH_PX;
      double ls = floor(s + 0.5), lt = floor(t + 0.5), u = (s - ls) * PITCH_PX, v = (t - lt) * PITCH_PX;
      double r2 = (u * u + v * v) / (0.23 * PITCH_PX * PITCH_PX);
      double shade = (r2 < 1 ? 1 - 0.3 * r2 : 0) * (1 - 0.2 * (x * x + y * y) / (W * W / 4.0));
      double away = 1 - PLANE_M / FOCUS_M;
      sum += shade *
             (is_white ? 0.8
                       : texture(ls * PLANE_M / FOCAL_PX + BASELINE_M * u * away,
                                 lt * PLANE_M / FOCAL_PX + BASELINE_M * v * away, channel)) /
             16;
    }
    b.u16[i] = (uint16_t)(sum * 65535 + 0.5);
  }
  assert_int_equal(sv_path_join(path, sizeof path, folder, name, &err), SV_OK);
  assert_ok(sv_bitmap_write_png(path, &b, &err), &err);
  sv_bitmap_free(&b);
}

static double bilinear(const sv_bitmap *b, double x, double y, int c) {
  int i = (int)floor(x - 0.5), j = (int)floor(y - 0.5);
  double fx = x - 0.5 - i, fy = y - 0.5 - j, v[4];
  for (int k = 0; k < 4; k++)
    v[k] = b->u16[((j + (k >> 1)) * b->width_px + i + (k & 1)) * b->n_channels + c] / 65535.0;
  return (v[0] * (1 - fx) + v[1] * fx) * (1 - fy) + (v[2] * (1 - fx) + v[3] * fx) * fy;
}

// Points of the plane, through pose and model of each sub-view, against what the picture has there.
// Returns the mean of the picture over that of the plane; checks errors when scale is above 0.
static double check_views(const char *out, const sv_rig *rig, double scale) {
  double worst = 0, sum = 0, seen = 0, there = 0;
  int n = 0;
  for (int i = 0; i < rig->n_sub_views; i++) {
    const sv_sub_view *s = &rig->sub_views[i];
    char path[440];
    sv_bitmap b;
    snprintf(path, sizeof path, "%s/images/%s/000000.png", out, s->name);
    assert_ok(sv_bitmap_read(path, &b, &err), &err);
    assert_true(b.bits == 16 && b.n_channels == 3 && b.width_px == s->model.width_px);
    for (int k = 0; k < 300; k++) {
      double x[3] = {(k % 20 - 9.3) * 0.008, (k / 20 - 7.1) * 0.008, PLANE_M}, c[3], uv[2];
      sv_pose_apply(c, &s->cam_from_rig, x);
      if (!sv_model_project(&s->model, c, uv, NULL, NULL) || uv[0] < 1 || uv[1] < 1 ||
          uv[0] > b.width_px - 1 || uv[1] > b.height_px - 1)
        continue;
      double value = bilinear(&b, uv[0], uv[1], k % 3), want = texture(x[0], x[1], k % 3);
      double e = fabs(value - scale * want);
      seen += value;
      there += want;
      sum += e;
      n++;
      worst = e > worst ? e : worst;
    }
    sv_bitmap_free(&b);
  }
  if (scale == 0) return seen / there;
  print_message("plane seen in %d sub-views: mean error %.4f, worst %.4f, %d points\n", rig->n_sub_views,
                sum / n, worst, n);
  assert_true(n > 25 * 200);
  // a wrong sign or shift of one step gives 0.05 on average
  assert_true(sum / n < 0.01 && worst < 0.06);
  return seen / there;
}

TEST(test_import) {
  static uint8_t rig_block[64 << 10], scratch_block[256 << 10];
  char out[400], path[440];
  expose("white.png", 1, true);
  expose("raw_a.png", 3, false);
  snprintf(out, sizeof out, "%s/out", folder);
  lab_options o = {.from = "lenslet",
                   .input = folder,
                   .out = out,
                   .keep = KEEP,
                   .focal_px = FOCAL_PX,
                   .baseline_m = BASELINE_M,
                   .focus_m = FOCUS_M,
                   .is_quiet = true};
  assert_int_equal(lab_cmd_import(&o), LAB_EXIT_OK);
  sv_arena a = sv_arena_make(rig_block, sizeof rig_block);
  sv_arena scratch = sv_arena_make(scratch_block, sizeof scratch_block);
  sv_rig rig;
  snprintf(path, sizeof path, "%s/rig", out);
  assert_int_equal(sv_rig_init(&rig, KEEP * KEEP, &a), SV_OK);
  sv_file_reader files = {path, sv_folder_read};
  assert_ok(sv_rig_read(&rig, &files, KEEP * KEEP, &scratch, &err), &err);
  assert_true(rig.n_sub_views == KEEP * KEEP && rig.forward == SV_FORWARD_LIGHT_FIELD);
  assert_true(rig.sub_views[0].model.width_px >= 26 && rig.sub_views[0].model.height_px >= 24);
  // The white image's 99th percentile is what decoded values are scaled to: a little below its
  // peak.
  double scale = check_views(out, &rig, 0);
  assert_true(scale > 0.85 && scale <= 1);
  check_views(out, &rig, scale);

  // The dataset is read back as any other.
  lab_views v;
  sv_pool serial = sv_pool_serial();
  lab_source src = {.folder = out, .transforms = "transforms.json", .split = "all", .scale = 1};
  assert_ok(lab_views_open(&v, &src, &serial, &err), &err);
  assert_int_equal(v.n, KEEP * KEEP);
  assert_int_equal(v.frames[7].f.sub_view, 7);
  assert_true(fabs(v.frames[7].f.model.p[2] - rig.sub_views[7].model.p[2]) < 1e-9);
  lab_views_free(&v);
}

TEST(test_refusals) {
  char out[400], path[440];
  snprintf(out, sizeof out, "%s/out2", folder);
  lab_options o = {.from = "lenslet", .input = folder, .out = out, .keep = 15, .is_quiet = true};
  assert_int_equal(lab_cmd_import(&o), LAB_EXIT_FAILED); // 15 samples do not fit in 10 px
  o.keep = -1;
  snprintf(path, sizeof path, "%s/raw_a.png", folder);
  unlink(path);
  assert_int_equal(lab_cmd_import(&o), LAB_EXIT_FAILED); // a white image alone
  snprintf(path, sizeof path, "%s/white.png", folder);
  unlink(path);
  assert_int_equal(lab_cmd_import(&o), LAB_EXIT_FAILED); // nothing
}

FIXTURE(make_folder) { return temp_folder_make(folder, sizeof folder, "import_lenslet"); }

FIXTURE(remove_folder) { return temp_folder_remove(folder); }

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_import), cmocka_unit_test(test_refusals)};
  return cmocka_run_group_tests(tests, make_folder, remove_folder);
}
