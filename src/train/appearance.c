// SPDX-License-Identifier: Apache-2.0
#include "src/train/appearance.h"

#include <string.h>

#include "src/base/mathx.h"
#include "src/train/train.h"

#define BAND_ROWS 32
#define N_MATRIX  9
#define N_COLOR   12                // of M and b; the others are the falloff's
#define SATURATED (254.5f / 255.0f) // display value

sv_appearance_cfg sv_appearance_defaults(void) {
  return (sv_appearance_cfg){.lr_camera = 0.002f,
                             .lr_offset = 0.0002f,
                             .lr_falloff = 0.0005f,
                             .lr_exposure = 0.002f,
                             .decay = 0.03f,
                             .pull = 1e-3f};
}

void sv_appearance_carve(sv_appearance *a, const sv_train_cfg *cfg, size_t cap_floats, sv_arena *arena) {
  const sv_appearance_cfg *c = &cfg->appearance;
  *a = (sv_appearance){0};
  if (c->n_cameras < 1 && !cfg->is_deep) return;
  sv_arena_part_begin(arena, "appearance");
  a->camera = SV_TAKE(arena, sv_appearance_group, c->n_cameras);
  a->exposure = SV_TAKE(arena, sv_appearance_group, c->n_exposures);
  a->measured = SV_TAKE(arena, sv_photometry, c->n_cameras);
  a->camera_of = SV_TAKE(arena, int32_t, cfg->cap_views);
  a->exposure_of = SV_TAKE(arena, int32_t, cfg->cap_views);
  for (int k = 0; k < 3; k++) a->image.c[k] = SV_TAKE(arena, float, cap_floats);
  a->cap_stride = sv_plane_pad(cfg->cap_width_px);
  a->scratch = SV_TAKE(arena, float, (size_t)cfg->n_threads *SV_APPEARANCE_ROWS *(size_t)a->cap_stride);
  a->row_sum = SV_TAKE(arena, float, (size_t)sv_plane_pad(cfg->cap_height_px) * SV_APPEARANCE_SUMS);
}

static void begin(sv_appearance_group *g, int n) {
  for (int i = 0; i < n; i++) {
    g[i] = (sv_appearance_group){0};
    g[i].p[0] = g[i].p[4] = g[i].p[8] = 1;
    memcpy(g[i].start, g[i].p, sizeof g[i].start);
  }
}

void sv_appearance_reset(sv_appearance *a, const sv_appearance_cfg *c) {
  begin(a->camera, c->n_cameras);
  begin(a->exposure, c->n_exposures);
  for (int i = 0; i < c->n_cameras; i++) a->measured[i] = (sv_photometry){0};
}

void sv_train_set_appearance(sv_trainer *t, int i_view, int i_camera, int i_exposure) {
  const sv_appearance_cfg *c = &t->cfg.appearance;
  if (c->n_cameras < 1) return;
  t->appearance.camera_of[i_view] = i_camera < c->n_cameras ? i_camera : -1;
  t->appearance.exposure_of[i_view] = i_exposure < c->n_exposures ? i_exposure : -1;
}

bool sv_train_has_appearance(const sv_trainer *t, int i_view) {
  return t->cfg.appearance.n_cameras > 0 && t->appearance.camera_of[i_view] >= 0;
}

bool sv_train_is_shown(const sv_trainer *t, int i_view) {
  return sv_train_has_appearance(t, i_view) || t->views[i_view].deep.px;
}

// --- transforms
// ------------------------------------------------------------------------------------

static const sv_appearance_group *exposure_of(const sv_trainer *t, int i_view) {
  const int e = t->appearance.exposure_of[i_view];
  return e < 0 ? NULL : &t->appearance.exposure[e];
}

void sv_train_appearance_of(const sv_trainer *t, int i_view, double out[SV_APPEARANCE_SUMS]) {
  const sv_appearance_group *c = &t->appearance.camera[t->appearance.camera_of[i_view]];
  const sv_appearance_group *e = exposure_of(t, i_view);
  memcpy(out, c->p, sizeof c->p);
  if (!e) return;
  sv_mul33(out, e->p, c->p);
  sv_apply33(out + 9, e->p, c->p + 9);
}

