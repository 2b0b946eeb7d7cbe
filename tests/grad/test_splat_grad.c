// SPDX-License-Identifier: Apache-2.0
// The renderer's values against a double-precision renderer (splat_double.h) and its gradients
// against central differences of that one, for every parameter and the camera's twist.
//
// Two tiers near the cut-offs (1/255 skip, gradients' end at 1e-4 of the light): a pixel where a
// contribution lies within `band` (relative) of one may be decided differently in float. Its value
// gets a wide tolerance, it carries no loss weight, and such pixels are counted and must be few. A
// difference quotient whose steps h and 2h disagree straddles a jump (two Gaussians of one depth,
// the 0.99 clamp): dropped, counted, few.
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "calib/fisheye.h"
#include "kernels/kernels.h"
#include "src/base/mathx.h"
#include "src/base/rng.h"
#include "kernels/simd/s1_math.h"
#include "src/splat/render.h"
#include "tests/common/test.h"
#include "tests/grad/splat_double.h"

#define CAP_PX     (70 * 45)
#define CAP_BLOCKS ((DR_CAP_GAUSSIANS + 15) / 16)

typedef enum { MIX, CLAMPED, SHAPES, LAYERS, HIDDEN, EVERYTHING } scene_kind;

typedef struct {
  const char *name;
  scene_kind kind;
  int n, width_px, height_px, sh_rows, sh_used;
  bool is_antialiased, has_depth;
  double cx_shift, cy_shift; // of the principal point, in image sizes
  bool is_hard;              // wider tolerances, see below
  uint64_t seed;
  float dropout;
  double fisheye_deg; // across the diagonal; 0: a pinhole
} scene_case;

// Values: absolute, of colours and transmittance (depth: five times that). Gradients: largest error
// of one Gaussian's group, relative to its norm plus a tenth of the group's rms norm over the
// scene. In Gaussians far longer than they are wide the exponent is a difference of large terms in
// float, and the gradient of an axis far below the pixel's dilation is rounding of a larger one:
// the cases that hold them are `hard`. SSE4.1 rounds twice where the others fuse: twice the
// tolerance.
static double tol_value(bool is_hard) { return is_hard ? 1e-4 : 2e-5; }
// Needles: the terms of their power cancel; up to 5e-3 over 13 seeds.
static double tol_grad(bool is_hard) { return is_hard ? 6e-3 : 2e-4; }
static double band(bool is_hard) { return is_hard ? 1e-3 : 1e-4; }

static const scene_case cases[] = {
    {"plain, SH 0", MIX, 12, 14, 12, 0, 0, false, true, 0, 0, false, 1},
    {"plain, SH 1", MIX, 12, 14, 12, 1, 1, false, true, 0, 0, false, 2},
    {"plain, SH 2", MIX, 12, 37, 29, 2, 2, false, true, 0, 0, false, 3},
    {"plain, SH 3", MIX, 17, 14, 12, 3, 3, false, true, 0, 0, false, 4},
    {"rows of SH 3, SH 1 in use", MIX, 9, 14, 12, 3, 1, false, true, 0, 0, false, 5},
    {"no depth", MIX, 12, 37, 29, 1, 1, false, false, 0, 0, false, 6},
    {"antialiased", MIX, 12, 37, 29, 3, 3, true, true, 0, 0, false, 7},
    {"off-centre principal point", MIX, 12, 37, 29, 1, 1, false, true, 0.4, -0.35, false, 8},
    {"beyond the frustum limits", CLAMPED, 12, 37, 29, 1, 1, false, true, 0, 0, false, 9},
    {"beyond the frustum limits, antialiased, off-centre", CLAMPED, 12, 37, 29, 1, 1, true, true, -0.2, 0.3,
     false, 10},
    {"tiny, needle-like and huge", SHAPES, 14, 70, 45, 2, 2, false, true, 0, 0, true, 11},
    {"tiny, needle-like and huge, antialiased", SHAPES, 14, 70, 45, 0, 0, true, true, 0, 0, true, 12},
    {"saturated layers, clamped alpha", LAYERS, 40, 14, 12, 0, 0, false, true, 0, 0, true, 18},
    {"saturated layers of two groups", LAYERS, 150, 14, 12, 0, 0, false, true, 0, 0, true, 19},
    {"invisible ones", HIDDEN, 20, 37, 29, 1, 1, false, true, 0, 0, false, 14},
    {"everything", EVERYTHING, 20, 70, 45, 3, 3, true, true, 0.1, 0.1, true, 15},
    {"some left out", MIX, 24, 37, 29, 1, 1, false, true, 0, 0, false, 16, 0.25f},
    {"some left out, antialiased", MIX, 24, 37, 29, 1, 1, true, true, 0, 0, false, 17, 0.4f},
    {"fisheye of 120 degrees", MIX, 16, 37, 29, 1, 1, false, true, 0, 0, false, 20, 0, 120},
    {"fisheye of 185 degrees", MIX, 24, 37, 29, 3, 3, false, true, 0, 0, false, 21, 0, 185},
    {"fisheye of 190 degrees, off-centre, antialiased", MIX, 24, 37, 29, 1, 1, true, true, 0.03, -0.03, false,
     22, 0, 190},
    {"fisheye, invisible ones", HIDDEN, 20, 37, 29, 1, 1, false, true, 0, 0, false, 23, 0, 185},
};
#define N_CASES ((int)(sizeof cases / sizeof *cases))

