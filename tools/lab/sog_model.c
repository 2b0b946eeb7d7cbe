// SPDX-License-Identifier: Apache-2.0
#include "tools/lab/sog_model.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/vec.h"
#include "src/format/axes.h"
#include "tools/lab/curve.h"
#include "tools/lab/kmeans.h"

#define ROUNDS      6    // of k-means
#define MAX_SHARED  2048 // sets by k-means
#define MAX_PALETTE 65536
#define PER_SET     2 // Gaussians for one set of the palette, at least

// The finest steps. They are even, so that WebP finds what neighbors and channels have in common.
#define SCALE_STEP    0.03125
#define COLOR_STEP    0.015625
#define QUAT_STEP     1     // of 255
#define POSITION_STEP 0.125 // of the smallest standard deviation, at most
#define COARSEST      3     // powers of two that the finest are raised by, at most
#define SH_COARSEST   0.25  // each further step of SH is 2^(-1/4) of the last
#define N_SH_STEPS    27
#define SH_ROUNDING   0.45 // a little towards 0, which costs the fewest bits
// All but SH is this much better than the target, where the format allows it.
#define GEOMETRY_DB 4.0
#define LIMIT_DB    2.0 // SH are at most this much worse than the rest

#define MAX_LEVEL 3
#define FINEST    0.75 // quantile of the weights from whose half on steps are the finest

// A set of its own must save this squared error for each of its bits, in squared steps of SH and of
// a Gaussian of mean weight.
#define ERROR_PER_BIT 0.008

// --- weights and levels --------------------------------------------------------------------------

// Without views: opacity by area.
static float visibility(const sog_model *m, int i) {
  const sv_gaussian *g = &m->v[i];
  float sum = 0;
  for (int v = 0; m->seen && v < m->seen->n_views; v++)
    sum += m->seen->weight[(size_t)v * (size_t)m->n + (size_t)m->index[i]];
  if (m->seen) return sum + 1e-12f;
  const float *l = g->log_scale, least = fminf(l[0], fminf(l[1], l[2]));
  return expf(l[0] + l[1] + l[2] - least) / (1.0f + expf(-g->opacity_logit)) + 1e-12f;
}

static int by_size(const void *a, const void *b) {
  const float x = *(const float *)a, y = *(const float *)b;
  return (x > y) - (x < y);
}

// The least total error for a number of bits has steps that are inverse to the square roots of the
// weights. Weights without views are too rough for that.
static int level_of(const sog_model *m, double weight) {
  int level = 0;
  while (m->seen && level < MAX_LEVEL && weight * (2 << 2 * level) < m->full_weight) level++;
  return level;
}

static bool weigh(sog_model *m) {
  float *sorted = malloc((size_t)m->n * sizeof *sorted);
  if (!sorted) return false;
  for (int i = 0; i < m->n; i++) sorted[i] = m->weight[i] = visibility(m, i);
  qsort(sorted, (size_t)m->n, sizeof *sorted, by_size);
  m->full_weight = (double)sorted[(size_t)(FINEST * (m->n - 1))];
  for (int i = 0; i < m->n; i++) m->level[i] = level_of(m, (double)m->weight[i]);
  free(sorted);
  return true;
}

// --- all but SH ----------------------------------------------------------------------------------

// Of the 24 orders and signs of its axes that describe the same Gaussian, the one nearest to no
// rotation: its quaternion has the fewest values.
static void choose_axes(sv_gaussian *g) {
  static const uint8_t order[6][3] = {{0, 1, 2}, {1, 2, 0}, {2, 0, 1}, {0, 2, 1}, {2, 1, 0}, {1, 0, 2}};
  double m[9], r[9], q[4], best = -INFINITY, sign[3] = {1, 1, 1};
  for (int k = 0; k < 4; k++) q[k] = (double)g->quat_wxyz[k];
  sv_quat_to_mat(m, q);
  const uint8_t *axis = order[0];
  for (int j = 0; j < 6; j++) {
    int weakest = 0;
    double trace = 0, hand = j < 3 ? 1 : -1, d[3];
    for (int k = 0; k < 3; k++) {
      d[k] = m[3 * k + order[j][k]];
      trace += fabs(d[k]);
      hand *= d[k] < 0 ? -1 : 1;
      if (fabs(d[k]) < fabs(d[weakest])) weakest = k;
    }
    if (hand < 0) trace -= 2 * fabs(d[weakest]);
    if (trace <= best) continue;
    best = trace;
    axis = order[j];
    for (int k = 0; k < 3; k++) sign[k] = (d[k] < 0) == (hand < 0 && k == weakest) ? 1 : -1;
  }
  float log_scale[3];
  for (int k = 0; k < 3; k++) {
    for (int row = 0; row < 3; row++) r[3 * row + k] = sign[k] * m[3 * row + axis[k]];
    log_scale[k] = g->log_scale[axis[k]];
  }
  sv_quat_from_mat(q, r);
  memcpy(g->log_scale, log_scale, sizeof log_scale);
  for (int k = 0; k < 4; k++) g->quat_wxyz[k] = (float)(q[0] < 0 ? -q[k] : q[k]);
}

