// SPDX-License-Identifier: Apache-2.0
// subview-calibrate lenslets on simulated pictures: a ray-traced scene through each lens of a multiplexed sensor
// alone, and white pictures with round, partly lit footprints.
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "calib/solve/structure.h"
#include "platform/sim/sim.h"
#include "src/base/mathx.h"
#include "src/base/rng.h"
#include "src/format/rig_file.h"
#include "tools/calibrate/calibrate.h"
#include "tools/common/coverage.h"
#include "tools/common/fileio.h"
#include "tools/common/imageio.h"

static sv_err err;
static char folder[SV_CAP_PATH], white[SV_CAP_PATH], isolated[SV_CAP_PATH], out[SV_CAP_PATH];

static void in_folder(char *path, const char *name) {
  assert_int_equal(sv_path_join(path, SV_CAP_PATH, folder, name, &err), SV_OK);
}

static double light_of(double s) { return s <= 0.04045 ? s / 12.92 : pow((s + 0.055) / 1.055, 2.4); }
static double srgb_of(double l) { return l <= 0.0031308 ? 12.92 * l : 1.055 * pow(l, 1 / 2.4) - 0.055; }

// A lens's true share of light: a disc as wide as its rectangle with a rim of one pixel, darker outwards.
#define FALL_OFF 0.25
static double share(const sv_footprint *f, int x, int y) {
  double r = 0.5 * f->width_px - 1, dx = x + 0.5 - 0.5 * f->width_px, dy = y + 0.5 - 0.5 * f->height_px;
  double d = sqrt(dx * dx + dy * dy), rim = r + 0.5 - d;
  return (rim < 0 ? 0 : rim > 1 ? 1 : rim) * (1 - FALL_OFF * d * d / (r * r));
}

// One sensor picture, 16 bits sRGB-encoded, with read noise; rgb NULL: white.
static void save(const char *path, const sv_sim *sim, const sv_footprint *f, const uint8_t *rgb,
                 sv_rng *rng) {
  int w = sim->cfg.width_px, h = sim->cfg.height_px;
  sv_bitmap b = {.width_px = w, .height_px = h, .n_channels = 1, .bits = 16};
  b.u16 = malloc((size_t)w * (size_t)h * 2);
  for (int y = 0; y < h; y++)
    for (int x = 0; x < w; x++) {
      int lx = x - f->x0_px, ly = y - f->y0_px;
      double v = 0.004;
      if (lx >= 0 && ly >= 0 && lx < f->width_px && ly < f->height_px) {
        const uint8_t *p = rgb ? rgb + 3 * (ly * f->width_px + lx) : NULL;
        double l = p ? (light_of(p[0] / 255.0) + light_of(p[1] / 255.0) + light_of(p[2] / 255.0)) / 3 : 0.85;
        v += l * share(f, lx, ly);
      }
      v += 0.002 * (double)sv_rng_normal(rng);
      b.u16[y * w + x] = (uint16_t)lrint(65535 * srgb_of(v < 0 ? 0 : v > 1 ? 1 : v));
    }
  if (sv_bitmap_write_png(path, &b, &err) != SV_OK) fail_msg("%s", err.text);
  free(b.u16);
}

static void make_pictures(sv_sim *sim, int n_exposures) {
  sv_rng rng = sv_rng_make(3, 1);
  uint8_t *rgb = malloc((size_t)sim->cfg.width_px * (size_t)sim->cfg.height_px * 3);
  for (int e = -1; e < n_exposures; e++)
    for (int i = 0; i < sim->rig.n_sub_views; i++) {
      const sv_sub_view *v = &sim->rig.sub_views[i];
      char path[SV_CAP_PATH], name[80];
      sv_view view;
      double time_s;
      snprintf(name, sizeof name, "e%02d/%s.png", e, v->name);
      if (e < 0) snprintf(name, sizeof name, "%s.png", v->name);
      assert_int_equal(sv_path_join(path, sizeof path, e < 0 ? white : isolated, name, &err), SV_OK);
      if (e >= 0) {
        sv_sim_view(sim, e, i, &view, &time_s);
        sv_sim_render(sim, &view, 0, rgb, NULL);
      }
      save(path, sim, &v->footprint, e < 0 ? NULL : rgb, &rng);
    }
  free(rgb);
}

static void make_folders(int n_exposures) {
  const char *tmp = getenv("TMPDIR");
  snprintf(folder, sizeof folder, "%s/subview-lenslets-%ld", tmp ? tmp : "/tmp", (long)getpid());
  in_folder(white, "white"), in_folder(isolated, "isolated"), in_folder(out, "rig");
  assert_int_equal(sv_path_make_folder(white, &err), SV_OK);
  for (int e = 0; e < n_exposures; e++) {
    char path[SV_CAP_PATH], name[16];
    snprintf(name, sizeof name, "e%02d", e);
    assert_int_equal(sv_path_join(path, sizeof path, isolated, name, &err), SV_OK);
    assert_int_equal(sv_path_make_folder(path, &err), SV_OK);
  }
}

static void remove_folders(void) {
  char command[SV_CAP_PATH + 20];
  snprintf(command, sizeof command, "rm -rf '%s'", folder);
  if (system(command) != 0) printf("%s stays\n", folder);
}

