// SPDX-License-Identifier: Apache-2.0
#include "tools/metric/flow.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define PATCH      8
#define AREA       (PATCH * PATCH)
#define STEP       4  // pixels from one patch to the next
#define BORDER     16 // a patch may lie outside the image by this much, less one patch
#define MIN_SIDE   16 // of the coarsest level
#define ITERATIONS 12
#define REACH      PATCH      // a patch that moved further from its start than this has lost itself
#define DAMPING    (4 * AREA) // gray levels^2: keeps patches without structure where they started

// --- pyramid -------------------------------------------------------------------------------------

static void fill_border(sv_flow_pyramid *p, int l) {
  int w = p->width[l], h = p->height[l], s = p->stride[l];
  for (int y = 0; y < h; y++) {
    float *row = p->px[l] + (ptrdiff_t)y * s;
    for (int i = 1; i <= BORDER; i++) {
      row[-i] = row[0];
      row[w - 1 + i] = row[w - 1];
    }
  }
  for (int i = 1; i <= BORDER; i++) {
    memcpy(p->px[l] - (ptrdiff_t)i * s - BORDER, p->px[l] - BORDER, (size_t)s * sizeof(float));
    memcpy(p->px[l] + (ptrdiff_t)(h - 1 + i) * s - BORDER, p->px[l] + (ptrdiff_t)(h - 1) * s - BORDER,
           (size_t)s * sizeof(float));
  }
}

sv_status sv_flow_pyramid_make(sv_flow_pyramid *p, const float *grey, int width, int height) {
  size_t floats = 0;
  memset(p, 0, sizeof *p);
  if (width < SV_FLOW_MIN_SIDE_PX || height < SV_FLOW_MIN_SIDE_PX) return SV_E_RANGE;
  for (int w = width, h = height; w >= MIN_SIDE && h >= MIN_SIDE && p->n_levels < SV_FLOW_CAP_LEVELS;
       w /= 2, h /= 2) {
    int l = p->n_levels++;
    p->width[l] = w;
    p->height[l] = h;
    p->stride[l] = w + 2 * BORDER;
    floats += (size_t)p->stride[l] * (size_t)(h + 2 * BORDER);
  }
  float *at = p->block = malloc(floats * sizeof(float));
  if (!at) return SV_E_NOMEM;
  for (int l = 0; l < p->n_levels; l++) {
    int w = p->width[l], h = p->height[l], s = p->stride[l];
    p->px[l] = at + (size_t)BORDER * (size_t)s + BORDER;
    at += (size_t)s * (size_t)(h + 2 * BORDER);
    for (int y = 0; y < h; y++) {
      float *to = p->px[l] + (ptrdiff_t)y * s;
      if (l == 0) {
        memcpy(to, grey + (size_t)y * (size_t)w, (size_t)w * sizeof(float));
        continue;
      }
      const float *r0 = p->px[l - 1] + (ptrdiff_t)(2 * y) * p->stride[l - 1], *r1 = r0 + p->stride[l - 1];
      for (int x = 0; x < w; x++) to[x] = 0.25f * ((r0[2 * x] + r0[2 * x + 1]) + (r1[2 * x] + r1[2 * x + 1]));
    }
    fill_border(p, l);
  }
  return SV_OK;
}

void sv_flow_pyramid_free(sv_flow_pyramid *p) {
  free(p->block);
  memset(p, 0, sizeof *p);
}

void sv_flow_work_free(sv_flow_work *w) {
  free(w->block);
  memset(w, 0, sizeof *w);
}

// --- one patch -----------------------------------------------------------------------------------

typedef struct {
  const float *a, *b;
  int a_stride, b_stride, a_width, a_height, b_width, b_height;
} level;

// A row of a patch. The compiler maps it to whatever vectors the machine has; the bits are the
// same.
typedef float row __attribute__((vector_size(PATCH * sizeof(float)), aligned(sizeof(float)), may_alias));

typedef struct {
  float x0, y0;                       // its corner in a
  row a[PATCH], gx[PATCH], gy[PATCH]; // without their means
  float ixx, ixy, iyy;                // inverse of sum of g g^T
} patch;

typedef struct {
  float u, v, error; // error: sum of squared differences without their mean
} found;

