// SPDX-License-Identifier: Apache-2.0
#include "src/image/convert.h"

#include <string.h>

#include "src/base/mathx.h"

#define ROWS_PER_TASK 32

// --- what can be converted -----------------------------------------------------------------------
static bool is_plain(sv_pixel_format f) { return f == SV_PIX_RGB8 || f == SV_PIX_NONE; }

// Raw: samples go through tables first.
static bool is_raw(sv_pixel_format f) {
  const sv_pixel_info *p = sv_pixel(f);
  return p->layout == SV_LAYOUT_BAYER || (p->layout == SV_LAYOUT_GREY && p->bits > 8);
}

static int rgb8_layout(sv_pixel_layout l) {
  switch (l) {
  case SV_LAYOUT_GREY:
  case SV_LAYOUT_BAYER: return SV_RGB8_GREY;
  case SV_LAYOUT_BGR: return SV_RGB8_BGR;
  case SV_LAYOUT_RGBX: return SV_RGB8_RGBX;
  case SV_LAYOUT_BGRX: return SV_RGB8_BGRX;
  case SV_LAYOUT_YUYV: return SV_RGB8_YUYV;
  case SV_LAYOUT_UYVY: return SV_RGB8_UYVY;
  case SV_LAYOUT_NV12: return SV_RGB8_NV12;
  default: return -1;
  }
}

bool sv_convert_knows(sv_pixel_format f) {
  sv_pixel_layout l = sv_pixel(f)->layout;
  return f == SV_PIX_RGB8 || l == SV_LAYOUT_CODED || (f != SV_PIX_RGBA8 && rgb8_layout(l) >= 0);
}

static sv_status check_caps(const sv_convert_cfg *cfg, int i, bool has_decoder_check, sv_err *err) {
  const sv_camera_caps *c = &cfg->caps[i];
  const sv_pixel_info *p = sv_pixel(c->format);
  if (cfg->is_deep && !sv_deep_knows(c))
    return sv_fail(
        err, SV_E_UNSUPPORTED,
        "camera %d (%s) delivers %s; 16 bits a value come from raw frames of more than 8 bits whose "
        "samples are linear light, and from 16-bit pictures",
        i, c->name, p->name);
  if (cfg->is_deep || is_plain(c->format)) return SV_OK;
  if (!sv_convert_knows(c->format))
    return sv_fail(err, SV_E_UNSUPPORTED, "camera %d (%s) delivers %s, which cannot be made RGB8", i, c->name,
                   p->name);
  if (has_decoder_check && p->layout == SV_LAYOUT_CODED && (!cfg->decoder || !cfg->decoder->decode))
    return sv_fail(err, SV_E_UNSUPPORTED, "camera %d (%s) delivers %s images and there is no decoder", i,
                   c->name, p->name);
  bool is_paired = p->layout == SV_LAYOUT_YUYV || p->layout == SV_LAYOUT_UYVY || p->layout == SV_LAYOUT_NV12;
  if (is_paired && c->width_px % 2)
    return sv_fail(err, SV_E_RANGE, "camera %d (%s): %s frames of %d px width, expected an even width", i,
                   c->name, p->name, c->width_px);
  if (p->layout == SV_LAYOUT_BAYER && (c->width_px < 4 || c->height_px < 4))
    return sv_fail(err, SV_E_RANGE, "camera %d (%s): Bayer frames of %dx%d px, expected at least 4x4", i,
                   c->name, c->width_px, c->height_px);
  return SV_OK;
}

// --- tables --------------------------------------------------------------------------------------
uint8_t sv_raw_tone_value(const sv_raw_tone *t, double gain, int bits, int sample) {
  double white = (double)((1 << bits) - 1 - t->black);
  double v = white > 0 ? gain * (double)(sample - t->black) / white : 0;
  v = v < 0 ? 0 : v > 1 ? 1 : v;
  // IEC 61966-2-1
  if (t->is_linear) v = v <= 0.0031308 ? 12.92 * v : 1.055 * sv_pow(v, 1.0 / 2.4) - 0.055;
  return (uint8_t)(int)(255.0 * v + 0.5);
}

