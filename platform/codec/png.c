// SPDX-License-Identifier: Apache-2.0
#include "platform/codec/codec_mem.h"

#include <png.h>
#include <string.h>

#include "src/base/str.h"

typedef struct {
  sv_codec *codec;
  const uint8_t *data;
  size_t bytes, pos;
  jmp_buf exit;
  char text[128];
  png_structp png;
  png_infop info;
} reader_t;

static png_voidp png_take(png_structp png, png_alloc_size_t bytes) {
  reader_t *r = png_get_mem_ptr(png);
  return sv_codec_block_take(r->codec, bytes); // libpng handles NULL
}

// the block is emptied as a whole
static void png_give(png_structp png, png_voidp p) { (void)png, (void)p; }

static void png_fail(png_structp png, png_const_charp text) {
  reader_t *r = png_get_error_ptr(png);
  sv_copy(r->text, sizeof r->text, text);
  longjmp(r->exit, 1);
}

static void png_warn(png_structp png, png_const_charp text) { (void)png, (void)text; }

static void png_take_data(png_structp png, png_bytep out, size_t n) {
  reader_t *r = png_get_io_ptr(png);
  if (n > r->bytes - r->pos) png_error(png, "the file is cut short");
  memcpy(out, r->data + r->pos, n);
  r->pos += n;
}

static void set_transforms(reader_t *r, sv_pixel_format format) {
  png_structp png = r->png;
  int colour = png_get_color_type(png, r->info), bits = png_get_bit_depth(png, r->info);
  bool has_alpha = (colour & PNG_COLOR_MASK_ALPHA) || png_get_valid(png, r->info, PNG_INFO_tRNS);
  if (format == SV_PIX_RGB16) png_set_expand_16(png);
  else png_set_expand(png);
  if (bits == 16 && format != SV_PIX_RGB16) png_set_scale_16(png);
  if (format == SV_PIX_GREY8) {
    // 0.2126, 0.7152 of BT.709, in libpng's hundred-thousandths
    if ((colour & PNG_COLOR_MASK_COLOR)) png_set_rgb_to_gray_fixed(png, PNG_ERROR_ACTION_NONE, 21260, 71520);
  } else if (!(colour & PNG_COLOR_MASK_COLOR)) png_set_gray_to_rgb(png);
  if (format == SV_PIX_RGBA8 && !has_alpha) png_set_add_alpha(png, 255, PNG_FILLER_AFTER);
  if (format != SV_PIX_RGBA8 && has_alpha) png_set_strip_alpha(png);
#if __BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__
  if (format == SV_PIX_RGB16) png_set_swap(png);
#endif
}

static size_t pixel_bytes(sv_pixel_format f) {
  return f == SV_PIX_GREY8 ? 1 : f == SV_PIX_RGB8 ? 3 : f == SV_PIX_RGBA8 ? 4 : f == SV_PIX_RGB16 ? 6 : 0;
}

static sv_status read_picture(reader_t *r, const sv_picture *out, sv_err *err) {
  png_structp png = r->png;
  png_set_read_fn(png, r, png_take_data);
  png_set_user_limits(png, (png_uint_32)r->codec->cfg.max_width_px, (png_uint_32)r->codec->cfg.max_height_px);
  png_set_chunk_malloc_max(png, 64u << 10); // texts and profiles are not used
  png_set_chunk_cache_max(png, 8);
  png_read_info(png, r->info);
  int w = (int)png_get_image_width(png, r->info), h = (int)png_get_image_height(png, r->info);
  if (w != out->width_px || h != out->height_px)
    return sv_fail(err, SV_E_RANGE, "PNG: the image is %dx%d, expected %dx%d", w, h, out->width_px,
                   out->height_px);
  bool is_interlaced = png_get_interlace_type(png, r->info) != PNG_INTERLACE_NONE;
  set_transforms(r, out->format);
  int n_passes = png_set_interlace_handling(png);
  png_read_update_info(png, r->info);
  if (png_get_rowbytes(png, r->info) != pixel_bytes(out->format) * (size_t)w)
    return sv_fail(err, SV_E_UNSUPPORTED, "PNG: this pixel form is not supported");
  if (is_interlaced) // the passes build on the rows before
    for (int y = 0; y < h; y++)
      memset(out->data + out->stride_bytes * (size_t)y, 0, pixel_bytes(out->format) * (size_t)w);
  for (int pass = 0; pass < n_passes; pass++)
    for (int y = 0; y < h; y++) png_read_row(png, out->data + out->stride_bytes * (size_t)y, NULL);
  png_read_end(png, NULL);
  return SV_OK;
}

sv_status sv_codec_decode_png(sv_codec *c, const uint8_t *data, size_t bytes, const sv_picture *out,
                              sv_err *err) {
  if (!pixel_bytes(out->format))
    return sv_fail(err, SV_E_ARG, "PNG: it can be decoded to GREY8, RGB8, RGBA8 or RGB16 only");
  c->used_bytes = 0;
  reader_t *r = sv_codec_block_take(c, sizeof *r);
  if (!r) return sv_fail(err, SV_E_NOMEM, "PNG: the codec's fixed block is too small");
  memset(r, 0, sizeof *r);
  r->codec = c;
  r->data = data;
  r->bytes = bytes;
  if (setjmp(r->exit)) return sv_fail(err, SV_E_FORMAT, "PNG: %s", r->text);
  r->png = png_create_read_struct_2(PNG_LIBPNG_VER_STRING, r, png_fail, png_warn, r, png_take, png_give);
  if (r->png) r->info = png_create_info_struct(r->png);
  if (!r->info) return sv_fail(err, SV_E_NOMEM, "PNG: the codec's fixed block is too small");
  // Nothing to destroy: everything, zlib's window included, lies in the block.
  return read_picture(r, out, err);
}
