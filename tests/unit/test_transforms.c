// SPDX-License-Identifier: Apache-2.0
// Transforms JSON: axes, inherited and own intrinsics, finishing, labels, refusals.
// Every transforms file of the datasets in tests/data is read.
#include <glob.h>
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/str.h"
#include "src/format/transforms.h"
#include "tests/common/test.h"
#include "tools/common/fileio.h"

enum { CAP_TOK = 200000, CAP_FRAMES = 2000 };
static jsmntok_t tok[CAP_TOK];
static sv_transforms_frame frames[CAP_FRAMES];
static sv_transforms t;
static sv_err err;

static sv_status read_text(const char *text, size_t n) {
  sv_status s = sv_transforms_open(&t, &(sv_file_data){"t.json", text, n}, tok, CAP_TOK, &err);
  return s == SV_OK ? sv_transforms_read(&t, frames, CAP_FRAMES, &err) : s;
}

#define EYE "\"transform_matrix\":[[1,0,0,2],[0,1,0,3],[0,0,1,4],[0,0,0,1]]"

TEST(test_axes) {
  static const char text[] =
      "{\"camera_angle_x\":1.5707963267948966,\"frames\":[{\"file_path\":\"./a/r_0\"," EYE "}]}";
  assert_int_equal(read_text(text, sizeof text - 1), SV_OK);
  assert_int_equal(t.n_frames, 1);
  assert_string_equal(frames[0].file_path, "a/r_0");
  assert_false(frames[0].has_extension);
  // an OpenGL camera at (2,3,4) looks along -z: a point 5 in front, 1 right, 2 up is (1, -2, 5) for
  // OpenCV
  double x[3], world[3] = {2 + 1, 3 + 2, 4 - 5};
  sv_pose_apply(x, &frames[0].cam_from_world, world);
  assert_true(fabs(x[0] - 1) < 1e-12 && fabs(x[1] + 2) < 1e-12 && fabs(x[2] - 5) < 1e-12);
  assert_int_equal(sv_transforms_finish(&frames[0], 800, 600, &err), SV_OK);
  const sv_camera_model *m = &frames[0].model;
  assert_int_equal(m->kind, SV_MODEL_PINHOLE);
  assert_true(fabs(m->p[0] - 400) < 1e-9 && m->p[1] == m->p[0] && m->p[2] == 400 && m->p[3] == 300);
  assert_true(frames[0].exposure == -1 && frames[0].sub_view == -1 && frames[0].time == -1 &&
              frames[0].depth_unit == 0);
}

