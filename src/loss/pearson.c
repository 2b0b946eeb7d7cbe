// SPDX-License-Identifier: Apache-2.0
#include "src/loss/pearson.h"

#include <math.h>

#include "src/base/mathx.h"

#define BAND_ROWS 16
// variance over squared mean: below it, differences are rounding errors
#define MIN_CONTRAST_2 1e-12

static void carve(sv_pearson *p, const sv_pearson_cfg *cfg, sv_arena *a) {
  p->stats = SV_TAKE(a, sv_pearson_stat, cfg->cap_patches);
}

sv_status sv_pearson_init(sv_pearson *p, const sv_pearson_cfg *cfg, sv_compute compute, sv_arena *arena) {
  if (cfg->cap_patches < 1) return SV_E_ARG;
  p->cfg = *cfg;
  p->compute = compute;
  carve(p, cfg, arena);
  return arena->status < 0 ? arena->status : SV_OK;
}

size_t sv_pearson_bytes(const sv_pearson_cfg *cfg) {
  sv_pearson p;
  sv_arena dry = sv_arena_dry();
  carve(&p, cfg, &dry);
  return dry.used_bytes;
}

typedef struct {
  const sv_pearson_input *in;
  sv_pearson_stat *stats;
  float *grad;
  int n_patches;
} pearson_job;

static sv_pearson_patch patch_at(const sv_pearson_input *in, int i) {
  sv_pearson_patch q = {0, 0, in->width_px, in->height_px};
  if (!in->patches) return q;
  q = in->patches[i];
  q.x0 = sv_clampi(q.x0, 0, in->width_px);
  q.x1 = sv_clampi(q.x1, q.x0, in->width_px);
  q.y0 = sv_clampi(q.y0, 0, in->height_px);
  q.y1 = sv_clampi(q.y1, q.y0, in->height_px);
  return q;
}

static int is_counted(const sv_pearson_input *in, size_t i) { return !in->mask || in->mask[i]; }

// --- value: the statistics of one patch ----------------------------------------------------------
static void stat_task(void *arg, int i_patch, int i_thread) {
  const pearson_job *j = arg;
  const sv_pearson_input *in = j->in;
  const sv_pearson_patch q = patch_at(in, i_patch);
  sv_pearson_stat s = {0};
  double n = 0, saa = 0, sbb = 0, sab = 0;
  (void)i_thread;
  for (int y = q.y0; y < q.y1; y++)
    for (int x = q.x0; x < q.x1; x++) {
      size_t i = (size_t)y * (size_t)in->stride + (size_t)x;
      if (!is_counted(in, i)) continue;
      s.mean_d += (double)in->depth[i];
      s.mean_t += (double)in->prior[i];
      n++;
    }
  if (n > 0) {
    s.mean_d /= n;
    s.mean_t /= n;
  }
  for (int y = q.y0; y < q.y1; y++) // a second pass: one-pass sums cancel
    for (int x = q.x0; x < q.x1; x++) {
      size_t i = (size_t)y * (size_t)in->stride + (size_t)x;
      if (!is_counted(in, i)) continue;
      double a = (double)in->depth[i] - s.mean_d, b = (double)in->prior[i] - s.mean_t;
      saa += a * a;
      sbb += b * b;
      sab += a * b;
    }
  if (n >= 2 && saa > MIN_CONTRAST_2 * n * s.mean_d * s.mean_d &&
      sbb > MIN_CONTRAST_2 * n * s.mean_t * s.mean_t) {
    double root = sqrt(saa) * sqrt(sbb);
    s.r = sab / root;
    s.per_b = 1 / root;
    s.per_a = s.r / saa;
  }
  j->stats[i_patch] = s;
}

// --- gradient: one band of rows, all patches in index order --------------------------------------
static void bwd_task(void *arg, int i_band, int i_thread) {
  const pearson_job *j = arg;
  const sv_pearson_input *in = j->in;
  const double w = (double)in->weight / j->n_patches;
  (void)i_thread;
  for (int k = 0; k < j->n_patches; k++) {
    const sv_pearson_stat *s = j->stats + k;
    const sv_pearson_patch q = patch_at(in, k);
    const int y0 = sv_maxi(q.y0, i_band * BAND_ROWS), y1 = sv_mini(q.y1, (i_band + 1) * BAND_ROWS);
    if (s->per_b == 0) continue;
    for (int y = y0; y < y1; y++)
      for (int x = q.x0; x < q.x1; x++) {
        size_t i = (size_t)y * (size_t)in->stride + (size_t)x;
        if (!is_counted(in, i)) continue;
        double a = (double)in->depth[i] - s->mean_d, b = (double)in->prior[i] - s->mean_t;
        j->grad[i] += (float)(w * (s->per_a * a - s->per_b * b));
      }
  }
}

double sv_pearson_loss(sv_pearson *p, const sv_pearson_input *in, float *grad_depth) {
  pearson_job j = {in, p->stats, grad_depth, in->patches ? sv_mini(in->n_patches, p->cfg.cap_patches) : 1};
  double sum = 0;
  if (j.n_patches < 1) return 0;
  sv_pool_run(p->compute.pool, stat_task, &j, j.n_patches);
  if (grad_depth) sv_pool_run(p->compute.pool, bwd_task, &j, (in->height_px + BAND_ROWS - 1) / BAND_ROWS);
  for (int k = 0; k < j.n_patches; k++) sum += 1 - p->stats[k].r;
  return (double)in->weight * sum / j.n_patches;
}
