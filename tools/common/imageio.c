// SPDX-License-Identifier: Apache-2.0
#include "tools/common/imageio.h"

#include <setjmp.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <jpeglib.h>

#include <jerror.h>
#include <png.h>

#include "tools/common/fileio.h"

static size_t n_samples(const sv_bitmap *b) {
  return (size_t)b->width_px * (size_t)b->height_px * (size_t)b->n_channels;
}

static sv_status allocate(const char *name, sv_bitmap *b, sv_err *err) {
  if (n_samples(b) > SV_BITMAP_CAP_SAMPLES)
    return sv_fail(err, SV_E_RANGE, "%s: %dx%d pixels are too many", name, b->width_px, b->height_px);
  if (b->bits == 16) b->u16 = malloc(n_samples(b) * 2);
  else b->u8 = malloc(n_samples(b));
  return b->u8 || b->u16
             ? SV_OK
             : sv_fail(err, SV_E_NOMEM, "%s: no memory for %dx%d pixels", name, b->width_px, b->height_px);
}

void sv_bitmap_free(sv_bitmap *b) {
  free(b->u8);
  free(b->u16);
  *b = (sv_bitmap){0};
}

// --- PNG -----------------------------------------------------------------------------------------
typedef struct {
  const char *name;
  const uint8_t *data;
  size_t bytes, at;
  uint8_t *out; // encoder: grows
  size_t cap;
  char text[128]; // the library's words
} stream;

static void png_failed(png_structp png, png_const_charp text) {
  stream *s = png_get_error_ptr(png);
  snprintf(s->text, sizeof s->text, "%s", text);
  png_longjmp(png, 1);
}

static void png_warned(png_structp png, png_const_charp text) {
  (void)png;
  (void)text;
}

static void png_take(png_structp png, png_bytep to, size_t n) {
  stream *s = png_get_io_ptr(png);
  if (n > s->bytes - s->at) png_error(png, "the file is cut off");
  memcpy(to, s->data + s->at, n);
  s->at += n;
}

static void png_normalise(png_structp png, png_infop info) {
  int type = png_get_color_type(png, info), bits = png_get_bit_depth(png, info);
  if (type == PNG_COLOR_TYPE_PALETTE) png_set_palette_to_rgb(png);
  if (type == PNG_COLOR_TYPE_GRAY && bits < 8) png_set_expand_gray_1_2_4_to_8(png);
  if (png_get_valid(png, info, PNG_INFO_tRNS)) png_set_tRNS_to_alpha(png);
  if (bits == 16) png_set_swap(png); // PNG is big endian, the machines this builds for are little
  png_set_interlace_handling(png);
  png_read_update_info(png, info);
}

static sv_status decode_png(stream *in, sv_bitmap *out, sv_err *err) {
  png_structp png = png_create_read_struct(PNG_LIBPNG_VER_STRING, in, png_failed, png_warned);
  png_infop info = png ? png_create_info_struct(png) : NULL;
  png_bytep *volatile rows = NULL;
  volatile sv_status s = SV_OK;
  if (!info) {
    png_destroy_read_struct(&png, NULL, NULL);
    return sv_fail(err, SV_E_NOMEM, "%s: no memory for the PNG decoder", in->name);
  }
  if (setjmp(png_jmpbuf(png))) s = sv_fail(err, SV_E_FORMAT, "%s: not a usable PNG: %s", in->name, in->text);
  else {
    png_set_read_fn(png, in, png_take);
    png_set_user_limits(png, SV_BITMAP_CAP_SIDE_PX, SV_BITMAP_CAP_SIDE_PX);
    png_read_info(png, info);
    png_normalise(png, info);
    out->width_px = (int)png_get_image_width(png, info);
    out->height_px = (int)png_get_image_height(png, info);
    out->n_channels = png_get_channels(png, info);
    out->bits = png_get_bit_depth(png, info);
    s = allocate(in->name, out, err);
    rows = malloc(sizeof(png_bytep) * (size_t)out->height_px);
    if (s == SV_OK && !rows) s = sv_fail(err, SV_E_NOMEM, "%s: no memory for its rows", in->name);
    size_t row_bytes = n_samples(out) / (size_t)out->height_px * (size_t)(out->bits / 8);
    for (int y = 0; s == SV_OK && y < out->height_px; y++)
      rows[y] = (out->u8 ? out->u8 : (uint8_t *)out->u16) + (size_t)y * row_bytes;
    if (s == SV_OK) {
      png_read_image(png, rows);
      png_read_end(png, NULL);
    }
  }
  free(rows);
  png_destroy_read_struct(&png, &info, NULL);
  return s;
}

