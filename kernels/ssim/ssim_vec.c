// SPDX-License-Identifier: Apache-2.0
// ssim and ssim_bwd over the 16-lane vocabulary. Rows are blurred vertically straight from the
// planes into a scratch row with zero borders, then horizontally from there: no ring of rows, so a
// band costs no halo rows.
#include <stddef.h>
#include <string.h>

#include "kernels/ssim/ssim.h"
#include "kernels/simd/v16.h"
#include "kernels/ssim/ssim_const.h"

static inline float *scratch_row(float *scratch, int stride, int i) {
  return scratch + (size_t)i * (size_t)(stride + 2 * SSIM_BORDER) + SSIM_BORDER;
}

static inline void rows_around(const float *row[11], const float *plane, int r, int height, int stride,
                               const float *zero) {
  for (int k = -SSIM_R; k <= SSIM_R; k++) {
    int j = r + k;
    row[k + SSIM_R] = j >= 0 && j < height ? plane + (size_t)j * (size_t)stride : zero;
  }
}

static inline v16m lanes_below(int n) { return v16m_from_bits(n >= 16 ? 0xffffu : (1u << n) - 1u); }

// The rows about one row of the image. Away from its edges they are a stride apart, and nothing
// but the middle one has to be known: eleven pointers a plane would not stay in registers.
typedef struct {
  const float *middle;
  long stride;
  const float *row[11]; // near the edges
} window;

static inline window window_at(const float *plane, int r, int height, int stride, const float *zero) {
  window w = {.middle = plane + (size_t)r * (size_t)stride, .stride = stride};
  if (r < SSIM_R || r >= height - SSIM_R) rows_around(w.row, plane, r, height, stride, zero);
  return w;
}

static inline int is_inner(int r, int height) { return r >= SSIM_R && r < height - SSIM_R; }

// Column i of the row k below the middle one.
#define TAP(w, k) v16_load((inner ? (w)->middle + (k) * (w)->stride : (w)->row[SSIM_R + (k)]) + i)

static inline v16 squares(v16 x, v16 y) { return v16_fma(y, y, v16_mul(x, x)); }

#define COLUMN_PAIR(k, gk)                                                                                   \
  {                                                                                                          \
    v16 a = TAP(x, -(k)), b = TAP(x, k), c = TAP(y, -(k)), d = TAP(y, k), w = v16_set1(gk);                  \
    mx = v16_fma(v16_add(a, b), w, mx);                                                                      \
    my = v16_fma(v16_add(c, d), w, my);                                                                      \
    e = v16_fma(v16_add(squares(a, c), squares(b, d)), w, e);                                                \
    p = v16_fma(v16_add(v16_mul(a, c), v16_mul(b, d)), w, p);                                                \
  }

V16_INLINE void blur_columns(const window *x, const window *y, int inner, long i, float *t, long map) {
  v16 x0 = TAP(x, 0), y0 = TAP(y, 0), g0 = v16_set1(SSIM_G0);
  v16 mx = v16_mul(x0, g0), my = v16_mul(y0, g0);
  v16 e = v16_mul(squares(x0, y0), g0), p = v16_mul(v16_mul(x0, y0), g0);
  COLUMN_PAIR(1, SSIM_G1)
  COLUMN_PAIR(2, SSIM_G2)
  COLUMN_PAIR(3, SSIM_G3)
  COLUMN_PAIR(4, SSIM_G4)
  COLUMN_PAIR(5, SSIM_G5)
  v16_store(t + i, mx);
  v16_store(t + map + i, my);
  v16_store(t + 2 * map + i, e);
  v16_store(t + 3 * map + i, p);
}

// A call for each vector keeps the compiler from taking eleven pointers a plane out of the loop
// again.
static __attribute__((noinline)) void inner_columns(const window *x, const window *y, long i, float *t,
                                                    long map) {
  const window wx = {.middle = x->middle, .stride = x->stride},
               wy = {.middle = y->middle, .stride = x->stride};
  blur_columns(&wx, &wy, 1, i, t, map);
}

static __attribute__((noinline)) void edge_columns(const window *x, const window *y, int w, float *t,
                                                   long map) {
  for (int i = 0; i < w; i += 16) blur_columns(x, y, 0, i, t, map);
}

