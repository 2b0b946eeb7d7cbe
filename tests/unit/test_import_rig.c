// SPDX-License-Identifier: Apache-2.0
// Rigs at import: COLMAP models whose frames place images that are not registered, and poses of one
// camera that place all sub-views of a rig. Which frames of several files, with and without marks,
// a split is.
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tests/common/test.h"
#include "tools/common/imageio.h"
#include "tools/import/recording.h"
#include "tools/import/import.h"

static char folder[256];
static sv_err err;

static void put(const char *name, const char *text) {
  char path[400], up[400];
  snprintf(path, sizeof path, "%s/%s", folder, name);
  sv_path_folder(up, sizeof up, path);
  assert_int_equal(sv_path_make_folder(up, &err), SV_OK);
  assert_int_equal(sv_file_write(path, text, strlen(text), &err), SV_OK);
}

static void put_picture(const char *name, int value) {
  char path[400];
  sv_bitmap b = {.width_px = 16, .height_px = 12, .n_channels = 3, .bits = 8};
  put(name, ""); // makes the folder
  snprintf(path, sizeof path, "%s/%s", folder, name);
  b.u8 = malloc(16 * 12 * 3);
  memset(b.u8, value, 16 * 12 * 3);
  assert_int_equal(sv_bitmap_write_png(path, &b, &err), SV_OK);
  sv_bitmap_free(&b);
}

static int unlink_in(const char *name) {
  char path[400];
  snprintf(path, sizeof path, "%s/%s", folder, name);
  return remove(path);
}

static const lab_frame *view_of(const lab_views *v, const char *name) {
  for (int i = 0; i < v->n; i++)
    if (strstr(v->frames[i].f.file_path, name)) return &v->frames[i];
  fail_msg("%s is not among the views", name);
  return NULL;
}

// Camera centre, exposure and sub-view of a view, and that its picture is the one it was made with.
static void check_view(const lab_views *v, const char *name, const double centre[3], int exposure,
                       int sub_view, int value) {
  const lab_frame *f = view_of(v, name);
  double at[3];
  sv_bitmap b;
  sv_pose_centre(at, &f->f.cam_from_world);
  for (int k = 0; k < 3; k++)
    if (!(fabs(at[k] - centre[k]) < 1e-9)) fail_msg("%s: centre[%d] %g, not %g", name, k, at[k], centre[k]);
  assert_int_equal(f->f.exposure, exposure);
  assert_int_equal(f->f.sub_view, sub_view);
  assert_int_equal(sv_bitmap_read(f->path, &b, &err), SV_OK);
  assert_int_equal(b.u8[0], value);
  sv_bitmap_free(&b);
}

static void open_dataset(lab_views *v, const char *name) {
  static char path[400];
  sv_pool serial = sv_pool_serial();
  snprintf(path, sizeof path, "%s/%s", folder, name);
  lab_source src = {.folder = path, .transforms = "transforms.json", .split = "all", .scale = 1};
  assert_ok(lab_views_open(v, &src, &serial, &err), &err);
}

static int import_stream(const char *in, const char *out, const char *rig, const char *stream,
                         double unit_m) {
  char from_path[400], to_path[400], rig_path[400];
  snprintf(from_path, sizeof from_path, "%s/%s", folder, in);
  snprintf(to_path, sizeof to_path, "%s/%s", folder, out);
  snprintf(rig_path, sizeof rig_path, "%s/%s", folder, rig);
  lab_options o = {.from = "nerfstudio",
                   .input = from_path,
                   .out = to_path,
                   .rig = rig_path,
                   .stream = stream,
                   .unit_m = unit_m,
                   .is_quiet = true};
  return lab_cmd_import(&o);
}

static int import(const char *from, const char *in, const char *out) {
  char from_path[400], to_path[400];
  snprintf(from_path, sizeof from_path, "%s/%s", folder, in);
  snprintf(to_path, sizeof to_path, "%s/%s", folder, out);
  lab_options o = {.from = from, .input = from_path, .out = to_path, .is_quiet = true};
  return lab_cmd_import(&o);
}

// The right camera stands 0.5 to the right of the left one; frame k at x = k, frame 3 turned by a
// quarter about y.
#define FRAMES "1 1 1 0 0 0 -1 0 0 2 CAMERA 5 1 CAMERA 9 2\n2 1 1 0 0 0 -2 0 0 2 CAMERA 5 3 CAMERA 9 4\n"
#define TURN   "3 1 0.70710678118654752 0 0.70710678118654752 0 0 0 0 1 CAMERA 5 5\n"

