// SPDX-License-Identifier: Apache-2.0
// A made raw file of a Lytro camera, by the format's public description: 10-bit mosaic in a
// container, white images at several zooms beside it. The sub-views show the scene to 40 dB, the
// white image is the nearest bright one, and damaged files get one sentence.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/format/rig_file.h"
#include "tests/common/test.h"
#include "tools/import/lytro.h"
#include "tools/lab/lab.h"

enum { W = 320, H = 288, KEEP = 5, LEVELS = 1023 };
#define PITCH_PX 12.0
#define FOCAL_M  0.01
#define LENS_M   2e-4 // pitch of the microlenses: sub-views have a focal length of 50 px
#define F_NUMBER 2.0
#define PLANE_M  0.5
#define BLACK    64

static sv_err err;
static uint8_t file[1 << 20];
static size_t file_bytes;

static const double focal_px = FOCAL_M / LENS_M, baseline_m = FOCAL_M / F_NUMBER / PITCH_PX;

// Linear light of the plane.
static double texture(double x_m, double y_m, int channel) {
  const double k = 2 * 3.14159265358979 * focal_px / PLANE_M; // cycles per pixel of a sub-view
  return 0.3 + 0.12 * cos(k * (0.03 * x_m + 0.02 * y_m) + channel);
}

// What the sensor's pixel measures: GRBG, focus at infinity.
static int measure(int px, int py, bool is_white, double level) {
  static const int color[4] = {1, 0, 2, 1};
  const int c = color[2 * (py & 1) + (px & 1)];
  double sum = 0;
  for (int k = 0; k < 16; k++) {
    double x = px + (k % 4 + 0.5) / 4 - W / 2.0, y = py + (k / 4 + 0.5) / 4 - H / 2.0;
    double s = x / PITCH_PX, t = y / PITCH_PX, ls = floor(s + 0.5), lt = floor(t + 0.5);
    double u = (s - ls) * PITCH_PX, v = (t - lt) * PITCH_PX;
    double r2 = (u * u + v * v) / (0.24 * PITCH_PX * PITCH_PX), shade = r2 < 1 ? 1 - 0.2 * r2 : 0;
    sum += shade / 16 *
           (is_white ? level
                     : texture(ls * PLANE_M / focal_px + baseline_m * u,
                               lt * PLANE_M / focal_px + baseline_m * v, c));
  }
  return (int)lrint(BLACK + sum * (LEVELS - BLACK));
}

static void pack(uint8_t *out, bool is_white, double level) {
  for (int i = 0; i < W * H; i += 4) {
    uint8_t *p = out + i / 4 * 5;
    p[4] = 0;
    for (int k = 0; k < 4; k++) {
      const int v = measure((i + k) % W, (i + k) / W, is_white, level);
      p[k] = (uint8_t)(v >> 2);
      p[4] = (uint8_t)(p[4] | (v & 3) << (2 * k));
    }
  }
}

static int describe(char *out, size_t cap, int zoom) {
  return snprintf(
      out, cap,
      "{\"image\": {\"width\": %d, \"height\": %d, \"pixelPacking\": {\"endianness\": \"little\", "
      "\"bitsPerPixel\": 10}, \"pixelFormat\": {\"black\": {\"r\": 64, \"gr\": 64, \"gb\": 64, \"b\": 64}, "
      "\"white\": {\"r\": 1023, \"gr\": 1023, \"gb\": 1023, \"b\": 1023}}, \"mosaic\": {\"tile\": "
      "\"r,gr:gb,b\", \"upperLeftPixel\": \"gr\"}}, \"devices\": {\"lens\": {\"focalLength\": %g, "
      "\"fNumber\": %g, \"zoomStep\": %d, \"focusStep\": 400}, \"mla\": {\"lensPitch\": %g}, \"sensor\": "
      "{\"pixelPitch\": 1.4e-6}}}",
      W, H, FOCAL_M, F_NUMBER, zoom, LENS_M);
}