static void find_ranges(sog_model *m) {
  double least = INFINITY, most = -INFINITY, bright = 0;
  lab_curve_ranges(m->v, m->n, m->lo, m->hi);
  for (int k = 0; k < 3; k++) m->unit[k] = (m->hi[k] - m->lo[k]) / 65535.0;
  for (int i = 0; i < m->n; i++)
    for (int k = 0; k < 3; k++) {
      least = fmin(least, (double)m->v[i].log_scale[k]);
      most = fmax(most, (double)m->v[i].log_scale[k]);
      bright = fmax(bright, fabs((double)m->v[i].sh[0][k]));
    }
  // Twice the step reaches down to a ten millionth of the largest scale.
  double step = SCALE_STEP * (most - least > (SOG_CODES - 2) * SCALE_STEP ? 2 : 1);
  m->scale = (sog_codebook){(ceil(most / step) - (SOG_CODES - 1)) * step, step};
  step = COLOR_STEP;
  while (step * (SOG_CODES / 2 - 1) < bright) step *= 2;
  m->color = (sog_codebook){-SOG_CODES / 2 * step, step};
}

static uint8_t byte_of(double x) { return (uint8_t)fmin(fmax(floor(x + 0.5), 0), 255); }

// The nearest code that is a multiple of 2^level.
static uint8_t code_of(const sog_codebook *c, double x, int level) {
  const double u = (x - c->first) / c->step;
  const int last = SOG_CODES - (1 << level);
  return (uint8_t)(fmin(fmax(floor(u / (1 << level) + 0.5), 0), last >> level)) << level;
}

// How many of the 16 bits of its position a Gaussian does not need.
static int spare_bits(const sog_model *m, const sv_gaussian *g, int level) {
  const float *l = g->log_scale;
  const double enough = POSITION_STEP * (1 << level) * exp((double)fminf(l[0], fminf(l[1], l[2])));
  double step = 0;
  for (int k = 0; k < 3; k++) step = fmax(step, m->unit[k] * (1 + fabs((double)g->mean[k])));
  int bits = 0;
  while (bits < 8 && step * (2 << bits) <= enough) bits++;
  return bits;
}

// w is the largest component of the rotation (choose_axes).
sog_coded sog_model_code(const sog_model *m, int i) {
  const sv_gaussian *g = &m->v[i];
  int level[SOG_N_PARTS];
  for (int p = 0; p < SOG_N_PARTS; p++) level[p] = m->level[i] + m->coarser[p];
  const int bits = spare_bits(m, g, level[SOG_POSITION]);
  const double step = QUAT_STEP * (1 << level[SOG_QUAT]);
  sog_coded c;
  for (int k = 0; k < 3; k++) {
    const double x = (double)lab_curve_log(g->mean[k]), u = m->unit[k] > 0 ? (x - m->lo[k]) / m->unit[k] : 0;
    const unsigned rounded = (unsigned)(u / (1 << bits) + 0.5) << bits;
    c.position[k] = (uint16_t)(rounded < 65535 ? rounded : 65535);
    c.quat[k] = byte_of(128 + step * floor((double)g->quat_wxyz[1 + k] * sqrt(0.5) * 255.0 / step + 0.5));
    c.scale[k] = code_of(&m->scale, (double)g->log_scale[k], level[SOG_SCALE]);
    c.color[k] = code_of(&m->color, (double)m->dc[i][k], level[SOG_COLOR]);
  }
  c.alpha = byte_of(255.0 / (1.0 + exp(-(double)g->opacity_logit)));
  return c;
}