enum { MEAN, QUAT, SCALE, LOGIT, SH_DC, SH_REST, OMEGA, VELOCITY, N_GROUPS };
static const char *const group_names[N_GROUPS] = {"mean", "quat",   "log-scale", "logit",
                                                  "SH 0", "SH 1..", "omega",     "v"};

static int group_of_row(int row) {
  return row < 3 ? MEAN : row < 7 ? QUAT : row < 10 ? SCALE : row == 10 ? LOGIT : row < 14 ? SH_DC : SH_REST;
}

static double uniform(sv_rng *r, double lo, double hi) { return lo + (hi - lo) * (double)sv_rng_f(r); }

// --- scenes --------------------------------------------------------------------------------------

static void make_fisheye(const scene_case *c, dr_view *v, sv_view *view) {
  static sv_camera_model m;
  static sv_fisheye fisheye;
  const double f = 0.5 * hypot(c->width_px, c->height_px) / (0.5 * c->fisheye_deg * SV_PI / 180);
  m = (sv_camera_model){
      SV_MODEL_KB4, c->width_px, c->height_px, {f, 0.96 * f, v->cx, v->cy, 0.02, -0.01, 0.003, -0.0004}};
  assert_true(sv_fisheye_make(&fisheye, &m));
  view->fx = (float)m.p[0];
  view->fy = (float)m.p[1];
  view->fisheye = &fisheye;
  v->fx = m.p[0] = view->fx;
  v->fy = m.p[1] = view->fy;
  v->fisheye = &m;
}

static void make_view(const scene_case *c, dr_scene *s, sv_view *view) {
  double eye[3] = {0.3, -2.6, 0.8}, at[3] = {0, 0, 0}, up[3] = {0.1, 0, 1};
  sv_pose pose;
  assert_true(sv_pose_look_at(&pose, eye, at, up));
  double w = c->width_px, h = c->height_px;
  *view = sv_view_make(c->width_px, c->height_px,
                       (const double[]){0.95 * w, 0.92 * w, w * (0.5 + c->cx_shift), h * (0.5 + c->cy_shift)},
                       &pose);
  dr_view *v = &s->view;
  *v = (dr_view){.width_px = c->width_px,
                 .height_px = c->height_px,
                 .fx = view->fx,
                 .fy = view->fy,
                 .cx = view->cx,
                 .cy = view->cy,
                 .near_z = 0.1f,
                 .bg = {0.3f, 0.6f, 0.1f},
                 .is_antialiased = c->is_antialiased,
                 .sh_degree = c->sh_used};
  for (int i = 0; i < 9; i++) v->r[i] = view->r[i];
  for (int i = 0; i < 3; i++) v->t[i] = view->t[i];
  if (c->fisheye_deg > 0) make_fisheye(c, v, view);
}

