// SPDX-License-Identifier: Apache-2.0
#include "src/rig/forward.h"

#include <math.h>
#include <string.h>

#include "src/base/mathx.h"
#include "src/base/rng.h"

#define ROWS 8 // of a task

// --- geometry ------------------------------------------------------------------------------------

float sv_multiplexed_max_overlap(const sv_lens *lenses, int n_lenses, int width_px, int height_px,
                                 float *row) {
  float most = 0;
  for (int y = 0; y < height_px; y++) {
    memset(row, 0, (size_t)width_px * sizeof *row);
    for (int m = 0; m < n_lenses; m++) {
      const sv_footprint *f = &lenses[m].footprint;
      int v = y - f->y0_px;
      if (v < 0 || v >= f->height_px) continue;
      const uint8_t *cover = f->coverage ? f->coverage + (size_t)v * (size_t)f->width_px : NULL;
      for (int u = 0; u < f->width_px; u++) row[f->x0_px + u] += cover ? (float)cover[u] / 255.0f : 1.0f;
    }
    for (int x = 0; x < width_px; x++)
      if (row[x] > most) most = row[x];
  }
  return most;
}

sv_status sv_multiplexed_check(const sv_multiplexed *c, sv_err *err) {
  if (c->n_lenses < 1 || c->width_px < 1 || c->height_px < 1)
    return sv_fail(err, SV_E_RANGE, "a sensor of %dx%d with %d lenses", c->width_px, c->height_px,
                   c->n_lenses);
  for (int m = 0; m < c->n_lenses; m++) {
    const sv_footprint *f = &c->lenses[m].footprint;
    const sv_view *v = &c->lenses[m].view;
    if (f->x0_px < 0 || f->y0_px < 0 || f->width_px < 1 || f->height_px < 1 ||
        f->width_px > c->width_px - f->x0_px || f->height_px > c->height_px - f->y0_px)
      return sv_fail(err, SV_E_RANGE,
                     "lens %d: the footprint %dx%d at (%d, %d) is not on the sensor of %dx%d", m, f->width_px,
                     f->height_px, f->x0_px, f->y0_px, c->width_px, c->height_px);
    if (f->width_px != v->width_px || f->height_px != v->height_px)
      return sv_fail(err, SV_E_RANGE, "lens %d: a footprint of %dx%d for a view of %dx%d", m, f->width_px,
                     f->height_px, v->width_px, v->height_px);
  }
  if (!(c->max_overlap > 0)) return sv_fail(err, SV_E_RANGE, "no lens image falls on the sensor");
  return SV_OK;
}

static int most(int a, int b) { return a > b ? a : b; }
static int least(int a, int b) { return a < b ? a : b; }

bool sv_multiplexed_crop(const sv_multiplexed *c, int i_lens, const sv_region *region, sv_crop *out) {
  const sv_lens *lens = c->lenses + i_lens;
  const sv_footprint *f = &lens->footprint;
  int x0 = most(region->x0, f->x0_px), x1 = least(region->x1, f->x0_px + f->width_px);
  int y0 = most(region->y0, f->y0_px), y1 = least(region->y1, f->y0_px + f->height_px);
  if (x0 >= x1 || y0 >= y1) return false;
  *out = (sv_crop){.lens = lens,
                   .view = lens->view,
                   .x_px = x0 - region->x0,
                   .y_px = y0 - region->y0,
                   .lens_x = x0 - f->x0_px,
                   .lens_y = y0 - f->y0_px};
  out->view.width_px = x1 - x0;
  out->view.height_px = y1 - y0;
  out->view.cx -= (float)out->lens_x;
  out->view.cy -= (float)out->lens_y;
  return true;
}

static float inv_max(const sv_multiplexed *c) { return 1.0f / c->max_overlap; }

// Shares of 255 of a row of the crop, NULL when all of each pixel is lit.
static const uint8_t *cover_row(const sv_crop *crop, int y) {
  const sv_footprint *f = &crop->lens->footprint;
  return f->coverage ? f->coverage + (size_t)(crop->lens_y + y) * (size_t)f->width_px + crop->lens_x : NULL;
}

// --- memory --------------------------------------------------------------------------------------

static int scratch_stride(const sv_forward_cfg *cfg) { return sv_plane_pad(cfg->cap_width_px); }

static void carve(sv_forward *f, const sv_forward_cfg *cfg, sv_arena *a) {
  size_t px = sv_plane_floats(cfg->cap_width_px, cfg->cap_height_px);
  for (int k = 0; k < 3; k++) f->sum.c[k] = SV_TAKE(a, float, px);
  for (int k = 0; k < 3; k++) f->predicted.c[k] = SV_TAKE(a, float, px);
  f->scratch = SV_TAKE(a, float, (size_t)cfg->n_threads * 2 * (size_t)scratch_stride(cfg));
}

