// SPDX-License-Identifier: Apache-2.0
// The white squares of chessboards as a measure of light. In one frame the board's light is a plane
// over the board, the same for all cameras; in logarithms, channel by channel, all is linear:
//   log y = a + b s + c t (of the frame) + g (of the camera) + f1 q + f2 q^2 + f3 q^3 (of its lens)
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/cholesky.h"
#include "src/base/mathx.h"
#include "tools/calibrate/photometry.h"

#define CAP_UNKNOWNS 2048
#define N_ROUNDS     4
#define SPREAD       0.05 // of logarithms: from here on residuals count less
#define INSIDE       0.25 // half the side of the part of a square that is averaged
#define MIN_SQUARES  30
#define RIDGE        1e-9
#define UNKNOWN      0.05 // of the light at the corner: a falloff that is less certain is left out

// --- what is seen --------------------------------------------------------------------------------

static const double *corner_of(const cal_boards *b, int c, int f, int x, int y) {
  const size_t board = (size_t)c * (size_t)b->n_frames + (size_t)f;
  return b->uv_px + 2 * ((board * (size_t)b->n_rows + (size_t)y) * (size_t)b->n_cols + (size_t)x);
}

// Mean light of the middle of a square; false where it is too small, dark or saturated.
static bool measure(const sv_bitmap *im, const double *at[4], cal_square *out, bool *is_saturated) {
  double side = 1e9, sum[3] = {0}, n = 0;
  for (int k = 0; k < 2; k++) out->uv_px[k] = (at[0][k] + at[1][k] + at[2][k] + at[3][k]) / 4;
  for (int i = 0; i < 4; i++) side = sv_mind(side, hypot(at[i][0] - out->uv_px[0], at[i][1] - out->uv_px[1]));
  const double half = INSIDE * side;
  const int x0 = (int)ceil(out->uv_px[0] - half), x1 = (int)floor(out->uv_px[0] + half),
            y0 = (int)ceil(out->uv_px[1] - half), y1 = (int)floor(out->uv_px[1] + half);
  for (int y = y0; y <= y1; y++)
    for (int x = x0; x <= x1; x++) {
      if (x < 0 || y < 0 || x >= im->width_px || y >= im->height_px) return false;
      const uint8_t *px = im->u8 + 3 * ((size_t)y * (size_t)im->width_px + (size_t)x);
      for (int k = 0; k < 3; k++) {
        *is_saturated |= px[k] > CAL_BRIGHT;
        if (px[k] < CAL_DARK || px[k] > CAL_BRIGHT) return false;
        sum[k] += cal_linear_of(px[k] / 255.0);
      }
      n++;
    }
  for (int k = 0; k < 3 && n > 0; k++) out->light[k] = sum[k] / n;
  return n > 0;
}

static bool push(cal_squares *s, const cal_square *q) {
  if (s->n == s->cap) {
    const int cap = s->cap ? 2 * s->cap : 1024;
    cal_square *more = realloc(s->all, (size_t)cap * sizeof *more);
    if (!more) return false;
    s->all = more;
    s->cap = cap;
  }
  s->all[s->n++] = *q;
  return true;
}

// Squares of one color alternate; the brighter ones are white. Black ones leave again.
static void keep_white(cal_squares *s, int from, int n_cols) {
  double sum[2] = {0}, n[2] = {0};
  for (int i = from; i < s->n; i++) {
    const int k = (s->all[i].i_square % n_cols + s->all[i].i_square / n_cols) & 1;
    sum[k] += s->all[i].light[1];
    n[k]++;
  }
  const int white = !n[0] ? 1 : !n[1] ? 0 : sum[1] / n[1] > sum[0] / n[0];
  int kept = from;
  for (int i = from; i < s->n; i++)
    if (((s->all[i].i_square % n_cols + s->all[i].i_square / n_cols) & 1) == white)
      s->all[kept++] = s->all[i];
  s->n = kept;
}

