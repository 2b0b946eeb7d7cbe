// SPDX-License-Identifier: Apache-2.0
#include "kernels/motion/motion.h"
#include "kernels/project/project.h"
#include "kernels/simd/s1_math.h"
#include "kernels/ops.h"

#define LOG2E 1.44269504f
#define TINY2 1e-12f // below this squared length nothing is left to shrink

static const float *at(const float *base, int block, int n_rows) { return base + (long)block * n_rows * 16; }
static int n_motion_rows(const sv_motion_args *a) { return SV_N_MROWS(a->n_pos, a->n_rot, a->n_colour); }

// out row i of `width`, += sum_j f_j of the coefficients, which lie [n][width][16].
static void add_functions(const float *f, const float *c, int n, int width, float *out, int k) {
  for (int i = 0; i < width; i++) {
    float s = out[16 * i + k];
    for (int j = 0; j < n; j++) s = fmaf(f[j], c[16 * (width * j + i) + k], s);
    out[16 * i + k] = s;
  }
}

void sv_motion_ref(const sv_motion_args *a, int block0, int block1) {
  for (int b = block0; b < block1; b++) {
    const float *p = at(a->param, b, a->n_rows), *m = at(a->motion, b, n_motion_rows(a));
    float *out = a->moved + (long)b * a->n_rows * 16;
    memcpy(out, p, (unsigned long)a->n_rows * 16 * sizeof *out);
    const float *pos = m + 16 * SV_MROW_FUNCTIONS, *rot = pos + 16 * 3 * a->n_pos,
                *col = rot + 16 * 4 * a->n_rot;
    for (int k = 0; k < 16; k++) {
      float d = a->t - m[16 * SV_MROW_CENTRE + k];
      float w = s1_exp2_fine(m[16 * SV_MROW_SHARPNESS + k] * LOG2E) * (d * d);
      out[16 * SV_ROW_LOGIT + k] -= s1_min(w, SV_WINDOW_MAX);
      add_functions(a->f_pos, pos, a->n_pos, 3, out + 16 * SV_ROW_MEAN, k);
      add_functions(a->f_rot, rot, a->n_rot, 4, out + 16 * SV_ROW_QUAT, k);
      add_functions(a->f_colour, col, a->n_colour, 3, out + 16 * SV_ROW_SH, k);
    }
  }
}

// Coefficients of one property and the values of its basis functions.
typedef struct {
  const float *f; // [n]
  const float *c; // [n][width][16]
  int n, width;
  float reg; // weight of the coefficients' length
} series;

static void functions_bwd(const series *s, const float *grad, float *out, int k) {
  const float *f = s->f, *c = s->c, reg = s->reg;
  const int n = s->n, width = s->width;
  float len2 = 0;
  for (int i = 0; i < n * width; i++) len2 = fmaf(c[16 * i + k], c[16 * i + k], len2);
  float pull = len2 > TINY2 ? reg / sqrtf(len2) : 0.0f;
  for (int j = 0; j < n; j++)
    for (int i = 0; i < width; i++) {
      int r = 16 * (width * j + i) + k;
      out[r] = fmaf(pull, c[r], f[j] * grad[16 * i + k]);
    }
}

void sv_motion_bwd_ref(const sv_motion_args *a, int block, uint32_t touched, const float *grad,
                       float *grad_motion) {
  const float *m = at(a->motion, block, n_motion_rows(a));
  long pos = 16 * SV_MROW_FUNCTIONS, rot = pos + 16 * 3 * a->n_pos, col = rot + 16 * 4 * a->n_rot;
  memset(grad_motion, 0, (unsigned long)n_motion_rows(a) * 16 * sizeof *grad_motion);
  for (int k = 0; k < 16; k++) {
    if (!(touched >> k & 1)) continue;
    float d = a->t - m[16 * SV_MROW_CENTRE + k];
    float e = s1_exp2_fine(m[16 * SV_MROW_SHARPNESS + k] * LOG2E), w = e * (d * d);
    float g = w < SV_WINDOW_MAX ? grad[16 * SV_ROW_LOGIT + k] : 0.0f;
    grad_motion[16 * SV_MROW_CENTRE + k] = g * (2.0f * (e * d));
    grad_motion[16 * SV_MROW_SHARPNESS + k] = -(g * w);
    functions_bwd(&(series){a->f_pos, m + pos, a->n_pos, 3, a->reg_pos}, grad + 16 * SV_ROW_MEAN,
                  grad_motion + pos, k);
    functions_bwd(&(series){a->f_rot, m + rot, a->n_rot, 4, a->reg_rot}, grad + 16 * SV_ROW_QUAT,
                  grad_motion + rot, k);
    functions_bwd(&(series){a->f_colour, m + col, a->n_colour, 3, a->reg_col}, grad + 16 * SV_ROW_SH,
                  grad_motion + col, k);
  }
}