static void put_section(char kind, const void *data, size_t bytes) {
  uint8_t *p = file + file_bytes;
  memset(p, 0, 96);
  memcpy(p, "\x89LF?\r\n\x1a\n", 8);
  p[3] = (uint8_t)kind;
  p[11] = kind == 'P';
  for (int i = 0; i < 4; i++) p[12 + i] = (uint8_t)(bytes >> (24 - 8 * i));
  file_bytes += 16;
  if (!bytes) return;
  memcpy(p + 16, "sha1-0000000000000000000000000000000000000000", 45);
  memcpy(p + 96, data, bytes);
  file_bytes += 80 + bytes;
  while (file_bytes % 16) file[file_bytes++] = 0;
}

static void make_container(void) {
  static uint8_t raw[W * H / 4 * 5];
  static const char table[] = "{\"frames\": [{\"frame\": {\"metadataRef\": \"a\", \"imageRef\": \"b\"}}]}";
  char text[2000];
  file_bytes = 0;
  pack(raw, false, 0);
  put_section('P', NULL, 0);
  put_section('M', table, sizeof table - 1);
  put_section('C', raw, sizeof raw);
  put_section('C', text, (size_t)describe(text, sizeof text, 600));
}

static void save(const char *name, const void *data, size_t bytes) {
  char path[400], up[400];
  snprintf(path, sizeof path, "%s/%s", temp_folder, name);
  sv_path_folder(up, sizeof up, path);
  assert_ok(sv_path_make_folder(up, &err), &err);
  assert_ok(sv_file_write(path, data, bytes, &err), &err);
}

static void make_white(int i, int zoom, double level) {
  static uint8_t raw[W * H / 4 * 5];
  char text[2000], name[40];
  pack(raw, true, level);
  snprintf(name, sizeof name, "in/white/MOD_%04d.TXT", i);
  save(name, text, (size_t)describe(text, sizeof text, zoom));
  snprintf(name, sizeof name, "in/white/MOD_%04d.RAW", i);
  save(name, raw, sizeof raw);
}

static double encode(double v) { return v <= 0.0031308 ? 12.92 * v : 1.055 * pow(v, 1 / 2.4) - 0.055; }

// PSNR of the sub-views against the plane as their cameras see it.
static double psnr_of(const char *out, const sv_rig *rig) {
  double sum = 0;
  int n = 0;
  for (int i = 0; i < rig->n_sub_views; i++) {
    const sv_sub_view *s = &rig->sub_views[i];
    char path[600];
    sv_bitmap b;
    double center[3];
    snprintf(path, sizeof path, "%s/images/%s/000000.png", out, s->name);
    assert_ok(sv_bitmap_read(path, &b, &err), &err);
    sv_pose_centre(center, &s->cam_from_rig);
    for (int y = 2; y < b.height_px - 2; y++)
      for (int x = 2; x < b.width_px - 2; x++)
        for (int c = 0; c < 3; c++) {
          double u = center[0] + (x + 0.5 - s->model.p[2]) * PLANE_M / s->model.p[0];
          double v = center[1] + (y + 0.5 - s->model.p[3]) * PLANE_M / s->model.p[1];
          double e = b.u16[(y * b.width_px + x) * 3 + c] / 65535.0 - encode(texture(u, v, c));
          sum += e * e;
          n++;
        }
    sv_bitmap_free(&b);
  }
  return -10 * log10(sum / n);
}

