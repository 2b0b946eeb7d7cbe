// SPDX-License-Identifier: Apache-2.0
// One step: what is taken next, its picture as planes, the loss, and the way back.
#include <string.h>

#include "src/base/mathx.h"
#include "src/prior/methods.h"
#include "src/prior/views.h"
#include "src/splat/constants.h"
#include "src/dynamic/distil.h"

#define UNPACK_ROWS 16 // rows a task

// --- what is taken next --------------------------------------------------------------------------

int sv_train_scale_at(const sv_trainer *t, const sv_view *view, float progress) {
  int k = t->cfg.start_scale;
  if (k == 4 && progress >= 0.5f * t->cfg.fine_at) k = 2;
  if (progress >= t->cfg.fine_at) k = 1;
  k = sv_maxi(k, sv_train_new_time_scale(t, view->time, progress));
  // Below about 64 pixels a side there is nothing left to learn from.
  while (k > 1 && (view->width_px / k < 64 || view->height_px / k < 64)) k /= 2;
  return k;
}

// Views and regions are drawn without replacement; regions lie elsewhere in each epoch.
static int next_item(sv_trainer *t) {
  const int n = t->n_views + t->n_regions;
  if (t->i_order == 0) {
    for (int i = 0; i < n; i++) t->order[i] = i;
    for (int i = n - 1; i > 0; i--) {
      int j = (int)sv_rng_below(&t->rng, (uint32_t)i + 1), s = t->order[i];
      t->order[i] = t->order[j];
      t->order[j] = s;
    }
    for (int k = 0; k < 2 && t->n_regions > 0; k++) t->jitter[k] = sv_rng_f(&t->rng);
  }
  int i = t->order[t->i_order];
  t->i_order = (t->i_order + 1) % n;
  return i;
}

static bool is_newest_due(const sv_trainer *t) {
  const int every = t->cfg.dynamic.older_every;
  return every > 0 && t->n_views > 0 && t->step % (uint32_t)every != 0;
}

// One of the sub-views of the newest time, in turn.
static int newest_view(const sv_trainer *t) {
  int n = 0, k = 0;
  for (int i = 0; i < t->n_views; i++) n += t->views[i].view.time >= t->newest;
  if (n == 0) return 0; // its picture was replaced by an older one
  uint32_t turn = (t->step - t->step / (uint32_t)t->cfg.dynamic.older_every) % (uint32_t)n;
  while (t->views[k].view.time < t->newest || turn-- > 0) k++;
  return k;
}

// In clip mode now and then one of the views whose time came in last, on either side. -1: none is due. (A network that
// all times share would forget the others.)
static int front_view(sv_trainer *t, float progress) {
  const sv_dynamic_cfg *d = &t->cfg.dynamic;
  if (t->deform.kind != SV_DEFORM_CLIP || d->front_every < 1 || t->step % (uint32_t)d->front_every) return -1;
  if (progress < d->from || progress >= d->grow_until) return -1;
  float first = t->middle, last = t->middle;
  for (int i = 0; i < t->n_views; i++) {
    float time = t->views[i].view.time;
    if (!sv_train_has_time(t, time, progress)) continue;
    first = sv_minf(first, time), last = sv_maxf(last, time);
  }
  int n = 0, k = 0;
  for (int i = 0; i < t->n_views; i++) n += t->views[i].view.time == first || t->views[i].view.time == last;
  if (n == 0) return -1;
  int turn = (int)sv_rng_below(&t->rng, (uint32_t)n);
  while ((t->views[k].view.time != first && t->views[k].view.time != last) || turn-- > 0) k++;
  return k;
}

static bool is_passed_over(sv_trainer *t, int i, float progress) {
  if (i >= t->n_views || !sv_train_is_dynamic(t)) return false;
  if (!sv_train_has_time(t, t->views[i].view.time, progress)) return true;
  float share = sv_train_share(t, &t->views[i].view);
  return share < 1.0f && sv_rng_f(&t->rng) >= share;
}

static int choose_view(sv_trainer *t, float progress) {
  int i = is_newest_due(t) ? newest_view(t) : front_view(t, progress);
  if (i >= 0 && !is_passed_over(t, i, progress)) return i;
  do i = next_item(t);
  while (is_passed_over(t, i, progress));
  return i;
}

// Regions lie side by side and reach beyond the sensor by less than one; the jitter shares that out between the
// two ends, and the outer ones are pushed back onto the sensor.
static void span(int side, int n, int region_px, float jitter, int i, int *from, int *to) {
  int size = sv_mini(region_px, side), beyond = n * region_px - side;
  *from = sv_maxi(0, sv_mini(i * region_px - (int)(jitter * (float)beyond), side - size));
  *to = *from + size;
}

