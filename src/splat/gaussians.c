// SPDX-License-Identifier: Apache-2.0
#include "src/splat/gaussians.h"

#include <float.h>
#include <string.h>

#include "src/base/mathx.h"
#include "src/base/vec.h"
#include "src/splat/constants.h"
#include "src/splat/neighbours.h"

#define CAP_GAUSSIANS 4000000

sv_status sv_gaussians_init(sv_gaussians *g, int n, int sh_degree, sv_arena *arena) {
  if (n < 1 || n > CAP_GAUSSIANS || sh_degree < 0 || sh_degree > 3) return SV_E_ARG;
  *g = (sv_gaussians){
      .cap = (n + 15) / 16 * 16, .n = n, .sh_degree = sh_degree, .n_rows = SV_N_ROWS(sh_degree)};
  g->param = SV_TAKE(arena, float, (size_t)g->cap *(size_t)g->n_rows);
  if (arena->status < 0) return arena->status;
  if (g->param) memset(g->param, 0, (size_t)g->cap * (size_t)g->n_rows * sizeof(float));
  return SV_OK;
}

sv_status sv_gaussians_check(const sv_gaussians *g, sv_err *err) {
  for (int i = 0; i < g->n; i++)
    for (int r = 0; r < g->n_rows; r++) {
      const float x = *sv_gaussians_at(g, i, r);
      if (x >= -FLT_MAX && x <= FLT_MAX) continue;
      return sv_fail(err, SV_E_RANGE,
                     "the model is not saved: Gaussian %d has a value that is not finite; check the scene's "
                     "bounds, the poses and the lens models of the source",
                     i);
    }
  return SV_OK;
}

size_t sv_gaussians_bytes(int n, int sh_degree) {
  sv_arena dry = sv_arena_dry();
  sv_gaussians g;
  return sv_gaussians_init(&g, n, sh_degree, &dry) == SV_OK ? dry.used_bytes : 0;
}

void sv_gaussians_put(sv_gaussians *g, int i, const sv_gaussian *in) {
  float *p = sv_gaussians_at(g, i, 0);
  for (int k = 0; k < 3; k++) p[16 * (SV_ROW_MEAN + k)] = in->mean[k];
  for (int k = 0; k < 4; k++) p[16 * (SV_ROW_QUAT + k)] = in->quat_wxyz[k];
  for (int k = 0; k < 3; k++) p[16 * (SV_ROW_SCALE + k)] = in->log_scale[k];
  p[16 * SV_ROW_LOGIT] = in->opacity_logit;
  for (int k = 0; k < g->n_rows - SV_ROW_SH; k++) p[16 * (SV_ROW_SH + k)] = in->sh[k / 3][k % 3];
}

void sv_gaussians_get(const sv_gaussians *g, int i, sv_gaussian *out) {
  const float *p = sv_gaussians_at(g, i, 0);
  memset(out, 0, sizeof *out);
  for (int k = 0; k < 3; k++) out->mean[k] = p[16 * (SV_ROW_MEAN + k)];
  for (int k = 0; k < 4; k++) out->quat_wxyz[k] = p[16 * (SV_ROW_QUAT + k)];
  for (int k = 0; k < 3; k++) out->log_scale[k] = p[16 * (SV_ROW_SCALE + k)];
  out->opacity_logit = p[16 * SV_ROW_LOGIT];
  for (int k = 0; k < g->n_rows - SV_ROW_SH; k++) out->sh[k / 3][k % 3] = p[16 * (SV_ROW_SH + k)];
}

// A uniform point of the unit ball (r = U^(1/3)) or of the cube [-1,1]^3, by rejection-free draws.
static void random_point(sv_rng *rng, sv_init_kind kind, float out[3]) {
  if (kind == SV_INIT_CUBE) {
    for (int k = 0; k < 3; k++) out[k] = 2.0f * sv_rng_f(rng) - 1.0f;
    return;
  }
  double d[3], n;
  do {
    for (int k = 0; k < 3; k++) d[k] = sv_rng_normal(rng);
    n = sv_norm3(d);
  } while (!(n > 1e-6));
  double r = sv_pow((double)sv_rng_f(rng) + 1e-9, 1.0 / 3.0) / n;
  for (int k = 0; k < 3; k++) out[k] = (float)(d[k] * r);
}

// Chooses the point of each Gaussian: a random subset, or every point several times.
static void choose_points(sv_rng *rng, int *pick, int n, int *order, int n_points) {
  for (int i = 0; i < n_points; i++) order[i] = i;
  for (int i = 0; i < n; i++) {
    int k = i % n_points;
    if (k == 0 || i < n_points) { // a fresh shuffle of what has not been taken in this round
      int j = k + (int)sv_rng_below(rng, (uint32_t)(n_points - k)), t = order[k];
      order[k] = order[j];
      order[j] = t;
    }
    pick[i] = order[k];
  }
}

// Scratch of a fill.
typedef struct {
  float *xyz;   // [n][3] means
  float *dist2; // [n] mean squared distance of the nearest neighbours
  int *pick;    // [n] the point of each Gaussian
  int *order;   // [n_points] their shuffle
} fill_scratch;

static fill_scratch carve_scratch(sv_arena *a, int n, int n_points) {
  fill_scratch f;
  f.xyz = SV_TAKE(a, float, 3 * (size_t)n);
  f.dist2 = SV_TAKE(a, float, (size_t)n);
  f.pick = SV_TAKE(a, int, (size_t)n);
  f.order = SV_TAKE(a, int, (size_t)n_points);
  return f;
}