// World point of a pixel position and depth.
static void unproject(const dr_view *v, double x, double y, double z, double out[3]) {
  double t[3] = {(x - v->cx) / v->fx * z - v->t[0], (y - v->cy) / v->fy * z - v->t[1], z - v->t[2]};
  const double uv[2] = {x, y};
  double ray[3];
  if (v->fisheye && sv_model_unproject(v->fisheye, uv, ray))
    for (int i = 0; i < 3; i++) t[i] = ray[i] * z - v->t[i];
  for (int i = 0; i < 3; i++) out[i] = v->r[i] * t[0] + v->r[3 + i] * t[1] + v->r[6 + i] * t[2];
}

static void random_gaussian(sv_rng *r, const dr_view *v, double *p) {
  // One draw a statement: C does not order a call's arguments, and every machine must get this
  // scene.
  double x = uniform(r, 0.05, 0.95) * v->width_px;
  double y = uniform(r, 0.05, 0.95) * v->height_px;
  unproject(v, x, y, uniform(r, 1.8, 3.6), p);
  for (int k = 3; k < 7; k++) p[k] = uniform(r, -1.7, 1.7);
  for (int k = 7; k < 10; k++) p[k] = uniform(r, -2.6, -1.2);
  p[10] = uniform(r, -1.5, 1.8);
  for (int k = 11; k < DR_N_PARAMS; k++) p[k] = uniform(r, -0.35, 0.35);
}

static void special_gaussian(scene_kind kind, int i, sv_rng *r, const dr_view *v, double *p) {
  double w = v->width_px, h = v->height_px, z = uniform(r, 1.8, 3.6);
  // centres outside the picture by more than 0.15 of it, reaching in
  if (kind == CLAMPED && i % 3 != 2) {
    double x = i % 2 ? -uniform(r, 0.3, 0.6) * w : uniform(r, 1.3, 1.6) * w, y = uniform(r, 0.1, 0.9) * h;
    if (i % 4 >= 2) {
      x = uniform(r, 0.1, 0.9) * w;
      y = i % 2 ? -uniform(r, 0.3, 0.6) * h : uniform(r, 1.3, 1.6) * h;
    }
    if (i % 6 == 0) {
      x = -0.4 * w;
      y = -0.3 * h;
    }
    unproject(v, x, y, z, p);
    for (int k = 7; k < 10; k++) p[k] = uniform(r, -0.7, 0.0);
    p[10] = uniform(r, 0, 3);
  } else if (kind == SHAPES && i % 4 == 0) { // far below a pixel
    for (int k = 7; k < 10; k++) p[k] = uniform(r, -9, -6);
    p[10] = uniform(r, 1, 3);
  } else if (kind == SHAPES && i % 4 == 1) { // needle
    p[7 + i % 3] = uniform(r, -0.8, -0.2);
    p[7 + (i + 1) % 3] = uniform(r, -6, -5);
    p[7 + (i + 2) % 3] = uniform(r, -6, -5);
  } else if (kind == SHAPES && i % 4 == 2) { // larger than the picture
    for (int k = 7; k < 10; k++) p[k] = uniform(r, 0, 1);
    p[10] = uniform(r, -3, -1);
    unproject(v, 0.5 * w, 0.5 * h, uniform(r, 3, 5), p);
  } else if (kind == LAYERS) { // wide and opaque, one behind the other; some beyond 0.99
    double x = uniform(r, 0.3, 0.7) * w, y = uniform(r, 0.3, 0.7) * h;
    unproject(v, x, y, uniform(r, 2, 4), p);
    for (int k = 7; k < 10; k++) p[k] = uniform(r, -0.7, 0.3);
    p[10] = i % 3 ? uniform(r, 0, 3) : uniform(r, 4.8, 8);
  }
}

// Behind the camera, before the near plane, beside the picture, or transparent.
static void hidden_gaussian(int i, sv_rng *r, const dr_view *v, double *p) {
  for (int k = 7; k < 10; k++) p[k] = -3;
  double w = v->width_px, h = v->height_px;
  if (i % 5 == 0) unproject(v, 0.5 * w, 0.5 * h, -2, p);
  else if (i % 5 == 1) unproject(v, 0.5 * w, 0.5 * h, 0.05, p);
  else if (i % 5 == 2) unproject(v, 3 * w, 0.5 * h, 2, p);
  else if (i % 5 == 3) p[10] = uniform(r, -12, -6);
  else unproject(v, 0.4 * w, -2 * h, 2, p);
}