static void build_tables(const sv_camera_caps *c, uint8_t *tables) {
  const sv_pixel_info *p = sv_pixel(c->format);
  int index_bits = p->bits > 12 ? 12 : p->bits, shift = p->bits - index_bits;
  for (int place = 0; place < 4; place++) {
    bool is_red = place == p->phase, is_blue = place == (p->phase ^ 3);
    double gain = 1;
    if (p->layout == SV_LAYOUT_BAYER && is_red && c->tone.gain_r > 0) gain = (double)c->tone.gain_r;
    if (p->layout == SV_LAYOUT_BAYER && is_blue && c->tone.gain_b > 0) gain = (double)c->tone.gain_b;
    // the middle sample of the range; at both ends the end itself
    for (int i = 0; i < SV_RAW_TABLE; i++) {
      int k = sv_mini(i, (1 << index_bits) - 1), v = k << shift;
      if (shift) v += k == (1 << index_bits) - 1 ? (1 << shift) - 1 : k ? 1 << (shift - 1) : 0;
      tables[place * SV_RAW_TABLE + i] = sv_raw_tone_value(&c->tone, gain, p->bits, v);
    }
  }
}

// --- start ---------------------------------------------------------------------------------------
static void coded_size(const sv_camera_caps *c, int *w, int *h) {
  *w = c->coded_width_px > 0 ? c->coded_width_px : c->width_px;
  *h = c->coded_height_px > 0 ? c->coded_height_px : c->height_px;
}

static size_t larger(size_t a, size_t b) { return a > b ? a : b; }

static void carve_deep(sv_convert *c, const sv_convert_cfg *cfg, sv_arena *a) {
  size_t px = 0, scratch = 0;
  bool has_pattern = false;
  for (int i = 0; i < cfg->n_cameras; i++) {
    const sv_camera_caps *k = &cfg->caps[i];
    px = larger(px, (size_t)k->width_px * (size_t)k->height_px);
    scratch = larger(scratch, SV_DEEP_SCRATCH_FLOATS(k->width_px));
    has_pattern |= sv_pixel(k->format)->layout == SV_LAYOUT_BAYER;
  }
  c->rgb = SV_TAKE(a, uint8_t, 3 * px);
  c->deep = (sv_deep_buffers){.linear = SV_TAKE(a, uint16_t, 3 * px),
                              .rgb = c->rgb,
                              .samples = has_pattern ? SV_TAKE(a, uint16_t, px) : NULL,
                              .scratch = SV_TAKE(a, float, scratch *(size_t)cfg->n_threads)};
}

static void carve(sv_convert *c, const sv_convert_cfg *cfg, sv_arena *a) {
  size_t rgb = 0, grey = 0, row = 0;
  bool has_raw = false;
  for (int i = 0; i < cfg->n_cameras; i++) {
    const sv_camera_caps *k = &cfg->caps[i];
    int w, h;
    if (is_plain(k->format)) continue;
    coded_size(k, &w, &h);
    size_t px = (size_t)w * (size_t)h, rows = SV_DEMOSAIC_SCRATCH_BYTES(w);
    if (3 * px > rgb) rgb = 3 * px;
    if (!is_raw(k->format)) continue;
    has_raw = true;
    if (px > grey) grey = px;
    if (sv_pixel(k->format)->layout == SV_LAYOUT_BAYER && rows > row) row = (rows + 63) & ~(size_t)63;
  }
  c->row_bytes = row;
  c->rgb = rgb ? SV_TAKE(a, uint8_t, rgb) : NULL;
  c->grey = grey ? SV_TAKE(a, uint8_t, grey) : NULL;
  c->rows = row ? SV_TAKE(a, uint8_t, row * (size_t)cfg->n_threads) : NULL;
  if (!has_raw) return;
  c->tables = SV_TAKE(a, uint8_t *, cfg->n_cameras);
  for (int i = 0; i < cfg->n_cameras; i++) {
    uint8_t *t = is_raw(cfg->caps[i].format) ? SV_TAKE(a, uint8_t, 4 * SV_RAW_TABLE) : NULL;
    if (c->tables) c->tables[i] = t;
  }
}

sv_status sv_convert_init(sv_convert *c, const sv_convert_cfg *cfg, sv_arena *arena, sv_err *err) {
  memset(c, 0, sizeof *c);
  c->cfg = *cfg;
  for (int i = 0; i < cfg->n_cameras; i++) {
    sv_status s = check_caps(cfg, i, arena->base != NULL, err); // a plan has no port
    if (s < 0) return s;
  }
  if (cfg->is_deep) carve_deep(c, cfg, arena);
  else carve(c, cfg, arena);
  if (arena->status < 0) return sv_fail(err, arena->status, "no room for the conversion of camera formats");
  for (int i = 0; c->tables && i < cfg->n_cameras; i++)
    if (c->tables[i]) build_tables(&cfg->caps[i], c->tables[i]);
  return SV_OK;
}

