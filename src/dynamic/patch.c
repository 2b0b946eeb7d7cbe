// SPDX-License-Identifier: Apache-2.0
#include "src/dynamic/patch.h"

#include "src/base/mathx.h"

#define RADIUS   3
#define SIDE_PX  200
#define IN_FRONT 0.03f // of the depth

int sv_patch_scale(const sv_view *v, float usual_fx_px) {
  int k = 1;
  while (k < SV_UNPACK_CAP_K && sv_maxi(v->width_px, v->height_px) / k > SIDE_PX) k++;
  const float most = 1.0001f * usual_fx_px / (float)k;
  while (k > 1 && v->fx / (float)(k - 1) <= most) k--;
  return k;
}

bool sv_patch_is_in_front(const sv_renderer *r, int x, int y, float z) {
  const long at = (long)y * r->rgb.stride + x;
  const float alpha = 1.0f - r->trans[at];
  return alpha > 0.5f && fabsf(r->depth[at] / alpha - z) < IN_FRONT * z;
}

bool sv_patch_is_inside(const sv_planes *p, int x, int y) {
  return x >= RADIUS && y >= RADIUS && x < p->width_px - RADIUS && y < p->height_px - RADIUS;
}

float sv_patch_mismatch(const sv_planes *a, int xa, int ya, const sv_planes *b, int xb, int yb, float most) {
  float sum = 0;
  for (int j = -RADIUS; j <= RADIUS && sum <= most; j++)
    for (int c = 0; c < 3; c++) {
      const float *p = a->c[c] + (long)(ya + j) * a->stride + xa - RADIUS;
      const float *q = b->c[c] + (long)(yb + j) * b->stride + xb - RADIUS;
      for (int i = 0; i < 2 * RADIUS + 1; i++) sum += (p[i] - q[i]) * (p[i] - q[i]);
    }
  return sum;
}

float sv_patch_texture(const sv_planes *p, int x, int y) {
  if (!sv_patch_is_inside(p, x - 1, y - 1) || !sv_patch_is_inside(p, x + 1, y + 1)) return 0;
  return sv_minf(sv_patch_mismatch(p, x, y, p, x + 1, y, 1e30f),
                 sv_patch_mismatch(p, x, y, p, x, y + 1, 1e30f));
}

float sv_patch_search(const sv_planes *a, int xa, int ya, const sv_planes *b, int reach, int *x, int *y) {
  const int x0 = *x, y0 = *y;
  float best = sv_patch_is_inside(b, x0, y0) ? sv_patch_mismatch(a, xa, ya, b, x0, y0, 1e30f) : 1e30f;
  for (int j = -reach; j <= reach; j++)
    for (int i = -reach; i <= reach; i++) {
      if (!sv_patch_is_inside(b, x0 + i, y0 + j)) continue;
      float here = sv_patch_mismatch(a, xa, ya, b, x0 + i, y0 + j, best);
      if (here < best) {
        best = here;
        *x = x0 + i;
        *y = y0 + j;
      }
    }
  return best;
}

// Offset of the least of a parabola through three values, the middle one the least.
static float vertex(float l, float m, float r) {
  float curve = l - 2 * m + r;
  return curve > 0 ? sv_clampf(0.5f * (l - r) / curve, -0.5f, 0.5f) : 0;
}

bool sv_patch_project(const sv_view *v, const float x[3], float px[2], float *z, float *jac) {
  float c[3];
  for (int r = 0; r < 3; r++)
    c[r] = v->r[3 * r] * x[0] + v->r[3 * r + 1] * x[1] + v->r[3 * r + 2] * x[2] + v->t[r];
  *z = c[2];
  if (!(c[2] > 1e-6f)) return false;
  px[0] = v->fx * c[0] / c[2] + v->cx;
  px[1] = v->fy * c[1] / c[2] + v->cy;
  for (int k = 0; k < 3 && jac; k++) {
    jac[k] = v->fx / c[2] * (v->r[k] - c[0] / c[2] * v->r[6 + k]);
    jac[3 + k] = v->fy / c[2] * (v->r[3 + k] - c[1] / c[2] * v->r[6 + k]);
  }
  return true;
}

void sv_patch_offset(const sv_planes *a, int xa, int ya, const sv_planes *b, int x, int y, float d[2]) {
  d[0] = d[1] = 0;
  if (!sv_patch_is_inside(b, x - 1, y - 1) || !sv_patch_is_inside(b, x + 1, y + 1)) return;
  float m = sv_patch_mismatch(a, xa, ya, b, x, y, 1e30f);
  d[0] = vertex(sv_patch_mismatch(a, xa, ya, b, x - 1, y, 1e30f), m,
                sv_patch_mismatch(a, xa, ya, b, x + 1, y, 1e30f));
  d[1] = vertex(sv_patch_mismatch(a, xa, ya, b, x, y - 1, 1e30f), m,
                sv_patch_mismatch(a, xa, ya, b, x, y + 1, 1e30f));
}
