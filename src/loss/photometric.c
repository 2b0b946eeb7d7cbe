// SPDX-License-Identifier: Apache-2.0
#include "src/loss/photometric.h"

#include <string.h>

#include "src/base/mathx.h"

// Each band finds the maps of five rows beyond both of its ends once more, so bands are as high as
// the number of threads allows. Within a band SSIM runs ahead of its gradient by a few rows, whose
// maps stay in the cache.
#define CAP_BAND_ROWS 256
#define MIN_BAND_ROWS 16
#define AHEAD_ROWS    32
#define REACH         5

static int band_rows_of(int height, int n_threads) {
  return sv_clampi((height + n_threads - 1) / n_threads, MIN_BAND_ROWS, CAP_BAND_ROWS);
}

static void carve(sv_photometric *p, const sv_photometric_cfg *cfg, sv_arena *a) {
  const size_t rows = (size_t)sv_plane_pad(cfg->cap_height_px), threads = (size_t)cfg->n_threads,
               stride = (size_t)sv_plane_pad(cfg->cap_width_px);
  p->phase = 0;
  p->cap_map_rows = (sv_mini(AHEAD_ROWS + 2 * REACH, cfg->cap_height_px) + 1) / 2;
  // Without SSIM the kernels still want their scratch rows; a gradient is always there.
  const size_t maps = cfg->has_ssim ? 3 * (size_t)p->cap_map_rows * stride : 0;
  p->map = cfg->has_ssim ? SV_TAKE(a, float, threads *maps) : NULL;
  p->map_ssim = cfg->has_ssim ? SV_TAKE(a, float, threads *rows) : NULL;
  p->row_ssim = SV_TAKE(a, float, 3 * rows);
  p->row_l1 = SV_TAKE(a, float, 3 * rows);
  p->scratch = SV_TAKE(a, float *, cfg->n_threads);
  for (int i = 0; i < cfg->n_threads; i++) {
    float *s = SV_TAKE(a, float, SV_SSIM_SCRATCH_FLOATS(stride));
    if (p->scratch) p->scratch[i] = s;
  }
}

sv_status sv_photometric_init(sv_photometric *p, const sv_photometric_cfg *cfg, sv_compute compute,
                              sv_arena *arena) {
  if (cfg->cap_width_px < 1 || cfg->cap_height_px < 1 || cfg->n_threads < 1) return SV_E_ARG;
  p->cfg = *cfg;
  p->compute = compute;
  carve(p, cfg, arena);
  return arena->status < 0 ? arena->status : SV_OK;
}

size_t sv_photometric_bytes(const sv_photometric_cfg *cfg) {
  sv_photometric p;
  sv_arena dry = sv_arena_dry();
  carve(&p, cfg, &dry);
  return dry.used_bytes;
}

// What the tasks of one call share.
typedef struct {
  sv_photometric *p;
  const sv_kernels *k;
  const sv_planes *x, *y;
  sv_planes *grad;
  float *err;
  float w_l1, w_ssim;
  bool has_ssim;
  int phase; // of SSIM's windows
  int n_bands;
} photometric_job;

// Windows stand on every second row: rows of them above the picture's row, and their number in a
// picture so high.
static int windows_above(const photometric_job *j, int row) { return (row - j->phase + 1) / 2; }

static int band_begin(const photometric_job *j, int i_band) {
  return (int)((int64_t)j->x->height_px * i_band / j->n_bands);
}

// SSIM of the windows of rows from the first that have no maps yet up to row1, without a gradient
// without maps; *b gets them.
static void forward(const photometric_job *j, int row0, int row1, int i_thread, sv_ssim_bwd_args *b) {
  sv_photometric *p = j->p;
  sv_ssim_args a = {
      .x = b->x,
      .y = b->y,
      .width_px = b->width_px,
      .height_px = b->height_px,
      .stride = b->stride,
      .phase = b->phase,
      .row0 = row0,
      .row1 = row1,
      .map_row0 = b->map_row0,
      .row_ssim = p->map_ssim + (size_t)i_thread * (size_t)sv_plane_pad(p->cfg.cap_height_px),
      .scratch = b->scratch,
  };
  if (j->grad) {
    const size_t one = (size_t)p->cap_map_rows * (size_t)a.stride;
    a.dm1 =
        p->map + 3 * (size_t)i_thread * (size_t)p->cap_map_rows * (size_t)sv_plane_pad(p->cfg.cap_width_px);
    a.ds1 = a.dm1 + one;
    a.ds12 = a.ds1 + one;
    b->dm1 = a.dm1;
    b->ds1 = a.ds1;
    b->ds12 = a.ds12;
  }
  j->k->ssim(&a);
}