void sv_convert_forget(sv_convert *c) { c->coded = NULL; }

// --- one frame -----------------------------------------------------------------------------------
typedef struct {
  const sv_kernels *k;
  int height_px;
  sv_raw_args raw;
  sv_rgb8_args rgb8;
  sv_demosaic_args demosaic;
  uint8_t *rows;
  size_t row_bytes;
} job;

static void rows_of(const job *j, int i_task, int *row0, int *row1) {
  *row0 = i_task * ROWS_PER_TASK;
  *row1 = sv_mini(*row0 + ROWS_PER_TASK, j->height_px);
}

static void raw_task(void *arg, int i_task, int i_thread) {
  const job *j = arg;
  sv_raw_args a = j->raw;
  (void)i_thread;
  rows_of(j, i_task, &a.row0, &a.row1);
  j->k->raw(&a);
}
static void rgb8_task(void *arg, int i_task, int i_thread) {
  const job *j = arg;
  sv_rgb8_args a = j->rgb8;
  (void)i_thread;
  rows_of(j, i_task, &a.row0, &a.row1);
  j->k->rgb8(&a);
}
static void demosaic_task(void *arg, int i_task, int i_thread) {
  const job *j = arg;
  sv_demosaic_args a = j->demosaic;
  rows_of(j, i_task, &a.row0, &a.row1);
  a.scratch = j->rows + j->row_bytes * (size_t)i_thread;
  j->k->demosaic(&a);
}

static void from_raw(sv_convert *c, const sv_frame *f, job *j, const sv_pool *pool, int n_tasks) {
  const sv_pixel_info *p = sv_pixel(f->format);
  const uint8_t *table = c->tables[f->i_camera];
  size_t w = (size_t)f->width_px;
  j->raw = (sv_raw_args){.container = p->container_bits == 8    ? SV_RAW_8
                                      : p->container_bits == 16 ? SV_RAW_16LE
                                      : p->container_bits == 10 ? SV_RAW_10P
                                                                : SV_RAW_12P,
                         .shift = p->bits > 12 ? p->bits - 12 : 0,
                         .src = f->data,
                         .src_stride_bytes = (size_t)f->stride_bytes,
                         .width_px = f->width_px,
                         .dst = c->grey,
                         .dst_stride_bytes = w};
  for (int k = 0; k < 4; k++) j->raw.table[k] = table + k * SV_RAW_TABLE;
  sv_pool_run(pool, raw_task, j, n_tasks);
  if (p->layout == SV_LAYOUT_GREY) {
    j->rgb8.src = c->grey;
    j->rgb8.src_stride_bytes = w;
    sv_pool_run(pool, rgb8_task, j, n_tasks);
    return;
  }
  j->demosaic = (sv_demosaic_args){.src = c->grey,
                                   .src_stride_bytes = w,
                                   .width_px = f->width_px,
                                   .height_px = f->height_px,
                                   .phase = p->phase,
                                   .dst = c->rgb,
                                   .dst_stride_bytes = 3 * w};
  sv_pool_run(pool, demosaic_task, j, n_tasks);
}

// Several cameras may share one compressed image: it is decoded once, and each gets its part.
static sv_status from_coded(sv_convert *c, const sv_frame *f, sv_image_u8 *out, sv_err *err) {
  const sv_camera_caps *caps = &c->cfg.caps[f->i_camera];
  const sv_decoder *d = c->cfg.decoder;
  sv_err why;
  int w, h;
  coded_size(caps, &w, &h);
  size_t stride = 3 * (size_t)w;
  if (f->coded_x0_px < 0 || f->coded_y0_px < 0 || f->coded_x0_px > w - f->width_px ||
      f->coded_y0_px > h - f->height_px)
    return sv_fail(err, SV_E_RANGE, "camera %d (%s): its part of the image lies outside of %dx%d px",
                   f->i_camera, caps->name, w, h);
  if (c->coded != f->data) {
    c->coded = NULL;
    sv_status s = d->decode(d->self, f->data, f->data_bytes, &(sv_decoded){w, h, stride, c->rgb}, &why);
    if (s < 0)
      return sv_fail(err, s, "camera %d (%s), frame %u: %s", f->i_camera, caps->name, f->sequence, why.text);
    c->coded = f->data;
  }
  out->px = c->rgb + (size_t)f->coded_y0_px * stride + 3 * (size_t)f->coded_x0_px;
  out->stride_bytes = (int)stride;
  return SV_OK;
}

