// SPDX-License-Identifier: Apache-2.0
// The specification of `project`: one Gaussian at a time, plain C. project_vec.c does the same
// operations in the same order on 16 lanes.
#include "kernels/project/project.h"

#include "kernels/project/sh.h"
#include "kernels/simd/s1_math.h"
#include "kernels/ops.h"

#define LOG2E 1.44269504f

typedef struct {
  float t[3], iz, xz, yz, rx, ry; // camera point; ratios and clamped ratios
  int clamp_x, clamp_y;
  float q[4], rn, rot[9], s[3], w[9]; // unit quaternion, 1/|q|, rotation, scale, w = Rc R diag(s)
  float ja, jb, a[3], b[3];           // rows of J w
  float sxx, sxy, syy, ca, cc, inv_d, conic[3];
  float o, not_o, comp, oe; // opacity, 1 - o without cancellation
  int is_comp_floor;
} geom;

typedef struct {
  float n, rn, is;              // distance, its inverse; 1 / (n + z)
  float h[2], g[3], w, f, e, d; // g: gradient of n + z; f: F(w), e = 2 F', d = 2 F''
  float j[6];                   // Jacobian of (u, v) by the camera point
} wide;

static void rotation(const float q[4], float r[9]) {
  float w = q[0], x = q[1], y = q[2], z = q[3];
  float x2 = x + x, y2 = y + y, z2 = z + z;
  r[0] = fmaf(-2.0f, fmaf(y, y, z * z), 1.0f);
  r[1] = fmaf(x2, y, -(w * z2));
  r[2] = fmaf(x2, z, w * y2);
  r[3] = fmaf(x2, y, w * z2);
  r[4] = fmaf(-2.0f, fmaf(x, x, z * z), 1.0f);
  r[5] = fmaf(y2, z, -(w * x2));
  r[6] = fmaf(x2, z, -(w * y2));
  r[7] = fmaf(y2, z, w * x2);
  r[8] = fmaf(-2.0f, fmaf(x, x, y * y), 1.0f);
}

// p: the Gaussian's lane in its block, rows 16 floats apart.
static void camera_point(const sv_kview *v, const float *p, geom *g) {
  for (int i = 0; i < 3; i++)
    g->t[i] = fmaf(v->r[3 * i], p[0], fmaf(v->r[3 * i + 1], p[16], fmaf(v->r[3 * i + 2], p[32], v->t[i])));
}

static void shape(const float *p, geom *g) {
  const float *q = p + 16 * SV_ROW_QUAT;
  float n2 = fmaf(q[0], q[0], fmaf(q[16], q[16], fmaf(q[32], q[32], q[48] * q[48])));
  g->rn = 1.0f / sqrtf(s1_max(n2, 1e-20f));
  for (int i = 0; i < 4; i++) g->q[i] = q[16 * i] * g->rn;
  rotation(g->q, g->rot);
  for (int i = 0; i < 3; i++) g->s[i] = s1_exp2_fine(p[16 * (SV_ROW_SCALE + i)] * LOG2E);
}

// Column j of w.
static void axis(const sv_kview *v, int j, geom *g) {
  float m0 = g->rot[j] * g->s[j], m1 = g->rot[3 + j] * g->s[j], m2 = g->rot[6 + j] * g->s[j];
  for (int i = 0; i < 3; i++)
    g->w[3 * i + j] = fmaf(v->r[3 * i], m0, fmaf(v->r[3 * i + 1], m1, v->r[3 * i + 2] * m2));
}

