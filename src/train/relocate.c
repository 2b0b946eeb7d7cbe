// SPDX-License-Identifier: Apache-2.0
// Slots that became transparent move to where the picture is wrong.
#include "src/train/relocate.h"

#include "src/base/mathx.h"
#include "src/splat/constants.h"
#include "src/train/optimize.h"

#define DEAD_LOGIT -8.0f // opacity 0.0003
#define CAP_COPIES 51    // 3DGS-MCMC's limit on copies of one Gaussian at a time

static double opacity_of(const sv_trainer *t, int i) {
  return 1.0 / (1.0 + sv_exp(-(double)*sv_gaussians_at(&t->g, i, SV_ROW_LOGIT)));
}

// K = sum_j C(n,j) (-1)^(j-1) o'^j / sqrt(j): the 1-D integral of the copies' composited alpha, in
// units of one copy's scale (algorithm of 3DGS-MCMC, in its single-sum form).
void sv_relocation_split(double o, int n, double *o_new, double *scale_factor) {
  double on = 1.0 - sv_pow(1.0 - o, 1.0 / n), k = 0, binom = 1, power = 1;
  for (int j = 1; j <= n; j++) {
    binom = binom * (n - j + 1) / j;
    power *= on;
    k += (j & 1 ? binom : -binom) * power / sqrt((double)j);
  }
  *o_new = on < (double)SV_OPACITY_DEAD ? (double)SV_OPACITY_DEAD : on;
  *scale_factor = o / k;
}

// First index whose cumulative weight exceeds x.
static int draw(const double *cum, int n, double x) {
  int lo = 0, hi = n - 1;
  while (lo < hi) {
    int mid = lo + (hi - lo) / 2;
    if (cum[mid] > x) hi = mid;
    else lo = mid + 1;
  }
  return lo;
}

// Rows of v that are curvature, which halves of a Gaussian share; the rest are moments.
static int n_curvatures(const sv_trainer *t) {
  const int n = sv_train_newton_rows(t);
  return n > SV_ROW_QUAT ? t->g.n_rows : n; // of SH that are not in use yet, too
}

static void clear_moments(sv_trainer *t, int i) {
  long at = sv_gaussians_at(&t->g, i, 0) - t->g.param;
  for (int row = 0; row < t->g.n_rows; row++) t->m[at + 16 * row] = 0;
  for (int row = n_curvatures(t); row < t->g.n_rows; row++) t->v[at + 16 * row] = 0;
}

static void copy_curvature(sv_trainer *t, int to, int from) {
  long a = sv_gaussians_at(&t->g, to, 0) - t->g.param, b = sv_gaussians_at(&t->g, from, 0) - t->g.param;
  for (int row = 0; row < n_curvatures(t); row++) t->v[a + 16 * row] = t->v[b + 16 * row];
  for (int k = 0; k < 3; k++) sv_train_cross_at(t, to)[16 * k] = sv_train_cross_at(t, from)[16 * k];
}

static void copy_slot(sv_trainer *t, int to, int from) {
  float *a = sv_gaussians_at(&t->g, to, 0);
  const float *b = sv_gaussians_at(&t->g, from, 0);
  for (int row = 0; row < t->g.n_rows; row++) a[16 * row] = b[16 * row];
}

void sv_train_copy_slot(sv_trainer *t, int to, int from) {
  copy_slot(t, to, from);
  clear_moments(t, to);
  if (t->cfg.optimizer != SV_OPTIMIZER_ADAM) copy_curvature(t, to, from);
  t->err[to] = t->err[from];
}

// --- long-axis split -----------------------------------------------------------------------------

#define LONG_RATIO    1.5 // of the longest axis to the next, from which a Gaussian is cut across it
#define CUT_OFFSET    0.7 // of the halves, in standard deviations: together they have the whole's
#define CUT_SCALE     0.7 // second moment
#define CUT_OPACITY   0.8
#define COPIES_HALVES (-2) // in the place of the number of copies: cut in two

static int long_axis(const float *p) {
  const float *s = p + 16 * SV_ROW_SCALE;
  const int a = s[16] > s[0];
  return s[32] > s[16 * a] ? 2 : a;
}

static bool is_long(const float *p) {
  const float *s = p + 16 * SV_ROW_SCALE;
  const int a = long_axis(p);
  const float next = sv_maxf(s[16 * ((a + 1) % 3)], s[16 * ((a + 2) % 3)]);
  return sv_exp((double)(s[16 * a] - next)) >= LONG_RATIO;
}

