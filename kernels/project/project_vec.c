// SPDX-License-Identifier: Apache-2.0
// `project` on 16 Gaussians at once. project_ref.c is the specification: same operations, same
// order.
#include "kernels/project/project.h"
#include "kernels/simd/v16.h"
#include "kernels/project/sh.h"

#define LOG2E 1.44269504f
#define S(x)  v16_set1(x)

typedef struct {
  v16 t[3], iz, xz, yz, rx, ry;
  v16 q[4], rn, rot[9], s[3], w[9];
  v16 ja, jb, a[3], b[3];
  v16 sxx, sxy, syy, ca, cc, inv_d, conic[3];
  v16 o, not_o, comp, oe;
  v16m is_comp_floor;
} geom;

typedef struct {
  v16 row[16]; // of a block's splats; backward the sums of its intersections
  geom g;
  v16 m[12], vs[3], vt[3], vw[9], vm[3];
} project_work;

// Where the registers hold many vectors each direction is one function, and what they cannot hold
// goes to the stack. Else it is several, and what they share is in the caller's scratch: it would
// fill several KiB of stack.
#if V16_REGISTERS >= 32
#define PART V16_INLINE
#else
#define PART static __attribute__((noinline))
#endif
#ifdef V16_UNROLL // vectors of four registers: without loops the code would leave the first cache
#define UNROLL
#define UNROLL_SH
#else
#define UNROLL    _Pragma("GCC unroll 4")
#define UNROLL_SH _Pragma("GCC unroll 16")
#endif
_Static_assert(sizeof(project_work) <= SV_PROJECT_SCRATCH_FLOATS * sizeof(float), "scratch is too small");

static inline v16 dot3_(v16 a0, v16 b0, v16 a1, v16 b1, v16 a2, v16 b2) {
  return v16_fma(a0, b0, v16_fma(a1, b1, v16_mul(a2, b2)));
}

V16_INLINE void rotation(const v16 q[4], v16 r[9]) {
  v16 w = q[0], x = q[1], y = q[2], z = q[3], one = S(1.0f), m2 = S(-2.0f);
  v16 x2 = v16_add(x, x), y2 = v16_add(y, y), z2 = v16_add(z, z);
  v16 wx = v16_mul(w, x2), wy = v16_mul(w, y2), wz = v16_mul(w, z2);
  r[0] = v16_fma(m2, v16_fma(y, y, v16_mul(z, z)), one);
  r[1] = v16_fms(x2, y, wz);
  r[2] = v16_fma(x2, z, wy);
  r[3] = v16_fma(x2, y, wz);
  r[4] = v16_fma(m2, v16_fma(x, x, v16_mul(z, z)), one);
  r[5] = v16_fms(y2, z, wx);
  r[6] = v16_fms(x2, z, wy);
  r[7] = v16_fma(y2, z, wx);
  r[8] = v16_fma(m2, v16_fma(x, x, v16_mul(y, y)), one);
}

static inline v16 clamp_ratio(v16 x, float least, float most) {
  return v16_min(v16_max(x, S(least)), S(most));
}
static inline v16m is_clamped(v16 x, float least, float most) {
  return v16m_or(v16_gt(x, S(most)), v16_lt(x, S(least)));
}