TEST(test_colmap) {
  lab_views v;
  put("a/sparse/0/cameras.txt", "5 PINHOLE 16 12 20 20 8 6\n9 PINHOLE 16 12 21 21 8 6\n");
  put("a/sparse/0/rigs.txt", "1 2 CAMERA 5 CAMERA 9 1 1 0 0 0 -0.5 0 0\n");
  put("a/sparse/0/frames.txt", FRAMES TURN);
  put("a/sparse/0/images.txt", "1 1 0 0 0 -1 0 0 5 rig/left/a.png\n\n2 1 0 0 0 -1.5 0 0 9 rig/right/a.png\n\n"
                               "3 1 0 0 0 -2 0 0 5 rig/left/b.png\n\n"
                               "5 0.70710678 0 0.70710678 0 0 0 0 5 rig/left/c.png\n\n");
  for (int i = 0; i < 6; i++) {
    char name[64];
    snprintf(name, sizeof name, "a/images/rig/%s/%c.png", i % 2 ? "right" : "left", 'a' + i / 2);
    put_picture(name, 40 * i);
  }
  assert_int_equal(import("colmap", "a", "a_out"), LAB_EXIT_OK);
  open_dataset(&v, "a_out");
  assert_int_equal(v.n, 6);
  check_view(&v, "left/a", (double[3]){1, 0, 0}, 0, 0, 0);
  check_view(&v, "right/a", (double[3]){1.5, 0, 0}, 0, 1, 40);
  check_view(&v, "left/b", (double[3]){2, 0, 0}, 1, 0, 80);
  // listed in its frame, not registered
  check_view(&v, "right/b", (double[3]){2.5, 0, 0}, 1, 1, 120);
  // Not even listed. rig_from_world takes x to -z, so 0.5 to the right in the rig is 0.5 along z in
  // the world.
  check_view(&v, "right/c", (double[3]){0, 0, 0.5}, 2, 1, 200);
  assert_true(view_of(&v, "right/c")->f.model.p[0] == 21); // the right camera's lens
  lab_views_free(&v);
}

TEST(test_colmap_without) {
  lab_views v;
  char command[600];
  put("a/sparse/0/rigs.txt", "1 2 CAMERA 5 CAMERA 9 0\n"); // the rig's pose is not known
  assert_int_equal(import("colmap", "a", "b_out"), LAB_EXIT_OK);
  open_dataset(&v, "b_out");
  assert_int_equal(v.n, 4);
  check_view(&v, "right/a", (double[3]){1.5, 0, 0}, 0, 1, 40); // as registered
  lab_views_free(&v);
  put("a/sparse/0/rigs.txt", "1 2 CAMERA 5 CAMERA 9 1 1 0 0 0 -0.5 0 0\n");
  snprintf(command, sizeof command, "rm '%s/a/images/rig/right/b.png'", folder);
  assert_int_equal(system(command), 0);
  // a picture that is not there is left out
  assert_int_equal(import("colmap", "a", "c_out"), LAB_EXIT_OK);
  open_dataset(&v, "c_out");
  assert_int_equal(v.n, 5);
  lab_views_free(&v);
  put("a/sparse/0/rigs.txt", "1 2 CAMERA 5 CAMERA 9 1 1 0 0 0 -0.5 0\n");
  assert_int_equal(import("colmap", "a", "d_out"), LAB_EXIT_FAILED);
}

// One folder for both cameras: the name of a frame's picture does not lead to the other's.
TEST(test_colmap_one_folder) {
  lab_views v;
  put("e/cameras.txt", "5 PINHOLE 16 12 20 20 8 6\n9 PINHOLE 16 12 21 21 8 6\n");
  put("e/rigs.txt", "1 2 CAMERA 5 CAMERA 9 1 1 0 0 0 -0.5 0 0\n");
  put("e/frames.txt", FRAMES);
  put("e/images.txt",
      "1 1 0 0 0 -1 0 0 5 l0.png\n\n2 1 0 0 0 -1.5 0 0 9 r0.png\n\n3 1 0 0 0 -2 0 0 5 l1.png\n\n");
  put_picture("e/l0.png", 1);
  put_picture("e/r0.png", 2);
  put_picture("e/l1.png", 3);
  put_picture("e/r1.png", 4);
  assert_int_equal(import("colmap", "e", "e_out"), LAB_EXIT_OK);
  open_dataset(&v, "e_out");
  assert_int_equal(v.n, 3);
  check_view(&v, "l1", (double[3]){2, 0, 0}, 1, 0, 3);
  lab_views_free(&v);
}

