// SPDX-License-Identifier: Apache-2.0
// subview-lab on bad input: the program is run as a user runs it, on files made here. Each case
// must end with the stated exit code and exactly one line on stderr that names what is wrong; a
// crash or a second line fails. Skipped when the program is not built (SV_BIN names its folder,
// SV_EMULATE what runs it).
#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "tests/common/test.h"
#include "tools/common/fileio.h"
#include "tools/common/imageio.h"

static char g_root[512], g_lab[512], g_calibrate[512], g_emulate[900];

// --- a small dataset -----------------------------------------------------------------------------

static void put(const char *name, const char *text) {
  char path[1024];
  sv_err err;
  snprintf(path, sizeof path, "%s/%s", g_root, name);
  assert_int_equal(sv_file_write(path, text, strlen(text), &err), SV_OK);
}

static void put_picture(const char *name, int w, int h, int n_channels) {
  char path[1024];
  sv_err err;
  sv_bitmap b = {.width_px = w, .height_px = h, .n_channels = n_channels, .bits = 8};
  b.u8 = malloc((size_t)w * (size_t)h * (size_t)n_channels);
  for (int i = 0; i < w * h * n_channels; i++) b.u8[i] = (uint8_t)(37 * i + i / 7);
  snprintf(path, sizeof path, "%s/%s", g_root, name);
  assert_int_equal(sv_bitmap_write_png(path, &b, &err), SV_OK);
  free(b.u8);
}

static void folder(const char *name) {
  char path[1024];
  sv_err err;
  snprintf(path, sizeof path, "%s/%s", g_root, name);
  assert_int_equal(sv_path_make_folder(path, &err), SV_OK);
}

// Nobody writes to it: who opens it as a file waits for ever.
static void make_pipe(const char *name) {
  char path[1024];
  snprintf(path, sizeof path, "%s/%s", g_root, name);
  assert_int_equal(mkfifo(path, 0600), 0);
}

#define POSE(z)              "\"transform_matrix\": [[1,0,0,0],[0,1,0,0],[0,0,1," #z "],[0,0,0,1]]"
#define FRAME(file, z, more) "{\"file_path\": \"" file "\", " POSE(z) more "}"

// A dataset folder with one transforms.json; "%" stands for nothing here.
static void dataset(const char *name, const char *head, const char *frames) {
  char file[256], text[4096];
  folder(name);
  snprintf(file, sizeof file, "%s/transforms.json", name);
  snprintf(text, sizeof text, "{%s \"frames\": [%s]}", head, frames);
  put(file, text);
}

#define ANGLE "\"camera_angle_x\": 0.7,"
#define POINTS(n)                                                                                            \
  "ply\nformat ascii 1.0\nelement vertex " #n                                                                \
  "\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
#define GOOD_FRAMES FRAME("../a.png", 4, "") "," FRAME("../b.png", 4.5, "") "," FRAME("../a", 5, "")

