// SPDX-License-Identifier: Apache-2.0
#include "tests/grad/splat_double.h"

#include <math.h>
#include <string.h>

typedef struct {
  double u, v, z, conic[3], opacity, rgb[3];
  double sigma_max; // beyond it alpha is under 1/255 by a margin that `margin` cannot see
  int i;
} screen;

static void mul(const double *a, const double *b, double *c, int n, int k, int m) { // [n][k] [k][m]
  for (int i = 0; i < n; i++)
    for (int j = 0; j < m; j++) {
      c[i * m + j] = 0;
      for (int l = 0; l < k; l++) c[i * m + j] += a[i * k + l] * b[l * m + j];
    }
}

static void transpose(const double *a, double *b, int n, int m) {
  for (int i = 0; i < n; i++)
    for (int j = 0; j < m; j++) b[j * n + i] = a[i * m + j];
}

static void rotation_of_vector(const double w[3], double r[9]) { // Rodrigues
  double angle = sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]);
  double k[9] = {0, -w[2], w[1], w[2], 0, -w[0], -w[1], w[0], 0}, k2[9];
  mul(k, k, k2, 3, 3, 3);
  double a = angle < 1e-4 ? 1 - angle * angle / 6 : sin(angle) / angle;
  double b = angle < 1e-4 ? 0.5 - angle * angle / 24 : (1 - cos(angle)) / (angle * angle);
  for (int i = 0; i < 9; i++) r[i] = (i % 4 == 0) + a * k[i] + b * k2[i];
}

static void rotation_of_quat(const double q_in[4], double r[9]) {
  double n = sqrt(q_in[0] * q_in[0] + q_in[1] * q_in[1] + q_in[2] * q_in[2] + q_in[3] * q_in[3]);
  double w = q_in[0] / n, x = q_in[1] / n, y = q_in[2] / n, z = q_in[3] / n;
  double m[9] = {1 - 2 * (y * y + z * z), 2 * (x * y - w * z),     2 * (x * z + w * y),
                 2 * (x * y + w * z),     1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
                 2 * (x * z - w * y),     2 * (y * z + w * x),     1 - 2 * (x * x + y * y)};
  memcpy(r, m, sizeof m);
}

static void sh_basis(const double d[3], double b[16]) {
  double x = d[0], y = d[1], z = d[2], xx = x * x, yy = y * y, zz = z * z;
  b[0] = 0.28209479177387814;
  b[1] = -0.4886025119029199 * y;
  b[2] = 0.4886025119029199 * z;
  b[3] = -0.4886025119029199 * x;
  b[4] = 1.0925484305920792 * x * y;
  b[5] = -1.0925484305920792 * y * z;
  b[6] = 0.31539156525252005 * (2 * zz - xx - yy);
  b[7] = -1.0925484305920792 * x * z;
  b[8] = 0.5462742152960396 * (xx - yy);
  b[9] = -0.5900435899266435 * y * (3 * xx - yy);
  b[10] = 2.890611442640554 * x * y * z;
  b[11] = -0.4570457994644658 * y * (4 * zz - xx - yy);
  b[12] = 0.3731763325901154 * z * (2 * zz - 3 * xx - 3 * yy);
  b[13] = -0.4570457994644658 * x * (4 * zz - xx - yy);
  b[14] = 1.445305721320277 * z * (xx - yy);
  b[15] = -0.5900435899266435 * x * (xx - 3 * yy);
}

static void colour(const double *sh, int degree, const double dir[3], double rgb[3]) {
  double b[16];
  sh_basis(dir, b);
  for (int c = 0; c < 3; c++) {
    double s = 0.5;
    for (int k = 0; k < (degree + 1) * (degree + 1); k++) s += b[k] * sh[3 * k + c];
    rgb[c] = s > 0 ? s : 0;
  }
}

static double clamp(double x, double lo, double hi) { return x < lo ? lo : x > hi ? hi : x; }

