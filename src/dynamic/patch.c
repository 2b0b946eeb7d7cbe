// SPDX-License-Identifier: Apache-2.0
#include "src/dynamic/patch.h"

#include "src/base/mathx.h"

#define RADIUS   3
#define SIDE_PX  200
#define IN_FRONT 0.03f // of the depth

int sv_patch_scale(const sv_view *v, float usual_fx_px) {
  int k = 1;
  while (k < SV_UNPACK_CAP_K && sv_maxi(v->width_px, v->height_px) / k > SIDE_PX) k++;
  const float max = 1.0001f * usual_fx_px / (float)k;
  while (k > 1 && v->fx / (float)(k - 1) <= max) k--;
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

static const float *row_of(sv_image_patch p, int c, int j) {
  return p.image->c[c] + (long)(p.y + j) * p.image->stride + p.x - RADIUS;
}

float sv_patch_mismatch(sv_image_patch a, sv_image_patch b, float max) {
  float sum = 0;
  for (int j = -RADIUS; j <= RADIUS && sum <= max; j++)
    for (int c = 0; c < 3; c++) {
      const float *p = row_of(a, c, j), *q = row_of(b, c, j);
      for (int i = 0; i < 2 * RADIUS + 1; i++) sum += (p[i] - q[i]) * (p[i] - q[i]);
    }
  return sum;
}

static sv_image_patch moved(sv_image_patch p, int dx, int dy) {
  p.x += dx;
  p.y += dy;
  return p;
}

static bool is_inside(sv_image_patch p) { return sv_patch_is_inside(p.image, p.x, p.y); }

float sv_patch_texture(const sv_planes *p, int x, int y) {
  const sv_image_patch a = {p, x, y};
  if (!sv_patch_is_inside(p, x - 1, y - 1) || !sv_patch_is_inside(p, x + 1, y + 1)) return 0;
  return sv_minf(sv_patch_mismatch(a, moved(a, 1, 0), 1e30f), sv_patch_mismatch(a, moved(a, 0, 1), 1e30f));
}

float sv_patch_search(sv_image_patch a, sv_image_patch *b, int reach) {
  const sv_image_patch start = *b;
  float best = is_inside(start) ? sv_patch_mismatch(a, start, 1e30f) : 1e30f;
  for (int j = -reach; j <= reach; j++)
    for (int i = -reach; i <= reach; i++) {
      const sv_image_patch at = moved(start, i, j);
      if (!is_inside(at)) continue;
      float here = sv_patch_mismatch(a, at, best);
      if (here < best) {
        best = here;
        *b = at;
      }
    }
  return best;
}

// Offset of the minimum of a parabola through three values, the middle one the smallest.
static float vertex(float l, float m, float r) {
  float curve = l - 2 * m + r;
  return curve > 0 ? sv_clampf(0.5f * (l - r) / curve, -0.5f, 0.5f) : 0;
}

bool sv_patch_project(const sv_view *v, const float x[3], float px[2], float *z, float *jac) {
  float c[3];
  for (int r = 0; r < 3; r++)
    c[r] = v->r[3 * r] * x[0] + v->r[3 * r + 1] * x[1] + v->r[3 * r + 2] * x[2] + v->t[r];
  *z = c[2];
  if (v->fisheye) {
    float j[6];
    if (!sv_view_project(v, c, px, z) || !(*z > 1e-6f)) return false;
    sv_view_jacobian(v, c, j);
    for (int k = 0; k < 6 && jac; k++) {
      const float *of = j + k / 3 * 3;
      jac[k] = of[0] * v->r[k % 3] + of[1] * v->r[3 + k % 3] + of[2] * v->r[6 + k % 3];
    }
    return true;
  }
  if (!(c[2] > 1e-6f)) return false;
  px[0] = v->fx * c[0] / c[2] + v->cx;
  px[1] = v->fy * c[1] / c[2] + v->cy;
  for (int k = 0; k < 3 && jac; k++) {
    jac[k] = v->fx / c[2] * (v->r[k] - c[0] / c[2] * v->r[6 + k]);
    jac[3 + k] = v->fy / c[2] * (v->r[3 + k] - c[1] / c[2] * v->r[6 + k]);
  }
  return true;
}

void sv_patch_offset(sv_image_patch a, sv_image_patch b, float d[2]) {
  d[0] = d[1] = 0;
  if (!is_inside(moved(b, -1, -1)) || !is_inside(moved(b, 1, 1))) return;
  float m = sv_patch_mismatch(a, b, 1e30f);
  d[0] = vertex(sv_patch_mismatch(a, moved(b, -1, 0), 1e30f), m, sv_patch_mismatch(a, moved(b, 1, 0), 1e30f));
  d[1] = vertex(sv_patch_mismatch(a, moved(b, 0, -1), 1e30f), m, sv_patch_mismatch(a, moved(b, 0, 1), 1e30f));
}