static void make_scene(const scene_case *c, dr_scene *s, sv_view *view) {
  sv_rng r = sv_rng_make(c->seed, 77);
  memset(s, 0, sizeof *s);
  make_view(c, s, view);
  s->n = c->n;
  s->gain = 1;
  for (int i = 0; i < c->n; i++) {
    double *p = s->p[i];
    random_gaussian(&r, &s->view, p);
    scene_kind kind = c->kind == EVERYTHING ? (i < 5    ? CLAMPED
                                               : i < 12 ? SHAPES
                                               : i < 16 ? HIDDEN
                                                        : MIX)
                                            : c->kind;
    if (kind == HIDDEN) {
      if (i % 2 || c->kind == EVERYTHING) hidden_gaussian(i / 2, &r, &s->view, p);
    } else special_gaussian(kind, i, &r, &s->view, p);
    for (int k = 0; k < DR_N_PARAMS; k++) p[k] = (float)p[k];
  }
}

// --- the renderer under test ---------------------------------------------------------------------

static _Alignas(64) uint8_t block[48 << 20];

typedef struct {
  sv_gaussians g;
  sv_renderer r;
  sv_planes g_rgb;
  float *g_depth, *g_trans, *err, *expected_depth; // padded planes
  float grad[CAP_BLOCKS][SV_CAP_ROWS][16], err_sum[CAP_BLOCKS][16];
  uint32_t touched[CAP_BLOCKS];
  double pose[6];
} run;

static float *plane(sv_arena *a, const sv_planes *like, const double *from) {
  size_t n = (size_t)like->stride * (size_t)like->rows_padded;
  float *p = SV_TAKE(a, float, n);
  assert_non_null(p);
  memset(p, 0, n * sizeof *p);
  for (int y = 0; from && y < like->height_px; y++)
    for (int x = 0; x < like->width_px; x++) p[y * like->stride + x] = (float)from[y * like->width_px + x];
  return p;
}

static void backward(run *q, const sv_kernels *k) {
  sv_pool pool = sv_pool_serial();
  q->r.compute = (sv_compute){k, &pool};
  assert_int_equal(sv_render_bwd(&q->r, &q->g_rgb, q->g_depth, q->g_trans, q->err), SV_OK);
  memset(q->pose, 0, sizeof q->pose);
  for (int b = 0; b < q->g.cap / 16; b++) {
    float pose[6];
    memset(q->grad[b], 0xff, sizeof q->grad[b]); // NaN: rows in use must all be written
    q->touched[b] =
        sv_render_bwd_block(&q->r, b, 0, NULL, &(sv_block_grads){q->grad[b][0], q->err_sum[b], pose});
    for (int i = 0; i < 6; i++) q->pose[i] += (double)pose[i];
  }
}

static void render_float(const scene_case *c, const dr_scene *s, const sv_view *view, const dr_weights *w,
                         const double *err, const sv_kernels *k, run *q) {
  sv_arena a = sv_arena_make(block, sizeof block);
  memset(q, 0, sizeof *q);
  assert_int_equal(sv_gaussians_init(&q->g, s->n, c->sh_rows, &a), SV_OK);
  for (int i = 0; i < s->n; i++)
    for (int row = 0; row < q->g.n_rows; row++) *sv_gaussians_at(&q->g, i, row) = (float)s->p[i][row];
  sv_renderer_cfg cfg = {.cap_gaussians = s->n,
                         .cap_width_px = c->width_px,
                         .cap_height_px = c->height_px,
                         .n_threads = 1,
                         .has_grad = true};
  sv_pool pool = sv_pool_serial();
  assert_int_equal(sv_renderer_init(&q->r, &cfg, (sv_compute){k, &pool}, &a), SV_OK);
  sv_render_options o = {.sh_degree = c->sh_used,
                         .near_z = 0.1f,
                         .is_antialiased = c->is_antialiased,
                         .has_depth = c->has_depth,
                         .bg = {0.3f, 0.6f, 0.1f},
                         .dropout = c->dropout,
                         .dropout_seed = 3};
  assert_int_equal(sv_render(&q->r, &q->g, view, &o), SV_OK);
  assert_int_equal(sv_planes_init(&q->g_rgb, c->width_px, c->height_px, &a), SV_OK);
  for (int i = 0; i < 3; i++) q->g_rgb.c[i] = plane(&a, &q->g_rgb, w->rgb[i]);
  q->g_depth = c->has_depth ? plane(&a, &q->g_rgb, w->depth) : NULL;
  q->g_trans = c->has_depth ? plane(&a, &q->g_rgb, w->trans) : NULL;
  q->err = plane(&a, &q->g_rgb, err);
  q->expected_depth = plane(&a, &q->g_rgb, NULL);
  if (c->has_depth) sv_render_expected_depth(&q->r, 1e-3f, q->expected_depth);
  backward(q, k);
}