// From the rows a and b of J w to the ellipse and the opacity.
static void ellipse(const sv_kview *v, const float *p, geom *g) {
  g->sxx = fmaf(g->a[0], g->a[0], fmaf(g->a[1], g->a[1], g->a[2] * g->a[2]));
  g->sxy = fmaf(g->a[0], g->b[0], fmaf(g->a[1], g->b[1], g->a[2] * g->b[2]));
  g->syy = fmaf(g->b[0], g->b[0], fmaf(g->b[1], g->b[1], g->b[2] * g->b[2]));
  g->ca = g->sxx + v->dilation_px2;
  g->cc = g->syy + v->dilation_px2;
  // The determinant before dilation is |a x b|^2 (Lagrange): never negative, and not the difference
  // of two large products, which for a long splat has no correct digit left.
  float det = 0.0f;
  for (int i = 0; i < 3; i++) {
    int j = (i + 1) % 3, k = (i + 2) % 3;
    float cross = fmaf(g->a[j], g->b[k], -(g->a[k] * g->b[j]));
    det = fmaf(cross, cross, det);
  }
  g->inv_d = 1.0f / fmaf(v->dilation_px2, g->sxx + g->cc, det);
  g->conic[0] = g->cc * g->inv_d;
  g->conic[1] = -(g->sxy * g->inv_d);
  g->conic[2] = g->ca * g->inv_d;
  float e = s1_exp2_fine(p[16 * SV_ROW_LOGIT] * -LOG2E);
  g->o = 1.0f / (1.0f + e);
  g->not_o = e * g->o;
  g->comp = 1.0f;
  g->is_comp_floor = 1;
  if (v->is_antialiased) {
    float ratio = det * g->inv_d;
    g->is_comp_floor = !(ratio > 2.5e-5f);
    g->comp = sqrtf(s1_max(ratio, 2.5e-5f));
  }
  g->oe = g->o * g->comp;
}

static void geometry(const sv_kview *v, const float *p, geom *g) {
  camera_point(v, p, g);
  g->iz = 1.0f / g->t[2];
  g->xz = g->t[0] * g->iz;
  g->yz = g->t[1] * g->iz;
  g->clamp_x = g->xz > v->max_x || g->xz < v->min_x;
  g->clamp_y = g->yz > v->max_y || g->yz < v->min_y;
  g->rx = s1_min(s1_max(g->xz, v->min_x), v->max_x);
  g->ry = s1_min(s1_max(g->yz, v->min_y), v->max_y);
  shape(p, g);
  g->ja = v->fx * g->iz;
  g->jb = v->fy * g->iz;
  for (int j = 0; j < 3; j++) {
    axis(v, j, g);
    g->a[j] = g->ja * fmaf(-g->rx, g->w[6 + j], g->w[j]);
    g->b[j] = g->jb * fmaf(-g->ry, g->w[6 + j], g->w[3 + j]);
  }
  ellipse(v, p, g);
}

// F and its derivatives by Horner's rule.
static void radial(const sv_fisheye *l, wide *x) {
  const float y = fmaf(l->scale, x->w, -1.0f);
  float f0 = l->term[0], f1 = 0.0f, f2 = 0.0f;
  for (int k = 1; k < SV_FISHEYE_TERMS; k++) {
    f2 = fmaf(f2, y, f1);
    f1 = fmaf(f1, y, f0);
    f0 = fmaf(f0, y, l->term[k]);
  }
  const float twice = l->scale + l->scale;
  x->f = f0;
  x->e = f1 * twice;
  x->d = f2 * (twice * twice); // f2: half of the second derivative
}

// The same through a fisheye: x = g->xz and y = g->yz are the image's coordinates over fx and fy.
static void wide_geometry(const sv_kview *v, const float *p, geom *g, wide *x) {
  camera_point(v, p, g);
  x->n = sqrtf(fmaf(g->t[0], g->t[0], fmaf(g->t[1], g->t[1], g->t[2] * g->t[2])));
  const float s = x->n + g->t[2];
  x->rn = 1.0f / x->n;
  x->is = 1.0f / s;
  x->h[0] = g->t[0] * x->is;
  x->h[1] = g->t[1] * x->is;
  x->g[0] = g->t[0] * x->rn;
  x->g[1] = g->t[1] * x->rn;
  x->g[2] = s * x->rn;
  x->w = fmaf(x->h[0], x->h[0], x->h[1] * x->h[1]);
  radial(v->fisheye, x);
  g->xz = x->h[0] * x->f;
  g->yz = x->h[1] * x->f;
  // Rows of d(h F)/dp = F dh/dp + 2 F' h (h . dh/dp)
  const float fi = x->f * x->is, ei = x->e * x->is, ew = x->e * x->w * x->is;
  const float through = fi + ew; // what the change of n + z multiplies
  for (int i = 0; i < 2; i++) {
    const float c = (i ? v->fy : v->fx) * x->h[i], own = (i ? v->fy : v->fx) * fi;
    for (int k = 0; k < 3; k++) x->j[3 * i + k] = -(c * through) * x->g[k];
    for (int k = 0; k < 2; k++) x->j[3 * i + k] = fmaf(c * ei, x->h[k], x->j[3 * i + k]);
    x->j[3 * i + i] += own;
  }
  shape(p, g);
  for (int j = 0; j < 3; j++) {
    axis(v, j, g);
    g->a[j] = fmaf(x->j[0], g->w[j], fmaf(x->j[1], g->w[3 + j], x->j[2] * g->w[6 + j]));
    g->b[j] = fmaf(x->j[3], g->w[j], fmaf(x->j[4], g->w[3 + j], x->j[5] * g->w[6 + j]));
  }
  ellipse(v, p, g);
}