// Left stands at x = -0.1 in the rig, right at x = 0.1 and turned by a quarter about its axis, top
// at y = -0.3.
static void put_rig(void) {
  static sv_sub_view views[3] = {
      {.name = "left", .i_camera = 0}, {.name = "right", .i_camera = 1}, {.name = "top"}};
  sv_rig rig = {.name = "three", .n_sub_views = 3, .cap_sub_views = 3, .sub_views = views};
  static const double quarter[9] = {0, -1, 0, 1, 0, 0, 0, 0, 1};
  char path[400];
  for (int i = 0; i < 3; i++) {
    views[i].i_camera = i;
    views[i].model =
        (sv_camera_model){.kind = SV_MODEL_PINHOLE, .width_px = 16, .height_px = 12, .p = {30 + i, 30, 8, 6}};
    views[i].cam_from_rig = sv_pose_identity();
  }
  views[0].cam_from_rig.t[0] = 0.1;
  memcpy(views[1].cam_from_rig.r, quarter, sizeof quarter);
  views[1].cam_from_rig.t[1] = -0.1;
  views[2].cam_from_rig.t[1] = 0.3;
  snprintf(path, sizeof path, "%s/rig", folder);
  assert_ok(lab_rig_write(&rig, path, &err), &err);
}

#define EYE "\"transform_matrix\": [[1,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]]"

// OpenGL's camera-to-world: the camera at z = 4 looks along -z, that at x = 1 likewise turned by a
// quarter about y.
static void put_stream(void) {
  put("s/transforms.json",
      "{\"fl_x\": 25, \"fl_y\": 25, \"cx\": 8, \"cy\": 6, \"w\": 16, \"h\": 12, \"ply_file_path\": "
      "\"p.ply\", "
      "\"frames\": [\n"
      "{\"file_path\": \"images/left/0.png\", \"split\": \"test\", "
      "\"transform_matrix\": [[1,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]]},\n"
      "{\"file_path\": \"images/right/0.png\", " // what it says about this one is replaced
      "\"transform_matrix\": [[1,0,0,9],[0,1,0,9],[0,0,1,9],[0,0,0,1]]},\n"
      "{\"file_path\": \"images/left/1.png\", "
      "\"transform_matrix\": [[0,0,1,1],[0,1,0,0],[-1,0,0,0],[0,0,0,1]]}]}\n");
  put("s/p.ply",
      "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n"
      "end_header\n1 2 3\n-1 0 1\n");
  put_picture("s/images/left/0.png", 10);
  put_picture("s/images/left/1.png", 20);
  put_picture("s/images/right/0.png", 30);
  put_picture("s/images/right/1.png", 40);
  put_picture("s/images/top/1.png", 50);
}

TEST(test_stream) {
  lab_views v;
  float centre[3], radius;
  sv_point *points;
  int n;
  put_rig();
  put_stream();
  assert_int_equal(import_stream("s", "s_out", "rig", "left", 2), LAB_EXIT_OK);
  open_dataset(&v, "s_out");
  assert_int_equal(v.n, 5); // top has no picture of exposure 0
  check_view(&v, "left/0", (double[3]){0, 0, 8}, 0, 0, 10);
  // the baseline is the rig's, not scaled
  check_view(&v, "right/0", (double[3]){0.2, 0, 8}, 0, 1, 30);
  check_view(&v, "left/1", (double[3]){2, 0, 0}, 1, 0, 20);
  // Its right is -z of the world, its down -y. Top: 0.1 to the right and 0.3 up.
  check_view(&v, "right/1", (double[3]){2, 0, -0.2}, 1, 1, 40);
  check_view(&v, "top/1", (double[3]){2, 0.3, -0.1}, 1, 2, 50);
  assert_true(view_of(&v, "left/0")->f.model.p[0] == 25 && view_of(&v, "right/0")->f.model.p[0] == 31);
  // what is held out stays so in all sub-views
  assert_string_equal(view_of(&v, "right/0")->f.split, "test");
  assert_string_equal(view_of(&v, "top/1")->f.camera, "top");
  // right is left turned by a quarter about the axis: what is to the right of left is below for
  // right.
  double at[3], x[3] = {0.2 + 0.5, 0, 6};
  sv_pose_apply(at, &view_of(&v, "right/0")->f.cam_from_world, x);
  assert_true(fabs(at[0]) < 1e-9 && fabs(at[1] - 0.5) < 1e-9 && fabs(at[2] - 2) < 1e-9);
  assert_int_equal(lab_points_read(v.points, &points, &n, centre, &radius, &err), SV_OK);
  assert_true(n == 2 && points[0].mean[2] == 6);
  free(points);
  lab_views_free(&v);
}