static void shift_along(float *p, double deviations) {
  const int a = long_axis(p);
  double q[4], r[9];
  for (int k = 0; k < 4; k++) q[k] = (double)p[16 * (SV_ROW_QUAT + k)];
  sv_quat_to_mat(r, q);
  const double d = deviations * sv_exp((double)p[16 * (SV_ROW_SCALE + a)]);
  for (int k = 0; k < 3; k++) p[16 * k] += (float)(r[3 * k + a] * d);
}

// The first half. The second is its copy, on the other side.
static void cut(float *p, double opacity) {
  const double o = CUT_OPACITY * opacity;
  const int a = long_axis(p);
  shift_along(p, CUT_OFFSET);
  p[16 * (SV_ROW_SCALE + a)] += (float)sv_log(CUT_SCALE);
  p[16 * SV_ROW_LOGIT] = (float)sv_log(o / (1.0 - o));
}

static void move_second_half(float *p) { shift_along(p, -2.0 * CUT_OFFSET / CUT_SCALE); }

// --- relocation ----------------------------------------------------------------------------------

// Opacity and scale of the copies of one source; the copies are also spread along the source's own
// axes. Many exposures tell where the halves of a long one belong.
static void apply_split(sv_trainer *t, int i, int n) {
  double o_new, factor;
  float *p = sv_gaussians_at(&t->g, i, 0);
  if (t->cfg.relocate_share > 0 && n == 2 && is_long(p)) {
    cut(p, opacity_of(t, i));
    t->relocation.copies[i] = COPIES_HALVES;
    return;
  }
  sv_relocation_split(sv_clampf((float)opacity_of(t, i), 1e-4f, 0.9999f), n, &o_new, &factor);
  p[16 * SV_ROW_LOGIT] = (float)sv_log(o_new / (1.0 - o_new));
  for (int k = 0; k < 3; k++) p[16 * (SV_ROW_SCALE + k)] += (float)sv_log(factor);
}

// Weights of all live Gaussians: opacity x (mean error + error).
static double accumulate(sv_trainer *t, uint32_t *n_dead) {
  double mean = 0, sum = 0;
  *n_dead = 0;
  for (int i = 0; i < t->g.n; i++) mean += (double)t->err[i] / t->g.n;
  for (int i = 0; i < t->g.n; i++) {
    double o = opacity_of(t, i);
    if (o <= (double)SV_OPACITY_DEAD) (*n_dead)++;
    else sum += o * (0.1 * mean + (double)t->err[i] + 1e-12);
    t->relocation.cum[i] = sum;
    t->relocation.copies[i] = 1;
  }
  return sum;
}

static void displace(sv_trainer *t, int i) {
  float *p = sv_gaussians_at(&t->g, i, 0);
  double q[4], r[9];
  for (int k = 0; k < 4; k++) q[k] = (double)p[16 * (SV_ROW_QUAT + k)];
  sv_quat_to_mat(r, q);
  for (int j = 0; j < 3; j++) {
    double d = 0.5 * sv_exp((double)p[16 * (SV_ROW_SCALE + j)]) * (double)sv_rng_normal(&t->rng);
    for (int k = 0; k < 3; k++) p[16 * k] += (float)(r[3 * k + j] * d);
  }
}

bool sv_train_is_relocation_due(const sv_trainer *t, float progress) {
  return t->cfg.relocate_every > 0 && progress >= t->cfg.relocate_from && progress <= t->cfg.relocate_until &&
         t->step % (uint32_t)t->cfg.relocate_every == 0;
}

// Is a Gaussian too large, as seen from the camera, for the linearized projection of a fisheye
// (SV_FISHEYE_MAX_VAR)?
static bool is_too_wide(const sv_trainer *t, int i) {
  const float *p = sv_gaussians_at(&t->g, i, 0);
  const float mean[3] = {p[0], p[16], p[32]}, *s = p + 16 * SV_ROW_SCALE;
  const float size = (float)sv_exp((double)sv_maxf(s[0], sv_maxf(s[16], s[32])));
  for (int k = 0; k < t->n_views; k++) {
    const sv_view *v = &t->views[k].view;
    const float d = v->fisheye ? sv_view_distance(v, mean) : 0.0f;
    if (v->fisheye && size * size > SV_FISHEYE_MAX_VAR * (d * d)) return true;
  }
  return false;
}

