// SPDX-License-Identifier: Apache-2.0
#include "src/train/surface.h"

#include "src/loss/reproject.h"

// A surface asks the same in each step: one of eight with eight times the weight gives the same
// model for 4 % more time of a run instead of 60 % (docs/notes/few-exposures.md).
#define EVERY       8
#define PARTNER_KEY 0x9d2cu

bool sv_train_is_surface_due(const sv_trainer *t, const sv_train_image *im) {
  // Depth has one value a pixel: with several samples, late in the run, it is no longer needed.
  return t->cfg.weight_smooth > 0.0f && t->step % EVERY == 0 && !im->options.has_depth &&
         !im->is_supersampled;
}

bool sv_train_has_same_colours(const sv_trainer *t) {
  return !t->cfg.is_rolling && !t->cfg.is_deep && t->cfg.appearance.n_cameras == 0;
}

// Another view of the same exposure, at random; -1: there is none that can be compared.
static int partner_of(const sv_trainer *t, int i_view) {
  const int exposure = t->views[i_view].view.i_exposure;
  int n = 0, i_partner = -1;
  if (!sv_train_has_same_colours(t)) return -1;
  for (int i = 0; i < t->n_views; i++) {
    if (i == i_view || t->views[i].view.i_exposure != exposure) continue;
    if (sv_hash3((uint32_t)t->cfg.seed, t->step, PARTNER_KEY + (uint32_t)i) % (uint32_t)++n == 0)
      i_partner = i;
  }
  return i_partner;
}

static double reproject(sv_trainer *t, const sv_train_image *im) {
  const sv_planes *x = &t->render.rgb, *target = &t->target;
  const int i = im->scale == 1 ? partner_of(t, im->i_view) : -1;
  const float *bg = im->options.bg;
  if (i < 0) return 0;
  const sv_reproject_input in = {.inverse = t->smooth.inverse,
                                 .depth = t->render.depth,
                                 .colour = {target->c[0], target->c[1], target->c[2]},
                                 .width_px = x->width_px,
                                 .height_px = x->height_px,
                                 .stride = x->stride,
                                 .view = &im->view,
                                 .partner = &t->views[i].view,
                                 .image = &t->views[i].image,
                                 .bg = {bg[0], bg[1], bg[2]},
                                 .n_px = t->smooth.n_px,
                                 .phase = (int)(t->step / EVERY % SV_REPROJECT_PHASES),
                                 .weight = t->cfg.weight_reproject * EVERY};
  return sv_reproject_loss(&in, t->compute.pool, t->smooth.band, t->smooth.g_depth, t->smooth.g_trans);
}

double sv_train_smooth_loss(sv_trainer *t, float *const colour[3], float weight) {
  const sv_planes *x = &t->render.rgb;
  const sv_smooth_input in = {.depth = t->render.depth,
                              .trans = t->render.trans,
                              .colour = {colour[0], colour[1], colour[2]},
                              .width_px = x->width_px,
                              .height_px = x->height_px,
                              .stride = x->stride,
                              .rows_padded = x->rows_padded,
                              .alpha_min = SV_SURFACE_ALPHA_MIN,
                              .weight = weight};
  return sv_smooth_loss(&t->smooth, &in);
}

double sv_train_surface_loss(sv_trainer *t, sv_train_image *im) {
  double loss = sv_train_smooth_loss(t, t->target.c, t->cfg.weight_smooth * EVERY);
  if (t->cfg.weight_reproject > 0.0f) loss += reproject(t, im);
  im->g_depth = t->smooth.g_depth;
  im->g_trans = t->smooth.g_trans;
  return loss;
}
