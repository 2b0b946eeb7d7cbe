// SPDX-License-Identifier: Apache-2.0
// The folder of the paper's authors, made small: imported, and the protocol of each kind of scene
// checked one by one: which pictures are trained on, validated with and held out, the pixel
// budgets, the frame that train and test share, the sensor of the grids. SV_BIN names the
// programs' folder.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "platform/sim/sim.h"
#include "tests/common/exr_write.h"
#include "tests/common/lab_shell.h"
#include "tests/common/release_folder.h"
#include "tests/common/test.h"
#include "tools/common/exr.h"
#include "tools/dataset/measurement.h"

static lab_shell shell = {.cwd = ""};
static sv_err err;

FIXTURE(setup) {
  int code = lab_shell_open(&shell, "release");
  if (code != 0) return code < 0 ? code : 0;
  char root[300];
  snprintf(root, sizeof root, "%s/r", shell.root);
  release_folder_make(root);
  if (lab_shell_run(&shell, "@ import --from lightfield-release r --out d") != 0) {
    fprintf(stderr, "%s", shell.said);
    return -1;
  }
  shell.is_ready = true;
  return 0;
}

FIXTURE(teardown) { return lab_shell_close(&shell); }

// The views of a split of a dataset; freed by the caller.
static void open_views(lab_views *v, const char *dataset, const char *transforms, const char *split) {
  static char folder[600];
  sv_pool serial = sv_pool_serial();
  snprintf(folder, sizeof folder, "%s/d/%s", shell.root, dataset);
  const lab_source src = {.folder = folder,
                          .transforms = transforms,
                          .split = split,
                          .n_exposures = 0,
                          .is_multiplexed = true,
                          .scale = 1};
  assert_ok(lab_views_open(v, &src, &serial, &err), &err);
}

static int count_views(const char *dataset, const char *transforms, const char *split) {
  lab_views v;
  open_views(&v, dataset, transforms, split);
  const int n = v.n;
  lab_views_free(&v);
  return n;
}

static bool has_view(const lab_views *v, const char *name) {
  for (int i = 0; i < v->n; i++)
    if (strstr(v->frames[i].path, name)) return true;
  return false;
}

TEST(test_what_is_made) {
  lab_shell_need(&shell);
  assert_int_equal(lab_shell_run(&shell, "ls d | tr '\\n' ' '"), 0);
  assert_string_equal(shell.said,
                      "casual_toy_iphone casual_toy_stereo dynamic_toy_iphone dynamic_toy_stereo multiplexed "
                      "static_toy_iphone static_toy_lightfield static_toy_stereo synthetic_toy ");
}

// One exposure; evaluation frames are those of the phone's video for every device; the mono file of
// a device is its own camera.
TEST(test_static) {
  static const struct {
    const char *dataset, *file, *mono;
    int n;
  } cases[] = {
      {"static_toy_iphone", "transforms_train_phone.json", "iphone__wide", 3},
      {"static_toy_stereo", "transforms_train_stereo.json", "stereo__stereo_right", 2},
      {"static_toy_lightfield", "transforms_train_lightfield.json", "middle", 81},
  };
  lab_shell_need(&shell);
  for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
    lab_views v;
    open_views(&v, cases[i].dataset, cases[i].file, "train");
    assert_int_equal(v.n, cases[i].n);
    assert_false(has_view(&v, "eval__") || has_view(&v, "mono__"));
    for (int k = 0; k < v.n; k++) assert_true(v.frames[k].f.exposure == 0 && v.frames[k].f.sub_view == k);
    lab_views_free(&v);
    open_views(&v, cases[i].dataset, "transforms_train_mono.json", "train");
    assert_true(v.n == 1 && has_view(&v, cases[i].mono));
    lab_views_free(&v);
    open_views(&v, cases[i].dataset, cases[i].file, "test");
    assert_true(v.n == RELEASE_N_EVAL && has_view(&v, "eval__frame_00001"));
    lab_views_free(&v);
  }
}