// Is it in the lens's range, and small enough for a linearized projection?
static int is_wide_valid(const sv_kview *v, const geom *g, const wide *x) {
  return x->w <= v->fisheye->max_w && g->sxx + g->syy <= SV_FISHEYE_MAX_VAR * (v->fx * v->fy);
}

static void sh_basis(int degree, float x, float y, float z, float b[16]) {
  b[0] = SH0;
  if (degree < 1) return;
  b[1] = -SH1 * y;
  b[2] = SH1 * z;
  b[3] = -SH1 * x;
  if (degree < 2) return;
  float xx = x * x, yy = y * y, zz = z * z, zz2 = zz + zz, s = xx + yy, d = xx - yy;
  b[4] = SH2A * (x * y);
  b[5] = -SH2A * (y * z);
  b[6] = SH2B * (zz2 - s);
  b[7] = -SH2A * (x * z);
  b[8] = SH2C * d;
  if (degree < 3) return;
  float zz4 = zz2 + zz2;
  b[9] = -SH3A * (y * fmaf(3.0f, xx, -yy));
  b[10] = SH3B * (x * y * z);
  b[11] = -SH3C * (y * (zz4 - s));
  b[12] = SH3D * (z * fmaf(-3.0f, s, zz2));
  b[13] = -SH3C * (x * (zz4 - s));
  b[14] = SH3E * (z * d);
  b[15] = -SH3A * (x * fmaf(-3.0f, yy, xx));
}

static float direction(const sv_kview *v, const float *p, float d[3]) { // unit; returns 1/distance
  for (int i = 0; i < 3; i++) d[i] = p[16 * i] - v->centre[i];
  float rl = 1.0f / sqrtf(s1_max(fmaf(d[0], d[0], fmaf(d[1], d[1], d[2] * d[2])), 1e-20f));
  for (int i = 0; i < 3; i++) d[i] *= rl;
  return rl;
}

// before the clamp at 0
static float colour(const float *sh, int c, int n_coef, const float b[16]) {
  float s = 0.5f;
  for (int k = 0; k < n_coef; k++) s = fmaf(b[k], sh[16 * (3 * k + c)], s);
  return s;
}

