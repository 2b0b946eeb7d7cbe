// SPDX-License-Identifier: Apache-2.0
#include <string.h>

#include "src/base/mathx.h"
#include "src/prior/methods.h"
#include "src/prior/views.h"
#include "src/splat/constants.h"

#define SAMPLES   4096 // of a view, for the dip and the percentile
#define SHARPNESS 7.5  // SparseGS: percentile 98 exp(-7.5 dip), at least 80
#define MAX_Q     98.0
#define MIN_Q     80.0
#define NEAR_2    (-5.7707802f) // log2 of e^-4: a Gaussian covers a pixel where its falloff is more

#define BEFORE 0.95f // of the surface's depth: a floater

typedef struct {
  float *sample; // [SAMPLES] ascending
  int32_t *hull; // [2][SAMPLES]
} work;

static void carve(work *w, sv_arena *a) {
  w->sample = SV_TAKE(a, float, SAMPLES);
  w->hull = SV_TAKE(a, int32_t, 2 * SAMPLES);
}

size_t sv_prior_prune_bytes(int n_gaussians) {
  sv_arena dry = sv_arena_dry();
  work w;
  (void)n_gaussians;
  carve(&w, &dry);
  return dry.used_bytes;
}

// --- one pixel -----------------------------------------------------------------------------------

typedef struct {
  float power, falloff; // log2 of opacity x falloff; log2 of the falloff alone
} pair;

static pair evaluate(const sv_splat *s, float x, float y) {
  const float dx = s->u_px - x, dy = s->v_px - y;
  pair p;
  p.falloff = fmaf(fmaf(s->qa, dx, s->qb * dy), dx, s->qc * dy * dy);
  p.power = p.falloff + s->lo + SV_POWER_SHIFT;
  return p;
}

// Front to back through the intersections of a pixel's tile, as the rasterizer does, to the
// Gaussian of the largest weight. Returns its place in the list, -1 when there is none; *z its
// depth. Rare and slow, so exp is the exact one.
static int find_mode(const sv_renderer *r, uint32_t begin, uint32_t end, float x, float y, float *z) {
  float trans = 1.0f, most = 0.0f;
  int mode = -1;
  for (uint32_t i = begin; i < end; i++) {
    const sv_splat *s = r->splat + r->intersection[r->list[i]].id;
    const pair p = evaluate(s, x, y);
    if (p.power < SV_LOG2_ALPHA_MIN) continue;
    const float a = sv_minf(SV_ALPHA_MAX, (float)sv_exp((double)p.power * 0.6931471805599453)), w = a * trans;
    if (w > most) {
      most = w;
      mode = (int)i;
      *z = s->z;
    }
    trans -= w;
    // nothing behind can weigh more, or the pixel has ended
    if (trans < most || trans < SV_T_MIN) break;
  }
  return mode;
}

static uint32_t tile_of(const sv_renderer *r, int x, int y) {
  return (uint32_t)(y / SV_TILE_PX * r->n_tiles_x + x / SV_TILE_PX);
}

// --- one view ------------------------------------------------------------------------------------

// The depth of the largest weight into prior.prior, 0 where there is no depth.
static void mode_task(void *arg, int i_tile, int i_thread) {
  sv_prior *prior = arg;
  sv_renderer *r = &prior->t->render;
  const int x0 = i_tile % r->n_tiles_x * SV_TILE_PX, y0 = i_tile / r->n_tiles_x * SV_TILE_PX;
  const int x1 = sv_mini(x0 + SV_TILE_PX, r->rgb.width_px), y1 = sv_mini(y0 + SV_TILE_PX, r->rgb.height_px);
  (void)i_thread;
  for (int y = y0; y < y1; y++)
    for (int x = x0; x < x1; x++) {
      const size_t at = (size_t)y * (size_t)r->rgb.stride + (size_t)x;
      float z = 0.0f;
      if (prior->mask[at])
        (void)find_mode(r, r->tile_begin[i_tile], r->tile_begin[i_tile + 1], (float)x + 0.5f, (float)y + 0.5f,
                        &z);
      prior->target[at] = z;
    }
}

// Relative differences into prior.share: (expected - mode) / (expected + floor), floor the least
// expected depth, or three standard deviations below the mean when that is more.
static void find_differences(sv_prior *prior) {
  const sv_planes *size = &prior->t->render.rgb;
  double n = 0, sum = 0, sum2 = 0, least = 1e30;
  for (int y = 0; y < size->height_px; y++)
    for (int x = 0; x < size->width_px; x++) {
      const size_t at = (size_t)y * (size_t)size->stride + (size_t)x;
      const double e = (double)prior->expected[at];
      if (!prior->mask[at]) continue;
      n++;
      sum += e;
      sum2 += e * e;
      least = sv_mind(least, e);
    }
  const double mean = n > 0 ? sum / n : 0, var = n > 0 ? sum2 / n - mean * mean : 0;
  const double floor = n > 0 ? sv_maxd(least, mean - 3 * sqrt(sv_maxd(var, 0))) : 0;
  for (int y = 0; y < size->height_px; y++)
    for (int x = 0; x < size->width_px; x++) {
      const size_t at = (size_t)y * (size_t)size->stride + (size_t)x;
      const float e = prior->expected[at];
      prior->share[at] =
          prior->mask[at] && prior->target[at] > 0.0f ? (e - prior->target[at]) / (e + (float)floor) : 0.0f;
    }
}

