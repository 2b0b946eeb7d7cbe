// SPDX-License-Identifier: Apache-2.0
#include "src/prior/views.h"

#include <string.h>

#include "src/base/mathx.h"
#include "src/loss/depth.h"
#include "src/train/novel.h"
#include "src/train/optimize.h"
#include "src/train/step.h"

#define BAND_ROWS 16

// An aligned map counts as much as the picture: what shapes a surface that one view sees is the map
// alone (docs/notes/few-exposures.md).
#define ALIGNED_FACTOR 60.0f

// --- views ---------------------------------------------------------------------------------------

sv_status sv_prior_request_views(sv_prior *prior, float turn_rad, int n, sv_view *out) {
  if (prior->t->n_views < 1) return SV_E_UNSUPPORTED;
  for (int i = 0; i < n; i++) {
    const sv_view *v = &prior->t->views[sv_rng_below(&prior->rng, (uint32_t)prior->t->n_views)].view;
    out[i] = sv_train_turned_view(prior->t, v, turn_rad, &prior->rng);
    out[i].i_exposure = out[i].i_sub_view = -1;
  }
  return SV_OK;
}

static sv_depth_input depth_input(const sv_prior *prior, bool is_inverse) {
  const sv_planes *p = &prior->t->render.rgb;
  return (sv_depth_input){.depth = prior->t->render.depth,
                          .trans = prior->t->render.trans,
                          .width_px = p->width_px,
                          .height_px = p->height_px,
                          .stride = p->stride,
                          .alpha_min = SV_PRIOR_ALPHA_MIN,
                          .is_inverse = is_inverse};
}

sv_status sv_prior_render(sv_prior *prior, const sv_view *view, float progress) {
  sv_render_options o = sv_train_render_options(prior->t, progress, true);
  sv_status s = sv_render(&prior->t->render, &prior->t->g, view, &o);
  if (s < 0) return s;
  sv_depth_input in = depth_input(prior, false);
  memset(prior->mask, 1, (size_t)in.height_px * (size_t)in.stride);
  sv_depth_expected(&in, prior->expected, prior->mask);
  return SV_OK;
}

int sv_prior_nearest(const sv_prior *prior, const sv_view *view) {
  float from[3], to[3];
  double best = -2, a[3], b[3];
  int i_best = 0;
  sv_view_centre(from, view);
  for (int k = 0; k < 3; k++) a[k] = (double)from[k] - (double)prior->t->centre[k];
  for (int i = 0; i < prior->t->n_views; i++) {
    sv_view_centre(to, &prior->t->views[i].view);
    double dot = 0;
    for (int k = 0; k < 3; k++) {
      b[k] = (double)to[k] - (double)prior->t->centre[k];
      dot += a[k] * b[k];
    }
    dot /= sv_norm3(a) * sv_norm3(b) + 1e-30;
    if (dot > best) {
      best = dot;
      i_best = i;
    }
  }
  return i_best;
}

// --- depth ---------------------------------------------------------------------------------------

const sv_prior_depth *sv_prior_depth_of(const sv_prior *prior, int id, const sv_view *full) {
  return prior->cfg.cap_depths > 0 ? sv_prior_find_depth(prior, id, full) : NULL;
}

// The map's middle sample of each block of scale x scale; what it does not know is masked out.
static void load_map(sv_prior *p, const sv_prior_depth *d, int scale, const sv_planes *size) {
  for (int y = 0; y < size->height_px; y++)
    for (int x = 0; x < size->width_px; x++) {
      const int sx = sv_mini(x * scale + scale / 2, d->width_px - 1),
                sy = sv_mini(y * scale + scale / 2, d->height_px - 1);
      const float v = d->map[(size_t)sy * (size_t)d->width_px + (size_t)sx];
      const size_t i = (size_t)y * (size_t)size->stride + (size_t)x;
      p->mask[i] = v >= 0.0f;
      p->target[i] = v >= 0.0f ? v : 0.0f;
    }
}

// Correlation over patches drawn at random, beside that of the whole picture (SparseGS).
static double patch_loss(sv_prior *prior, sv_pearson_input in) {
  sv_pearson_patch patches[SV_PRIOR_PATCHES];
  const int side = sv_maxi(4, (int)(prior->cfg.patch_side * (float)sv_maxi(in.width_px, in.height_px)));
  const int w = sv_mini(side, in.width_px), h = sv_mini(side, in.height_px);
  const float n = prior->cfg.patch_share * (float)(in.width_px * in.height_px) / (float)(w * h);
  in.n_patches = sv_clampi((int)(n + 0.5f), 1, SV_PRIOR_PATCHES);
  for (int i = 0; i < in.n_patches; i++) {
    sv_pearson_patch *q = &patches[i];
    q->x0 = (int)sv_rng_below(&prior->rng, (uint32_t)(in.width_px - w + 1));
    q->y0 = (int)sv_rng_below(&prior->rng, (uint32_t)(in.height_px - h + 1));
    q->x1 = q->x0 + w;
    q->y1 = q->y0 + h;
  }
  in.patches = patches;
  in.weight *= prior->cfg.patch_weight;
  return sv_pearson_loss(&prior->pearson, &in, prior->g_expected);
}