static void make_files(void) {
  put_picture("a.png", 32, 24, 3);
  put_picture("b.png", 32, 24, 4);
  put_picture("dot.png", 1, 1, 3);
  put_picture("tiny.png", 7, 40, 3);
  put("not_a_picture.png", "hello");
  put("cut.png", "\x89PNG\r\n\x1a\n");
  dataset("good", ANGLE, GOOD_FRAMES);
  dataset("missing", ANGLE, FRAME("../a.png", 4, "") "," FRAME("../nowhere.png", 4, ""));
  dataset("size", ANGLE "\"w\": 33, \"h\": 24,", GOOD_FRAMES);
  dataset("one_pixel", ANGLE, FRAME("../a.png", 4, "") "," FRAME("../dot.png", 4, ""));
  dataset("thin", ANGLE, FRAME("../a.png", 4, "") "," FRAME("../tiny.png", 4, ""));
  dataset("text", ANGLE, FRAME("../a.png", 4, "") "," FRAME("../not_a_picture.png", 4, ""));
  dataset("cut", ANGLE, FRAME("../a.png", 4, "") "," FRAME("../cut.png", 4, ""));
  dataset("pipe", ANGLE, FRAME("../a.png", 4, "") "," FRAME("../pipe.png", 4, ""));
  make_pipe("pipe.png");
  dataset("device", ANGLE, FRAME("../a.png", 4, "") "," FRAME("/dev/zero", 4, ""));
  dataset("nan", "\"camera_angle_x\": NaN,", GOOD_FRAMES);
  dataset("nan_pose", ANGLE,
          "{\"file_path\": \"../a.png\", \"transform_matrix\": [[NaN,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]]}");
  dataset("skewed", ANGLE,
          "{\"file_path\": \"../a.png\", \"transform_matrix\": [[2,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]]}");
  dataset("empty", ANGLE, "");
  dataset("no_test", ANGLE, FRAME("../a.png", 4, ", \"split\": \"train\""));
  dataset("held_out", ANGLE, FRAME("../a.png", 4, ", \"split\": \"test\""));
  dataset("lens", ANGLE "\"k1\": -9e9,", GOOD_FRAMES);
  dataset("points", ANGLE "\"ply_file_path\": \"p.ply\",", GOOD_FRAMES);
  put("points/p.ply", POINTS(5) "1 2 3\n4 5\n");
  dataset("known", ANGLE "\"ply_file_path\": \"p.ply\",", GOOD_FRAMES);
  put("known/p.ply", POINTS(5) "0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 1 0\n");
  dataset("blind", ANGLE "\"ply_file_path\": \"p.ply\",", GOOD_FRAMES);
  put("blind/p.ply", // behind the cameras, which look along -z
      POINTS(3) "0 0 90\n1 0 91\n0 1 92\n");
  dataset("no_focal", "\"fl_x\": 1e-30,", GOOD_FRAMES);
  dataset(
      "far_pose", ANGLE,
      "{\"file_path\": \"../a.png\", \"transform_matrix\": [[1,0,0,1e300],[0,1,0,0],[0,0,1,4],[0,0,0,1]]}");
  dataset("kinds", ANGLE "\"depth_unit_scale_factor\": 0.25,",
          FRAME("../a.png", 4, ", \"depth_path\": \"../a.png\"") "," FRAME(
              "../b.png", 4.5, ", \"ray_distance_path\": \"../b.png\""));
  folder("units");
  put("units/transforms_train.json", "{" ANGLE "\"depth_unit_scale_factor\": 0.25, \"frames\": [" FRAME(
                                         "../a.png", 4, ", \"depth_path\": \"../a.png\"") "]}");
  put("units/transforms_test.json", "{" ANGLE "\"depth_unit_scale_factor\": 0.5, \"frames\": [" FRAME(
                                        "../b.png", 4, ", \"depth_path\": \"../b.png\"") "]}");
  folder("unfinished");
  put("unfinished/transforms.json", "{\"frames\": [{\"file_path\": \"../a.png\", ");
  folder("nothing");
  folder("many"); // none of the two names that are looked for
  for (int i = 0; i < 6; i++) {
    char name[64];
    snprintf(name, sizeof name, "many/transforms_train_r%d.json", i);
    put(name, "{}");
  }
  put("many/transforms_test.json", "{}");
  dataset(
      "cameras", ANGLE,
      FRAME("../a.png", 4, ", \"camera\": \"left\"") "," FRAME("../b.png", 4.5, ", \"camera\": \"right\""));
  put("cloud.ply", POINTS(1) "1 2 3\n");
  put("bad.ply", "ply\nformat binary_little_endian 1.0\nelement vertex 9\nproperty fl");
}

// --- running it ----------------------------------------------------------------------------------

// Runs `PROGRAM ARGS` in g_root through the shell; stderr's lines, exit code (or 128 + signal).
static int run_program(const char *before, const char *program, const char *args, char *text, size_t cap) {
  char command[4096];
  snprintf(command, sizeof command, "cd '%s' && exec %s %s '%s' %s 2>&1 >out.txt </dev/null", g_root, before,
           g_emulate, program, args);
  FILE *p = popen(command, "r");
  assert_non_null(p);
  size_t n = fread(text, 1, cap - 1, p);
  text[n] = 0;
  int code = pclose(p);
  return WIFEXITED(code) ? WEXITSTATUS(code) : 128 + WTERMSIG(code);
}

