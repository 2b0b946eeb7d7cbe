// SPDX-License-Identifier: Apache-2.0
// `motion` on 16 Gaussians at once. motion_ref.c is the specification.
#include "kernels/motion/motion.h"
#include "kernels/simd/v16.h"
#include "kernels/project/project.h"

#define LOG2E 1.44269504f
#define TINY2 1e-12f

static inline const float *at(const float *base, int block, int n_rows) {
  return base + (long)block * n_rows * 16;
}
static inline int n_motion_rows(const sv_motion_args *a) {
  return SV_N_MROWS(a->n_pos, a->n_rot, a->n_colour);
}

static inline void add_functions(const float *f, const float *c, int n, int width, const float *in,
                                 float *out) {
  for (int i = 0; i < width; i++) {
    v16 s = v16_load(in + 16 * i);
    for (int j = 0; j < n; j++) s = v16_fma(v16_set1(f[j]), v16_load(c + 16 * (width * j + i)), s);
    v16_store(out + 16 * i, s);
  }
}

void V(sv_motion)(const sv_motion_args *a, int block0, int block1) {
  for (int b = block0; b < block1; b++) {
    const float *p = at(a->param, b, a->n_rows), *m = at(a->motion, b, n_motion_rows(a));
    float *out = a->moved + (long)b * a->n_rows * 16;
    const float *pos = m + 16 * SV_MROW_FUNCTIONS, *rot = pos + 16 * 3 * a->n_pos,
                *col = rot + 16 * 4 * a->n_rot;
    v16 d = v16_sub(v16_set1(a->t), v16_load(m + 16 * SV_MROW_CENTRE));
    v16 e = v16_exp2_fine(v16_mul(v16_load(m + 16 * SV_MROW_SHARPNESS), v16_set1(LOG2E)));
    v16 w = v16_min(v16_mul(e, v16_mul(d, d)), v16_set1(SV_WINDOW_MAX));
    add_functions(a->f_pos, pos, a->n_pos, 3, p + 16 * SV_ROW_MEAN, out + 16 * SV_ROW_MEAN);
    add_functions(a->f_rot, rot, a->n_rot, 4, p + 16 * SV_ROW_QUAT, out + 16 * SV_ROW_QUAT);
    for (int r = SV_ROW_SCALE; r < SV_ROW_LOGIT; r++) v16_store(out + 16 * r, v16_load(p + 16 * r));
    v16_store(out + 16 * SV_ROW_LOGIT, v16_sub(v16_load(p + 16 * SV_ROW_LOGIT), w));
    add_functions(a->f_colour, col, a->n_colour, 3, p + 16 * SV_ROW_SH, out + 16 * SV_ROW_SH);
    for (int r = SV_ROW_SH + 3; r < a->n_rows; r++) v16_store(out + 16 * r, v16_load(p + 16 * r));
  }
}

// Coefficients of one property and the values of its basis functions.
typedef struct {
  const float *f; // [n]
  const float *c; // [n][width][16]
  int n, width;
  float reg; // weight of the coefficients' length
} series;

static inline void functions_bwd(const series *s, v16m on, const float *grad, float *out) {
  const float *f = s->f, *c = s->c, reg = s->reg;
  const int n = s->n, width = s->width;
  v16 len2 = v16_zero();
  for (int i = 0; i < n * width; i++) len2 = v16_fma(v16_load(c + 16 * i), v16_load(c + 16 * i), len2);
  v16m is_any = v16_gt(len2, v16_set1(TINY2));
  v16 pull = v16_keep(is_any, v16_div(v16_set1(reg), v16_sqrt(v16_sel(is_any, len2, v16_set1(1.0f)))));
  for (int j = 0; j < n; j++)
    for (int i = 0; i < width; i++) {
      int r = 16 * (width * j + i);
      v16 g = v16_mul(v16_set1(f[j]), v16_load(grad + 16 * i));
      v16_store(out + r, v16_keep(on, v16_fma(pull, v16_load(c + r), g)));
    }
}

void V(sv_motion_bwd)(const sv_motion_args *a, int block, uint32_t touched, const float *grad,
                      float *grad_motion) {
  const float *m = at(a->motion, block, n_motion_rows(a));
  long pos = 16 * SV_MROW_FUNCTIONS, rot = pos + 16 * 3 * a->n_pos, col = rot + 16 * 4 * a->n_rot;
  v16m on = v16m_from_bits(touched);
  v16 d = v16_sub(v16_set1(a->t), v16_load(m + 16 * SV_MROW_CENTRE));
  v16 e = v16_exp2_fine(v16_mul(v16_load(m + 16 * SV_MROW_SHARPNESS), v16_set1(LOG2E)));
  v16 w = v16_mul(e, v16_mul(d, d));
  v16 g = v16_keep(v16_lt(w, v16_set1(SV_WINDOW_MAX)), v16_load(grad + 16 * SV_ROW_LOGIT));
  v16 centre = v16_mul(g, v16_mul(v16_set1(2.0f), v16_mul(e, d)));
  v16_store(grad_motion + 16 * SV_MROW_CENTRE, v16_keep(on, centre));
  v16_store(grad_motion + 16 * SV_MROW_SHARPNESS, v16_keep(on, v16_neg(v16_mul(g, w))));
  functions_bwd(&(series){a->f_pos, m + pos, a->n_pos, 3, a->reg_pos}, on, grad + 16 * SV_ROW_MEAN,
                grad_motion + pos);
  functions_bwd(&(series){a->f_rot, m + rot, a->n_rot, 4, a->reg_rot}, on, grad + 16 * SV_ROW_QUAT,
                grad_motion + rot);
  functions_bwd(&(series){a->f_colour, m + col, a->n_colour, 3, a->reg_col}, on, grad + 16 * SV_ROW_SH,
                grad_motion + col);
}
