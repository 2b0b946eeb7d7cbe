// SPDX-License-Identifier: Apache-2.0
#include "platform/codec/codec.h"

#include <string.h>

#include "platform/codec/codec_mem.h"

#define MAX_SIDE_PX 32768

// Working memory of one image. libjpeg keeps rows: at most 3 channels, 2 lines of MCUs (16 rows
// each) with context, twice (decoded and upsampled), about 200 bytes a column; tables and derived
// tables are under 128 KiB. libpng keeps two rows of up to 8 bytes a pixel, zlib's window and state
// are 40 KiB, or 270 KiB for writing. The unit
// test prints the high-water mark.
static size_t block_bytes(const sv_codec_cfg *cfg) {
  size_t w = ((size_t)cfg->max_width_px + 31) & ~(size_t)31,
         h = ((size_t)cfg->max_height_px + 31) & ~(size_t)31;
  size_t bytes = (size_t)(384 << 10) + 256 * w;
  // coefficients of three full channels, and row pointers
  if (cfg->has_progressive) bytes += w * h * 6 + 64 * h;
  return bytes;
}

static bool cfg_is_good(const sv_codec_cfg *c) {
  return c->max_width_px >= 1 && c->max_height_px >= 1 && c->max_width_px <= MAX_SIDE_PX &&
         c->max_height_px <= MAX_SIDE_PX;
}

static void carve(sv_codec *c, const sv_codec_cfg *cfg, sv_arena *a) {
  sv_arena_part_begin(a, "codec");
  c->state = SV_TAKE(a, sv_codec_state, 1);
  c->block_bytes = block_bytes(cfg);
  c->block = SV_TAKE(a, uint8_t, c->block_bytes);
}

size_t sv_codec_bytes(const sv_codec_cfg *cfg) {
  if (!cfg_is_good(cfg)) return 0;
  sv_codec c = {0};
  sv_arena dry = sv_arena_dry();
  carve(&c, cfg, &dry);
  return dry.used_bytes;
}

sv_status sv_codec_init(sv_codec *c, const sv_codec_cfg *cfg, sv_arena *arena) {
  memset(c, 0, sizeof *c);
  if (!cfg_is_good(cfg)) return SV_E_ARG;
  c->cfg = *cfg;
  carve(c, cfg, arena);
  if (arena->status < 0) {
    c->state = NULL;
    return arena->status;
  }
  sv_status s = sv_jpeg_open(c);
  if (s < 0) return s;
  // At its first use libjpeg-turbo detects the processor with heap memory: do it now, not while
  // cameras run.
  uint8_t px[3] = {0}, out[2048];
  sv_picture dot = {.width_px = 1, .height_px = 1, .stride_bytes = 3, .format = SV_PIX_RGB8, .data = px};
  size_t bytes;
  sv_err err;
  return sv_codec_encode_jpeg(c, &dot, (sv_jpeg_options){90, true}, (sv_codec_buffer){out, sizeof out},
                              &bytes, &err);
}

void sv_codec_close(sv_codec *c) {
  if (c->state) sv_jpeg_close(c);
  c->state = NULL;
}

static unsigned be16(const uint8_t *p) { return (unsigned)p[0] << 8 | p[1]; }

static sv_status probe_png(const uint8_t *p, size_t n, sv_codec_info *out, sv_err *err) {
  static const uint8_t channels[7] = {1, 0, 3, 3, 2, 0, 4};
  if (n < 33) return sv_fail(err, SV_E_FORMAT, "PNG: the file ends within its header");
  unsigned w_high = be16(p + 16), w = be16(p + 18), h_high = be16(p + 20), h = be16(p + 22);
  if (memcmp(p + 12, "IHDR", 4) || w_high || h_high || !w || !h || w > MAX_SIDE_PX || h > MAX_SIDE_PX)
    return sv_fail(err, SV_E_FORMAT, "PNG: the header does not tell a size of 1 to %d px a side",
                   MAX_SIDE_PX);
  if (p[25] > 6 || !channels[p[25]]) return sv_fail(err, SV_E_FORMAT, "PNG: unknown colour type %d", p[25]);
  *out = (sv_codec_info){SV_PIX_PNG, (int)w, (int)h, channels[p[25]], p[24]};
  return SV_OK;
}

static sv_status probe_jpeg(const uint8_t *p, size_t n, sv_codec_info *out, sv_err *err) {
  for (size_t i = 2; i + 4 <= n;) {
    if (p[i] != 0xff) break;
    uint8_t m = p[i + 1];
    // fill byte, or a marker without content
    if (m == 0xff || (m >= 0xd0 && m <= 0xd8) || m == 0x01) {
      i += m == 0xff ? 1 : 2;
      continue;
    }
    bool is_frame = m >= 0xc0 && m <= 0xcf && m != 0xc4 && m != 0xc8 && m != 0xcc;
    if (is_frame && i + 10 <= n) {
      unsigned h = be16(p + i + 5), w = be16(p + i + 7);
      if (!w || !h || w > MAX_SIDE_PX || h > MAX_SIDE_PX) break;
      if (p[i + 9] != 1 && p[i + 9] != 3 && p[i + 9] != 4)
        return sv_fail(err, SV_E_FORMAT, "JPEG: %d channels, expected 1, 3 or 4", p[i + 9]);
      *out = (sv_codec_info){SV_PIX_JPEG, (int)w, (int)h, p[i + 9], p[i + 4]};
      return SV_OK;
    }
    if (m == 0xd9 || m == 0xda || is_frame) break;
    i += 2 + be16(p + i + 2);
  }
  return sv_fail(err, SV_E_FORMAT, "JPEG: no frame header with a size of 1 to %d px a side was found",
                 MAX_SIDE_PX);
}

sv_status sv_codec_probe(const uint8_t *p, size_t n, sv_codec_info *out, sv_err *err) {
  static const uint8_t png[8] = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'};
  if (n >= 8 && !memcmp(p, png, 8)) return probe_png(p, n, out, err);
  if (n >= 3 && p[0] == 0xff && p[1] == 0xd8 && p[2] == 0xff) return probe_jpeg(p, n, out, err);
  return sv_fail(err, SV_E_FORMAT, "image: the file is neither JPEG nor PNG by its first bytes");
}

sv_status sv_codec_decode(sv_codec *c, const uint8_t *data, size_t bytes, const sv_picture *out,
                          sv_err *err) {
  if (bytes && data[0] == 0x89) return sv_codec_decode_png(c, data, bytes, out, err);
  return sv_codec_decode_jpeg(c, data, bytes, out, err);
}