// --- comparisons ---------------------------------------------------------------------------------

typedef struct {
  double rgb[3][CAP_PX], depth[CAP_PX], trans[CAP_PX], margin[CAP_PX];
  double w_rgb[3][CAP_PX], w_depth[CAP_PX], w_trans[CAP_PX], err[CAP_PX];
  dr_share share[DR_CAP_GAUSSIANS];
  dr_rest rest[CAP_PX];
  double fd[DR_CAP_GAUSSIANS + 1][DR_N_PARAMS]; // last row: the twist
  bool is_dropped[DR_CAP_GAUSSIANS + 1][DR_N_PARAMS];
  int n_px, n_near, n_low, n_clamped, n_quotients, n_dropped;
} truth;

static dr_weights weights_of(const scene_case *c, truth *t) {
  return (dr_weights){
      {t->w_rgb[0], t->w_rgb[1], t->w_rgb[2]}, c->has_depth ? t->w_depth : NULL, t->w_trans, t->rest};
}

static void make_truth(const scene_case *c, const dr_scene *s, truth *t) {
  sv_rng r = sv_rng_make(c->seed, 5);
  memset(t, 0, sizeof *t);
  t->n_px = c->width_px * c->height_px;
  for (int i = 0; i < t->n_px; i++) t->err[i] = (float)uniform(&r, 0, 1);
  dr_picture pic = {{t->rgb[0], t->rgb[1], t->rgb[2]}, t->depth, t->trans, t->margin, t->rest, &t->n_low};
  dr_render(s, &pic, t->err, t->share);
  for (int i = 0; i < s->n; i++) t->n_clamped += t->share[i].peak_alpha > 0.99;
  for (int i = 0; i < t->n_px; i++) {
    bool is_near = t->margin[i] < band(c->is_hard);
    t->n_near += is_near;
    for (int k = 0; k < 3; k++) t->w_rgb[k][i] = is_near ? 0 : (float)uniform(&r, -1, 1);
    t->w_depth[i] = is_near ? 0 : (float)uniform(&r, -0.3, 0.3);
    t->w_trans[i] = is_near || !c->has_depth ? 0 : (float)uniform(&r, -0.5, 0.5);
  }
}

static void difference(dr_scene *s, double *x, const dr_weights *w, double *fd, bool *is_dropped, truth *t) {
  const double h = 1e-6, x0 = *x;
  double l[4];
  for (int i = 0; i < 4; i++) {
    *x = x0 + (i < 2 ? h : 2 * h) * (i % 2 ? -1 : 1);
    l[i] = dr_loss(s, w);
  }
  *x = x0;
  double d1 = (l[0] - l[1]) / (2 * h), d2 = (l[2] - l[3]) / (4 * h);
  *fd = d1;
  *is_dropped = fabs(d1 - d2) > 1e-4 * (1 + fabs(d1));
  t->n_quotients++;
  t->n_dropped += *is_dropped;
}

static void make_differences(const scene_case *c, dr_scene *s, truth *t) {
  dr_weights w = weights_of(c, t);
  for (int i = 0; i < s->n; i++)
    for (int row = 0; row < SV_N_ROWS(c->sh_used); row++)
      difference(s, &s->p[i][row], &w, &t->fd[i][row], &t->is_dropped[i][row], t);
  for (int k = 0; k < 6; k++)
    difference(s, &s->view.twist[k], &w, &t->fd[s->n][k], &t->is_dropped[s->n][k], t);
}