// 81 sub-views have as many pixels together as the middle one alone, and see what it sees.
TEST(test_pixel_budget) {
  lab_views grid, mono;
  lab_shell_need(&shell);
  open_views(&grid, "static_toy_lightfield", "transforms_train_lightfield.json", "train");
  open_views(&mono, "static_toy_lightfield", "transforms_train_mono.json", "train");
  const sv_view *m = &mono.frames[0].view, *middle = &grid.frames[40].view;
  assert_true(m->width_px == RELEASE_LF_W && m->height_px == RELEASE_LF_H);
  assert_int_equal(81 * grid.frames[0].view.width_px * grid.frames[0].view.height_px,
                   m->width_px * m->height_px);
  assert_near(middle->fx * 9, m->fx, 1e-3);
  assert_near(middle->cx * 9, m->cx, 1e-3);
  float a[3], b[3];
  sv_view_centre(a, m);
  sv_view_centre(b, middle);
  assert_floats_near(a, b, 3, 1e-6);
  lab_views_free(&grid);
  lab_views_free(&mono);
}

// Train and test are of one model: a point that a training picture shows is in an evaluation
// picture's place, too.
TEST(test_alignment) {
  lab_views train, test;
  sv_point *points;
  float centre[3], radius;
  int n, n_in = 0;
  lab_shell_need(&shell);
  open_views(&train, "static_toy_stereo", "transforms_train_stereo.json", "train");
  open_views(&test, "static_toy_stereo", "transforms_train_stereo.json", "test");
  assert_true(*train.points);
  assert_ok(lab_points_read(train.points, &points, &n, centre, &radius, &err), &err);
  assert_in_range(n, 20, 10000);
  for (int i = 0; i < n; i++) {
    const sv_view *v = &test.frames[2].view;
    float x[3], uv[2], z;
    for (int a = 0; a < 3; a++)
      x[a] = v->r[3 * a] * points[i].mean[0] + v->r[3 * a + 1] * points[i].mean[1] +
             v->r[3 * a + 2] * points[i].mean[2] + v->t[a];
    n_in += sv_view_project(v, x, uv, &z) && uv[0] > 0 && uv[1] > 0 && uv[0] < (float)v->width_px &&
            uv[1] < (float)v->height_px;
  }
  assert_true(n_in > n / 2);
  free(points);
  lab_views_free(&train);
  lab_views_free(&test);
}

// Index % 8 of the names of all streams together is for validation; mono is the filter after that;
// all frames of the evaluation video are scored.
TEST(test_casual) {
  lab_views v;
  lab_shell_need(&shell);
  assert_int_equal(count_views("casual_toy_iphone", "transforms_train_phone.json", "val"),
                   3 * RELEASE_N_TRAIN / 8);
  assert_int_equal(count_views("casual_toy_iphone", "transforms_train_phone.json", "train"),
                   3 * RELEASE_N_TRAIN - 3 * RELEASE_N_TRAIN / 8);
  assert_int_equal(count_views("casual_toy_iphone", "transforms_train_phone.json", "test"), RELEASE_N_EVAL);
  open_views(&v, "casual_toy_iphone", "transforms_train_mono.json", "train");
  assert_int_equal(v.n, RELEASE_N_TRAIN - 1);
  // the 17th of the sorted names: tele, ultrawide, wide
  assert_true(has_view(&v, ".wide__frame_000002") && !has_view(&v, ".wide__frame_000001"));
  assert_false(has_view(&v, "ultrawide"));
  lab_views_free(&v);
  open_views(&v, "casual_toy_stereo", "transforms_train_stereo.json", "train");
  assert_int_equal(v.n, 2 * RELEASE_N_TRAIN - 2);
  int n_pairs = 0; // frames of one number are an exposure
  for (int i = 0; i < v.n; i++)
    for (int k = 0; k < i; k++)
      n_pairs += v.frames[i].f.exposure == v.frames[k].f.exposure && v.frames[i].f.sub_view == 1 &&
                 v.frames[k].f.sub_view == 0;
  assert_int_equal(n_pairs, RELEASE_N_TRAIN - 1);
  lab_views_free(&v);
}