static sv_status read_picture(cal_squares *s, const cal_boards *b, int c, int f, sv_err *err) {
  sv_bitmap im = {0};
  const int from = s->n, n_cols = b->n_cols - 1, n_rows = b->n_rows - 1;
  sv_status r = cal_picture_read(cal_picture_of(b, c, f), &im, err);
  for (int i = 0; i < n_cols * n_rows && r == SV_OK; i++) {
    const int x = i % n_cols, y = i / n_cols;
    const double *at[4];
    cal_square q = {.i_sub = c,
                    .i_frame = f,
                    .i_square = i,
                    .board = {(2 * x + 1.0) / n_cols - 1, (2 * y + 1.0) / n_rows - 1}};
    for (int k = 0; k < 4; k++) at[k] = corner_of(b, c, f, x + (k & 1), y + (k >> 1));
    bool is_saturated = false;
    if (measure(&im, at, &q, &is_saturated) && !push(s, &q))
      r = sv_fail(err, SV_E_NOMEM, "no memory for squares");
    s->n_saturated[c] += is_saturated;
  }
  if (r == SV_OK) keep_white(s, from, n_cols);
  sv_bitmap_free(&im);
  return r;
}

sv_status cal_squares_read(cal_squares *s, const sv_rig *rig, const cal_boards *b, sv_err *err) {
  sv_status r = SV_OK;
  for (int f = 0; f < b->n_frames; f++)
    for (int c = 0; c < rig->n_sub_views && r == SV_OK; c++)
      if (b->is_seen[c * b->n_frames + f]) r = read_picture(s, b, c, f, err);
  return r;
}

void cal_squares_free(cal_squares *s) {
  free(s->all);
  *s = (cal_squares){0};
}

// --- comparison ----------------------------------------------------------------------------------

static int by_value(const void *a, const void *b) {
  const double x = *(const double *)a, y = *(const double *)b;
  return (x > y) - (x < y);
}

// What the reference would have shown.
static bool corrected(const cal_square *q, const sv_sub_view *v, double out[3]) {
  double inverse[9];
  memcpy(out, q->light, sizeof q->light);
  if (!v->photometric.is_known) return true;
  if (!sv_photometry_inverse(&v->photometric, inverse)) return false;
  const double r2 = sv_photometry_r2(&v->photometric, &v->model, q->uv_px[0] + 0.5, q->uv_px[1] + 0.5);
  sv_apply33(out, inverse, q->light);
  for (int k = 0; k < 3; k++) out[k] /= sv_photometry_falloff(&v->photometric, r2);
  return true;
}

static const cal_square *same_square(const cal_squares *s, const cal_square *q) {
  for (int i = 0; i < s->n; i++)
    if (s->all[i].i_sub == 0 && s->all[i].i_frame == q->i_frame && s->all[i].i_square == q->i_square)
      return &s->all[i];
  return NULL;
}

int cal_squares_compare(const cal_squares *s, const sv_rig *rig, int i_sub, double ratio[3]) {
  double *all = calloc((size_t)s->n + 1, 3 * sizeof *all), a[3], b[3];
  int n = 0;
  for (int i = 0; i < s->n && all; i++) {
    const cal_square *q = &s->all[i], *first = q->i_sub == i_sub ? same_square(s, q) : NULL;
    if (!first || !corrected(q, &rig->sub_views[i_sub], a) || !corrected(first, &rig->sub_views[0], b))
      continue;
    for (int k = 0; k < 3; k++) all[k * s->n + n] = a[k] / b[k];
    n++;
  }
  for (int k = 0; k < 3 && n; k++) {
    qsort(all + k * s->n, (size_t)n, sizeof *all, by_value);
    ratio[k] = all[k * s->n + n / 2];
  }
  free(all);
  return n;
}

// --- the system of one channel -------------------------------------------------------------------

typedef struct {
  const cal_squares *s;
  const sv_rig *rig;
  int n, n_sub, n_frames; // n: unknowns; those of frames first
  int *frame_of;          // [frames of the boards] -> place among those with squares, -1
  double *a, *b, *x;
  bool has_falloff;
  sv_photometry none[SV_CAP_SUB_VIEWS];
} problem;