// The worst pixel against its tolerance; > 1 is a failure.
static double value_error(const scene_case *c, const truth *t, const run *q, double slack) {
  double worst = 0;
  for (int y = 0; y < c->height_px; y++)
    for (int x = 0; x < c->width_px; x++) {
      int i = y * c->width_px + x, o = y * q->r.rgb.stride + x;
      double tol = (t->margin[i] < band(c->is_hard) ? 0.03 : tol_value(c->is_hard)) *
                   slack; // a splat of alpha 1/255, or the light's end
      for (int k = 0; k < 3; k++) worst = fmax(worst, fabs((double)q->r.rgb.c[k][o] - t->rgb[k][i]) / tol);
      if (!c->has_depth) continue;
      worst = fmax(worst, fabs((double)q->r.trans[o] - t->trans[i]) / tol);
      worst = fmax(worst, fabs((double)q->r.depth[o] - t->depth[i]) / (5 * tol));
      double alpha = 1 - t->trans[i], expected = alpha > 1e-3 ? t->depth[i] / fmax(alpha, 1e-10) : 0;
      if (alpha > 0.002) // under 1/255 nothing is drawn
        worst = fmax(worst, fabs((double)q->expected_depth[o] - expected) / (5 * tol / alpha));
      else if (q->expected_depth[o] != 0) worst = 1e9;
    }
  return worst;
}

// Worst error per group, see tol_grad.
static void gradient_errors(const scene_case *c, const dr_scene *s, const truth *t, const run *q,
                            double worst[N_GROUPS]) {
  double rms[N_GROUPS] = {0}, err2[DR_CAP_GAUSSIANS + 1][N_GROUPS] = {{0}},
         fd2[DR_CAP_GAUSSIANS + 1][N_GROUPS] = {{0}};
  for (int i = 0; i <= s->n; i++) {
    bool is_pose = i == s->n;
    for (int row = 0; row < (is_pose ? 6 : SV_N_ROWS(c->sh_used)); row++) {
      int g = is_pose ? (row < 3 ? OMEGA : VELOCITY) : group_of_row(row);
      double got = is_pose ? q->pose[row] : (double)q->grad[i / 16][row][i % 16];
      double e = t->is_dropped[i][row] ? 0 : got - t->fd[i][row];
      err2[i][g] += isfinite(e) ? e * e : 1e30;
      fd2[i][g] += t->fd[i][row] * t->fd[i][row];
    }
    for (int g = 0; g < N_GROUPS; g++) rms[g] += fd2[i][g] / (g >= OMEGA ? 1 : s->n);
  }
  for (int g = 0; g < N_GROUPS; g++) {
    worst[g] = 0;
    for (int i = 0; i <= s->n; i++)
      worst[g] = fmax(worst[g], sqrt(err2[i][g]) / (sqrt(fd2[i][g]) + 0.1 * sqrt(rms[g]) + 1e-12));
  }
}

// Touched bits, exact zeros of what is not seen, and the weighted residuals (16 bits of a
// record's).
static void check_shares(const scene_case *c, const dr_scene *s, const truth *t, const run *q, double slack) {
  int n_hidden = 0;
  for (int i = 0; i < q->g.cap; i++) {
    const dr_share *h = t->share + i;
    bool is_touched = q->touched[i / 16] >> (i % 16) & 1;
    bool is_seen = i < s->n && h->weight > 0.01;
    bool is_hidden = i >= s->n || h->peak_alpha < 0.99 / 255;
    if (is_seen) assert_true(is_touched);
    if (i >= s->n || !h->is_drawn) assert_false(is_touched);
    n_hidden += is_hidden;
    for (int row = 0; is_hidden && row < SV_N_ROWS(c->sh_used); row++)
      assert_true(q->grad[i / 16][row][i % 16] == 0); // -0 is fine, NaN is not
    double err = i < s->n ? h->err : 0, tol = slack * (8e-3 * err + 0.02 * t->n_near + 1e-6);
    if (fabs((double)q->err_sum[i / 16][i % 16] - err) > tol)
      fail_msg("%s: Gaussian %d: err %.7g, expected %.7g", c->name, i, (double)q->err_sum[i / 16][i % 16],
               err);
  }
  if (c->kind == HIDDEN) assert_true(n_hidden >= 10);
}

