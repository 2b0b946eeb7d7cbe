// SPDX-License-Identifier: Apache-2.0
// JPEG and PNG over a fixed block: right pixels, no heap call, and no damaged file does harm.
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

// jpeglib.h needs stdio.h before it.
#include <jpeglib.h>
#include <png.h>

#include "platform/codec/codec.h"
#include "src/base/rng.h"
#include "tests/common/test.h"
#include "tests/fault/heap_count.h"

static uint8_t g_file[4 << 20], g_rgb[1920 * 1080 * 3], g_back[1920 * 1080 * 8];

typedef struct {
  sv_codec codec;
  void *block;
} bench_t;

static void bench_open(bench_t *b, int w, int h, bool has_progressive) {
  sv_codec_cfg cfg = {w, h, has_progressive};
  size_t bytes = sv_codec_bytes(&cfg);
  assert_true(bytes > 0);
  b->block = aligned_alloc(64, bytes);
  sv_arena a = sv_arena_make(b->block, bytes);
  assert_int_equal(sv_codec_init(&b->codec, &cfg, &a), SV_OK);
  assert_int_equal(a.used_bytes, bytes);
}

static void bench_close(bench_t *b) {
  sv_codec_close(&b->codec);
  free(b->block);
}

static sv_picture picture(uint8_t *data, int w, int h, sv_pixel_format f) {
  int n = f == SV_PIX_GREY8 ? 1 : f == SV_PIX_RGB8 ? 3 : f == SV_PIX_RGBA8 ? 4 : 6;
  return (sv_picture){w, h, (size_t)w * (size_t)n, f, data};
}

static void paint(uint8_t *rgb, int w, int h) { // smooth, so that JPEG keeps it
  for (int y = 0; y < h; y++)
    for (int x = 0; x < w; x++) {
      uint8_t *p = rgb + (size_t)(y * w + x) * 3;
      p[0] = (uint8_t)(255 * x / w);
      p[1] = (uint8_t)(255 * y / h);
      p[2] = (uint8_t)(128 + 100 * ((x / 32 + y / 32) & 1));
    }
}

static double mean_error(const uint8_t *a, const uint8_t *b, size_t n) {
  double sum = 0;
  for (size_t i = 0; i < n; i++) sum += a[i] > b[i] ? a[i] - b[i] : b[i] - a[i];
  return sum / (double)n;
}

// A JPEG in forms that our encoder does not write.
static size_t libjpeg_file(int w, int h, bool is_progressive, J_COLOR_SPACE space) {
  struct jpeg_compress_struct c;
  struct jpeg_error_mgr e;
  unsigned char *out = NULL;
  unsigned long n = 0;
  c.err = jpeg_std_error(&e);
  jpeg_create_compress(&c);
  jpeg_mem_dest(&c, &out, &n);
  c.image_width = (JDIMENSION)w;
  c.image_height = (JDIMENSION)h;
  c.input_components = 3;
  c.in_color_space = JCS_RGB;
  jpeg_set_defaults(&c);
  jpeg_set_colorspace(&c, space);
  jpeg_set_quality(&c, 95, TRUE);
  if (is_progressive) jpeg_simple_progression(&c);
  jpeg_start_compress(&c, TRUE);
  while (c.next_scanline < c.image_height) {
    JSAMPROW row = g_rgb + (size_t)c.next_scanline * (size_t)w * 3;
    jpeg_write_scanlines(&c, &row, 1);
  }
  jpeg_finish_compress(&c);
  jpeg_destroy_compress(&c);
  memcpy(g_file, out, n);
  free(out);
  return n;
}