// Fisheye views do not draw what is too wide for them, and so would never train it: it starts anew
// elsewhere.
static void kill_too_wide(sv_trainer *t) {
  bool has_fisheye = false;
  for (int k = 0; k < t->n_views; k++) has_fisheye |= t->views[k].view.fisheye != NULL;
  for (int i = 0; has_fisheye && i < t->g.n; i++)
    if (is_too_wide(t, i)) *sv_gaussians_at(&t->g, i, SV_ROW_LOGIT) = DEAD_LOGIT;
}

// --- the budget ----------------------------------------------------------------------------------

// What the pictures would lose without a Gaussian, about: opacity x largest area x blended error.
static double score_of(const sv_trainer *t, int i) {
  const float *s = sv_gaussians_at(&t->g, i, SV_ROW_SCALE);
  const float least = sv_minf(s[0], sv_minf(s[16], s[32]));
  return opacity_of(t, i) * sv_exp((double)(s[0] + s[16] + s[32] - least)) * (double)t->err[i];
}

// Quickselect: the k-th smallest of a, which is reordered.
static double select_least(double *a, int n, int k) {
  int lo = 0, hi = n - 1;
  while (lo < hi) {
    const double pivot = a[lo + (hi - lo) / 2];
    int i = lo, j = hi;
    while (i <= j) {
      while (a[i] < pivot) i++;
      while (a[j] > pivot) j--;
      if (i > j) break;
      const double x = a[i];
      a[i++] = a[j];
      a[j--] = x;
    }
    if (k <= j) hi = j;
    else if (k >= i) lo = i;
    else break;
  }
  return a[k];
}

// Makes a share of the Gaussians free for relocation: those that died, and of the others those that
// matter least.
static void kill_least(sv_trainer *t) {
  int n_live = 0;
  for (int i = 0; i < t->g.n; i++)
    if (opacity_of(t, i) > (double)SV_OPACITY_DEAD) t->relocation.cum[n_live++] = score_of(t, i);
  const int n = (int)(t->cfg.relocate_share * (float)t->g.n) - (t->g.n - n_live);
  if (n <= 0 || n >= n_live) return;
  const double least = select_least(t->relocation.cum, n_live, n);
  for (int i = 0; i < t->g.n; i++)
    if (score_of(t, i) < least) *sv_gaussians_at(&t->g, i, SV_ROW_LOGIT) = DEAD_LOGIT;
}

uint32_t sv_train_relocate(sv_trainer *t, float progress) {
  kill_too_wide(t);
  if (t->cfg.relocate_share > 0 && progress <= t->cfg.relocate_share_until) kill_least(t);
  uint32_t n_dead, n_done = 0;
  double sum = accumulate(t, &n_dead);
  if (!n_dead || !(sum > 0)) return 0;
  // All sources are chosen by the weights of now; then each is split once by its number of copies.
  for (int i = 0; i < t->g.n; i++) {
    t->relocation.source[i] = -1;
    if (t->relocation.cum[i] > (i ? t->relocation.cum[i - 1] : 0.0)) continue; // alive
    int src = draw(t->relocation.cum, t->g.n, (double)sv_rng_f(&t->rng) * sum);
    if (t->relocation.copies[src] >= CAP_COPIES) continue;
    t->relocation.copies[src]++;
    t->relocation.source[i] = src;
  }
  for (int i = 0; i < t->g.n; i++) {
    const int n_copies = t->relocation.copies[i];
    if (n_copies < 2) continue;
    apply_split(t, i, n_copies);
    clear_moments(t, i);
    t->err[i] /= (float)n_copies;
  }
  for (int i = 0; i < t->g.n; i++) {
    if (t->relocation.source[i] < 0) continue;
    sv_train_copy_slot(t, i, t->relocation.source[i]);
    if (SV_TRAIN_HAS(t, copy)) t->hooks->copy(t->hooked, i, t->relocation.source[i]);
    if (t->relocation.copies[t->relocation.source[i]] == COPIES_HALVES)
      move_second_half(sv_gaussians_at(&t->g, i, 0));
    else displace(t, i);
    n_done++;
  }
  t->n_relocated += n_done;
  return n_done;
}
