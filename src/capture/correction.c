// SPDX-License-Identifier: Apache-2.0
#include "src/capture/correction.h"

#include <math.h>

#include "src/base/mathx.h"

#define NO_DIFFERENCE 1e-6
#define MOST_INVERSE  32767
#define MOST_EXPOSURE 64.0 // the table's sums have room for 1,000

static bool is_identity(const double m[9]) {
  for (int i = 0; i < 9; i++)
    if (!(fabs(m[i] - (i % 4 == 0 ? 1 : 0)) < NO_DIFFERENCE)) return false;
  return true;
}

bool sv_correction_is_needed(const sv_photometry *p) {
  bool has_falloff = false;
  for (int i = 0; i < 3; i++) has_falloff |= fabs(p->falloff[i]) > NO_DIFFERENCE;
  return p->is_known && (has_falloff || !is_identity(p->color));
}

static double linear_of(double v) { return v <= 0.04045 ? v / 12.92 : sv_pow((v + 0.055) / 1.055, 2.4); }

static double display_of(double x) { return x <= 0.0031308 ? 12.92 * x : 1.055 * sv_pow(x, 1 / 2.4) - 0.055; }

uint8_t *sv_correction_display(sv_arena *arena) {
  uint8_t *d = SV_TAKE(arena, uint8_t, SV_CORRECT_CODES);
  for (int i = 0; d && i < SV_CORRECT_CODES; i++)
    d[i] = (uint8_t)(255 * display_of(i / (SV_CORRECT_CODES - 1.0)) + 0.5);
  return d;
}

void sv_correction_carve(sv_correction *c, const sv_sub_view *v, const uint8_t *display, size_t n_px,
                         sv_arena *arena) {
  *c = (sv_correction){.display = display};
  if (!sv_correction_is_needed(&v->photometric)) return;
  c->light = SV_TAKE(arena, int32_t, 9 * 256);
  c->inverse_falloff = SV_TAKE(arena, uint16_t, n_px);
}

// False: the color matrix has no inverse.
static bool fill_light(sv_correction *c, const sv_sub_view *v, double exposure) {
  double inverse[9];
  if (!sv_photometry_inverse(&v->photometric, inverse)) return false;
  for (int k = 0; k < 256; k++) {
    const double light = SV_CORRECT_ONE * linear_of(k / 255.0) / exposure;
    for (int i = 0; i < 9; i++) c->light[256 * i + k] = (int32_t)floor(light * inverse[i] + 0.5);
  }
  c->exposure = exposure;
  return true;
}

void sv_correction_expose(sv_correction *c, const sv_sub_view *v, double exposure) {
  exposure = sv_mind(sv_maxd(exposure, 1 / MOST_EXPOSURE), MOST_EXPOSURE);
  if (c->light && exposure != c->exposure) (void)fill_light(c, v, exposure);
}

sv_status sv_correction_fill(sv_correction *c, const sv_sub_view *v, const sv_remap *map) {
  const int w = map->entries ? map->width_px : v->model.width_px,
            h = map->entries ? map->height_px : v->model.height_px;
  if (!fill_light(c, v, 1)) return SV_E_RANGE;
  for (int y = 0; y < h; y++)
    for (int x = 0; x < w; x++) {
      const size_t at = (size_t)y * (size_t)w + (size_t)x;
      const sv_remap_tap *t = map->entries ? &map->entries[at] : NULL;
      const double u = t ? t->x + t->fx / 256.0 : x, l = t ? t->y + t->fy / 256.0 : y;
      const double r2 = sv_photometry_r2(&v->photometric, &v->model, u + 0.5, l + 0.5);
      const double f = sv_photometry_falloff(&v->photometric, r2);
      c->inverse_falloff[at] = (uint16_t)sv_mind(SV_CORRECT_FALLOFF / f + 0.5, MOST_INVERSE);
    }
  return SV_OK;
}