TEST(jpeg_round_trip) {
  static const int sizes[][2] = {{1, 1}, {7, 5}, {64, 48}, {641, 361}, {1920, 1080}};
  for (int i = 0; i < 5; i++)
    for (int full = 0; full < 2; full++) {
      int w = sizes[i][0], h = sizes[i][1];
      bench_t b;
      bench_open(&b, w, h, false);
      paint(g_rgb, w, h);
      sv_picture in = picture(g_rgb, w, h, SV_PIX_RGB8), out = picture(g_back, w, h, SV_PIX_RGB8);
      size_t n;
      sv_err err;
      assert_int_equal(sv_codec_encode_jpeg(&b.codec, &in, (sv_jpeg_options){95, full},
                                            (sv_codec_buffer){g_file, sizeof g_file}, &n, &err),
                       SV_OK);
      size_t enc_high = b.codec.high_bytes;
      memset(g_back, 0, sizeof g_back);
      assert_int_equal(sv_codec_decode(&b.codec, g_file, n, &out, &err), SV_OK);
      assert_true(mean_error(g_rgb, g_back, (size_t)w * (size_t)h * 3) < (i < 2 ? 30 : full ? 2 : 3));
      sv_codec_info info;
      assert_int_equal(sv_codec_probe(g_file, n, &info, &err), SV_OK);
      assert_true(info.width_px == w && info.height_px == h && info.format == SV_PIX_JPEG &&
                  info.n_channels == 3);
      if (i > 2)
        print_message("%dx%d: %zu bytes, block encoding %zu, decoding %zu of %zu\n", w, h, n, enc_high,
                      b.codec.high_bytes, b.codec.block_bytes);
      assert_int_equal(sv_codec_encode_jpeg(&b.codec, &in, (sv_jpeg_options){95, full},
                                            (sv_codec_buffer){g_file, n - 1}, &n, &err),
                       SV_E_FULL);
      bench_close(&b);
    }
}

TEST(jpeg_same_as_libjpeg) {
  paint(g_rgb, 200, 100);
  static const J_COLOR_SPACE spaces[] = {JCS_YCbCr, JCS_RGB, JCS_GRAYSCALE};
  for (int i = 0; i < 6; i++) {
    size_t n = libjpeg_file(200, 100, i & 1, spaces[i / 2]);
    bench_t b;
    bench_open(&b, 200, 100, true);
    sv_picture out = picture(g_back, 200, 100, SV_PIX_RGB8);
    sv_err err;
    assert_int_equal(sv_codec_decode_jpeg(&b.codec, g_file, n, &out, &err), SV_OK);
    static uint8_t want[200 * 100 * 3];
    struct jpeg_decompress_struct d;
    struct jpeg_error_mgr e;
    d.err = jpeg_std_error(&e);
    jpeg_create_decompress(&d);
    jpeg_mem_src(&d, g_file, n);
    jpeg_read_header(&d, TRUE);
    d.out_color_space = JCS_RGB;
    jpeg_start_decompress(&d);
    while (d.output_scanline < 100) {
      JSAMPROW row = want + d.output_scanline * 600;
      jpeg_read_scanlines(&d, &row, 1);
    }
    jpeg_destroy_decompress(&d);
    assert_memory_equal(want, g_back, sizeof want);
    bench_close(&b);
    if (i & 1) {
      bench_open(&b, 200, 100, false);
      assert_int_equal(sv_codec_decode_jpeg(&b.codec, g_file, n, &out, &err), SV_E_UNSUPPORTED);
      bench_close(&b);
    }
  }
}

TEST(sizes_must_agree) {
  bench_t b;
  bench_open(&b, 100, 100, false);
  paint(g_rgb, 64, 48);
  sv_picture in = picture(g_rgb, 64, 48, SV_PIX_RGB8), out = picture(g_back, 64, 40, SV_PIX_RGB8);
  size_t n;
  sv_err err;
  assert_int_equal(sv_codec_encode_jpeg(&b.codec, &in, (sv_jpeg_options){90, false},
                                        (sv_codec_buffer){g_file, sizeof g_file}, &n, &err),
                   SV_OK);
  assert_int_equal(sv_codec_decode(&b.codec, g_file, n, &out, &err), SV_E_RANGE);
  assert_contains(err.text, "64x48");
  out.width_px = 200;
  assert_int_equal(sv_codec_decode(&b.codec, g_file, n, &out, &err), SV_E_RANGE);
  in.width_px = 101;
  assert_int_equal(sv_codec_encode_jpeg(&b.codec, &in, (sv_jpeg_options){90, false},
                                        (sv_codec_buffer){g_file, sizeof g_file}, &n, &err),
                   SV_E_RANGE);
  assert_int_equal(sv_codec_decode(&b.codec, (const uint8_t *)"hello", 5, &out, &err), SV_E_RANGE);
  assert_int_equal(sv_codec_decode(&b.codec, g_file, 0, &in, &err), SV_E_RANGE);
  bench_close(&b);
  sv_codec_cfg zero = {0, 5, false};
  assert_int_equal(sv_codec_bytes(&zero), 0);
}