// Depth without a unit is in thousandths of a unit that is not a metre any more; exposure numbers
// that are given stay alone.
TEST(test_stream_numbers) {
  lab_views v;
  put_rig();
  put("n/transforms.json",
      "{\"fl_x\": 25, \"frames\": [\n"
      "{\"file_path\": \"images/left/0.png\", \"exposure\": 1, \"depth_path\": \"images/left/d.png\", " EYE
      "},\n"
      "{\"file_path\": \"images/left/1.png\", " EYE "}]}\n");
  put_picture("n/images/left/0.png", 10);
  put_picture("n/images/left/1.png", 20);
  put_picture("n/images/right/0.png", 30);
  put_picture("n/images/right/1.png", 40);
  put_picture("n/images/left/d.png", 50);
  assert_int_equal(import_stream("n", "n_out", "rig", "left", 2), LAB_EXIT_OK);
  open_dataset(&v, "n_out");
  assert_int_equal(view_of(&v, "left/0")->f.exposure, 1);
  assert_int_equal(view_of(&v, "left/1")->f.exposure, 2);
  assert_true(fabs(view_of(&v, "left/0")->f.depth_unit - 0.002) < 1e-12);
  lab_views_free(&v);
}

// "a b c": the names of a split's views; `want` NULL: there is no such split.
static void check_split(const char *name, const char *split, const char *want) {
  char path[400], at[SV_CAP_PATH], all[400] = "";
  lab_views v;
  sv_pool serial = sv_pool_serial();
  snprintf(path, sizeof path, "%s/%s", folder, name);
  lab_source src = {.folder = path, .split = split, .scale = 1};
  sv_status s = lab_views_open(&v, &src, &serial, &err);
  assert_int_equal(s, want ? SV_OK : SV_E_NOT_FOUND);
  if (!want) return;
  for (int i = 0; i < v.n; i++) {
    lab_view_name(&v, i, at, sizeof at);
    snprintf(all + strlen(all), sizeof all - strlen(all), "%s%.60s", i ? " " : "", at);
  }
  assert_string_equal(all, want);
  lab_views_free(&v);
}

#define FRAME(name, more) "{\"file_path\": \"" name "\", " more EYE "}"
#define MARK(split)       "\"split\": \"" split "\", "

TEST(test_splits) {
  static const char *const names[] = {"a", "b", "c", "d", "e"};
  for (int i = 0; i < 5; i++) {
    char name[40];
    snprintf(name, sizeof name, "m/%s.png", names[i]);
    put_picture(name, i);
  }
  put("m/transforms.json", "{\"fl_x\": 25, \"frames\": [" FRAME("a.png", "") "," FRAME(
                               "b.png", MARK("test_time")) "," FRAME("c.png", MARK("test")) "]}");
  check_split("m", "train", "a");
  check_split("m", "test", "c"); // not the held-out time
  check_split("m", "test_time", "b");
  check_split("m", "test_near", "c"); // no mark: the nearest of test
  put("m/transforms.json",
      "{\"fl_x\": 25, \"frames\": [" FRAME("a.png", "") "," FRAME("b.png", MARK("test_time")) "," FRAME(
          "c.png", MARK("test_view")) "," FRAME("d.png", MARK("test_near")) "]}");
  check_split("m", "test", "c d"); // none is marked so
  check_split("m", "test_near", "d");
  put("m/transforms.json",
      "{\"fl_x\": 25, \"frames\": [" FRAME("a.png", "") "," FRAME("b.png", MARK("test_time")) "]}");
  check_split("m", "test", "b"); // nothing else is held out
  // Files of their own beside transforms.json go into the import, too.
  put("m/transforms_test.json", "{\"fl_x\": 25, \"frames\": [" FRAME("c.png", "") "]}");
  put("m/transforms_test_near.json", "{\"fl_x\": 25, \"frames\": [" FRAME("d.png", "") "]}");
  check_split("m", "test", "c");
  assert_int_equal(import("nerfstudio", "m", "m_out"), LAB_EXIT_OK);
  check_split("m_out", "train", "a");
  check_split("m_out", "test", "c");
  check_split("m_out", "test_near", "d");
  check_split("m_out", "test_time", "b");
  put("m/transforms.json", "{\"fl_x\": 25, \"frames\": [" FRAME("a.png", "") "," FRAME("b.png", "") "]}");
  assert_int_equal(unlink_in("m/transforms_test.json"), 0);
  assert_int_equal(import("nerfstudio", "m", "k_out"), LAB_EXIT_OK);
  check_split("k_out", "train", "b"); // every 8th is held out, as without the import
  check_split("k_out", "test", "a");
}

