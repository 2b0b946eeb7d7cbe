// SPDX-License-Identifier: Apache-2.0
// Footprints from simulated white images, and their way to disk and back.
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "src/base/rng.h"
#include "src/format/rig_file.h"
#include "src/rig/footprint.h"
#include "tests/common/test.h"
#include "tools/common/coverage.h"
#include "tools/common/fileio.h"

enum { W = 300, H = 240 };

static sv_err err;

// --- simulated lenses ----------------------------------------------------------------------------

typedef struct {
  double x, y, half, round; // centre, half side, radius of the corners (half: a circle)
  double fall_off;          // loss of light at the rim
  double shot, read, dark, level;
  int bits;
  double n_dead;
  uint64_t seed; // of its noise
} lens;

// Light of a place, 0..1 of the brightest: inside the shape, with its rim one pixel wide.
static double light(const lens *l, double x, double y) {
  double dx = fabs(x - l->x) - (l->half - l->round), dy = fabs(y - l->y) - (l->half - l->round);
  double d = dx > 0 && dy > 0 ? sqrt(dx * dx + dy * dy) : dx > dy ? dx : dy;
  double r2 = ((x - l->x) * (x - l->x) + (y - l->y) * (y - l->y)) / (l->half * l->half);
  return d > l->round ? 0 : 1 - l->fall_off * r2;
}

// The truth from 4x4 sub-samples a pixel, over 2x2 more for a blurred rim; px as measured.
static void expose(const lens *l, float *truth, uint16_t *px) {
  sv_rng rng = sv_rng_make(l->seed, 1);
  double top = (double)((1 << l->bits) - 1);
  for (int y = 0; y < H; y++)
    for (int x = 0; x < W; x++) {
      double sum = 0;
      for (int k = 0; k < 16; k++) sum += light(l, x + (k % 4 + 0.5) / 4, y + (k / 4 + 0.5) / 4) / 16;
      truth[y * W + x] = (float)sum;
      double v = l->dark + l->level * sum;
      v += sqrt(l->shot * l->level * sum + l->read) * (double)sv_rng_normal(&rng);
      if (sv_rng_f(&rng) < (float)l->n_dead) v = sv_rng_f(&rng) < 0.5f ? 0 : 1;
      v = v < 0 ? 0 : v > 1 ? 1 : v;
      px[y * W + x] = (uint16_t)(floor(v * top + 0.5) / top * 65535 + 0.5);
    }
}

static lens lens_make(double x, double y, double half, double round) {
  return (lens){
      .x = x, .y = y, .half = half, .round = round, .dark = 0.03, .level = 0.7, .bits = 14, .seed = 1};
}

static uint8_t out_block[1 << 20], scratch_block[1 << 20];

static sv_status measure(const lens *l, float *truth, sv_footprint *f, sv_footprint_stats *st, double dark,
                         sv_arena *out) {
  uint16_t *px = malloc(sizeof *px * W * H);
  sv_arena scratch = sv_arena_make(scratch_block, sizeof scratch_block);
  expose(l, truth, px);
  sv_raw raw = {.u16 = px, .width_px = W, .height_px = H, .n_channels = 1};
  sv_status s = sv_footprint_measure(f, st, &(sv_white_image){"lens03.png", &raw, dark}, out, &scratch, &err);
  assert_int_equal(sv_arena_mark(&scratch), sv_arena_make(scratch_block, sizeof scratch_block).used_bytes);
  free(px);
  return s;
}

static float covers(const sv_footprint *f, int x, int y) {
  int i = x - f->x0_px, j = y - f->y0_px;
  return i < 0 || j < 0 || i >= f->width_px || j >= f->height_px
             ? 0
             : (float)f->coverage[j * f->width_px + i] / 255;
}

static double worst_error, worst_lit_error, worst_area;

static void check(const lens *l) {
  float *truth = malloc(sizeof *truth * W * H);
  sv_arena out = sv_arena_make(out_block, sizeof out_block);
  sv_footprint f;
  sv_footprint_stats st;
  assert_ok(measure(l, truth, &f, &st, -1, &out), &err);
  double error = 0, area = 0, lit = 0, n_lit = 0;
  for (int y = 0; y < H; y++)
    for (int x = 0; x < W; x++) {
      double t = (double)truth[y * W + x], e = fabs((double)covers(&f, x, y) - t);
      error += e / (W * H);
      area += t;
      if (t > 0) {
        lit += e;
        n_lit++;
      }
    }
  lit /= n_lit;
  double off = fabs(st.area_px / area - 1);
  if (error > 0.01 || lit > 0.01 || off > 0.01 || fabs(st.dark - l->dark) > 0.002)
    fail_msg(
        "lens %g,%g half %g round %g: error %.4f (lit part %.4f), area off by %.4f, dark %.4f, plateau %.4f",
        l->x, l->y, l->half, l->round, error, lit, off, st.dark, st.plateau);
  worst_error = fmax(worst_error, error);
  worst_lit_error = fmax(worst_lit_error, lit);
  worst_area = fmax(worst_area, off);
  free(truth);
}