static float fold(const row *r) {
  const row v = *r;
  return ((v[0] + v[4]) + (v[2] + v[6])) + ((v[1] + v[5]) + (v[3] + v[7]));
}

static float dot(const row a[PATCH], const row b[PATCH]) {
  row sum = a[0] * b[0];
  for (int i = 1; i < PATCH; i++) sum += a[i] * b[i];
  return fold(&sum);
}

static void remove_mean(row v[PATCH]) {
  row sum = v[0];
  for (int i = 1; i < PATCH; i++) sum += v[i];
  float mean = fold(&sum) / AREA;
  for (int i = 0; i < PATCH; i++) v[i] -= mean;
}

static void patch_make(patch *p, const level *lv, int x0, int y0) {
  p->x0 = (float)x0;
  p->y0 = (float)y0;
  for (int i = 0; i < PATCH; i++) {
    const float *c = lv->a + (ptrdiff_t)(y0 + i) * lv->a_stride + x0;
    p->a[i] = *(const row *)c;
    p->gx[i] = 0.5f * (*(const row *)(c + 1) - *(const row *)(c - 1));
    p->gy[i] = 0.5f * (*(const row *)(c + lv->a_stride) - *(const row *)(c - lv->a_stride));
  }
  remove_mean(p->a);
  remove_mean(p->gx);
  remove_mean(p->gy);
  float xx = DAMPING + dot(p->gx, p->gx), xy = dot(p->gx, p->gy), yy = DAMPING + dot(p->gy, p->gy);
  float det = xx * yy - xy * xy; // at least DAMPING^2
  p->ixx = yy / det;
  p->ixy = -xy / det;
  p->iyy = xx / det;
}

static float clamp(float x, float lo, float hi) { return x < lo ? lo : x > hi ? hi : x; }

// b at the patch moved by (u, v), without its mean, minus a. Returns the sum of squares. A patch
// that is moved out of b looks at the border.
static float difference(const patch *p, const level *lv, float u, float v, row d[PATCH]) {
  float x = clamp(p->x0 + u, -BORDER + 1, (float)(lv->b_width + BORDER - PATCH - 2));
  float y = clamp(p->y0 + v, -BORDER + 1, (float)(lv->b_height + BORDER - PATCH - 2));
  float fx = floorf(x), fy = floorf(y), tx = x - fx, ty = y - fy;
  const float *b = lv->b + (ptrdiff_t)fy * lv->b_stride + (ptrdiff_t)fx;
  float w00 = (1 - tx) * (1 - ty), w10 = tx * (1 - ty), w01 = (1 - tx) * ty, w11 = tx * ty;
  for (int i = 0; i < PATCH; i++, b += lv->b_stride) {
    const float *below = b + lv->b_stride;
    d[i] = (w00 * *(const row *)b + w10 * *(const row *)(b + 1)) +
           (w01 * *(const row *)below + w11 * *(const row *)(below + 1));
  }
  remove_mean(d);
  for (int i = 0; i < PATCH; i++) d[i] -= p->a[i];
  return dot(d, d);
}

// Gauss-Newton from (u, v); never worse than where it began.
static found align(const patch *p, const level *lv, float u, float v) {
  row d[PATCH];
  float u0 = u, v0 = v;
  found best = {u, v, difference(p, lv, u, v, d)};
  for (int i = 0; i < ITERATIONS; i++) {
    float bx = dot(p->gx, d), by = dot(p->gy, d);
    float du = p->ixx * bx + p->ixy * by, dv = p->ixy * bx + p->iyy * by;
    u -= du;
    v -= dv;
    if (!(fabsf(u - u0) <= REACH && fabsf(v - v0) <= REACH)) break;
    float error = difference(p, lv, u, v, d);
    if (!(error < best.error)) break;
    best = (found){u, v, error};
    if (du * du + dv * dv < 1e-4f) break;
  }
  return best;
}

// --- one level -----------------------------------------------------------------------------------

typedef struct {
  level lv;
  int nx, ny;    // patches
  found *at;     // [ny][nx]
  float *uv;     // [2][height][width], in: from the coarser level; out
  float *weight; // [height][width]
} search;

// Patches lie STEP apart; the last ones end with the picture.
static int patch_place(int i, int n_px) { return STEP * i + PATCH <= n_px ? STEP * i : n_px - PATCH; }
static int patch_count(int n_px) { return (n_px - PATCH + STEP - 1) / STEP + 1; }