TEST(test_everything) {
  static const char text[] =
      "{\"fl_x\":500,\"fl_y\":510,\"cx\":320.5,\"cy\":240.25,\"w\":640.0,\"h\":480,\"k1\":0.1,\"p2\":-0.01,"
      "\"camera_model\":\"OPENCV\","
      "\"depth_scale\":8000,\"ply_file_path\":\"./points.ply\",\"ray_distance_unit\":0.00025,"
      "\"composites\":[{\"exposure\":0,\"file_path\":\"./c0.png\",\"M_max\":4}],\"frames\":["
      "{\"file_path\":\"a.JPG\",\"depth_path\":\"d/"
      "a.png\",\"exposure\":3,\"sub_view\":2,\"camera\":\"left\",\"time\":0.5,"
      "\"split\":\"test\",\"footprint\":[80,0,160,160]," EYE "},"
      "{\"file_path\":\"b.png\",\"camera_angle_x\":1.0,\"camera_angle_y\":0.8,\"k1\":0,\"p2\":0,\"w\":100,"
      "\"h\":50,\"ray_distance_path\":\"b_d.png\"," EYE "},"
      "{\"file_path\":\"c.png\",\"fl_x\":300,\"k3\":0.2," EYE "}]}";
  assert_int_equal(read_text(text, sizeof text - 1), SV_OK);
  assert_string_equal(t.ply_file_path, "points.ply");
  sv_transforms_frame *f = frames;
  assert_true(f->has_extension && f->depth_kind == SV_DEPTH_Z && f->depth_unit == 1.0 / 8000);
  assert_true(f->exposure == 3 && f->sub_view == 2 && f->time == 0.5);
  assert_string_equal(f->camera, "left");
  assert_string_equal(f->split, "test");
  assert_true(f->footprint.x0_px == 80 && f->footprint.height_px == 160);
  assert_int_equal(sv_transforms_finish(f, 640, 480, &err), SV_OK);
  assert_int_equal(f->model.kind, SV_MODEL_OPENCV4);
  const double want[8] = {500, 510, 320.5, 240.25, 0.1, 0, 0, -0.01};
  for (int i = 0; i < 8; i++) assert_true(f->model.p[i] == want[i]);
  assert_int_equal(sv_transforms_finish(f, 320, 200, &err), SV_E_FORMAT);
  assert_contains(err.text, "the image is 320x200, the transforms file says 640x480");
  sv_transforms_frame half = *f; // images_2 beside the camera of the full size
  assert_ok(sv_transforms_finish(&half, 320, 240, &err), &err);
  assert_true(half.model.width_px == 320 && half.model.p[0] == 250 && half.model.p[1] == 255);
  assert_true(half.model.p[2] == 160.25 && half.model.p[3] == 120.125 && half.model.p[4] == 0.1);
  f = &frames[1]; // the frame's angles replace the file's focal lengths
  assert_int_equal(sv_transforms_finish(f, 100, 50, &err), SV_OK);
  assert_int_equal(f->model.kind, SV_MODEL_PINHOLE);
  assert_true(fabs(f->model.p[0] - 50 / tan(0.5)) < 1e-9 && fabs(f->model.p[1] - 25 / tan(0.4)) < 1e-9);
  assert_true(f->depth_kind == SV_DEPTH_RAY && f->depth_unit == 0.00025);
  f = &frames[2];
  assert_int_equal(sv_transforms_finish(f, 640, 480, &err), SV_OK);
  assert_true(f->model.kind == SV_MODEL_OPENCV5 && f->model.p[0] == 300 && f->model.p[8] == 0.2);
  sv_transforms_measurement c;
  assert_int_equal(sv_transforms_find_measurement(&t, false, 0, &c, &err), SV_OK);
  assert_string_equal(c.file_path, "c0.png");
  assert_int_equal(c.max_overlap, 4);
  assert_int_equal(sv_transforms_find_measurement(&t, false, 1, &c, &err), SV_END);
  assert_int_equal(sv_transforms_find_measurement(&t, true, 0, &c, &err), SV_END);
  assert_int_equal(sv_transforms_read(&t, frames, 2, &err), SV_E_NOMEM);
}

TEST(test_small_errors_are_corrected) {
  static const char text[] = "{\"fl_x\":1,\"frames\":[{\"file_path\":\"a\",\"transform_matrix\":"
                             "[[0.8001,0.6,0.0002,0],[-0.6,0.7999,0,0],[0,0.0001,1.0001,0]]}]}";
  assert_int_equal(read_text(text, sizeof text - 1), SV_OK);
  assert_true(sv_rotation_error(frames[0].cam_from_world.r) < 1e-14);
  assert_true(fabs(frames[0].cam_from_world.r[0] - 0.8) < 2e-4);
}

TEST(test_fisheye) {
  static const char text[] =
      "{\"camera_model\":\"OPENCV_FISHEYE\",\"fl_x\":1,\"k1\":0.1,\"k2\":0.2,\"k3\":0.3,"
      "\"k4\":0.4,\"frames\":[{\"file_path\":\"a\"," EYE "}]}";
  assert_int_equal(read_text(text, sizeof text - 1), SV_OK);
  assert_int_equal((int)frames[0].model.kind, SV_MODEL_KB4);
  for (int i = 0; i < 4; i++) assert_true(frames[0].model.p[4 + i] == 0.1 * (i + 1) || i == 2);
}