static void project_one(const sv_project_args *a, int id, const float *p) {
  const sv_kview *v = &a->view;
  sv_splat *s = a->splat + id;
  geom g;
  float z;
  int is_valid = 1;
  if (v->fisheye) {
    wide x;
    wide_geometry(v, p, &g, &x);
    is_valid = is_wide_valid(v, &g, &x);
    z = x.n;
  } else {
    geometry(v, p, &g);
    z = g.t[2];
  }
  float lo = s1_log2(g.oe) + a->log2_compensation, level = lo - SV_LOG2_ALPHA_MIN;
  float tau = 1.38629436f * s1_max(level, 0.0f); // 2 ln(255 o)
  s->u_px = fmaf(v->fx, g.xz, v->cx);
  s->v_px = fmaf(v->fy, g.yz, v->cy);
  s->qa = -0.5f * LOG2E * g.conic[0];
  s->qb = -LOG2E * g.conic[1];
  s->qc = -0.5f * LOG2E * g.conic[2];
  s->lo = lo - SV_POWER_SHIFT;
  s->z = z;
  // half-widths of the region where alpha >= 1/255
  float ex = sqrtf(tau * g.ca), ey = sqrtf(tau * g.cc);
  s->dy_right = s->qb * ex / (2.0f * s->qc);
  s->inv_2qa = 0.5f / s->qa;
  float w1 = (float)(v->width_px - 1), h1 = (float)(v->height_px - 1);
  float x0 = s1_max(0.0f, s->u_px - ex - 0.5f), x1 = s1_min(s->u_px + ex - 0.5f, w1);
  float y0 = s1_max(0.0f, s->v_px - ey - 0.5f), y1 = s1_min(s->v_px + ey - 0.5f, h1);
  // A NaN anywhere makes x0 or y0 a NaN, and a form that is not negative an infinite splat: not
  // visible.
  int is_visible = z > v->near_z && level > 0.0f && x0 <= x1 && y0 <= y1 && id < a->n_gaussians;
  is_visible = is_visible && is_valid && s->qa < 0.0f && s->qc < 0.0f;
  is_visible = is_visible && !(a->dropout_mask && (a->dropout_mask[id / SV_LANES] >> id % SV_LANES & 1));
  int n_coef = (a->sh_degree + 1) * (a->sh_degree + 1);
  float d[3], b[16];
  direction(v, p, d);
  sh_basis(a->sh_degree, d[0], d[1], d[2], b);
  for (int c = 0; c < 3; c++) s->rgb[c] = s1_max(colour(p + 16 * SV_ROW_SH, c, n_coef, b), 0.0f);
  s->intersection_offset = 0;
  s->bx0 = s->bx1 = s->by0 = s->by1 = 0;
  s->n_intersections = 0;
  if (!is_visible) return;
  int px0 = (int)(x0 + SV_ROUND_UP), px1 = (int)x1, py0 = (int)(y0 + SV_ROUND_UP), py1 = (int)y1;
  if (px0 > px1 || py0 > py1) return; // between the pixels' centres
  s->bx0 = (uint16_t)(px0 / 4);
  s->bx1 = (uint16_t)(px1 / 4);
  s->by0 = (uint16_t)(py0 / 4);
  s->by1 = (uint16_t)(py1 / 4);
  s->n_intersections =
      (uint32_t)((s->bx1 >> 3) - (s->bx0 >> 3) + 1) * (uint32_t)((s->by1 >> 3) - (s->by0 >> 3) + 1);
  a->depth_key[id] = s1_bits(z);
}

sv_project_counts sv_project_ref(const sv_project_args *a, int block0, int block1, float *scratch) {
  sv_project_counts n = {0, 0};
  (void)scratch; // the scalar form needs none
  for (int b = block0; b < block1; b++)
    for (int k = 0; k < SV_LANES; k++) {
      const int id = b * SV_LANES + k;
      project_one(a, id, a->param + (long)b * a->n_rows * SV_LANES + k);
      n.n_visible += a->splat[id].n_intersections != 0;
      n.n_intersections += a->splat[id].n_intersections;
    }
  return n;
}

// Here no result of fmaf is negated: compilers make one instruction of the two, and that gives the
// other zero.
// --- backward ----------------------------------------