// A gradient that is one per cent off must be seen: the check checked.
static void check_can_fail(const scene_case *c, const dr_scene *s, const truth *t, run *q) {
  double worst[N_GROUPS];
  for (int g = 0; g < N_GROUPS; g++) {
    if ((g == SH_REST && c->sh_used == 0)) continue;
    run *bad = q;
    for (int i = 0; i < s->n && g < OMEGA; i++)
      for (int row = 0; row < SV_N_ROWS(c->sh_used); row++)
        if (group_of_row(row) == g) bad->grad[i / 16][row][i % 16] *= 1.01f;
    for (int k = 0; k < 3 && g >= OMEGA; k++) bad->pose[3 * (g - OMEGA) + k] *= 1.01;
    gradient_errors(c, s, t, bad, worst);
    assert_true(worst[g] > tol_grad(c->is_hard));
  }
}

static void report(const char *isa, double value, const double worst[N_GROUPS]) {
  int g = 0;
  for (int i = 1; i < N_GROUPS; i++)
    if (worst[i] > worst[g]) g = i;
  printf("    %-7s values at %.2f of the tolerance, gradients within %.1e (%s)\n", isa, value, worst[g],
         group_names[g]);
}

// Whether a record has lost all its blocks, which had ended before its group.
static bool has_ended(const sv_renderer *r) {
  for (uint32_t i = 0; i < r->stats.n_intersections; i++)
    if (!r->intersection[r->list[i]].mask) return true;
  return false;
}

// Who is left out is the renderer's draw; that the others are so much more opaque for it is not.
static void leave_out(const scene_case *c, dr_scene *s, const sv_view *view, run *q) {
  const dr_weights none = {0};
  sv_kernels k;
  int n = 0;
  sv_kernels_init(&k, sv_isa_only(SV_ISA_REF));
  render_float(c, s, view, &none, NULL, &k, q);
  for (int i = 0; i < s->n; i++) n += s->is_dropped[i] = q->r.dropout_mask[i / 16] >> i % 16 & 1;
  assert_true(n > 0 && n < s->n);
  s->gain = 1 / (1 - round(256 * (double)c->dropout) / 256);
}

static void check_case(const scene_case *c) {
  static dr_scene s;
  static truth t;
  static run q, first;
  sv_view view;
  make_scene(c, &s, &view);
  if (c->dropout > 0) leave_out(c, &s, &view, &q);
  make_truth(c, &s, &t);
  make_differences(c, &s, &t);
  dr_weights w = weights_of(c, &t);
  printf("  %s: of %d pixels %d near a cut-off, %d dark; %d Gaussians clamped; %d of %d quotients dropped\n",
         c->name, t.n_px, t.n_near, t.n_low, t.n_clamped, t.n_dropped, t.n_quotients);
  if (c->kind == LAYERS) assert_true(t.n_low > t.n_px / 2 && t.n_clamped >= 3);
  assert_true(t.n_near <= 0.06 * t.n_px);
  assert_true(t.n_dropped <= 0.02 * t.n_quotients);
  for (int isa = 0; isa < SV_N_ISAS; isa++) {
    sv_kernels k;
    if (!(sv_cpu_isas() & SV_ISA_BIT(isa))) continue;
    sv_kernels_init(&k, sv_isa_only((sv_isa)isa));
    render_float(c, &s, &view, &w, t.err, &k, &q);
    double worst[N_GROUPS], slack = isa == SV_ISA_SSE41 ? 3 : 1; // no FMA
    double value = value_error(c, &t, &q, slack);
    gradient_errors(c, &s, &t, &q, worst);
    report(sv_isa_name((sv_isa)isa), value, worst);
    assert_true(value <= 1);
    for (int g = 0; g < N_GROUPS; g++) assert_true(worst[g] <= slack * tol_grad(c->is_hard));
    check_shares(c, &s, &t, &q, slack);
    if (c->kind == LAYERS) assert_int_equal(has_ended(&q.r), c->n > SV_RASTER_GROUP);
    if (isa == SV_ISA_REF) first = q;
    else if (isa != SV_ISA_SSE41) {
      assert_memory_equal(first.grad, q.grad, sizeof q.grad);
      assert_memory_equal(first.pose, q.pose, sizeof q.pose);
    }
  }
  check_can_fail(c, &s, &t, &q);
}

