// SPDX-License-Identifier: Apache-2.0
// What moves: a Gaussian whose residual changes with time, in any of the cameras, moves from now
// on; one whose motion is below the static thresholds comes to rest. Moving Gaussians are kept
// first.
#include "src/dynamic/search.h"

#include <math.h>
#include <string.h>

#include "src/base/mathx.h"
#include "src/dynamic/bodies.h"
#include "src/dynamic/curriculum.h"
#include "src/train/mask.h"
#include "src/train/optimize.h"
#include "src/train/step.h"

// --- who moves -----------------------------------------------------------------------------------

// Pixels per world unit at a place, in the view that sees it largest.
static float rate_at(const sv_dynamic *dyn, const float x[3]) {
  float most = 0;
  for (int i = 0; i < dyn->t->n_views; i++) {
    const sv_view *v = &dyn->t->views[i].view;
    const float z =
        v->fisheye ? sv_view_distance(v, x) : v->r[6] * x[0] + v->r[7] * x[1] + v->r[8] * x[2] + v->t[2];
    if (z > 0 && v->fx / z > most) most = v->fx / z;
  }
  return most;
}

static bool is_worth_it(const sv_dynamic *dyn, int i) {
  if (dyn->deform.kind != SV_DEFORM_CLIP) return true; // a field does not tell before it is asked
  const sv_dynamic_cfg *d = &dyn->cfg;
  const float *p = sv_gaussians_at(&dyn->t->g, i, SV_ROW_MEAN), x[3] = {p[0], p[16], p[32]};
  sv_motion_extent e = sv_motion_extent_of(&dyn->deform.motion, i);
  return e.distance * rate_at(dyn, x) > d->static_px || e.fade > d->static_fade ||
         e.colour > d->static_colour;
}

static void swap_f(float *a, float *b) {
  float s = *a;
  *a = *b;
  *b = s;
}

static void swap_h(uint16_t *a, uint16_t *b) {
  uint16_t s = *a;
  *a = *b;
  *b = s;
}

static void swap_b(uint8_t *a, uint8_t *b) {
  uint8_t s = *a;
  *a = *b;
  *b = s;
}

static void swap_slots(sv_dynamic *dyn, int i, int j) {
  long a = sv_gaussians_at(&dyn->t->g, i, 0) - dyn->t->g.param,
       b = sv_gaussians_at(&dyn->t->g, j, 0) - dyn->t->g.param;
  for (int r = 0; r < dyn->t->g.n_rows; r++) {
    swap_f(dyn->t->g.param + a + 16 * r, dyn->t->g.param + b + 16 * r);
    swap_h(dyn->t->m + a + 16 * r, dyn->t->m + b + 16 * r);
    swap_h(dyn->t->v + a + 16 * r, dyn->t->v + b + 16 * r);
  }
  for (int k = 0; k < 3 && dyn->t->cross; k++)
    swap_h(sv_train_cross_at(dyn->t, i) + 16 * k, sv_train_cross_at(dyn->t, j) + 16 * k);
  swap_f(dyn->t->err + i, dyn->t->err + j);
  if (dyn->t->floor) swap_f(dyn->t->floor + i, dyn->t->floor + j);
  if (dyn->deform.kind == SV_DEFORM_CLIP) sv_motion_swap(&dyn->deform.motion, i, j);
  swap_b(dyn->is_moving + i, dyn->is_moving + j);
  swap_b(dyn->hidden_for + i, dyn->hidden_for + j);
}

void sv_dynamic_sort(sv_dynamic *dyn) {
  for (int i = 0; i < dyn->t->g.n; i++) {
    if (dyn->is_moving[i] == 1 && !is_worth_it(dyn, i)) dyn->is_moving[i] = 0;
    if (dyn->is_moving[i] == 2) dyn->is_moving[i] = 1;
    if (!dyn->is_moving[i] && dyn->deform.kind == SV_DEFORM_CLIP) sv_motion_still(&dyn->deform.motion, i);
  }
  int n = 0, j = dyn->t->g.n - 1;
  for (;;) {
    while (n <= j && dyn->is_moving[n]) n++;
    while (j > n && !dyn->is_moving[j]) j--;
    if (n >= j) break;
    swap_slots(dyn, n, j);
  }
  sv_deform_set_moving(&dyn->deform, n);
}

// --- what moves ----------------------------------------------------------------------------------

#define HALF_SIZE 0.99f // of the progress at which full size is reached

static int scale_at(const sv_dynamic *dyn, const sv_view *view, float progress) {
  return sv_train_scale_at(dyn->t, view, progress, sv_dynamic_min_scale(dyn, view->time, progress));
}

sv_status sv_dynamic_residual(sv_dynamic *dyn, int i_view, float progress) {
  const sv_train_view *tv = &dyn->t->views[i_view];
  sv_render_options o = sv_train_render_options(dyn->t, progress, dyn->assignment != NULL);
  const int scale =
      sv_maxi(scale_at(dyn, &tv->view, progress), scale_at(dyn, &tv->view, HALF_SIZE * dyn->t->cfg.fine_at));
  sv_view view = sv_view_scaled(&tv->view, scale);
  sv_train_set_time(dyn->t, tv->view.time);
  sv_train_load_image(dyn->t, &tv->image, scale, o.bg, &dyn->t->target);
  sv_status s = sv_render(&dyn->t->render, &dyn->t->g, &view, &o);
  if (s < 0) return s;
  sv_train_mask_copy(dyn->t, &tv->image, scale, &dyn->t->render.rgb, &dyn->t->target);
  sv_photometric_loss(&dyn->t->photometric, &dyn->t->render.rgb, &dyn->t->target, &dyn->t->grad,
                      dyn->t->err_plane, 0.0f);
  return SV_OK;
}