// Pictures and panels are written under these names, so no two are the same.
TEST(test_names) {
  put_picture("v/l/x.png", 1);
  put_picture("v/r/x.png", 2);
  put_picture("v/l_x.png", 3);
  put_picture("v/f.1.png", 4);
  put_picture("v/f.2.png", 5);
  put("v/transforms.json",
      "{\"fl_x\": 25, \"frames\": [" FRAME("l/x.png", "") "," FRAME("r/x.png", "") "," FRAME(
          "l_x.png", "") "," FRAME("f.1", "") "," FRAME("f.2", "") "," FRAME("f.2.png",
                                                                             "") "," FRAME("f.2.png",
                                                                                           "") "]}");
  check_split("v", "all", "l_x_0 r_x l_x f.1 f.2_4 f.2_5 f.2_6");
}

TEST(test_stream_refused) {
  char command[600];
  // not in the rig
  assert_int_equal(import_stream("s", "t_out", "rig", "middle", 1), LAB_EXIT_FAILED);
  // no rig there
  assert_int_equal(import_stream("s", "t_out", "s", "left", 1), LAB_EXIT_FAILED);
  // no view of it
  assert_int_equal(import_stream("s", "t_out", "rig", "top", 1), LAB_EXIT_FAILED);
  assert_int_equal(import_stream("s", "t_out", "rig", NULL, 1), LAB_EXIT_USAGE);
  lab_options o = {.from = "capture", .input = folder, .out = folder, .rig = folder, .stream = "left"};
  assert_int_equal(lab_cmd_import(&o), LAB_EXIT_USAGE);
  snprintf(command, sizeof command, "cd '%s/s/images' && cp ../p.ply right/0.png", folder);
  assert_int_equal(system(command), 0);
  assert_int_equal(import_stream("s", "t_out", "rig", "left", 1), LAB_EXIT_FAILED); // no picture
  snprintf(command, sizeof command, "cd '%s/s/images' && rm -r right top", folder);
  assert_int_equal(system(command), 0);
  put("s/transforms.json", "{\"fl_x\": 25, \"frames\": [{\"file_path\": \"images/left/0.png\", "
                           "\"transform_matrix\": [[1,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]]}]}");
  // nothing to place
  assert_int_equal(import_stream("s", "t_out", "rig", "left", 1), LAB_EXIT_FAILED);
}

// A recording that is imported into its own folder, or over a capture that is not finished.
TEST(test_recording_refused) {
  char from[400], to[400];
  sv_import_camera camera = {.name = "cam"};
  put_picture("w/cam/0.png", 7);
  snprintf(from, sizeof from, "%s/w", folder);
  snprintf(to, sizeof to, "%s/w/../w/", folder);
  assert_int_equal(
      sv_import_write(&(sv_import_job){.src_dir = from, .out_dir = to}, "r", 30, &camera, 1, &err), SV_E_ARG);
  snprintf(to, sizeof to, "%s/w/cam/0.png", folder);
  sv_bitmap b;
  assert_int_equal(sv_bitmap_read(to, &b, &err), SV_OK);
  sv_bitmap_free(&b);
  put("x/frames.0.part", "");
  snprintf(to, sizeof to, "%s/x", folder);
  assert_int_equal(
      sv_import_write(&(sv_import_job){.src_dir = from, .out_dir = to}, "r", 30, &camera, 1, &err), SV_E_IO);
}

FIXTURE(make_folder) { return temp_folder_make(folder, sizeof folder, "import_rig"); }

FIXTURE(remove_folder) { return temp_folder_remove(folder); }