static int run_through(const char *before, const char *args, char *text, size_t cap) {
  return run_program(before, g_lab, args, text, cap);
}

static int run_lab(const char *args, char *text, size_t cap) { return run_through("", args, text, cap); }

static int lines_of(const char *text) {
  int n = 0;
  for (; *text; text++) n += *text == '\n';
  return n;
}

typedef struct {
  int code;
  const char *args, *word; // word: must stand in the line
} bad_case;

static const bad_case cases[] = {
    // usage: exit 2, with a hint
    {2, "", "--help"},
    {2, "cook", "unknown command"},
    {2, "train --out o", "--data"},
    {2, "train --data good", "--out"},
    {2, "train --data", "--data needs a value"},
    {2, "train --data good --out o --frobnicate", "--frobnicate"},
    {2, "train --data good --steps 3 --out --json", "--out needs a value"},
    {2, "train --data good --loss --out o", "--loss needs a value"},
    {2, "train --data good --loss dilation=0 --out o", "--loss dilation needs a number from 0.001 to 10"},
    {2, "train --data good --loss region=8 --out o", "from 16 to 4096"},
    {2, "export --model m.ply --format ply --spz-version 2 --out o.ply", "--spz-version needs"},
    {2, "export --model m.ply --format delta --crop 0,0,0,1 --out o.ply", "--crop has no effect"},
    {2, "export --model m.ply --format html --frames 9 --out o.html", "--frames has no effect"},
    {2, "train --data good --out o --gaussians 0", "--gaussians"},
    {2, "train --data good --out o --gaussians 5000000", "--gaussians"},
    {2, "train --data good --out o --steps -3", "--steps"},
    {2, "train --data good --out o --steps 1e3", "--steps"},
    {2, "train --data good --out o --steps 99999999999999999999", "--steps"},
    {2, "train --data good --out o --time-limit nan", "--time-limit"},
    {2, "train --data good --out o --steps 3 --time-limit 3", "cannot be combined"},
    {2, "train --data good --out o --exposures 0", "--exposures"},
    {2, "train --data good --out o --sh 4", "--sh"},
    {2, "train --data good --out o --threads 0", "--threads"},
    {2, "train --data good --out o --scale 0", "--scale"},
    {2, "train --data good --out o --seed -1", "--seed"},
    {2, "train --data good --out o --background blue", "--background"},
    {2, "train --data good --out o --init torus", "--init"},
    {2, "train --data good --out o --init points:", "--init"},
    {2, "train --data good --out o --loss ssim=2", "ssim"},
    {2, "train --data good --out o --loss l7=1", "--loss"},
    {2, "train --data good --out o --loss ssim", "--loss"},
    {2, "train --data good --out o --motion clip", "needs --model 4dgs"},
    {2, "train --data good --out o --model 4dgs --motion walk", "--motion must be clip or field"},
    {2, "train --data good --out o --model 4dgs --motion clip,pos=99", "--motion must be clip or field"},
    {1, "train --data good --out o --model 4dgs --motion field,base=1", "the first of 1 points a side"},
    {1, "train --data good --out o --model 4dgs --motion field,channels=20", "expected 16 or 32"},
    {1, "train --data good --out o --model 4dgs --motion field,width=24", "multiple of 16 up to 128"},
    {2, "train --data good --out o --prior fsgs,sparsegs", "external:CMD"},
    {2, "train --data good --out o --prior sparsegs --model 4dgs", "static scenes"},
    {2, "train --data good --out o --prior external:", "external:CMD"},
    {2, "train --data good --out o --prior-calls 3", "need --prior external"},
    {2, "train --data good --out o --noise read=2", "from 0 to 1"},
    {2, "train --data good --out o --antialias maybe", "auto|on|off"},
    {2, "train --data good --out o --eval=yes", "takes no value"},
    {2, "train --data good --out o stray", "stray"},
    {2, "eval --data good", "--model"},
    {2, "eval --data good --model m.ply --mask all", "--mask"},
    {2, "train --data good --out o --lpips", "--eval"},
    {2, "train --data good --out o --mask covisible", "--eval"},
    {2, "render --data good --model m.ply --out o --orbit 3 --split test", "cannot be combined"},
    {2, "export --model m.ply --format obj --out o", "--format"},
    {2, "import --from colmap --out o", "folder"},
    {2, "import --from tape good --out o", "--from"},
    {2, "import --from colmap good --keep 3 --out o", "lenslet"},
    // failures: exit 1, one sentence with the file
    {1, "train --data absent --out o", "absent"},
    {1, "train --data nothing --out o", "nothing"},
    {1, "train --data many --out o",
     "neither transforms_train.json nor transforms.json; name another with --transforms: "
     "transforms_train_r0.json, transforms_train_r1.json, transforms_train_r2.json, "
     "transforms_train_r3.json, ...\n"},
    {1, "train --data nothing --out o", "holds nothing; expected transforms.json, sparse"},
    {1, "train --data good --transforms t.json --out o", "t.json"},
    {1, "train --data missing --out o", "nowhere.png"},
    {1, "train --data size --out o", "33x24"},
    {1, "train --data one_pixel --out o", "dot.png"},
    {1, "train --data thin --out o", "tiny.png"},
    {1, "train --data good --scale 16 --out o", "after --scale"},
    {1, "train --data text --out o", "not_a_picture.png"},
    {1, "train --data cut --out o", "cut.png"},
    {1, "train --data pipe --out o", "pipe.png: not a regular file"},
    {1, "train --data device --out o", "/dev/zero: not a regular file"},
    {1, "train --data nan --out o", "transforms.json"},
    {1, "train --data nan_pose --out o", "transforms.json"},
    {1, "train --data skewed --out o", "rotation"},
    {1, "train --data empty --out o", "no frames"},
    {1, "train --data held_out --out o", "belongs to split"},
    {1, "train --data blind --steps 3 --init points:blind/p.ply --out o", "no camera sees the first model"},
    {1, "train --data no_focal --steps 3 --out o", "the focal length is"},
    {1, "train --data far_pose --steps 3 --out o", "a camera's position is 1e300 m"},
    {1, "train --data lens --out o", "lens"},
    {1, "train --data points --out o", "p.ply"},
    {1, "train --data unfinished --out o", "transforms.json"},
    {1, "train --data good --init points:absent.ply --out o", "absent.ply"},
    {1, "train --data good --steps 2 --quiet --out a.png/o", "a.png"},
    {1, "train --data good --noise shot=0.1 --background white --quiet --out o", "black"},
    {1, "eval --data good --model absent.ply", "absent.ply"},
    {1, "eval --data good --model bad.ply", "bad.ply"},
    {1, "eval --data good --model cloud.ply", "cloud.ply"},
    {1, "eval --data good --model cut_model.ply", "cut_model.ply"},
    {1, "eval --data good --model model/model.ply --depth --quiet", "depth"},
    {1, "eval --data no_test --model model/model.ply --split test_near", "test_near"},
    {1, "eval --data good --model model/model.ply --split unheard_of", "unheard_of"},
    {1, "eval --data good --model spoilt/model.ply", "train.json"},
    {1, "eval --data many --model elsewhere/model.ply --split train",
     "nor gone.json, which elsewhere/train.json names; name"},
    {1, "eval --data good --transforms gone.json --model elsewhere/model.ply", "good/gone.json"},
    {1, "eval --data cameras --model model/model.ply --split all --camera nope",
     "camera nope; there are left, right\n"},
    {1, "eval --data cameras --model model/model.ply --split test_near --camera right",
     "right; there are left\n"},
    {1, "eval --data good --model model/model.ply --camera nope", "nope; its views do not name cameras\n"},
    {1, "render --data missing --model model/model.ply --split train --out o", "nowhere.png"},
    {1, "export --model bad.ply --format splat --out o.splat", "bad.ply"},
    {1, "export --model model/model.ply --format splat --out absent/o.splat --quiet", "o.splat"},
    {1, "import --from colmap good --out o", "images"},
    {1, "import --from blender units --out o", "its depth unit is 0.5 and that of units/../a.png is 0.25"},
    {1, "import --from nerfstudio kinds --out o", "kinds/../b.png: depth along the ray"},
    {1, "import --from capture good --out o", "capture.json"},
    {1, "import --from blender nothing --out o", "transforms"},
    {1, "import --from qca good --out o", "qca"},
    {1, "import --from lenslet good --out o", "white.png"},
    {1, "import --from 4cam-board good --out o", "camera_array"},
};