// A rendering of a view, what it is compared with, and where what the camera shows, or its
// gradient, goes.
typedef struct {
  const sv_trainer *t;
  sv_appearance_args args;     // of any row but for cy
  const sv_planes *x, *target; // target NULL: nothing is clipped
  sv_planes *out;
  const sv_image_deep *deep; // or NULL
  float saturated;           // value of the target
  float cy;
} job;

// Of one thread: rows of three channels each.
typedef struct {
  float *linear[3], *light[3], *slope_in[3], *slope_out[3];
} rows;

static rows rows_of(const sv_trainer *t, int i_thread, int stride) {
  rows r;
  float *at =
      t->appearance.scratch + (size_t)i_thread * SV_APPEARANCE_ROWS * (size_t)t->appearance.cap_stride;
  float **const all[] = {r.linear, r.light, r.slope_in, r.slope_out};
  for (int i = 0; i < 4; i++)
    for (int c = 0; c < 3; c++, at += stride) all[i][c] = at;
  return r;
}

// What a deep camera's sensor counts: light -> values of equal noise.
static void count_light(const job *j, const float *light, float *out, float *slope) {
  j->t->compute.k->noise_curve(&(sv_noise_curve_args){.src = light,
                                                      .dst = out,
                                                      .slope = slope,
                                                      .n = j->x->width_px,
                                                      .read = sv_deep_read(j->deep),
                                                      .shot = sv_deep_shot(j->deep)});
}

// Display values of a row -> linear light -> the camera's light -> display values (of deep ones:
// noise curve) in out, slopes with is_bwd.
static void show_row(const job *j, const rows *r, int y, float *const out[3], bool is_bwd) {
  const sv_kernels *k = j->t->compute.k;
  const int w = j->x->width_px;
  const size_t at = (size_t)y * (size_t)j->x->stride;
  sv_appearance_args a = j->args;
  a.cy = j->cy - (float)y;
  for (int c = 0; c < 3; c++) {
    k->srgb_to_linear(&(sv_curve_args){
        .src = j->x->c[c] + at, .dst = r->linear[c], .slope = is_bwd ? r->slope_in[c] : NULL, .n = w});
    a.x[c] = r->linear[c];
    a.out[c] = r->light[c];
  }
  k->appearance(&a);
  for (int c = 0; c < 3; c++) {
    float *slope = is_bwd ? r->slope_out[c] : NULL;
    if (j->deep) count_light(j, r->light[c], out[c], slope);
    else k->linear_to_srgb(&(sv_curve_args){.src = r->light[c], .dst = out[c], .slope = slope, .n = w});
  }
}

// How much brighter than a saturated pixel the light was, no sensor tells.
static bool is_clipped(const job *j, float target, float out) {
  return target >= j->saturated && out > target;
}

static void show_task(void *arg, int i_task, int i_thread) {
  const job *j = arg;
  const rows r = rows_of(j->t, i_thread, j->x->stride);
  for (int y = i_task * BAND_ROWS; y < sv_mini((i_task + 1) * BAND_ROWS, j->x->height_px); y++) {
    const size_t at = (size_t)y * (size_t)j->x->stride;
    float *const out[3] = {j->out->c[0] + at, j->out->c[1] + at, j->out->c[2] + at};
    show_row(j, &r, y, out, false);
    for (int c = 0; c < 3; c++)
      for (int i = 0; i < j->x->width_px; i++) {
        const float target = j->target->c[c][at + (size_t)i];
        if (is_clipped(j, target, out[c][i])) out[c][i] = target;
      }
  }
}