static void put_mask(const char *name, int x, int y) {
  char path[400];
  uint8_t px[16 * 12];
  const sv_bitmap b = {.width_px = 16, .height_px = 12, .n_channels = 1, .bits = 8, .u8 = px};
  put(name, "");
  snprintf(path, sizeof path, "%s/%s", folder, name);
  memset(px, 1, sizeof px); // all but black counts
  px[16 * y + x] = 0;
  assert_int_equal(sv_bitmap_write_png(path, &b, &err), SV_OK);
}

// Pixels that the view's mask does not let count; the last of them.
static int n_masked(const lab_frame *f, int scale, int *x, int *y) {
  uint8_t px[16 * 12];
  lab_loader l = {0};
  int n = 0;
  assert_ok(lab_mask_load(&l, f, scale, px, &err), &err);
  lab_loader_free(&l);
  for (int p = 0; p < f->view.width_px * f->view.height_px; p++)
    if (!px[p]) {
      n++;
      *x = p % f->view.width_px;
      *y = p / f->view.width_px;
    }
  return n;
}

// mask_path comes along with an import; reduced and undistorted views lose what a masked pixel is a
// part of; a folder of masks goes before mask_path.
TEST(test_masks) {
  lab_views v;
  int x, y;
  put_picture("q/images/a.png", 1);
  put_picture("q/images/b.png", 2);
  put_mask("q/some/where/m.png", 5, 6);
  put("q/transforms.json",
      "{\"fl_x\": 25, \"frames\": [" FRAME(
          "images/a.png",
          "\"mask_path\": \"./some/where/m.png\", ") "," FRAME("images/b.png",
                                                               "\"mask_path\": \"some/where/m.png\", \"k1\": "
                                                               "-0.1, ") "]}");
  assert_int_equal(import("nerfstudio", "q", "q_out"), LAB_EXIT_OK);
  open_dataset(&v, "q_out");
  assert_int_equal(v.n_masked, 2);
  assert_non_null(strstr(view_of(&v, "a.png")->mask_path, "q_out/masks/a.png"));
  assert_int_equal(n_masked(view_of(&v, "a.png"), 1, &x, &y), 1);
  assert_true(x == 5 && y == 6);
  assert_in_range(n_masked(view_of(&v, "b.png"), 1, &x, &y), 1, 6); // interpolated from it
  assert_true(abs(x - 5) <= 1 && abs(y - 6) <= 1);
  lab_views_free(&v);
  char data[400], masks[400];
  const sv_pool serial = sv_pool_serial();
  snprintf(data, sizeof data, "%s/q", folder);
  snprintf(masks, sizeof masks, "%s/q_masks", folder);
  put_mask("q_masks/a.png", 15, 11);
  lab_source src = {.folder = data, .split = "all", .scale = 2, .masks = masks};
  sv_status s = lab_views_open(&v, &src, &serial, &err);
  assert_int_equal(s, SV_E_RANGE); // 8 x 6 pixels are too few for a view
  lab_views_free(&v);
  src.scale = 1;
  assert_ok(lab_views_open(&v, &src, &serial, &err), &err);
  assert_int_equal(n_masked(view_of(&v, "a.png"), 1, &x, &y), 1);
  assert_true(x == 15 && y == 11);
  assert_non_null(strstr(view_of(&v, "b.png")->mask_path, "m.png")); // has none in that folder
  v.frames[0].view = sv_view_scaled(&v.frames[0].view, 2);
  assert_int_equal(n_masked(&v.frames[0], 2, &x, &y), 1);
  assert_true(x == 7 && y == 5);
  lab_views_free(&v);
  src.has_all_masks = true;
  assert_error(lab_views_open(&v, &src, &serial, &err), SV_E_NOT_FOUND, &err, "images/b.png");
  lab_views_free(&v);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_colmap),
                                     cmocka_unit_test(test_colmap_without),
                                     cmocka_unit_test(test_colmap_one_folder),
                                     cmocka_unit_test(test_stream),
                                     cmocka_unit_test(test_stream_refused),
                                     cmocka_unit_test(test_stream_numbers),
                                     cmocka_unit_test(test_splits),
                                     cmocka_unit_test(test_masks),
                                     cmocka_unit_test(test_names),
                                     cmocka_unit_test(test_recording_refused)};
  return cmocka_run_group_tests(tests, make_folder, remove_folder);
}