// g: derivatives by x, y and z.
static void sh_basis_grad(int degree, const float dir[3], float g[3][16]) {
  const float x = dir[0], y = dir[1], z = dir[2];
  float *bx = g[0], *by = g[1], *bz = g[2];
  for (int k = 0; k < 16; k++) bx[k] = by[k] = bz[k] = 0.0f;
  if (degree < 1) return;
  by[1] = -SH1;
  bz[2] = SH1;
  bx[3] = -SH1;
  if (degree < 2) return;
  float xx = x * x, yy = y * y, zz = z * z, s = xx + yy, d = xx - yy, xy = x * y, xz = x * z, yz = y * z;
  bx[4] = SH2A * y;
  by[4] = SH2A * x;
  by[5] = -SH2A * z;
  bz[5] = -SH2A * y;
  bx[6] = -2.0f * SH2B * x;
  by[6] = -2.0f * SH2B * y;
  bz[6] = 4.0f * SH2B * z;
  bx[7] = -SH2A * z;
  bz[7] = -SH2A * x;
  bx[8] = 2.0f * SH2C * x;
  by[8] = -2.0f * SH2C * y;
  if (degree < 3) return;
  float zz4 = 4.0f * zz;
  bx[9] = -6.0f * SH3A * xy;
  by[9] = -3.0f * SH3A * d;
  bx[10] = SH3B * yz;
  by[10] = SH3B * xz;
  bz[10] = SH3B * xy;
  bx[11] = 2.0f * SH3C * xy;
  by[11] = -SH3C * (zz4 - fmaf(3.0f, yy, xx));
  bz[11] = -8.0f * SH3C * yz;
  bx[12] = -6.0f * SH3D * xz;
  by[12] = -6.0f * SH3D * yz;
  bz[12] = SH3D * fmaf(6.0f, zz, -3.0f * s);
  bx[13] = -SH3C * (zz4 - fmaf(3.0f, xx, yy));
  by[13] = 2.0f * SH3C * xy;
  bz[13] = -8.0f * SH3C * xz;
  bx[14] = 2.0f * SH3E * xz;
  by[14] = -2.0f * SH3E * yz;
  bz[14] = SH3E * d;
  bx[15] = -3.0f * SH3A * d;
  by[15] = 6.0f * SH3A * xy;
}

// Conic and opacity moments -> twice the gradient of the 2D covariance [xx, xy (matrix entry), yy],
// and that of the logit. (The moments are -2 times the gradient of the conic: no factor is left.)
static float screen_bwd(const sv_kview *v, const geom *g, const float *m, float vs[3]) {
  float ga = m[SV_IGRAD_GXX], gb = m[SV_IGRAD_GXY], gc = m[SV_IGRAD_GYY];
  float A = g->conic[0], B = g->conic[1], C = g->conic[2];
  float q00 = fmaf(A, ga, B * gb), q01 = fmaf(A, gb, B * gc), q10 = fmaf(B, ga, C * gb),
        q11 = fmaf(B, gb, C * gc);
  vs[0] = fmaf(q00, A, q01 * B);
  vs[1] = fmaf(q00, B, q01 * C);
  vs[2] = fmaf(q10, B, q11 * C);
  float v_oe = m[SV_IGRAD_G] / g->oe, v_o = v_oe * g->comp;
  if (v->is_antialiased && !g->is_comp_floor) {
    // h d(comp^2)/dS, by the adjugate: the textbook form (1 - comp^2) Q - 0.3 det Q I is a
    // difference of equals.
    float h = v_oe * g->o / g->comp * v->dilation_px2, bb = B * B;
    vs[0] = fmaf(h, fmaf(A, g->syy * g->inv_d, bb), vs[0]);
    vs[1] = fmaf(h, B * ((g->sxx + g->cc) * g->inv_d), vs[1]);
    vs[2] = fmaf(h, fmaf(C, g->sxx * g->inv_d, bb), vs[2]);
  }
  return v_o * (g->o * g->not_o);
}

// Through the projection: dL/dt (camera point) and dL/dw.
static void camera_bwd(const geom *g, const float *m, const float vs[3], float vt[3], float vw[9]) {
  float vu = fmaf(-g->conic[0], m[SV_IGRAD_GX], -(g->conic[1] * m[SV_IGRAD_GY]));
  float vv = fmaf(-g->conic[1], m[SV_IGRAD_GX], -(g->conic[2] * m[SV_IGRAD_GY]));
  float j00 = 0, j02 = 0, j11 = 0, j12 = 0;
  for (int j = 0; j < 3; j++) {
    float va = fmaf(vs[0], g->a[j], vs[1] * g->b[j]), vb = fmaf(vs[1], g->a[j], vs[2] * g->b[j]);
    float pa = g->ja * va, pb = g->jb * vb;
    vw[j] = pa;
    vw[3 + j] = pb;
    vw[6 + j] = fmaf(-g->rx, pa, -(g->ry * pb));
    j00 = fmaf(va, g->w[j], j00);
    j02 = fmaf(va, g->w[6 + j], j02);
    j11 = fmaf(vb, g->w[3 + j], j11);
    j12 = fmaf(vb, g->w[6 + j], j12);
  }
  float ja = g->ja, jb = g->jb, iz = g->iz, kx = ja * iz * j02, ky = jb * iz * j12;
  vt[0] = ja * vu;
  vt[1] = jb * vv;
  vt[2] = fmaf(-iz, fmaf(ja, j00, jb * j11), m[SV_IGRAD_Z] - fmaf(ja * g->xz, vu, jb * g->yz * vv));
  vt[2] = fmaf(g->clamp_x ? g->rx : 2.0f * g->rx, kx, vt[2]);
  vt[2] = fmaf(g->clamp_y ? g->ry : 2.0f * g->ry, ky, vt[2]);
  if (!g->clamp_x) vt[0] -= kx;
  if (!g->clamp_y) vt[1] -= ky;
}