// What a viewer reads. With the exact SH where there is no palette.
static sv_gaussian decode(const sog_model *m, int i) {
  const sog_coded c = sog_model_code(m, i);
  const double alpha = fmin(fmax(c.alpha / 255.0, 1e-6), 1 - 1e-6);
  sv_gaussian g = m->v[i];
  double rest = 1;
  for (int k = 0; k < 3; k++) {
    const double x = m->lo[k] + m->unit[k] * c.position[k], q = (c.quat[k] / 255.0 - 0.5) * sqrt(2.0);
    g.mean[k] = (float)copysign(expm1(fabs(x)), x);
    g.quat_wxyz[1 + k] = (float)q;
    rest -= q * q;
    g.log_scale[k] = (float)(m->scale.first + m->scale.step * c.scale[k]);
    g.sh[0][k] = (float)(m->color.first + m->color.step * c.color[k]);
  }
  g.quat_wxyz[0] = (float)sqrt(fmax(rest, 0));
  g.opacity_logit = (float)log(alpha / (1 - alpha));
  for (int k = 0; m->palette.n && k < 3 * m->n_rest; k++)
    g.sh[1 + k / 3][k % 3] = (float)(m->palette.step * sog_model_sh(m, m->label[i], k));
  return g;
}

static sv_status ask(const sog_model *m, sog_judge *judge, sv_gaussians *scratch, double *psnr, sv_err *err) {
  for (int i = 0; i < m->n; i++) {
    const sv_gaussian g = decode(m, i);
    sv_gaussians_put(scratch, i, &g);
  }
  return sog_judge_ask(judge, scratch, psnr, err);
}

// Raises the steps of all parts as far as the target allows, then those of each part once more.
static sv_status choose_steps(sog_model *m, sog_judge *judge, sv_gaussians *scratch, sv_err *err) {
  double psnr = -INFINITY, wanted = judge->target_db + (m->n_rest ? GEOMETRY_DB : 0);
  sv_status s = SV_OK;
  for (int coarser = COARSEST; s == SV_OK && coarser >= 0 && psnr < wanted; coarser--) {
    for (int p = 0; p < SOG_N_PARTS; p++) m->coarser[p] = coarser;
    s = ask(m, judge, scratch, &psnr, err);
  }
  // Finer SH would not show beside what the format loses in the other parts.
  if (m->n_rest) judge->target_db = fmin(judge->target_db, psnr - LIMIT_DB);
  for (int p = 0; s == SV_OK && p < SOG_N_PARTS && psnr >= wanted; p++) {
    double with;
    m->coarser[p]++;
    s = ask(m, judge, scratch, &with, err);
    if (with < wanted) m->coarser[p]--;
  }
  return s;
}

// --- SH ------------------------------------------------------------------------------------------

static int round_sh(double x, double step, int level) {
  const double size =
      fmin(floor(fabs(x) / (step * (1 << level)) + SH_ROUNDING), (SOG_CODES / 2 >> level) - 1);
  return (int)copysign(size, x) * (1 << level);
}

int sog_model_sh(const sog_model *m, int j, int c) {
  const sog_palette *p = &m->palette;
  return round_sh((double)p->set[(size_t)j * (size_t)(3 * m->n_rest) + (size_t)c], p->step, p->level[j]);
}

// Squared error of Gaussian i if its SH are rounded; *bits: about what they take.
static double own_error(const sog_model *m, int i, double step, double *bits) {
  double error = 0;
  *bits = 0;
  for (int k = 0; k < 3 * m->n_rest; k++) {
    const double x = (double)m->v[i].sh[1 + k / 3][k % 3];
    const int q = round_sh(x, step, m->level[i]), steps = abs(q) >> m->level[i];
    error += (x - step * q) * (x - step * q);
    *bits += steps ? 2.5 + 2 * log2(steps) : 0.6;
  }
  return error;
}

// The first coefficient takes the mean of what the palette changes in the colors that views see.
static void refit_color(sog_model *m, int i) {
  double sum[3] = {0}, total = 0, change[3][15];
  memcpy(m->dc[i], m->v[i].sh[0], sizeof m->dc[i]);
  if (!m->seen) return;
  for (int c = 0; c < m->n_rest; c++)
    for (int k = 0; k < 3; k++)
      change[k][c] = (double)m->v[i].sh[1 + c][k] - m->palette.step * sog_model_sh(m, m->label[i], 3 * c + k);
  for (int v = 0; v < m->seen->n_views; v++) {
    const double w = (double)m->seen->weight[(size_t)v * (size_t)m->n + (size_t)m->index[i]];
    double d[3], y[15];
    for (int k = 0; k < 3; k++) d[k] = (double)m->v[i].mean[k] - m->seen->eye[v][k];
    const double length = sv_norm3(d);
    if (!(w > 0 && length > 0)) continue;
    for (int k = 0; k < 3; k++) d[k] /= length;
    sv_sh_basis(y, d);
    for (int k = 0; k < 3; k++)
      for (int c = 0; c < m->n_rest; c++) sum[k] += w * change[k][c] * y[c];
    total += w;
  }
  for (int k = 0; total > 0 && k < 3; k++) m->dc[i][k] += (float)(sum[k] / total / SV_SH_C0);
}

