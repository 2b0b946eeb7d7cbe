// SPDX-License-Identifier: Apache-2.0
#include "src/capture/sharpness.h"

#include <string.h>

#include "src/base/mathx.h"

#define BAND_ROWS 16 // of the image at half size

static size_t full_floats(int width_px) { return (size_t)sv_plane_pad(width_px) * 2 * (BAND_ROWS + 1); }
static size_t half_floats(int width_px) { return (size_t)sv_plane_pad(width_px / 2) * (BAND_ROWS + 1); }
static int n_bands(int height_px) { return (height_px / 2 + BAND_ROWS - 1) / BAND_ROWS; }

void sv_sharpness_carve(sv_sharpness *s, int cap_width_px, int cap_height_px, int n_threads, sv_arena *a) {
  *s = (sv_sharpness){.cap_rows = full_floats(cap_width_px) + half_floats(cap_width_px)};
  s->rows = SV_TAKE(a, float, (size_t)n_threads * s->cap_rows);
  s->band = SV_TAKE(a, sv_sharpness_sums, n_bands(cap_height_px));
}

typedef struct {
  sv_sharpness *s;
  const sv_image_u8 *im;
  const sv_kernels *k;
} job;

// Rows of a band, and one more below for slopes, where there is one.
static void band_task(void *arg, int i_task, int i_thread) {
  const job *j = arg;
  const sv_image_u8 *im = j->im;
  const int w = im->width_px / 2, h = im->height_px / 2, y0 = i_task * BAND_ROWS,
            n = sv_mini(BAND_ROWS + 1, h - y0), stride = sv_plane_pad(w),
            full_stride = sv_plane_pad(im->width_px);
  float *full = j->s->rows + (size_t)i_thread * j->s->cap_rows, *half = full + full_floats(im->width_px);
  sv_sharpness_sums sums = {0};
  j->k->luma(&(sv_luma_args){.src = im->px + (size_t)(2 * y0) * (size_t)im->stride_bytes,
                             .src_stride_bytes = (size_t)im->stride_bytes,
                             .width_px = im->width_px,
                             .dst = full,
                             .dst_stride = full_stride,
                             .row1 = 2 * n});
  j->k->half(&(sv_resize_args){.src = full,
                               .src_width_px = im->width_px,
                               .src_height_px = 2 * n,
                               .src_stride = full_stride,
                               .dst = half,
                               .dst_width_px = w,
                               .dst_height_px = n,
                               .dst_stride = stride,
                               .row1 = n});
  for (int y = 0; y < sv_mini(BAND_ROWS, n - (y0 + n == h)); y++)
    for (int x = 0; x + 1 < w; x++) {
      const float *p = half + (size_t)y * (size_t)stride + x;
      const double v = (double)p[0], dx = (double)p[1] - v, dy = (double)p[stride] - v;
      if (!sv_image_counts(im, 2, x, y0 + y) || !sv_image_counts(im, 2, x + 1, y0 + y) ||
          !sv_image_counts(im, 2, x, y0 + y + 1))
        continue;
      sums.dx2 += dx * dx;
      sums.dy2 += dy * dy;
      sums.luma += v;
      sums.n++;
    }
  j->s->band[i_task] = sums;
}

void sv_sharpness_add(sv_sharpness *s, const sv_image_u8 *im, const sv_compute *c, sv_sharpness_sums *sums) {
  const int n = n_bands(im->height_px);
  sv_pool_run(c->pool, band_task, &(job){s, im, c->k}, n);
  for (int i = 0; i < n; i++) {
    sums->dx2 += s->band[i].dx2;
    sums->dy2 += s->band[i].dy2;
    sums->luma += s->band[i].luma;
    sums->n += s->band[i].n;
  }
}

static double median(const double *v, int n) {
  double sorted[SV_SHARPNESS_RECENT];
  for (int i = 0; i < n; i++) {
    int k = i;
    for (; k > 0 && sorted[k - 1] > v[i]; k--) sorted[k] = sorted[k - 1];
    sorted[k] = v[i];
  }
  return 0.5 * (sorted[(n - 1) / 2] + sorted[n / 2]);
}

double sv_sharpness_share(sv_sharpness *s, const sv_sharpness_sums *sums) {
  const double mean = sums->n > 0 ? sums->luma / sums->n : 0;
  const double sharpness[2] = {sums->dx2, sums->dy2};
  const int n = sv_mini(s->n_seen, SV_SHARPNESS_RECENT);
  double share = 1, here[2];
  if (!(mean > SV_SHARPNESS_DARK)) return 1; // a covered lens is not what this is about
  for (int i = 0; i < 2; i++) {
    here[i] = sharpness[i] / (sums->n * mean * mean);
    const double before = n >= SV_SHARPNESS_FEWEST ? sv_mind(median(s->recent[i], n), s->last_sharp[i]) : 0;
    if (before > 0) share = sv_mind(share, here[i] / before);
    s->recent[i][s->n_seen % SV_SHARPNESS_RECENT] = here[i];
  }
  if (share >= SV_SHARPNESS_SHARE) memcpy(s->last_sharp, here, sizeof here);
  s->n_seen++;
  return share;
}

bool sv_sharpness_is_blurred(sv_sharpness *s, const sv_sharpness_sums *sums) {
  return sv_sharpness_share(s, sums) < SV_SHARPNESS_SHARE;
}