static size_t png_file(const void *data, int w, int h, uint32_t format) {
  png_image im;
  memset(&im, 0, sizeof im);
  im.version = PNG_IMAGE_VERSION;
  im.width = (uint32_t)w;
  im.height = (uint32_t)h;
  im.format = format;
  png_alloc_size_t n = sizeof g_file;
  assert_true(png_image_write_to_memory(&im, g_file, &n, 0, data, 0, NULL));
  return n;
}

TEST(png_forms) {
  bench_t b;
  bench_open(&b, 64, 48, false);
  paint(g_rgb, 64, 48);
  sv_err err;
  size_t n = png_file(g_rgb, 64, 48, PNG_FORMAT_RGB);
  sv_picture out = picture(g_back, 64, 48, SV_PIX_RGB8);
  assert_int_equal(sv_codec_decode(&b.codec, g_file, n, &out, &err), SV_OK);
  assert_memory_equal(g_rgb, g_back, 64 * 48 * 3);
  sv_codec_info info;
  assert_int_equal(sv_codec_probe(g_file, n, &info, &err), SV_OK);
  assert_true(info.width_px == 64 && info.height_px == 48 && info.n_channels == 3 && info.bits == 8);
  out = picture(g_back, 64, 48, SV_PIX_RGBA8);
  assert_int_equal(sv_codec_decode(&b.codec, g_file, n, &out, &err), SV_OK);
  assert_true(g_back[3] == 255 && g_back[4] == g_rgb[3]);
  out = picture(g_back, 64, 48, SV_PIX_GREY8);
  assert_int_equal(sv_codec_decode(&b.codec, g_file, n, &out, &err), SV_OK);
  static uint8_t rgba[64 * 48 * 4];
  for (int i = 0; i < 64 * 48 * 4; i++) rgba[i] = (uint8_t)(i * 7);
  n = png_file(rgba, 64, 48, PNG_FORMAT_RGBA);
  out = picture(g_back, 64, 48, SV_PIX_RGBA8);
  assert_int_equal(sv_codec_decode(&b.codec, g_file, n, &out, &err), SV_OK);
  assert_memory_equal(rgba, g_back, sizeof rgba);
  out = picture(g_back, 64, 48, SV_PIX_RGB8);
  assert_int_equal(sv_codec_decode(&b.codec, g_file, n, &out, &err), SV_OK);
  assert_true(g_back[3] == rgba[4] && g_back[5] == rgba[6]);
  out = picture(g_back, 64, 48, SV_PIX_GREY8 + 100);
  assert_int_equal(sv_codec_decode_png(&b.codec, g_file, n, &out, &err), SV_E_ARG);
  bench_close(&b);
}

// A 16-bit grey depth map, interlaced, written with the full interface of libpng.
static void mem_write(png_structp png, png_bytep p, size_t n) {
  size_t *len = png_get_io_ptr(png);
  memcpy(g_file + *len, p, n);
  *len += n;
}
static void mem_flush(png_structp png) { (void)png; }

TEST(png_depth_interlaced) {
  size_t n = 0;
  static uint8_t row[40 * 2];
  png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, NULL, NULL, NULL);
  png_infop info = png_create_info_struct(png);
  png_set_write_fn(png, &n, mem_write, mem_flush);
  png_set_IHDR(png, info, 40, 30, 16, PNG_COLOR_TYPE_GRAY, PNG_INTERLACE_ADAM7, 0, 0);
  png_write_info(png, info);
  int n_passes = png_set_interlace_handling(png);
  for (int p = 0; p < n_passes; p++)
    for (int y = 0; y < 30; y++) {
      for (int x = 0; x < 40; x++) {
        row[2 * x] = (uint8_t)((y * 1000 + x) >> 8);
        row[2 * x + 1] = (uint8_t)(y * 1000 + x);
      }
      png_write_row(png, row);
    }
  png_write_end(png, info);
  png_destroy_write_struct(&png, &info);
  bench_t b;
  bench_open(&b, 40, 30, true);
  sv_picture out = picture(g_back, 40, 30, SV_PIX_RGB16);
  sv_err err;
  assert_int_equal(sv_codec_decode(&b.codec, g_file, n, &out, &err), SV_OK);
  for (int y = 0; y < 30; y++)
    for (int x = 0; x < 40; x++) {
      uint16_t v[3];
      memcpy(v, g_back + (y * 40 + x) * 6, 6);
      assert_true(v[0] == y * 1000 + x && v[1] == v[0] && v[2] == v[0]);
    }
  bench_close(&b);
}