// What k-means found.
typedef struct {
  float *set; // [n][3 n_rest]
  int *label; // [n of Gaussians]
  int *to;    // [n] its index in the palette, below 0: nobody's
  float *sum; // [n] of the weights of its Gaussians
  int n;
} shared_sets;

// Fills the palette for this step: Gaussians have a set of their own where that saves enough error.
static void fill_palette(sog_model *m, shared_sets *sh, double step) {
  const size_t dims = (size_t)(3 * m->n_rest);
  sog_palette *p = &m->palette;
  double mean = 0;
  for (int i = 0; i < m->n; i++) mean += (double)m->weight[i] / m->n;
  p->step = step;
  for (double least = ERROR_PER_BIT * step * step * mean;; least *= 1.5) {
    int n_own = 0;
    p->n = 0;
    memset(sh->sum, 0, (size_t)sh->n * sizeof *sh->sum);
    for (int i = 0; i < m->n; i++) {
      const float *set = sh->set + (size_t)sh->label[i] * dims;
      double bits, shared = 0;
      for (size_t k = 0; k < dims; k++) {
        const double d = (double)(m->v[i].sh[1 + k / 3][k % 3] - set[k]);
        shared += d * d;
      }
      const double own = own_error(m, i, step, &bits);
      const bool is_own = (double)m->weight[i] * (shared - own) > least * bits;
      m->label[i] = is_own ? -1 : sh->label[i];
      n_own += is_own;
      if (!is_own) sh->sum[sh->label[i]] += m->weight[i];
    }
    for (int j = 0; j < sh->n; j++) {
      sh->to[j] = sh->sum[j] > 0 ? p->n : -1;
      if (sh->to[j] < 0) continue;
      p->level[p->n] = level_of(m, (double)sh->sum[j]);
      memcpy(p->set + (size_t)p->n++ * dims, sh->set + (size_t)j * dims, dims * sizeof *p->set);
    }
    p->n_shared = p->n;
    if (p->n + n_own <= MAX_PALETTE) break;
  }
  for (int l = 0; l <= MAX_LEVEL; l++)
    for (int i = 0; i < m->n; i++) {
      if (m->level[i] != l) continue;
      if (m->label[i] >= 0) {
        m->label[i] = sh->to[m->label[i]];
        continue;
      }
      p->level[p->n] = l;
      memcpy(p->set + (size_t)p->n * dims, m->v[i].sh[1], dims * sizeof *p->set);
      m->label[i] = p->n++;
    }
  for (int i = 0; i < m->n; i++) refit_color(m, i);
}

static sv_status choose_palette(sog_model *m, shared_sets *sh, sog_judge *judge, sv_gaussians *scratch,
                                sv_err *err) {
  double best = -INFINITY, best_step = SH_COARSEST;
  for (int k = 0; k < N_SH_STEPS; k++) {
    double psnr;
    const double step = SH_COARSEST * pow(2, -k / 4.0);
    fill_palette(m, sh, step);
    const sv_status s = ask(m, judge, scratch, &psnr, err);
    if (s != SV_OK || psnr >= judge->target_db) return s;
    if (psnr <= best) continue;
    best = psnr;
    best_step = step;
  }
  fill_palette(m, sh, best_step);
  return SV_OK;
}