sv_region sv_train_region(const sv_trainer *t, const sv_train_measurement *c, int i) {
  sv_region r;
  span(c->model.width_px, c->n_x, t->cfg.region_px, t->jitter[0], i % c->n_x, &r.x0, &r.x1);
  span(c->model.height_px, c->n_y, t->cfg.region_px, t->jitter[1], i / c->n_x, &r.y0, &r.y1);
  return r;
}

// --- targets -------------------------------------------------------------------------------------

static void set_size(sv_planes *p, int w, int h) {
  p->width_px = w;
  p->height_px = h;
  p->stride = sv_plane_pad(w);
  p->rows_padded = sv_plane_pad(h);
}

void sv_train_size_target(sv_trainer *t, int w, int h) {
  if (t->grad.width_px == w && t->grad.height_px == h) return;
  set_size(&t->target, w, h);
  set_size(&t->grad, w, h);
  sv_planes_clear(&t->target);
  sv_planes_clear(&t->grad); // the padding must stay 0
  memset(t->err_plane, 0, sv_plane_floats(w, h) * sizeof(float));
}

typedef struct {
  const sv_trainer *t;
  sv_unpack_args a;
  int n_rows;
} unpack_job;

static void unpack_task(void *arg, int i_task, int i_thread) {
  unpack_job *j = arg;
  sv_unpack_args a = j->a;
  a.row0 = i_task * UNPACK_ROWS;
  a.row1 = sv_mini(a.row0 + UNPACK_ROWS, j->n_rows);
  a.scratch += (size_t)i_thread * SV_UNPACK_SCRATCH_FLOATS((size_t)j->t->cfg.cap_width_px);
  j->t->compute.k->unpack(&a);
}

// The sub-view's picture as planes at 1/scale, laid over the background.
void sv_train_load_target(sv_trainer *t, const sv_image_u8 *im, int scale, const float bg[3]) {
  int w = im->width_px / scale, h = im->height_px / scale;
  sv_train_size_target(t, w, h);
  unpack_job j = {.t = t,
                  .n_rows = h,
                  .a = {.src = im->px,
                        .src_stride_bytes = (size_t)im->stride_bytes,
                        .n_channels = im->n_channels,
                        .width_px = im->width_px,
                        .height_px = im->height_px,
                        .k = scale,
                        .bg = {bg[0], bg[1], bg[2]},
                        .dst = {t->target.c[0], t->target.c[1], t->target.c[2]},
                        .dst_stride = t->target.stride,
                        .scratch = t->unpack_scratch}};
  sv_pool_run(t->compute.pool, unpack_task, &j, (h + UNPACK_ROWS - 1) / UNPACK_ROWS);
}

static void load_region(sv_trainer *t, const sv_train_measurement *c, const sv_region *r) {
  const int w = r->x1 - r->x0, h = r->y1 - r->y0;
  sv_train_size_target(t, w, h);
  for (int y = 0; y < h; y++) {
    const uint16_t *src = c->px + 3 * ((size_t)(r->y0 + y) * (size_t)c->model.width_px + (size_t)r->x0);
    for (int k = 0; k < 3; k++) {
      float *dst = t->target.c[k] + (size_t)y * (size_t)t->target.stride;
      for (int x = 0; x < w; x++) dst[x] = (float)src[3 * x + k] * (1.0f / 65535.0f);
    }
  }
}

// --- steps ---------------------------------------------------------------------------------------

sv_render_options sv_train_render_options(const sv_trainer *t, float progress, bool has_depth) {
  sv_render_options o = {.sh_degree = t->cfg.sh_degree,
                         .near_z = SV_NEAR_FRACTION * t->radius,
                         .is_antialiased = t->cfg.is_antialiased,
                         .dilation_px2 = t->cfg.dilation_px2,
                         .has_depth = has_depth};
  if (t->cfg.sh_step > 0.0f) o.sh_degree = sv_mini(t->cfg.sh_degree, (int)(progress / t->cfg.sh_step));
  if (t->cfg.background == SV_BG_WHITE) o.bg[0] = o.bg[1] = o.bg[2] = 1.0f;
  return o;
}

static bool has_unseen(const sv_trainer *t) {
  return t->cfg.n_unseen > 0 && t->cfg.weight_tv_unseen > 0.0f &&
         t->step % (uint32_t)t->cfg.unseen_every == 0;
}

