// SPDX-License-Identifier: Apache-2.0
#include "platform/sim/optics.h"

#include <string.h>

#include "src/base/mathx.h"
#include "src/image/noise.h"

#define REFERENCE_K 6500.0

sv_sim_optics_cfg sv_sim_optics_defaults(void) {
  return (sv_sim_optics_cfg){.white_k = REFERENCE_K,
                             .response = 1,
                             .auto_exposure = 1,
                             .light = 1,
                             .bracket = 1,
                             .focus_m = 4,
                             .n_samples = 16};
}

static bool has_samples(const sv_sim_optics_cfg *c) { return c->is_blurred || c->aperture_mm > 0; }

bool sv_sim_optics_is_color_known(const sv_sim_optics_cfg *c) {
  const bool has_falloff =
      c->vignetting[0] != 0 || c->vignetting[1] != 0 || c->vignetting[2] != 0 || c->is_cos4;
  return !has_falloff && c->gain == 0 && c->white_k == REFERENCE_K && c->crosstalk == 0 && c->response == 1 &&
         c->black == 0;
}

sv_status sv_sim_optics_init(sv_sim_optics *o, const sv_sim_optics_cfg *c, const uint16_t *srgb16,
                             sv_arena *arena) {
  o->is_on = !sv_sim_optics_is_color_known(c) || c->auto_exposure != 1 || c->light != 1 || c->bracket != 1 ||
             c->lock != SV_SIM_LOCK_GIVEN || c->flat > 0 || c->readout_ms > 0 || c->n_hot > 0 ||
             has_samples(c);
  o->response = c->response != 1 ? SV_TAKE(arena, uint16_t, SV_NOISE_CODE_MAX + 1) : NULL;
  if (arena->status < 0 || !arena->base || !o->response) return arena->status;
  for (int i = 0; i <= SV_NOISE_CODE_MAX; i++) {
    const double v = srgb16[i] / 65535.0;
    o->response[i] = (uint16_t)(v > 0 ? 65535 * sv_pow(v, c->response) + 0.5 : 0);
  }
  return SV_OK;
}

// --- color ---------------------------------------------------------------------------------------

// Linear sRGB of a black body of unit luminance. Chromaticity: Kim et al., US 7024034 B2, cubic in
// 1/T, 1667 to 25000 K; then the matrix of IEC 61966-2-1.
static void black_body(double t_k, double rgb[3]) {
  const double u = 1e3 / t_k, u2 = u * u, u3 = u2 * u;
  const double x = t_k < 4000 ? -0.2661239 * u3 - 0.2343589 * u2 + 0.8776956 * u + 0.179910
                              : -3.0258469 * u3 + 2.1070379 * u2 + 0.2226347 * u + 0.240390;
  const double x2 = x * x, x3 = x2 * x;
  const double y = t_k < 2222   ? -1.1063814 * x3 - 1.34811020 * x2 + 2.18555832 * x - 0.20219683
                   : t_k < 4000 ? -0.9549476 * x3 - 1.37418593 * x2 + 2.09137015 * x - 0.16748867
                                : 3.0817580 * x3 - 5.87338670 * x2 + 3.75112997 * x - 0.37001483;
  const double xyz[3] = {x / y, 1, (1 - x - y) / y};
  static const double m[9] = {3.2406, -1.5372, -0.4986, -0.9689, 1.8758, 0.0415, 0.0557, -0.2040, 1.0570};
  for (int i = 0; i < 3; i++) rgb[i] = m[3 * i] * xyz[0] + m[3 * i + 1] * xyz[1] + m[3 * i + 2] * xyz[2];
}

// A camera that is balanced to white_k under light of 6500 K: what is missing in its white is made
// up for, with green as it was.
static void white_gains(double white_k, double gain[3]) {
  double here[3], there[3];
  black_body(REFERENCE_K, here);
  black_body(white_k, there);
  for (int i = 0; i < 3; i++) gain[i] = (here[i] / there[i]) * (there[1] / here[1]);
}

void sv_sim_optics_matrix(const sv_sim_optics_cfg *c, int i_camera, double progress, float m[9]) {
  const double mired = i_camera == 2 ? 0.5 * (1 / REFERENCE_K + 1 / c->white_k) : 1 / c->white_k;
  const double light = c->auto_exposure != 1 ? sv_exp(progress * sv_log(c->auto_exposure)) : 1;
  const double share = i_camera == 1 ? 1 + c->gain : i_camera == 2 ? 1 - c->gain : 1;
  double white[3] = {1, 1, 1};
  if (i_camera > 0 && c->white_k != REFERENCE_K) white_gains(1 / mired, white);
  for (int i = 0; i < 3; i++)
    for (int k = 0; k < 3; k++) {
      const double mix = i_camera == 0 ? i == k : i == k ? 1 - 2 * c->crosstalk : c->crosstalk;
      m[3 * i + k] = (float)(c->light * light * share * white[i] * mix);
    }
}

double sv_sim_optics_exposure(const sv_sim_optics_cfg *c, int64_t slot) { return slot % 2 ? c->bracket : 1; }

float sv_sim_optics_falloff(const sv_sim_optics_cfg *c, const sv_view *v, float x, float y) {
  const float dx = x - v->cx, dy = y - v->cy, u = dx / v->fx, w = dy / v->fy;
  const float far_x = sv_maxf(v->cx, (float)v->width_px - v->cx),
              far_y = sv_maxf(v->cy, (float)v->height_px - v->cy);
  const float r2 = (dx * dx + dy * dy) / (far_x * far_x + far_y * far_y);
  float f =
      1 + r2 * ((float)c->vignetting[0] + r2 * ((float)c->vignetting[1] + r2 * (float)c->vignetting[2]));
  if (c->is_cos4) {
    float cos2 = 1 / (1 + u * u + w * w), ray[3];
    if (v->fisheye) cos2 = sv_view_ray(v, x, y, ray) && ray[2] > 0 ? ray[2] * ray[2] : 0;
    f *= cos2 * cos2;
  }
  return sv_maxf(f, 0);
}

// --- samples -------------------------------------------------------------------------------------

int sv_sim_optics_n_samples(const sv_sim_optics_cfg *c) { return has_samples(c) ? c->n_samples : 1; }

// Golden section of the plane (Roberts' R2 sequence), on a disk of equal areas.
void sv_sim_optics_sample(const sv_sim_optics_cfg *c, int i, double *late, double lens_m[2]) {
  const double a = 0.5 + 0.7548776662466927 * i, b = 0.5 + 0.5698402909980532 * i;
  const double turn = 2 * SV_PI * (a - (double)(int)a), r = sqrt(b - (double)(int)b);
  const double radius_m = c->aperture_mm > 0 ? 0.5e-3 * c->aperture_mm * r : 0;
  *late = c->is_blurred ? (i + 0.5) / c->n_samples - 0.5 : 0;
  lens_m[0] = radius_m * sv_cos(turn);
  lens_m[1] = radius_m * sv_sin(turn);
}

sv_view sv_sim_optics_through(const sv_sim_optics_cfg *c, const sv_view *v, const double lens_m[2]) {
  sv_view out = *v;
  out.t[0] -= (float)lens_m[0];
  out.t[1] -= (float)lens_m[1];
  if (v->fisheye) return out; // its rays lean
  out.cx += (float)((double)v->fx * lens_m[0] / c->focus_m);
  out.cy += (float)((double)v->fy * lens_m[1] / c->focus_m);
  return out;
}