// What must work, so that the cases above fail for their own reason; it also makes the model they
// use.
TEST(test_good_input) {
  char text[4096];
  assert_int_equal(run_lab("train --data good --gaussians 50 --steps 5 --quiet --json --eval --out model",
                           text, sizeof text),
                   0);
  assert_string_equal(text, "");
  assert_int_equal(run_lab("eval --data good --model model/model.ply --quiet", text, sizeof text), 0);
  assert_int_equal(run_lab("render --data good --model model/model.ply --orbit 2 --depth --quiet --out turn",
                           text, sizeof text),
                   0);
  assert_int_equal(
      run_lab("export --model model/model.ply --format splat --quiet --out m.splat", text, sizeof text), 0);
  assert_int_equal(run_lab("import --from nerfstudio good --quiet --out again", text, sizeof text), 0);
  assert_int_equal(
      run_lab("train --data again --gaussians 50 --steps 5 --quiet --out model2", text, sizeof text), 0);
  assert_int_equal(run_lab("train --help", text, sizeof text), 0);
  assert_int_equal(run_lab("--version", text, sizeof text), 0);
}

static void make_damaged_models(void) {
  char path[1024];
  void *data;
  size_t bytes;
  sv_err err;
  snprintf(path, sizeof path, "%s/model/model.ply", g_root);
  assert_int_equal(sv_file_read(path, &data, &bytes, &err), SV_OK);
  snprintf(path, sizeof path, "%s/cut_model.ply", g_root);
  assert_int_equal(sv_file_write(path, data, bytes - 10, &err), SV_OK);
  folder("spoilt");
  snprintf(path, sizeof path, "%s/spoilt/model.ply", g_root);
  assert_int_equal(sv_file_write(path, data, bytes, &err), SV_OK);
  put("spoilt/train.json", "{\"scale\": \"large\"}");
  folder("elsewhere"); // was trained on a dataset with a file that others do not have
  snprintf(path, sizeof path, "%s/elsewhere/model.ply", g_root);
  assert_int_equal(sv_file_write(path, data, bytes, &err), SV_OK);
  put("elsewhere/train.json", "{\"transforms\": \"gone.json\"}");
  free(data);
}