static void try_start(found *best, const patch *p, const level *lv, const found *other) {
  row d[PATCH];
  float error = difference(p, lv, other->u, other->v, d);
  if (error < best->error) *best = (found){other->u, other->v, error};
}

// First from the top left: start from the coarser level or the neighbors before; then back: the
// neighbors behind.
static void search_patches(search *s) {
  const level *lv = &s->lv;
  size_t n = (size_t)lv->a_width * (size_t)lv->a_height;
  for (int pass = 0; pass < 2; pass++)
    for (int k = 0; k < s->nx * s->ny; k++) {
      int i = pass ? s->nx * s->ny - 1 - k : k, ix = i % s->nx, iy = i / s->nx, back = pass ? 1 : -1;
      int x0 = patch_place(ix, lv->a_width), y0 = patch_place(iy, lv->a_height);
      patch p;
      row d[PATCH];
      patch_make(&p, lv, x0, y0);
      found start = s->at[i];
      if (!pass) {
        size_t c = (size_t)(y0 + PATCH / 2) * (size_t)lv->a_width + (size_t)(x0 + PATCH / 2);
        start = (found){s->uv[c], s->uv[n + c], 0};
        start.error = difference(&p, lv, start.u, start.v, d);
      }
      found before = start;
      if (ix + back >= 0 && ix + back < s->nx) try_start(&start, &p, lv, &s->at[i + back]);
      if (iy + back >= 0 && iy + back < s->ny) try_start(&start, &p, lv, &s->at[i + back * s->nx]);
      bool is_new = start.u != before.u || start.v != before.v;
      s->at[i] = !pass || is_new ? align(&p, lv, start.u, start.v) : start;
    }
}

// Each pixel: mean over the patches that cover it, weighted with 1 / max(1, |difference|).
static void blend(search *s) {
  const level *lv = &s->lv;
  size_t w = (size_t)lv->a_width, n = w * (size_t)lv->a_height;
  memset(s->uv, 0, 2 * n * sizeof(float));
  memset(s->weight, 0, n * sizeof(float));
  for (int i = 0; i < s->nx * s->ny; i++) {
    patch p;
    row d[PATCH];
    int x0 = patch_place(i % s->nx, lv->a_width), y0 = patch_place(i / s->nx, lv->a_height);
    const found *f = &s->at[i];
    patch_make(&p, lv, x0, y0);
    difference(&p, lv, f->u, f->v, d);
    for (int k = 0; k < AREA; k++) {
      size_t to = (size_t)(y0 + k / PATCH) * w + (size_t)(x0 + k % PATCH);
      float e = fabsf(d[k / PATCH][k % PATCH]), g = 1.0f / (e > 1 ? e : 1);
      s->uv[to] += g * f->u;
      s->uv[n + to] += g * f->v;
      s->weight[to] += g;
    }
  }
  for (size_t i = 0; i < n; i++) {
    s->uv[i] /= s->weight[i];
    s->uv[n + i] /= s->weight[i];
  }
}

// --- all levels ----------------------------------------------------------------------------------

// The coarsest level begins where the homography (or the images' sizes) says.
static void begin(search *s, const double *h, double unit_a, double size_x, double size_y) {
  int w = s->lv.a_width;
  size_t n = (size_t)w * (size_t)s->lv.a_height;
  for (size_t i = 0; i < n; i++) {
    double x = ((double)(i % (size_t)w) + 0.5) * unit_a, y = ((double)(i / (size_t)w) + 0.5) * unit_a;
    double u = x * size_x, v = y * size_y;
    if (h) {
      double z = h[6] * x + h[7] * y + h[8];
      if (z > 1e-9) {
        u = (h[0] * x + h[1] * y + h[2]) / z;
        v = (h[3] * x + h[4] * y + h[5]) / z;
      }
    }
    // a horizon may project to anywhere
    double far = 4.0 * (s->lv.b_width + s->lv.b_height) * unit_a;
    u = u < -far ? -far : u > far ? far : u;
    v = v < -far ? -far : v > far ? far : v;
    s->uv[i] = (float)((u - x) / unit_a);
    s->uv[n + i] = (float)((v - y) / unit_a);
  }
}

