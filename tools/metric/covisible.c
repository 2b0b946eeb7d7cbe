// SPDX-License-Identifier: Apache-2.0
#include "tools/metric/covisible.h"

#include <math.h>

#define TOLERANCE  0.005 // of the depth
#define NEAR       1e-4  // scene units; nothing is projected from nearer
#define OVERLAP    1.25  // splats of neighboring pixels must not leave gaps
#define MAX_RADIUS 8.0   // px

int sv_covisible_needed(int n) {
  if (n <= 4) return n;
  int share = (n + 19) / 20;
  return share > 3 ? share : 3;
}

// A point: camera `from` -> camera `to`. For directions (points at infinity) leave t out.
typedef struct {
  double r[9], t[3];
} motion;

static motion between(const sv_view *to, const sv_view *from) {
  motion m;
  for (int i = 0; i < 3; i++) {
    for (int j = 0; j < 3; j++) {
      m.r[3 * i + j] = 0;
      for (int k = 0; k < 3; k++) m.r[3 * i + j] += (double)to->r[3 * i + k] * (double)from->r[3 * j + k];
    }
    m.t[i] = (double)to->t[i];
    for (int k = 0; k < 3; k++) m.t[i] -= m.r[3 * i + k] * (double)from->t[k];
  }
  return m;
}

// The ray of pixel (x, y) with z = 1.
static void ray(const sv_view *v, int x, int y, double out[3]) {
  out[0] = (x + 0.5 - (double)v->cx) / (double)v->fx;
  out[1] = (y + 0.5 - (double)v->cy) / (double)v->fy;
  out[2] = 1;
}

static void move(const motion *m, const double d[3], double depth, bool is_far, double out[3]) {
  for (int i = 0; i < 3; i++) {
    double turned = m->r[3 * i] * d[0] + m->r[3 * i + 1] * d[1] + m->r[3 * i + 2] * d[2];
    out[i] = is_far ? turned : depth * turned + m->t[i];
  }
}

static bool is_depth(float d) { return d > 0 && d < 1e30f; }

static int below(double x, int lo, int hi) { // floor, kept in [lo, hi]
  return x <= lo ? lo : x >= hi ? hi : (int)floor(x);
}

static void splat(sv_zbuffer *zb, double u, double v, double rx, double ry, float z) {
  int w = zb->view.width_px, h = zb->view.height_px;
  if (!(u + rx >= 0 && v + ry >= 0 && u - rx < w && v - ry < h)) return;
  // All pixels whose centers it covers, and the one it lies in.
  int x0 = below(u - rx + 0.5, 0, w - 1), x1 = below(u + rx - 0.5, 0, w - 1);
  int y0 = below(v - ry + 0.5, 0, h - 1), y1 = below(v + ry - 0.5, 0, h - 1);
  int xc = below(u, 0, w - 1), yc = below(v, 0, h - 1);
  if (x0 > xc) x0 = xc;
  if (x1 < xc) x1 = xc;
  if (y0 > yc) y0 = yc;
  if (y1 < yc) y1 = yc;
  for (int y = y0; y <= y1; y++)
    for (int x = x0; x <= x1; x++) {
      float *to = &zb->z[(size_t)y * (size_t)w + (size_t)x];
      if (*to == 0 || z < *to) *to = z;
    }
}

void sv_zbuffer_add(sv_zbuffer *zb, const sv_view *from, const float *depth) {
  const sv_view *to = &zb->view;
  motion m = between(to, from);
  for (int y = 0; y < from->height_px; y++)
    for (int x = 0; x < from->width_px; x++, depth++) {
      double d[3], p[3];
      if (!is_depth(*depth)) continue;
      ray(from, x, y, d);
      move(&m, d, (double)*depth, false, p);
      if (p[2] < NEAR) continue;
      double zoom = (double)*depth / p[2]; // half a pixel there, seen from here
      double rx = 0.5 * OVERLAP * zoom * (double)to->fx / (double)from->fx;
      double ry = 0.5 * OVERLAP * zoom * (double)to->fy / (double)from->fy;
      if (rx > MAX_RADIUS) rx = MAX_RADIUS;
      if (ry > MAX_RADIUS) ry = MAX_RADIUS;
      splat(zb, (double)to->fx * p[0] / p[2] + (double)to->cx, (double)to->fy * p[1] / p[2] + (double)to->cy,
            rx, ry, (float)p[2]);
    }
}

// Whether something stands before depth z everywhere around (x, y).
static bool is_hidden(const sv_zbuffer *zb, int x, int y, double z) {
  int w = zb->view.width_px, h = zb->view.height_px;
  for (int yy = y - 1; yy <= y + 1; yy++)
    for (int xx = x - 1; xx <= x + 1; xx++) {
      if (xx < 0 || yy < 0 || xx >= w || yy >= h) continue;
      float front = zb->z[(size_t)yy * (size_t)w + (size_t)xx];
      if (front == 0 || (double)front >= z * (1 - TOLERANCE)) return false;
    }
  return true;
}

void sv_covisible_by_depth(const sv_covisible_test *t, const sv_zbuffer *support, uint8_t *seen) {
  const sv_view *to = &support->view;
  motion m = between(to, t->view);
  for (int y = 0, i = 0; y < t->view->height_px; y++)
    for (int x = 0; x < t->view->width_px; x++, i++) {
      double d[3], p[3];
      bool has_depth = is_depth(t->depth[i]), is_far = !has_depth && t->is_sky && t->is_sky[i];
      seen[i] = 0;
      if (!has_depth && !is_far) continue;
      ray(t->view, x, y, d);
      move(&m, d, (double)t->depth[i], is_far, p);
      if (p[2] < NEAR) continue;
      double u = (double)to->fx * p[0] / p[2] + (double)to->cx,
             v = (double)to->fy * p[1] / p[2] + (double)to->cy;
      if (!(u >= 0 && v >= 0 && u < to->width_px && v < to->height_px)) continue;
      seen[i] = !is_hidden(support, (int)u, (int)v, is_far ? 1e30 : p[2]);
    }
}
