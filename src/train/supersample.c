// SPDX-License-Identifier: Apache-2.0
// A pixel measures the mean over its area. Rendered once per pixel, splats that are smaller than
// one are blurred to its size first and laid over each other then, which is not the same: where
// several meet, the background shines through, and edges move. Four samples a pixel bring training
// pictures closer to that mean than any low-pass does.
#include "src/train/supersample.h"

#include <string.h>

#define SAMPLES 2 // of a pixel, along each side

static size_t samples_px(size_t px) { return SAMPLES * SAMPLES * px; }

sv_renderer_cfg sv_train_renderer_cfg(const sv_train_cfg *c) {
  const int k = c->is_supersampled ? SAMPLES : 1;
  size_t px = c->cap_pixels ? c->cap_pixels : sv_plane_floats(c->cap_width_px, c->cap_height_px);
  return (sv_renderer_cfg){.cap_gaussians = c->n_gaussians,
                           .cap_width_px = k * c->cap_width_px,
                           .cap_height_px = k * c->cap_height_px,
                           .cap_pixels = (size_t)(k * k) * px,
                           .cap_intersections = c->cap_intersections,
                           .n_threads = c->n_threads,
                           .has_grad = true};
}

void sv_train_supersample_carve(sv_supersample *s, size_t px, sv_arena *a) {
  sv_arena_part_begin(a, "supersampling");
  for (int c = 0; c < 3; c++) s->mean.c[c] = SV_TAKE(a, float, px);
  for (int c = 0; c < 3; c++) s->grad.c[c] = SV_TAKE(a, float, samples_px(px));
  s->err = SV_TAKE(a, float, samples_px(px));
}

bool sv_train_is_supersampled(const sv_trainer *t, int scale, float progress) {
  return t->cfg.is_supersampled && scale == 1 && progress >= t->cfg.supersample_from;
}

// Of gradients the padding must stay 0.
static void size(sv_planes *p, int w, int h) {
  if (p->width_px == w && p->height_px == h) return;
  sv_planes_set_size(p, w, h);
  sv_planes_clear(p);
}

typedef struct {
  sv_trainer *t;
  const sv_planes *grad; // backward
  const float *err;
} job;

static void mean_task(void *arg, int i_channel, int i_thread) {
  const sv_trainer *t = ((job *)arg)->t;
  const sv_planes *from = &t->render.rgb, *to = &t->supersample.mean;
  (void)i_thread;
  t->compute.k->half(&(sv_resize_args){.src = from->c[i_channel],
                                       .src_width_px = from->width_px,
                                       .src_height_px = from->height_px,
                                       .src_stride = from->stride,
                                       .dst = to->c[i_channel],
                                       .dst_width_px = to->width_px,
                                       .dst_height_px = to->height_px,
                                       .dst_stride = to->stride,
                                       .row1 = to->height_px});
}

sv_status sv_train_supersample(sv_trainer *t, const sv_view *view, const sv_render_options *o) {
  sv_supersample *s = &t->supersample;
  const sv_view fine = sv_view_enlarged(view, SAMPLES);
  if (samples_px(sv_plane_floats(view->width_px, view->height_px)) > t->render.cfg.cap_pixels)
    return SV_E_RANGE;
  sv_status st = sv_render(&t->render, &t->g, &fine, o);
  if (st < 0) return st;
  size(&s->mean, view->width_px, view->height_px);
  if (s->grad.width_px != fine.width_px || s->grad.height_px != fine.height_px)
    memset(s->err, 0, sv_plane_floats(fine.width_px, fine.height_px) * sizeof *s->err);
  size(&s->grad, fine.width_px, fine.height_px);
  sv_pool_run(t->compute.pool, mean_task, &(job){.t = t}, 3);
  return SV_OK;
}

sv_status sv_train_measure(sv_trainer *t, const sv_view *view, const sv_render_options *o,
                           bool is_supersampled, const sv_planes **out) {
  *out = is_supersampled ? &t->supersample.mean : &t->render.rgb;
  return is_supersampled ? sv_train_supersample(t, view, o) : sv_render(&t->render, &t->g, view, o);
}

// Three channels of the gradient, then the error, which a Gaussian gets in the same shares.
static void spread_task(void *arg, int i_plane, int i_thread) {
  const job *j = arg;
  sv_trainer *t = j->t;
  const sv_planes *from = j->grad, *to = &t->supersample.grad;
  (void)i_thread;
  t->compute.k->half_bwd(&(sv_half_bwd_args){.grad = i_plane < 3 ? from->c[i_plane] : j->err,
                                             .width_px = from->width_px,
                                             .stride = from->stride,
                                             .src_grad = i_plane < 3 ? to->c[i_plane] : t->supersample.err,
                                             .src_stride = to->stride,
                                             .row1 = from->height_px});
}

const sv_planes *sv_train_spread(sv_trainer *t, const sv_planes *grad, const float *err) {
  sv_pool_run(t->compute.pool, spread_task, &(job){t, grad, err}, err ? 4 : 3);
  return &t->supersample.grad;
}

sv_status sv_train_supersample_bwd(sv_trainer *t, const sv_planes *grad, const float *err) {
  const sv_planes *spread = sv_train_spread(t, grad, err);
  return sv_render_bwd(&t->render, spread, NULL, NULL, err ? t->supersample.err : NULL);
}