TEST(test_measure) {
  // ISO 100, 400, 800
  static const double shot[] = {3e-5, 1.3e-4, 2.7e-4}, read[] = {1e-8, 1.4e-7, 5e-7};
  for (int iso = 0; iso < 3; iso++)
    for (int k = 0; k < 6; k++) {
      double half = 22 + 14 * k;
      lens l = lens_make(100.3 + 7 * k, 118.6 - k, half, k & 1 ? half : 0.3 * half);
      l.shot = shot[iso];
      l.read = read[iso];
      if (k == 4) l.x = 40; // over the sensor's edge
      if (k == 3) l.n_dead = 5e-4;
      l.seed = (uint64_t)(iso * 6 + k);
      check(&l);
      l.bits = 8;
      l.seed += 100;
      check(&l);
    }
  print_message("coverage: mean error %.5f over the sensor, %.5f over the lens, area %.4f (worst cases)\n",
                worst_error, worst_lit_error, worst_area);
}

// Light that falls off inside the lens is part of its weight.
TEST(test_fall_off) {
  lens l = lens_make(150.2, 121.7, 80, 80);
  l.fall_off = 0.1;
  l.shot = 1.3e-4;
  l.read = 1.4e-7;
  l.seed = 3;
  check(&l);
}

static void refuse(const lens *l, double dark, const char *word) {
  float *truth = malloc(sizeof *truth * W * H);
  sv_arena out = sv_arena_make(out_block, sizeof out_block);
  size_t mark = sv_arena_mark(&out);
  sv_footprint f;
  sv_footprint_stats st;
  sv_status s = measure(l, truth, &f, &st, dark, &out);
  if (s >= 0 || !strstr(err.text, word) || !strstr(err.text, "lens03.png"))
    fail_msg("'%s' expected: %s", word, s < 0 ? err.text : "accepted");
  assert_int_equal(sv_arena_mark(&out), mark);
  free(truth);
}

TEST(test_no_footprint) {
  lens l = lens_make(150, 120, 60, 60);
  l.read = 1e-6;
  l.level = 0.01;
  refuse(&l, -1, "no lit lens");
  l.level = 0.97;
  refuse(&l, -1, "overexposed");
  l.level = 0.4;
  l.dark = 0.45; // other lenses are not masked
  refuse(&l, -1, "mask the other lenses");
  // lights the whole sensor: only a given dark level helps
  lens all = lens_make(150, 120, 400, 400);
  refuse(&all, -1, "no lit lens");
  float *truth = malloc(sizeof *truth * W * H);
  sv_arena out = sv_arena_make(out_block, sizeof out_block), small = sv_arena_make(out_block, 1000);
  sv_footprint f;
  sv_footprint_stats st;
  assert_int_equal(measure(&all, truth, &f, &st, 0.03, &out), SV_OK);
  assert_true(f.width_px == W && f.height_px == H && fabs(st.area_px / (W * H) - 1) < 0.005);
  assert_int_equal(measure(&all, truth, &f, &st, 0.03, &small), SV_E_NOMEM);
  free(truth);
}