// What lies beyond the image counts as 0.
static inline void clear_beyond(float *const *t, int n, int w) {
  for (int m = 0; m < n; m++)
    for (int i = w; i % 16; i++) t[m][i] = 0.0f;
}

// The five pairs of one 1-D blur: LO(k) and HI(k) are the two taps at distance k.
#define BLUR_PAIRS(s, LO, HI)                                                                                \
  s = v16_fma(v16_add(LO(1), HI(1)), v16_set1(SSIM_G1), s);                                                  \
  s = v16_fma(v16_add(LO(2), HI(2)), v16_set1(SSIM_G2), s);                                                  \
  s = v16_fma(v16_add(LO(3), HI(3)), v16_set1(SSIM_G3), s);                                                  \
  s = v16_fma(v16_add(LO(4), HI(4)), v16_set1(SSIM_G4), s);                                                  \
  s = v16_fma(v16_add(LO(5), HI(5)), v16_set1(SSIM_G5), s)

// Most loads beside p go across the border of two lines and take two turns. Where vectors can be
// shifted into each other most taps are made that way: as many as the ports of arithmetic have time
// for beside the sums.
static inline v16 blur_row(const float *p) {
  v16 here = v16_load(p), s = v16_mul(here, v16_set1(SSIM_G0));
#ifdef V16_HAS_SHIFT_IN
  v16 before = v16_load(p - 16), after = v16_load(p + 16);
#define FROM_LEFT(k)  v16_shift_in(before, here, 16 - (k))
#define FROM_RIGHT(k) v16_shift_in(here, after, k)
  s = v16_fma(v16_add(FROM_LEFT(1), FROM_RIGHT(1)), v16_set1(SSIM_G1), s);
  s = v16_fma(v16_add(FROM_LEFT(2), FROM_RIGHT(2)), v16_set1(SSIM_G2), s);
  s = v16_fma(v16_add(FROM_LEFT(3), FROM_RIGHT(3)), v16_set1(SSIM_G3), s);
  s = v16_fma(v16_add(FROM_LEFT(4), FROM_RIGHT(4)), v16_set1(SSIM_G4), s);
  s = v16_fma(v16_add(v16_load(p - 5), v16_load(p + 5)), v16_set1(SSIM_G5), s);
#undef FROM_LEFT
#undef FROM_RIGHT
#else
#define LEFT(k)  v16_load(p - (k))
#define RIGHT(k) v16_load(p + (k))
  BLUR_PAIRS(s, LEFT, RIGHT);
#undef LEFT
#undef RIGHT
#endif
  return s;
}

// Four rows at once, where registers hold the seventeen that they are made of: each is loaded,
// squared and multiplied once instead of up to six times.
#if V16_REGISTERS >= 32
enum { AT_ONCE = 4 };
#else
enum { AT_ONCE = 1 };
#endif

// Planes up to this size are still in the near caches.
#define NEAR_FLOATS (256 * 256)

// What the next rows of windows ask for besides the rows that these have.
V16_INLINE void fetch_rows(const float *p, long stride) {
  for (int k = 0; k < 2 * AT_ONCE; k++) __builtin_prefetch(p + k * stride);
}

#if V16_REGISTERS >= 32
enum { ROWS_ABOUT = 2 * (AT_ONCE - 1) + 1 + 2 * SSIM_R };

V16_INLINE void load_rows(v16 x[ROWS_ABOUT], const float *p, long stride) {
  for (int k = 0; k < ROWS_ABOUT; k++, p += stride) x[k] = v16_load(p);
}

V16_INLINE void blur_rows_about(const v16 x[ROWS_ABOUT], float *t, long row) {
  for (int k = 0; k < AT_ONCE; k++) {
#define ABOVE(d) x[SSIM_R + 2 * k - (d)]
#define BELOW(d) x[SSIM_R + 2 * k + (d)]
    v16 s = v16_mul(x[SSIM_R + 2 * k], v16_set1(SSIM_G0));
    BLUR_PAIRS(s, ABOVE, BELOW);
    v16_store(t + k * row, s);
#undef ABOVE
#undef BELOW
  }
}