// 2D covariance of one Gaussian before dilation: J Rc Sigma Rc^T J^T.
static void covariance(const dr_view *v, const double rc[9], const double *p, const double t[3],
                       double s2[4]) {
  double rq[9], m[9], mt[9], sigma[9], rct[9], tmp[9], cam[9], jt[6], jv[6];
  rotation_of_quat(p + 3, rq);
  for (int i = 0; i < 9; i++) m[i] = rq[i] * exp(p[7 + i % 3]);
  transpose(m, mt, 3, 3);
  mul(m, mt, sigma, 3, 3, 3);
  transpose(rc, rct, 3, 3);
  mul(rc, sigma, tmp, 3, 3, 3);
  mul(tmp, rct, cam, 3, 3, 3);
  double w = v->width_px, h = v->height_px, gx = 0.15 * w / v->fx,
         gy = 0.15 * h / v->fy; // 0.3 x half the view
  double rx = clamp(t[0] / t[2], -v->cx / v->fx - gx, (w - v->cx) / v->fx + gx);
  double ry = clamp(t[1] / t[2], -v->cy / v->fy - gy, (h - v->cy) / v->fy + gy);
  double uv[2], j[6] = {v->fx / t[2], 0, -v->fx * rx / t[2], 0, v->fy / t[2], -v->fy * ry / t[2]};
  if (v->fisheye) (void)sv_model_project(v->fisheye, t, uv, j, NULL);
  transpose(j, jt, 2, 3);
  mul(j, cam, jv, 2, 3, 3);
  mul(jv, jt, s2, 2, 3, 2);
}

static bool project(const dr_view *v, double gain, const double rc[9], const double tc[3], const double *p,
                    screen *s) {
  double t[3], s2[4], centre[3], d[3];
  mul(rc, p, t, 3, 3, 1);
  for (int i = 0; i < 3; i++) t[i] += tc[i];
  const double distance = sqrt(t[0] * t[0] + t[1] * t[1] + t[2] * t[2]);
  double uv[2] = {v->fx * t[0] / t[2] + v->cx, v->fy * t[1] / t[2] + v->cy};
  if (!((v->fisheye ? distance : t[2]) > v->near_z)) return false;
  if (v->fisheye && !sv_model_project(v->fisheye, t, uv, NULL, NULL)) return false;
  covariance(v, rc, p, t, s2);
  double a = s2[0] + 0.3, b = s2[1], c = s2[3] + 0.3, det = a * c - b * b;
  double comp2 = (s2[0] * s2[3] - s2[1] * s2[1]) / det;
  s->opacity = 1 / (1 + exp(-p[10]));
  if (v->is_antialiased) s->opacity *= sqrt(comp2 > 0.005 * 0.005 ? comp2 : 0.005 * 0.005);
  s->opacity *= gain;
  s->conic[0] = c / det;
  s->conic[1] = -b / det;
  s->conic[2] = a / det;
  s->u = uv[0];
  s->v = uv[1];
  s->z = v->fisheye ? distance : t[2];
  s->sigma_max = log(255 * s->opacity) + 0.1;
  double n = 0;
  for (int i = 0; i < 3; i++) {
    centre[i] = -(rc[i] * tc[0] + rc[3 + i] * tc[1] + rc[6 + i] * tc[2]);
    d[i] = p[i] - centre[i];
    n += d[i] * d[i];
  }
  for (int i = 0; i < 3; i++) d[i] /= sqrt(n);
  colour(p + 11, v->sh_degree, d, s->rgb);
  return s->opacity > 0.9 / 255;
}

static int prepare(const dr_scene *s, screen *out) {
  const dr_view *v = &s->view;
  double e[9], rc[9], tc[3];
  int n = 0;
  rotation_of_vector(v->twist, e);
  mul(e, v->r, rc, 3, 3, 3);
  mul(e, v->t, tc, 3, 3, 1);
  for (int i = 0; i < 3; i++) tc[i] += v->twist[3 + i];
  for (int i = 0; i < s->n; i++) {
    screen g = {.i = i};
    if (s->is_dropped[i] || !project(v, s->gain, rc, tc, s->p[i], &g)) continue;
    int k = n++;
    for (; k > 0 && out[k - 1].z > g.z; k--) out[k] = out[k - 1];
    out[k] = g;
  }
  return n;
}

typedef struct {
  double rgb[3], depth, trans, margin;
  bool is_low;
} pixel;

