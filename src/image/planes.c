// SPDX-License-Identifier: Apache-2.0
#include "src/image/planes.h"

#include <string.h>

#define CAP_SIDE_PX 16384

void sv_planes_set_size(sv_planes *p, int width_px, int height_px) {
  p->width_px = width_px;
  p->height_px = height_px;
  p->stride = sv_plane_pad(width_px);
  p->rows_padded = sv_plane_pad(height_px);
}

static int is_side_ok(int n) { return n >= 1 && n <= CAP_SIDE_PX; }

sv_status sv_planes_init(sv_planes *p, int width_px, int height_px, sv_arena *a) {
  if (!is_side_ok(width_px) || !is_side_ok(height_px)) return SV_E_ARG;
  sv_planes_set_size(p, width_px, height_px);
  for (int k = 0; k < 3; k++) p->c[k] = SV_TAKE(a, float, sv_plane_floats(width_px, height_px));
  if (a->status < 0) return a->status;
  if (p->c[0]) sv_planes_clear(p);
  return SV_OK;
}

sv_status sv_planes_resize(sv_planes *p, int width_px, int height_px, size_t cap_floats) {
  if (!is_side_ok(width_px) || !is_side_ok(height_px)) return SV_E_ARG;
  if (sv_plane_floats(width_px, height_px) > cap_floats) return SV_E_RANGE;
  sv_planes_set_size(p, width_px, height_px);
  sv_planes_clear(p);
  return SV_OK;
}

void sv_planes_clear(sv_planes *p) {
  for (int k = 0; k < 3; k++) memset(p->c[k], 0, sizeof(float) * (size_t)p->stride * (size_t)p->rows_padded);
}

long sv_image_n_counted(const sv_image_u8 *im) {
  const long n = (long)im->width_px * im->height_px;
  long n_counted = 0;
  for (long i = 0; i < n && im->mask; i++) n_counted += im->mask[i] != 0;
  return im->mask ? n_counted : n;
}