static void png_give(png_structp png, png_bytep from, size_t n) {
  stream *s = png_get_io_ptr(png);
  if (n > s->cap - s->at) {
    size_t cap = 2 * s->cap + n + 65536;
    uint8_t *more = realloc(s->out, cap);
    if (!more) png_error(png, "no memory");
    s->out = more;
    s->cap = cap;
  }
  memcpy(s->out + s->at, from, n);
  s->at += n;
}

static void png_flush_nothing(png_structp png) { (void)png; }

static bool is_writable(const sv_bitmap *b) {
  return b->width_px > 0 && b->height_px > 0 && b->n_channels >= 1 && b->n_channels <= 4 &&
         ((b->bits == 8 && b->u8) || (b->bits == 16 && b->u16));
}

static sv_status encode_png(stream *o, const sv_bitmap *b, sv_err *err) {
  static const int types[5] = {0, PNG_COLOR_TYPE_GRAY, PNG_COLOR_TYPE_GRAY_ALPHA, PNG_COLOR_TYPE_RGB,
                               PNG_COLOR_TYPE_RGB_ALPHA};
  png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, o, png_failed, png_warned);
  png_infop info = png ? png_create_info_struct(png) : NULL;
  volatile sv_status s = SV_OK;
  if (!info) {
    png_destroy_write_struct(&png, NULL);
    return sv_fail(err, SV_E_NOMEM, "%s: no memory for the PNG encoder", o->name);
  }
  if (setjmp(png_jmpbuf(png))) s = sv_fail(err, SV_E_IO, "%s: cannot encode the PNG: %s", o->name, o->text);
  else {
    png_set_write_fn(png, o, png_give, png_flush_nothing);
    png_set_compression_level(png, 6);
    png_set_IHDR(png, info, (png_uint_32)b->width_px, (png_uint_32)b->height_px, b->bits,
                 types[b->n_channels], PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT,
                 PNG_FILTER_TYPE_DEFAULT);
    png_write_info(png, info);
    if (b->bits == 16) png_set_swap(png);
    size_t row_bytes = n_samples(b) / (size_t)b->height_px * (size_t)(b->bits / 8);
    const uint8_t *p = b->u8 ? b->u8 : (const uint8_t *)b->u16;
    for (int y = 0; y < b->height_px; y++) png_write_row(png, p + (size_t)y * row_bytes);
    png_write_end(png, info);
  }
  png_destroy_write_struct(&png, &info);
  return s;
}

sv_status sv_bitmap_write_png(const char *path, const sv_bitmap *b, sv_err *err) {
  if (!is_writable(b)) return sv_fail(err, SV_E_ARG, "%s: this bitmap cannot be written as PNG", path);
  stream o = {.name = path};
  sv_status s = encode_png(&o, b, err);
  if (s == SV_OK) s = sv_file_write(path, o.out, o.at, err);
  free(o.out);
  return s;
}

// --- JPEG ----------------------------------------------------------------------------------------
typedef struct {
  struct jpeg_error_mgr base; // first, so that the library's pointer is ours
  jmp_buf jump;
  char text[JMSG_LENGTH_MAX];
} jpeg_failure;

static void jpeg_failed(j_common_ptr cinfo) {
  jpeg_failure *f = (jpeg_failure *)cinfo->err;
  cinfo->err->format_message(cinfo, f->text);
  longjmp(f->jump, 1);
}