// Four lenses of a multiplexed sensor: the sum of what was measured is the sum of the truth.
TEST(test_sum) {
  sv_arena out = sv_arena_make(out_block, sizeof out_block);
  sv_footprint f[4];
  sv_footprint_stats st;
  float *truth = malloc(sizeof *truth * W * H), *sum = malloc(sizeof *sum * W * H);
  float *want = calloc(W * H, sizeof *want), most = 0;
  for (int m = 0; m < 4; m++) {
    lens l = lens_make(110 + 80 * (m & 1), 85 + 70 * (m >> 1), 60, 60);
    l.shot = 1.3e-4;
    l.read = 1.4e-7;
    l.seed = (uint64_t)m;
    assert_int_equal(measure(&l, truth, &f[m], &st, -1, &out), SV_OK);
    for (int i = 0; i < W * H; i++) want[i] += truth[i];
  }
  for (int i = 0; i < W * H; i++) most = want[i] > most ? want[i] : most;
  sv_overlap_map map = {.width_px = W, .height_px = H, .sum = sum};
  assert_int_equal(sv_footprint_sum(f, 4, &map, &err), SV_OK);
  double error = 0;
  for (int i = 0; i < W * H; i++) error += (double)fabsf(sum[i] - want[i]) / (W * H);
  print_message("sum of four: M_max %.3f, true %.3f, mean error %.5f\n", (double)map.max_overlap,
                (double)most, error);
  assert_true(fabsf(map.max_overlap - most) <= 0.02f && error < 0.01);
  f[2].coverage = NULL; // all of the rectangle
  assert_int_equal(sv_footprint_sum(f, 4, &map, &err), SV_OK);
  assert_true(sum[f[2].y0_px * W + f[2].x0_px] >= 1);
  map.width_px = W - 90;
  assert_int_equal(sv_footprint_sum(f, 4, &map, &err), SV_E_RANGE);
  assert_contains(err.text, "not on the sensor");
  free(truth);
  free(sum);
  free(want);
}

// --- files ---------------------------------------------------------------------------------------

static const char model_text[] = "{'lensmodel':'LENSMODEL_PINHOLE','intrinsics':[1,1,1,1],"
                                 "'extrinsics':[0,0,0,0,0,0],'imagersize':[4,3]}";

static sv_status from_text(void *self, const char *name, void *buf, size_t cap, size_t *bytes, sv_err *e) {
  const char *text = strstr(name, ".json") ? self : model_text;
  (void)e, (void)cap;
  *bytes = strlen(text);
  memcpy(buf, text, *bytes);
  return SV_OK;
}

static sv_status read_rig(const char *json, sv_rig *rig, sv_coverage_names *names) {
  static _Alignas(64) uint8_t rig_block[4096];
  sv_arena a = sv_arena_make(rig_block, sizeof rig_block);
  sv_arena scratch = sv_arena_make(scratch_block, sizeof scratch_block);
  assert_int_equal(sv_rig_init(rig, 4, &a), SV_OK);
  sv_file_reader files = {(void *)(uintptr_t)json, from_text};
  return sv_rig_read_coverage(rig, names, &files, 1, &scratch, &err);
}

#define RIG(rest)                                                                                            \
  "{\"version\":1,\"name\":\"m\",\"forward\":\"multiplexed\",\"sub_views\":[{\"name\":\"a\",\"model\":"      \
  "\"a.cameramodel\",\"camera\":0" rest "},{\"name\":\"b\",\"model\":\"b.cameramodel\",\"camera\":0,"        \
  "\"footprint\":[5,6,4,3]}]}"

#define DIRECT(rest)                                                                                         \
  "{\"version\":1,\"name\":\"d\",\"forward\":\"direct\",\"sub_views\":[{\"name\":\"a\",\"model\":"           \
  "\"a.cameramodel\",\"camera\":0" rest "},{\"name\":\"b\",\"model\":\"b.cameramodel\",\"camera\":0}]}"

TEST(test_rig_json) {
  sv_rig rig;
  sv_coverage_names names;
  char text[2048];
  assert_int_equal(read_rig(RIG(",\"footprint\":[1,2,4,3],\"coverage\":\"lens a.png\""), &rig, &names),
                   SV_OK);
  assert_string_equal(names.name[0], "lens a.png");
  assert_string_equal(names.name[1], "");
  sv_str out = sv_str_make(text, sizeof text);
  assert_int_equal(sv_rig_json_write_coverage(&out, &rig, &names), SV_OK);
  assert_contains(text, "\"footprint\": [1, 2, 4, 3], \"coverage\": \"lens a.png\"}");
  memset(&names, 0, sizeof names);
  assert_int_equal(read_rig(text, &rig, &names), SV_OK);
  assert_string_equal(names.name[0], "lens a.png");
  assert_int_equal(read_rig(text, &rig, NULL), SV_OK); // who does not ask is not told
  static const char *const bad[][2] = {
      {RIG(",\"coverage\":\"a.png\""), "without a footprint"},
      {RIG(",\"footprint\":[1,2,4,3],\"coverage\":\"../a.png\""), "'.'"},
      {RIG(",\"footprint\":[1,2,4,3],\"coverage\":\"x/a.png\""), "separator"},
      {RIG(",\"footprint\":[1,2,4,3],\"coverage\":7"), "coverage"},
      {RIG(",\"footprint\":[1,2,4,3],\"coverage\":"
           "\"a012345678901234567890123456789012345678901234567890123456789012345.png\""),
       "coverage"},
      {RIG(",\"footprint\":[1,2,4,3],\"mask\":\"a.png\""), "shares its pixels"},
      {DIRECT(",\"mask\":\"../a.png\""), "'.'"},
      {DIRECT(",\"mask\":7"), "mask"}};
  for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
    if (read_rig(bad[i][0], &rig, &names) >= 0 || !strstr(err.text, bad[i][1]) ||
        !strstr(err.text, "rig.json"))
      fail_msg("%s: %s", bad[i][1], err.text);
}

