// SPDX-License-Identifier: Apache-2.0
#include "src/train/novel.h"

#include "src/base/mathx.h"
#include "src/train/optimize.h"

bool sv_train_is_novel_due(const sv_trainer *t) {
  return t->cfg.n_novel > 0 && t->cfg.weight_tv_novel > 0.0f && t->step % (uint32_t)t->cfg.novel_every == 0;
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

sv_status sv_train_novel_step(sv_trainer *t, const sv_render_options *o, double *loss) {
  for (int i = 0; i < t->cfg.n_novel; i++) {
    sv_view view = sv_train_novel_view(t);
    sv_status s = sv_render(&t->render, &t->g, &view, o);
    if (s < 0) return s;
    sv_planes_set_size(&t->part_grad, view.width_px, view.height_px);
    sv_planes_clear(&t->part_grad);
    *loss += sv_tv_loss(&t->tv, &t->render.rgb, &t->part_grad, SV_TV_SQUARED,
                        t->cfg.weight_tv_novel / (float)t->cfg.n_novel);
    if ((s = sv_render_bwd(&t->render, &t->part_grad, NULL, NULL, NULL)) < 0) return s;
    sv_train_collect(t, NULL, false);
  }
  return SV_OK;
}
