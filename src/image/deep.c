// SPDX-License-Identifier: Apache-2.0
#include "src/image/deep.h"

#include <math.h>

#include "src/base/mathx.h"

#define ROWS_PER_TASK 16
#define MAX           65535

bool sv_deep_knows(const sv_camera_caps *c) {
  const sv_pixel_info *p = sv_pixel(c->format);
  if (c->format == SV_PIX_RGB16) return true;
  return p->bits > 8 && c->tone.is_linear && (p->layout == SV_LAYOUT_BAYER || p->layout == SV_LAYOUT_GREY);
}

typedef struct {
  const sv_frame *f;
  const sv_camera_caps *caps;
  const sv_deep_buffers *b;
  const sv_kernels *k;
  const sv_pixel_info *p;
  float gain[4]; // from samples to MAX, by place in the pattern
} job;

// --- samples -------------------------------------------------------------------------------------

static int sample(const job *j, const uint8_t *row, int x) {
  switch (j->p->container_bits) {
  case 16: return row[2 * x] | row[2 * x + 1] << 8;
  case 10: return row[x / 4 * 5 + x % 4] << 2 | (row[x / 4 * 5 + 4] >> (x % 4 * 2) & 3);
  case 12: return row[x / 2 * 3 + x % 2] << 4 | (row[x / 2 * 3 + 2] >> (x % 2 * 4) & 15);
  default: return row[x];
  }
}

static uint16_t to_u16(float v) { return (uint16_t)(sv_clampf(v, 0, MAX) + 0.5f); }

static void linear_row(const job *j, int y, uint16_t *out) {
  const uint8_t *row = j->f->data + (size_t)y * (size_t)j->f->stride_bytes;
  for (int x = 0; x < j->f->width_px; x++)
    out[x] = to_u16(j->gain[(x & 1) + 2 * (y & 1)] * (float)(sample(j, row, x) - j->caps->tone.black));
}

static void samples_task(void *arg, int i_task, int i_thread) {
  const job *j = arg;
  (void)i_thread;
  for (int y = i_task * ROWS_PER_TASK; y < sv_mini((i_task + 1) * ROWS_PER_TASK, j->f->height_px); y++)
    linear_row(j, y, j->b->samples + (size_t)y * (size_t)j->f->width_px);
}

// --- colors --------------------------------------------------------------------------------------

static int mirror(int i, int n) { return i < 0 ? -i : i >= n ? 2 * (n - 1) - i : i; }

static uint16_t sixteenth(int t) { return (uint16_t)sv_clampi((t + 8) >> 4, 0, MAX); }

// As kernels/demosaic/demosaic.h, with 16 bits.
static void demosaic_row(const job *j, int y, uint16_t *const out[3]) {
  const int w = j->f->width_px, h = j->f->height_px, phase = j->p->phase;
  const uint16_t *r[5];
  for (int i = 0; i < 5; i++) r[i] = j->b->samples + (size_t)mirror(y + i - 2, h) * (size_t)w;
  for (int x = 0; x < w; x++) {
    const int w1 = mirror(x - 1, w), e1 = mirror(x + 1, w), w2 = mirror(x - 2, w), e2 = mirror(x + 2, w);
    const int c = r[2][x], ew = r[2][w1] + r[2][e1], ns = r[1][x] + r[3][x], ew2 = r[2][w2] + r[2][e2],
              ns2 = r[0][x] + r[4][x], diagonal = r[1][w1] + r[1][e1] + r[3][w1] + r[3][e1];
    const bool is_red_row = (y & 1) == phase >> 1, is_red_column = (x & 1) == (phase & 1);
    const int same = is_red_row ? 0 : 2, other = 2 - same;
    if (is_red_row == is_red_column) { // red or blue itself
      out[same][x] = (uint16_t)c;
      out[1][x] = sixteenth(8 * c + 4 * (ew + ns) - 2 * (ew2 + ns2));
      out[other][x] = sixteenth(12 * c + 4 * diagonal - 3 * (ew2 + ns2));
    } else {
      out[1][x] = (uint16_t)c;
      out[same][x] = sixteenth(10 * c + 8 * ew - 2 * diagonal - 2 * ew2 + ns2);
      out[other][x] = sixteenth(10 * c + 8 * ns - 2 * diagonal - 2 * ns2 + ew2);
    }
  }
}

static void rgb16_row(const job *j, int y, float *row, uint16_t *const out[3]) {
  const uint8_t *src = j->f->data + (size_t)y * (size_t)j->f->stride_bytes;
  const int w = j->f->width_px;
  for (int c = 0; c < 3; c++) {
    for (int x = 0; x < w; x++) {
      const uint8_t *p = src + 2 * (3 * x + c);
      row[x] = (float)(p[0] | p[1] << 8) * (1.0f / MAX);
    }
    j->k->srgb_to_linear(&(sv_curve_args){.src = row, .dst = row, .n = w});
    for (int x = 0; x < w; x++) out[c][x] = to_u16(MAX * row[x]);
  }
}

// The same light as display values in bytes.
static void rgb8_row(const job *j, int y, float *rows, uint16_t *const in[3]) {
  const int w = j->f->width_px, stride = (w + 31) & ~31;
  const float scale = j->b->light / MAX;
  sv_pack_args pack = {.width_px = w,
                       .stride = stride,
                       .dst = j->b->rgb + (size_t)y * 3 * (size_t)w,
                       .dst_stride_bytes = 3 * (size_t)w,
                       .row1 = 1};
  for (int c = 0; c < 3; c++, rows += stride) {
    for (int x = 0; x < w; x++) rows[x] = (float)in[c][x] * scale;
    j->k->linear_to_srgb(&(sv_curve_args){.src = rows, .dst = rows, .n = w});
    pack.src[c] = rows;
  }
  j->k->pack(&pack);
}