// Positive differences, evenly over the picture, in ascending order; how many.
static int take_samples(const sv_prior *prior, float *sample) {
  const sv_planes *size = &prior->t->render.rgb;
  const int n_px = size->width_px * size->height_px, every = n_px / SAMPLES + 1;
  int n = 0;
  for (int i = every / 2; i < n_px && n < SAMPLES; i += every) {
    const float d =
        prior->share[(size_t)(i / size->width_px) * (size_t)size->stride + (size_t)(i % size->width_px)];
    if (d > 0.0f) sample[n++] = d;
  }
  sv_prior_sort(sample, n);
  return n;
}

static sv_status score_view(sv_prior *prior, const work *w, int i_view, int *n_samples) {
  sv_status s = sv_prior_render(prior, &prior->t->views[i_view].view, 1.0f);
  if (s < 0) return s;
  sv_pool_run(prior->t->compute.pool, mode_task, prior, prior->t->render.n_tiles);
  find_differences(prior);
  *n_samples = take_samples(prior, w->sample);
  return SV_OK;
}

// Marks what lies before or at the largest weight of a pixel, nearer than a limit, and covers it.
static void mark_pixel(sv_prior *prior, int x, int y, float limit) {
  const sv_renderer *r = &prior->t->render;
  const uint32_t tile = tile_of(r, x, y), begin = r->tile_begin[tile];
  const float px = (float)x + 0.5f, py = (float)y + 0.5f;
  float z;
  const int mode = find_mode(r, begin, r->tile_begin[tile + 1], px, py, &z);
  for (int i = (int)begin; i <= mode; i++) {
    const uint32_t id = r->intersection[r->list[i]].id;
    const pair p = evaluate(r->splat + id, px, py);
    const bool covers = p.power >= SV_LOG2_ALPHA_MIN && p.falloff > NEAR_2;
    if (covers && r->splat[id].z < limit) prior->t->relocation.copies[id] = -1;
  }
}

// Depth before which a floater of this pixel lies: well before its surface, as a depth map has it.
static float limit_of(const sv_prior_depth *d, int x, int y) {
  const float v = d ? d->map[(size_t)y * (size_t)d->width_px + (size_t)x] : 0.0f;
  if (!d) return 1e30f;
  return v > 0.0f ? BEFORE * (d->kind == SV_PRIOR_ALIGNED ? 1.0f / v : v) : 0.0f;
}

static void mark_view(sv_prior *prior, const work *w, int i_view, int n, double percentile) {
  const sv_planes *size = &prior->t->render.rgb;
  const sv_prior_depth *d = sv_prior_find_depth(prior, i_view, &prior->t->views[i_view].view);
  if (d && (d->kind == SV_PRIOR_RELATIVE || d->kind == SV_PRIOR_INVERSE)) d = NULL;
  if (n < 1) return;
  const float beyond = w->sample[sv_mini(n - 1, (int)(percentile / 100 * n))];
  for (int y = 0; y < size->height_px; y++)
    for (int x = 0; x < size->width_px; x++) {
      const size_t at = (size_t)y * (size_t)size->stride + (size_t)x;
      if (prior->share[at] > beyond) mark_pixel(prior, x, y, limit_of(d, x, y));
    }
}

// --- all views -----------------------------------------------------------------------------------

sv_status sv_prior_prune(sv_prior *prior, uint32_t *n_pruned) {
  sv_arena *a = prior->scratch;
  const size_t mark = sv_arena_mark(a);
  sv_status s = SV_OK;
  double dip = 0;
  int n;
  work w;
  *n_pruned = 0;
  carve(&w, a);
  if (a->status < 0) return a->status;
  for (int i = 0; i < prior->t->n_views && s >= 0; i++)
    if ((s = score_view(prior, &w, i, &n)) >= 0) dip += sv_prior_dip(w.sample, n, w.hull) / prior->t->n_views;
  const double percentile = sv_maxd(MIN_Q, MAX_Q * sv_exp(-SHARPNESS * dip));
  // free between two relocations
  for (int i = 0; i < prior->t->g.n; i++) prior->t->relocation.copies[i] = 0;
  for (int i = 0; i < prior->t->n_views && s >= 0; i++)
    if ((s = score_view(prior, &w, i, &n)) >= 0) mark_view(prior, &w, i, n, percentile);
  for (int i = 0; i < prior->t->g.n && s >= 0; i++) {
    if (prior->t->relocation.copies[i] >= 0) continue;
    *sv_gaussians_at(&prior->t->g, i, SV_ROW_LOGIT) = (float)sv_log((double)SV_OPACITY_DEAD / 2);
    (*n_pruned)++;
  }
  sv_arena_reset(a, mark);
  prior->last_dip = dip;
  prior->n_pruned += (int)*n_pruned;
  return s;
}
