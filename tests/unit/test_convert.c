// SPDX-License-Identifier: Apache-2.0
// Camera frames to RGB8: each format of the list from one known picture, tones of raw sensors,
// tiles of compressed pictures, and what is refused.
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "platform/camera/options.h"
#include "platform/camera/tiled.h"
#include "platform/codec/codec.h"
#include "src/base/rng.h"
#include "src/image/convert.h"
#include "tests/common/test.h"

#define W 48
#define H 32

static uint8_t block[4 << 20], codec_block[2 << 20], px[W * H * 8];
static sv_arena arena;
static sv_kernels k;
static sv_codec codec;
static int n_decoded;

FIXTURE(setup) {
  arena = sv_arena_make(block, sizeof block);
  sv_kernels_init(&k, ~0u);
  n_decoded = 0;
  return 0;
}

// A flat colour, so that every format must give it back: in RGB, Y'CbCr (601, limited) and a Bayer
// pattern.
static const uint8_t colour[3] = {180, 90, 40};

static void put_sample(sv_pixel_format f, int x, int y, unsigned v8) {
  const sv_pixel_info *p = sv_pixel(f);
  size_t stride = sv_pixel_row_bytes(f, W);
  uint8_t *row = px + (size_t)y * stride;
  unsigned max = (1u << p->bits) - 1, v = (v8 * max + 127) / 255;
  switch (p->container_bits) {
  case 8: row[x] = (uint8_t)v; break;
  case 16:
    row[2 * x] = (uint8_t)v;
    row[2 * x + 1] = (uint8_t)(v >> 8);
    break;
  case 10:
    row[x / 4 * 5 + x % 4] = (uint8_t)(v >> 2);
    row[x / 4 * 5 + 4] |= (uint8_t)((v & 3) << x % 4 * 2);
    break;
  default: row[x / 2 * 3 + x % 2] = (uint8_t)(v >> 4); row[x / 2 * 3 + 2] |= (uint8_t)((v & 15) << x % 2 * 4);
  }
}

static void put_yuv(sv_pixel_format f) {
  double r = colour[0] / 255.0, g = colour[1] / 255.0, b = colour[2] / 255.0;
  double l = 0.299 * r + 0.587 * g + 0.114 * b;
  uint8_t y = (uint8_t)(16 + 219 * l + 0.5), u = (uint8_t)(128 + 224 * (b - l) / 1.772 + 0.5),
          v = (uint8_t)(128 + 224 * (r - l) / 1.402 + 0.5);
  if (f == SV_PIX_NV12) {
    memset(px, y, W * H);
    for (int i = 0; i < W * H / 2; i += 2) {
      px[W * H + i] = u;
      px[W * H + i + 1] = v;
    }
    return;
  }
  const uint8_t quad[2][4] = {{y, u, y, v}, {u, y, v, y}};
  for (int i = 0; i < W * H * 2; i++) px[i] = quad[f == SV_PIX_UYVY][i % 4];
}

static void put_picture(sv_pixel_format f) {
  const sv_pixel_info *p = sv_pixel(f);
  static const uint8_t order[2][3] = {{0, 1, 2}, {2, 1, 0}};
  memset(px, 0, sizeof px);
  if (p->layout == SV_LAYOUT_YUYV || p->layout == SV_LAYOUT_UYVY || p->layout == SV_LAYOUT_NV12) {
    put_yuv(f);
    return;
  }
  int is_bgr = p->layout == SV_LAYOUT_BGR || p->layout == SV_LAYOUT_BGRX;
  int n = p->layout == SV_LAYOUT_RGBX || p->layout == SV_LAYOUT_BGRX ? 4 : 3;
  for (int y = 0; y < H; y++)
    for (int x = 0; x < W; x++) {
      int place = (x & 1) + 2 * (y & 1);
      if (p->layout == SV_LAYOUT_GREY) put_sample(f, x, y, 77);
      else if (p->layout == SV_LAYOUT_BAYER)
        put_sample(f, x, y, colour[place == p->phase ? 0 : place == (p->phase ^ 3) ? 2 : 1]);
      else
        for (int c = 0; c < 3; c++) px[(y * W + x) * n + c] = colour[order[is_bgr][c]];
    }
}