double sv_prior_depth_loss(sv_prior *prior, const sv_prior_depth *d, int scale, float weight) {
  const sv_planes *size = &prior->t->render.rgb;
  const bool is_aligned = d->kind == SV_PRIOR_ALIGNED;
  sv_depth_input in = depth_input(prior, d->kind == SV_PRIOR_INVERSE || is_aligned);
  weight *= d->weight;
  if (is_aligned) weight *= ALIGNED_FACTOR * d->trust;
  load_map(prior, d, scale, size);
  sv_depth_expected(&in, prior->expected, prior->mask);
  memset(prior->g_expected, 0, (size_t)size->rows_padded * (size_t)size->stride * sizeof *prior->g_expected);
  const sv_pearson_input pearson = {.depth = prior->expected,
                                    .prior = prior->target,
                                    .mask = prior->mask,
                                    .width_px = size->width_px,
                                    .height_px = size->height_px,
                                    .stride = size->stride,
                                    .weight = weight};
  const sv_depth_pair in_units = {.depth = prior->expected,
                                  .prior = prior->target,
                                  .mask = prior->mask,
                                  .width_px = size->width_px,
                                  .height_px = size->height_px,
                                  .stride = size->stride,
                                  .unit = is_aligned ? d->unit : prior->t->radius,
                                  .weight = weight};
  const bool has_units = d->kind == SV_PRIOR_METRIC || is_aligned;
  double loss = has_units ? sv_depth_loss(&in_units, prior->g_expected)
                          : sv_pearson_loss(&prior->pearson, &pearson, prior->g_expected);
  if (!has_units && prior->cfg.patch_weight > 0.0f) loss += patch_loss(prior, pearson);
  sv_depth_expected_bwd(&in, prior->expected, prior->mask, prior->g_expected,
                        &(sv_depth_grad){prior->g_depth, prior->g_trans, size->rows_padded});
  prior->last_depth_loss = loss;
  return loss;
}

// --- pseudo-views --------------------------------------------------------------------------------

float sv_prior_depth_share(const sv_prior *prior, float progress) {
  const sv_prior_cfg *c = &prior->cfg;
  return c->method && progress > c->late_from ? c->late_factor : 1.0f;
}

bool sv_prior_is_due(const sv_prior *prior, float progress) {
  const sv_prior_cfg *c = &prior->cfg;
  return c->cap_pseudo > 0 && prior->t->step % (uint32_t)c->every == 0 &&
         sv_prior_n_alive(prior, progress) > 0;
}

static const sv_prior_view *choose(sv_prior *p, float progress) {
  uint32_t turn = sv_rng_below(&p->rng, (uint32_t)sv_prior_n_alive(p, progress));
  int i = 0;
  for (;; i++) {
    if (p->views[i].id <= 0 || p->views[i].until <= progress) continue;
    if (turn-- == 0) return &p->views[i];
  }
}

typedef struct {
  sv_prior *prior;
  const sv_prior_view *v;
  int scale;
} load_job;

// The picture at 1/scale; where it does not count, the rendering stands in for it, so that there is
// nothing to learn.
static void load_rows(void *arg, int i_task, int i_thread) {
  const load_job *j = arg;
  sv_prior *prior = j->prior;
  const sv_planes *x = &prior->t->render.rgb;
  const int k = j->scale, y1 = sv_mini((i_task + 1) * BAND_ROWS, x->height_px);
  (void)i_thread;
  for (int y = i_task * BAND_ROWS; y < y1; y++)
    for (int col = 0; col < x->width_px; col++) {
      uint32_t sum[4] = {0};
      for (int i = 0; i < k * k; i++) {
        const size_t row = (size_t)(y * k + i / k) * (size_t)j->v->view.width_px;
        const uint8_t *px = j->v->rgba + 4 * (row + (size_t)(col * k + i % k));
        for (int c = 0; c < 3; c++) sum[c] += (uint32_t)px[c] * px[3];
        sum[3] += px[3];
      }
      const size_t at = (size_t)y * (size_t)x->stride + (size_t)col;
      const float share = (float)sum[3] / (255.0f * (float)(k * k));
      prior->share[at] = share;
      for (int c = 0; c < 3; c++) {
        const float seen = sum[3] ? (float)sum[c] / (255.0f * (float)sum[3]) : 0.0f, now = x->c[c][at];
        prior->t->target.c[c][at] = now + share * (seen - now);
      }
    }
}

static void weigh_gradient(sv_prior *prior, float weight) {
  const sv_planes *g = &prior->t->grad;
  for (int y = 0; y < g->height_px; y++)
    for (int x = 0; x < g->width_px; x++) {
      const size_t at = (size_t)y * (size_t)g->stride + (size_t)x;
      const float w = weight * prior->share[at];
      for (int c = 0; c < 3; c++) g->c[c][at] *= w;
    }
}

sv_status sv_prior_step(sv_prior *prior, float progress, const sv_render_options *o, double *loss) {
  const sv_prior_view *v = choose(prior, progress);
  const sv_prior_depth *d = sv_prior_depth_of(prior, v->id, &v->view);
  const int scale = sv_train_scale_at(prior->t, &v->view, progress, 1);
  sv_view view = sv_view_scaled(&v->view, scale);
  sv_render_options with = *o;
  with.has_depth = d != NULL;
  sv_status s = sv_render(&prior->t->render, &prior->t->g, &view, &with);
  if (s < 0) return s;
  load_job j = {prior, v, scale};
  sv_train_size_images(prior->t, view.width_px, view.height_px);
  sv_pool_run(prior->t->compute.pool, load_rows, &j, (view.height_px + BAND_ROWS - 1) / BAND_ROWS);
  *loss += (double)v->weight * sv_photometric_loss(&prior->t->photometric, &prior->t->render.rgb,
                                                   &prior->t->target, &prior->t->grad, NULL,
                                                   prior->t->cfg.weight_ssim)
                                   .loss;
  weigh_gradient(prior, v->weight);
  if (d) *loss += sv_prior_depth_loss(prior, d, scale, sv_prior_depth_share(prior, progress));
  s = sv_render_bwd(&prior->t->render, &prior->t->grad, d ? prior->g_depth : NULL, d ? prior->g_trans : NULL,
                    NULL);
  if (s >= 0) sv_train_collect(prior->t, NULL, false);
  return s;
}