static void refine_from(const float *coarse, int cw, int ch, float *uv, int w, int h) {
  size_t n = (size_t)w * (size_t)h, cn = (size_t)cw * (size_t)ch;
  for (int y = 0; y < h; y++)
    for (int x = 0; x < w; x++) {
      int cx = x / 2 < cw ? x / 2 : cw - 1, cy = y / 2 < ch ? y / 2 : ch - 1;
      size_t from = (size_t)cy * (size_t)cw + (size_t)cx, to = (size_t)y * (size_t)w + (size_t)x;
      uv[to] = 2 * coarse[from];
      uv[n + to] = 2 * coarse[cn + from];
    }
}

static bool reserve(sv_flow_work *w, size_t floats) {
  if (floats <= w->cap_floats) return true;
  free(w->block);
  w->block = malloc(floats * sizeof(float));
  w->cap_floats = w->block ? floats : 0;
  return w->block;
}

sv_status sv_flow_dense(const sv_flow_pyramid *a, const sv_flow_pyramid *b, const double *start,
                        sv_flow_work *work, float *flow) {
  size_t n = (size_t)a->width[0] * (size_t)a->height[0];
  size_t n_patches = (size_t)patch_count(a->width[0]) * (size_t)patch_count(a->height[0]);
  if (!reserve(work, 3 * n + n_patches * (sizeof(found) / sizeof(float)))) return SV_E_NOMEM;
  int top = (a->n_levels < b->n_levels ? a->n_levels : b->n_levels) - 1;
  float *coarse = work->block, *weight = coarse + 2 * n;
  found *at = (found *)(void *)(weight + n);
  for (int l = top; l >= 0; l--) {
    int w = a->width[l], h = a->height[l];
    search s = {.lv = {.a = a->px[l],
                       .b = b->px[l],
                       .a_stride = a->stride[l],
                       .b_stride = b->stride[l],
                       .a_width = w,
                       .a_height = h,
                       .b_width = b->width[l],
                       .b_height = b->height[l]},
                .nx = patch_count(w),
                .ny = patch_count(h),
                .at = at,
                .uv = flow,
                .weight = weight};
    if (l == top)
      begin(&s, start, (double)(1 << l), (double)b->width[0] / a->width[0],
            (double)b->height[0] / a->height[0]);
    else refine_from(coarse, a->width[l + 1], a->height[l + 1], flow, w, h);
    search_patches(&s);
    blend(&s);
    if (l > 0) memcpy(coarse, flow, 2 * (size_t)w * (size_t)h * sizeof(float));
  }
  return SV_OK;
}

// --- forward-backward check ----------------------------------------------------------------------

static bool lookup(const sv_flow_field *f, double x, double y, double uv[2]) {
  size_t n = (size_t)f->width * (size_t)f->height;
  if (!(x >= 0 && y >= 0 && x <= f->width - 1 && y <= f->height - 1)) return false;
  size_t x0 = (size_t)x, y0 = (size_t)y, w = (size_t)f->width;
  size_t x1 = x0 + 1 < w ? x0 + 1 : x0, y1 = y0 + 1 < (size_t)f->height ? y0 + 1 : y0;
  double tx = x - (double)x0, ty = y - (double)y0;
  for (size_t k = 0; k < 2; k++) {
    const float *p = f->uv + k * n;
    double a = (1 - tx) * (double)p[y0 * w + x0] + tx * (double)p[y0 * w + x1];
    double b = (1 - tx) * (double)p[y1 * w + x0] + tx * (double)p[y1 * w + x1];
    uv[k] = (1 - ty) * a + ty * b;
  }
  return true;
}

void sv_flow_check(const sv_flow_field *fw, const sv_flow_field *bw, double unit, uint8_t *seen) {
  size_t n = (size_t)fw->width * (size_t)fw->height;
  for (size_t i = 0; i < n; i++) {
    double u = (double)fw->uv[i], v = (double)fw->uv[n + i], back[2];
    seen[i] = 0;
    if (!lookup(bw, (double)(i % (size_t)fw->width) + u, (double)(i / (size_t)fw->width) + v, back)) continue;
    double e2 = (u + back[0]) * (u + back[0]) + (v + back[1]) * (v + back[1]);
    double size2 = u * u + v * v + back[0] * back[0] + back[1] * back[1];
    seen[i] = unit * unit * e2 <= 0.01 * unit * unit * size2 + 0.5;
  }
}
