// SPDX-License-Identifier: Apache-2.0
#include <stdlib.h>
#include <string.h>

#include "platform/codec/codec_mem.h"

#include <jerror.h>

#include "src/base/str.h"

static sv_codec_state *state(sv_codec *c) { return c->state; }

// --- errors --------------------------------------------------------------------------------------
static void error_exit(j_common_ptr cinfo) {
  sv_jpeg_common *j = (sv_jpeg_common *)cinfo->err;
  if (cinfo->err->msg_code == JERR_OUT_OF_MEMORY)
    sv_copy(j->text, sizeof j->text, "the codec's fixed block is too small");
  else cinfo->err->format_message(cinfo, j->text);
  longjmp(j->exit, 1);
}

// Warnings (level -1) are damage, except bytes between segments: whole classes of webcams send
// those.
static void emit_message(j_common_ptr cinfo, int level) {
  sv_jpeg_common *j = (sv_jpeg_common *)cinfo->err;
  if (level >= 0 || cinfo->err->msg_code == JWRN_EXTRANEOUS_DATA) return;
  if (!j->n_damages++) cinfo->err->format_message(cinfo, j->text);
}

static void output_message(j_common_ptr cinfo) { (void)cinfo; }

void sv_jpeg_errors_init(sv_jpeg_common *j, j_common_ptr cinfo, sv_codec *c) {
  j->codec = c;
  cinfo->err = jpeg_std_error(&j->errors);
  j->errors.error_exit = error_exit;
  j->errors.emit_message = emit_message;
  j->errors.output_message = output_message;
}

// --- open and close ------------------------------------------------------------------------------
// The objects are created once with libjpeg's own memory manager; later it only uses the block.
sv_status sv_jpeg_open(sv_codec *c) {
  sv_codec_state *s = state(c);
  memset(s, 0, sizeof *s);
  sv_jpeg_errors_init(&s->dec.common, (j_common_ptr)&s->dec.d, c);
  if (setjmp(s->dec.common.exit)) return SV_E_NOMEM;
  jpeg_create_decompress(&s->dec.d);
  s->has_dec = true;
  sv_jpeg_mem_init(&s->dec.common, (j_common_ptr)&s->dec.d);
  sv_jpeg_errors_init(&s->enc.common, (j_common_ptr)&s->enc.c, c);
  if (setjmp(s->enc.common.exit)) {
    sv_jpeg_close(c);
    return SV_E_NOMEM;
  }
  jpeg_create_compress(&s->enc.c);
  s->has_enc = true;
  sv_jpeg_mem_init(&s->enc.common, (j_common_ptr)&s->enc.c);
  return SV_OK;
}

void sv_jpeg_close(sv_codec *c) {
  sv_codec_state *s = state(c);
  if (s->has_dec) {
    s->dec.d.mem = s->dec.common.heap_mem;
    jpeg_destroy_decompress(&s->dec.d);
  }
  if (s->has_enc) {
    s->enc.c.mem = s->enc.common.heap_mem;
    jpeg_destroy_compress(&s->enc.c);
  }
  s->has_dec = s->has_enc = false;
}

// --- decoding ------------------------------------------------------------------------------------
static void source_nothing(j_decompress_ptr d) { (void)d; }

// At the end of the data, an end-of-image marker lets libjpeg finish; the image counts as damaged.
static boolean source_at_end(j_decompress_ptr d) {
  static const JOCTET end[2] = {0xff, JPEG_EOI};
  WARNMS(d, JWRN_JPEG_EOF);
  d->src->next_input_byte = end;
  d->src->bytes_in_buffer = 2;
  return TRUE;
}

static void source_skip(j_decompress_ptr d, long n) {
  if (n <= 0) return;
  if ((size_t)n > d->src->bytes_in_buffer) {
    source_at_end(d);
    return;
  }
  d->src->next_input_byte += n;
  d->src->bytes_in_buffer -= (size_t)n;
}

// A progressive file may hold thousands of tiny scans, each of which costs a pass over the image.
static void limit_scans(j_common_ptr cinfo) {
  if (cinfo->is_decompressor && ((j_decompress_ptr)cinfo)->input_scan_number > 100)
    ERREXIT(cinfo, JERR_BAD_PROGRESSION);
}