TEST(test_cases) {
  for (int i = 0; i < N_CASES; i++) check_case(cases + i);
}

// --- Adam ----------------------------------------------------------------------------------------

// Of each step of 300: parameters against the same step in double, m to the nearest of 16 bits, v
// to one of both neighbours. Of all: v, as its rounding has no bias, against the mean of squares
// without rounding.
typedef struct {
  double p, m, v; // largest differences, relative ones of m and v
  double share;   // mean of v's ratio to the unrounded one
} adam_errors;

static adam_errors adam_steps(const sv_kernels *k) {
  enum { N_ROWS = 59, N = 16 * N_ROWS, N_STEPS = 300 };
  static float p[N], g[N];
  static uint16_t m[N], v[N];
  static double exact[N], before[3][N];
  const double b1 = 0.9f, b2 = 0.999f, eps = 1e-15f;
  adam_errors e = {0};
  sv_rng r = sv_rng_make(3, 9);
  for (int i = 0; i < N; i++) {
    p[i] = sv_rng_normal(&r);
    m[i] = v[i] = 0;
    exact[i] = 0;
  }
  for (int t = 1; t <= N_STEPS; t++) {
    float lr[N_ROWS];
    const double bias2 = sqrt(1 - pow(b2, t));
    uint32_t touched = t % 7 ? sv_rng_u32(&r) & 0xffff : 0xffff;
    for (int i = 0; i < N_ROWS; i++) lr[i] = (float)(1e-3 * (1 + i % 5) / (1 - pow(b1, t)));
    for (int i = 0; i < N; i++) {
      g[i] = (touched >> i % 16 & 1) ? sv_rng_normal(&r) * powf(10, (float)(i % 9 - 6)) : 0;
      before[0][i] = (double)p[i];
      before[1][i] = (double)s1_from_high(m[i]);
      before[2][i] = (double)s1_from_high(v[i]);
    }
    sv_adam_args a = {.beta1 = 0.9f,
                      .beta2 = 0.999f,
                      .eps = 1e-15f,
                      .rsqrt_bias2 = (float)(1 / bias2),
                      .lr = lr,
                      .n_rows = N_ROWS,
                      .step = (uint32_t)t};
    k->adam(&a, touched, g, p, m, v);
    for (int i = 0; i < N; i++) {
      if (!(touched >> i % 16 & 1)) continue;
      const double g2 = (double)g[i] * (double)g[i], m1 = b1 * before[1][i] + (1 - b1) * (double)g[i],
                   v1 = b2 * before[2][i] + (1 - b2) * g2;
      const double p1 = before[0][i] - (double)lr[i / 16] * m1 / (sqrt(v1) / bias2 + eps);
      exact[i] = b2 * exact[i] + (1 - b2) * g2;
      e.p = fmax(e.p, fabs((double)p[i] - p1));
      e.m = fmax(e.m, fabs((double)s1_from_high(m[i]) - m1) / (fabs(m1) + 1e-30));
      e.v = fmax(e.v, fabs((double)s1_from_high(v[i]) - v1) / (v1 + 1e-30));
    }
  }
  for (int i = 0; i < N; i++) e.share += (double)s1_from_high(v[i]) / exact[i] / N;
  return e;
}

TEST(test_adam) {
  for (int isa = 0; isa < SV_N_ISAS; isa++) {
    sv_kernels k;
    if (!(sv_cpu_isas() & SV_ISA_BIT(isa))) continue;
    sv_kernels_init(&k, sv_isa_only((sv_isa)isa));
    adam_errors e = adam_steps(&k);
    printf("  adam %s: 300 steps, p off by %.1e, m by %.2g, v by %.2g of itself, its mean by %.1e\n",
           sv_isa_name((sv_isa)isa), e.p, e.m, e.v, e.share - 1);
    assert_true(e.p < 1e-6);       // of size 1, rounded once
    assert_true(e.m < 1.01 / 256); // half of the last of 8 bits
    assert_true(e.v < 1.01 / 128); // all of it
    assert_true(fabs(e.share - 1) < 0.01);
  }
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_cases), cmocka_unit_test(test_adam)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