size_t sv_forward_bytes(const sv_forward_cfg *cfg) {
  sv_arena dry = sv_arena_dry();
  sv_forward f;
  carve(&f, cfg, &dry);
  return dry.used_bytes;
}

sv_status sv_forward_init(sv_forward *f, const sv_forward_cfg *cfg, sv_compute compute, sv_arena *arena) {
  if (cfg->cap_width_px < 1 || cfg->cap_height_px < 1 || cfg->n_threads < 1) return SV_E_ARG;
  memset(f, 0, sizeof *f);
  f->cfg = *cfg;
  f->compute = compute;
  carve(f, cfg, arena);
  return arena->status < 0 ? arena->status : SV_OK;
}

// --- forward -------------------------------------------------------------------------------------

typedef struct {
  const sv_forward *f;
  const sv_multiplexed *c;
  const sv_crop *crop;
  const sv_planes *rgb, *g;
  const float *trans, *err;
  sv_planes *out;
  float *out_err, *out_trans;
  int n_rows;
} job;

static float *thread_row(const sv_forward *f, int i_thread) {
  return f->scratch + (size_t)i_thread * 2 * (size_t)scratch_stride(&f->cfg);
}

static void run_rows(const sv_forward *f, sv_task_fn fn, job *j) {
  sv_pool_run(f->compute.pool, fn, j, (j->n_rows + ROWS - 1) / ROWS);
}

static void set_size(sv_planes *p, int w, int h) {
  p->width_px = w;
  p->height_px = h;
  p->stride = sv_plane_pad(w);
  p->rows_padded = sv_plane_pad(h);
}

sv_status sv_forward_begin(sv_forward *f, const sv_region *region) {
  int w = region->x1 - region->x0, h = region->y1 - region->y0;
  if (w < 1 || h < 1 || w > f->cfg.cap_width_px || h > f->cfg.cap_height_px) return SV_E_RANGE;
  set_size(&f->sum, w, h);
  set_size(&f->predicted, w, h);
  sv_planes_clear(&f->sum);
  sv_planes_clear(&f->predicted);
  return SV_OK;
}

static void add_task(void *arg, int i_task, int i_thread) {
  const job *j = arg;
  const sv_crop *crop = j->crop;
  const int w = crop->view.width_px;
  float *linear = thread_row(j->f, i_thread);
  for (int y = i_task * ROWS; y < least((i_task + 1) * ROWS, j->n_rows); y++) {
    const uint8_t *cover = cover_row(crop, y);
    for (int k = 0; k < 3; k++) {
      const float *src = j->rgb->c[k] + (size_t)y * (size_t)j->rgb->stride;
      float *sum = j->f->sum.c[k] + (size_t)(crop->y_px + y) * (size_t)j->f->sum.stride + crop->x_px;
      if (j->c->is_linear) {
        j->f->compute.k->srgb_to_linear(&(sv_curve_args){.src = src, .dst = linear, .n = w});
        src = linear;
      }
      if (j->trans) {
        const float *trans = j->trans + (size_t)y * (size_t)j->rgb->stride, back = j->f->backdrop[k];
        for (int x = 0; x < w; x++) linear[x] = fmaf(back, trans[x], src[x]);
        src = linear;
      }
      if (cover)
        for (int x = 0; x < w; x++) sum[x] += (float)cover[x] * (1.0f / 255.0f) * src[x];
      else
        for (int x = 0; x < w; x++) sum[x] += src[x];
    }
  }
}

void sv_forward_add(sv_forward *f, const sv_multiplexed *c, const sv_crop *crop, const sv_planes *rgb,
                    const float *trans) {
  run_rows(f, add_task,
           &(job){.f = f, .c = c, .crop = crop, .rgb = rgb, .trans = trans, .n_rows = crop->view.height_px});
}

// One row of one colour: value -> noisy value, slope times its derivative.
static void add_noise(const sv_forward_noise *n, uint32_t i_row, float *value, float *slope, int w) {
  for (int x = 0; x < w; x++) {
    float e = sv_hash_normal(sv_hash3(n->key, i_row, (uint32_t)x));
    float y = fmaf(fmaf(n->shot, value[x], n->read), e, value[x]);
    slope[x] *= y > 0.0f && y < 1.0f ? fmaf(n->shot, e, 1.0f) : 0.0f;
    value[x] = floorf(sv_clampf(y, 0.0f, 1.0f) * 16383.0f + 0.5f) * (1.0f / 16383.0f);
  }
}