typedef struct {
  int i[7];
  double h[7];
} row;

static row row_of(const problem *p, const cal_square *q) {
  const sv_sub_view *v = &p->rig->sub_views[q->i_sub];
  const double r2 = sv_photometry_r2(&p->none[q->i_sub], &v->model, q->uv_px[0] + 0.5, q->uv_px[1] + 0.5);
  const int f = 3 * p->frame_of[q->i_frame], c = 3 * p->n_frames + 4 * q->i_sub;
  return (row){{f, f + 1, f + 2, c, c + 1, c + 2, c + 3},
               {1, q->board[0], q->board[1], 1, r2, r2 * r2, r2 * r2 * r2}};
}

static double residual(const problem *p, const row *r, double y) {
  for (int i = 0; i < 7; i++) y -= r->h[i] * p->x[r->i[i]];
  return y;
}

// Returns the variance of a square's logarithm; NAN: not solvable. p->a is then the factor.
static double solve_channel(problem *p, int k) {
  double variance = NAN;
  memset(p->x, 0, (size_t)p->n * sizeof *p->x);
  for (int round = 0; round < N_ROUNDS; round++) {
    double sum2 = 0, sum = 0;
    memset(p->a, 0, (size_t)p->n * (size_t)p->n * sizeof *p->a);
    memset(p->b, 0, (size_t)p->n * sizeof *p->b);
    for (int i = 0; i < p->s->n; i++) {
      const row r = row_of(p, &p->s->all[i]);
      const double y = log(p->s->all[i].light[k]), e = round ? residual(p, &r, y) : 0,
                   w = 1 / (1 + e * e / (SPREAD * SPREAD));
      sum2 += w * e * e;
      sum += w;
      for (int m = 0; m < 7; m++) {
        p->b[r.i[m]] += w * r.h[m] * y;
        for (int l = 0; l < 7; l++) p->a[r.i[m] * p->n + r.i[l]] += w * r.h[m] * r.h[l];
      }
    }
    for (int i = 0; i < p->n; i++) p->a[i * p->n + i] += RIDGE * p->s->n;
    for (int c = 0; c < p->n_sub && !p->has_falloff; c++)
      for (int m = 1; m < 4; m++) p->a[(3 * p->n_frames + 4 * c + m) * (p->n + 1)] += 1e6 * p->s->n;
    p->a[3 * p->n_frames * (p->n + 1)] += 1e6 * p->s->n; // the gain of the reference is 1
    if (!sv_cholesky(p->a, p->n)) return NAN;
    memcpy(p->x, p->b, (size_t)p->n * sizeof *p->x);
    sv_cholesky_solve(p->a, p->n, p->x);
    variance = sum2 / sv_maxd(sum - p->n, 1);
  }
  return variance;
}

// Variance of a sum of n unknowns from `from` on.
static double variance_of(problem *p, int from, int n, double variance) {
  double sum = 0;
  memset(p->b, 0, (size_t)p->n * sizeof *p->b);
  for (int i = 0; i < n; i++) p->b[from + i] = 1;
  sv_cholesky_solve(p->a, p->n, p->b);
  for (int i = 0; i < n; i++) sum += p->b[from + i];
  return variance * sum;
}

// Of logarithms f1 q + f2 q^2 + f3 q^3.
static void falloff_of(const double f[3], double k[3]) {
  double light[3];
  for (int i = 0; i < 3; i++) {
    const double q = (i + 1) / 3.0;
    light[i] = exp(q * (f[0] + q * (f[1] + q * f[2])));
  }
  sv_photometry_fit(light, k);
}