static sv_frame frame_of(sv_pixel_format f) {
  return (sv_frame){.width_px = W,
                    .height_px = H,
                    .stride_bytes = (int)sv_pixel_row_bytes(f, W),
                    .format = f,
                    .data = px,
                    .data_bytes = sv_pixel_frame_bytes(f, W, H)};
}

TEST(every_format_gives_the_picture) {
  int n = 0;
  for (int f = 0; f < SV_N_PIXEL_FORMATS; f++) {
    const sv_pixel_info *p = sv_pixel((sv_pixel_format)f);
    if (!sv_convert_knows((sv_pixel_format)f) || p->layout == SV_LAYOUT_CODED) continue;
    sv_camera_caps caps = {.name = "c", .width_px = W, .height_px = H, .format = (sv_pixel_format)f};
    sv_convert_cfg cfg = {&caps, 1, 1, NULL};
    sv_convert c;
    sv_err err;
    sv_image_u8 out;
    sv_pool pool = sv_pool_serial();
    setup(NULL);
    assert_ok(sv_convert_init(&c, &cfg, &arena, &err), &err);
    put_picture((sv_pixel_format)f);
    sv_frame fr = frame_of((sv_pixel_format)f);
    if (sv_convert_frame(&c, &fr, &k, &pool, &out, &err) < 0) fail_msg("%s: %s", p->name, err.text);
    if (f == SV_PIX_RGB8) assert_ptr_equal(out.px, px); // not copied
    for (int i = 0; i < W * H; i++)
      for (int ch = 0; ch < 3; ch++) {
        int got = out.px[i / W * out.stride_bytes + i % W * 3 + ch];
        int want = p->layout == SV_LAYOUT_GREY ? 77 : colour[ch];
        int tolerance =
            p->layout == SV_LAYOUT_YUYV || p->layout == SV_LAYOUT_UYVY || p->layout == SV_LAYOUT_NV12;
        if (abs(got - want) > 2 * tolerance)
          fail_msg("%s: pixel %d channel %d is %d, expected %d", p->name, i, ch, got, want);
      }
    n++;
  }
  assert_int_equal(n, 37);
}

TEST(tones_of_raw_sensors) {
  sv_raw_tone t = {.black = 64, .gain_r = 2, .is_linear = true};
  assert_int_equal(sv_raw_tone_value(&t, 1, 10, 64), 0);
  assert_int_equal(sv_raw_tone_value(&t, 1, 10, 0), 0);
  assert_int_equal(sv_raw_tone_value(&t, 1, 10, 1023), 255);
  assert_int_equal(sv_raw_tone_value(&t, 2, 10, 1000), 255);
  double v = 300.0 / (1023 - 64), s = 1.055 * pow(v, 1 / 2.4) - 0.055; // the standard's formula
  assert_int_equal(sv_raw_tone_value(&t, 1, 10, 364), (int)(255 * s + 0.5));
  // Through the whole: black and the red gain act on the red places only.
  sv_camera_caps caps = {
      .name = "c", .width_px = W, .height_px = H, .format = SV_PIX_RGGB10, .tone = {64, 2, 1, false}};
  sv_convert_cfg cfg = {&caps, 1, 1, NULL};
  sv_convert c;
  sv_image_u8 out;
  sv_pool pool = sv_pool_serial();
  assert_int_equal(sv_convert_init(&c, &cfg, &arena, NULL), SV_OK);
  for (int i = 0; i < W * H; i++) {
    px[2 * i] = 364 & 255;
    px[2 * i + 1] = 364 >> 8;
  }
  sv_frame fr = frame_of(SV_PIX_RGGB10);
  assert_int_equal(sv_convert_frame(&c, &fr, &k, &pool, &out, NULL), SV_OK);
  assert_int_equal(out.px[out.stride_bytes * 10 + 30], (int)(255 * 600.0 / 959 + 0.5));
  assert_int_equal(out.px[out.stride_bytes * 10 + 31], (int)(255 * 300.0 / 959 + 0.5));
  sv_camera_options o = sv_camera_defaults();
  assert_true(sv_camera_tone(&o, SV_PIX_RGGB10).is_linear);
  assert_false(sv_camera_tone(&o, SV_PIX_GREY10).is_linear);
}