TEST(test_refused) {
#define F(top, frame) "{\"fl_x\":1," top "\"frames\":[{\"file_path\":\"a\"," frame "}]}"
#define M(m)          F("", "\"transform_matrix\":" m)
  static const struct {
    const char *text, *word;
    sv_status s;
  } cases[] = {
      {"[]", "object", SV_E_FORMAT},
      {"{}", "\"frames\" is missing", SV_E_NOT_FOUND},
      {"{\"frames\":3}", "array of frames", SV_E_FORMAT},
      {"{\"frames\":[]}", "no frames", SV_E_NOT_FOUND},
      {"{\"frames\":[1]}", "not an object", SV_E_FORMAT},
      {"{\"fl_x\":1,\"frames\":[{" EYE "}]}", "file_path", SV_E_NOT_FOUND},
      {"{\"frames\":[{\"file_path\":\"a\"," EYE "}]}", "camera_angle_x", SV_E_NOT_FOUND},
      {"{\"camera_angle_x\":3.2,\"frames\":[{\"file_path\":\"a\"," EYE "}]}", "radians", SV_E_RANGE},
      {F("", "\"x\":1"), "transform_matrix", SV_E_NOT_FOUND},
      {F("\"camera_model\":\"EQUIRECTANGULAR\",", EYE), "EQUIRECTANGULAR is not supported", SV_E_UNSUPPORTED},
      {F("\"is_fisheye\":3,", EYE), "true or false", SV_E_FORMAT},
      {F("\"k4\":0.1,", EYE), "r^8", SV_E_UNSUPPORTED},
      {F("\"w\":0,", EYE), "outside 1", SV_E_RANGE},
      {F("", "\"fl_x\":-1," EYE), "positive", SV_E_RANGE},
      {F("", "\"time\":1.5," EYE), "outside 0 to 1", SV_E_RANGE},
      {F("", "\"exposure\":\"x\"," EYE), "number was expected", SV_E_FORMAT},
      {F("", "\"footprint\":[0,0,0,5]," EYE), "whole pixels", SV_E_RANGE},
      {F("\"depth_scale\":0,", "\"depth_path\":\"d\"," EYE), "unit of depth", SV_E_RANGE},
      {M("[[1,0,0,0],[0,1,0,0]]"), "rows", SV_E_FORMAT},
      {M("[[1,0,0,0],[0,1,0,0],[0,0,1]]"), "4 numbers", SV_E_FORMAT},
      {M("[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,2]]"), "last row", SV_E_FORMAT},
      {M("[[1,0,0,0],[0,1,0,0],[0,0,1.01,0]]"), "not a rotation", SV_E_FORMAT},
      {M("[[1,0,0,0],[0,1,0,0],[0,0,-1,0]]"), "not a rotation", SV_E_FORMAT}, // a reflection
      {M("[[1,0,0,NaN],[0,1,0,0],[0,0,1,0]]"), "not JSON", SV_E_FORMAT},
      {M("[[1,0,0,1e300],[0,1,0,0],[0,0,1,0]]"), "camera's position is 1e300 m", SV_E_RANGE},
  };
  for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
    sv_status s = read_text(cases[i].text, strlen(cases[i].text));
    assert_error(s, cases[i].s, &err, cases[i].word);
  }
}

// A file's frames, finished for pictures of side_px where it does not tell their size.
static int frames_of(const char *path, int side_px) {
  void *text;
  size_t bytes;
  assert_ok(sv_file_read(path, &text, &bytes, &err), &err);
  if (read_text(text, bytes) != SV_OK) fail_msg("%s: %s", path, err.text);
  for (int i = 0; i < t.n_frames; i++) {
    const sv_camera_model *m = &frames[i].model;
    if (sv_transforms_finish(&frames[i], m->width_px ? m->width_px : side_px,
                             m->height_px ? m->height_px : side_px, &err) != SV_OK)
      fail_msg("%s: %s", path, err.text);
  }
  free(text);
  return t.n_frames;
}

TEST(test_datasets) {
  glob_t files;
  int n_frames = 0;
  assert_int_equal(glob("tests/data/*/transforms*.json", 0, NULL, &files), 0);
  for (size_t i = 0; i < files.gl_pathc; i++) n_frames += frames_of(files.gl_pathv[i], 200);
  assert_int_equal(files.gl_pathc, 8);
  assert_int_equal(n_frames, 32 + 8 + 6 + 1 + 2 + 3 + 16 + 16); // mic_200, then kitchen
  globfree(&files);
  assert_int_equal(frames_of("tests/data/mic_200/transforms_train.json", 200), 32);
  assert_true(fabs(frames[0].model.p[0] - 277.7777) < 1e-3 && frames[0].depth_unit == 0);
  assert_int_equal(frames_of("tests/data/kitchen/transforms_test_near.json", 0), 6);
  assert_true(frames[0].depth_kind == SV_DEPTH_Z && fabs(frames[0].depth_unit - 1.0 / 8000) < 1e-12);
  assert_int_equal(frames_of("tests/data/kitchen/transforms_train_multiplexed_theta10.json", 0), 16);
  sv_transforms_measurement c;
  for (int is_linear = 0; is_linear < 2; is_linear++) {
    assert_int_equal(sv_transforms_find_measurement(&t, is_linear, 0, &c, &err), SV_OK);
    assert_int_equal(c.max_overlap, 4);
  }
  assert_true(frames[15].footprint.x0_px == 240 && frames[15].footprint.y0_px == 240);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_axes),
                                     cmocka_unit_test(test_everything),
                                     cmocka_unit_test(test_small_errors_are_corrected),
                                     cmocka_unit_test(test_fisheye),
                                     cmocka_unit_test(test_refused),
                                     cmocka_unit_test(test_datasets)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