static void color_task(void *arg, int i_task, int i_thread) {
  const job *j = arg;
  const size_t w = (size_t)j->f->width_px, plane = w * (size_t)j->f->height_px;
  float *rows = j->b->scratch + (size_t)i_thread * SV_DEEP_SCRATCH_FLOATS(w);
  for (int y = i_task * ROWS_PER_TASK; y < sv_mini((i_task + 1) * ROWS_PER_TASK, j->f->height_px); y++) {
    uint16_t *const first = j->b->linear + (size_t)y * w;
    uint16_t *const out[3] = {first, first + plane, first + 2 * plane};
    if (j->p->layout == SV_LAYOUT_BAYER) demosaic_row(j, y, out);
    else if (j->p->layout == SV_LAYOUT_GREY)
      for (int c = 0; c < 3; c++) linear_row(j, y, out[c]);
    else rgb16_row(j, y, rows, out);
    rgb8_row(j, y, rows, out);
  }
}

void sv_deep_convert(const sv_frame *f, const sv_camera_caps *caps, const sv_deep_buffers *b,
                     const sv_kernels *k, const sv_pool *pool) {
  const int n_tasks = (f->height_px + ROWS_PER_TASK - 1) / ROWS_PER_TASK;
  job j = {.f = f, .caps = caps, .b = b, .k = k, .p = sv_pixel(f->format)};
  const int range = (1 << j.p->bits) - 1 - caps->tone.black;
  for (int place = 0; place < 4; place++) {
    const bool is_bayer = j.p->layout == SV_LAYOUT_BAYER, is_red = place == j.p->phase,
               is_blue = place == (j.p->phase ^ 3);
    const float gain = !is_bayer ? 1 : is_red ? caps->tone.gain_r : is_blue ? caps->tone.gain_b : 1;
    j.gain[place] = range > 0 ? MAX * (gain > 0 ? gain : 1) / (float)range : 0;
  }
  if (j.p->layout == SV_LAYOUT_BAYER) sv_pool_run(pool, samples_task, &j, n_tasks);
  sv_pool_run(pool, color_task, &j, n_tasks);
}

// How much of pixel i of n_dst lies in pixel k of n_src, in units of 1 / (n_src n_dst) of the side.
static uint32_t overlap(int i, int n_dst, int k, int n_src) {
  return (uint32_t)(sv_mini((i + 1) * n_src, (k + 1) * n_dst) - sv_maxi(i * n_src, k * n_dst));
}

static int end_of(int i, int n_dst, int n_src) { return ((i + 1) * n_src + n_dst - 1) / n_dst; }

static void reduce_row(const sv_deep_reduction *r, const uint16_t *plane, int y, uint16_t *out) {
  const int sw = r->src_width_px, sh = r->src_height_px, w = r->dst_width_px, h = r->dst_height_px;
  const uint64_t all = (uint64_t)sw * (uint64_t)sh;
  for (int x = 0; x < sw; x++) r->scratch[x] = 0;
  for (int k = y * sh / h; k < end_of(y, h, sh); k++) {
    const uint32_t weight = overlap(y, h, k, sh);
    const uint16_t *p = plane + (size_t)k * r->src_stride;
    for (int x = 0; x < sw; x++) r->scratch[x] += weight * p[x]; // below MAX src_height
  }
  for (int x = 0; x < w; x++) {
    uint64_t sum = all / 2;
    for (int k = x * sw / w; k < end_of(x, w, sw); k++) sum += (uint64_t)overlap(x, w, k, sw) * r->scratch[k];
    out[x] = (uint16_t)(sum / all);
  }
}

void sv_deep_reduce(const sv_deep_reduction *r) {
  const size_t w = (size_t)r->dst_width_px, plane = w * (size_t)r->dst_height_px;
  for (size_t c = 0; c < 3; c++)
    for (int y = r->row0; y < r->row1; y++)
      reduce_row(r, r->src + c * r->src_plane, y, r->dst + c * plane + (size_t)y * w);
}

void sv_deep_encode(const uint16_t *linear, int width_px, int height_px, uint8_t *rgb16, float *scratch,
                    const sv_kernels *k) {
  const size_t w = (size_t)width_px, plane = w * (size_t)height_px;
  for (int y = 0; y < height_px; y++)
    for (size_t c = 0; c < 3; c++) {
      const uint16_t *in = linear + c * plane + (size_t)y * w;
      uint8_t *out = rgb16 + 6 * (size_t)y * w + 2 * c;
      for (size_t x = 0; x < w; x++) scratch[x] = (float)in[x] * (1.0f / MAX);
      k->linear_to_srgb(&(sv_curve_args){.src = scratch, .dst = scratch, .n = width_px});
      for (size_t x = 0; x < w; x++, out += 6) {
        const uint16_t v = to_u16(MAX * scratch[x]);
        out[0] = (uint8_t)v;
        out[1] = (uint8_t)(v >> 8);
      }
    }
}

float sv_deep_white(const uint16_t *linear, size_t n) {
  uint32_t count[256] = {0}; // by the high byte
  size_t above = 0;
  int i = 255;
  for (size_t p = 0; p < n; p++) count[linear[p] >> 8]++;
  while (i > 0 && (above += count[i]) * 100 < n) i--;
  return (float)(i + 1) * (1.0f / 256);
}

float sv_deep_saturated(const sv_image_deep *d) {
  const float x = 0.99f / d->white, read = sv_deep_read(d), shot = sv_deep_shot(d), dark = sqrtf(read);
  return x * (sqrtf(read + shot) + dark) / (sqrtf(read + shot * x) + dark);
}