sv_status sv_train_residual(sv_trainer *t, int i_view, float progress) {
  const sv_train_view *tv = &t->views[i_view];
  sv_render_options o = sv_train_render_options(t, progress, t->member != NULL);
  int scale = sv_maxi(sv_train_scale_at(t, &tv->view, progress),
                      sv_train_scale_at(t, &tv->view, 0.99f * t->cfg.fine_at));
  sv_view view = sv_view_scaled(&tv->view, scale);
  sv_train_set_time(t, tv->view.time);
  sv_train_load_target(t, &tv->image, scale, o.bg);
  sv_status s = sv_render(&t->render, &t->g, &view, &o);
  if (s < 0) return s;
  sv_photometric_loss(&t->photometric, &t->render.rgb, &t->target, &t->grad, t->err_plane, 0.0f);
  return SV_OK;
}

// Where a step's errors go, if anybody will ask for them.
static float *errors_of(const sv_trainer *t, float progress) {
  return sv_train_is_error_due(t, progress) ? t->err_plane : NULL;
}

// Renders a sub-view and leaves its gradients in the renderer.
static sv_status view_step(sv_trainer *t, int i, float progress, sv_render_options o, sv_step_stats *out) {
  const sv_train_view *tv = &t->views[i];
  sv_photometric_value loss;
  out->scale = sv_train_scale_at(t, &tv->view, progress);
  sv_view view = sv_view_scaled(&tv->view, out->scale);
  if (t->cfg.background == SV_BG_RANDOM && tv->image.n_channels == 4)
    for (int c = 0; c < 3; c++) o.bg[c] = sv_rng_f(&t->rng);
  view.time = sv_train_lesson_time(t, tv->view.time);
  const bool is_lesson = view.time != tv->view.time;
  sv_render_options whole = o;
  whole.dropout = 0.0f; // what is learnt from
  sv_status s = is_lesson ? sv_train_load_lesson(t, &view, &whole) : SV_OK;
  if (s < 0) return s;
  if (!is_lesson) sv_train_load_target(t, &tv->image, out->scale, o.bg);
  sv_train_set_time(t, view.time);
  const bool is_fine = sv_train_is_supersampled(t, out->scale, progress);
  // Depth has one value a pixel: with several samples, late in the run, it has done its duty.
  const sv_prior_depth *depth = is_fine || is_lesson ? NULL : sv_prior_depth_of(t, i, &tv->view);
  o.has_depth = depth != NULL;
  const sv_planes *x;
  float *const errors = errors_of(t, progress);
  if ((s = sv_train_measure(t, &view, &o, is_fine, &x)) < 0) return s;
  loss = sv_photometric_loss(&t->photometric, x, &t->target, &t->grad, errors, t->cfg.weight_ssim);
  out->loss = loss.loss, out->l1 = loss.l1, out->ssim = loss.ssim;
  const float weight = sv_train_weight(t, &tv->view);
  sv_train_weigh(t, weight, errors);
  if (t->cfg.weight_tv > 0.0f) out->loss += sv_tv_loss(&t->tv, x, &t->grad, SV_TV_SQUARED, t->cfg.weight_tv);
  if (sv_train_is_probe_due(t)) {
    const double l1 = loss.l1 / (double)weight; // the squares are to have the weight once
    if ((s = sv_train_curvature(t, l1, is_fine)) < 0) return s;
  }
  if (is_fine) return sv_train_supersample_bwd(t, &t->grad, errors);
  if (!depth) return sv_render_bwd(&t->render, &t->grad, NULL, NULL, errors);
  out->loss += sv_prior_depth_loss(t, depth, out->scale, sv_prior_depth_share(t, progress));
  return sv_render_bwd(&t->render, &t->grad, t->prior.g_depth, t->prior.g_trans, errors);
}

sv_status sv_train_predict(sv_trainer *t, const sv_multiplexed *c, const sv_region *region,
                           const sv_render_options *o, int *last, size_t *n_px) {
  sv_crop crop;
  size_t sum_px = 0;
  if (last) *last = -1;
  sv_status s = sv_forward_begin(&t->forward, region);
  for (int m = 0; m < c->n_lenses && s >= 0; m++) {
    if (!sv_multiplexed_crop(c, m, region, &crop)) continue;
    if ((s = sv_render(&t->render, &t->g, &crop.view, o)) < 0) break;
    sv_forward_add(&t->forward, c, &crop, &t->render.rgb);
    if (last) *last = m;
    sum_px += (size_t)crop.view.width_px * (size_t)crop.view.height_px;
  }
  if (n_px) *n_px = sum_px;
  if (s >= 0) sv_forward_finish(&t->forward, c);
  return s;
}