static double linear_of(double v) { return v <= 0.04045 ? v / 12.92 : pow((v + 0.055) / 1.055, 2.4); }

// Every format of more than 8 bits gives the colour in 16 bits of linear light, and its display
// values in 8.
TEST(deep_formats_give_the_light) {
  int n = 0;
  for (int f = 0; f < SV_N_PIXEL_FORMATS; f++) {
    const sv_pixel_info *p = sv_pixel((sv_pixel_format)f);
    sv_camera_caps caps = {.name = "c",
                           .width_px = W,
                           .height_px = H,
                           .format = (sv_pixel_format)f,
                           .tone = {.is_linear = true}};
    sv_pool pool = sv_pool_serial();
    sv_convert_cfg cfg = {&caps, 1, 1, NULL, true};
    sv_convert c;
    sv_err err;
    sv_image_u8 out;
    setup(NULL);
    if (!sv_deep_knows(&caps)) {
      assert_int_equal(sv_convert_init(&c, &cfg, &arena, &err), SV_E_UNSUPPORTED);
      continue;
    }
    assert_ok(sv_convert_init(&c, &cfg, &arena, &err), &err);
    put_picture((sv_pixel_format)f);
    for (int i = 0; i < 3 * W * H && f == SV_PIX_RGB16; i++) {
      px[2 * i] = (uint8_t)(257 * colour[i % 3] & 255);
      px[2 * i + 1] = colour[i % 3];
    }
    const sv_frame fr = frame_of((sv_pixel_format)f);
    assert_ok(sv_convert_deep(&c, &fr, 0.5f, &(sv_compute){&k, &pool}, &out, &err), &err);
    static uint8_t again[6 * W * H];
    sv_deep_encode(c.deep.linear, W, H, again, c.deep.scratch, &k);
    for (int i = 0; i < 3 * W * H && f == SV_PIX_RGB16; i++) {
      const int was = px[2 * i] | px[2 * i + 1] << 8, is = again[2 * i] | again[2 * i + 1] << 8;
      assert_true(abs(was - is) < 5);
    }
    for (int i = 0; i < 3 * W * H; i++) {
      const int ch = i / (W * H), at = i % (W * H), v8 = p->layout == SV_LAYOUT_GREY ? 77 : colour[ch];
      const double want = f == SV_PIX_RGB16 ? linear_of(v8 / 255.0) : v8 / 255.0;
      const double got = c.deep.linear[i] / 65535.0,
                   shown = out.px[at / W * out.stride_bytes + at % W * 3 + ch];
      if (fabs(got - want) > 1e-3) fail_msg("%s: value %d is %g, expected %g", p->name, i, got, want);
      assert_true(fabs(linear_of(shown / 255) - 0.5 * got) < 5e-3);
    }
    n++;
  }
  assert_int_equal(n, 26);
}

// Each value is the mean of the light of the pixels that it covers, by the part covered.
TEST(deep_pictures_are_made_smaller) {
  static uint16_t from[3 * 40 * 30], to[3 * 40 * 30];
  static const int sizes[][2] = {{20, 15}, {13, 10}, {40, 30}, {39, 7}, {1, 1}};
  uint32_t sums[40];
  sv_rng rng = sv_rng_make(3, 0);
  for (int i = 0; i < 3 * 40 * 30; i++) from[i] = i < 40 ? 65535 : (uint16_t)sv_rng_below(&rng, 65536);
  for (size_t n = 0; n < sizeof sizes / sizeof *sizes; n++) {
    const int w = sizes[n][0], h = sizes[n][1];
    sv_deep_reduction r = {.src = from,
                           .src_plane = 40 * 30,
                           .src_stride = 40,
                           .src_width_px = 40,
                           .src_height_px = 30,
                           .dst = to,
                           .dst_width_px = w,
                           .dst_height_px = h,
                           .row1 = h / 2,
                           .scratch = sums};
    sv_deep_reduce(&r); // in two parts
    r.row0 = h / 2;
    r.row1 = h;
    sv_deep_reduce(&r);
    for (int i = 0; i < 3 * w * h; i++) {
      const double x0 = 40.0 * (i % w) / w, y0 = 30.0 * (i / w % h) / h, x1 = x0 + 40.0 / w,
                   y1 = y0 + 30.0 / h;
      double sum = 0;
      for (int y = (int)y0; y < y1 && y < 30; y++)
        for (int x = (int)x0; x < x1 && x < 40; x++)
          sum += fmax(fmin(x1, x + 1) - fmax(x0, x), 0) * fmax(fmin(y1, y + 1) - fmax(y0, y), 0) *
                 from[i / (w * h) * 1200 + y * 40 + x];
      assert_true(fabs(to[i] - sum / ((x1 - x0) * (y1 - y0))) < 0.51);
    }
  }
}