// The maps of the windows' rows [row0, row1) come first.
static void slide(const photometric_job *j, int row0, int row1, int i_thread, sv_ssim_bwd_args *b) {
  const sv_photometric *p = j->p;
  const size_t stride = (size_t)b->stride, one = (size_t)p->cap_map_rows * stride,
               from = (size_t)(row0 - b->map_row0) * stride, n = (size_t)(row1 - row0) * stride;
  float *map =
      p->map + 3 * (size_t)i_thread * (size_t)p->cap_map_rows * (size_t)sv_plane_pad(p->cfg.cap_width_px);
  for (int m = 0; m < 3; m++, map += one) memmove(map, map + from, n * sizeof(float));
  b->map_row0 = row0;
}

// A band's loss and gradient with SSIM. The maps also need the rows next to it, whose sums are
// their own band's to keep.
static void ssim_band(const photometric_job *j, int c, int row0, int row1, int i_thread,
                      sv_ssim_bwd_args *b) {
  const sv_photometric *p = j->p;
  const size_t cap_rows = (size_t)sv_plane_pad(p->cfg.cap_height_px);
  const float *sum = p->map_ssim + (size_t)i_thread * cap_rows;
  const int h = b->height_px, reach = j->grad ? REACH : 0;
  int done = b->map_row0 = windows_above(j, sv_maxi(0, row0 - reach));
  for (int r = row0; r < row1; r = b->row1) {
    b->row0 = r;
    b->row1 = sv_mini(r + AHEAD_ROWS, row1);
    if (j->grad && r > row0) slide(j, windows_above(j, r - REACH), done, i_thread, b);
    const int until = windows_above(j, sv_mini(h, b->row1 + reach));
    forward(j, done, until, i_thread, b);
    done = until;
    j->k->ssim_bwd(b);
  }
  const int first = windows_above(j, row0), n = windows_above(j, row1) - first;
  memcpy(p->row_ssim + (size_t)c * (size_t)j->x->rows_padded + first, sum + first, sizeof(float) * (size_t)n);
}

static void band_task(void *arg, int i_band, int i_thread) {
  const photometric_job *j = arg;
  sv_photometric *p = j->p;
  for (int c = 0; c < 3; c++) {
    sv_ssim_bwd_args a = {
        .x = j->x->c[c],
        .y = j->y->c[c],
        .width_px = j->x->width_px,
        .height_px = j->x->height_px,
        .stride = j->x->stride,
        .phase = j->phase,
        .row0 = band_begin(j, i_band),
        .row1 = band_begin(j, i_band + 1),
        .w_l1 = j->w_l1,
        .w_ssim = j->w_ssim,
        .grad = j->grad ? j->grad->c[c] : NULL,
        .err = j->err,
        .err_scale = 1.0f / 3.0f,
        .is_err_add = c > 0,
        .row_l1 = p->row_l1 + (size_t)c * (size_t)j->x->rows_padded,
        .scratch = p->scratch[i_thread],
    };
    if (j->has_ssim) ssim_band(j, c, a.row0, a.row1, i_thread, &a);
    else j->k->ssim_bwd(&a);
  }
}

static double fold(const float *rows, int n_rows, const sv_planes *x) {
  double s = 0;
  for (int c = 0; c < 3; c++)
    for (int r = 0; r < n_rows; r++) s += (double)rows[(size_t)c * (size_t)x->rows_padded + (size_t)r];
  return s / (3.0 * x->width_px * n_rows);
}

// The kernels write the rows of the picture; rows below it are ours to clear.
static void clear_rows_below(float *plane, const sv_planes *x) {
  memset(plane + (size_t)x->height_px * (size_t)x->stride, 0,
         sizeof(float) * (size_t)x->stride * (size_t)(x->rows_padded - x->height_px));
}

sv_photometric_value sv_photometric_loss(sv_photometric *p, const sv_planes *render, const sv_planes *target,
                                         sv_planes *grad, float *err_plane, float weight_ssim) {
  const sv_pool *pool = p->compute.pool;
  const double n = 3.0 * render->width_px * render->height_px;
  photometric_job j = {
      .p = p,
      .k = p->compute.k,
      .x = render,
      .y = target,
      .grad = grad,
      .err = err_plane,
      .w_l1 = (float)((1.0 - (double)weight_ssim) / n),
      .has_ssim = p->cfg.has_ssim && weight_ssim != 0.0f,
      .phase = render->height_px > 1 ? p->phase : 0,
  };
  const int n_windows = windows_above(&j, render->height_px); // rows of them
  j.w_ssim = (float)(-(double)weight_ssim / (3.0 * render->width_px * n_windows));
  const int band_rows = band_rows_of(render->height_px, pool->n_threads);
  j.n_bands = (render->height_px + band_rows - 1) / band_rows;
  sv_pool_run(pool, band_task, &j, j.n_bands);
  for (int c = 0; c < 3 && grad; c++) clear_rows_below(grad->c[c], render);
  if (err_plane) clear_rows_below(err_plane, render);
  sv_photometric_value v = {.l1 = fold(p->row_l1, render->height_px, render),
                            .ssim = j.has_ssim ? fold(p->row_ssim, n_windows, render) : 0};
  v.loss = (1.0 - (double)weight_ssim) * v.l1 + (j.has_ssim ? (double)weight_ssim * (1.0 - v.ssim) : 0.0);
  return v;
}
