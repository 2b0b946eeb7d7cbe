// SPDX-License-Identifier: Apache-2.0
// Pyramids, corners, and the alignment of one patch.
#include <string.h>

#include "src/base/mathx.h"
#include "src/track/tracker.h"

#define QUALITY       0.01f // minimum relative to the best corner's score
#define MIN_SCORE     2e-4f // absolute minimum: about 1 % contrast over the neighbourhood
#define APART_PX      10.0f // between two features of a view
#define MASK_REACH_PX 6     // half of a patch
#define ALIGN_ITER    12
#define ALIGN_ENOUGH  0.01f // px
#define AFFINE_ITER   10
// damping of the map's four parameters; the two of position are better determined
#define AFFINE_DAMP  0.02
#define AFFINE_REACH 4.0f // pixels of the patch
#define ALIGN_REACH  6.0f // px of the level; a larger motion is a wrong match

sv_track_plane sv_track_level(const sv_tracker *t, bool is_now, int i_view, int level) {
  int w = t->width_px[i_view] >> level, h = t->height_px[i_view] >> level;
  const sv_track_pyramid *p = &t->pyramid[is_now ? t->i_now : 1 - t->i_now][i_view];
  return (sv_track_plane){p->level[level], w, h, sv_plane_pad(w)};
}

void sv_track_build(sv_tracker *t, const sv_image_u8 *image) {
  t->i_now = 1 - t->i_now;
  for (int v = 0; v < t->n_views; v++) {
    const sv_image_u8 *im = t->image + v;
    t->image[v] = image[t->sub_view[v]];
    sv_track_pyramid *p = &t->pyramid[t->i_now][v];
    sv_luma_args a = {.src = im->px,
                      .src_stride_bytes = (size_t)im->stride_bytes,
                      .width_px = im->width_px,
                      .dst = p->level[0],
                      .dst_stride = sv_plane_pad(im->width_px),
                      .row1 = im->height_px};
    t->k->luma(&a);
    for (int l = 1; l < t->n_levels[v]; l++) {
      sv_track_plane from = sv_track_level(t, true, v, l - 1), to = sv_track_level(t, true, v, l);
      sv_resize_args r = {.src = from.px,
                          .src_width_px = from.width_px,
                          .src_height_px = from.height_px,
                          .src_stride = from.stride,
                          .dst = p->level[l],
                          .dst_width_px = to.width_px,
                          .dst_height_px = to.height_px,
                          .dst_stride = to.stride,
                          .row1 = to.height_px};
      t->k->half(&r);
    }
  }
}

// Shell sort of cells by score, best first; ties by cell.
static void sort_cells(const sv_corner *c, int32_t *order, int n) {
  for (int gap = n / 2; gap > 0; gap /= 2)
    for (int i = gap; i < n; i++) {
      int32_t cell = order[i];
      int k = i;
      for (; k >= gap; k -= gap) {
        int32_t o = order[k - gap];
        if (c[o].score > c[cell].score || (c[o].score == c[cell].score && o < cell)) break;
        order[k] = o;
      }
      order[k] = cell;
    }
}

// Masks corners near points that the view already tracks.
static void forget_taken(sv_tracker *t, int i_view, int n_x, int n_y) {
  for (int i = 0; i < t->n_live; i++) {
    const sv_track_point *p = &t->point[t->live[i]];
    if (p->now[i_view] < 0) continue;
    const float *uv = t->obs[p->now[i_view]].uv_px;
    int cx = (int)uv[0] / SV_CORNER_CELL, cy = (int)uv[1] / SV_CORNER_CELL;
    for (int y = sv_maxi(cy - 1, 0); y <= sv_mini(cy + 1, n_y - 1); y++)
      for (int x = sv_maxi(cx - 1, 0); x <= sv_mini(cx + 1, n_x - 1); x++) {
        sv_corner *c = &t->corner[y * n_x + x];
        float dx = (float)c->x + 0.5f - uv[0], dy = (float)c->y + 0.5f - uv[1];
        if (dx * dx + dy * dy < APART_PX * APART_PX) c->score = 0;
      }
  }
}