// Warnings are about damaged data (a cut file ends in gray): that is a failure here. Bytes too many
// between markers are harmless, and webcams write them.
static void jpeg_message(j_common_ptr cinfo, int level) {
  if (level < 0 && cinfo->err->msg_code != JWRN_EXTRANEOUS_DATA) jpeg_failed(cinfo);
}

static struct jpeg_error_mgr *jpeg_errors(jpeg_failure *f) {
  jpeg_std_error(&f->base);
  f->base.error_exit = jpeg_failed;
  f->base.emit_message = jpeg_message;
  f->text[0] = 0;
  return &f->base;
}

static sv_status decode_jpeg(const char *name, const uint8_t *data, size_t bytes, sv_bitmap *out,
                             sv_err *err) {
  struct jpeg_decompress_struct d;
  jpeg_failure failure;
  volatile sv_status s = SV_OK;
  memset(&d, 0, sizeof d);
  d.err = jpeg_errors(&failure);
  if (setjmp(failure.jump)) s = sv_fail(err, SV_E_FORMAT, "%s: not a usable JPEG: %s", name, failure.text);
  else {
    jpeg_create_decompress(&d);
    jpeg_mem_src(&d, data, (unsigned long)bytes);
    (void)jpeg_read_header(&d, TRUE);
    bool is_size_good = d.image_width <= SV_BITMAP_CAP_SIDE_PX && d.image_height <= SV_BITMAP_CAP_SIDE_PX;
    if (d.num_components == 4) s = sv_fail(err, SV_E_UNSUPPORTED, "%s: a CMYK JPEG is not supported", name);
    else if (!is_size_good)
      s = sv_fail(err, SV_E_RANGE, "%s: larger than %d pixels a side", name, SV_BITMAP_CAP_SIDE_PX);
    else {
      d.out_color_space = d.num_components == 1 ? JCS_GRAYSCALE : JCS_RGB;
      d.dct_method = JDCT_ISLOW;
      jpeg_start_decompress(&d);
      out->width_px = (int)d.output_width;
      out->height_px = (int)d.output_height;
      out->n_channels = d.output_components;
      out->bits = 8;
      s = allocate(name, out, err);
      while (s == SV_OK && d.output_scanline < d.output_height) {
        JSAMPROW row = out->u8 + (size_t)d.output_scanline * (size_t)out->width_px * (size_t)out->n_channels;
        (void)jpeg_read_scanlines(&d, &row, 1);
      }
      if (s == SV_OK) jpeg_finish_decompress(&d);
    }
  }
  jpeg_destroy_decompress(&d);
  return s;
}

static sv_status encode_jpeg(const char *path, const sv_bitmap *b, int quality, unsigned char **mem,
                             unsigned long *bytes, sv_err *err) {
  struct jpeg_compress_struct c;
  jpeg_failure failure;
  volatile sv_status s = SV_OK;
  memset(&c, 0, sizeof c);
  c.err = jpeg_errors(&failure);
  if (setjmp(failure.jump)) s = sv_fail(err, SV_E_IO, "%s: cannot encode the JPEG: %s", path, failure.text);
  else {
    jpeg_create_compress(&c);
    jpeg_mem_dest(&c, mem, bytes);
    c.image_width = (JDIMENSION)b->width_px;
    c.image_height = (JDIMENSION)b->height_px;
    c.input_components = b->n_channels;
    c.in_color_space = b->n_channels == 1 ? JCS_GRAYSCALE : JCS_RGB;
    jpeg_set_defaults(&c);
    jpeg_set_quality(&c, quality, TRUE);
    c.dct_method = JDCT_ISLOW;
    jpeg_start_compress(&c, TRUE);
    while (c.next_scanline < c.image_height) {
      JSAMPROW row = b->u8 + (size_t)c.next_scanline * (size_t)b->width_px * (size_t)b->n_channels;
      (void)jpeg_write_scanlines(&c, &row, 1);
    }
    jpeg_finish_compress(&c);
  }
  jpeg_destroy_compress(&c);
  return s;
}

