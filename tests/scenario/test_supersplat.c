// SPDX-License-Identifier: Apache-2.0
// Exports in SuperSplat's viewer: upright, the right way round, and as the rasterizer draws them.
// Read and put into a page by splat-transform (npm install -g
// @playcanvas/splat-transform, or its path in SV_SPLAT_TRANSFORM), drawn by headless Chromium.
// The viewer widens splats by 0.075 square pixels, not 0.3, so the rasterizer is told that, too.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "tests/common/browser.h"
#include "tests/common/lab_shell.h"
#include "tests/common/test.h"

#define W 480
#define H 360

static lab_shell shell = {.cwd = ""};
static char tool[600];
static bool has_viewer;

static bool find_tool(void) {
  const char *given = getenv("SV_SPLAT_TRANSFORM");
  char command[700];
  snprintf(tool, sizeof tool, "%s", given ? given : "splat-transform");
  snprintf(command, sizeof command, "command -v '%s' && command -v ffmpeg", tool);
  return lab_shell_run(&shell, command) == 0;
}

// The same model in a world with z up and in one that calls y up.
FIXTURE(setup) {
  const int r = lab_shell_open(&shell, "supersplat");
  if (r < 0) return -1;
  shell.is_ready = r == 0;
  has_viewer = r == 0 && browser_program() && find_tool();
  if (has_viewer)
    lab_shell_run_well(
        &shell, "@ import --from sim textured,rig=stereo,exposures=12,size=320x240 --out ds --quiet && "
                "@ train --data ds --gaussians 5000 --sh 1 --steps 600 --out m --quiet && "
                "for up in z y; do mkdir $up && LC_ALL=C sed -e '1,20s/SplatDilation: .*/"
                "SplatDilation: 0.075/' -e \"1,20s/SplatUp: z/SplatUp: $up/\" m/model.ply "
                ">$up/model.ply && @ render --model $up/model.ply --orbit 3 --width 480 --out $up/views "
                "--quiet; done");
  return 0;
}
FIXTURE(teardown) { return lab_shell_close(&shell); }

// The viewer's settings for the camera of view v. Exports have right-down-forward axes there, which
// it turns upright by half a turn about z.
static void write_settings(const char *up, int v) {
  char path[300];
  snprintf(path, sizeof path, "%s/views/views.json", up);
  char *views = temp_read(shell.root, path);
  const char *at = views;
  double p[12];
  for (int i = 0; i <= v; i++) {
    at = strstr(at, "\"cam_from_world_3x4\": [");
    assert_non_null(at);
    at += strlen("\"cam_from_world_3x4\": [");
  }
  for (int i = 0; i < 12; i++) {
    char *end;
    p[i] = strtod(at, &end);
    at = end + 1;
  }
  free(views);
  double point[2][3]; // the camera, and what it looks at
  for (int k = 0; k < 3; k++) {
    point[0][k] = -(p[k] * p[3] + p[4 + k] * p[7] + p[8 + k] * p[11]);
    point[1][k] = point[0][k] + 4 * p[8 + k];
  }
  double seen[2][3];
  for (int i = 0; i < 2; i++) {
    const double x = point[i][0], y = point[i][1], z = point[i][2];
    seen[i][0] = -x;
    seen[i][1] = *up == 'z' ? z : y;
    seen[i][2] = *up == 'z' ? y : -z;
  }
  snprintf(path, sizeof path, "%s/settings.json", shell.root);
  FILE *f = fopen(path, "w");
  assert_non_null(f);
  fprintf(f,
          "{\"version\": 2, \"tonemapping\": \"none\", \"highPrecisionRendering\": false,\n"
          "\"background\": {\"color\": [0, 0, 0]}, \"animTracks\": [], \"annotations\": [],\n"
          "\"postEffectSettings\": {\"sharpness\": {\"enabled\": false, \"amount\": 0},\n"
          "\"bloom\": {\"enabled\": false, \"intensity\": 1, \"blurLevel\": 2},\n"
          "\"grading\": {\"enabled\": false, \"brightness\": 0, \"contrast\": 1, \"saturation\": 1,"
          " \"tint\": [1, 1, 1]},\n"
          "\"vignette\": {\"enabled\": false, \"intensity\": 0, \"inner\": 0, \"outer\": 1,"
          " \"curvature\": 1},\n"
          "\"fringing\": {\"enabled\": false, \"intensity\": 0}},\n"
          "\"cameras\": [{\"initial\": {\"position\": [%.9g, %.9g, %.9g], \"target\": [%.9g, %.9g, %.9g],"
          " \"fov\": %.9g}}], \"startMode\": \"default\"}\n",
          seen[0][0], seen[0][1], seen[0][2], seen[1][0], seen[1][1], seen[1][2],
          2 * atan(0.5 * W / 600.0) * 180 / 3.14159265358979);
  assert_int_equal(fclose(f), 0);
}