// Tables of the previous image must not apply to this one: their memory is reused.
static void decoder_begin(sv_codec *c, const uint8_t *data, size_t bytes) {
  sv_jpeg_decoder *j = &state(c)->dec;
  c->used_bytes = 0;
  j->common.virt_arrays = NULL;
  j->common.n_damages = 0;
  j->common.text[0] = 0;
  for (int i = 0; i < NUM_QUANT_TBLS; i++) j->d.quant_tbl_ptrs[i] = NULL;
  for (int i = 0; i < NUM_HUFF_TBLS; i++) j->d.dc_huff_tbl_ptrs[i] = j->d.ac_huff_tbl_ptrs[i] = NULL;
  j->source = (struct jpeg_source_mgr){.next_input_byte = data,
                                       .bytes_in_buffer = bytes,
                                       .init_source = source_nothing,
                                       .fill_input_buffer = source_at_end,
                                       .skip_input_data = source_skip,
                                       .resync_to_restart = jpeg_resync_to_restart,
                                       .term_source = source_nothing};
  j->d.src = &j->source;
  j->progress = (struct jpeg_progress_mgr){.progress_monitor = limit_scans};
  j->d.progress = &j->progress;
}

static sv_status check_header(sv_codec *c, const sv_picture *out, sv_err *err) {
  struct jpeg_decompress_struct *d = &state(c)->dec.d;
  if ((int)d->image_width != out->width_px || (int)d->image_height != out->height_px)
    return sv_fail(err, SV_E_RANGE, "JPEG: the image is %ux%u, expected %dx%d", d->image_width,
                   d->image_height, out->width_px, out->height_px);
  if ((d->progressive_mode || jpeg_has_multiple_scans(d)) && !c->cfg.has_progressive)
    return sv_fail(err, SV_E_UNSUPPORTED, "JPEG: it is progressive, expected a baseline image");
  if (d->num_components != 1 && d->num_components != 3)
    return sv_fail(err, SV_E_UNSUPPORTED, "JPEG: it has %d channels, expected 1 or 3", d->num_components);
  return SV_OK;
}

static sv_status decode_rows(sv_codec *c, const sv_picture *out, sv_err *err) {
  sv_jpeg_decoder *j = &state(c)->dec;
  struct jpeg_decompress_struct *d = &j->d;
  d->out_color_space = out->format == SV_PIX_GREY8 ? JCS_GRAYSCALE : JCS_RGB;
  d->dct_method = JDCT_ISLOW; // exact to the bit on all machines, unlike the float one
  jpeg_start_decompress(d);
  while (d->output_scanline < d->output_height) {
    JSAMPROW row = out->data + out->stride_bytes * d->output_scanline;
    jpeg_read_scanlines(d, &row, 1);
  }
  jpeg_finish_decompress(d);
  if (j->common.n_damages) return sv_fail(err, SV_E_CORRUPT, "JPEG: %s", j->common.text);
  return SV_OK;
}

sv_status sv_codec_decode_jpeg(sv_codec *c, const uint8_t *data, size_t bytes, const sv_picture *out,
                               sv_err *err) {
  sv_jpeg_decoder *j = &state(c)->dec;
  if (out->format != SV_PIX_RGB8 && out->format != SV_PIX_GREY8)
    return sv_fail(err, SV_E_ARG, "JPEG: it can be decoded to RGB8 or GREY8 only");
  if (out->width_px > c->cfg.max_width_px || out->height_px > c->cfg.max_height_px)
    return sv_fail(err, SV_E_RANGE, "JPEG: %dx%d is larger than the %dx%d reserved for", out->width_px,
                   out->height_px, c->cfg.max_width_px, c->cfg.max_height_px);
  decoder_begin(c, data, bytes);
  if (setjmp(j->common.exit)) {
    jpeg_abort_decompress(&j->d);
    return sv_fail(err, SV_E_FORMAT, "JPEG: %s", j->common.text);
  }
  jpeg_read_header(&j->d, TRUE);
  sv_status s = check_header(c, out, err);
  if (s == SV_OK) s = decode_rows(c, out, err);
  jpeg_abort_decompress(&j->d);
  return s;
}