static void bwd_task(void *arg, int i_task, int i_thread) {
  const job *j = arg;
  const rows r = rows_of(j->t, i_thread, j->x->stride);
  for (int y = i_task * BAND_ROWS; y < sv_mini((i_task + 1) * BAND_ROWS, j->x->height_px); y++) {
    const size_t at = (size_t)y * (size_t)j->x->stride;
    sv_appearance_args a = j->args;
    a.cy = j->cy - (float)y;
    a.row_sum = j->t->appearance.row_sum + (size_t)y * SV_APPEARANCE_SUMS;
    show_row(j, &r, y, r.light, true); // light becomes display values
    for (int c = 0; c < 3; c++) {
      float *g = j->out->c[c] + at;
      for (int i = 0; i < j->x->width_px; i++)
        g[i] = j->target && is_clipped(j, j->target->c[c][at + (size_t)i], r.light[c][i])
                   ? 0.0f
                   : g[i] * r.slope_out[c][i];
      a.x[c] = r.linear[c];
      a.out[c] = g;
    }
    j->t->compute.k->appearance_bwd(&a);
    for (int c = 0; c < 3; c++)
      for (int i = 0; i < j->x->width_px; i++) j->out->c[c][at + (size_t)i] *= r.slope_in[c][i];
  }
}

static double exposure_of_view(const sv_trainer *t, int i_view) {
  return t->views[i_view].deep.px ? (double)t->views[i_view].deep.exposure : 1;
}

// Of a deep view whose appearance is not learned.
static const sv_photometry *photometric_of(const sv_trainer *t, int i_view) {
  const sv_image_deep *deep = &t->views[i_view].deep;
  return deep->px && !sv_train_has_appearance(t, i_view) ? deep->photometric : NULL;
}

// bwd NULL: shows x; else takes it, dL/d(what the camera shows), to dL/dx.
static void run(sv_trainer *t, int i_view, const sv_view *v, const sv_planes *x, sv_planes *bwd,
                const sv_planes *target) {
  const sv_photometry *calibrated = photometric_of(t, i_view);
  double p[SV_APPEARANCE_SUMS] = {[0] = 1, [4] = 1, [8] = 1};
  if (sv_train_has_appearance(t, i_view)) sv_train_appearance_of(t, i_view, p);
  else if (calibrated) memcpy(p, calibrated->color, sizeof calibrated->color);
  if (calibrated) memcpy(p + N_COLOR, calibrated->falloff, sizeof calibrated->falloff);
  for (int i = 0; i < N_COLOR; i++) p[i] *= exposure_of_view(t, i_view);
  const sv_image_deep *deep = &t->views[i_view].deep;
  const float far_x = sv_maxf(v->cx, (float)v->width_px - v->cx),
              far_y = sv_maxf(v->cy, (float)v->height_px - v->cy);
  job j = {.t = t,
           .args = {.cx = v->cx,
                    .inv_r2 = 1.0f / (far_x * far_x + far_y * far_y),
                    .width_px = x->width_px,
                    .stride = x->stride,
                    .row1 = 1},
           .x = x,
           .target = target,
           .out = bwd ? bwd : &t->appearance.image,
           .deep = deep->px ? deep : NULL,
           .saturated = deep->px ? sv_deep_saturated(deep) : SATURATED,
           .cy = v->cy};
  if (calibrated) j.args.inv_r2 = 1 / ((float)(calibrated->corner * calibrated->corner) * v->fx * v->fx);
  for (int i = 0; i < 9; i++) j.args.m[i] = (float)p[i];
  for (int i = 0; i < 3; i++) j.args.b[i] = (float)p[9 + i];
  for (int i = 0; i < 3; i++) j.args.k[i] = (float)p[N_COLOR + i];
  sv_pool_run(t->compute.pool, bwd ? bwd_task : show_task, &j, (x->height_px + BAND_ROWS - 1) / BAND_ROWS);
}

const sv_planes *sv_train_appear(sv_trainer *t, int i_view, const sv_view *view, const sv_planes *x) {
  if (!sv_train_is_shown(t, i_view)) return x;
  sv_planes_set_size(&t->appearance.image, x->width_px, x->height_px);
  run(t, i_view, view, x, NULL, &t->target);
  return &t->appearance.image;
}

// --- gradients
// -------------------------------------------------------------------------------------

