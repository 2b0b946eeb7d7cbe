// SPDX-License-Identifier: Apache-2.0
#include "src/loss/tv.h"

#define BAND_ROWS 32

static void carve(sv_tv *t, const sv_tv_cfg *cfg, sv_arena *a) {
  const size_t rows = (size_t)sv_plane_pad(cfg->cap_height_px),
               stride = (size_t)sv_plane_pad(cfg->cap_width_px);
  t->row_v = SV_TAKE(a, float, 3 * rows);
  t->row_h = SV_TAKE(a, float, 3 * rows);
  t->scratch = SV_TAKE(a, float *, cfg->n_threads);
  for (int i = 0; i < cfg->n_threads; i++) {
    float *s = SV_TAKE(a, float, SV_TV_SCRATCH_FLOATS(stride));
    if (t->scratch) t->scratch[i] = s;
  }
}

sv_status sv_tv_init(sv_tv *t, const sv_tv_cfg *cfg, sv_compute compute, sv_arena *arena) {
  if (cfg->cap_width_px < 1 || cfg->cap_height_px < 1 || cfg->n_threads < 1) return SV_E_ARG;
  t->cfg = *cfg;
  t->compute = compute;
  carve(t, cfg, arena);
  return arena->status < 0 ? arena->status : SV_OK;
}

size_t sv_tv_bytes(const sv_tv_cfg *cfg) {
  sv_tv t;
  sv_arena dry = sv_arena_dry();
  carve(&t, cfg, &dry);
  return dry.used_bytes;
}

typedef struct {
  sv_tv *t;
  const sv_kernels *k;
  const sv_planes *x;
  sv_planes *grad;
  sv_tv_form form;
  float w_v, w_h;
  int n_bands;
} tv_job;

static void band_task(void *arg, int i_task, int i_thread) {
  const tv_job *j = arg;
  const int c = i_task / j->n_bands, row0 = i_task % j->n_bands * BAND_ROWS, row1 = row0 + BAND_ROWS;
  const size_t rows = (size_t)c * (size_t)j->x->rows_padded;
  const sv_tv_args a = {
      .x = j->x->c[c],
      .width_px = j->x->width_px,
      .height_px = j->x->height_px,
      .stride = j->x->stride,
      .row0 = row0,
      .row1 = row1 < j->x->height_px ? row1 : j->x->height_px,
      .form = j->form,
      .w_v = j->w_v,
      .w_h = j->w_h,
      .grad = j->grad ? j->grad->c[c] : NULL,
      .row_v = j->t->row_v + rows,
      .row_h = j->t->row_h + rows,
      .scratch = j->t->scratch[i_thread],
  };
  j->k->tv(&a);
}

double sv_tv_loss(sv_tv *t, const sv_planes *render, sv_planes *grad, sv_tv_form form, float weight) {
  const double w = render->width_px, h = render->height_px, n_v = 3 * w * (h - 1), n_h = 3 * h * (w - 1);
  const double per_v = n_v > 0 ? 1 / n_v : 0, per_h = n_h > 0 ? 1 / n_h : 0;
  tv_job j = {
      .t = t,
      .k = t->compute.k,
      .x = render,
      .grad = grad,
      .form = form,
      .w_v = (float)((double)weight * per_v),
      .w_h = (float)((double)weight * per_h),
      .n_bands = (render->height_px + BAND_ROWS - 1) / BAND_ROWS,
  };
  sv_pool_run(t->compute.pool, band_task, &j, 3 * j.n_bands);
  double sum_v = 0, sum_h = 0;
  for (int c = 0; c < 3; c++)
    for (int r = 0; r < render->height_px; r++) {
      size_t i = (size_t)c * (size_t)render->rows_padded + (size_t)r;
      sum_v += (double)t->row_v[i];
      sum_h += (double)t->row_h[i];
    }
  return (double)weight * (sum_v * per_v + sum_h * per_h);
}