// What is in a mask or at its border does not belong to the scene.
static bool has_masked_near(const sv_image_u8 *im, int x, int y) {
  for (int j = sv_maxi(y - MASK_REACH_PX, 0); j <= sv_mini(y + MASK_REACH_PX, im->height_px - 1); j++)
    for (int i = sv_maxi(x - MASK_REACH_PX, 0); i <= sv_mini(x + MASK_REACH_PX, im->width_px - 1); i++)
      if (!sv_image_counts(im, 1, i, j)) return true;
  return false;
}

static void forget_masked(sv_tracker *t, int i_view, int n_cells) {
  const sv_image_u8 *im = &t->image[i_view];
  for (int i = 0; i < n_cells && im->mask; i++)
    if (t->corner[i].score > 0 && has_masked_near(im, t->corner[i].x, t->corner[i].y)) t->corner[i].score = 0;
}

int sv_track_detect(sv_tracker *t, int i_view) {
  sv_track_plane p = sv_track_level(t, true, i_view, 0);
  int n_x = (p.width_px + SV_CORNER_CELL - 1) / SV_CORNER_CELL,
      n_y = (p.height_px + SV_CORNER_CELL - 1) / SV_CORNER_CELL, n = 0;
  sv_corner_args a = {.src = p.px,
                      .width_px = p.width_px,
                      .height_px = p.height_px,
                      .stride = p.stride,
                      .margin_px = SV_TRACK_MARGIN_PX,
                      .cell1 = n_y,
                      .out = t->corner,
                      .scratch = t->scratch};
  t->k->corner(&a);
  forget_masked(t, i_view, n_x * n_y);
  float best = 0;
  for (int i = 0; i < n_x * n_y; i++) best = sv_maxf(best, t->corner[i].score);
  float least = sv_maxf(QUALITY * best, MIN_SCORE);
  forget_taken(t, i_view, n_x, n_y);
  for (int i = 0; i < n_x * n_y; i++)
    if (t->corner[i].score >= least) t->order[n++] = i;
  sort_cells(t->corner, t->order, n);
  return n;
}

// --- alignment -----------------------------------------------------------------------------------

typedef struct {
  double pp, px, py, hxx, hxy, hyy; // sums of the patch with itself and its slopes
} patch_moments;

static patch_moments moments_of(const sv_patch *p) {
  patch_moments m = {0};
  for (int i = 0; i < SV_PATCH_PIXELS; i++) {
    double v = (double)p->v[0][i], gx = (double)p->v[1][i], gy = (double)p->v[2][i];
    m.pp += v * v;
    m.px += v * gx;
    m.py += v * gy;
    m.hxx += gx * gx;
    m.hxy += gx * gy;
    m.hyy += gy * gy;
  }
  return m;
}

static bool fits(const sv_track_plane *p, float x, float y) {
  return x >= SV_PATCH_REACH && x < (float)(p->width_px - SV_PATCH_REACH - 1) && y >= SV_PATCH_REACH &&
         y < (float)(p->height_px - SV_PATCH_REACH - 1);
}

static float correlation(const float sums[5], double pp) {
  double var = (double)sums[1] - (double)sums[0] * (double)sums[0] / SV_PATCH_PIXELS;
  return var > 1e-6 && pp > 1e-6 ? (float)((double)sums[2] / sqrt(var * pp)) : -1.0f;
}