// Frames 8 and 16 of every camera are held out; those of the reference stream are scored.
TEST(test_dynamic) {
  lab_views v;
  lab_shell_need(&shell);
  open_views(&v, "dynamic_toy_stereo", "transforms_train_stereo.json", "train");
  assert_int_equal(v.n, 2 * (RELEASE_N_FRAMES - 2));
  for (int i = 0; i < v.n; i++) {
    assert_true(v.frames[i].f.exposure % 8 != 0);
    assert_near(v.frames[i].f.time, (v.frames[i].f.exposure - 1) / (double)(RELEASE_N_FRAMES - 1), 1e-6);
  }
  lab_views_free(&v);
  assert_int_equal(count_views("dynamic_toy_stereo", "transforms_train_stereo.json", "test_time"), 4);
  open_views(&v, "dynamic_toy_stereo", "transforms_train_mono.json", "test_time");
  assert_true(v.n == 2 && has_view(&v, "right_002/frame_00008") && has_view(&v, "right_002/frame_00016"));
  lab_views_free(&v);
  open_views(&v, "dynamic_toy_iphone", "transforms_train_mono.json", "train");
  assert_true(v.n == RELEASE_N_FRAMES - 2 && has_view(&v, "wide_001/") && !has_view(&v, "ultrawide"));
  lab_views_free(&v);
}

// Group and view numbers order the frames. Lens images: 12 or 20 units of the sensor.
TEST(test_synthetic) {
  static const struct {
    const char *file;
    int n, n_exposures, side_px;
  } cases[] = {{"transforms_train_mono_1views.json", 1, 1, RELEASE_SIDE},
               {"transforms_train_mono_3views.json", 3, 3, RELEASE_SIDE},
               {"transforms_train_stereo_3views.json", 6, 3, RELEASE_SIDE},
               {"transforms_train_phone_1views.json", 3, 1, RELEASE_SIDE},
               {"transforms_train_lightfield_3views.json", 48, 3, 24},
               {"transforms_train_multiplexed_1views.json", 16, 1, 40}};
  lab_shell_need(&shell);
  for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
    lab_views v;
    open_views(&v, "synthetic_toy", cases[i].file, "train");
    assert_int_equal(v.n, cases[i].n);
    for (int k = 0; k < v.n; k++) {
      const lab_frame *f = &v.frames[k];
      assert_int_equal(f->view.width_px, cases[i].side_px);
      assert_int_equal(f->f.exposure, k * cases[i].n_exposures / cases[i].n);
      assert_near(f->view.fx / (float)f->view.width_px, 100.0f / RELEASE_SIDE, 1e-5f);
    }
    lab_views_free(&v);
  }
  assert_int_equal(count_views("synthetic_toy", "transforms_train_mono_1views.json", "test"), RELEASE_N_TEST);
  assert_int_equal(count_views("synthetic_toy", "transforms_train_mono_1views.json", "test_near"), 6);
}

// Depth of the test views, from world positions, is that of the simulator to half a step.
TEST(test_synthetic_depth) {
  static float depth[RELEASE_SIDE * RELEASE_SIDE], truth[RELEASE_SIDE * RELEASE_SIDE];
  static uint8_t rgb[3 * RELEASE_SIDE * RELEASE_SIDE];
  lab_views v;
  lab_loader loader = {0};
  sv_sim sim;
  sv_sim_config cfg;
  lab_shell_need(&shell);
  if (!lab_has_exr()) skip();
  assert_ok(sv_sim_parse(&cfg, "textured,rig=mono,size=256x256", &err), &err);
  const size_t bytes = sv_sim_bytes(&cfg) + SV_ARENA_ALIGN;
  void *block = malloc(bytes);
  assert_non_null(block);
  sv_arena a = sv_arena_make(block, bytes);
  assert_ok(sv_sim_init(&sim, &cfg, &a, &err), &err);
  open_views(&v, "synthetic_toy", "transforms_train_mono_1views.json", "test");
  assert_true(v.has_depth && v.n == RELEASE_N_TEST);
  for (int i = 0; i < v.n; i++) {
    const double unit = v.frames[i].f.depth_unit;
    int n = 0;
    assert_true(v.frames[i].f.depth_kind == SV_DEPTH_Z && unit > 0 && unit < 2e-4);
    assert_ok(lab_depth_load(&loader, &v.frames[i], 1, depth, &err), &err);
    sv_sim_render(&sim, &v.frames[i].view, 0, rgb, truth);
    for (size_t k = 0; k < RELEASE_SIDE * RELEASE_SIDE; k++) {
      assert_near(depth[k], truth[k], 0.5 * unit + 1e-5);
      n += truth[k] > 0;
    }
    assert_in_range(n, 500, RELEASE_SIDE * RELEASE_SIDE - 500);
  }
  lab_loader_free(&loader);
  lab_views_free(&v);
  free(block);
}