TEST(test_folder) {
  char folder[] = "/tmp/subview-footprint-XXXXXX", path[128];
  assert_non_null(mkdtemp(folder));
  static const uint8_t coverage[12] = {0, 1, 2, 3, 100, 200, 254, 255, 9, 8, 7, 6};
  sv_rig rig;
  sv_coverage_names names;
  assert_int_equal(read_rig(RIG(",\"footprint\":[1,2,4,3],\"coverage\":\"a.png\""), &rig, &names), SV_OK);
  assert_int_equal(sv_coverage_load(folder, &rig, &names, &err), SV_E_NOT_FOUND);
  assert_true(!rig.sub_views[0].footprint.coverage);
  rig.sub_views[0].footprint.coverage = coverage;
  assert_int_equal(sv_coverage_save(folder, "a.png", &rig.sub_views[0].footprint, &err), SV_OK);
  rig.sub_views[0].footprint.coverage = NULL;
  assert_ok(sv_coverage_load(folder, &rig, &names, &err), &err);
  assert_memory_equal(rig.sub_views[0].footprint.coverage, coverage, 12);
  assert_true(!rig.sub_views[1].footprint.coverage);
  sv_coverage_free(&rig);
  assert_true(!rig.sub_views[0].footprint.coverage);
  rig.sub_views[0].footprint.width_px = 3; // another size than the picture's
  assert_int_equal(sv_coverage_load(folder, &rig, &names, &err), SV_E_FORMAT);
  assert_contains(err.text, "4x3");
  snprintf(path, sizeof path, "%s/a.png", folder);
  unlink(path);
  rmdir(folder);
}

// A mask beside a lens file: its name is kept and written again, its picture has the sub-view's
// size.
TEST(test_mask) {
  char folder[] = "/tmp/subview-footprint-XXXXXX", path[128], text[2048];
  static const uint8_t px[12] = {0, 255, 255, 255, 255, 255, 255, 255, 255, 255, 255, 0};
  assert_non_null(mkdtemp(folder));
  sv_rig rig;
  sv_coverage_names names;
  assert_ok(read_rig(DIRECT(",\"mask\":\"own shadow.png\""), &rig, &names), &err);
  sv_str out = sv_str_make(text, sizeof text);
  assert_int_equal(sv_rig_json_write_coverage(&out, &rig, &names), SV_OK);
  assert_contains(text, "\"mask\": \"own shadow.png\"}");
  assert_ok(read_rig(text, &rig, &names), &err);
  assert_string_equal(names.mask[0], "own shadow.png");
  assert_string_equal(names.mask[1], "");
  assert_error(sv_coverage_load(folder, &rig, &names, &err), SV_E_NOT_FOUND, &err, "own shadow.png");
  const sv_footprint same = {0, 0, 4, 3, px}, other = {0, 0, 3, 4, px};
  assert_ok(sv_coverage_save(folder, "own shadow.png", &same, &err), &err);
  assert_ok(sv_coverage_load(folder, &rig, &names, &err), &err);
  assert_memory_equal(rig.sub_views[0].mask, px, 12);
  assert_true(!rig.sub_views[1].mask);
  sv_coverage_free(&rig);
  assert_true(!rig.sub_views[0].mask);
  assert_ok(sv_coverage_save(folder, "own shadow.png", &other, &err), &err);
  assert_error(sv_coverage_load(folder, &rig, &names, &err), SV_E_FORMAT, &err,
               "3x4 pixels, its sub-view in rig.json has 4x3");
  snprintf(path, sizeof path, "%s/own shadow.png", folder);
  unlink(path);
  rmdir(folder);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_measure), cmocka_unit_test(test_fall_off), cmocka_unit_test(test_no_footprint),
      cmocka_unit_test(test_sum),     cmocka_unit_test(test_rig_json), cmocka_unit_test(test_folder),
      cmocka_unit_test(test_mask),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
