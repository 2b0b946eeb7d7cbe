// SPDX-License-Identifier: Apache-2.0
#include "src/dynamic/renew.h"

#include "src/base/mathx.h"
#include "src/splat/constants.h"
#include "src/dynamic/search.h"
#include "src/train/stereo.h"

// Chosen by trials on the simulator's moving scene, 30 and 60 steps an exposure.
#define OFF     0.2f // mean residual over the channels, display values, of a surface that is wrong
#define OPACITY 0.7  // depth is measured from both sides: it may cover what is behind it
#define MAP_PX  2    // pixels of a depth map per Gaussian: each exposure gets its maps
#define SPREAD  0.6f // standard deviation, in distances to the neighbours

// Mean residual over a map's pixel; k: pixels of the whole picture a side of a residual's.
static float residual_at(const sv_dynamic *dyn, const sv_depth_map *m, int k, int x, int y) {
  const int n = sv_maxi(m->k / k, 1), x0 = x * m->k / k, y0 = y * m->k / k;
  float sum = 0;
  for (int i = 0; i < n * n; i++) {
    int v = sv_mini(y0 + i / n, dyn->t->grad.height_px - 1),
        u = sv_mini(x0 + i % n, dyn->t->grad.width_px - 1);
    sum += dyn->t->err_plane[(long)v * dyn->t->grad.stride + u];
  }
  return sum / (float)(n * n);
}

static uint16_t *code_at(const sv_depth_map *m, int x, int y) {
  return m->code + (size_t)y * (size_t)m->view.width_px + (size_t)x;
}

// Leaves a map only what the model's picture does not show; returns how many pixels that is.
static int forget_good(const sv_dynamic *dyn, const sv_depth_map *m) {
  const int k = sv_maxi(dyn->t->views[m->i_view].view.width_px / dyn->t->grad.width_px, 1);
  sv_point p;
  float z;
  int n = 0;
  for (int y = 0; y < m->view.height_px; y++)
    for (int x = 0; x < m->view.width_px; x++) {
      if (!*code_at(m, x, y)) continue;
      bool is_off = residual_at(dyn, m, k, x, y) > OFF && sv_stereo_point(dyn->t, m, x, y, &p, &z);
      if (!is_off) *code_at(m, x, y) = 0;
      n += is_off;
    }
  return n;
}

// Seen where the picture is wrong, or seen by nobody for long: out of view, behind a surface or
// transparent. Without the latter the model loses a part of its Gaussians with each exposure.
static bool is_stale(const sv_dynamic *dyn, int i) {
  if (dyn->share[i] > SV_DYNAMIC_SHARE_MIN) return dyn->residual[i] > OFF * dyn->share[i];
  return dyn->hidden_for[i] > dyn->cfg.keep_hidden;
}

static int next_stale(const sv_dynamic *dyn, int i) {
  while (i < dyn->t->g.n && !is_stale(dyn, i)) i++;
  return i;
}

static void count_hidden(sv_dynamic *dyn) {
  for (int i = 0; i < dyn->t->g.n; i++)
    if (dyn->share[i] > SV_DYNAMIC_SHARE_MIN) dyn->hidden_for[i] = 0;
    else if (dyn->hidden_for[i] < UINT8_MAX) dyn->hidden_for[i]++;
}

static void place(sv_dynamic *dyn, int i, const sv_point *p, float sigma) {
  const float log_sigma = (float)sv_log((double)sigma);
  sv_gaussian g = {.mean = {p->mean[0], p->mean[1], p->mean[2]},
                   .quat_wxyz = {1},
                   .log_scale = {log_sigma, log_sigma, log_sigma},
                   .opacity_logit = (float)sv_log(OPACITY / (1.0 - OPACITY))};
  for (int c = 0; c < 3; c++) g.sh[0][c] = (p->rgb[c] - 0.5f) / (float)SV_SH_C0;
  sv_gaussians_put(&dyn->t->g, i, &g);
  const long at = sv_gaussians_at(&dyn->t->g, i, 0) - dyn->t->g.param;
  for (int r = 0; r < dyn->t->g.n_rows; r++) dyn->t->m[at + 16 * r] = dyn->t->v[at + 16 * r] = 0;
  dyn->t->err[i] = 0.0f;
  dyn->is_moving[i] = 0;
  dyn->hidden_for[i] = 0;
}

// One of the n_off places for each who goes, evenly over all maps, which see about the same.
static void renew(sv_dynamic *dyn, const sv_sweep *w, int n_off, int n) {
  // pixels of a map
  const float apart = sv_maxf(sqrtf((float)n_off / ((float)n * (float)w->n)), 1.0f);
  int index = next_stale(dyn, 0);
  int64_t i_off = 0;
  for (int i = 0; i < w->n; i++)
    for (int y = 0; y < w->map[i].view.height_px; y++)
      for (int x = 0; x < w->map[i].view.width_px; x++) {
        const sv_depth_map *m = &w->map[i];
        sv_point p;
        float z;
        if (!*code_at(m, x, y)) continue;
        i_off++;
        if (i_off * n / n_off == (i_off - 1) * n / n_off || !sv_stereo_point(dyn->t, m, x, y, &p, &z))
          continue;
        place(dyn, index, &p, SPREAD * apart * z / m->view.fx);
        index = next_stale(dyn, index + 1);
      }
}

static sv_status compare(sv_dynamic *dyn, const sv_depth_map *m, float progress, int *n_off) {
  sv_status s = sv_dynamic_residual(dyn, m->i_view, progress);
  if (s < 0) return s;
  *n_off += forget_good(dyn, m);
  return sv_dynamic_share_residual(dyn);
}

sv_status sv_dynamic_renew(sv_dynamic *dyn, float progress, sv_arena *scratch) {
  const sv_bounds b = {{dyn->t->centre[0], dyn->t->centre[1], dyn->t->centre[2]}, dyn->t->radius};
  const size_t mark = sv_arena_mark(scratch);
  sv_sweep w;
  int n_off = 0, n_stale = 0;
  dyn->t->reference_time = dyn->t->newest_time; // depth maps are of that time
  sv_status s = sv_sweep_run(&w, dyn->t, &b, sv_mini(MAP_PX * dyn->t->g.n, SV_SWEEP_CAP_PX), scratch);
  sv_dynamic_clear_shares(dyn);
  for (int i = 0; s == SV_OK && i < w.n; i++) s = compare(dyn, &w.map[i], progress, &n_off);
  if (s == SV_OK) {
    count_hidden(dyn);
    for (int i = next_stale(dyn, 0); i < dyn->t->g.n; i = next_stale(dyn, i + 1)) n_stale++;
    const int n = sv_mini(n_off, n_stale);
    if (n > 0) renew(dyn, &w, n_off, n);
    if (n > 0) sv_dynamic_sort(dyn);
    dyn->n_renewed += (uint32_t)n;
  }
  sv_arena_reset(scratch, mark);
  return s < 0 ? s : SV_OK;
}
