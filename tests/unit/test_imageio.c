// SPDX-License-Identifier: Apache-2.0
// PNG and JPEG of every kind that host tools read, and the files under them. Works in a folder of
// its own.
#include <math.h>
#include <png.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "tests/common/test.h"
#include "tools/common/fileio.h"
#include "tools/common/imageio.h"

static sv_err fail;
static char folder[] = "/tmp/subview-imageio-XXXXXX";
static char path[256];

static const char *at(const char *name) {
  assert_int_equal(sv_path_join(path, sizeof path, folder, name, &fail), SV_OK);
  return path;
}

static size_t n_samples(const sv_bitmap *b) {
  return (size_t)b->width_px * (size_t)b->height_px * (size_t)b->n_channels;
}

static sv_bitmap make(int w, int h, int nc, int bits) { // noise
  sv_bitmap b = {w, h, nc, bits, NULL, NULL};
  size_t n = n_samples(&b);
  if (bits == 8) b.u8 = malloc(n);
  else b.u16 = malloc(2 * n);
  uint32_t x = 12345;
  for (size_t i = 0; i < n; i++) {
    x = x * 1664525u + 1013904223u;
    if (bits == 8) b.u8[i] = (uint8_t)(x >> 24);
    else b.u16[i] = (uint16_t)(x >> 16);
  }
  return b;
}

TEST(test_png_round_trip) {
  for (int nc = 1; nc <= 4; nc++)
    for (int bits = 8; bits <= 16; bits += 8) {
      sv_bitmap b = make(37, 21, nc, bits), r;
      assert_int_equal(sv_bitmap_write_png(at("a.png"), &b, &fail), SV_OK);
      assert_int_equal(sv_bitmap_read(path, &r, &fail), SV_OK);
      assert_true(r.width_px == 37 && r.height_px == 21 && r.n_channels == nc && r.bits == bits);
      assert_memory_equal(bits == 8 ? (void *)r.u8 : (void *)r.u16, bits == 8 ? (void *)b.u8 : (void *)b.u16,
                          n_samples(&b) * (size_t)(bits / 8));
      sv_bitmap_free(&b);
      sv_bitmap_free(&r);
    }
}

// A 2-bit palette image with one transparent entry, and 1-bit grey: written by libpng directly.
static void write_small(int type, int bits) {
  FILE *f = fopen(at("small.png"), "wb");
  png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, NULL, NULL, NULL);
  png_infop info = png_create_info_struct(png);
  png_init_io(png, f);
  png_set_IHDR(png, info, 4, 1, bits, type, PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT,
               PNG_FILTER_TYPE_DEFAULT);
  png_color colours[4] = {{0, 0, 0}, {255, 0, 0}, {0, 255, 0}, {1, 2, 3}};
  png_byte alpha[2] = {255, 7}, row[1] = {bits == 2 ? 0x1B : 0x50}; // 0 1 2 3, or 0 1 0 1
  if (type == PNG_COLOR_TYPE_PALETTE) {
    png_set_PLTE(png, info, colours, 4);
    png_set_tRNS(png, info, alpha, 2, NULL);
  }
  png_write_info(png, info);
  png_write_row(png, row);
  png_write_end(png, info);
  png_destroy_write_struct(&png, &info);
  fclose(f);
}

TEST(test_png_small_depths) {
  sv_bitmap r;
  write_small(PNG_COLOR_TYPE_PALETTE, 2);
  assert_int_equal(sv_bitmap_read(path, &r, &fail), SV_OK);
  static const uint8_t want[16] = {0, 0, 0, 255, 255, 0, 0, 7, 0, 255, 0, 255, 1, 2, 3, 255};
  assert_true(r.n_channels == 4 && r.bits == 8);
  assert_memory_equal(r.u8, want, 16);
  sv_bitmap_free(&r);
  write_small(PNG_COLOR_TYPE_GRAY, 1);
  assert_int_equal(sv_bitmap_read(path, &r, &fail), SV_OK);
  assert_true(r.n_channels == 1 && r.u8[0] == 0 && r.u8[1] == 255 && r.u8[3] == 255);
  sv_bitmap_free(&r);
}