// All three forms come back bit for bit, within the size that is promised, without heap; libpng's
// own reader agrees.
TEST(png_round_trips) {
  static const sv_pixel_format forms[] = {SV_PIX_GREY8, SV_PIX_RGB8, SV_PIX_RGB16};
  static const int sizes[][2] = {{1, 1}, {33, 17}, {640, 48}};
  static uint8_t file[1 << 20];
  sv_rng r = sv_rng_make(11, 1);
  for (size_t i = 0; i < 9; i++) {
    int w = sizes[i / 3][0], h = sizes[i / 3][1];
    bench_t b;
    sv_err err;
    bench_open(&b, w, h, false);
    sv_picture in = picture(g_rgb, w, h, forms[i % 3]), out = picture(g_back, w, h, forms[i % 3]);
    size_t n = in.stride_bytes * (size_t)h, bytes = 0, cap = sv_codec_png_cap(w, h, in.format);
    for (size_t k = 0; k < n; k++) g_rgb[k] = (uint8_t)sv_rng_u32(&r); // cannot be compressed
    memset(g_back, 0, n);
    assert_true(cap <= sizeof file);
    sv_heap_arm();
    sv_status s = sv_codec_encode_png(&b.codec, &in, file, cap, &bytes, &err);
    sv_heap_disarm();
    if (s < 0) fail_msg("%s", err.text);
    assert_int_equal(sv_heap_count(), 0);
    print_message("PNG %dx%d: %zu of %zu bytes, %zu of a block of %zu\n", w, h, bytes, cap,
                  b.codec.high_bytes, b.codec.block_bytes);
    assert_int_equal(sv_codec_decode(&b.codec, file, bytes, &out, &err), SV_OK);
    assert_memory_equal(g_back, g_rgb, n);
    png_image own = {.version = PNG_IMAGE_VERSION};
    assert_true(png_image_begin_read_from_memory(&own, file, bytes));
    assert_int_equal(own.width, w);
    assert_true(!!(own.format & PNG_FORMAT_FLAG_LINEAR) == (in.format == SV_PIX_RGB16));
    png_image_free(&own);
    assert_int_equal(sv_codec_encode_png(&b.codec, &in, file, bytes - 1, &bytes, &err), SV_E_FULL);
    in.width_px++;
    assert_int_equal(sv_codec_encode_png(&b.codec, &in, file, cap, &bytes, &err), SV_E_RANGE);
    in.width_px--;
    in.format = SV_PIX_JPEG;
    assert_int_equal(sv_codec_encode_png(&b.codec, &in, file, cap, &bytes, &err), SV_E_ARG);
    bench_close(&b);
  }
}

// Every cut and many flips of both kinds of file: some status, no crash, and the next good one is
// fine.
TEST(damaged_files) {
  bench_t b;
  sv_err err;
  static uint8_t good[65536], bad[65536];
  for (int kind = 0; kind < 3; kind++) {
    bench_open(&b, 64, 48, kind == 2);
    paint(g_rgb, 64, 48);
    size_t n =
        kind == 1 ? png_file(g_rgb, 64, 48, PNG_FORMAT_RGB) : libjpeg_file(64, 48, kind == 2, JCS_YCbCr);
    memcpy(good, g_file, n);
    sv_picture out = picture(g_back, 64, 48, SV_PIX_RGB8);
    int n_ok = 0;
    for (size_t cut = 0; cut < n; cut++) {
      uint8_t *exact = malloc(cut ? cut : 1); // so that ASan sees a read past the end
      memcpy(exact, good, cut);
      n_ok += sv_codec_decode(&b.codec, exact, cut, &out, &err) == SV_OK;
      sv_codec_info info;
      sv_status s = sv_codec_probe(exact, cut, &info, &err);
      assert_true(s == SV_OK || s == SV_E_FORMAT);
      free(exact);
    }
    assert_true(n_ok <= 2); // only the end marker may be missing
    sv_rng r = sv_rng_make(5, (uint64_t)kind);
    for (int i = 0; i < 4000; i++) {
      memcpy(bad, good, n);
      for (int k = 0; k <= i % 4; k++)
        bad[sv_rng_below(&r, (uint32_t)n)] ^= (uint8_t)(1 << sv_rng_below(&r, 8));
      sv_status s = sv_codec_decode(&b.codec, bad, n, &out, &err);
      assert_true(s <= 0);
      sv_codec_info info;
      s = sv_codec_probe(bad, n, &info, &err);
      assert_true(s <= 0);
    }
    assert_int_equal(sv_codec_decode(&b.codec, good, n, &out, &err), SV_OK);
    bench_close(&b);
  }
}