// The same through a fisheye. With P the gradient of J's rows by F and F', times (fx, fy), the
// loss's share that J carries is  is (F (sigma - beta) + 2 F' (kappa - w beta))  where sigma is the
// trace of P's left half, kappa = h^T P h, and beta = h . (P g).
static void wide_camera_bwd(const sv_kview *v, const geom *g, const wide *x, const float *m,
                            const float vs[3], float vt[3], float vw[9]) {
  const float *j = x->j, *h = x->h;
  float vu = fmaf(-g->conic[0], m[SV_IGRAD_GX], -(g->conic[1] * m[SV_IGRAD_GY]));
  float vv = fmaf(-g->conic[1], m[SV_IGRAD_GX], -(g->conic[2] * m[SV_IGRAD_GY]));
  float p0[3] = {0, 0, 0}, p1[3] = {0, 0, 0};
  for (int k = 0; k < 3; k++) {
    float va = fmaf(vs[0], g->a[k], vs[1] * g->b[k]), vb = fmaf(vs[1], g->a[k], vs[2] * g->b[k]);
    for (int i = 0; i < 3; i++) {
      vw[3 * i + k] = fmaf(j[i], va, j[3 + i] * vb);
      p0[i] = fmaf(va, g->w[3 * i + k], p0[i]);
      p1[i] = fmaf(vb, g->w[3 * i + k], p1[i]);
    }
  }
  for (int i = 0; i < 3; i++) {
    p0[i] *= v->fx;
    p1[i] *= v->fy;
  }
  const float alpha0 = fmaf(p0[0], x->g[0], fmaf(p0[1], x->g[1], p0[2] * x->g[2]));
  const float alpha1 = fmaf(p1[0], x->g[0], fmaf(p1[1], x->g[1], p1[2] * x->g[2]));
  const float sigma = p0[0] + p1[1], across = p0[1] + p1[0];
  const float beta = fmaf(h[0], alpha0, h[1] * alpha1);
  const float kappa = fmaf(h[0] * h[0], p0[0], fmaf(h[0] * h[1], across, h[1] * h[1] * p1[1]));
  const float left = sigma - beta, right = fmaf(-x->w, beta, kappa);
  const float v_is = fmaf(x->f, left, x->e * right), is = x->is;
  const float v_beta = -(is * fmaf(x->e, x->w, x->f)), v_kappa = is * x->e;
  // by w, twice, as w = |h|^2
  const float v_w = is * fmaf(x->e, left, fmaf(x->d + x->d, right, -2.0f * (x->e * beta)));
  const float v_h0 = fmaf(v_beta, alpha0, fmaf(v_kappa, fmaf(2.0f * p0[0], h[0], across * h[1]), v_w * h[0]));
  const float v_h1 = fmaf(v_beta, alpha1, fmaf(v_kappa, fmaf(2.0f * p1[1], h[1], across * h[0]), v_w * h[1]));
  const float b0 = v_beta * h[0], b1 = v_beta * h[1];
  float v_g[3];
  for (int k = 0; k < 3; k++) v_g[k] = fmaf(b0, p0[k], b1 * p1[k]);
  // h = (x, y) is, g = (x, y, s) rn, is = 1 / s, s = n + z. v_g . (x, y, s) = n v_g . g.
  const float to_is = fmaf(v_h0, g->t[0], fmaf(v_h1, g->t[1], v_is));
  const float v_s = fmaf(-is * is, to_is, v_g[2] * x->rn);
  const float to_rn = fmaf(v_g[0], x->g[0], fmaf(v_g[1], x->g[1], v_g[2] * x->g[2]));
  const float v_n = fmaf(-x->rn, to_rn, v_s + m[SV_IGRAD_Z]) * x->rn; // over n
  vt[0] = fmaf(v_n, g->t[0], fmaf(v_h0, is, v_g[0] * x->rn));
  vt[1] = fmaf(v_n, g->t[1], fmaf(v_h1, is, v_g[1] * x->rn));
  vt[2] = fmaf(v_n, g->t[2], v_s);
  for (int k = 0; k < 3; k++) vt[k] = fmaf(j[k], vu, fmaf(j[3 + k], vv, vt[k]));
}