static void read_back(sv_rig *rig, sv_arena *a, sv_arena *scratch) {
  static sv_coverage_names names;
  sv_file_reader files = {out, sv_folder_read};
  assert_int_equal(sv_rig_init(rig, 64, a), SV_OK);
  if (sv_rig_read_coverage(rig, &names, &files, "rig.json", 1, scratch, &err) != SV_OK)
    fail_msg("%s", err.text);
  if (sv_coverage_load(out, rig, &names, &err) != SV_OK) fail_msg("%s", err.text);
}

static void check_footprint(const sv_sub_view *v, const sv_sub_view *want) {
  const sv_footprint *f = &v->footprint, *g = &want->footprint;
  double sum = 0, diff = 0;
  for (int y = 0; y < g->height_px; y++)
    for (int x = 0; x < g->width_px; x++) {
      int fx = x + g->x0_px - f->x0_px, fy = y + g->y0_px - f->y0_px;
      bool is_in = fx >= 0 && fy >= 0 && fx < f->width_px && fy < f->height_px;
      double c = is_in ? f->coverage[fy * f->width_px + fx] / 255.0 : 0;
      // The plateau is the brightest 5 % of the lit part: in a disc, what d^2 < r^2 / 20 sees at least.
      double want_share = fmin(1, share(g, x, y) / (1 - FALL_OFF * 0.05));
      sum += want_share, diff += fabs(c - want_share);
    }
  if (!(diff < 0.01 * sum)) fail_msg("%s: coverage is off by %.2f %%", v->name, 100 * diff / sum);
}

typedef struct {
  double rotation_deg, focal, place; // worst; the last two as shares
} errors;

static errors compare(const sv_rig *rig, const sv_rig *want) {
  errors e = {0};
  sv_pose back = sv_pose_inv(&want->sub_views[0].cam_from_rig);
  double far[3];
  sv_pose last = sv_pose_mul(&want->sub_views[want->n_sub_views - 1].cam_from_rig, &back);
  sv_pose_centre(far, &last);
  for (int i = 0; i < rig->n_sub_views; i++) {
    const sv_sub_view *v = &rig->sub_views[i];
    sv_pose true_pose = sv_pose_mul(&want->sub_views[i].cam_from_rig, &back), inv = sv_pose_inv(&true_pose);
    double r[9], w[3], a[3], b[3];
    sv_mul33(r, v->cam_from_rig.r, inv.r);
    sv_rodrigues_inv(w, r);
    sv_pose_centre(a, &v->cam_from_rig), sv_pose_centre(b, &true_pose);
    sv_sub3(a, a, b);
    e.rotation_deg = fmax(e.rotation_deg, sv_norm3(w) * 180 / SV_PI);
    e.place = fmax(e.place, sv_norm3(a) / sv_norm3(far));
    e.focal = fmax(e.focal, fabs(v->model.p[0] / want->sub_views[i].model.p[0] - 1));
  }
  return e;
}

static void test_texture(void **state) {
  (void)state;
  enum { N_EXPOSURES = 4 };
  if (!sv_structure_available()) {
    printf("skip  this build has no OpenCV to match pictures with (libopencv-dev)\n");
    skip();
  }
  static uint8_t block[1 << 20], room[1 << 20];
  sv_sim *sim = calloc(1, sizeof *sim);
  sv_sim_config cfg;
  if (sv_sim_parse(&cfg, "textured,rig=multiplexed,size=480x480,grid=3x3", &err) != SV_OK)
    fail_msg("%s", err.text);
  size_t n_bytes = sv_sim_bytes(&cfg) + 4096;
  void *memory = malloc(n_bytes);
  sv_arena arena = sv_arena_make(memory, n_bytes);
  if (sv_sim_init(sim, &cfg, &arena, &err) != SV_OK) fail_msg("%s", err.text);
  make_folders(N_EXPOSURES);
  make_pictures(sim, N_EXPOSURES);
  double a[3], b[3];
  sv_pose_centre(a, &sim->rig.sub_views[0].cam_from_rig),
      sv_pose_centre(b, &sim->rig.sub_views[1].cam_from_rig);
  sv_sub3(a, a, b);
  cal_options o = {.isolated = isolated,
                   .white = white,
                   .out = out,
                   .pitch_m = sv_norm3(a),
                   .focal_px = sim->rig.sub_views[0].model.p[0],
                   .dark = -1,
                   .threads = 2,
                   .spacing_m = -1};
  assert_int_equal(cal_cmd_lenslets(&o), CAL_EXIT_OK);
  sv_rig rig;
  sv_arena arena2 = sv_arena_make(block, sizeof block), scratch = sv_arena_make(room, sizeof room);
  read_back(&rig, &arena2, &scratch);
  assert_int_equal(rig.n_sub_views, sim->rig.n_sub_views);
  for (int i = 0; i < rig.n_sub_views; i++) check_footprint(&rig.sub_views[i], &sim->rig.sub_views[i]);
  errors e = compare(&rig, &sim->rig);
  printf("worst: rotation %.4f degrees, focal length %.3f %%, place %.3f %% of the array\n", e.rotation_deg,
         100 * e.focal, 100 * e.place);
  // Features of a shaded scene are not as good as corners of a board.
  assert_true(e.rotation_deg < 0.6 && e.focal < 0.02);
  sv_coverage_free(&rig);
  remove_folders();
  free(memory), free(sim);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_texture)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
