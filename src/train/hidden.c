// SPDX-License-Identifier: Apache-2.0
#include "src/train/hidden.h"

#include <string.h>

#include "src/base/mathx.h"
#include "src/splat/constants.h"
#include "src/splat/support.h"
#include "src/train/relocate.h"
#include "src/train/rolling.h"
#include "src/train/step.h"

#define GAUSSIANS_PER_TASK 512
#define OPAQUE             0.9f // alpha of a surface that hides what lies behind it
// Of the scene's radius, that a Gaussian must lie behind the surface. What lies closer fills the
// body of things, which holes would show through.
#define BEHIND 0.5f

enum { IN_VIEW = 1, NOT_HIDDEN = 2 };

bool sv_train_is_hidden_due(const sv_trainer *t, float progress) {
  return t->cfg.hidden_every > 0 && t->step % (uint32_t)t->cfg.hidden_every == 0 && t->n_views > 0 &&
         sv_train_is_relocation_due(t, progress);
}

typedef struct {
  const sv_trainer *t;
  const sv_view *view;
  float behind;
} job;

static void judge(const job *j, int i) {
  const sv_renderer *r = &j->t->render;
  const sv_view *v = j->view;
  const float *p = sv_gaussians_at(&j->t->g, i, SV_ROW_MEAN);
  float x[3], px[2], depth;
  for (int k = 0; k < 3; k++)
    x[k] = v->r[3 * k] * p[0] + v->r[3 * k + 1] * p[16] + v->r[3 * k + 2] * p[32] + v->t[k];
  if (!sv_view_project(v, x, px, &depth)) return;
  if (!(px[0] >= 0 && px[1] >= 0 && px[0] < (float)v->width_px && px[1] < (float)v->height_px)) return;
  const size_t at = (size_t)px[1] * (size_t)r->rgb.stride + (size_t)px[0];
  const float alpha = 1.0f - r->trans[at];
  const bool is_hidden = alpha >= OPAQUE && depth - r->depth[at] / alpha > j->behind;
  j->t->relocation.copies[i] |= is_hidden ? IN_VIEW : IN_VIEW | NOT_HIDDEN;
}

static void judge_task(void *arg, int i_task, int i_thread) {
  const job *j = arg;
  const int end = sv_mini((i_task + 1) * GAUSSIANS_PER_TASK, j->t->g.n);
  (void)i_thread;
  for (int i = i_task * GAUSSIANS_PER_TASK; i < end; i++) judge(j, i);
}

// A background far beyond the scene is behind things, and is seen beside them from elsewhere.
static bool is_background(const sv_trainer *t, int i) {
  const float reach = SV_REACH_RADII * t->radius;
  float square = 0.0f;
  for (int k = 0; k < 3; k++) {
    const float d = *sv_gaussians_at(&t->g, i, SV_ROW_MEAN + k) - t->centre[k];
    square += d * d;
  }
  return square > reach * reach;
}

sv_status sv_train_prune_hidden(sv_trainer *t, int *n) {
  const sv_render_options o = sv_train_render_options(t, 1.0f, true);
  const float dead = (float)sv_log((double)SV_OPACITY_DEAD / 2);
  int32_t *flags = t->relocation.copies; // free between two relocations
  memset(flags, 0, (size_t)t->g.n * sizeof *flags);
  *n = 0;
  for (int k = 0; k < sv_support_n_asked(t->n_views); k++) {
    const int i = sv_support_asked(t->n_views, k);
    const job j = {t, &t->views[i].view, BEHIND * t->radius};
    sv_train_roll(t, i, j.view, o.near_z);
    const sv_status s = sv_render(&t->render, &t->g, j.view, &o);
    sv_train_unroll(t);
    if (s < 0) return s;
    sv_pool_run(t->compute.pool, judge_task, (void *)(uintptr_t)&j,
                (t->g.n + GAUSSIANS_PER_TASK - 1) / GAUSSIANS_PER_TASK);
  }
  for (int i = 0; i < t->g.n; i++) {
    if (flags[i] != IN_VIEW || is_background(t, i)) continue;
    *sv_gaussians_at(&t->g, i, SV_ROW_LOGIT) = dead;
    (*n)++;
  }
  return SV_OK;
}