// Through w = Rc R(q) diag(s): rows quat and scale of grad.
static void shape_bwd(const sv_kview *v, const geom *g, const float vw[9], float *grad) {
  float r[9];
  for (int j = 0; j < 3; j++) {
    float vm[3], s = 0;
    for (int i = 0; i < 3; i++) {
      vm[i] = fmaf(v->r[i], vw[j], fmaf(v->r[3 + i], vw[3 + j], v->r[6 + i] * vw[6 + j]));
      s = fmaf(g->rot[3 * i + j], vm[i], s);
      r[3 * i + j] = vm[i] * g->s[j];
    }
    grad[16 * (SV_ROW_SCALE + j)] = s * g->s[j];
  }
  float w = g->q[0], x = g->q[1], y = g->q[2], z = g->q[3], vq[4];
  float dx = r[7] - r[5], dy = r[2] - r[6], dz = r[3] - r[1], pxy = r[3] + r[1], pxz = r[6] + r[2],
        pyz = r[7] + r[5];
  float rn2 = g->rn + g->rn; // vq: half of the gradient of the unit quaternion
  vq[0] = fmaf(x, dx, fmaf(y, dy, z * dz));
  vq[1] = fmaf(-2.0f * x, r[4] + r[8], fmaf(y, pxy, fmaf(z, pxz, w * dx)));
  vq[2] = fmaf(-2.0f * y, r[0] + r[8], fmaf(x, pxy, fmaf(z, pyz, w * dy)));
  vq[3] = fmaf(-2.0f * z, r[0] + r[4], fmaf(x, pxz, fmaf(y, pyz, w * dz)));
  float dot = fmaf(vq[0], w, fmaf(vq[1], x, fmaf(vq[2], y, vq[3] * z)));
  for (int i = 0; i < 4; i++) grad[16 * (SV_ROW_QUAT + i)] = fmaf(dot, -g->q[i], vq[i]) * rn2;
}

// SH rows of grad; returns dL/dmean through the viewing direction in vm.
static void colour_bwd(const sv_project_args *a, const float *p, const float *v_rgb, float *grad,
                       float vm[3]) {
  int n = (a->sh_degree + 1) * (a->sh_degree + 1);
  const float *sh = p + 16 * SV_ROW_SH;
  float d[3], b[16], by_dir[3][16], vd[3] = {0, 0, 0}, vc[3];
  float rl = direction(&a->view, p, d);
  sh_basis(a->sh_degree, d[0], d[1], d[2], b);
  sh_basis_grad(a->sh_degree, d, by_dir);
  for (int c = 0; c < 3; c++) vc[c] = colour(sh, c, n, b) > 0.0f ? v_rgb[c] : 0.0f;
  for (int k = 0; k < n; k++) {
    for (int c = 0; c < 3; c++) grad[16 * (SV_ROW_SH + 3 * k + c)] = b[k] * vc[c];
    if (k == 0) continue;
    float f = fmaf(sh[16 * 3 * k], vc[0], fmaf(sh[16 * (3 * k + 1)], vc[1], sh[16 * (3 * k + 2)] * vc[2]));
    for (int i = 0; i < 3; i++) vd[i] = fmaf(by_dir[i][k], f, vd[i]);
  }
  float dot = fmaf(vd[0], d[0], fmaf(vd[1], d[1], vd[2] * d[2]));
  for (int i = 0; i < 3; i++) vm[i] = fmaf(dot, -d[i], vd[i]) * rl;
}