static bool solve(problem *p, cal_photometry *out) {
  double f[SV_CAP_SUB_VIEWS][3] = {{0}};
  for (int c = 0; c < p->n_sub; c++) out[c] = (cal_photometry){.found = p->none[c]};
  for (int k = 0; k < 3; k++) {
    const double variance = solve_channel(p, k);
    if (!(variance >= 0)) return false;
    for (int c = 0; c < p->n_sub; c++) {
      const int at = 3 * p->n_frames + 4 * c;
      sv_photometry *o = &out[c].found;
      out[c].rms = sv_maxd(out[c].rms, sqrt(variance));
      for (int m = 0; m < 3; m++) f[c][m] += p->x[at + 1 + m] / 3;
      o->falloff_sigma = sv_maxd(o->falloff_sigma, sqrt(variance_of(p, at + 1, 3, variance)));
      if (c == 0) continue;
      o->color[4 * k] = exp(p->x[at]);
      o->color_sigma[k] = sqrt(variance_of(p, at, 1, variance));
    }
  }
  for (int c = 0; c < p->n_sub; c++) falloff_of(f[c], out[c].found.falloff);
  return true;
}

static bool is_certain(const cal_photometry *out, int n) {
  for (int c = 0; c < n; c++)
    if (!(out[c].found.falloff_sigma < UNKNOWN) || !sv_photometry_has_light(&out[c].found)) return false;
  return true;
}

static sv_status solve_all(problem *p, cal_photometry *out, sv_err *err) {
  int n_seen[SV_CAP_SUB_VIEWS] = {0};
  for (int i = 0; i < p->s->n; i++) n_seen[p->s->all[i].i_sub]++;
  for (int c = 0; c < p->n_sub; c++)
    if (n_seen[c] < MIN_SQUARES)
      return sv_fail(
          err, SV_E_NOT_FOUND,
          "%s shows %d white squares that are neither dark nor saturated, at least %d are needed; %d are "
          "saturated",
          p->rig->sub_views[c].name, n_seen[c], MIN_SQUARES, p->s->n_saturated[c]);
  p->has_falloff = true;
  bool is_solved = solve(p, out) && is_certain(out, p->n_sub);
  p->has_falloff = is_solved;
  if (!is_solved && !solve(p, out))
    return sv_fail(err, SV_E_RANGE, "the boards do not link all cameras: hold them where all see them");
  for (int c = 0; c < p->n_sub; c++) {
    out[c].n_pictures = p->n_frames;
    if (!p->has_falloff) out[c].found.falloff_sigma = 1; // not known
  }
  return SV_OK;
}

sv_status cal_squares_solve(const cal_squares *s, const sv_rig *rig, cal_photometry *out, sv_err *err) {
  problem p = {.s = s, .rig = rig, .n_sub = rig->n_sub_views};
  int n_frames = 0;
  for (int i = 0; i < s->n; i++)
    if (s->all[i].i_frame >= n_frames) n_frames = s->all[i].i_frame + 1;
  p.frame_of = calloc((size_t)n_frames + 1, sizeof *p.frame_of);
  if (!p.frame_of) return sv_fail(err, SV_E_NOMEM, "no memory for squares");
  for (int f = 0; f < n_frames; f++) p.frame_of[f] = -1;
  for (int i = 0; i < s->n; i++) // squares are in the order of frames
    if (p.frame_of[s->all[i].i_frame] < 0) p.frame_of[s->all[i].i_frame] = p.n_frames++;
  for (int c = 0; c < p.n_sub; c++) p.none[c] = sv_photometry_none(&rig->sub_views[c].model);
  p.n = 3 * p.n_frames + 4 * p.n_sub;
  const size_t n = (size_t)p.n;
  sv_status r = p.n <= CAP_UNKNOWNS ? SV_OK
                                    : sv_fail(err, SV_E_UNSUPPORTED, "%d boards; at most %d can be solved",
                                              p.n_frames, (CAP_UNKNOWNS - 4 * p.n_sub) / 3);
  if (r == SV_OK) {
    p.a = calloc(n * n, sizeof *p.a);
    p.b = calloc(n, sizeof *p.b);
    p.x = calloc(n, sizeof *p.x);
    r = p.a && p.b && p.x ? solve_all(&p, out, err) : sv_fail(err, SV_E_NOMEM, "no memory for squares");
  }
  free(p.frame_of);
  free(p.a);
  free(p.b);
  free(p.x);
  return r;
}