// AT_ONCE rows of windows, the first about row `first` of the image.
static __attribute__((noinline)) void inner_rows(const sv_ssim_args *a, int first, float *t, long row,
                                                 long map, int is_fetching) {
  const long stride = a->stride;
  const float *x = a->x + (first - SSIM_R) * stride, *y = a->y + (first - SSIM_R) * stride;
  for (int i = 0, w = a->width_px; i < w; i += 16) {
    v16 r[ROWS_ABOUT];
    if (is_fetching) fetch_rows(x + i + ROWS_ABOUT * stride, stride);
    load_rows(r, x + i, stride);
    blur_rows_about(r, t + i, row);
    if (is_fetching) fetch_rows(y + i + ROWS_ABOUT * stride, stride);
    load_rows(r, y + i, stride);
    blur_rows_about(r, t + map + i, row);
    for (int k = 0; k < ROWS_ABOUT; k++)
      r[k] = squares(v16_load(x + i + k * stride), v16_load(y + i + k * stride));
    blur_rows_about(r, t + 2 * map + i, row);
    for (int k = 0; k < ROWS_ABOUT; k++)
      r[k] = v16_mul(v16_load(x + i + k * stride), v16_load(y + i + k * stride));
    blur_rows_about(r, t + 3 * map + i, row);
  }
}
#endif

// One vector's blurred planes.
typedef struct {
  v16 m1, m2, e, p;
} moments;

// One vector's terms of the similarity: r is 1 / (A B).
typedef struct {
  v16 m1, n, A, BA, C, CD, r;
} terms;

V16_INLINE terms terms_of(const moments *v) {
  const v16 m1 = v->m1, m2 = v->m2;
  v16 mm = v16_mul(m1, m2), q = v16_fma(m1, m1, v16_mul(m2, m2));
  v16 A = v16_add(q, v16_set1(SSIM_C1)), B = v16_add(v16_sub(v->e, q), v16_set1(SSIM_C2));
  v16 r = v16_div(v16_set1(1.0f), v16_mul(A, B));
  v16 C = v16_fma(v16_set1(2.0f), mm, v16_set1(SSIM_C1));
  v16 D = v16_fma(v16_set1(2.0f), v16_sub(v->p, mm), v16_set1(SSIM_C2));
  terms t = {m1, v16_mul(m2, v16_sub(D, C)), A, v16_sub(B, A), C, v16_mul(C, D), r};
  return t;
}

// Stores the maps `row` apart, if p is not NULL; returns the ssim.
V16_INLINE v16 put_maps(const terms *t, float *p, long row, v16m keep) {
  v16 ssim = v16_mul(t->CD, t->r);
  if (p) {
    v16 dm1 = v16_mul(v16_fnma(v16_mul(t->m1, ssim), t->BA, t->n), t->r);
    v16 ds1 = v16_neg(v16_mul(ssim, v16_mul(t->A, t->r)));
    v16_store(p, v16_keep(keep, dm1));
    v16_store(p + row, v16_keep(keep, ds1));
    v16_store(p + 2 * row, v16_keep(keep, v16_mul(t->C, t->r)));
  }
  return v16_keep(keep, ssim);
}

// Planes about rows of windows from r on, blurred along columns: row k of map m at t + m * map + k
// * row. Returns how many.
static int blur_planes(const sv_ssim_args *a, int r, float *t, long row, long map, const float *zero) {
  const int first = 2 * r + a->phase, h = a->height_px;
  const int is_fetching = (long)a->stride * h > NEAR_FLOATS;
#if V16_REGISTERS >= 32
  if (r + AT_ONCE <= a->row1 && is_inner(first, h) && is_inner(first + 2 * (AT_ONCE - 1), h)) {
    inner_rows(a, first, t, row, map, is_fetching);
    return AT_ONCE;
  }
#else
  (void)row;
#endif
  const window x = window_at(a->x, first, h, a->stride, zero), y = window_at(a->y, first, h, a->stride, zero);
  const long below = (SSIM_R + 1) * x.stride;
  if (!is_inner(first, h)) edge_columns(&x, &y, a->width_px, t, map);
  else
    for (int i = 0; i < a->width_px; i += 16) {
      if (is_fetching) {
        fetch_rows(x.middle + i + below, x.stride);
        fetch_rows(y.middle + i + below, x.stride);
      }
      inner_columns(&x, &y, i, t, map);
    }
  return 1;
}

