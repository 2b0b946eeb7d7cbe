// SPDX-License-Identifier: Apache-2.0
// PNG images into each pixel format. The first byte picks it; the file follows.
#include <string.h>

#include "platform/codec/codec.h"
#include "tests/fuzz/fuzz.h"

#define WIDTH  24
#define HEIGHT 16
#define ROW    (WIDTH * 6)

static const sv_pixel_format formats[] = {SV_PIX_RGB8, SV_PIX_GREY8, SV_PIX_RGBA8, SV_PIX_RGB16};
static uint8_t block[2 << 20], px[HEIGHT * ROW + 64];
static sv_codec codec;

static void make_codec(void) {
  static int is_made;
  sv_codec_cfg cfg = {WIDTH, HEIGHT, true};
  if (is_made++) return;
  sv_arena arena = sv_arena_make(block, sizeof block);
  FUZZ_CHECK(sv_codec_init(&codec, &cfg, &arena) == SV_OK);
}

size_t fuzz_seed(int i, uint8_t *buf, size_t cap) {
  static const sv_pixel_format kinds[] = {SV_PIX_RGB8, SV_PIX_GREY8, SV_PIX_RGB16};
  size_t n = 0;
  sv_err err;
  if (i > 2) return 0;
  make_codec();
  for (size_t k = 0; k < sizeof px; k++) px[k] = (uint8_t)(k * 13 + k / 50);
  sv_picture in = {WIDTH, HEIGHT, ROW, kinds[i], px};
  buf[0] = (uint8_t)i;
  FUZZ_CHECK(sv_codec_encode_png(&codec, &in, buf + 1, cap - 1, &n, &err) == SV_OK);
  return n + 1;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t bytes) {
  sv_err err = {0};
  sv_codec_info info;
  if (!bytes) return 0;
  make_codec();
  memset(px, 0xa5, sizeof px);
  if (sv_codec_probe(data + 1, bytes - 1, &info, &err) == SV_OK)
    FUZZ_CHECK(info.width_px > 0 && info.height_px > 0 && info.n_channels >= 1 && info.n_channels <= 4);
  sv_picture out = {WIDTH, HEIGHT, ROW, formats[data[0] % 4], px};
  const sv_status s = sv_codec_decode(&codec, data + 1, bytes - 1, &out, &err);
  FUZZ_CHECK(s <= SV_OK && (s == SV_OK || err.text[0]));
  for (size_t k = HEIGHT * ROW; k < sizeof px; k++) FUZZ_CHECK(px[k] == 0xa5);
  return 0;
}