TEST(test_jpeg) {
  for (int nc = 1; nc <= 3; nc += 2) {
    sv_bitmap b = make(64, 48, nc, 8), r;
    for (size_t i = 0; i < n_samples(&b); i++)
      b.u8[i] = (uint8_t)(i / (size_t)nc % 64 * 3 + 20 * (i % (size_t)nc));
    assert_int_equal(sv_bitmap_write_jpeg(at("a.jpg"), &b, 95, &fail), SV_OK);
    assert_int_equal(sv_bitmap_read(path, &r, &fail), SV_OK);
    assert_true(r.width_px == 64 && r.height_px == 48 && r.n_channels == nc && r.bits == 8);
    for (size_t i = 0; i < n_samples(&b); i++) assert_true(abs(r.u8[i] - b.u8[i]) < 12);
    sv_bitmap_free(&b);
    sv_bitmap_free(&r);
  }
}

TEST(test_conversions) {
  sv_bitmap b = make(3, 2, 4, 16);
  uint16_t first = b.u16[0];
  assert_int_equal(sv_bitmap_to_8(&b, &fail), SV_OK);
  assert_int_equal(b.u8[0], (int)floor(first / 257.0 + 0.5));
  uint8_t rgb[3] = {b.u8[4], b.u8[5], b.u8[6]};
  assert_int_equal(sv_bitmap_to_channels(&b, 3, &fail), SV_OK);
  assert_memory_equal(b.u8 + 3, rgb, 3);
  assert_int_equal(sv_bitmap_to_channels(&b, 4, &fail), SV_OK);
  assert_int_equal(b.u8[7], 255);
  assert_int_equal(sv_bitmap_to_channels(&b, 1, &fail), SV_OK);
  assert_true(abs(b.u8[1] - (int)(0.299 * rgb[0] + 0.587 * rgb[1] + 0.114 * rgb[2] + 0.5)) <= 1);
  assert_int_equal(sv_bitmap_to_channels(&b, 4, &fail), SV_OK);
  assert_true(b.u8[4] == b.u8[5] && b.u8[5] == b.u8[6] && b.u8[7] == 255);
  assert_int_equal(sv_bitmap_to_channels(&b, 2, &fail), SV_E_ARG);
  sv_bitmap_free(&b);
}

TEST(test_damaged) {
  for (int k = 0; k < 2; k++) {
    sv_bitmap b = make(19, 13, 3, 8), r;
    if (k) assert_int_equal(sv_bitmap_write_jpeg(at("d"), &b, 90, &fail), SV_OK);
    else assert_int_equal(sv_bitmap_write_png(at("d"), &b, &fail), SV_OK);
    sv_bitmap_free(&b);
    void *data;
    size_t n;
    assert_int_equal(sv_file_read(path, &data, &n, &fail), SV_OK);
    for (size_t cut = 0; cut < n;
         cut++) { // a JPEG without its last two bytes (the end mark) counts as cut, too
      uint8_t *copy = malloc(cut ? cut : 1);
      memcpy(copy, data, cut);
      assert_int_equal(sv_bitmap_decode("d", copy, cut, &r, &fail), SV_E_FORMAT);
      assert_true(!r.u8 && !r.u16);
      free(copy);
    }
    for (size_t i = 0; i < n; i += 3) { // damage may pass as picture, but never crash or leak
      ((uint8_t *)data)[i] ^= 0x41;
      (void)!sv_bitmap_decode("d", data, n, &r, &fail);
      sv_bitmap_free(&r);
      ((uint8_t *)data)[i] ^= 0x41;
    }
    free(data);
  }
  sv_bitmap r;
  assert_int_equal(sv_bitmap_decode("x.gif", "GIF89a", 6, &r, &fail), SV_E_FORMAT);
  assert_string_equal(fail.text, "x.gif: neither a PNG nor a JPEG");
  assert_int_equal(sv_bitmap_read(at("gone.png"), &r, &fail), SV_E_NOT_FOUND);
  assert_contains(fail.text, "gone.png");
}