// --- encoding ------------------------------------------------------------------------------------
static void dest_nothing(j_compress_ptr c) { (void)c; }

static boolean dest_full(j_compress_ptr c) {
  ERREXIT(c, JERR_BUFFER_SIZE);
  return FALSE;
}

static void encode_rows(sv_codec *c, const sv_picture *in, sv_jpeg_options o) {
  struct jpeg_compress_struct *e = &state(c)->enc.c;
  e->image_width = (JDIMENSION)in->width_px;
  e->image_height = (JDIMENSION)in->height_px;
  e->input_components = in->format == SV_PIX_RGB8 ? 3 : 1;
  e->in_color_space = in->format == SV_PIX_RGB8 ? JCS_RGB : JCS_GRAYSCALE;
  jpeg_set_defaults(e);
  jpeg_set_quality(e, o.quality, TRUE);
  e->dct_method = JDCT_ISLOW;
  if (o.is_full_color) e->comp_info[0].h_samp_factor = e->comp_info[0].v_samp_factor = 1;
  jpeg_start_compress(e, TRUE);
  while (e->next_scanline < e->image_height) {
    JSAMPROW row = in->data + in->stride_bytes * e->next_scanline;
    jpeg_write_scanlines(e, &row, 1);
  }
  jpeg_finish_compress(e);
}

static void encoder_begin(sv_codec *c, uint8_t *out, size_t cap) {
  sv_jpeg_encoder *j = &state(c)->enc;
  c->used_bytes = 0;
  j->common.virt_arrays = NULL;
  j->common.text[0] = 0;
  j->c.comp_info = NULL; // these were in the block of the previous image
  j->c.script_space = NULL;
  for (int i = 0; i < NUM_QUANT_TBLS; i++) j->c.quant_tbl_ptrs[i] = NULL;
  for (int i = 0; i < NUM_HUFF_TBLS; i++) j->c.dc_huff_tbl_ptrs[i] = j->c.ac_huff_tbl_ptrs[i] = NULL;
  j->dest = (struct jpeg_destination_mgr){.next_output_byte = out,
                                          .free_in_buffer = cap,
                                          .init_destination = dest_nothing,
                                          .empty_output_buffer = dest_full,
                                          .term_destination = dest_nothing};
  j->c.dest = &j->dest;
}

sv_status sv_codec_encode_jpeg(sv_codec *c, const sv_picture *in, sv_jpeg_options o, sv_codec_buffer out,
                               size_t *bytes, sv_err *err) {
  sv_jpeg_encoder *j = &state(c)->enc;
  *bytes = 0;
  if ((in->format != SV_PIX_RGB8 && in->format != SV_PIX_GREY8) || o.quality < 1 || o.quality > 100)
    return sv_fail(err, SV_E_ARG, "JPEG: only RGB8 and GREY8 with a quality of 1 to 100 can be encoded");
  if (in->width_px < 1 || in->height_px < 1 || in->width_px > c->cfg.max_width_px ||
      in->height_px > c->cfg.max_height_px)
    return sv_fail(err, SV_E_RANGE, "JPEG: %dx%d does not lie within 1x1 and the %dx%d reserved for",
                   in->width_px, in->height_px, c->cfg.max_width_px, c->cfg.max_height_px);
  encoder_begin(c, out.data, out.cap_bytes);
  if (setjmp(j->common.exit)) {
    bool is_full = j->c.err->msg_code == JERR_BUFFER_SIZE;
    jpeg_abort_compress(&j->c);
    if (is_full) return sv_fail(err, SV_E_FULL, "JPEG: the image does not fit into %zu bytes", out.cap_bytes);
    return sv_fail(err, SV_E_FORMAT, "JPEG: %s", j->common.text);
  }
  encode_rows(c, in, o);
  *bytes = out.cap_bytes - j->dest.free_in_buffer;
  return SV_OK;
}
