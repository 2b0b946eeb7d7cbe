// SPDX-License-Identifier: Apache-2.0
// PNG output, for data that must return bit for bit: measurements of shared sensors, coverage
// images.
#include "platform/codec/codec_mem.h"

#include <png.h>
#include <string.h>

#include "src/base/str.h"

// Sensor images are noisy in their low bytes: a higher level takes several times as long for a few
// percent.
#define LEVEL 2

typedef struct {
  sv_codec *codec;
  uint8_t *out;
  size_t cap, pos;
  bool is_full;
  jmp_buf exit;
  char text[128];
  png_structp png;
  png_infop info;
} writer_t;

static png_voidp png_take(png_structp png, png_alloc_size_t bytes) {
  writer_t *w = png_get_mem_ptr(png);
  return sv_codec_block_take(w->codec, bytes); // libpng and zlib handle NULL
}

// the block is emptied as a whole
static void png_give(png_structp png, png_voidp p) { (void)png, (void)p; }

static void png_fail(png_structp png, png_const_charp text) {
  writer_t *w = png_get_error_ptr(png);
  sv_copy(w->text, sizeof w->text, text);
  longjmp(w->exit, 1);
}

static void png_warn(png_structp png, png_const_charp text) { (void)png, (void)text; }

static void png_put(png_structp png, png_bytep data, size_t n) {
  writer_t *w = png_get_io_ptr(png);
  w->is_full = n > w->cap - w->pos;
  if (w->is_full) png_error(png, "the buffer is full");
  memcpy(w->out + w->pos, data, n);
  w->pos += n;
}

static void png_nothing(png_structp png) { (void)png; }

static void write_picture(writer_t *w, const sv_picture *in) {
  png_structp png = w->png;
  png_set_write_fn(png, w, png_put, png_nothing);
  png_set_user_limits(png, (png_uint_32)in->width_px, (png_uint_32)in->height_px);
  png_set_IHDR(png, w->info, (png_uint_32)in->width_px, (png_uint_32)in->height_px,
               in->format == SV_PIX_RGB16 ? 16 : 8,
               in->format == SV_PIX_GREY8 ? PNG_COLOR_TYPE_GRAY : PNG_COLOR_TYPE_RGB, PNG_INTERLACE_NONE,
               PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
  png_set_compression_level(png, LEVEL);
  png_set_filter(png, PNG_FILTER_TYPE_BASE, PNG_FILTER_SUB);
  png_write_info(png, w->info);
#if __BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__
  if (in->format == SV_PIX_RGB16) png_set_swap(png);
#endif
  for (int y = 0; y < in->height_px; y++) png_write_row(png, in->data + in->stride_bytes * (size_t)y);
  png_write_end(png, w->info);
}

size_t sv_codec_png_cap(int width_px, int height_px, sv_pixel_format f) {
  size_t row = (size_t)width_px * (f == SV_PIX_GREY8 ? 1 : f == SV_PIX_RGB8 ? 3 : 6) + 1;
  size_t bytes = row * (size_t)height_px;
  return bytes + bytes / 256 + 4096; // deflate's stored blocks, and 12 bytes each 8 KiB for IDAT
}

sv_status sv_codec_encode_png(sv_codec *c, const sv_picture *in, uint8_t *out, size_t cap, size_t *bytes,
                              sv_err *err) {
  *bytes = 0;
  if (in->format != SV_PIX_GREY8 && in->format != SV_PIX_RGB8 && in->format != SV_PIX_RGB16)
    return sv_fail(err, SV_E_ARG, "PNG: only GREY8, RGB8 and RGB16 can be encoded");
  if (in->width_px < 1 || in->height_px < 1 || in->width_px > c->cfg.max_width_px ||
      in->height_px > c->cfg.max_height_px)
    return sv_fail(err, SV_E_RANGE, "PNG: %dx%d does not lie within 1x1 and the %dx%d reserved for",
                   in->width_px, in->height_px, c->cfg.max_width_px, c->cfg.max_height_px);
  c->used_bytes = 0;
  writer_t *w = sv_codec_block_take(c, sizeof *w);
  if (!w) return sv_fail(err, SV_E_NOMEM, "PNG: the codec's fixed block is too small");
  memset(w, 0, sizeof *w);
  w->codec = c;
  w->out = out;
  w->cap = cap;
  if (setjmp(w->exit)) {
    if (w->is_full) return sv_fail(err, SV_E_FULL, "PNG: the image does not fit into %zu bytes", cap);
    return sv_fail(err, SV_E_FORMAT, "PNG: %s", w->text);
  }
  w->png = png_create_write_struct_2(PNG_LIBPNG_VER_STRING, w, png_fail, png_warn, w, png_take, png_give);
  if (w->png) w->info = png_create_info_struct(w->png);
  if (!w->info) return sv_fail(err, SV_E_NOMEM, "PNG: the codec's fixed block is too small");
  write_picture(w, in); // nothing to destroy: everything lies in the block
  *bytes = w->pos;
  return SV_OK;
}