// An ellipse in stages of a hundred instructions at the most, so that two blocks can take turns.
V16_INLINE void place_point(const sv_kview *v, const float *p, geom *g) {
  v16 m[3] = {v16_load(p), v16_load(p + 16), v16_load(p + 32)};
  UNROLL
  for (int i = 0; i < 3; i++)
    g->t[i] = v16_fma(S(v->r[3 * i]), m[0],
                      v16_fma(S(v->r[3 * i + 1]), m[1], v16_fma(S(v->r[3 * i + 2]), m[2], S(v->t[i]))));
}
V16_INLINE void load_rotation(const float *p, geom *g) {
  UNROLL
  for (int i = 0; i < 4; i++) g->q[i] = v16_load(p + 16 * (SV_ROW_QUAT + i));
  v16 n2 = v16_fma(g->q[0], g->q[0],
                   v16_fma(g->q[1], g->q[1], v16_fma(g->q[2], g->q[2], v16_mul(g->q[3], g->q[3]))));
  g->rn = v16_div(S(1.0f), v16_sqrt(v16_max(n2, S(1e-20f))));
}
V16_INLINE void place(const sv_kview *v, const float *p, geom *g) {
  place_point(v, p, g);
  g->iz = v16_div(S(1.0f), g->t[2]);
  g->xz = v16_mul(g->t[0], g->iz);
  g->yz = v16_mul(g->t[1], g->iz);
  g->rx = clamp_ratio(g->xz, v->min_x, v->max_x);
  g->ry = clamp_ratio(g->yz, v->min_y, v->max_y);
  load_rotation(p, g);
}
V16_INLINE void exp_scales(const float *p, geom *g) {
  UNROLL
  for (int i = 0; i < 3; i++)
    g->s[i] = v16_exp2_fine(v16_mul(v16_load(p + 16 * (SV_ROW_SCALE + i)), S(LOG2E)));
}
V16_INLINE void normalize_rotation(geom *g) {
  UNROLL
  for (int i = 0; i < 4; i++) g->q[i] = v16_mul(g->q[i], g->rn);
  rotation(g->q, g->rot);
}
V16_INLINE void axes(const sv_kview *v, geom *g) {
  g->ja = v16_mul(S(v->fx), g->iz);
  g->jb = v16_mul(S(v->fy), g->iz);
  UNROLL
  for (int j = 0; j < 3; j++) {
    v16 m0 = v16_mul(g->rot[j], g->s[j]), m1 = v16_mul(g->rot[3 + j], g->s[j]),
        m2 = v16_mul(g->rot[6 + j], g->s[j]);
    UNROLL
    for (int i = 0; i < 3; i++)
      g->w[3 * i + j] = dot3_(S(v->r[3 * i]), m0, S(v->r[3 * i + 1]), m1, S(v->r[3 * i + 2]), m2);
    g->a[j] = v16_mul(g->ja, v16_fnma(g->rx, g->w[6 + j], g->w[j]));
    g->b[j] = v16_mul(g->jb, v16_fnma(g->ry, g->w[6 + j], g->w[3 + j]));
  }
}
V16_INLINE v16 covariance_2d(const sv_kview *v, geom *g) {
  g->sxx = dot3_(g->a[0], g->a[0], g->a[1], g->a[1], g->a[2], g->a[2]);
  g->sxy = dot3_(g->a[0], g->b[0], g->a[1], g->b[1], g->a[2], g->b[2]);
  g->syy = dot3_(g->b[0], g->b[0], g->b[1], g->b[1], g->b[2], g->b[2]);
  g->ca = v16_add(g->sxx, S(v->dilation_px2));
  g->cc = v16_add(g->syy, S(v->dilation_px2));
  v16 det = v16_zero();
  UNROLL
  for (int i = 0; i < 3; i++) {
    int j = (i + 1) % 3, k = (i + 2) % 3;
    v16 cross = v16_fms(g->a[j], g->b[k], v16_mul(g->a[k], g->b[j]));
    det = v16_fma(cross, cross, det);
  }
  g->inv_d = v16_div(S(1.0f), v16_fma(S(v->dilation_px2), v16_add(g->sxx, g->cc), det));
  return det;
}
V16_INLINE void sigmoid_opacity(const float *p, geom *g) {
  v16 e = v16_exp2_fine(v16_mul(v16_load(p + 16 * SV_ROW_LOGIT), S(-LOG2E)));
  g->o = v16_div(S(1.0f), v16_add(S(1.0f), e));
  g->not_o = v16_mul(e, g->o);
}
V16_INLINE void conic_of(geom *g) {
  g->conic[0] = v16_mul(g->cc, g->inv_d);
  g->conic[1] = v16_neg(v16_mul(g->sxy, g->inv_d));
  g->conic[2] = v16_mul(g->ca, g->inv_d);
}
V16_INLINE void compensate(const sv_kview *v, v16 det, geom *g) {
  g->comp = S(1.0f);
  g->is_comp_floor = v16m_from_bits(0xffff);
  if (v->is_antialiased) {
    v16 ratio = v16_mul(det, g->inv_d);
    g->is_comp_floor = v16m_andnot(v16m_from_bits(0xffff), v16_gt(ratio, S(2.5e-5f)));
    g->comp = v16_sqrt(v16_max(ratio, S(2.5e-5f)));
  }
  g->oe = v16_mul(g->o, g->comp);
}
V16_INLINE void geometry(const sv_kview *v, const float *p, geom *g) {
  place(v, p, g);
  normalize_rotation(g);
  exp_scales(p, g);
  axes(v, g);
  v16 det = covariance_2d(v, g);
  conic_of(g);
  sigmoid_opacity(p, g);
  compensate(v, det, g);
}