TEST(test_files) {
  char text[64];
  void *data;
  size_t n;
  sv_names names;
  assert_int_equal(sv_path_make_folder(at("x/y"), &fail), SV_OK);
  assert_int_equal(sv_path_make_folder(at("x/y"), &fail), SV_OK);
  assert_int_equal(sv_file_write(at("x/y/b"), "two", 3, &fail), SV_OK);
  assert_int_equal(sv_file_write(at("x/y/b"), "other", 5, &fail), SV_OK);
  assert_int_equal(sv_file_write(at("x/y/a"), "", 0, &fail), SV_OK);
  assert_int_equal(sv_file_write(at("x/none/a"), "", 0, &fail), SV_E_NOT_FOUND);
  assert_int_equal(sv_path_make_folder(at("x/y/b"), &fail), SV_E_IO);
  assert_int_equal(sv_file_read(at("x/y/b"), &data, &n, &fail), SV_OK);
  assert_true(n == 5 && strcmp(data, "other") == 0);
  free(data);
  assert_int_equal(sv_file_read(at("x/y"), &data, &n, &fail), SV_E_FORMAT);
  sv_file f;
  assert_int_equal(sv_file_begin(&f, at("x/y/b"), &fail), SV_OK);
  assert_int_equal(sv_file_append(&f, "new", 3, &fail), SV_OK);
  sv_file_abandon(&f);
  at("x/y");
  assert_int_equal(sv_folder_read(path, "b", text, sizeof text, &n, &fail), SV_OK);
  assert_true(n == 5 && memcmp(text, "other", 5) == 0);
  assert_int_equal(sv_folder_read(path, "b", text, 4, &n, &fail), SV_E_NOMEM);
  assert_int_equal(sv_folder_list(path, &names, &fail), SV_OK);
  assert_int_equal(names.n, 2);
  assert_string_equal(names.names[0], "a");
  assert_string_equal(names.names[1], "b");
  sv_names_free(&names);
  assert_int_equal(sv_path_join(text, 4, "ab", "cd", &fail), SV_E_RANGE);
  assert_int_equal(sv_path_join(text, sizeof text, "ab", "/cd", &fail), SV_OK);
  assert_string_equal(text, "/cd");
  sv_path_folder(text, sizeof text, "/a");
  assert_string_equal(text, "/");
  sv_path_folder(text, sizeof text, "a");
  assert_string_equal(text, ".");
  sv_path_folder(text, sizeof text, "a/b/c.d");
  assert_string_equal(text, "a/b");
  assert_string_equal(sv_path_extension("a.b/c"), "");
  assert_string_equal(sv_path_extension("a/.hidden"), "");
  assert_string_equal(sv_path_extension("a/b.tar.gz"), ".gz");
}

FIXTURE(make_folder) { return mkdtemp(folder) ? 0 : -1; }

FIXTURE(remove_folder) {
  static const char *const made[] = {"a.png", "small.png", "a.jpg", "d", "x/y/a", "x/y/b", "x/y", "x", "."};
  for (size_t i = 0; i < sizeof made / sizeof *made; i++)
    if (remove(i + 1 < sizeof made / sizeof *made ? at(made[i]) : folder) != 0) return -1;
  return 0;
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_png_round_trip), cmocka_unit_test(test_png_small_depths),
      cmocka_unit_test(test_jpeg),           cmocka_unit_test(test_conversions),
      cmocka_unit_test(test_damaged),        cmocka_unit_test(test_files)};
  return cmocka_run_group_tests(tests, make_folder, remove_folder);
}