static void one_bwd(const sv_project_bwd_args *args, const float *p, const float *m, float *grad,
                    float pose[6]) {
  const sv_project_args *a = args->fwd;
  const sv_kview *v = &a->view;
  geom g;
  float vs[3], vt[3], vw[9], vm[3];
  if (v->fisheye) {
    wide x;
    wide_geometry(v, p, &g, &x);
    grad[16 * SV_ROW_LOGIT] = screen_bwd(v, &g, m, vs);
    wide_camera_bwd(v, &g, &x, m, vs, vt, vw);
  } else {
    geometry(v, p, &g);
    grad[16 * SV_ROW_LOGIT] = screen_bwd(v, &g, m, vs);
    camera_bwd(&g, m, vs, vt, vw);
  }
  shape_bwd(v, &g, vw, grad);
  grad[16 * SV_ROW_LOGIT] = fmaf(args->reg_opacity, g.o * (1.0f - g.o), grad[16 * SV_ROW_LOGIT]);
  for (int j = 0; j < 3; j++)
    grad[16 * (SV_ROW_SCALE + j)] = fmaf(args->reg_scale, g.s[j], grad[16 * (SV_ROW_SCALE + j)]);
  colour_bwd(a, p, m + SV_IGRAD_RGB, grad, vm);
  for (int i = 0; i < 3; i++)
    grad[16 * i] = fmaf(v->r[i], vt[0], fmaf(v->r[3 + i], vt[1], fmaf(v->r[6 + i], vt[2], vm[i])));
  for (int i = 0; i < 3; i++) {
    int j = (i + 1) % 3, k = (i + 2) % 3;
    float tq = fmaf(g.t[j], vt[k], -(g.t[k] * vt[j]));
    for (int c = 0; c < 3; c++)
      tq = fmaf(g.w[3 * j + c], vw[3 * k + c], fmaf(-g.w[3 * k + c], vw[3 * j + c], tq));
    pose[i] = tq;
    pose[3 + i] = fmaf(v->r[3 * i], vm[0], fmaf(v->r[3 * i + 1], vm[1], fmaf(v->r[3 * i + 2], vm[2], vt[i])));
  }
}

uint32_t sv_project_bwd_ref(const sv_project_bwd_args *args, int block, float *grad, float *err,
                            float *scratch) {
  (void)scratch;
  const sv_project_args *a = args->fwd;
  const float *p = a->param + (long)block * a->n_rows * SV_LANES;
  int n_used = SV_N_ROWS(a->sh_degree);
  uint32_t touched = 0;
  float pose[6][16] = {{0}};
  for (int i = 0; i < n_used * SV_LANES; i++) grad[i] = 0.0f;
  for (int k = 0; k < SV_LANES; k++) {
    const sv_splat *s = a->splat + block * SV_LANES + k;
    float m[SV_IGRAD_VALUES] = {0}, of_intersection[SV_IGRAD_VALUES], one[6];
    int is_touched = 0;
    for (uint32_t r = s->intersection_offset; r < s->intersection_offset + s->n_intersections; r++) {
      if (!args->intersection[r].mask) continue;
      is_touched = 1;
      s1_load11(args->igrad + (long)r * SV_IGRAD_BYTES, of_intersection);
      for (int i = 0; i < SV_IGRAD_VALUES; i++) m[i] += of_intersection[i];
    }
    err[k] = m[SV_IGRAD_ERR];
    if (!is_touched) continue;
    touched |= 1u << k;
    one_bwd(args, p + k, m, grad + k, one);
    for (int i = 0; i < 6; i++) pose[i][k] = one[i];
  }
  if (args->pose_grad)
    for (int i = 0; i < 6; i++) args->pose_grad[i] = s1_sum16(pose[i]);
  return touched;
}
