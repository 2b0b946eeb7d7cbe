// SPDX-License-Identifier: Apache-2.0
#include "calib/remap.h"

#include <math.h>

// Where the view's point (u, v) lies in the lens' image; false when the lens does not see it.
static bool lookup(const sv_camera_model *lens, const sv_camera_model *view, double u, double v,
                   double uv[2]) {
  double x[3] = {(u - view->p[2]) / view->p[0], (v - view->p[3]) / view->p[1], 1};
  if (view->kind != SV_MODEL_PINHOLE && !sv_model_unproject(view, (const double[2]){u, v}, x)) return false;
  if (!sv_model_project(lens, x, uv, NULL, NULL)) return false;
  return uv[0] >= 0 && uv[0] <= lens->width_px && uv[1] >= 0 && uv[1] <= lens->height_px;
}

// Every border pixel seen means every pixel seen: the lens' range is star-shaped about its axis.
static bool is_border_seen(const sv_camera_model *lens, const sv_camera_model *view) {
  double uv[2], w = view->width_px, h = view->height_px;
  for (int i = 0; i < view->width_px; i++)
    if (!lookup(lens, view, i + 0.5, 0.5, uv) || !lookup(lens, view, i + 0.5, h - 0.5, uv)) return false;
  for (int j = 0; j < view->height_px; j++)
    if (!lookup(lens, view, 0.5, j + 0.5, uv) || !lookup(lens, view, w - 0.5, j + 0.5, uv)) return false;
  return true;
}

bool sv_pinhole_for_model(const sv_camera_model *m, sv_pinhole_choice choice, sv_camera_model *out) {
  sv_camera_model view = {.kind = SV_MODEL_PINHOLE, .width_px = m->width_px, .height_px = m->height_px};
  for (int i = 0; i < 4; i++) view.p[i] = m->p[i];
  if (!(m->p[0] > 0 && m->p[1] > 0 && m->width_px > 0 && m->height_px > 0)) return false;
  if (choice == SV_PINHOLE_CROP_TO_VALID && m->kind != SV_MODEL_PINHOLE) {
    double lo = 0.5, hi = 4; // hi is always a scale that shows no black
    view.p[0] = m->p[0] * hi;
    view.p[1] = m->p[1] * hi;
    if (!is_border_seen(m, &view)) return false;
    for (int it = 0; it < 24; it++) {
      double k = it == 0 ? lo : 0.5 * (lo + hi);
      view.p[0] = m->p[0] * k;
      view.p[1] = m->p[1] * k;
      if (is_border_seen(m, &view)) hi = k;
      else lo = k;
      if (lo == hi) break; // the widest allowed view fits already
    }
    view.p[0] = m->p[0] * hi;
    view.p[1] = m->p[1] * hi;
  }
  *out = view;
  return true;
}

static sv_remap_tap entry_at(double u, double v, int w, int h) {
  // from corners at (0,0) to pixel indices; the outer half pixel takes the border's value
  double x = u - 0.5, y = v - 0.5;
  x = x < 0 ? 0 : x > w - 1 ? w - 1 : x;
  y = y < 0 ? 0 : y > h - 1 ? h - 1 : y;
  int32_t qx = (int32_t)floor(x * 256 + 0.5), qy = (int32_t)floor(y * 256 + 0.5);
  return (sv_remap_tap){(int16_t)(qx >> 8), (int16_t)(qy >> 8), (uint8_t)(qx & 255), (uint8_t)(qy & 255)};
}

sv_status sv_remap_build(sv_remap *map, const sv_camera_model *lens, const sv_camera_model *view,
                         sv_remap_tap *entries) {
  if (view->kind != SV_MODEL_PINHOLE && view->kind != SV_MODEL_KB4) return SV_E_ARG;
  const int size[4] = {lens->width_px, lens->height_px, view->width_px, view->height_px};
  for (int i = 0; i < 4; i++)
    if (size[i] < 1 || size[i] > 32767) return SV_E_RANGE;
  *map = (sv_remap){size[0], size[1], size[2], size[3], 0, entries};
  for (int j = 0; j < size[3]; j++)
    for (int i = 0; i < size[2]; i++) {
      double uv[2];
      sv_remap_tap *e = entries + (size_t)j * (size_t)size[2] + (size_t)i;
      if (lookup(lens, view, i + 0.5, j + 0.5, uv)) *e = entry_at(uv[0], uv[1], size[0], size[1]);
      else {
        *e = (sv_remap_tap){SV_REMAP_NONE, 0, 0, 0};
        map->n_outside++;
      }
    }
  return SV_OK;
}

void sv_remap_apply(const sv_remap *map, const sv_remap_job *job) {
  const int nc = job->n_channels, w = map->width_px;
  for (int j = job->y0; j < job->y1; j++) {
    const sv_remap_tap *e = map->entries + (size_t)j * (size_t)w;
    uint8_t *dst = job->dst + (size_t)j * (size_t)w * (size_t)nc;
    uint8_t *mask = job->mask ? job->mask + (size_t)j * (size_t)w : NULL;
    for (int i = 0; i < w; i++, e++, dst += nc) {
      bool is_in = e->x != SV_REMAP_NONE;
      if (mask) mask[i] = is_in ? 255 : 0;
      if (!is_in) {
        for (int c = 0; c < nc; c++) dst[c] = 0;
        continue;
      }
      int x1 = e->x + 1 < map->src_width_px ? nc : 0; // the last column's neighbor has weight 0
      size_t y1 = e->y + 1 < map->src_height_px ? job->src_stride_bytes : 0;
      const uint8_t *s = job->src + (size_t)e->y * job->src_stride_bytes + (size_t)e->x * (size_t)nc;
      uint32_t fx = e->fx, fy = e->fy, gx = 256 - fx, gy = 256 - fy;
      for (int c = 0; c < nc; c++) {
        uint32_t top = s[c] * gx + s[x1 + c] * fx,
                 low = s[y1 + (size_t)c] * gx + s[y1 + (size_t)x1 + (size_t)c] * fx;
        dst[c] = (uint8_t)((top * gy + low * fy + 32768) >> 16);
      }
    }
  }
}

bool sv_remap_counts(const sv_remap *map, const uint8_t *mask, int x, int y) {
  const sv_remap_tap *e = map->entries + (size_t)y * (size_t)map->width_px + (size_t)x;
  if (e->x == SV_REMAP_NONE || !mask) return e->x != SV_REMAP_NONE;
  const int w = map->src_width_px;
  const size_t at = (size_t)e->y * (size_t)w + (size_t)e->x, right = e->fx ? 1 : 0,
               below = e->fy ? (size_t)w : 0;
  return mask[at] && mask[at + right] && mask[at + below] && mask[at + below + right];
}