// The chain of operations behind the blurs is longer than the core looks ahead: it is of the vector
// before, in two parts between the blurs of this one. maps: three rows, `row` apart, or NULL.
static float ssim_row(int w, const float *t, long map, float *maps, long row) {
  v16 sum = v16_zero();
  moments now = {blur_row(t), blur_row(t + map), blur_row(t + 2 * map), blur_row(t + 3 * map)}, next;
  int i = 0;
  for (; i + 16 < w; i += 16, now = next) {
    const float *p = t + i + 16;
    next.m1 = blur_row(p);
    next.m2 = blur_row(p + map);
    const terms x = terms_of(&now);
    next.e = blur_row(p + 2 * map);
    next.p = blur_row(p + 3 * map);
    sum = v16_add(sum, put_maps(&x, maps ? maps + i : NULL, row, lanes_below(16)));
  }
  const terms x = terms_of(&now);
  sum = v16_add(sum, put_maps(&x, maps ? maps + i : NULL, row, lanes_below(w - i)));
  return v16_sum(sum);
}

static void blur_maps(const sv_ssim_args *a, int r, const float *maps, long row) {
  const size_t at = (size_t)(r - a->map_row0) * (size_t)a->stride;
  // not read again after each store
  float *dm1 = a->dm1 + at, *ds1 = a->ds1 + at, *ds12 = a->ds12 + at;
  for (int i = 0, w = a->width_px; i < w; i += 16) {
    v16_store(dm1 + i, blur_row(maps + i));
    v16_store(ds1 + i, blur_row(maps + row + i));
    v16_store(ds12 + i, blur_row(maps + 2 * row + i));
  }
}

_Static_assert(SV_SSIM_SCRATCH_FLOATS(0) >= (4 * AT_ONCE + 4) * 2 * SSIM_BORDER, "scratch is too small");

void V(sv_ssim)(const sv_ssim_args *a) {
  const long row = a->stride + 2 * SSIM_BORDER, map = AT_ONCE * row;
  const float *zero = a->scratch + 4 * map;
  float *t = scratch_row(a->scratch, a->stride, 0);
  float *maps = a->dm1 ? scratch_row(a->scratch, a->stride, 4 * AT_ONCE + 1) : NULL;
  memset(a->scratch, 0, sizeof(float) * (4 * AT_ONCE + 4) * (size_t)row);
  for (int r = a->row0; r < a->row1;) {
    const int n = blur_planes(a, r, t, row, map, zero);
    for (int k = 0; k < n; k++, r++) {
      float *const of_row[4] = {t + k * row, t + map + k * row, t + 2 * map + k * row, t + 3 * map + k * row};
      clear_beyond(of_row, 4, a->width_px);
      a->row_ssim[r] = ssim_row(a->width_px, t + k * row, map, maps, row);
      if (maps) blur_maps(a, r, maps, row);
    }
  }
}

// --- gradient ----------------------------------------
typedef struct {
  v16 l1, minus_l1, ssim, err;
} weights;

V16_INLINE weights weights_of(const sv_ssim_bwd_args *a) {
  weights w = {v16_set1(a->w_l1), v16_set1(-a->w_l1), v16_set1(2.0f * a->w_ssim), v16_set1(a->err_scale)};
  return w;
}

// What becomes of a result.
typedef enum { PUT_NONE, PUT, PUT_ADD } put_how;
static inline put_how how(const float *p, int is_add) { return !p ? PUT_NONE : is_add ? PUT_ADD : PUT; }

typedef struct {
  float *at;
  put_how how;
} put_to;

typedef struct {
  put_to grad, err;
  v16m keep; // lanes of the image
} results;

// One vector's gradient and error; returns |x - y|. ssim: its gradient of SSIM, or NULL.
V16_INLINE v16 put_gradient(const weights *w, v16 x, v16 y, const v16 *ssim, results to) {
  const v16m keep = to.keep;
  v16 d = v16_sub(x, y), e = v16_keep(keep, v16_abs(d));
  if (to.grad.how != PUT_NONE) {
    v16 g = v16_sel(v16_lt(d, v16_zero()), w->minus_l1, v16_keep(v16_gt(d, v16_zero()), w->l1));
    if (ssim) g = v16_fma(w->ssim, *ssim, g);
    g = v16_keep(keep, g);
    v16_store(to.grad.at, to.grad.how == PUT_ADD ? v16_add(v16_load(to.grad.at), g) : g);
  }
  if (to.err.how != PUT_NONE)
    v16_store(to.err.at,
              to.err.how == PUT_ADD ? v16_fma(e, w->err, v16_load(to.err.at)) : v16_mul(e, w->err));
  return e;
}