static void finish_task(void *arg, int i_task, int i_thread) {
  const job *j = arg;
  const int w = j->f->sum.width_px;
  const float scale = inv_max(j->c);
  const sv_forward_noise *noise = &j->f->noise;
  const bool is_noisy = noise->read > 0.0f || noise->shot > 0.0f;
  float *value = thread_row(j->f, i_thread), *slope = value + scratch_stride(&j->f->cfg);
  for (int y = i_task * ROWS; y < least((i_task + 1) * ROWS, j->n_rows); y++)
    for (int k = 0; k < 3; k++) {
      float *sum = j->f->sum.c[k] + (size_t)y * (size_t)j->f->sum.stride;
      float *out = j->f->predicted.c[k] + (size_t)y * (size_t)j->f->predicted.stride;
      for (int x = 0; x < w; x++) {
        value[x] = sum[x] * scale;
        slope[x] = scale;
      }
      if (is_noisy) add_noise(noise, (uint32_t)(3 * y + k), value, slope, w);
      if (j->c->is_linear)
        j->f->compute.k->linear_to_srgb(&(sv_curve_args){.src = value, .dst = out, .slope = sum, .n = w});
      for (int x = 0; x < w; x++) {
        if (!j->c->is_linear) {
          out[x] = value[x];
          sum[x] = 1.0f;
        }
        sum[x] *= slope[x];
      }
    }
}

void sv_forward_finish(sv_forward *f, const sv_multiplexed *c) {
  run_rows(f, finish_task, &(job){.f = f, .c = c, .n_rows = f->sum.height_px});
}

// --- adjoint -------------------------------------------------------------------------------------

// Of one colour, from the gradient of its light.
static void add_trans(const job *j, int y, int k, const float *g_light) {
  const int w = j->crop->view.width_px, stride = j->out->stride;
  const float back = j->f->backdrop[k];
  float *out = j->out_trans + (size_t)y * (size_t)stride;
  if (k == 0) memset(out, 0, (size_t)stride * sizeof *out);
  for (int x = 0; x < w; x++) out[x] = fmaf(back, g_light[x], out[x]);
}

static void bwd_row(const job *j, int y, float *scratch) {
  const sv_crop *crop = j->crop;
  const int w = crop->view.width_px, stride = j->out->stride;
  const size_t at = (size_t)(crop->y_px + y) * (size_t)j->f->sum.stride + (size_t)crop->x_px;
  const uint8_t *cover = cover_row(crop, y);
  float *slope = scratch + scratch_stride(&j->f->cfg);
  for (int k = 0; k < 3; k++) {
    float *out = j->out->c[k] + (size_t)y * (size_t)stride;
    const float *g = j->g->c[k] + at, *per_sum = j->f->sum.c[k] + at;
    for (int x = 0; x < w; x++) out[x] = g[x] * per_sum[x];
    if (cover)
      for (int x = 0; x < w; x++) out[x] *= (float)cover[x] * (1.0f / 255.0f);
    if (j->out_trans) add_trans(j, y, k, out);
    if (j->c->is_linear) {
      const float *rgb = j->rgb->c[k] + (size_t)y * (size_t)j->rgb->stride;
      j->f->compute.k->srgb_to_linear(&(sv_curve_args){.src = rgb, .dst = scratch, .slope = slope, .n = w});
      for (int x = 0; x < w; x++) out[x] *= slope[x];
    }
    memset(out + w, 0, (size_t)(stride - w) * sizeof *out);
  }
  if (!j->err) return;
  float *out = j->out_err + (size_t)y * (size_t)stride;
  const float scale = inv_max(j->c) * (cover ? 1.0f / 255.0f : 1.0f);
  for (int x = 0; x < w; x++) out[x] = scale * (cover ? (float)cover[x] : 1.0f) * j->err[at + (size_t)x];
  memset(out + w, 0, (size_t)(stride - w) * sizeof *out);
}

static void bwd_task(void *arg, int i_task, int i_thread) {
  const job *j = arg;
  const int h = j->crop->view.height_px, stride = j->out->stride;
  for (int y = i_task * ROWS; y < least((i_task + 1) * ROWS, j->n_rows); y++) {
    size_t at = (size_t)y * (size_t)stride, bytes = (size_t)stride * sizeof(float);
    if (y < h) {
      bwd_row(j, y, thread_row(j->f, i_thread));
      continue;
    }
    for (int k = 0; k < 3; k++) memset(j->out->c[k] + at, 0, bytes);
    if (j->err) memset(j->out_err + at, 0, bytes);
    if (j->out_trans) memset(j->out_trans + at, 0, bytes);
  }
}

void sv_forward_bwd(const sv_forward *f, const sv_multiplexed *c, const sv_crop *crop, const sv_planes *rgb,
                    const sv_forward_grad *grad) {
  sv_planes *out = grad->rgb;
  set_size(out, crop->view.width_px, crop->view.height_px);
  run_rows(f, bwd_task,
           &(job){.f = f,
                  .c = c,
                  .crop = crop,
                  .rgb = rgb,
                  .g = grad->predicted,
                  .err = grad->err,
                  .out = out,
                  .out_err = grad->rgb_err,
                  .out_trans = grad->trans,
                  .n_rows = out->rows_padded});
}