// Positions that cannot be read are told in one sentence with their file.
TEST(test_hostile_positions) {
  static float values[RELEASE_SIDE * RELEASE_SIDE];
  static const char *const cases[][2] = {
      {"truncate -s 2000 %s", "cannot be read as OpenEXR"},
      {"truncate -s 0 %s", "cannot be read as OpenEXR"},
      {"rm %s", "cannot be read as OpenEXR"},
      {"head -c 9000 /dev/urandom >%s", "cannot be read as OpenEXR"},
      {"cp other.exr %s", "has no channel V"},
      {"cp small.exr %s", "8x8 pixels; expected 96x96"},
      // the window's far corner, behind the words dataWindow and box2i and its size
      {"perl -pi -e 's/(dataWindow.box2i.....\\0{8}).{8}/$1\\x2f\\x75\\0\\0\\x2f\\x75\\0\\0/s' %s",
       "30000x30000 pixels; expected 96x96"},
  };
  char path[600];
  lab_shell_need(&shell);
  if (!lab_has_exr()) skip();
  snprintf(path, sizeof path, "%s/other.exr", shell.root);
  exr_write(path, &(exr_image){"Y", RELEASE_SIDE, RELEASE_SIDE, values});
  snprintf(path, sizeof path, "%s/small.exr", shell.root);
  exr_write(path, &(exr_image){"V", 8, 8, values});
  for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
    char line[400];
    lab_shell_run_well(&shell, "rm -rf h x && mkdir h && cp -r r/data/synthetic h/");
    snprintf(line, sizeof line, cases[i][0], "h/synthetic/toy/positions/position_y_0003.exr");
    lab_shell_run_well(&shell, line);
    assert_int_equal(lab_shell_run(&shell, "@ import --from lightfield-release h --out x"), 1);
    assert_contains(shell.said, "position_y_0003.exr");
    assert_contains(shell.said, cases[i][1]);
  }
}

// The overlapping grid: views are turned and transposed on the sensor, and four meet at most.
TEST(test_synthetic_sensor) {
  lab_views v;
  lab_shell_need(&shell);
  open_views(&v, "synthetic_toy", "transforms_train_multiplexed_3views.json", "train");
  assert_true(v.n == 48 && v.n_measurements == 3);
  assert_near(v.measurements[0].max_overlap, 9, 1e-9); // 40 px wide, every 18.7 px
  const sv_footprint *first = &v.frames[0].f.footprint, *second = &v.frames[1].f.footprint,
                     *last = &v.frames[15].f.footprint;
  assert_true(first->x0_px == 56 && first->y0_px == 56 && last->x0_px == 0 && last->y0_px == 0);
  assert_true(second->x0_px == 56 && second->y0_px == 37); // view_id runs down the sensor's columns
  lab_views_free(&v);
}

// A real sensor: lens images with their shares of light, cut to where they fall.
TEST(test_multiplexed) {
  lab_views v;
  sv_lens lenses[RELEASE_N_LENSES];
  sv_multiplexed model;
  lab_shell_need(&shell);
  open_views(&v, "multiplexed", "transforms_train_multiplexed.json", "train");
  assert_int_equal(v.n, RELEASE_N_LENSES);
  assert_true(v.measurements[0].width_px == 64 && v.measurements[0].height_px == 50);
  assert_near(v.measurements[0].max_overlap, 4, 1e-9);
  assert_ok(lab_measurement_lenses(&v, 0, lenses, &model, &err), &err);
  const sv_footprint *f = &lenses[0].footprint;
  assert_non_null(f->coverage);
  assert_true(f->coverage[0] < 128 && f->coverage[f->height_px / 2 * f->width_px + f->width_px / 2] == 255);
  assert_near(lenses[0].view.fx, 0.9 * RELEASE_SENSOR_W * 64 / RELEASE_SENSOR_W, 1e-3);
  assert_near(lenses[0].view.cx + (float)f->x0_px, 0.34 * 64, 1e-3);
  lab_views_free(&v);
  lab_shell_run_well(&shell, "@ train --data d/multiplexed --transforms transforms_train_multiplexed.json "
                             "--gaussians 60 --steps 3 --quiet --out m");
}