V16_INLINE v16 put_gradient_at(const sv_ssim_bwd_args *a, const weights *w, const v16 *ssim, size_t at,
                               v16m keep) {
  const results to = {{a->grad ? a->grad + at : NULL, how(a->grad, a->is_grad_add)},
                      {a->err ? a->err + at : NULL, how(a->err, a->is_err_add)},
                      keep};
  return put_gradient(w, v16_load(a->x + at), v16_load(a->y + at), ssim, to);
}

static void end_row(const sv_ssim_bwd_args *a, int r, v16 sum) {
  const size_t at = (size_t)r * (size_t)a->stride;
  for (int i = (a->width_px + 15) & ~15; i < a->stride; i += 16) {
    if (a->grad && !a->is_grad_add) v16_store(a->grad + at + (size_t)i, v16_zero());
    if (a->err && !a->is_err_add) v16_store(a->err + at + (size_t)i, v16_zero());
  }
  a->row_l1[r] = v16_sum(sum);
}

// One vector of a map, blurred along columns for a row of the image on which a window stands, and
// for one between two. x: that of the rows of windows about it, from the second one above.
V16_INLINE v16 on_row(const v16 *x) {
  v16 s = v16_mul(x[2], v16_set1(SSIM_G0));
  s = v16_fma(v16_add(x[1], x[3]), v16_set1(SSIM_G2), s);
  return v16_fma(v16_add(x[0], x[4]), v16_set1(SSIM_G4), s);
}

V16_INLINE v16 off_row(const v16 *x) {
  v16 s = v16_mul(v16_add(x[2], x[3]), v16_set1(SSIM_G1));
  s = v16_fma(v16_add(x[1], x[4]), v16_set1(SSIM_G3), s);
  return v16_fma(v16_add(x[0], x[5]), v16_set1(SSIM_G5), s);
}

// Pairs of rows at once: the second one of a pair lies between windows.
enum { PAIRS = V16_REGISTERS >= 32 ? 2 : 1 };

V16_INLINE void load_maps(v16 x[PAIRS + 5], const float *p, long stride) {
  for (int k = 0; k < PAIRS + 5; k++) x[k] = v16_load(p + k * stride);
}

// Rows r to r + 2 PAIRS - 1, about which the maps have all rows; at: of the second row of windows
// above.
V16_INLINE void pairs(const sv_ssim_bwd_args *a, int r, size_t at, put_how of_err) {
  const long stride = a->stride;
  const size_t px = (size_t)r * (size_t)stride;
  const float *m1 = a->dm1 + at, *s1 = a->ds1 + at, *s12 = a->ds12 + at, *px_x = a->x + px, *px_y = a->y + px;
  float *grad = a->grad + px, *err = of_err == PUT_NONE ? NULL : a->err + px;
  const weights w = weights_of(a);
  v16 sum[2 * PAIRS];
  for (int k = 0; k < 2 * PAIRS; k++) sum[k] = v16_zero();
  for (int left = a->width_px; left > 0; left -= 16) {
    const v16m keep = lanes_below(left);
    v16 x[PAIRS + 5], s[2 * PAIRS];
    load_maps(x, m1, stride);
    for (int k = 0; k < PAIRS; k++) {
      s[2 * k] = on_row(x + k);
      s[2 * k + 1] = off_row(x + k);
    }
    load_maps(x, s1, stride);
    for (int k = 0; k < PAIRS; k++) {
      s[2 * k] = v16_fma(v16_load(px_x + 2 * k * stride), on_row(x + k), s[2 * k]);
      s[2 * k + 1] = v16_fma(v16_load(px_x + (2 * k + 1) * stride), off_row(x + k), s[2 * k + 1]);
    }
    load_maps(x, s12, stride);
    for (int k = 0; k < PAIRS; k++) {
      s[2 * k] = v16_fma(v16_load(px_y + 2 * k * stride), on_row(x + k), s[2 * k]);
      s[2 * k + 1] = v16_fma(v16_load(px_y + (2 * k + 1) * stride), off_row(x + k), s[2 * k + 1]);
    }
    for (int k = 0; k < 2 * PAIRS; k++)
      sum[k] = v16_add(
          sum[k],
          put_gradient(&w, v16_load(px_x + k * stride), v16_load(px_y + k * stride), s + k,
                       (results){{grad + k * stride, PUT}, {err ? err + k * stride : NULL, of_err}, keep}));
    m1 += 16;
    s1 += 16;
    s12 += 16;
    px_x += 16;
    px_y += 16;
    grad += 16;
    if (err) err += 16;
  }
  for (int k = 0; k < 2 * PAIRS; k++) end_row(a, r + k, sum[k]);
}