// All of a pixel as seen through `trans`: front + trans * rest.
static void add_rest(pixel *q, const dr_rest *rest) {
  for (int c = 0; c < 3; c++) q->rgb[c] += q->trans * rest->rgb[c];
  q->depth += q->trans * rest->depth;
  q->trans *= rest->trans;
}

static dr_rest rest_of(const pixel *front, const pixel *all) {
  dr_rest r = {.depth = (all->depth - front->depth) / front->trans, .trans = all->trans / front->trans};
  for (int c = 0; c < 3; c++) r.rgb[c] = (all->rgb[c] - front->rgb[c]) / front->trans;
  return r;
}

// given: the rest that is not looked at again, or NULL; rest: that of this pixel, or NULL.
static pixel shade(const screen *g, int n, double x, double y, double err, dr_share *share,
                   const dr_rest *given, dr_rest *rest) {
  pixel q = {{0, 0, 0}, 0, 1, 1, false}, front = q;
  for (int i = 0; i < n; i++) {
    double dx = g[i].u - x, dy = g[i].v - y;
    double sigma = 0.5 * (g[i].conic[0] * dx * dx + g[i].conic[2] * dy * dy) + g[i].conic[1] * dx * dy;
    if (sigma > g[i].sigma_max) continue;
    double raw = g[i].opacity * exp(-sigma), a = raw > 0.99 ? 0.99 : raw;
    q.margin = fmin(q.margin, fabs(raw * 255 - 1));
    if (share && share[g[i].i].peak_alpha < raw) share[g[i].i].peak_alpha = raw;
    if (raw < 1.0 / 255) continue;
    double w = a * q.trans;
    for (int c = 0; c < 3; c++) q.rgb[c] += w * g[i].rgb[c];
    q.depth += w * g[i].z;
    q.trans *= 1 - a;
    if (q.is_low) continue;
    if (share) {
      share[g[i].i].weight += w;
      share[g[i].i].err += w * err;
    }
    q.margin = fmin(q.margin, fabs(q.trans * 1e4 - 1));
    q.is_low = q.trans < 1e-4;
    if (q.is_low) front = q;
    if (q.is_low && given) {
      add_rest(&q, given);
      return q;
    }
  }
  if (rest && q.is_low) *rest = rest_of(&front, &q);
  return q;
}

void dr_render(const dr_scene *s, const dr_picture *out, const double *err, dr_share *share) {
  screen g[DR_CAP_GAUSSIANS];
  int n = prepare(s, g);
  if (share) memset(share, 0, (size_t)s->n * sizeof *share);
  for (int i = 0; share && i < n; i++) share[g[i].i].is_drawn = g[i].opacity >= 1.0 / 255;
  for (int y = 0; y < s->view.height_px; y++)
    for (int x = 0; x < s->view.width_px; x++) {
      int o = y * s->view.width_px + x;
      pixel q =
          shade(g, n, x + 0.5, y + 0.5, err ? err[o] : 0, share, NULL, out->rest ? out->rest + o : NULL);
      for (int c = 0; c < 3; c++)
        if (out->rgb[c]) out->rgb[c][o] = q.rgb[c] + q.trans * s->view.bg[c];
      if (out->depth) out->depth[o] = q.depth;
      if (out->trans) out->trans[o] = q.trans;
      if (out->margin) out->margin[o] = q.margin;
      if (out->n_low) *out->n_low += q.is_low;
    }
}

double dr_loss(const dr_scene *s, const dr_weights *w) {
  screen g[DR_CAP_GAUSSIANS];
  int n = prepare(s, g);
  double sum = 0;
  for (int y = 0; y < s->view.height_px; y++)
    for (int x = 0; x < s->view.width_px; x++) {
      int o = y * s->view.width_px + x;
      pixel q = shade(g, n, x + 0.5, y + 0.5, 0, NULL, w->rest ? w->rest + o : NULL, NULL);
      for (int c = 0; c < 3; c++) sum += w->rgb[c][o] * (q.rgb[c] + q.trans * s->view.bg[c]);
      if (w->depth) sum += w->depth[o] * q.depth;
      if (w->trans) sum += w->trans[o] * q.trans;
    }
  return sum;
}