static void need_viewer(void) {
  lab_shell_need(&shell);
  if (has_viewer) return;
  print_message("skip: no splat-transform (npm), Chromium or ffmpeg here\n");
  skip();
}

static uint8_t *pixels(const char *png) {
  char line[400];
  snprintf(line, sizeof line,
           "ffmpeg -v error -y -i %s -f rawvideo -pix_fmt rgb24 a.rgb && test $(stat -c %%s a.rgb) = %d", png,
           3 * W * H);
  lab_shell_run_well(&shell, line);
  return (uint8_t *)temp_read(shell.root, "a.rgb");
}

static double difference(const uint8_t *a, const uint8_t *b) {
  double sum = 0;
  for (int i = 0; i < 3 * W * H; i++) sum += abs(a[i] - b[i]);
  return sum / (3 * W * H);
}

// The viewer's picture of an export, once it does not change any more.
static uint8_t *drawn(const char *file) {
  char line[1500], why[200];
  browser b = {.pid = 0};
  snprintf(line, sizeof line, "'%s' -q -w -g cpu -E settings.json %s page.html", tool, file);
  lab_shell_run_well(&shell, line);
  if (!browser_open(&b, shell.root, W, H, why, sizeof why)) fail_msg("%s", why);
  snprintf(line, sizeof line, "file://%s/page.html?webgl&noui&noanim&fullload", shell.root);
  assert_true(browser_goto(&b, line));
  snprintf(line, sizeof line, "%s/drawn.png", shell.root);
  uint8_t *now = NULL, *black = calloc(3, (size_t)W * H);
  assert_non_null(black);
  for (int i = 0; i < 60; i++) {
    usleep(500000);
    if (!browser_screenshot(&b, line)) continue; // it may draw for longer than it may answer
    uint8_t *before = now;
    now = pixels("drawn.png");
    const bool is_still = before && difference(now, black) > 3 && difference(now, before) == 0;
    free(before);
    if (is_still) break;
  }
  free(black);
  browser_close(&b);
  assert_non_null(now);
  return now;
}

// `.splat` has no view-dependent color.
static void check(const char *up, int view, const char *options, const char *file, double limit) {
  char line[400], name[64];
  snprintf(line, sizeof line, "@ export --model %s/model.ply --quiet %s --out %s", up, options, file);
  lab_shell_run_well(&shell, line);
  write_settings(up, view);
  snprintf(name, sizeof name, "%s/views/orbit_%04d.png", up, view);
  uint8_t *theirs = drawn(file), *ours = pixels(name);
  const double d = difference(theirs, ours);
  print_message("%s up, %s: %.2f of 255 from the rasterizer's picture\n", up, file, d);
  free(theirs);
  free(ours);
  if (!(d < limit)) fail_msg("%s up, %s: the pictures differ by %.2f of 255 in the mean", up, file, d);
}

TEST(test_z_up) {
  need_viewer();
  check("z", 0, "--format ply --for supersplat", "a.ply", 1);
  check("z", 1, "--format compressed-ply", "b.compressed.ply", 1);
  check("z", 2, "--format sog", "c.sog", 1);
  check("z", 0, "--format spz", "d.spz", 1);
  check("z", 1, "--format splat --for supersplat", "e.splat", 2);
}

TEST(test_y_up) {
  need_viewer();
  check("y", 0, "--format ply --for supersplat", "a.ply", 1);
  check("y", 1, "--format spz --spz-version 3", "d.spz", 1);
  check("y", 2, "--format sog", "c.sog", 1);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_z_up), cmocka_unit_test(test_y_up)};
  return cmocka_run_group_tests(tests, setup, teardown);
}
