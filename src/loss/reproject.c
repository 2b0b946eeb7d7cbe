// SPDX-License-Identifier: Apache-2.0
#include "src/loss/reproject.h"

#include <math.h>

#include "src/base/mathx.h"

#define OCCLUDED 0.1f // mean difference of the channels
// Of a view that no camera has: a blurred surface may differ by more, as its depth is compared,
// too.
#define DIFFERENT    0.3f
#define SAME_SURFACE 0.05f // of depth
// Smaller differences count by their square: colors between pixel centers are no closer.
#define KNEE 0.2f

typedef struct {
  const sv_reproject_input *in;
  double *band;
  float *g_depth, *g_trans;
  const float *partner_depth; // of colors
  int partner_stride;
  float *g_colour[3];
  float turn[9], shift[3]; // partner's camera from this one: x' = turn x + shift
  float per_value;         // weight of one channel of a pixel
} job;

static void relate(job *j) {
  const sv_view *a = j->in->view, *b = j->in->partner;
  for (int r = 0; r < 3; r++) {
    j->shift[r] = b->t[r];
    for (int c = 0; c < 3; c++) {
      float *m = &j->turn[3 * r + c];
      *m = b->r[3 * r] * a->r[3 * c] + b->r[3 * r + 1] * a->r[3 * c + 1] + b->r[3 * r + 2] * a->r[3 * c + 2];
      j->shift[r] -= *m * a->t[c];
    }
  }
}

// Color at a place of an image and its derivative by the place; false outside and under the mask.
typedef struct {
  float value[3], by_u[3], by_v[3];
} sample;

static bool sample_at(const sv_reproject_input *in, const float uv[2], sample *out) {
  const sv_image_u8 *im = in->image;
  const float x = uv[0] - 0.5f, y = uv[1] - 0.5f;
  float corner[4][3];
  if (!(x >= 0.0f && y >= 0.0f)) return false;
  if (!(x < (float)(im->width_px - 1) && y < (float)(im->height_px - 1))) return false;
  const int i = (int)x, k = (int)y;
  const float a = x - (float)i, b = y - (float)k;
  for (int p = 0; p < 4; p++) {
    const int col = i + p % 2, row = k + p / 2;
    const uint8_t *px = im->px + (size_t)row * (size_t)im->stride_bytes + (size_t)(col * im->n_channels);
    const float alpha = im->n_channels == 4 ? (float)px[3] / 255.0f : 1.0f;
    if (!sv_image_counts(im, 1, col, row)) return false;
    for (int c = 0; c < 3; c++) corner[p][c] = alpha * (float)px[c] / 255.0f + (1.0f - alpha) * in->bg[c];
  }
  for (int c = 0; c < 3; c++) {
    const float top = corner[1][c] - corner[0][c], bottom = corner[3][c] - corner[2][c];
    const float left = corner[2][c] - corner[0][c];
    out->by_u[c] = top + b * (bottom - top);
    out->by_v[c] = left + a * (bottom - top);
    out->value[c] = corner[0][c] + a * top + b * out->by_v[c];
  }
  return true;
}

// Where a pixel's surface lies in the partner: `far` as seen from this camera, `point` from the
// partner's, both along the partner's axes.
typedef struct {
  float far[3], point[3], uv[2], depth;
} place;

// False: the pixel has no surface, or the partner does not see there.
static bool place_of(const job *j, int x, int y, place *p, sample *s) {
  const sv_reproject_input *in = j->in;
  const float inverse = in->inverse[(size_t)y * (size_t)in->stride + (size_t)x];
  float ray[3];
  if (!(inverse > 0.0f) || !sv_view_ray(in->view, (float)x + 0.5f, (float)y + 0.5f, ray)) return false;
  for (int r = 0; r < 3; r++) {
    const float *m = j->turn + 3 * r;
    p->far[r] = (m[0] * ray[0] + m[1] * ray[1] + m[2] * ray[2]) / inverse;
    p->point[r] = p->far[r] + j->shift[r];
  }
  return sv_view_project(in->partner, p->point, p->uv, &p->depth) && sample_at(in, p->uv, s);
}