// A model meets another dataset: what train.json remembers is not there, so the dataset's own file
// is taken.
TEST(test_other_dataset) {
  char text[4096];
  make_damaged_models();
  assert_int_equal(run_lab("eval --data good --model elsewhere/model.ply --quiet", text, sizeof text), 0);
  assert_string_equal(text, "");
  assert_int_equal(run_lab("render --data good --model elsewhere/model.ply --orbit 2 --quiet --out turn2",
                           text, sizeof text),
                   0);
  assert_string_equal(text, "");
}

TEST(test_bad_input) {
  char text[4096];
  int n_bad = 0;
  for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
    const bad_case *c = &cases[i];
    int code = run_through("timeout 60", c->args, text, sizeof text), n = lines_of(text);
    if (code == c->code && n == 1 && strstr(text, c->word)) continue;
    print_error("subview-lab %s\n  exit %d (expected %d), %d lines (expected 1 with '%s'):\n%s\n", c->args,
                code, c->code, n, c->word, text);
    n_bad++;
  }
  assert_int_equal(n_bad, 0);
}

// A key of a number in the JSON object on stdout of the last run.
static double json_number(const char *key) {
  char want[64], *text = temp_read(g_root, "out.txt");
  snprintf(want, sizeof want, "\"%s\": ", key);
  const char *p = strstr(text, want);
  assert_non_null(p);
  double v = strtod(p + strlen(want), NULL);
  free(text);
  return v;
}

