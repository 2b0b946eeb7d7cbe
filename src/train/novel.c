// SPDX-License-Identifier: Apache-2.0
#include "src/train/novel.h"

#include "src/base/mathx.h"
#include "src/loss/reproject.h"
#include "src/train/optimize.h"
#include "src/train/surface.h"

bool sv_train_is_novel_beside(const sv_train_cfg *c) {
  return c->n_novel > 0 && (c->weight_smooth_novel > 0.0f || c->weight_reproject_novel > 0.0f);
}

static bool is_turn(const sv_trainer *t) {
  return t->cfg.n_novel > 0 && t->step % (uint32_t)t->cfg.novel_every == 0;
}

bool sv_train_has_novel(const sv_trainer *t, const sv_train_image *im) {
  return is_turn(t) && sv_train_is_novel_beside(&t->cfg) && im->scale == 1 && !im->is_supersampled &&
         !t->cfg.is_deep; // smooth depth finds no edges in dark light
}

bool sv_train_is_novel_due(const sv_trainer *t, const sv_train_image *im) {
  return sv_train_is_novel_beside(&t->cfg) ? im->has_novel : is_turn(t) && t->cfg.weight_tv_novel > 0.0f;
}

static sv_view random_view(sv_trainer *t) {
  int n = t->n_views;
  for (int i = 0; i < t->n_measurements; i++) n += t->measurements[i].model.n_lenses;
  int v = (int)sv_rng_below(&t->rng, (uint32_t)n);
  if (v < t->n_views) return t->views[v].view;
  v -= t->n_views;
  int i = 0;
  for (; v >= t->measurements[i].model.n_lenses; i++) v -= t->measurements[i].model.n_lenses;
  return t->measurements[i].model.lenses[v].view;
}

sv_view sv_train_turned_view(const sv_trainer *t, const sv_view *v, float rad, sv_rng *rng) {
  sv_view out = *v;
  double axis[3], q[4], turn[9], norm;
  do {
    for (int i = 0; i < 3; i++) axis[i] = 2.0 * (double)sv_rng_f(rng) - 1.0;
    norm = sv_norm3(axis);
  } while (norm > 1.0 || norm < 0.1); // uniform on the sphere
  double half = 0.5 * (double)rad * (double)sv_rng_f(rng), s = sv_sin(half) / norm;
  q[0] = sv_cos(half);
  q[1] = s * axis[0];
  q[2] = s * axis[1];
  q[3] = s * axis[2];
  sv_quat_to_mat(turn, q);
  // The camera goes round with the world: R' = R Q, and the scene's centre keeps its place in the
  // picture.
  for (int i = 0; i < 3; i++) {
    double at = (double)v->t[i];
    for (int k = 0; k < 3; k++) {
      double r = 0;
      for (int j = 0; j < 3; j++) r += (double)v->r[3 * i + j] * turn[3 * j + k];
      out.r[3 * i + k] = (float)r;
      at += ((double)v->r[3 * i + k] - r) * (double)t->centre[k];
    }
    out.t[i] = (float)at;
  }
  return out;
}

sv_view sv_train_novel_view(sv_trainer *t) {
  sv_view v = random_view(t), out = sv_train_turned_view(t, &v, t->cfg.novel_rad, &t->rng);
  int side = sv_maxi(v.width_px, v.height_px);
  return sv_view_scaled(&out, (side + t->cfg.novel_px - 1) / t->cfg.novel_px);
}

// How far a view beside the step's own is turned at most: as far as the views go, and as far again.
// Farther off, no picture shows the surface.
static float most_rad(const sv_trainer *t, const sv_view *v) {
  double from[3], most = 0;
  float c[3];
  sv_view_centre(c, v);
  for (int k = 0; k < 3; k++) from[k] = (double)c[k] - (double)t->centre[k];
  for (int i = 0; i < t->n_views; i++) {
    double to[3];
    sv_view_centre(c, &t->views[i].view);
    for (int k = 0; k < 3; k++) to[k] = (double)c[k] - (double)t->centre[k];
    const double angle = sv_angle_between(from, to);
    if (angle > most) most = angle;
  }
  return sv_minf(t->cfg.novel_rad, 2.0f * (float)most);
}

// Of the novel view that is rendered, beside the image, whose depth is in part_err.
static double depth_losses(sv_trainer *t, const sv_train_image *im, const sv_view *view, float share) {
  const sv_planes *x = &t->render.rgb;
  const float *bg = im->options.bg;
  const double loss = sv_train_smooth_loss(t, t->render.rgb.c, share * t->cfg.weight_smooth_novel);
  if (!sv_train_has_same_colours(t) || im->has_target) return loss;
  const sv_reproject_input in = {.inverse = t->smooth.inverse,
                                 .colour = {x->c[0], x->c[1], x->c[2]},
                                 .width_px = x->width_px,
                                 .height_px = x->height_px,
                                 .stride = x->stride,
                                 .view = view,
                                 .partner = &im->view,
                                 .image = &t->views[im->i_view].image,
                                 .bg = {bg[0], bg[1], bg[2]},
                                 .n_px = (long)x->width_px * x->height_px,
                                 .weight = share * t->cfg.weight_reproject_novel};
  return loss +
         sv_reproject_colours(&in, t->part_err, x->stride, t->compute.pool, t->smooth.band, t->part_grad.c);
}

sv_status sv_train_novel_step(sv_trainer *t, const sv_train_image *im, const sv_render_options *o,
                              double *loss) {
  const float share = 1.0f / (float)t->cfg.n_novel;
  const bool is_beside = im->has_novel;
  const sv_render_options *options = is_beside ? &im->options : o;
  const float *g_depth = is_beside ? t->smooth.g_depth : NULL,
              *g_trans = is_beside ? t->smooth.g_trans : NULL;
  if (is_beside) sv_render_expected_depth(&t->render, SV_SURFACE_ALPHA_MIN, t->part_err);
  for (int i = 0; i < t->cfg.n_novel; i++) {
    const sv_view view = is_beside ? sv_train_turned_view(t, &im->view, most_rad(t, &im->view), &t->rng)
                                   : sv_train_novel_view(t);
    sv_status s = sv_render(&t->render, &t->g, &view, options);
    if (s < 0) return s;
    sv_planes_set_size(&t->part_grad, view.width_px, view.height_px);
    sv_planes_clear(&t->part_grad);
    if (t->cfg.weight_tv_novel > 0.0f)
      *loss +=
          sv_tv_loss(&t->tv, &t->render.rgb, &t->part_grad, SV_TV_SQUARED, share * t->cfg.weight_tv_novel);
    if (is_beside) *loss += depth_losses(t, im, &view, share);
    if ((s = sv_render_bwd(&t->render, &t->part_grad, g_depth, g_trans, NULL)) < 0) return s;
    sv_train_collect(t, NULL, false);
  }
  return SV_OK;
}