static __attribute__((noinline)) void pairs_no_err(const sv_ssim_bwd_args *a, int r, size_t at) {
  pairs(a, r, at, PUT_NONE);
}
static __attribute__((noinline)) void pairs_err(const sv_ssim_bwd_args *a, int r, size_t at) {
  pairs(a, r, at, PUT);
}
static __attribute__((noinline)) void pairs_add_err(const sv_ssim_bwd_args *a, int r, size_t at) {
  pairs(a, r, at, PUT_ADD);
}

// The maps' rows of windows about a row, the zero row where there are none.
typedef struct {
  const float *row[3][6];
} maps_about;

static __attribute__((noinline)) void any_row(const sv_ssim_bwd_args *a, int r, const maps_about *m,
                                              int is_off) {
  const size_t px = (size_t)r * (size_t)a->stride;
  const weights w = weights_of(a);
  v16 sum = v16_zero();
  for (int i = 0; i < a->width_px; i += 16) {
    v16 b[3], x[6];
    for (int c = 0; c < 3; c++) {
      for (int k = 0; k < 6; k++) x[k] = v16_load(m->row[c][k] + i);
      b[c] = is_off ? off_row(x) : on_row(x);
    }
    b[0] = v16_fma(v16_load(a->x + px + (size_t)i), b[1], b[0]);
    b[0] = v16_fma(v16_load(a->y + px + (size_t)i), b[2], b[0]);
    sum = v16_add(sum, put_gradient_at(a, &w, b, px + (size_t)i, lanes_below(a->width_px - i)));
  }
  end_row(a, r, sum);
}

static void l1_row(const sv_ssim_bwd_args *a, int r) {
  const size_t px = (size_t)r * (size_t)a->stride;
  const weights w = weights_of(a);
  v16 sum = v16_zero();
  for (int i = 0; i < a->width_px; i += 16)
    sum = v16_add(sum, put_gradient_at(a, &w, NULL, px + (size_t)i, lanes_below(a->width_px - i)));
  end_row(a, r, sum);
}

_Static_assert(SV_SSIM_SCRATCH_FLOATS(0) >= 2 * SSIM_BORDER, "scratch is too small");

void V(sv_ssim_bwd)(const sv_ssim_bwd_args *a) {
  const float *map[3] = {a->dm1, a->ds1, a->ds12};
  const int n_rows = (a->height_px - a->phase + 1) / 2;
  maps_about about;
  memset(a->scratch, 0, sizeof(float) * (size_t)a->stride);
  for (int r = a->row0; r < a->row1;) {
    const int is_off = (r - a->phase) & 1, above = (r - a->phase - is_off) / 2 - 2;
    if (!a->dm1 || !a->grad) {
      l1_row(a, r++);
      continue;
    }
    if (!is_off && above >= 0 && above + PAIRS + 5 <= n_rows && r + 2 * PAIRS <= a->row1 && !a->is_grad_add) {
      const size_t at = (size_t)(above - a->map_row0) * (size_t)a->stride;
      (!a->err ? pairs_no_err : a->is_err_add ? pairs_add_err : pairs_err)(a, r, at);
      r += 2 * PAIRS;
      continue;
    }
    for (int m = 0; m < 3; m++)
      for (int k = 0; k < 6; k++)
        about.row[m][k] = above + k >= 0 && above + k < n_rows
                              ? map[m] + (size_t)(above + k - a->map_row0) * (size_t)a->stride
                              : a->scratch;
    any_row(a, r++, &about, is_off);
  }
}