static sv_status check_frame(const sv_convert *c, const sv_frame *f, sv_err *err) {
  if (f->i_camera < 0 || f->i_camera >= c->cfg.n_cameras)
    return sv_fail(err, SV_E_ARG, "frame of camera %d, but there are only %d cameras", f->i_camera,
                   c->cfg.n_cameras);
  const sv_camera_caps *caps = &c->cfg.caps[f->i_camera];
  sv_pixel_format want = caps->format == SV_PIX_NONE ? SV_PIX_RGB8 : caps->format;
  if (f->format != want)
    return sv_fail(err, SV_E_UNSUPPORTED, "camera %d (%s) delivers %s, expected %s", f->i_camera, caps->name,
                   sv_pixel(f->format)->name, sv_pixel(want)->name);
  if (f->width_px != caps->width_px || f->height_px != caps->height_px)
    return sv_fail(err, SV_E_RANGE, "camera %d (%s) delivers %dx%d px, expected %dx%d", f->i_camera,
                   caps->name, f->width_px, f->height_px, caps->width_px, caps->height_px);
  if (sv_pixel(f->format)->layout != SV_LAYOUT_CODED &&
      (f->stride_bytes < 0 || (size_t)f->stride_bytes < sv_pixel_row_bytes(f->format, f->width_px)))
    return sv_fail(err, SV_E_RANGE, "camera %d (%s): rows of %d bytes, expected at least %zu", f->i_camera,
                   caps->name, f->stride_bytes, sv_pixel_row_bytes(f->format, f->width_px));
  return SV_OK;
}

sv_status sv_convert_deep(sv_convert *c, const sv_frame *f, float light, const sv_compute *with,
                          sv_image_u8 *rgb, sv_err *err) {
  sv_status s = check_frame(c, f, err);
  if (s < 0) return s;
  c->deep.light = light;
  sv_deep_convert(f, &c->cfg.caps[f->i_camera], &c->deep, with->k, with->pool);
  *rgb = (sv_image_u8){c->rgb, f->width_px, f->height_px, 3, 3 * f->width_px};
  return SV_OK;
}

sv_status sv_convert_frame(sv_convert *c, const sv_frame *f, const sv_kernels *k, const sv_pool *pool,
                           sv_image_u8 *out, sv_err *err) {
  if (c->cfg.is_deep) return sv_convert_deep(c, f, 1, &(sv_compute){k, pool}, out, err);
  sv_status s = check_frame(c, f, err);
  if (s < 0) return s;
  *out = (sv_image_u8){f->data, f->width_px, f->height_px, 3, f->stride_bytes};
  if (is_plain(f->format)) return SV_OK;
  const sv_pixel_info *p = sv_pixel(f->format);
  if (p->layout == SV_LAYOUT_CODED) return from_coded(c, f, out, err);
  sv_yuv_kind yuv = c->cfg.caps[f->i_camera].yuv;
  int n_tasks = (f->height_px + ROWS_PER_TASK - 1) / ROWS_PER_TASK;
  job j = {.k = k, .height_px = f->height_px, .rows = c->rows, .row_bytes = c->row_bytes};
  j.rgb8 = (sv_rgb8_args){
      .layout = (sv_rgb8_layout)rgb8_layout(p->layout),
      .src = f->data,
      .src_stride_bytes = (size_t)f->stride_bytes,
      .yuv = sv_rgb8_matrix(yuv >= SV_YUV_709, yuv == SV_YUV_601_FULL || yuv == SV_YUV_709_FULL),
      .width_px = f->width_px,
      .dst = c->rgb,
      .dst_stride_bytes = 3 * (size_t)f->width_px};
  if (p->layout == SV_LAYOUT_NV12) {
    j.rgb8.chroma = f->chroma ? f->chroma : f->data + (size_t)f->stride_bytes * (size_t)f->height_px;
    j.rgb8.chroma_stride_bytes = (size_t)(f->chroma ? f->chroma_stride_bytes : f->stride_bytes);
  }
  c->coded = NULL;
  if (is_raw(f->format)) from_raw(c, f, &j, pool, n_tasks);
  else sv_pool_run(pool, rgb8_task, &j, n_tasks);
  *out = (sv_image_u8){c->rgb, f->width_px, f->height_px, 3, 3 * f->width_px};
  return SV_OK;
}