// The curvature of a region's loss. *held: the lens whose part the renderer holds, before and after.
static sv_status probe_region(sv_trainer *t, const sv_multiplexed *c, const sv_region *region,
                              const sv_render_options *o, double l1, int *held) {
  sv_train_make_probe(t, l1);
  for (int m = *held; m >= 0; m--) {
    sv_crop crop;
    sv_status s = SV_OK;
    if (!sv_multiplexed_crop(c, m, region, &crop)) continue;
    if (m != *held && (s = sv_render(&t->render, &t->g, &crop.view, o)) < 0) return s;
    *held = m;
    sv_forward_bwd(&t->forward, c, &crop, &t->render.rgb, &t->target, NULL, &t->aux, NULL);
    if ((s = sv_render_bwd(&t->render, &t->aux, NULL, NULL, NULL)) < 0) return s;
    sv_train_collect_curvature(t);
  }
  sv_train_apply_curvature(t);
  return SV_OK;
}

// The crops are rendered twice: once for their sum, once for their gradients, so that one renderer is enough.
static sv_status region_step(sv_trainer *t, int i, float progress, const sv_render_options *o,
                             sv_step_stats *out) {
  int i_c = 0, last;
  size_t n_px;
  for (; i >= t->measurements[i_c].n_x * t->measurements[i_c].n_y; i_c++)
    i -= t->measurements[i_c].n_x * t->measurements[i_c].n_y;
  const sv_train_measurement *tc = &t->measurements[i_c];
  const sv_multiplexed *c = &tc->model;
  sv_region region = sv_train_region(t, tc, i);
  sv_photometric_value loss;
  t->forward.noise =
      (sv_forward_noise){t->cfg.noise_read, t->cfg.noise_shot, sv_hash3((uint32_t)t->cfg.seed, t->step, 0)};
  sv_status s = sv_train_predict(t, c, &region, o, &last, &n_px);
  if (s < 0 || last < 0) return s;
  t->forward.noise = (sv_forward_noise){0};
  load_region(t, tc, &region);
  float *const errors = errors_of(t, progress), *const crop_errors = errors ? t->aux_err : NULL;
  loss = sv_photometric_loss(&t->photometric, &t->forward.predicted, &t->target, &t->grad, errors,
                             t->cfg.weight_ssim);
  out->loss = loss.loss, out->l1 = loss.l1, out->ssim = loss.ssim;
  int held = last;
  if (sv_train_is_probe_due(t) && (s = probe_region(t, c, &region, o, loss.l1, &held)) < 0) return s;
  for (int m = last; m >= 0; m--) {
    sv_crop crop;
    if (!sv_multiplexed_crop(c, m, &region, &crop)) continue;
    if (m != held && (s = sv_render(&t->render, &t->g, &crop.view, o)) < 0) return s;
    held = m;
    sv_forward_bwd(&t->forward, c, &crop, &t->render.rgb, &t->grad, errors, &t->aux, crop_errors);
    float share = (float)((double)crop.view.width_px * (double)crop.view.height_px / (double)n_px);
    if (t->cfg.weight_tv > 0.0f)
      out->loss += sv_tv_loss(&t->tv, &t->render.rgb, &t->aux, SV_TV_SQUARED, t->cfg.weight_tv * share);
    s = sv_render_bwd(&t->render, &t->aux, NULL, NULL, crop_errors);
    if (s < 0) return s;
    sv_train_collect(t, 1.0f / c->max_overlap, true); // about M_max crops see a Gaussian
  }
  return SV_OK;
}

// --- unseen views --------------------------------------------------------------------------------

