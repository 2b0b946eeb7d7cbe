// SPDX-License-Identifier: Apache-2.0
#include "tools/train/measured.h"

#include <math.h>

#include "src/base/mathx.h"
#include "src/train/measurement.h"

static double squares_of(const sv_trainer *t, const sv_train_measurement *m, const sv_region *r) {
  const sv_planes *p = &t->forward.predicted;
  double sum = 0;
  for (int y = r->y0; y < r->y1; y++)
    for (int x = r->x0; x < r->x1; x++)
      for (size_t k = 0; k < 3; k++) {
        const float v = p->c[k][(size_t)(y - r->y0) * (size_t)p->stride + (size_t)(x - r->x0)],
                    inside = v < 0   ? 0
                             : v > 1 ? 1
                                     : v;
        const double d =
            (double)inside - m->px[3 * ((size_t)y * (size_t)m->model.width_px + (size_t)x) + k] / 65535.0;
        sum += d * d;
      }
  return sum;
}

double lab_measured_psnr(sv_trainer *t, const sv_render_options *o) {
  double sum = 0, n = 0;
  const int side = t->cfg.region_px;
  for (int i = 0; i < t->n_measurements; i++) {
    const sv_train_measurement *m = &t->measurements[i];
    const int w = m->model.width_px, h = m->model.height_px;
    for (int y = 0; y < h; y += side)
      for (int x = 0; x < w; x += side) {
        const sv_region r = {x, y, sv_mini(x + side, w), sv_mini(y + side, h)};
        if (sv_train_predict(t, &m->model, &r, o, NULL, NULL) < 0) return NAN;
        sum += squares_of(t, m, &r);
      }
    n += 3.0 * w * h;
  }
  return n > 0 ? -10 * log10(fmax(sum / n, 1e-10)) : NAN;
}