sv_status sv_bitmap_write_jpeg(const char *path, const sv_bitmap *b, int quality, sv_err *err) {
  if (!is_writable(b) || b->bits != 8 || (b->n_channels != 1 && b->n_channels != 3))
    return sv_fail(err, SV_E_ARG, "%s: a JPEG needs 8 bits and 1 or 3 channels", path);
  unsigned char *mem = NULL;
  unsigned long bytes = 0;
  sv_status s = encode_jpeg(path, b, quality, &mem, &bytes, err);
  if (s == SV_OK) s = sv_file_write(path, mem, bytes, err);
  free(mem);
  return s;
}

// --- both ----------------------------------------------------------------------------------------
sv_status sv_bitmap_decode(const char *name, const void *data, size_t bytes, sv_bitmap *out, sv_err *err) {
  static const uint8_t png_magic[8] = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1A, '\n'};
  const uint8_t *d = data;
  *out = (sv_bitmap){0};
  sv_status s;
  if (bytes >= 8 && memcmp(d, png_magic, 8) == 0) {
    stream in = {.name = name, .data = d, .bytes = bytes};
    s = decode_png(&in, out, err);
  } else if (bytes >= 3 && d[0] == 0xFF && d[1] == 0xD8 && d[2] == 0xFF)
    s = decode_jpeg(name, d, bytes, out, err);
  else s = sv_fail(err, SV_E_FORMAT, "%s: neither a PNG nor a JPEG", name);
  if (s != SV_OK) sv_bitmap_free(out);
  return s;
}

sv_status sv_bitmap_read(const char *path, sv_bitmap *out, sv_err *err) {
  void *data;
  size_t bytes;
  *out = (sv_bitmap){0};
  sv_status s = sv_file_read(path, &data, &bytes, err);
  if (s != SV_OK) return s;
  s = sv_bitmap_decode(path, data, bytes, out, err);
  free(data);
  return s;
}

sv_status sv_bitmap_to_8(sv_bitmap *b, sv_err *err) {
  if (b->bits == 8) return SV_OK;
  size_t n = n_samples(b);
  uint8_t *u8 = malloc(n);
  if (!u8) return sv_fail(err, SV_E_NOMEM, "no memory for %zu samples", n);
  for (size_t i = 0; i < n; i++) u8[i] = (uint8_t)((b->u16[i] + 128u) / 257u);
  free(b->u16);
  b->u16 = NULL;
  b->u8 = u8;
  b->bits = 8;
  return SV_OK;
}

static uint32_t get(const sv_bitmap *b, size_t i) { return b->bits == 8 ? b->u8[i] : b->u16[i]; }
static void set(sv_bitmap *b, size_t i, uint32_t v) {
  if (b->bits == 8) b->u8[i] = (uint8_t)v;
  else b->u16[i] = (uint16_t)v;
}

sv_status sv_bitmap_to_channels(sv_bitmap *b, int n_channels, sv_err *err) {
  if (b->n_channels == n_channels) return SV_OK;
  if (n_channels != 1 && n_channels != 3 && n_channels != 4)
    return sv_fail(err, SV_E_ARG, "%d channels requested; expected 1, 3 or 4", n_channels);
  sv_bitmap o = {b->width_px, b->height_px, n_channels, b->bits, NULL, NULL};
  sv_status s = allocate("bitmap", &o, err);
  if (s != SV_OK) return s;
  int nc = b->n_channels;
  size_t n = (size_t)b->width_px * (size_t)b->height_px;
  for (size_t i = 0; i < n; i++) {
    uint32_t c[4], k = (uint32_t)(nc > 2);
    for (uint32_t j = 0; j < 3; j++) c[j] = get(b, i * (size_t)nc + j * k);
    c[3] = nc % 2 == 0 ? get(b, i * (size_t)nc + (size_t)nc - 1) : b->bits == 8 ? 255 : 65535;
    if (n_channels == 1) set(&o, i, k ? (299 * c[0] + 587 * c[1] + 114 * c[2] + 500) / 1000 : c[0]);
    else
      for (size_t j = 0; j < (size_t)n_channels; j++) set(&o, i * (size_t)n_channels + j, c[j]);
  }
  sv_bitmap_free(b);
  *b = o;
  return SV_OK;
}