TEST(test_lytro) {
  static uint8_t rig_block[64 << 10], scratch_block[256 << 10];
  char in[400], out[400], path[SV_CAP_PATH];
  sv_rig rig;
  make_container();
  save("in/IMG_0001.LFR", file, file_bytes);
  make_white(0, 200, 0.8);
  make_white(1, 640, 0.85);
  make_white(2, 601, 0.01); // nearest, but dark
  snprintf(in, sizeof in, "%s/in", temp_folder);
  snprintf(out, sizeof out, "%s/out", temp_folder);
  lab_options o = {.from = "lytro", .input = in, .out = out, .keep = KEEP, .is_quiet = true};
  assert_int_equal(lab_cmd_import(&o), LAB_EXIT_OK);
  snprintf(path, sizeof path, "%s/rig", out);
  sv_arena a = sv_arena_make(rig_block, sizeof rig_block),
           scratch = sv_arena_make(scratch_block, sizeof scratch_block);
  sv_file_reader files = {path, sv_folder_read};
  assert_int_equal(sv_rig_init(&rig, KEEP * KEEP, &a), SV_OK);
  assert_ok(sv_rig_read(&rig, &files, -1, &scratch, &err), &err);
  assert_int_equal(rig.n_sub_views, KEEP * KEEP);
  double c0[3], c1[3];
  sv_pose_centre(c0, &rig.sub_views[0].cam_from_rig);
  sv_pose_centre(c1, &rig.sub_views[1].cam_from_rig);
  assert_near(fabs(c1[0] - c0[0]), baseline_m, 0.01 * baseline_m);
  assert_near(rig.sub_views[0].model.p[0], focal_px, 0.01 * focal_px);
  assert_psnr(psnr_of(out, &rig), 40);
  lab_lytro l;
  sv_bitmap white = {0};
  const sv_file_data f = {"f", file, file_bytes};
  assert_ok(lab_lytro_parse(&l, &f, &err), &err);
  snprintf(in, sizeof in, "%s/in/white", temp_folder);
  assert_ok(lab_lytro_white(in, &l, path, &white, &err), &err);
  assert_contains(path, "MOD_0001");
  sv_bitmap_free(&white);
}

// Twelve bits as the first camera packs them.
TEST(test_twelve_bits) {
  static const uint8_t raw[384] = {0x12, 0x34, 0x56};
  static const char json[] = "{\"image\": {\"width\": 16, \"height\": 16, \"rawDetails\": {\"pixelPacking\": "
                             "{\"endianness\": \"big\", \"bitsPerPixel\": 12}}}, \"devices\": {}}";
  const sv_file_data j = {"j", json, sizeof json - 1}, r = {"r", raw, sizeof raw};
  lab_lytro l;
  sv_bitmap b;
  assert_ok(lab_lytro_describe(&l, &j, &r, &err), &err);
  assert_ok(lab_lytro_develop(&l, true, &b, &err), &err);
  assert_near(b.u16[0], 0x123 / 4095.0 * 65535, 1);
  assert_near(b.u16[1], 0x456 / 4095.0 * 65535, 1);
  sv_bitmap_free(&b);
}

TEST(test_damaged) {
  make_container();
  for (size_t i = 0; i < 900; i++) {
    lab_lytro l;
    sv_bitmap b;
    uint8_t *copy = malloc(file_bytes);
    assert_non_null(copy);
    memcpy(copy, file, file_bytes);
    // Cut; changed near the end; changed at the start.
    const size_t n = i < 400 ? file_bytes * i / 400 : file_bytes;
    const size_t at = i < 650 ? file_bytes - 1 - (i % 400) * 3 : i - 650;
    if (i >= 400) copy[at] ^= 0x15;
    const sv_file_data f = {"IMG.LFR", copy, n};
    sv_status s = lab_lytro_parse(&l, &f, &err);
    assert_true(i >= 400 || s < 0 || n + 200 > file_bytes);
    if (s == SV_OK && i % 50 == 0 && lab_lytro_develop(&l, true, &b, &err) == SV_OK) sv_bitmap_free(&b);
    if (s < 0) assert_one_sentence(err.text);
    free(copy);
  }
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_lytro),
      cmocka_unit_test(test_twelve_bits),
      cmocka_unit_test(test_damaged),
  };
  return cmocka_run_group_tests(tests, temp_folder_setup, temp_folder_teardown);
}
