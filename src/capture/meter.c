// SPDX-License-Identifier: Apache-2.0
#include "src/capture/meter.h"

#include <math.h>
#include <string.h>

#include "src/base/mathx.h"
#include "src/image/sample.h"

#define METER_COLS 64
#define METER_ROWS 48
#define TOP        253 // of 255: clipped from here on
#define BOTTOM     2

static int luma_of(const uint8_t o[3]) { return (o[0] + 2 * o[1] + o[2]) / 4; }

// Mean over 2x2 pixels, 0 to 1.
static double block(const sv_frame *f, int x, int y) {
  int sum = 0;
  for (int k = 0; k < 4; k++) {
    uint8_t o[3];
    sv_sample(o, f, x + k % 2, y + k / 2);
    sum += o[0] + 2 * o[1] + o[2];
  }
  return sum / (16.0 * 255.0);
}

bool sv_meter_frame(const sv_frame *f, sv_meter *out) {
  memset(out, 0, sizeof *out);
  if (!sv_sample_can(f) || f->width_px < 4 || f->height_px < 4) return false;
  int n_top = 0, n_bottom = 0;
  sv_sharpness_sums *s = &out->sums;
  for (int r = 0; r < METER_ROWS; r++)
    for (int c = 0; c < METER_COLS; c++) {
      // The corner of 4x4 pixels, all over the frame.
      const int x = (int)((int64_t)c * (f->width_px - 4) / (METER_COLS - 1)),
                y = (int)((int64_t)r * (f->height_px - 4) / (METER_ROWS - 1));
      uint8_t o[3];
      sv_sample(o, f, x, y);
      const int top = sv_maxi(o[0], sv_maxi(o[1], o[2]));
      n_top += top >= TOP;
      n_bottom += top <= BOTTOM;
      out->histogram[luma_of(o) * SV_METER_BINS / 256]++;
      const double v = block(f, x, y), dx = block(f, x + 2, y) - v, dy = block(f, x, y + 2) - v;
      s->dx2 += dx * dx;
      s->dy2 += dy * dy;
      s->luma += v;
      s->n++;
    }
  out->luma = s->luma / s->n;
  out->clipped = n_top / s->n;
  out->black = n_bottom / s->n;
  if (out->luma > SV_SHARPNESS_DARK) out->sharpness = sqrt((s->dx2 + s->dy2) / s->n) / out->luma;
  return true;
}

bool sv_meter_image(const sv_image_u8 *image, sv_meter *out) {
  const sv_frame f = {.width_px = image->width_px,
                      .height_px = image->height_px,
                      .stride_bytes = image->stride_bytes,
                      .format = SV_PIX_RGB8,
                      .data = image->px};
  return sv_meter_frame(&f, out);
}

void sv_meter_sum_add(sv_meter_sum *all, const sv_meter *m) {
  all->sums.dx2 += m->sums.dx2;
  all->sums.dy2 += m->sums.dy2;
  all->sums.luma += m->sums.luma;
  all->sums.n += m->sums.n;
  all->clipped = sv_maxd(all->clipped, m->clipped);
}

sv_guidance_shot sv_meter_shot(const sv_meter_sum *all, sv_sharpness *recent, const sv_pose *rig_from_world) {
  if (!(all->sums.n > 0)) return (sv_guidance_shot){rig_from_world, 1, -1, 0};
  return (sv_guidance_shot){rig_from_world, sv_sharpness_share(recent, &all->sums),
                            all->sums.luma / all->sums.n, all->clipped};
}
