// SPDX-License-Identifier: Apache-2.0
#include "src/format/splat_file.h"

#include <math.h>

#include "src/base/mathx.h"
#include "src/format/bytes.h"

static uint8_t to_byte(double x) { // [0,255], rounded; NaN becomes 0
  return x > 255 ? 255 : x > 0 ? (uint8_t)(x + 0.5) : 0;
}

static double sigmoid(double x) { return 1 / (1 + sv_exp(-x)); }

void sv_splat_encode(const sv_gaussian *g, uint8_t out[SV_SPLAT_BYTES]) {
  for (int i = 0; i < 3; i++) {
    sv_put_lef32(out + 4 * i, g->mean[i]);
    sv_put_lef32(out + 12 + 4 * i, (float)sv_exp((double)g->log_scale[i]));
    out[24 + i] = to_byte((0.5 + SV_SH_C0 * (double)g->sh[0][i]) * 255);
  }
  out[27] = to_byte(sigmoid((double)g->opacity_logit) * 255);
  double n = 0;
  for (int i = 0; i < 4; i++) n += (double)g->quat_wxyz[i] * (double)g->quat_wxyz[i];
  n = n > 0 ? sqrt(n) : 1;
  for (int i = 0; i < 4; i++) out[28 + i] = to_byte((double)g->quat_wxyz[i] / n * 128 + 128);
}

float sv_splat_order(const sv_gaussian *g) {
  double s = (double)g->log_scale[0] + (double)g->log_scale[1] + (double)g->log_scale[2];
  return (float)(sv_exp(s) * sigmoid((double)g->opacity_logit));
}

void sv_splat_decode(const uint8_t in[SV_SPLAT_BYTES], sv_gaussian *g) {
  *g = (sv_gaussian){0};
  for (int i = 0; i < 3; i++) {
    double s = (double)sv_lef32(in + 12 + 4 * i);
    g->mean[i] = sv_lef32(in + 4 * i);
    g->log_scale[i] = s > 1e-13 ? (float)sv_log(s) : -30.0f;
    g->sh[0][i] = (float)((in[24 + i] / 255.0 - 0.5) / SV_SH_C0);
  }
  double a = in[27] / 255.0;
  a = a > 1 - 1e-6 ? 1 - 1e-6 : a > 1e-6 ? a : 1e-6;
  g->opacity_logit = (float)sv_log(a / (1 - a));
  for (int i = 0; i < 4; i++) g->quat_wxyz[i] = (float)((in[28 + i] - 128) / 128.0);
}