float sv_track_align(sv_tracker *t, const sv_track_plane *p, float *x, float *y) {
  const patch_moments m = moments_of(t->patch);
  double det = m.hxx * m.hyy - m.hxy * m.hxy;
  float sums[5], ax = *x, ay = *y, best = -1.0f;
  if (!(det > 1e-9)) return -1.0f;
  sv_patch_sums_args a = {
      .src = p->px, .stride = p->stride, .patch = t->patch, .x = &ax, .y = &ay, .n = 1, .out = &sums};
  for (int it = 0; it < ALIGN_ITER; it++) {
    float dx = ax - *x, dy = ay - *y;
    if (!fits(p, ax, ay) || dx * dx + dy * dy > ALIGN_REACH * ALIGN_REACH) return -1.0f;
    t->k->patch_sums(&a);
    best = correlation(sums, m.pp);
    // The contrast may have changed: slopes are compared at the image's contrast.
    double gain = (double)sums[2] / m.pp;
    if (!(gain > 0.2 && gain < 5)) return -1.0f;
    double bx = (double)sums[3] / gain - m.px, by = (double)sums[4] / gain - m.py;
    double sx = (m.hyy * bx - m.hxy * by) / det, sy = (m.hxx * by - m.hxy * bx) / det;
    ax -= (float)sx;
    ay -= (float)sy;
    if (sx * sx + sy * sy < (double)(ALIGN_ENOUGH * ALIGN_ENOUGH)) break;
  }
  float dx = ax - *x, dy = ay - *y;
  if (!fits(p, ax, ay) || dx * dx + dy * dy > ALIGN_REACH * ALIGN_REACH) return -1.0f;
  *x = ax;
  *y = ay;
  return best;
}

// --- with an affine map --------------------------------------------------------------------------

// Steepest descent images at pixel s: slopes times (1, i, j), i and j from the patch's centre.
static void descent(const sv_patch *p, int s, double sd[6]) {
  int b = s >> 4;
  double i = b % 3 * 4 + (s & 3) - 5.5, j = b / 3 * 4 + (s >> 2 & 3) - 5.5;
  double gx = (double)p->v[1][s], gy = (double)p->v[2][s];
  sd[0] = gx;
  sd[1] = gy;
  sd[2] = gx * i;
  sd[3] = gy * i;
  sd[4] = gx * j;
  sd[5] = gy * j;
}

static bool factor6(double a[36]) {
  for (int i = 0; i < 6; i++)
    for (int j = 0; j <= i; j++) {
      double s = a[6 * i + j];
      for (int k = 0; k < j; k++) s -= a[6 * i + k] * a[6 * j + k];
      if (i > j) a[6 * i + j] = s / a[7 * j];
      else if (s > 1e-9) a[7 * i] = sqrt(s);
      else return false;
    }
  return true;
}

static void substitute6(const double a[36], double x[6]) {
  for (int i = 0; i < 6; i++) {
    for (int k = 0; k < i; k++) x[i] -= a[6 * i + k] * x[k];
    x[i] /= a[7 * i];
  }
  for (int i = 5; i >= 0; i--) {
    for (int k = i + 1; k < 6; k++) x[i] -= a[6 * k + i] * x[k];
    x[i] /= a[7 * i];
  }
}

void sv_track_prepare_ref(sv_track_ref *r) {
  double mean[6] = {0}, sd[6];
  memset(r->l, 0, sizeof r->l);
  memset(r->tp, 0, sizeof r->tp);
  r->tt = 0;
  for (int s = 0; s < SV_PATCH_PIXELS; s++) {
    double v = (double)r->patch.v[0][s];
    descent(&r->patch, s, sd);
    r->tt += v * v;
    for (int a = 0; a < 6; a++) {
      mean[a] += sd[a] / SV_PATCH_PIXELS;
      r->tp[a] += v * sd[a];
      for (int b = 0; b <= a; b++) r->l[6 * a + b] += sd[a] * sd[b];
    }
  }
  for (int a = 0; a < 6; a++)
    for (int b = 0; b <= a; b++) r->l[6 * a + b] -= SV_PATCH_PIXELS * mean[a] * mean[b];
  for (int a = 2; a < 6; a++) r->l[7 * a] *= 1 + AFFINE_DAMP;
  r->is_usable = factor6(r->l) && r->tt > 1e-6;
}