static void step(sv_appearance_group *g, const double *grad, int from, int to, double rate, double pull) {
  const double n = (double)g->n_steps, bias1 = 1 - sv_pow(0.9, n), bias2 = 1 - sv_pow(0.999, n);
  for (int i = from; i < to; i++) {
    const double d = grad[i] + pull * (g->p[i] - g->start[i]);
    g->m[i] = 0.9 * g->m[i] + 0.1 * d;
    g->v[i] = 0.999 * g->v[i] + 0.001 * d * d;
    g->p[i] -= rate * (g->m[i] / bias1) / (sqrt(g->v[i] / bias2) + 1e-12);
  }
}

// M = E C and b = E c: dL/dC = E^T dL/dM, dL/dc = E^T dL/db, dL/dE = dL/dM C^T + dL/db c^T.
void sv_appearance_share(const double *sum, const double *camera, const double *exposure, double *d_camera,
                         double *d_exposure) {
  for (int i = 0; i < 3; i++)
    for (int k = 0; k < 3; k++) {
      double dc = 0, de = sum[9 + i] * camera[9 + k];
      for (int j = 0; j < 3; j++) {
        dc += exposure[3 * j + i] * sum[3 * j + k];
        de += sum[3 * i + j] * camera[3 * k + j];
      }
      d_camera[3 * i + k] = dc;
      d_exposure[3 * i + k] = de;
    }
  for (int i = 0; i < 3; i++) {
    d_camera[9 + i] = 0;
    for (int j = 0; j < 3; j++) d_camera[9 + i] += exposure[3 * j + i] * sum[9 + j];
  }
}

static void move(sv_trainer *t, int i_view, const double sum[SV_APPEARANCE_SUMS], float progress) {
  const sv_appearance_cfg *c = &t->cfg.appearance;
  const int i_camera = t->appearance.camera_of[i_view], i_exposure = t->appearance.exposure_of[i_view];
  const double rate = sv_exp(sv_log((double)c->decay) * (double)progress);
  sv_appearance_group *camera = &t->appearance.camera[i_camera];
  double d_camera[SV_APPEARANCE_SUMS], d_exposure[9];
  memcpy(d_camera, sum, sizeof d_camera);
  if (i_exposure >= 0) {
    sv_appearance_group *e = &t->appearance.exposure[i_exposure];
    sv_appearance_share(sum, camera->p, e->p, d_camera, d_exposure);
    e->n_steps++;
    if (i_exposure > 0) step(e, d_exposure, 0, N_MATRIX, rate * (double)c->lr_exposure, (double)c->pull);
  }
  camera->n_steps++;
  if (i_camera > 0) {
    step(camera, d_camera, 0, N_MATRIX, rate * (double)c->lr_camera, (double)c->pull);
    step(camera, d_camera, N_MATRIX, N_COLOR, rate * (double)c->lr_offset, (double)c->pull);
  }
  step(camera, d_camera, N_COLOR, SV_APPEARANCE_SUMS, rate * (double)c->lr_falloff, (double)c->pull);
}

void sv_train_appear_bwd(sv_trainer *t, int i_view, const sv_planes *x, const sv_view *view, float progress) {
  double sum[SV_APPEARANCE_SUMS] = {0};
  if (!sv_train_is_shown(t, i_view)) return;
  run(t, i_view, view, x, &t->grad, &t->target);
  if (!sv_train_has_appearance(t, i_view)) return;
  for (int r = 0; r < x->height_px; r++)
    for (int i = 0; i < SV_APPEARANCE_SUMS; i++)
      sum[i] += (double)t->appearance.row_sum[r * SV_APPEARANCE_SUMS + i];
  for (int i = 0; i < N_COLOR; i++) sum[i] *= exposure_of_view(t, i_view);
  move(t, i_view, sum, progress);
}

void sv_train_appear_probe(sv_trainer *t, int i_view, const sv_planes *x, const sv_view *view,
                           sv_planes *probe) {
  run(t, i_view, view, x, probe, NULL);
}