TEST(deep_tones) {
  sv_camera_caps caps = {
      .name = "c", .width_px = W, .height_px = H, .format = SV_PIX_RGGB10, .tone = {64, 2, 1, true}};
  sv_convert_cfg cfg = {&caps, 1, 1, NULL, true};
  sv_convert c;
  sv_image_u8 out;
  sv_pool pool = sv_pool_serial();
  assert_int_equal(sv_convert_init(&c, &cfg, &arena, NULL), SV_OK);
  for (int i = 0; i < W * H; i++) {
    px[2 * i] = 364 & 255;
    px[2 * i + 1] = 364 >> 8;
  }
  const sv_frame fr = frame_of(SV_PIX_RGGB10);
  assert_int_equal(sv_convert_deep(&c, &fr, 1, &(sv_compute){&k, &pool}, &out, NULL), SV_OK);
  for (int ch = 0; ch < 3; ch++)
    assert_true(abs(c.deep.linear[ch * W * H + 10 * W + 10] - (int)(65535 * (ch ? 300.0 : 600.0) / 959)) < 3);
  caps.tone.is_linear = false; // display values
  assert_int_equal(sv_convert_init(&c, &cfg, &arena, NULL), SV_E_UNSUPPORTED);
}

static sv_status decode(void *self, const uint8_t *data, size_t bytes, const sv_decoded *to, sv_err *err) {
  sv_picture out = {to->width_px, to->height_px, to->stride_bytes, SV_PIX_RGB8, to->rgb};
  n_decoded++;
  return sv_codec_decode(self, data, bytes, &out, err);
}

// A source of one JPEG, for the tiles.
static size_t jpeg_bytes;
static uint8_t jpeg[16384];
static sv_status one_caps(void *self, int i, sv_camera_caps *out) {
  (void)self, (void)i;
  *out = (sv_camera_caps){
      .name = "one", .width_px = W, .height_px = H, .format = SV_PIX_JPEG, .frame_bytes = sizeof jpeg};
  return SV_OK;
}
static sv_status one_dequeue(void *self, sv_frame *f, sv_ns until_ns) {
  (void)self, (void)until_ns;
  *f = (sv_frame){
      .width_px = W, .height_px = H, .format = SV_PIX_JPEG, .data = jpeg, .data_bytes = jpeg_bytes};
  return SV_OK;
}
static sv_status one_requeue(void *self, const sv_frame *f) {
  (*(int *)self)++;
  return f->i_camera == 0 && f->i_buffer == 0 ? SV_OK : SV_E_ARG;
}

