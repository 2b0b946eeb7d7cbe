// SPDX-License-Identifier: Apache-2.0
#include "tools/train/support_mask.h"

#include <stdlib.h>
#include <string.h>

#define SUPPORTED 0.5f // of a pixel's weight
#define SH_C0     0.28209479177387814

struct lab_support_mask {
  lab_viewer viewer;
  sv_gaussians scores; // the model, in the color of its scores
  void *block;
  sv_render_options options;
};

// --- support -------------------------------------------------------------------------------------

static sv_status open_views(lab_views *v, const lab_eval_job *job, const lab_source *train, sv_err *err) {
  lab_source src = *train;
  src.split = "train";
  sv_status s = lab_views_open(v, &src, &job->session->pool, err);
  if (s != SV_E_NOT_FOUND) return s;
  src.is_multiplexed = true; // lenses of one sensor need not have images of their own
  return lab_views_open(v, &src, &job->session->pool, err);
}

static sv_status ask_views(sv_support *out, const lab_eval_job *job, const lab_views *v, float *weight,
                           sv_err *err) {
  const sv_renderer_cfg cfg = {.cap_gaussians = job->g->n,
                               .cap_width_px = v->cap_width_px,
                               .cap_height_px = v->cap_height_px,
                               .cap_pixels = v->cap_floats,
                               .has_grad = true};
  lab_viewer viewer = {0};
  sv_planes zero = {0};
  sv_render_options o = job->render;
  o.has_depth = false;
  float *planes = malloc(4 * v->cap_floats * sizeof *planes);
  sv_status s = planes ? SV_OK : sv_fail(err, SV_E_NOMEM, "no memory for an image");
  if (s == SV_OK) s = lab_viewer_start(&viewer, job->session, cfg, err);
  for (size_t c = 0; planes && c < 3; c++) zero.c[c] = planes + c * v->cap_floats;
  const sv_support_planes p = {&zero, planes + 3 * v->cap_floats};
  for (int k = 0; s == SV_OK && k < sv_support_n_asked(v->n); k++) {
    const lab_frame *f = &v->frames[sv_support_asked(v->n, k)];
    sv_support_begin(out, &f->view, f->f.exposure);
    sv_status st = sv_render(&viewer.r, job->g, &f->view, &o);
    if (st == SV_OK) st = sv_support_add(out, &viewer.r, &p);
    if (st < 0) s = sv_fail(err, st, "a training view cannot be rendered: %s", sv_status_text(st));
    if (weight) memcpy(weight + (size_t)k * (size_t)out->n, out->weight, (size_t)out->n * sizeof *weight);
    sv_support_end(out);
  }
  lab_viewer_stop(&viewer);
  free(planes);
  return s;
}

sv_status lab_support_measure(sv_support *out, void **block, const lab_eval_job *job, const lab_source *train,
                              float *weight, sv_err *err) {
  lab_views v = {0};
  const int n = job->g->n, n_threads = job->session->n_threads;
  const size_t bytes = sv_support_bytes(n, n_threads) + SV_ARENA_ALIGN;
  *block = malloc(bytes);
  if (!*block) return sv_fail(err, SV_E_NOMEM, "no memory for the support of %d Gaussians", n);
  sv_arena a = sv_arena_make(*block, bytes);
  sv_status s = sv_support_init(out, n, n_threads, &a);
  if (s < 0) return sv_fail(err, s, "the support of %d Gaussians: %s", n, sv_status_text(s));
  s = open_views(&v, job, train, err);
  if (s == SV_OK) s = ask_views(out, job, &v, weight, err);
  lab_views_free(&v);
  return s;
}

// --- masks ---------------------------------------------------------------------------------------

static sv_status paint(lab_support_mask *m, const sv_support *support, const sv_gaussians *g, sv_err *err) {
  const size_t bytes = sv_gaussians_bytes(g->n, 0) + SV_ARENA_ALIGN;
  m->block = malloc(bytes);
  if (!m->block) return sv_fail(err, SV_E_NOMEM, "no memory for the support of %d Gaussians", g->n);
  sv_arena a = sv_arena_make(m->block, bytes);
  sv_status s = sv_gaussians_init(&m->scores, g->n, 0, &a);
  if (s < 0) return sv_fail(err, s, "the support of %d Gaussians: %s", g->n, sv_status_text(s));
  for (int i = 0; i < g->n; i++) {
    sv_gaussian v;
    const sv_support_value value = sv_support_of(support, g, i);
    sv_gaussians_get(g, i, &v);
    for (int c = 0; c < 3; c++) v.sh[0][c] = (float)((sv_support_score(&value) - 0.5) / SH_C0);
    sv_gaussians_put(&m->scores, i, &v);
  }
  return SV_OK;
}

sv_status lab_support_mask_open(lab_support_mask **out, const lab_eval_job *job, const lab_views *v,
                                const lab_source *train, sv_err *err) {
  sv_support support;
  void *block = NULL;
  if (lab_moves(&job->motion))
    return sv_fail(err, SV_E_UNSUPPORTED, "--mask supported is for models that stand still");
  lab_support_mask *m = *out = calloc(1, sizeof *m);
  if (!m) return sv_fail(err, SV_E_NOMEM, "no memory for masks");
  m->options = job->render;
  m->options.sh_degree = 0;
  m->options.has_depth = false;
  for (int c = 0; c < 3; c++) m->options.bg[c] = 0;
  sv_status s = lab_support_measure(&support, &block, job, train, NULL, err);
  if (s == SV_OK) s = paint(m, &support, job->g, err);
  free(block);
  if (s != SV_OK) return s;
  return lab_viewer_start(&m->viewer, job->session,
                          (sv_renderer_cfg){.cap_gaussians = job->g->n,
                                            .cap_width_px = v->cap_width_px,
                                            .cap_height_px = v->cap_height_px,
                                            .cap_pixels = v->cap_floats},
                          err);
}

void lab_support_mask_close(lab_support_mask *m) {
  if (!m) return;
  lab_viewer_stop(&m->viewer);
  free(m->block);
  free(m);
}

sv_status lab_support_mask_make(lab_support_mask *m, const sv_view *view, uint8_t *mask, sv_err *err) {
  const sv_planes *p = &m->viewer.r.rgb;
  const sv_status s = sv_render(&m->viewer.r, &m->scores, view, &m->options);
  if (s < 0) return sv_fail(err, s, "support cannot be rendered: %s", sv_status_text(s));
  for (int y = 0; y < view->height_px; y++)
    for (int x = 0; x < view->width_px; x++)
      *mask++ = p->c[0][(size_t)y * (size_t)p->stride + (size_t)x] >= SUPPORTED;
  return SV_OK;
}
