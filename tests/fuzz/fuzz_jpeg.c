// SPDX-License-Identifier: Apache-2.0
// Hostile MJPEG frames: the look at the header that the sources take, then the decoder over its
// fixed block.
#include <stddef.h>
#include <string.h>

#include "platform/camera/options.h"
#include "platform/codec/codec.h"
#include "tests/fuzz/fuzz.h"

#define WIDTH  48
#define HEIGHT 32

static uint8_t block[1 << 20], px[WIDTH * HEIGHT * 3 + 64];
static sv_codec codec;

static void make_codec(void) {
  static int is_made;
  sv_codec_cfg cfg = {WIDTH, HEIGHT, false};
  if (is_made++) return;
  sv_arena arena = sv_arena_make(block, sizeof block);
  FUZZ_CHECK(sv_codec_init(&codec, &cfg, &arena) == SV_OK);
}

size_t fuzz_seed(int i, uint8_t *buf, size_t cap) {
  size_t n = 0;
  sv_err err;
  if (i > 3) return 0;
  make_codec();
  for (int k = 0; k < WIDTH * HEIGHT * 3; k++) px[k] = (uint8_t)(k * (7 + i) + k / 100);
  bool is_grey = i == 2;
  sv_picture in = {WIDTH, HEIGHT, (size_t)WIDTH * (is_grey ? 1 : 3), is_grey ? SV_PIX_GREY8 : SV_PIX_RGB8,
                   px};
  FUZZ_CHECK(sv_codec_encode_jpeg(&codec, &in, (sv_jpeg_options){i == 3 ? 5 : 90, i == 1},
                                  (sv_codec_buffer){buf, cap}, &n, &err) == SV_OK);
  return n;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t bytes) {
  int w, h;
  bool has_end;
  sv_err err = {0};
  make_codec();
  memset(px, 0xa5, sizeof px);
  bool is_jpeg = sv_camera_jpeg_look(data, bytes, &w, &h, &has_end);
  FUZZ_CHECK(!is_jpeg || (w > 0 && h > 0 && w < 65536 && h < 65536));
  sv_picture out = {WIDTH, HEIGHT, (size_t)WIDTH * 3, SV_PIX_RGB8, px};
  sv_status s = sv_codec_decode_jpeg(&codec, data, bytes, &out, &err);
  FUZZ_CHECK(s <= SV_OK && (s == SV_OK || err.text[0]));
  for (size_t k = (size_t)WIDTH * HEIGHT * 3; k < sizeof px; k++) FUZZ_CHECK(px[k] == 0xa5);
  return 0;
}
