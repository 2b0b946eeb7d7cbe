// SPDX-License-Identifier: Apache-2.0
#include "src/train/transfer.h"

#include <math.h>

#include "kernels/kernels.h"
#include "src/base/mathx.h"

sv_transfer sv_transfer_make(const sv_view *b, const sv_view *a) {
  double r[9], t[3], kb[9] = {b->fx, 0, b->cx, 0, b->fy, b->cy, 0, 0, 1};
  double ka_inv[9] = {
      1 / (double)a->fx, 0, -(double)a->cx / a->fx, 0, 1 / (double)a->fy, -(double)a->cy / a->fy, 0, 0, 1};
  sv_transfer out;
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++)
      r[3 * i + j] = (double)b->r[3 * i] * a->r[3 * j] + (double)b->r[3 * i + 1] * a->r[3 * j + 1] +
                     (double)b->r[3 * i + 2] * a->r[3 * j + 2];
  for (int i = 0; i < 3; i++)
    t[i] = (double)b->t[i] - (r[3 * i] * a->t[0] + r[3 * i + 1] * a->t[1] + r[3 * i + 2] * a->t[2]);
  out.is_wide = a->fisheye || b->fisheye;
  out.a = a;
  out.b = b;
  for (int i = 0; i < 9; i++) out.r[i] = (float)r[i];
  for (int i = 0; i < 3; i++) out.t[i] = (float)t[i];
  sv_mul33(r, r, ka_inv);
  sv_mul33(r, kb, r);
  sv_apply33(t, kb, t);
  for (int i = 0; i < 9; i++) out.h[i] = (float)r[i];
  for (int i = 0; i < 3; i++) out.e[i] = (float)t[i];
  return out;
}

bool sv_transfer_see(const sv_transfer *q, float x, float y, float w, float uvz[3]) {
  if (q->is_wide) {
    float ray[3], p[3];
    if (!sv_view_ray(q->a, x, y, ray)) return false;
    for (int i = 0; i < 3; i++)
      p[i] = q->r[3 * i] * ray[0] + q->r[3 * i + 1] * ray[1] + q->r[3 * i + 2] * ray[2] + w * q->t[i];
    return sv_view_project(q->b, p, uvz, &uvz[2]) && uvz[2] > 1e-6f;
  }
  uvz[2] = q->h[6] * x + q->h[7] * y + q->h[8] + w * q->e[2];
  for (int i = 0; i < 2; i++)
    uvz[i] = (q->h[3 * i] * x + q->h[3 * i + 1] * y + q->h[3 * i + 2] + w * q->e[i]) / uvz[2];
  return uvz[2] > 1e-6f;
}

void sv_transfer_rays(const sv_view *a, int x0, int y, int n, float *const ray[3]) {
  for (int i = 0; i < n; i++) {
    float here[3];
    const bool is_ray = sv_view_ray(a, (float)(x0 + i) + 0.5f, (float)y + 0.5f, here);
    for (int k = 0; k < 3; k++) ray[k][i] = is_ray ? here[k] : NAN;
  }
}

void sv_transfer_see16(const sv_transfer *q, const float *const ray[3], float inverse, float x[16],
                       float y[16], float is_in[16]) {
  const sv_view *v = q->b;
  float p[3][16];
  for (int k = 0; k < 3; k++)
    for (int i = 0; i < 16; i++)
      p[k][i] = q->r[3 * k] * ray[0][i] + q->r[3 * k + 1] * ray[1][i] + q->r[3 * k + 2] * ray[2][i] +
                inverse * q->t[k];
  const float right = (float)v->width_px, bottom = (float)v->height_px;
  for (int i = 0; i < 16; i++) {
    float s = p[2][i], k = 1;
    bool is_seen = s > 1e-6f;
    if (v->fisheye) {
      const sv_fisheye *f = v->fisheye;
      s += sqrtf(p[0][i] * p[0][i] + p[1][i] * p[1][i] + p[2][i] * p[2][i]);
      const float w = (p[0][i] * p[0][i] + p[1][i] * p[1][i]) / (s * s), at = f->scale * w - 1.0f;
      k = f->term[0];
      for (int j = 1; j < SV_FISHEYE_TERMS; j++) k = k * at + f->term[j];
      is_seen = w <= f->max_w;
    }
    k = is_seen ? k / s : 0;
    const float u = v->fx * (p[0][i] * k) + v->cx, w = v->fy * (p[1][i] * k) + v->cy;
    is_seen = is_seen & (u >= 0) & (u <= right) & (w >= 0) & (w <= bottom);
    is_in[i] = is_seen ? 1.0f : 0.0f;
    x[i] = is_seen ? sv_clampf(u - 0.5f, 0, right - 1.001f) : 0;
    y[i] = is_seen ? sv_clampf(w - 0.5f, 0, bottom - 1.001f) : 0;
  }
}