V16_INLINE void sh_basis(int degree, const v16 d[3], v16 b[16]) {
  v16 x = d[0], y = d[1], z = d[2];
  b[0] = S(SH0);
  if (degree < 1) return;
  b[1] = v16_mul(S(-SH1), y);
  b[2] = v16_mul(S(SH1), z);
  b[3] = v16_mul(S(-SH1), x);
  if (degree < 2) return;
  v16 xx = v16_mul(x, x), yy = v16_mul(y, y), zz = v16_mul(z, z), zz2 = v16_add(zz, zz), s = v16_add(xx, yy);
  v16 dd = v16_sub(xx, yy);
  b[4] = v16_mul(S(SH2A), v16_mul(x, y));
  b[5] = v16_mul(S(-SH2A), v16_mul(y, z));
  b[6] = v16_mul(S(SH2B), v16_sub(zz2, s));
  b[7] = v16_mul(S(-SH2A), v16_mul(x, z));
  b[8] = v16_mul(S(SH2C), dd);
  if (degree < 3) return;
  v16 zz4 = v16_add(zz2, zz2);
  b[9] = v16_mul(S(-SH3A), v16_mul(y, v16_fms(S(3.0f), xx, yy)));
  b[10] = v16_mul(S(SH3B), v16_mul(v16_mul(x, y), z));
  b[11] = v16_mul(S(-SH3C), v16_mul(y, v16_sub(zz4, s)));
  b[12] = v16_mul(S(SH3D), v16_mul(z, v16_fma(S(-3.0f), s, zz2)));
  b[13] = v16_mul(S(-SH3C), v16_mul(x, v16_sub(zz4, s)));
  b[14] = v16_mul(S(SH3E), v16_mul(z, dd));
  b[15] = v16_mul(S(-SH3A), v16_mul(x, v16_fma(S(-3.0f), yy, xx)));
}

V16_INLINE v16 direction(const sv_kview *v, const float *p, v16 d[3]) {
  UNROLL
  for (int i = 0; i < 3; i++) d[i] = v16_sub(v16_load(p + 16 * i), S(v->centre[i]));
  v16 n2 = dot3_(d[0], d[0], d[1], d[1], d[2], d[2]);
  v16 rl = v16_div(S(1.0f), v16_sqrt(v16_max(n2, S(1e-20f))));
  UNROLL
  for (int i = 0; i < 3; i++) d[i] = v16_mul(d[i], rl);
  return rl;
}

V16_INLINE v16 colour(const float *sh, int c, int n_coef, const v16 b[16]) {
  v16 s = S(0.5f);
  UNROLL_SH
  for (int k = 0; k < n_coef; k++) s = v16_fma(b[k], v16_load(sh + 16 * (3 * k + c)), s);
  return s;
}

V16_INLINE void colours_of(int degree, const sv_project_args *a, const float *p, v16 rgb[3]) {
  v16 d[3], b[16];
  direction(&a->view, p, d);
  sh_basis(degree, d, b);
  UNROLL
  for (int c = 0; c < 3; c++)
    rgb[c] = v16_max(colour(p + 16 * SV_ROW_SH, c, (degree + 1) * (degree + 1), b), v16_zero());
}

PART void colours(const sv_project_args *a, const float *p, v16 rgb[3]) {
  if (a->sh_degree == 0) colours_of(0, a, p, rgb);
  else if (a->sh_degree == 1) colours_of(1, a, p, rgb);
  else if (a->sh_degree == 2) colours_of(2, a, p, rgb);
  else colours_of(3, a, p, rgb);
}