// The sampled values against the patch: the gradient of the squared difference by the six, at the
// picture's contrast. Returns the correlation.
static double compare(const sv_tracker *t, const sv_track_ref *r, const float *v, double b[6]) {
  sv_patch_compare_args a = {.v = v, .patch = &r->patch};
  t->k->patch_compare(&a);
  double vt = (double)a.out[0], vv = (double)a.out[1];
  if (!(vv > 1e-6) || !(vt > 0.2 * r->tt)) return -1;
  for (int k = 0; k < 6; k++) b[k] = (double)a.out[2 + k] * (r->tt / vt) - r->tp[k];
  return vt / sqrt(vv * r->tt);
}

// warp <- warp D^-1, position <- position - warp D^-1 d: the inverse compositional update.
static bool update(float uv[2], float warp[4], const double d[6], double *way) {
  double p = 1 + d[2], q = d[4], r = d[3], s = 1 + d[5], det = p * s - q * r;
  if (!(det > 0.3 && det < 3)) return false;
  double i[4] = {s / det, -q / det, -r / det, p / det}, w[4];
  for (int a = 0; a < 2; a++)
    for (int b = 0; b < 2; b++)
      w[2 * a + b] = (double)warp[2 * a] * i[b] + (double)warp[2 * a + 1] * i[2 + b];
  double dx = w[0] * d[0] + w[1] * d[1], dy = w[2] * d[0] + w[3] * d[1];
  for (int a = 0; a < 4; a++) warp[a] = (float)w[a];
  uv[0] -= (float)dx;
  uv[1] -= (float)dy;
  *way = sqrt(dx * dx + dy * dy);
  return true;
}

float sv_track_spacing(const float warp[4]) {
  float det = warp[0] * warp[3] - warp[1] * warp[2];
  return det > 0 ? sqrtf(det) : 0;
}

float sv_track_align_affine(sv_tracker *t, int i_ref, int i_view, float uv_px[2], float warp[4]) {
  const sv_track_ref *ref = &t->ref[i_ref];
  float uv[2] = {uv_px[0], uv_px[1]}, w[4] = {warp[0], warp[1], warp[2], warp[3]},
        space = sv_track_spacing(warp);
  int level = 0;
  while (level + 1 < t->n_levels[i_view] && space > 1.42f * (float)(1 << level)) level++;
  float k = 1.0f / (float)(1 << level);
  sv_track_plane p = sv_track_level(t, true, i_view, level);
  double corr = -1, way = 1;
  if (!ref->is_usable || !(space > 0)) return -1.0f;
  for (int it = 0; it <= AFFINE_ITER; it++) {
    sv_patch_take_args a = {.src = p.px,
                            .width_px = p.width_px,
                            .height_px = p.height_px,
                            .stride = p.stride,
                            .x = uv[0] * k,
                            .y = uv[1] * k,
                            .a = {w[0] * k, w[1] * k, w[2] * k, w[3] * k},
                            .out = &t->patch[1]};
    double b[6];
    t->k->patch_take(&a);
    if (!a.is_inside || (corr = compare(t, ref, t->patch[1].v[0], b)) < 0) return -1.0f;
    if (way < 0.01 * (double)space || it == AFFINE_ITER) break;
    substitute6(ref->l, b);
    if (!update(uv, w, b, &way)) return -1.0f;
    float dx = uv[0] - uv_px[0], dy = uv[1] - uv_px[1], now = sv_track_spacing(w);
    if (dx * dx + dy * dy > AFFINE_REACH * AFFINE_REACH * space * space || !(now > 0.6f * space) ||
        !(now < 1.6f * space))
      return -1.0f;
  }
  memcpy(uv_px, uv, sizeof uv);
  memcpy(warp, w, sizeof w);
  return (float)corr;
}