typedef struct {
  sv_dynamic *dyn;
  float *sum;
  int n_blocks;
} share_job;

#define BLOCKS_PER_TASK 64

static void share_task(void *arg, int i_task, int i_thread) {
  const share_job *j = arg;
  sv_dynamic *dyn = j->dyn;
  float *grad = dyn->t->block + (size_t)i_thread * SV_TRAIN_BLOCK_FLOATS, err[16];
  int b1 = sv_mini((i_task + 1) * BLOCKS_PER_TASK, j->n_blocks);
  for (int b = i_task * BLOCKS_PER_TASK; b < b1; b++) {
    (void)sv_render_bwd_block(&dyn->t->render, b, i_thread, NULL, &(sv_block_grads){grad, err, NULL});
    for (int k = 0; k < 16; k++) j->sum[16 * b + k] += err[k];
  }
}

static sv_status share_out(sv_dynamic *dyn, const float *plane, float *sum) {
  share_job j = {.dyn = dyn, .sum = sum, .n_blocks = (dyn->t->g.n + 15) / 16};
  sv_status s = sv_render_bwd(&dyn->t->render, &dyn->t->grad, NULL, NULL, plane);
  if (s >= 0)
    sv_pool_run(dyn->t->compute.pool, share_task, &j, (j.n_blocks + BLOCKS_PER_TASK - 1) / BLOCKS_PER_TASK);
  return s;
}

void sv_dynamic_clear_shares(sv_dynamic *dyn) {
  for (int i = 0; i < dyn->t->g.cap; i++) dyn->share[i] = dyn->residual[i] = 0.0f;
}

sv_status sv_dynamic_share_residual(sv_dynamic *dyn) {
  float *one = dyn->t->target.c[0]; // the target is free for reuse
  for (size_t p = 0; p < sv_plane_floats(dyn->t->grad.width_px, dyn->t->grad.height_px); p++) one[p] = 1.0f;
  sv_status s = share_out(dyn, one, dyn->share);
  if (s >= 0) s = share_out(dyn, dyn->t->err_plane, dyn->residual);
  sv_planes_clear(&dyn->t->target);
  return s;
}

static sv_status look_at(sv_dynamic *dyn, int i_view, float progress) {
  sv_status s = sv_dynamic_residual(dyn, i_view, progress);
  sv_dynamic_clear_shares(dyn);
  if (s >= 0) sv_dynamic_compare_assignment(dyn, i_view);
  if (s >= 0) s = sv_dynamic_share_residual(dyn);
  for (int i = 0; i < dyn->t->g.n && s >= 0; i++) {
    if (!(dyn->share[i] > SV_DYNAMIC_SHARE_MIN)) continue;
    float x = dyn->residual[i] / dyn->share[i], d = x - dyn->residual_mean[i]; // Welford's update
    dyn->n_seen[i] += 1.0f;
    dyn->residual_mean[i] += d / dyn->n_seen[i];
    dyn->residual_dev[i] += d * (x - dyn->residual_mean[i]);
  }
  return s;
}

static void end_camera(sv_dynamic *dyn) {
  for (int i = 0; i < dyn->t->g.n; i++) {
    if (dyn->n_seen[i] > 2.5f)
      dyn->temporal_residual[i] =
          sv_maxf(dyn->temporal_residual[i], sqrtf(dyn->residual_dev[i] / dyn->n_seen[i]));
    dyn->n_seen[i] = dyn->residual_mean[i] = dyn->residual_dev[i] = 0.0f;
  }
}

sv_status sv_dynamic_search(sv_dynamic *dyn, float progress) {
  if (dyn->deform.kind == SV_DEFORM_FIELD && dyn->field_step == 0)
    sv_field_reset(&dyn->deform.field, &dyn->t->g, dyn->t->cfg.seed); // the box is that of now
  int n_cameras = 1;
  for (int i = 0; i < dyn->t->n_views; i++)
    n_cameras = sv_maxi(n_cameras, dyn->t->views[i].view.i_sub_view + 1);
  for (int i = 0; i < dyn->t->g.cap; i++)
    dyn->temporal_residual[i] = dyn->n_seen[i] = dyn->residual_mean[i] = dyn->residual_dev[i] = 0.0f;
  sv_dynamic_begin_assignment(dyn);
  for (int c = 0; c < n_cameras; c++) {
    for (int i = 0; i < dyn->t->n_views; i++) {
      if (sv_maxi(dyn->t->views[i].view.i_sub_view, 0) != c) continue;
      if (!sv_dynamic_has_time(dyn, dyn->t->views[i].view.time, progress)) continue;
      sv_status s = look_at(dyn, i, progress);
      if (s < 0) return s;
    }
    end_camera(dyn);
  }
  sv_dynamic_end_assignment(dyn);
  for (int i = 0; i < dyn->t->g.n; i++) {
    if (dyn->is_moving[i] || !(dyn->temporal_residual[i] > dyn->cfg.residual_min)) continue;
    dyn->is_moving[i] = 2; // from now on; what has moved before has to be worth it
    if (dyn->deform.kind == SV_DEFORM_CLIP) sv_motion_rest(&dyn->deform.motion, i);
  }
  sv_dynamic_sort(dyn);
  return SV_OK;
}