// The integer fields of 16 splats from the bounds of their ellipses, as vectors of the same bits,
// to be laid beside the float fields: fields written one by one would be waited for where they are
// loaded together. Small whole numbers are exact as floats. Returns who is visible.
V16_INLINE v16m finish_splats(v16m visible, v16 x0, v16 x1, v16 y0, v16 y1, v16 row[4]) {
  const v16 up = S(SV_ROUND_UP), quarter = S(0.25f), eighth = S(0.125f), one = S(1.0f);
#define WHOLE(x) v16i_to_f(v16_trunc_i(x))
  x0 = WHOLE(v16_add(x0, up));
  x1 = WHOLE(x1);
  y0 = WHOLE(v16_add(y0, up));
  y1 = WHOLE(y1);
  // Not visible either: between the pixels' centres.
  visible = v16m_and(visible, v16m_and(v16_le(x0, x1), v16_le(y0, y1)));
  x0 = WHOLE(v16_mul(x0, quarter));
  x1 = WHOLE(v16_mul(x1, quarter)); // blocks
  y0 = WHOLE(v16_mul(y0, quarter));
  y1 = WHOLE(v16_mul(y1, quarter));
  v16 n_x = v16_add(v16_sub(WHOLE(v16_mul(x1, eighth)), WHOLE(v16_mul(x0, eighth))), one); // tiles
  v16 n_y = v16_add(v16_sub(WHOLE(v16_mul(y1, eighth)), WHOLE(v16_mul(y0, eighth))), one);
#undef WHOLE
#define PAIR(low, high)                                                                                      \
  v16i_or(v16_trunc_i(v16_keep(visible, low)), v16_trunc_i(v16_keep(visible, v16_mul(high, S(65536.0f)))))
  row[0] = v16_from_bits(PAIR(x0, x1));
  row[1] = v16_from_bits(PAIR(y0, y1));
#undef PAIR
  row[2] = v16_from_bits(v16_trunc_i(v16_keep(visible, v16_mul(n_x, n_y))));
  row[3] = v16_zero();
  return visible;
}

PART void geometry_of(const sv_kview *v, const float *p, geom *g) { geometry(v, p, g); }

typedef struct { // what is drawn
  v16 xz, yz, z, ca, cc, conic[3], oe;
} ellipse;

V16_INLINE void ellipse_of(const geom *g, ellipse *e) {
  e->xz = g->xz;
  e->yz = g->yz;
  e->z = g->t[2];
  e->ca = g->ca;
  e->cc = g->cc;
  e->oe = g->oe;
  e->conic[0] = g->conic[0];
  e->conic[1] = g->conic[1];
  e->conic[2] = g->conic[2];
}

typedef struct { // where, in real pixels
  v16 lo, level, tau, ex, x0, x1, y0, y1;
  v16m visible;
} bounds;

V16_INLINE void level_of(const sv_project_args *a, v16 oe, bounds *b) {
  b->lo = v16_add(v16_log2(oe), S(a->log2_compensation));
  b->level = v16_sub(b->lo, S(SV_LOG2_ALPHA_MIN));
  b->tau = v16_mul(S(1.38629436f), v16_max(b->level, S(0.0f)));
}

V16_INLINE void bounds_of(const sv_kview *v, const ellipse *e, uint32_t in_use, bounds *b, v16 row[16]) {
  v16 u = v16_fma(S(v->fx), e->xz, S(v->cx)), w = v16_fma(S(v->fy), e->yz, S(v->cy));
  v16 ex = v16_sqrt(v16_mul(b->tau, e->ca)), ey = v16_sqrt(v16_mul(b->tau, e->cc));
  v16 half = S(0.5f), zero = S(0.0f), w1 = S((float)(v->width_px - 1)), h1 = S((float)(v->height_px - 1));
  b->x0 = v16_max(zero, v16_sub(v16_sub(u, ex), half));
  b->x1 = v16_min(v16_sub(v16_add(u, ex), half), w1);
  b->y0 = v16_max(zero, v16_sub(v16_sub(w, ey), half));
  b->y1 = v16_min(v16_sub(v16_add(w, ey), half), h1);
  v16m vis = v16m_and(v16_gt(e->z, S(v->near_z)), v16_gt(b->level, zero));
  vis = v16m_and(vis, v16m_and(v16_le(b->x0, b->x1), v16_le(b->y0, b->y1)));
  b->visible = v16m_and(vis, v16m_from_bits(in_use));
  b->ex = ex;
  row[0] = u;
  row[1] = w;
  row[5] = v16_sub(b->lo, S(SV_POWER_SHIFT));
  row[9] = e->z;
}