// One command makes the tables of all kinds; every cell of ours is filled.
TEST(test_tables) {
  const int last = lab_has_exr() ? 9 : 7; // with depth errors
  const struct {
    const char *file;
    int n_lines, first, last; // columns that must hold numbers
  } files[] = {{"t/static/real.csv", 19, 4, 11},
               {"t/casual/real.csv", 5, 4, 11},
               {"t/dynamic/dynamic.csv", 9, 7, 9},
               {"t/synthetic/summary.csv", 11, 5, last},
               {"t/multiplexed/sensor.csv", 3, 2, 4}};
  lab_shell_need(&shell);
  lab_shell_run_well(&shell, "@ tables --data d --steps 2 --gaussians 40 --jobs 1 --quiet --out t");
  for (size_t i = 0; i < sizeof files / sizeof *files; i++) {
    char *text = temp_read(shell.root, files[i].file), *line = text;
    int n = 0;
    for (; *line; line += strcspn(line, "\n") + 1, n++) {
      const char *cell = line;
      for (int k = 0; n && k <= files[i].last; k++, cell += strcspn(cell, ",\n") + 1) {
        char *end;
        const double v = strtod(cell, &end);
        if (k >= files[i].first && (end == cell || !isfinite(v)))
          fail_msg("%s: field %d of line %d is no number: %.150s", files[i].file, k, n + 1, line);
      }
    }
    assert_int_equal(n, files[i].n_lines);
    free(text);
  }
  // Both devices of a recording are compared over the same pixels.
  char *text = temp_read(shell.root, "t/static/real.csv");
  const char *mono = strstr(text, "toy,stereo,monocular,3DGS"),
             *both = strstr(text, "toy,stereo,stereo,3DGS");
  assert_true(mono && both);
  double own[2], shared[2];
  for (int i = 0; i < 2; i++)
    assert_int_equal(
        sscanf(i ? both : mono, "%*[^,],%*[^,],%*[^,],%*[^,],%lf,%*f,%*f,%*f,%lf", &own[i], &shared[i]), 2);
  assert_true(shared[0] == shared[1] && shared[0] > 0 && shared[0] <= own[0] && shared[0] <= own[1]);
  free(text);
  text = temp_read(shell.root, "t/static/tables.md");
  // the paper's mean: light field capture, monocular, 3DGS
  assert_contains(text, "| 26.24 | 0.656 | 0.243 |");
  assert_contains(text, "What differs from the paper");
  free(text);
}

// What cannot be used is told in one sentence.
TEST(test_refused) {
  lab_shell_need(&shell);
  assert_int_equal(lab_shell_run(&shell, "mkdir -p e && @ import --from lightfield-release e --out x"), 1);
  assert_contains(shell.said, "none of the folders casual, dynamic, multiplexed, synthetic");
  assert_int_equal(lab_shell_run(&shell, "mkdir -p v/casual/a/iphone-train v/casual/a/static && @ import "
                                         "--from lightfield-release v --out x"),
                   1);
  assert_contains(shell.said, "no capture has poses yet");
  assert_int_equal(lab_shell_run(&shell,
                                 "mkdir -p w && cp -r r/data/multiplexed w/ && cp "
                                 "r/data/synthetic/toy/test/r_0.png w/multiplexed/measurement.png && @ "
                                 "import --from lightfield-release w --out x"),
                   1);
  assert_contains(shell.said, "asks for 64x50");
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_what_is_made),    cmocka_unit_test(test_static),
      cmocka_unit_test(test_pixel_budget),    cmocka_unit_test(test_alignment),
      cmocka_unit_test(test_casual),          cmocka_unit_test(test_dynamic),
      cmocka_unit_test(test_synthetic),       cmocka_unit_test(test_synthetic_sensor),
      cmocka_unit_test(test_synthetic_depth), cmocka_unit_test(test_hostile_positions),
      cmocka_unit_test(test_multiplexed),     cmocka_unit_test(test_tables),
      cmocka_unit_test(test_refused)};
  return cmocka_run_group_tests(tests, setup, teardown);
}