TEST(test_calibrate) {
  static const char *const cases_of[][2] = {
      {"pose --rig r --capture c --out o --threads 2", "--threads"},
      {"lenslets --isolated i --white w --out o --board 7x6 --spacing 0.02 --focal 900", "or --focal"}};
  char text[4096];
  for (size_t i = 0; i < sizeof cases_of / sizeof *cases_of; i++) {
    assert_int_equal(run_program("", g_calibrate, cases_of[i][0], text, sizeof text), 2);
    assert_int_equal(lines_of(text), 1);
    if (!strstr(text, cases_of[i][1])) fail_msg("'%s' was expected in: %s", cases_of[i][1], text);
  }
}

// A disk that fills up while the points are written: one sentence, and no half a file.
TEST(test_full_disk) {
  char text[4096], subview[600], folder_path[1024];
  snprintf(subview, sizeof subview, "%.*s", (int)(strrchr(g_lab, '-') - g_lab), g_lab);
  static const char shot[] = "capture --source sim:room,rig=stereo,path=handheld,arc=20,size=320x240 "
                             "--exposures 4 --quiet --out cap >out.txt";
  if (run_program("", subview, shot, text, sizeof text)) fail_msg("%s", text);
  static const char pose[] = "pose --rig cap/rig --capture cap --quiet --out poses";
  static const char limit[] = "sh -c 'trap \"\" XFSZ; ulimit -f 8; exec \"$@\"' sh"; // 4 or 8 kB
  assert_int_equal(run_program(limit, g_calibrate, pose, text, sizeof text), 1);
  assert_string_equal(text, "subview-calibrate: poses/points.ply: cannot write: File too large\n");
  sv_names names;
  sv_err err;
  snprintf(folder_path, sizeof folder_path, "%s/poses", g_root);
  assert_int_equal(sv_folder_list(folder_path, &names, &err), SV_OK);
  assert_int_equal(names.n, 1);
  assert_string_equal(names.names[0], "poses.json");
  sv_names_free(&names);
}

static double checked_view_deg(const char *model, const char *intrinsics) {
  char text[4096];
  snprintf(text, sizeof text,
           "{'lensmodel': '%s', 'intrinsics': [%s], 'extrinsics': [0,0,0,0,0,0], 'imagersize': [1000, 800]}",
           model, intrinsics);
  folder("rig");
  put("rig/a.cameramodel", text);
  put("rig/rig.json", "{\"version\": 1, \"name\": \"r\", \"forward\": \"direct\", \"sub_views\": "
                      "[{\"name\": \"a\", \"model\": \"a.cameramodel\", \"camera\": 0}]}");
  if (run_program("", g_calibrate, "check --rig rig --json --quiet", text, sizeof text)) fail_msg("%s", text);
  return json_number("field_of_view_deg");
}

// A fisheye's field of view is not a pinhole's; where the lens does not reach the edges there is
// none.
TEST(test_field_of_view) {
  double pinhole = checked_view_deg("LENSMODEL_PINHOLE", "500,500,499.5,399.5"),
         fisheye = checked_view_deg("LENSMODEL_KB4", "318.3098862,318.3098862,499.5,399.5,0,0,0,0");
  assert_true(pinhole > 89.999 && pinhole < 90.001);
  assert_true(fisheye > 179.999 && fisheye < 180.001);
  // 286 degrees to each side
  (void)checked_view_deg("LENSMODEL_KB4", "100,100,499.5,399.5,0,0,0,0");
  char *json = temp_read(g_root, "out.txt");
  assert_contains(json, "\"field_of_view_deg\": null");
  free(json);
}

static bool started_from(const char *word) {
  char want[64], *text = temp_read(g_root, "known_model/train.json");
  snprintf(want, sizeof want, "\"init\": \"%s\"", word);
  bool is_there = strstr(text, want) != NULL;
  free(text);
  return is_there;
}