// Difference of a pixel, and its derivative by the pixel's inverse depth; false: it does not count.
static bool pixel(const job *j, int x, int y, float *off, float *slope) {
  const sv_reproject_input *in = j->in;
  const size_t at = (size_t)y * (size_t)in->stride + (size_t)x;
  const float inverse = in->inverse[at];
  float jac[6], u = 0.0f, v = 0.0f;
  sample s;
  place p;
  if (!place_of(j, x, y, &p, &s)) return false;
  sv_view_jacobian(in->partner, p.point, jac);
  for (int r = 0; r < 3; r++) { // d(point)/d(inverse) = -far / inverse
    u -= jac[r] * p.far[r] / inverse;
    v -= jac[3 + r] * p.far[r] / inverse;
  }
  *off = *slope = 0.0f;
  for (int c = 0; c < 3; c++) {
    const float d = s.value[c] - in->colour[c][at], change = s.by_u[c] * u + s.by_v[c] * v;
    *off += fabsf(d);
    *slope += d > 0.0f ? change : d < 0.0f ? -change : 0.0f;
  }
  return *off <= 3.0f * OCCLUDED;
}

static void band_task(void *arg, int i_band, int i_thread) {
  const job *j = arg;
  const sv_reproject_input *in = j->in;
  const int y0 = i_band * SV_REPROJECT_BAND_ROWS, y1 = sv_mini(y0 + SV_REPROJECT_BAND_ROWS, in->height_px);
  double sum = 0;
  (void)i_thread;
  for (int y = y0; y < y1; y++)
    for (int x = (in->phase + 2 * y) % SV_REPROJECT_PHASES; x < in->width_px; x += SV_REPROJECT_PHASES) {
      const size_t at = (size_t)y * (size_t)in->stride + (size_t)x;
      float off, slope;
      if (!pixel(j, x, y, &off, &slope)) continue;
      const float g = -j->per_value * slope / in->depth[at]; // of A / D
      sum += (double)off;
      j->g_depth[at] += g * in->inverse[at];
      j->g_trans[at] += g;
    }
  j->band[i_band] = (double)j->per_value * sum;
}

static float colours_of(const job *j, int x, int y) {
  const sv_reproject_input *in = j->in;
  const size_t at = (size_t)y * (size_t)in->stride + (size_t)x;
  float off = 0.0f;
  sample s;
  place p;
  if (!place_of(j, x, y, &p, &s)) return 0.0f;
  const float seen = j->partner_depth[(size_t)p.uv[1] * (size_t)j->partner_stride + (size_t)p.uv[0]];
  if (!(seen > 0.0f) || fabsf(seen - p.depth) > SAME_SURFACE * p.depth) return 0.0f;
  for (int c = 0; c < 3; c++) off += fabsf(in->colour[c][at] - s.value[c]);
  if (off > 3.0f * DIFFERENT) return 0.0f;
  float sum = 0.0f;
  for (int c = 0; c < 3; c++) {
    const float d = in->colour[c][at] - s.value[c], size = fabsf(d);
    sum += size > KNEE ? size - 0.5f * KNEE : 0.5f * d * d / KNEE;
    j->g_colour[c][at] += j->per_value * sv_clampf(d / KNEE, -1.0f, 1.0f);
  }
  return sum;
}

static void colours_task(void *arg, int i_band, int i_thread) {
  const job *j = arg;
  const int y0 = i_band * SV_REPROJECT_BAND_ROWS, y1 = sv_mini(y0 + SV_REPROJECT_BAND_ROWS, j->in->height_px);
  double sum = 0;
  (void)i_thread;
  for (int y = y0; y < y1; y++)
    for (int x = 0; x < j->in->width_px; x++) sum += (double)colours_of(j, x, y);
  j->band[i_band] = (double)j->per_value * sum;
}

static double run_bands(job *j, sv_task_fn task, float per_value, const sv_pool *pool) {
  const int n = (j->in->height_px + SV_REPROJECT_BAND_ROWS - 1) / SV_REPROJECT_BAND_ROWS;
  double loss = 0;
  j->per_value = per_value;
  relate(j);
  sv_pool_run(pool, task, j, n);
  for (int i = 0; i < n; i++) loss += j->band[i];
  return loss;
}

double sv_reproject_loss(const sv_reproject_input *in, const sv_pool *pool, double *band, float *g_depth,
                         float *g_trans) {
  job j = {.in = in, .band = band, .g_depth = g_depth, .g_trans = g_trans};
  if (in->n_px < 1) return 0;
  return run_bands(&j, band_task, in->weight * SV_REPROJECT_PHASES / (3.0f * (float)in->n_px), pool);
}

double sv_reproject_colours(const sv_reproject_input *in, const float *partner_depth, int partner_stride,
                            const sv_pool *pool, double *band, float *const g_colour[3]) {
  job j = {.in = in,
           .band = band,
           .partner_depth = partner_depth,
           .partner_stride = partner_stride,
           .g_colour = {g_colour[0], g_colour[1], g_colour[2]}};
  if (in->n_px < 1) return 0;
  return run_bands(&j, colours_task, in->weight / (3.0f * (float)in->n_px), pool);
}
