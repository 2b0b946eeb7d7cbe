// SPDX-License-Identifier: Apache-2.0
#include "src/splat/support.h"

#include <math.h>
#include <string.h>

#include "src/base/mathx.h"
#include "src/base/vec.h"
#include "src/splat/constants.h"

#define BLOCKS_PER_TASK 32
#define BLOCK_FLOATS    ((SV_CAP_ROWS + 1) * 16) // gradients that nobody reads, weights
#define FAINT_LOGIT     -2.944f                  // opacity 0.05

static void carve(sv_support *s, int n, int n_threads, sv_arena *a) {
  s->seen = SV_TAKE(a, uint64_t, n);
  s->weight = SV_TAKE(a, float, n);
  s->alone = SV_TAKE(a, float, n);
  s->block = SV_TAKE(a, float, (size_t)n_threads *BLOCK_FLOATS);
}

size_t sv_support_bytes(int n_gaussians, int n_threads) {
  sv_arena dry = sv_arena_dry();
  sv_support s;
  carve(&s, n_gaussians, n_threads, &dry);
  return dry.used_bytes;
}

sv_status sv_support_init(sv_support *s, int n_gaussians, int n_threads, sv_arena *arena) {
  memset(s, 0, sizeof *s);
  s->n = n_gaussians;
  carve(s, n_gaussians, n_threads, arena);
  if (arena->status < 0) return arena->status;
  memset(s->seen, 0, (size_t)n_gaussians * sizeof *s->seen);
  return SV_OK;
}

int sv_support_n_asked(int n_views) { return sv_mini(n_views, SV_SUPPORT_VIEWS); }

int sv_support_asked(int n_views, int k) { return (int)((long)k * n_views / sv_support_n_asked(n_views)); }

// --- one view ------------------------------------------------------------------------------------

void sv_support_begin(sv_support *s, const sv_view *view, int exposure) {
  float *eye = s->eye[s->n_views];
  for (int c = 0; c < 3; c++)
    eye[c] = -(view->r[c] * view->t[0] + view->r[3 + c] * view->t[1] + view->r[6 + c] * view->t[2]);
  s->exposure[s->n_views] = exposure;
  memset(s->weight, 0, (size_t)s->n * sizeof *s->weight);
  memset(s->alone, 0, (size_t)s->n * sizeof *s->alone);
}

// The splat's sum of alpha over all pixels. Powers are of 2: its quadratic form is -ln 2 times that
// of the exponent, so that det S2^-1 = (ln 2)^2 (4 qa qc - qb^2).
static float alone(const sv_splat *s) {
  const float det = 4.0f * s->qa * s->qc - s->qb * s->qb;
  const float o = (float)sv_exp((double)(s->lo + SV_POWER_SHIFT) * 0.6931471805599453);
  if (!(det > 0.0f)) return 0.0f;
  return (float)(2 * SV_PI / 0.6931471805599453) * (o - 1.0f / 255.0f) / sqrtf(det);
}

typedef struct {
  sv_support *s;
  const sv_renderer *r;
  int n_blocks;
} job;

static void weigh_task(void *arg, int i_task, int i_thread) {
  const job *j = arg;
  sv_support *s = j->s;
  float *grad = s->block + (size_t)i_thread * BLOCK_FLOATS, *weight = grad + SV_CAP_ROWS * 16;
  const int end = sv_mini((i_task + 1) * BLOCKS_PER_TASK, j->n_blocks);
  for (int b = i_task * BLOCKS_PER_TASK; b < end; b++) {
    uint32_t touched = sv_render_bwd_block(j->r, b, i_thread, NULL, &(sv_block_grads){grad, weight, NULL});
    for (; touched; touched &= touched - 1) {
      const int k = __builtin_ctz(touched), i = 16 * b + k;
      if (i >= s->n) break;
      s->weight[i] += weight[k];
      s->alone[i] = alone(&j->r->splat[i]);
    }
  }
}

sv_status sv_support_add(sv_support *s, sv_renderer *r, const sv_support_planes *p) {
  const sv_planes *size = &r->rgb;
  const int w = size->width_px, h = size->height_px;
  sv_planes_set_size(p->zero, w, h);
  sv_planes_clear(p->zero);
  memset(p->one, 0, sv_plane_floats(w, h) * sizeof *p->one);
  for (int y = 0; y < h; y++)
    for (int x = 0; x < w; x++) p->one[(size_t)y * (size_t)size->stride + (size_t)x] = 1.0f;
  sv_status st = sv_render_bwd(r, p->zero, NULL, NULL, p->one);
  if (st < 0) return st;
  job j = {s, r, (s->n + 15) / 16};
  sv_pool_run(r->compute.pool, weigh_task, &j, (j.n_blocks + BLOCKS_PER_TASK - 1) / BLOCKS_PER_TASK);
  return SV_OK;
}

void sv_support_end(sv_support *s) {
  const uint64_t bit = (uint64_t)1 << s->n_views++;
  for (int i = 0; i < s->n; i++)
    if (s->weight[i] > 0.0f && s->weight[i] >= SV_SUPPORT_SHARE * s->alone[i]) s->seen[i] |= bit;
}

// --- all views -----------------------------------------------------------------------------------

sv_support_value sv_support_of(const sv_support *s, const sv_gaussians *g, int i) {
  sv_support_value v = {0};
  float way[SV_SUPPORT_VIEWS][3], least = 1.0f;
  int32_t exposure[SV_SUPPORT_VIEWS];
  for (uint64_t left = s->seen[i]; left; left &= left - 1) {
    const int k = __builtin_ctzll(left);
    float *to = way[v.n_views], square = 0.0f;
    bool is_new = true;
    for (int c = 0; c < 3; c++) {
      to[c] = s->eye[k][c] - *sv_gaussians_at(g, i, SV_ROW_MEAN + c);
      square += to[c] * to[c];
    }
    const float inverse = square > 0.0f ? 1.0f / sqrtf(square) : 0.0f;
    for (int c = 0; c < 3; c++) to[c] *= inverse;
    for (int m = 0; m < v.n_views; m++) {
      is_new &= s->exposure[k] < 0 || exposure[m] != s->exposure[k];
      const float *at = way[m];
      least = sv_minf(least, at[0] * to[0] + at[1] * to[1] + at[2] * to[2]);
    }
    exposure[v.n_views++] = s->exposure[k];
    v.n_exposures += is_new;
  }
  v.angle_deg = sv_acos((double)sv_clampf(least, -1.0f, 1.0f)) * 180 / SV_PI;
  return v;
}

double sv_support_score(const sv_support_value *v) { return sv_mind(v->angle_deg / SV_SUPPORT_DEG, 1); }

sv_support_summary sv_support_sum_up(const sv_support *s, const sv_gaussians *g) {
  sv_support_summary m = {.n_views = s->n_views};
  int n = 0, n_unseen = 0, n_one = 0;
  for (int i = 0; i < s->n; i++) {
    if (*sv_gaussians_at(g, i, SV_ROW_LOGIT) < FAINT_LOGIT) continue;
    const sv_support_value v = sv_support_of(s, g, i);
    n++;
    n_unseen += v.n_views == 0;
    n_one += v.n_views == 1;
    m.angle_deg += v.angle_deg;
    m.supported += sv_support_score(&v);
  }
  if (n == 0) return m;
  m.unseen = (double)n_unseen / n;
  m.one_view = (double)n_one / n;
  m.angle_deg /= n;
  m.supported /= n;
  return m;
}