// A file without its own tables must not decode with those of the file before.
TEST(no_tables_from_the_file_before) {
  bench_t b;
  sv_err err;
  bench_open(&b, 64, 48, false);
  paint(g_rgb, 64, 48);
  size_t n = libjpeg_file(64, 48, false, JCS_YCbCr);
  sv_picture out = picture(g_back, 64, 48, SV_PIX_RGB8);
  assert_int_equal(sv_codec_decode(&b.codec, g_file, n, &out, &err), SV_OK);
  for (size_t i = 0; i + 1 < n; i++)
    if (g_file[i] == 0xff && g_file[i + 1] == 0xdb) g_file[i + 1] = 0xfe; // tables become comments
  assert_int_equal(sv_codec_decode(&b.codec, g_file, n, &out, &err), SV_E_FORMAT);
  bench_close(&b);
}

TEST(webcam_padding_is_no_damage) {
  bench_t b;
  sv_err err;
  bench_open(&b, 64, 48, false);
  paint(g_rgb, 64, 48);
  size_t n = libjpeg_file(64, 48, false, JCS_YCbCr);
  memmove(g_file + n - 2 + 5, g_file + n - 2, 2);
  memset(g_file + n - 2, 0, 5);
  sv_picture out = picture(g_back, 64, 48, SV_PIX_RGB8);
  assert_int_equal(sv_codec_decode(&b.codec, g_file, n + 5, &out, &err), SV_OK);
  bench_close(&b);
}

TEST(no_heap_call_a_frame) {
  bench_t b;
  sv_err err;
  bench_open(&b, 320, 240, true);
  paint(g_rgb, 320, 240);
  static uint8_t jpeg[200000], prog[200000], png[400000];
  size_t n_prog = libjpeg_file(320, 240, true, JCS_YCbCr), n_png, n_jpeg;
  memcpy(prog, g_file, n_prog);
  n_png = png_file(g_rgb, 320, 240, PNG_FORMAT_RGB);
  memcpy(png, g_file, n_png);
  sv_picture in = picture(g_rgb, 320, 240, SV_PIX_RGB8), out = picture(g_back, 320, 240, SV_PIX_RGB8);
  sv_heap_arm();
  for (int i = 0; i < 20; i++) {
    assert_int_equal(sv_codec_encode_jpeg(&b.codec, &in, (sv_jpeg_options){90, i & 1},
                                          (sv_codec_buffer){jpeg, sizeof jpeg}, &n_jpeg, &err),
                     SV_OK);
    assert_int_equal(sv_codec_decode(&b.codec, jpeg, n_jpeg, &out, &err), SV_OK);
    assert_int_equal(sv_codec_decode(&b.codec, prog, n_prog, &out, &err), SV_OK);
    assert_int_equal(sv_codec_decode(&b.codec, png, n_png, &out, &err), SV_OK);
    assert_true(sv_codec_decode(&b.codec, jpeg, n_jpeg / 2, &out, &err) < 0);
    assert_true(sv_codec_decode(&b.codec, png, n_png / 2, &out, &err) < 0);
  }
  sv_heap_disarm();
  sv_heap_report();
  assert_int_equal(sv_heap_count(), 0);
  bench_close(&b);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(jpeg_round_trip),
      cmocka_unit_test(jpeg_same_as_libjpeg),
      cmocka_unit_test(sizes_must_agree),
      cmocka_unit_test(png_forms),
      cmocka_unit_test(png_depth_interlaced),
      cmocka_unit_test(png_round_trips),
      cmocka_unit_test(damaged_files),
      cmocka_unit_test(no_tables_from_the_file_before),
      cmocka_unit_test(webcam_padding_is_no_damage),
      cmocka_unit_test(no_heap_call_a_frame),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