V16_INLINE void form_of(const ellipse *e, bounds *b, v16 row[16]) {
  v16 zero = S(0.0f);
  row[2] = v16_mul(S(-0.5f * LOG2E), e->conic[0]);
  row[3] = v16_mul(S(-LOG2E), e->conic[1]);
  row[4] = v16_mul(S(-0.5f * LOG2E), e->conic[2]);
  b->visible = v16m_and(b->visible, v16m_and(v16_lt(row[2], zero), v16_lt(row[4], zero)));
  row[10] = v16_div(v16_mul(row[3], b->ex), v16_mul(S(2.0f), row[4]));
  row[11] = v16_div(S(0.5f), row[2]);
}

typedef struct { // of each lane
  v16i visible, intersections;
} counts16;

V16_INLINE void finish(const bounds *b, v16 row[16], counts16 *n) {
  v16m vis = b->visible; // bounds of the others may not fit an int
  vis = finish_splats(vis, v16_keep(vis, b->x0), v16_keep(vis, b->x1), v16_keep(vis, b->y0),
                      v16_keep(vis, b->y1), row + 12);
  n->intersections = v16i_add(n->intersections, v16_bits(row[14]));
  n->visible = v16i_add(n->visible, v16_bits(v16_keep(vis, v16_from_bits(v16i_set1(1)))));
}

V16_INLINE void write_splats(const sv_project_args *a, int block, v16 row[16]) {
  const int id0 = block * SV_LANES;
  float *splat = (float *)(void *)(a->splat + id0);
  v16i_store((int32_t *)a->depth_key + id0, v16_bits(row[9]));
  v16_transpose(row);
  UNROLL_SH
  for (int i = 0; i < SV_LANES; i++) v16_store(splat + 16 * i, row[i]);
}

static inline const float *rows_of(const sv_project_args *a, int block) {
  return a->param + (long)block * a->n_rows * SV_LANES;
}
static inline uint32_t in_use(const sv_project_args *a, int block) {
  const int left = a->n_gaussians - block * SV_LANES;
  const uint32_t in_range = left >= 16 ? 0xffffu : left <= 0 ? 0 : (1u << left) - 1;
  return a->dropout_mask ? in_range & ~(uint32_t)a->dropout_mask[block] : in_range;
}

#if V16_REGISTERS >= 32

// The chain from the parameters to a splat's last field is as long as the rest of the block's
// instructions take, and the next block is beyond the processor's window: two blocks take turns,
// stage by stage. What waits longest begins first.
typedef struct {
  const float *p;
  int block;
  uint32_t in_use;
  geom g;
  v16 det, row[16];
  ellipse e;
  bounds b;
} side;

// Part i of 8 of the lines of two blocks. They have left the near caches since the last step, and
// all at once would be waited for.
V16_INLINE void fetch(int degree, const sv_project_args *a, int block, int i) {
  const int n = SV_N_ROWS(degree);
  const float *p = rows_of(a, block);
  UNROLL_SH
  for (int k = i * n / 8; k < (i + 1) * n / 8; k++) {
    __builtin_prefetch(p + SV_LANES * k);
    __builtin_prefetch(p + SV_LANES * (a->n_rows + k));
  }
  UNROLL_SH
  for (int k = 4 * i; k < 4 * i + 4; k++) __builtin_prefetch(a->splat + block * SV_LANES + k, 1);
}

V16_INLINE void pair_of(int degree, const sv_project_args *a, int block, int other, int next, counts16 *n) {
  const sv_kview *v = &a->view;
  side x0 = {.p = rows_of(a, block), .block = block, .in_use = in_use(a, block)};
  side x1 = {.p = rows_of(a, other), .block = other, .in_use = other > block ? in_use(a, other) : 0};
#define BOTH(stage)                                                                                          \
  do {                                                                                                       \
    {                                                                                                        \
      side *x = &x0;                                                                                         \
      stage;                                                                                                 \
    }                                                                                                        \
    side *x = &x1;                                                                                           \
    stage;                                                                                                   \
  } while (0)
  BOTH(place(v, x->p, &x->g));
  fetch(degree, a, next, 0);
  BOTH(sigmoid_opacity(x->p, &x->g));
  fetch(degree, a, next, 1);
  BOTH(exp_scales(x->p, &x->g); normalize_rotation(&x->g));
  fetch(degree, a, next, 2);
  if (!v->is_antialiased) BOTH(level_of(a, x->g.o, &x->b));
  fetch(degree, a, next, 3);
  BOTH(axes(v, &x->g));
  fetch(degree, a, next, 4);
  BOTH(x->det = covariance_2d(v, &x->g));
  fetch(degree, a, next, 5);
  BOTH(conic_of(&x->g); compensate(v, x->det, &x->g));
  if (v->is_antialiased) BOTH(level_of(a, x->g.oe, &x->b));
  fetch(degree, a, next, 6);
  BOTH(ellipse_of(&x->g, &x->e); bounds_of(v, &x->e, x->in_use, &x->b, x->row));
  fetch(degree, a, next, 7);
  BOTH(colours_of(degree, a, x->p, x->row + 6)); // here, as bounds are a long chain
  BOTH(form_of(&x->e, &x->b, x->row));
  BOTH(finish(&x->b, x->row, n));
  write_splats(a, other, x1.row); // which may be the same block, none of it in use
  write_splats(a, block, x0.row);
#undef BOTH
}

