// SPDX-License-Identifier: Apache-2.0
#include <string.h>

#include "src/base/mathx.h"
#include "src/prior/methods.h"
#include "src/splat/constants.h"
#include "src/splat/neighbours.h"
#include "src/train/relocate.h"

#define WEAK 0.02f // a Gaussian of this opacity or less may be moved

typedef struct {
  float *xyz, *dist2, *score; // [n]
  int32_t *nearest, *index;   // [n][3]; [n] index of each point's Gaussian
} work;

static void carve(work *w, int n, sv_arena *a) {
  w->xyz = SV_TAKE(a, float, 3 * (size_t)n);
  w->dist2 = SV_TAKE(a, float, n);
  w->score = SV_TAKE(a, float, n);
  w->nearest = SV_TAKE(a, int32_t, 3 * (size_t)n);
  w->index = SV_TAKE(a, int32_t, n);
}

size_t sv_prior_unpool_bytes(int n) {
  sv_arena dry = sv_arena_dry();
  work w;
  carve(&w, n, &dry);
  return dry.used_bytes + sv_neighbours_bytes(n) + SV_ARENA_ALIGN;
}

static float logit_of(const sv_prior *prior, int i) {
  return *sv_gaussians_at(&prior->t->g, i, SV_ROW_LOGIT);
}
static float logit(float o) { return (float)sv_log((double)o / (1.0 - (double)o)); }

// Mean distances to the neighbours into score, and their median.
static float find_scores(work *w, int n) {
  for (int i = 0; i < n; i++) {
    double sum = 0;
    for (int k = 0; k < 3; k++) {
      const float *a = w->xyz + 3 * i, *b = w->xyz + 3 * w->nearest[3 * i + k];
      const double d[3] = {(double)a[0] - (double)b[0], (double)a[1] - (double)b[1],
                           (double)a[2] - (double)b[2]};
      sum += sv_norm3(d);
    }
    w->score[i] = (float)(sum / 3);
  }
  memcpy(w->dist2, w->score, (size_t)n * sizeof *w->dist2);
  sv_prior_sort(w->dist2, n);
  return w->dist2[n / 2];
}

// The next Gaussian from *at on that may be moved: dead ones first, then weak ones. -1: no
// more.
static int next_free(const sv_prior *prior, const float below[2], int *at) {
  for (; *at < 2 * prior->t->g.n; (*at)++) {
    const float l = logit_of(prior, *at % prior->t->g.n);
    const int round = *at / prior->t->g.n;
    if (l <= below[round] && (round == 0 || l > below[0])) return (*at)++ % prior->t->g.n;
  }
  return -1;
}

static void place(sv_prior *prior, int to, int from, const float *a, const float *b) {
  sv_train_copy_slot(prior->t, to, from);
  float *p = sv_gaussians_at(&prior->t->g, to, 0);
  for (int k = 0; k < 3; k++) p[16 * k] = 0.5f * (a[k] + b[k]);
  for (int k = 0; k < 4; k++) p[16 * (SV_ROW_QUAT + k)] = k == 0 ? 1.0f : 0.0f;
  for (int k = SV_ROW_SH + 3; k < prior->t->g.n_rows; k++) p[16 * k] = 0.0f;
}

uint32_t sv_prior_unpool(sv_prior *prior) {
  const sv_prior_cfg *c = &prior->cfg;
  const float below[2] = {logit(SV_OPACITY_DEAD), logit(WEAK)};
  sv_arena *a = prior->scratch;
  const size_t mark = sv_arena_mark(a);
  work w;
  int n = 0, at = 0, to = 0;
  uint32_t n_new = 0, most = (uint32_t)(c->unpool_share * (float)prior->t->g.n);
  carve(&w, prior->t->g.n, a);
  for (int i = 0; i < prior->t->g.n; i++) {
    if (logit_of(prior, i) <= below[1]) continue; // what may go is nobody's neighbour
    for (int k = 0; k < 3; k++) w.xyz[3 * n + k] = *sv_gaussians_at(&prior->t->g, i, k);
    w.index[n++] = i;
  }
  if (n < 5 || sv_neighbours_find(w.xyz, n, w.dist2, w.nearest, a) < 0) {
    sv_arena_reset(a, mark);
    return 0;
  }
  const float beyond = c->unpool_distance * find_scores(&w, n);
  // in index order when there are too few
  const int first = (int)sv_rng_below(&prior->rng, (uint32_t)n);
  for (int j = 0; j < n && n_new < most && to >= 0; j++) {
    const int i = (first + j) % n;
    for (int k = 0; k < 3 && w.score[i] > beyond && n_new < most; k++) {
      const int to_point = w.nearest[3 * i + k];
      if ((to = next_free(prior, below, &at)) < 0) break;
      place(prior, to, w.index[to_point], w.xyz + 3 * i, w.xyz + 3 * to_point);
      n_new++;
    }
  }
  sv_arena_reset(a, mark);
  prior->n_unpooled += (int)n_new;
  return n_new;
}