static sv_status share(sog_model *m, sog_judge *judge, sv_gaussians *scratch, sv_err *err) {
  const size_t n = (size_t)m->n, dims = (size_t)(3 * m->n_rest);
  int n_sets = m->n / PER_SET;
  n_sets = n_sets < 1 ? 1 : n_sets > MAX_SHARED ? MAX_SHARED : n_sets;
  const size_t cap = n + (size_t)n_sets < MAX_PALETTE ? n + (size_t)n_sets : MAX_PALETTE;
  shared_sets sh = {.set = malloc((size_t)n_sets * dims * sizeof *sh.set),
                    .label = malloc(n * sizeof *sh.label),
                    .to = malloc((size_t)n_sets * sizeof *sh.to),
                    .sum = malloc((size_t)n_sets * sizeof *sh.sum),
                    .n = n_sets};
  float *all = malloc(n * dims * sizeof *all);
  m->palette.set = malloc(cap * dims * sizeof *m->palette.set);
  m->palette.level = malloc(cap * sizeof *m->palette.level);
  sv_status s = SV_OK;
  for (size_t i = 0; all && i < n; i++) memcpy(all + i * dims, m->v[i].sh[1], dims * sizeof *all);
  const lab_points points = {all, m->weight, m->n, (int)dims, m->pool};
  if (!sh.set || !sh.label || !sh.to || !sh.sum || !all || !m->palette.set || !m->palette.level ||
      !lab_palette(&points, sh.set, n_sets, sh.label, ROUNDS))
    s = sv_fail(err, SV_E_NOMEM, "no memory for the SH of %d Gaussians", m->n);
  free(all);
  if (s == SV_OK) s = choose_palette(m, &sh, judge, scratch, err);
  free(sh.set);
  free(sh.label);
  free(sh.to);
  free(sh.sum);
  return s;
}

// --- the model -----------------------------------------------------------------------------------

// Gaussians of a level side by side, where WebP finds that they have few values. Behind them those
// whose sets are their own, which follow one another.
static bool group(sog_model *m) {
  const size_t n = (size_t)m->n;
  sog_model old = *m;
  m->v = malloc(n * sizeof *m->v);
  m->index = NULL;
  m->level = malloc(n * sizeof *m->level);
  m->label = malloc(n * sizeof *m->label);
  m->dc = malloc(n * sizeof *m->dc);
  const bool is_good = m->v && m->level && m->label && m->dc;
  for (int l = 0, k = 0; is_good && l <= MAX_LEVEL; l++)
    for (int is_own = 0; is_own < 2; is_own++)
      for (int i = 0; i < m->n; i++) {
        if (old.level[i] != l || (old.label[i] >= m->palette.n_shared) != is_own) continue;
        m->v[k] = old.v[i];
        m->level[k] = l;
        m->label[k] = old.label[i];
        memcpy(m->dc[k++], old.dc[i], sizeof *m->dc);
      }
  free(old.v);
  free(old.index);
  free(old.level);
  free(old.label);
  free(old.dc);
  return is_good;
}

sv_status sog_model_start(sog_model *m, const sv_gaussians *g, const lab_seen *seen, sog_judge *judge,
                          sv_err *err) {
  static const int rest[] = {0, 3, 8, 15};
  const size_t n = (size_t)g->n, bytes = sv_gaussians_bytes(g->n, g->sh_degree) + SV_ARENA_ALIGN;
  sv_gaussians scratch;
  m->pool = &judge->session->pool;
  m->seen = seen;
  m->n = g->n;
  m->n_rest = rest[g->sh_degree];
  m->index = malloc(n * sizeof *m->index);
  m->weight = malloc(n * sizeof *m->weight);
  m->level = malloc(n * sizeof *m->level);
  m->label = calloc(n, sizeof *m->label);
  m->dc = malloc(n * sizeof *m->dc);
  m->v = m->index ? lab_curve_order(g, m->index) : NULL;
  void *block = malloc(bytes);
  sv_status s = SV_OK;
  if (!m->v || !m->weight || !m->level || !m->label || !m->dc || !block || !weigh(m))
    s = sv_fail(err, SV_E_NOMEM, "no memory for %d Gaussians", g->n);
  if (s == SV_OK) {
    sv_arena a = sv_arena_make(block, bytes);
    s = sv_gaussians_init(&scratch, g->n, g->sh_degree, &a);
    for (int i = 0; i < m->n; i++) {
      choose_axes(&m->v[i]);
      memcpy(m->dc[i], m->v[i].sh[0], sizeof m->dc[i]);
    }
    find_ranges(m);
  }
  if (s == SV_OK) s = choose_steps(m, judge, &scratch, err);
  if (s == SV_OK && m->n_rest) s = share(m, judge, &scratch, err);
  free(block);
  if (s == SV_OK && !group(m)) s = sv_fail(err, SV_E_NOMEM, "no memory for %d Gaussians", g->n);
  return s;
}

void sog_model_stop(sog_model *m) {
  free(m->v);
  free(m->index);
  free(m->weight);
  free(m->level);
  free(m->label);
  free(m->dc);
  free(m->palette.set);
  free(m->palette.level);
}