// The dataset's points start a run, but not one of so few exposures that they cannot have measured
// them: that is said, and points that are asked for are taken all the same.
TEST(test_start) {
  char text[4096];
#define TRAIN "train --data known --gaussians 50 --steps 5 --json --out known_model "
  assert_int_equal(run_lab(TRAIN, text, sizeof text), 0);
  assert_true(started_from("points"));
  assert_not_contains(text, "could not have produced");
  assert_int_equal(run_lab(TRAIN "--exposures 2", text, sizeof text), 0);
  assert_false(started_from("points"));
  assert_contains(text, "2 exposures could not have produced the dataset's points");
  assert_int_equal(run_lab(TRAIN "--exposures 2 --init points:known/p.ply", text, sizeof text), 0);
  assert_true(started_from("points"));
}

// The file holds the whole model: scores before and after it agree.
TEST(test_model_file) {
  char text[4096];
  assert_int_equal(
      run_lab("train --data good --gaussians 300 --steps 60 --sh 2 --background white --quiet --json --eval "
              "--out whole",
              text, sizeof text),
      0);
  double psnr = json_number("psnr"), ssim = json_number("ssim");
  assert_int_equal(run_lab("eval --data good --model whole/model.ply --quiet --json", text, sizeof text), 0);
  assert_true(psnr > 5 && psnr < 60);
  assert_true(json_number("psnr") - psnr < 1e-6 && psnr - json_number("psnr") < 1e-6);
  assert_true(json_number("ssim") - ssim < 1e-6 && ssim - json_number("ssim") < 1e-6);
  assert_int_equal(
      run_lab("export --model whole/model.ply --format ply --quiet --out whole/copy.ply", text, sizeof text),
      0);
  assert_int_equal(run_lab("eval --data good --model whole/copy.ply --quiet --json", text, sizeof text), 0);
  assert_true(json_number("psnr") - psnr < 1e-6 && psnr - json_number("psnr") < 1e-6);
}

// Names that are not UTF-8: the JSON is valid all the same, and a dataset that is made from them
// can be read.
TEST(test_names_of_bytes) {
  char text[4096], path[1024];
  sv_err err;
  dataset("gr\xfcn", ANGLE,
          FRAME("bl\xe4u.png", 4, "") "," FRAME("../b.png", 4.5, "") "," FRAME("../a.png", 5, ""));
  put_picture("gr\xfcn/bl\xe4u.png", 32, 24, 3);
  assert_int_equal(
      run_lab("train --data gr\xfcn --gaussians 50 --steps 5 --quiet --out bytes", text, sizeof text), 0);
  char *json = temp_read(g_root, "bytes/train.json");
  assert_contains(json, "\"data\": \"gr\xef\xbf\xbdn\"");
  assert_null(strchr(json, '\xfc'));
  free(json);
  assert_int_equal(run_lab("import --from nerfstudio gr\xfcn --quiet --out bytes/again", text, sizeof text),
                   0);
  snprintf(path, sizeof path, "%s/bytes/again/transforms.json", g_root);
  void *data;
  size_t bytes;
  assert_int_equal(sv_file_read(path, &data, &bytes, &err), SV_OK);
  assert_contains(data, "bl_u.png");
  free(data);
  assert_int_equal(
      run_lab("train --data bytes/again --gaussians 50 --steps 5 --quiet --out bytes/m", text, sizeof text),
      0);
}

// Ctrl-C in the middle: exit 0, and what was trained is saved. In the foreground `timeout` sends
// one signal, not another to its group, which would be a second Ctrl-C.
TEST(test_stop) {
  char text[4096], path[1024];
  int code = run_through("timeout --foreground --preserve-status -s INT 1.5",
                         "train --data good --gaussians 50 --steps 1000000000 --quiet --json --out stopped",
                         text, sizeof text);
  assert_string_equal(text, "");
  assert_int_equal(code, 0);
  assert_true(json_number("steps") >= 1 && json_number("steps") < 1e9);
  snprintf(path, sizeof path, "%s/stopped/train.json", g_root);
  assert_true(sv_path_exists(path));
  assert_int_equal(run_lab("eval --data good --model stopped/model.ply --quiet", text, sizeof text), 0);
}

static bool is_there(const char *name) {
  char path[1024];
  snprintf(path, sizeof path, "%s/%s", g_root, name);
  return sv_path_exists(path);
}