size_t sv_init_scratch_bytes(int n_gaussians, int n_points) {
  sv_arena dry = sv_arena_dry();
  (void)carve_scratch(&dry, n_gaussians, n_points);
  return dry.used_bytes + sv_neighbours_bytes(n_gaussians);
}

static void place(const sv_init_cfg *cfg, const sv_point *point, int n_points, int n, const fill_scratch *f) {
  float *xyz = f->xyz;
  sv_rng rng = sv_rng_make(cfg->seed, 1);
  if (cfg->kind == SV_INIT_POINTS) choose_points(&rng, f->pick, n, f->order, n_points);
  for (int i = 0; i < n; i++) {
    if (cfg->kind == SV_INIT_POINTS) {
      // Copies of a point must not coincide: spread them by a hundredth of the scene, training does
      // the rest.
      for (int k = 0; k < 3; k++)
        xyz[3 * i + k] =
            point[f->pick[i]].mean[k] + (i < n_points ? 0.0f : 0.01f * cfg->radius * sv_rng_normal(&rng));
    } else {
      random_point(&rng, cfg->kind, xyz + 3 * i);
      for (int k = 0; k < 3; k++) xyz[3 * i + k] = cfg->centre[k] + cfg->radius * xyz[3 * i + k];
    }
  }
}

// Of a Gaussian at the start, from its neighbors' distance: what is far beyond the scene may be as
// large as it looks.
static double largest(const sv_init_cfg *cfg, const float at[3]) {
  double e[3];
  for (int k = 0; k < 3; k++) e[k] = (double)at[k] - (double)cfg->centre[k];
  const double d = sv_norm3(e), radius = (double)cfg->radius;
  return d > (double)SV_REACH_RADII * radius ? 0.1 * d : 0.1 * radius;
}

sv_status sv_gaussians_fill(sv_gaussians *g, const sv_init_cfg *cfg, const sv_point *point, int n_points,
                            sv_arena *scratch) {
  if (cfg->kind == SV_INIT_POINTS && n_points < 1) return SV_E_ARG;
  if (!(cfg->opacity > 0 && cfg->opacity < 1) || !(cfg->radius > 0) || !(cfg->scale_factor > 0))
    return SV_E_ARG;
  size_t mark = sv_arena_mark(scratch);
  const fill_scratch f = carve_scratch(scratch, g->n, cfg->kind == SV_INIT_POINTS ? n_points : 0);
  sv_status s = scratch->status < 0 ? SV_E_NOMEM : SV_OK;
  if (s == SV_OK) {
    place(cfg, point, n_points, g->n, &f);
    s = sv_neighbours(f.xyz, g->n, f.dist2, scratch);
  }
  float logit = (float)sv_log((double)cfg->opacity / (1.0 - (double)cfg->opacity));
  for (int i = 0; s == SV_OK && i < g->n; i++) {
    double d = sqrt(f.dist2[i] > 1e-14f ? (double)f.dist2[i] : 1e-14), max = largest(cfg, f.xyz + 3 * i);
    sv_gaussian v = {.quat_wxyz = {1, 0, 0, 0}, .opacity_logit = logit};
    float scale = (float)sv_log((d < max ? d : max) * (double)cfg->scale_factor);
    for (int k = 0; k < 3; k++) {
      v.mean[k] = f.xyz[3 * i + k];
      v.log_scale[k] = scale;
      if (cfg->kind == SV_INIT_POINTS) v.sh[0][k] = (point[f.pick[i]].rgb[k] - 0.5f) / (float)SV_SH_C0;
    }
    sv_gaussians_put(g, i, &v);
  }
  sv_arena_reset(scratch, mark);
  return s;
}

static void sift_median(float *a, int n, int k) { // quickselect: a[k] becomes the k-th smallest
  int lo = 0, hi = n - 1;
  while (lo < hi) {
    float pivot = a[lo + (hi - lo) / 2];
    int i = lo, j = hi;
    while (i <= j) {
      while (a[i] < pivot) i++;
      while (a[j] > pivot) j--;
      if (i > j) break;
      float t = a[i];
      a[i++] = a[j];
      a[j--] = t;
    }
    if (k <= j) hi = j;
    else if (k >= i) lo = i;
    else return;
  }
}

float sv_gaussians_radius(const sv_gaussians *g, sv_arena *scratch, float centre[3]) {
  double c[3] = {0, 0, 0};
  size_t mark = sv_arena_mark(scratch);
  float *d = SV_TAKE(scratch, float, (size_t)g->n), r = 1.0f;
  for (int i = 0; i < g->n; i++)
    for (int k = 0; k < 3; k++) c[k] += (double)*sv_gaussians_at(g, i, k) / g->n;
  for (int k = 0; k < 3; k++) centre[k] = (float)c[k];
  if (d) {
    for (int i = 0; i < g->n; i++) {
      double e[3];
      for (int k = 0; k < 3; k++) e[k] = (double)*sv_gaussians_at(g, i, k) - c[k];
      d[i] = (float)sv_norm3(e);
    }
    sift_median(d, g->n, g->n / 2);
    r = sv_maxf(1.5f * d[g->n / 2], 1e-6f);
  }
  sv_arena_reset(scratch, mark);
  return r;
}
