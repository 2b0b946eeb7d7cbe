// SPDX-License-Identifier: Apache-2.0
#include "src/image/noise.h"

#include <math.h>

#include "src/base/mathx.h"
#include "src/base/rng.h"

#define N_CODES  (SV_NOISE_CODE_MAX + 1)
#define N_RADIUS 4096
#define N_TURN   1024

static double encode(double x) { return x <= 0.0031308 ? 12.92 * x : 1.055 * sv_pow(x, 1 / 2.4) - 0.055; }
static double decode(double y) { return y <= 0.04045 ? y / 12.92 : sv_pow((y + 0.055) / 1.055, 2.4); }

static void carve(sv_noise *t, sv_arena *a) {
  t->srgb8 = SV_TAKE(a, uint8_t, N_CODES);
  t->srgb16 = SV_TAKE(a, uint16_t, N_CODES);
  t->linear8 = SV_TAKE(a, float, 256);
  t->radius = SV_TAKE(a, float, N_RADIUS);
  t->turn_cos = SV_TAKE(a, float, N_TURN);
}

size_t sv_noise_bytes(void) {
  sv_noise t;
  sv_arena dry = sv_arena_dry();
  carve(&t, &dry);
  return dry.used_bytes;
}

sv_status sv_noise_init(sv_noise *t, sv_arena *a) {
  carve(t, a);
  if (a->status < 0 || !a->base) return a->status;
  for (int i = 0; i < N_CODES; i++) {
    double y = encode((double)i / SV_NOISE_CODE_MAX);
    t->srgb8[i] = (uint8_t)(255 * y + 0.5);
    t->srgb16[i] = (uint16_t)(65535 * y + 0.5);
  }
  for (int i = 0; i < 256; i++) t->linear8[i] = (float)decode(i / 255.0);
  for (int i = 0; i < N_RADIUS; i++) t->radius[i] = (float)sqrt(-2 * sv_log((i + 0.5) / N_RADIUS));
  for (int i = 0; i < N_TURN; i++) t->turn_cos[i] = (float)sv_cos(2 * SV_PI * (i + 0.5) / N_TURN);
  return SV_OK;
}

// 12 bits of the hash choose the radius, 10 others the angle; the sine is the cosine three quarters
// of a turn further.
static float normal(const sv_noise *t, uint32_t hash, uint32_t quarter) {
  return t->radius[hash >> 20] * t->turn_cos[((hash >> 8) + quarter * (3 * N_TURN / 4)) & (N_TURN - 1)];
}

void sv_noise_add(const sv_noise *t, const sv_noise_model *m, const uint32_t key[2], uint32_t i_pixel,
                  const float in[3], float out[3]) {
  uint32_t h0 = sv_hash3(key[0], key[1], 2 * i_pixel), h1 = sv_hash3(key[0], key[1], 2 * i_pixel + 1);
  float z[3] = {normal(t, h0, 0), normal(t, h0, 1), normal(t, h1, 0)};
  for (int k = 0; k < 3; k++) out[k] = in[k] + sqrtf(m->read + m->shot * in[k]) * z[k];
}

sv_status sv_noise_u8(const sv_noise *t, const sv_noise_job *j, uint8_t *px, int n_channels, size_t n_px) {
  if (n_channels != 3 && !(n_channels == 4 && j->is_over_black)) return SV_E_ARG;
  for (size_t i = 0; i < n_px; i++, px += n_channels) {
    float x[3];
    int alpha = n_channels == 4 ? px[3] : 255;
    for (int k = 0; k < 3; k++)
      x[k] = alpha == 255 ? t->linear8[px[k]] : (float)decode(px[k] * alpha / (255.0 * 255.0));
    sv_noise_add(t, &j->model, j->key, (uint32_t)i, x, x);
    for (int k = 0; k < 3; k++) px[k] = t->srgb8[sv_noise_quantise(x[k])];
    if (n_channels == 4) px[3] = 255;
  }
  return SV_OK;
}

sv_status sv_noise_u16(const sv_noise *t, const sv_noise_job *j, uint16_t *px, int n_channels, size_t n_px) {
  if (n_channels != 3 && !(n_channels == 4 && j->is_over_black)) return SV_E_ARG;
  for (size_t i = 0; i < n_px; i++, px += n_channels) {
    float x[3];
    double alpha = n_channels == 4 ? px[3] / 65535.0 : 1;
    for (int k = 0; k < 3; k++) x[k] = (float)decode(px[k] / 65535.0 * alpha);
    sv_noise_add(t, &j->model, j->key, (uint32_t)i, x, x);
    for (int k = 0; k < 3; k++) px[k] = t->srgb16[sv_noise_quantise(x[k])];
    if (n_channels == 4) px[3] = 65535;
  }
  return SV_OK;
}