// An import that is stopped says so and leaves nothing that looks like a dataset, also of an older
// one in its place.
TEST(test_stopped_import) {
  char text[4096];
  folder("half");
  put("half/transforms_train_mono.json", "{}");
  int code = run_through("timeout --foreground --preserve-status -s INT 1",
                         "import --from sim textured,size=1200x1200 --out half", text, sizeof text);
  assert_string_equal(text, "error: stopped by request: half is incomplete; run the same command again\n");
  assert_int_equal(code, 1);
  assert_true(is_there("half/train/mono"));
  assert_false(is_there("half/transforms_train_mono.json"));
  assert_int_equal(run_lab("import --from sim nonex --out not_made", text, sizeof text), 1);
  assert_false(is_there("not_made"));
}

// Pictures of two cameras that are called the same do not overwrite each other's panel.
TEST(test_panels) {
  char text[4096];
  folder("twins/left");
  folder("twins/right");
  put_picture("twins/left/x.png", 32, 24, 3);
  put_picture("twins/right/x.png", 32, 24, 3);
  dataset(
      "twins", ANGLE,
      FRAME("../a.png", 4, ", \"split\": \"train\"") "," FRAME(
          "left/x.png", 4.5, ", \"split\": \"test\"") "," FRAME("right/x.png", 5, ", \"split\": \"test\""));
  assert_int_equal(
      run_lab("train --data twins --gaussians 50 --steps 2 --eval --quiet --out twins/m", text, sizeof text),
      0);
  assert_true(is_there("twins/m/eval/left_x.png") && is_there("twins/m/eval/right_x.png"));
}

// The emulator's folder of libraries is named from the root of the tree; the program runs
// elsewhere.
static void find_emulator(const char *cwd) {
  const char *e = getenv("SV_EMULATE"), *l = e ? strstr(e, " -L ") : NULL;
  if (!e) return;
  if (l && l[4] != '/') snprintf(g_emulate, sizeof g_emulate, "%.*s -L '%s'/%s", (int)(l - e), e, cwd, l + 4);
  else snprintf(g_emulate, sizeof g_emulate, "%s", e);
}

FIXTURE(set_up) {
  const char *bin = getenv("SV_BIN"), *tmp = getenv("TMPDIR");
  char cwd[300] = "";
  if (!bin) bin = "build/sim-x86/bin";
  if (!getcwd(cwd, sizeof cwd)) return -1;
  find_emulator(cwd);
  snprintf(g_lab, sizeof g_lab, "%s%s%.150s/subview-lab", *bin == '/' ? "" : cwd, *bin == '/' ? "" : "/",
           bin);
  snprintf(g_calibrate, sizeof g_calibrate, "%.*s/subview-calibrate", (int)(strrchr(g_lab, '/') - g_lab),
           g_lab);
  if (access(g_lab, X_OK) != 0) return 0;
  snprintf(g_root, sizeof g_root, "%.300s/lab-bad-XXXXXX", tmp ? tmp : "/tmp");
  if (!mkdtemp(g_root)) return -1;
  make_files();
  return 0;
}

FIXTURE(tear_down) {
  char command[600];
  if (!*g_root) return 0;
  snprintf(command, sizeof command, "rm -rf '%s'", g_root);
  return system(command);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_good_input),     cmocka_unit_test(test_other_dataset),
      cmocka_unit_test(test_bad_input),      cmocka_unit_test(test_model_file),
      cmocka_unit_test(test_start),          cmocka_unit_test(test_names_of_bytes),
      cmocka_unit_test(test_calibrate),      cmocka_unit_test(test_field_of_view),
      cmocka_unit_test(test_full_disk),      cmocka_unit_test(test_stop),
      cmocka_unit_test(test_stopped_import), cmocka_unit_test(test_panels)};
  signal(SIGPIPE, SIG_IGN);
  if (set_up(NULL) != 0) return 1;
  if (access(g_lab, X_OK) != 0) {
    print_message("skip: %s is not built\n", g_lab);
    return 77;
  }
  int n = cmocka_run_group_tests(tests, NULL, NULL);
  tear_down(NULL);
  return n;
}