static sv_view any_view(sv_trainer *t) {
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
  q[0] = sv_cos(half), q[1] = s * axis[0], q[2] = s * axis[1], q[3] = s * axis[2];
  sv_quat_to_mat(turn, q);
  // The camera goes round with the world: R' = R Q, and the scene's centre keeps its place in the picture.
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

sv_view sv_train_unseen_view(sv_trainer *t) {
  sv_view v = any_view(t), out = sv_train_turned_view(t, &v, t->cfg.unseen_rad, &t->rng);
  int side = sv_maxi(v.width_px, v.height_px);
  return sv_view_scaled(&out, (side + t->cfg.unseen_px - 1) / t->cfg.unseen_px);
}

static sv_status smooth_unseen(sv_trainer *t, const sv_render_options *o, double *loss) {
  for (int i = 0; i < t->cfg.n_unseen; i++) {
    sv_view view = sv_train_unseen_view(t);
    sv_status s = sv_render(&t->render, &t->g, &view, o);
    if (s < 0) return s;
    set_size(&t->aux, view.width_px, view.height_px);
    sv_planes_clear(&t->aux);
    *loss += sv_tv_loss(&t->tv, &t->render.rgb, &t->aux, SV_TV_SQUARED,
                        t->cfg.weight_tv_unseen / (float)t->cfg.n_unseen);
    if ((s = sv_render_bwd(&t->render, &t->aux, NULL, NULL, NULL)) < 0) return s;
    sv_train_collect(t, 0.0f, false);
  }
  return SV_OK;
}

// --- a step --------------------------------------------------------------------------------------

static void maybe_relocate(sv_trainer *t, float progress) {
  if (sv_train_is_taught(t)) return; // by a clip of as many that move
  const bool is_moving = sv_train_is_dynamic(t) && progress >= t->cfg.dynamic.from;
  if (t->cfg.relocate_every > 0 && t->step % (uint32_t)t->cfg.relocate_every == 0) sv_train_set_floors(t);
  if (t->cfg.relocate_every < 1 || progress < t->cfg.relocate_from || progress > t->cfg.relocate_until)
    return;
  if (t->step % (uint32_t)t->cfg.relocate_every == 0) {
    sv_train_relocate(t);
    if (is_moving) sv_train_sort_moving(t);
  }
}

// A search renders all views, at half their size: about half a step each. In what progress has been per step, so that
// searches never take more than half of a run, be it one of many views and little time.
static float search_costs(const sv_trainer *t, float progress) {
  return 0.5f * (float)t->n_views * progress / (float)t->step;
}

sv_status sv_train_step(sv_trainer *t, float progress, sv_step_stats *out) {
  if (t->n_views + t->n_regions < 1) return SV_E_ARG;
  if (t->deform.kind != t->cfg.dynamic.kind && progress >= t->cfg.dynamic.clip) sv_train_hand_over(t);
  if (t->fit_left > 0) {
    sv_train_fit(t, progress);
    if (out) *out = (sv_step_stats){.i_view = -1};
    return SV_OK;
  }
  progress = sv_train_stage_progress(t, progress);
  int i = choose_view(t, progress);
  const bool is_region = i >= t->n_views, has_pseudo = sv_prior_is_due(t, progress);
  const bool is_sum = is_region || has_pseudo || has_unseen(t);
  sv_step_stats st = {.i_view = i, .scale = 1};
  sv_render_options o = sv_train_render_options(t, progress, false);
  o.dropout = progress < t->cfg.dropout_until ? t->cfg.dropout : 0.0f;
  o.dropout_seed = sv_hash3((uint32_t)t->cfg.seed, t->step, 0);
  t->photometric.phase = (int)(t->step & 1); // rows on which windows of SSIM stand, in turn
  sv_status s =
      is_region ? region_step(t, i - t->n_views, progress, &o, &st) : view_step(t, i, progress, o, &st);
  if (s < 0) return s;
  if (is_sum && !is_region) {
    sv_train_collect(t, 1.0f, true);
    sv_train_move_pose(t, i, progress, sv_train_n_tasks(t));
  }
  if (has_unseen(t) && (s = smooth_unseen(t, &o, &st.loss)) < 0) return s;
  if (has_pseudo && (s = sv_prior_step(t, progress, &o, &st.loss)) < 0) return s;
  st.n_touched = is_sum ? sv_train_apply(t, progress) : sv_train_optimise(t, progress);
  if (!is_sum) sv_train_move_pose(t, i, progress, sv_train_n_tasks(t));
  t->step++;
  if ((s = sv_prior_tend(t, t->tended, progress)) < 0) return s;
  t->tended = progress;
  maybe_relocate(t, progress);
  if ((s = sv_train_follow(t, t->followed, progress)) < 0) return s;
  t->followed = progress;
  if (sv_train_is_dynamic(t) && !sv_train_is_taught(t) && progress >= t->find_at &&
      progress <= t->cfg.dynamic.find_until) {
    if ((s = sv_train_find_moving(t, progress)) < 0) return s;
    t->find_at = progress + sv_maxf(t->cfg.dynamic.find_every, search_costs(t, progress));
  }
  if (out) *out = st;
  return SV_OK;
}