TEST(tiles_of_a_jpeg_are_decoded_once) {
  sv_arena a = sv_arena_make(codec_block, sizeof codec_block);
  sv_codec_cfg cc = {W, H, false};
  assert_int_equal(sv_codec_init(&codec, &cc, &a), SV_OK);
  for (int i = 0; i < W * H; i++) memset(px + 3 * i, i % W < W / 2 ? 60 : 200, 3);
  sv_picture in = {W, H, W * 3, SV_PIX_RGB8, px};
  assert_int_equal(sv_codec_encode_jpeg(&codec, &in, (sv_jpeg_options){95, true},
                                        (sv_codec_buffer){jpeg, sizeof jpeg}, &jpeg_bytes, NULL),
                   SV_OK);
  int n_back = 0;
  sv_source one = {
      .self = &n_back, .n_cameras = 1, .caps = one_caps, .dequeue = one_dequeue, .requeue = one_requeue};
  sv_tiled t;
  sv_err err;
  assert_true(sv_tiled_init(&t, &one, 5, 1, &arena, &err) < 0); // 48 px in five parts
  assert_ok(sv_tiled_init(&t, &one, 2, 1, &arena, &err), &err);
  sv_source src = sv_tiled_source(&t);
  sv_camera_caps caps[2];
  for (int i = 0; i < 2; i++) assert_int_equal(src.caps(src.self, i, &caps[i]), SV_OK);
  assert_int_equal(caps[1].width_px, W / 2);
  assert_string_equal(caps[1].name, "one.1");
  sv_decoder d = {&codec, decode};
  sv_convert_cfg cfg = {caps, 2, 1, &d};
  sv_convert c;
  sv_pool pool = sv_pool_serial();
  assert_ok(sv_convert_init(&c, &cfg, &arena, &err), &err);
  for (int i = 0; i < 2; i++) {
    sv_frame f;
    sv_image_u8 out;
    assert_int_equal(src.dequeue(src.self, &f, 0), SV_OK);
    assert_int_equal(f.i_camera, i);
    assert_ok(sv_convert_frame(&c, &f, &k, &pool, &out, &err), &err);
    int got = out.px[out.stride_bytes * 7 + 3 * 5];
    assert_true(abs(got - (i ? 200 : 60)) < 4);
    assert_int_equal(n_back, 0);
    if (i) assert_int_equal(src.requeue(src.self, &f), SV_OK);
    f.i_camera = 0;
    assert_int_equal(src.requeue(src.self, &f), i ? SV_E_ARG : SV_OK);
  }
  assert_int_equal(n_back, 1); // when both are back
  assert_int_equal(n_decoded, 1);
  sv_codec_close(&codec);
}

TEST(what_cannot_be_converted_is_refused) {
  static const struct {
    sv_camera_caps caps;
    const char *says;
  } bad[] = {{{.name = "a", .width_px = W, .height_px = H, .format = SV_PIX_RGB16}, "rgb16"},
             {{.name = "a", .width_px = W, .height_px = H, .format = SV_PIX_JPEG}, "no decoder"},
             {{.name = "a", .width_px = 33, .height_px = H, .format = SV_PIX_YUYV}, "even width"},
             {{.name = "a", .width_px = 2, .height_px = 2, .format = SV_PIX_RGGB8}, "4x4"}};
  sv_convert c;
  sv_err err;
  for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
    sv_convert_cfg cfg = {&bad[i].caps, 1, 1, NULL};
    assert_true(sv_convert_init(&c, &cfg, &arena, &err) < 0);
    if (!strstr(err.text, bad[i].says)) fail_msg("%s", err.text);
  }
  sv_camera_caps caps = {.name = "a", .width_px = W, .height_px = H, .format = SV_PIX_YUYV};
  sv_convert_cfg cfg = {&caps, 1, 1, NULL};
  sv_pool pool = sv_pool_serial();
  sv_image_u8 out;
  assert_int_equal(sv_convert_init(&c, &cfg, &arena, &err), SV_OK);
  sv_frame f = frame_of(SV_PIX_GREY8);
  assert_int_equal(sv_convert_frame(&c, &f, &k, &pool, &out, &err), SV_E_UNSUPPORTED);
  f = frame_of(SV_PIX_YUYV);
  f.width_px = 20;
  assert_int_equal(sv_convert_frame(&c, &f, &k, &pool, &out, &err), SV_E_RANGE);
  f = frame_of(SV_PIX_YUYV);
  f.stride_bytes = 10;
  assert_int_equal(sv_convert_frame(&c, &f, &k, &pool, &out, &err), SV_E_RANGE);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test_setup(every_format_gives_the_picture, setup),
      cmocka_unit_test_setup(tones_of_raw_sensors, setup),
      cmocka_unit_test_setup(deep_formats_give_the_light, setup),
      cmocka_unit_test_setup(deep_tones, setup),
      cmocka_unit_test(deep_pictures_are_made_smaller),
      cmocka_unit_test_setup(tiles_of_a_jpeg_are_decoded_once, setup),
      cmocka_unit_test_setup(what_cannot_be_converted_is_refused, setup),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