static __attribute__((noinline)) void project_pair(const sv_project_args *a, int block, int other, int next,
                                                   counts16 *n) {
  if (a->sh_degree == 0) pair_of(0, a, block, other, next, n);
  else if (a->sh_degree == 1) pair_of(1, a, block, other, next, n);
  else if (a->sh_degree == 2) pair_of(2, a, block, other, next, n);
  else pair_of(3, a, block, other, next, n);
}

// Lines are fetched two pairs ahead, beyond the range as well: the next one is most often this
// thread's.
static void project_range(const sv_project_args *a, int block0, int block1, project_work *work, counts16 *n) {
  const int n_blocks = (a->n_gaussians + SV_LANES - 1) / SV_LANES;
  (void)work;
  for (int b = block0; b < block1; b += 2)
    project_pair(a, b, b + 1 < block1 ? b + 1 : b, b + 5 < n_blocks ? b + 4 : b, n);
}

#else

PART void find_ellipse(const sv_kview *v, const float *p, geom *scratch, ellipse *e) {
#ifdef V16_UNROLL // vectors of four registers: compilers leave all of the structure in memory
  geom *g = scratch;
  geometry_of(v, p, g);
#else
  geom of, *g = &of;
  (void)scratch;
  geometry(v, p, g);
#endif
  ellipse_of(g, e);
}

static void project_block(const sv_project_args *a, int block, project_work *work, counts16 *n) {
  const float *p = rows_of(a, block);
  v16 *row = work->row;
  ellipse e;
  bounds b;
  find_ellipse(&a->view, p, &work->g, &e);
  level_of(a, e.oe, &b);
  bounds_of(&a->view, &e, in_use(a, block), &b, row);
  colours(a, p, row + 6);
  form_of(&e, &b, row);
  finish(&b, row, n);
  write_splats(a, block, row);
}

static void project_range(const sv_project_args *a, int block0, int block1, project_work *work, counts16 *n) {
  for (int b = block0; b < block1; b++) {
    // the next block's rows and splats have left the near caches since the last step
    if (b + 1 < block1) {
      const float *next = rows_of(a, b + 1);
      UNROLL
      for (int row = 0; row < SV_N_ROWS(a->sh_degree); row++) __builtin_prefetch(next + SV_LANES * row);
      UNROLL_SH
      for (int k = 0; k < SV_LANES; k++) __builtin_prefetch(a->splat + (b + 1) * SV_LANES + k, 1);
    }
    project_block(a, b, work, n);
  }
}

#endif

#include "kernels/project/project_fisheye.inc"

static uint32_t sum_of(v16i n) {
  int32_t lane[SV_LANES];
  uint32_t sum = 0;
  v16i_store(lane, n);
  for (int k = 0; k < SV_LANES; k++) sum += (uint32_t)lane[k];
  return sum;
}

sv_project_counts V(sv_project)(const sv_project_args *a, int block0, int block1, float *scratch) {
  counts16 n = {v16i_set1(0), v16i_set1(0)};
  if (a->view.fisheye) project_wide(a, block0, block1, (wide_work *)(void *)scratch, &n);
  else project_range(a, block0, block1, (project_work *)(void *)scratch, &n);
  return (sv_project_counts){sum_of(n.visible), sum_of(n.intersections)};
}

#include "kernels/project/project_bwd.inc"
