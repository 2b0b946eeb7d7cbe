// SPDX-License-Identifier: Apache-2.0
#include "src/loss/smooth.h"

#include <math.h>
#include <string.h>

#include "src/base/mathx.h"

#define BAND_ROWS 16
#define SHARPNESS 10.0f // of edges of the picture
#define EDGE      0.05f // of the mean inverse depth: a step of the depth

static int n_bands(int height_px) { return (height_px + BAND_ROWS - 1) / BAND_ROWS; }

sv_status sv_smooth_init(sv_smooth *s, const sv_smooth_cfg *cfg, sv_compute compute, sv_arena *arena) {
  float **planes[] = {&s->inverse, &s->g_depth, &s->g_trans};
  s->compute = compute;
  for (int i = 0; i < 3; i++) *planes[i] = SV_TAKE(arena, float, cfg->cap_pixels);
  s->band = SV_TAKE(arena, double, 2 * (cfg->cap_height_px / BAND_ROWS + 1));
  return arena->status < 0 ? arena->status : SV_OK;
}

typedef struct {
  sv_smooth *s;
  const sv_smooth_input *in;
  float per_pixel, edge; // weight / (n u), largest step that counts
} job;

// Inverse depth of a band; its sum and the number of pixels that have one.
static void invert_task(void *arg, int i_band, int i_thread) {
  const job *j = arg;
  const sv_smooth_input *in = j->in;
  const int y1 = sv_mini((i_band + 1) * BAND_ROWS, in->height_px);
  double sum = 0, n = 0;
  (void)i_thread;
  for (int y = i_band * BAND_ROWS; y < y1; y++) {
    const size_t row = (size_t)y * (size_t)in->stride;
    for (int x = 0; x < in->width_px; x++) {
      const float depth = in->depth[row + (size_t)x], alpha = 1.0f - in->trans[row + (size_t)x];
      const bool has_depth = alpha >= in->alpha_min && depth > 0.0f;
      const float inverse = has_depth ? alpha / depth : 0.0f;
      j->s->inverse[row + (size_t)x] = inverse;
      sum += (double)inverse;
      n += has_depth;
    }
  }
  j->s->band[2 * i_band] = sum;
  j->s->band[2 * i_band + 1] = n;
}

// Loss of two pixels; *slope is its derivative by the second one's inverse depth.
static float pair_loss(const job *j, size_t a, size_t b, float *slope) {
  const sv_smooth_input *in = j->in;
  const float da = j->s->inverse[a], db = j->s->inverse[b], off = db - da;
  float contrast = 0.0f;
  for (int c = 0; c < 3; c++) contrast += fabsf(in->colour[c][a] - in->colour[c][b]);
  const bool counts = da > 0.0f && db > 0.0f && fabsf(off) <= j->edge;
  const float w = counts ? j->per_pixel / (1.0f + SHARPNESS * contrast) : 0.0f;
  *slope = w * (float)((off > 0.0f) - (off < 0.0f));
  return w * fabsf(off);
}

// Pairs of a row and the one below it, whose gradient goes to either or both.
static double down_row(const job *j, int y, bool has_upper, bool has_lower) {
  const size_t stride = (size_t)j->in->stride, row = (size_t)y * stride;
  double sum = 0;
  for (int x = 0; x < j->in->width_px; x++) {
    const size_t i = row + (size_t)x;
    float slope;
    sum += (double)pair_loss(j, i, i + stride, &slope);
    if (has_upper) j->s->g_depth[i] -= slope;
    if (has_lower) j->s->g_depth[i + stride] += slope;
  }
  return sum;
}

static double right_row(const job *j, int y) {
  const size_t row = (size_t)y * (size_t)j->in->stride;
  double sum = 0;
  for (int x = 0; x + 1 < j->in->width_px; x++) {
    const size_t i = row + (size_t)x;
    float slope;
    sum += (double)pair_loss(j, i, i + 1, &slope);
    j->s->g_depth[i] -= slope;
    j->s->g_depth[i + 1] += slope;
  }
  return sum;
}

// g_depth holds dL/d(A / D).
static void through_inverse(const job *j, int y) {
  const sv_smooth_input *in = j->in;
  const size_t row = (size_t)y * (size_t)in->stride;
  for (int x = 0; x < in->width_px; x++) {
    const size_t i = row + (size_t)x;
    const float inverse = j->s->inverse[i], g = inverse > 0.0f ? -j->s->g_depth[i] / in->depth[i] : 0.0f;
    j->s->g_depth[i] = g * inverse;
    j->s->g_trans[i] = g;
  }
}

// Loss and gradient of a band. The pairs across its upper edge are also those of the band above.
static void band_task(void *arg, int i_band, int i_thread) {
  const job *j = arg;
  const int y0 = i_band * BAND_ROWS, y1 = sv_mini(y0 + BAND_ROWS, j->in->height_px);
  const size_t stride = (size_t)j->in->stride, first = (size_t)y0 * stride;
  double sum = 0;
  (void)i_thread;
  memset(j->s->g_depth + first, 0, (size_t)(y1 - y0) * stride * sizeof(float));
  memset(j->s->g_trans + first, 0, (size_t)(y1 - y0) * stride * sizeof(float));
  if (y0 > 0) (void)down_row(j, y0 - 1, false, true);
  for (int y = y0; y < y1; y++) {
    sum += right_row(j, y);
    if (y + 1 < j->in->height_px) sum += down_row(j, y, true, y + 1 < y1);
  }
  for (int y = y0; y < y1; y++) through_inverse(j, y);
  j->s->band[2 * i_band] = sum;
}

double sv_smooth_loss(sv_smooth *s, const sv_smooth_input *in) {
  const int n = n_bands(in->height_px);
  const size_t below = (size_t)in->height_px * (size_t)in->stride;
  const size_t n_below = (size_t)(in->rows_padded - in->height_px) * (size_t)in->stride;
  double sum = 0, n_px = 0, loss = 0;
  job j = {.s = s, .in = in};
  sv_pool_run(s->compute.pool, invert_task, &j, n);
  for (int i = 0; i < n; i++) {
    sum += s->band[2 * i];
    n_px += s->band[2 * i + 1];
  }
  s->n_px = (long)n_px;
  if (n_px > 0) {
    j.edge = (float)((double)EDGE * sum / n_px);
    j.per_pixel = (float)((double)in->weight / sum);
  }
  sv_pool_run(s->compute.pool, band_task, &j, n);
  memset(s->g_depth + below, 0, n_below * sizeof(float));
  memset(s->g_trans + below, 0, n_below * sizeof(float));
  for (int i = 0; i < n; i++) loss += s->band[2 * i];
  return loss;
}
