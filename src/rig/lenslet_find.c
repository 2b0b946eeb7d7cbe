// SPDX-License-Identifier: Apache-2.0
// The lattice of a white image: coarse lattice, then a robust affine fit to measured centres. Sums
// only: no list of centres is kept, so memory does not grow with the sensor.
#include <math.h>

#include "src/base/mathx.h"
#include "src/rig/lenslet_lattice.h"

// radius of the window around a centre, in pitches: the dark gaps on all sides are in it
#define REACH 0.75

size_t sv_lenslet_find_bytes(void) { return sv_lenslet_coarse_bytes(); }

// Vignetting over the sensor: c . (1, x, y, x^2, x y, y^2) with x, y in units of
// `unit_px` from the middle. Its slope pulls every measured centre towards the brighter side, which
// would change the scale of the lattice.
typedef struct {
  double c[6], middle[2], unit_px;
} field;

static void field_terms(const field *f, double x, double y, double t[6]) {
  double a = (x - f->middle[0]) / f->unit_px, b = (y - f->middle[1]) / f->unit_px;
  t[0] = 1;
  t[1] = a;
  t[2] = b;
  t[3] = a * a;
  t[4] = a * b;
  t[5] = b * b;
}

// Relative slope of the brightness, per px.
static void field_slope(const field *f, double x, double y, double slope[2]) {
  double t[6], v = 0;
  field_terms(f, x, y, t);
  for (int k = 0; k < 6; k++) v += f->c[k] * t[k];
  if (!(v > 0)) v = 1e30;
  slope[0] = (f->c[1] + 2 * f->c[3] * t[1] + f->c[4] * t[2]) / (v * f->unit_px);
  slope[1] = (f->c[2] + 2 * f->c[5] * t[2] + f->c[4] * t[1]) / (v * f->unit_px);
}

// Gradient and curvature of the image smoothed with (1 - r^2/R^2)^3 about c. The response to a
// constant is subtracted, because the window does not sum to exactly zero on few pixels.
typedef struct {
  double mean, gx, gy, hxx, hxy, hyy;
} bump;

static bump measure(const sv_raw *white, const field *f, double cx, double cy, double radius) {
  double slope[2];
  field_slope(f, cx, cy, slope);
  double n = 0, sum = 0, inv = 1 / (radius * radius), v[5] = {0}, one[5] = {0};
  int x0 = (int)floor(cx - radius), x1 = (int)floor(cx + radius);
  int y0 = (int)floor(cy - radius), y1 = (int)floor(cy + radius);
  for (int y = y0; y <= y1; y++)
    for (int x = x0; x <= x1; x++) {
      double dx = x + 0.5 - cx, dy = y + 0.5 - cy, q = 1 - (dx * dx + dy * dy) * inv;
      if (q <= 0) continue;
      double i = (double)sv_raw_at(white, x, y, 0) * (1 - slope[0] * dx - slope[1] * dy), w = 6 * inv * q * q,
             c = 24 * inv * inv * q;
      double t[5] = {w * dx, w * dy, c * dx * dx - w, c * dx * dy, c * dy * dy - w};
      n += 1;
      sum += i;
      for (int k = 0; k < 5; k++) {
        v[k] += i * t[k];
        one[k] += t[k];
      }
    }
  bump b = {.mean = n > 0 ? sum / n : 0};
  for (int k = 0; k < 5; k++) v[k] -= b.mean * one[k];
  b.gx = v[0];
  b.gy = v[1];
  b.hxx = v[2];
  b.hxy = v[3];
  b.hyy = v[4];
  return b;
}

// Moves (x, y) to the lenslet's centre. False where there is none: dead, or darker in the middle.
static bool centre_of(const sv_raw *white, const field *f, double pitch, int n_steps, double at[2],
                      double *light) {
  double x = at[0], y = at[1], radius = REACH * pitch, mean = 0;
  for (int k = 0; k < n_steps; k++) {
    bump b = measure(white, f, x, y, radius);
    double det = b.hxx * b.hyy - b.hxy * b.hxy;
    // Curvatures of a lit lenslet are about -10 means; dead ones have a positive or no curvature.
    double least = -0.5 * b.mean;
    mean = b.mean;
    if (!(det > 0) || b.hxx > least || b.hyy > least) return false;
    double dx = -(b.hyy * b.gx - b.hxy * b.gy) / det, dy = -(b.hxx * b.gy - b.hxy * b.gx) / det;
    if (dx * dx + dy * dy > 0.16 * pitch * pitch) return false;
    x += dx;
    y += dy;
  }
  double ex = x - at[0], ey = y - at[1];
  *light = mean;
  at[0] = x;
  at[1] = y;
  return ex * ex + ey * ey < 0.16 * pitch * pitch;
}

// Weighted sums over lenslets of [1 p j]^T [1 p j] and of [1 p j] (x, y), p = i + h.
typedef struct {
  double n[6], x[3], y[3]; // n: 11 1p 1j pp pj jj
  double weight, square;
  int n_seen, n_used;
  double light[6][7]; // normal equations of the field, right-hand side last
} sums;

static void add(sums *s, double w, double p, double j, const double at[2]) {
  double d[3] = {1, p, j};
  for (int a = 0, k = 0; a < 3; a++) {
    for (int b = a; b < 3; b++, k++) s->n[k] += w * d[a] * d[b];
    s->x[a] += w * d[a] * at[0];
    s->y[a] += w * d[a] * at[1];
  }
}

// One pass over the lenslets at most `reach` lattice steps from (0, 0); scale_px: expected error.
static void collect(const sv_lenslet_grid *g, const sv_raw *white, const field *f, int reach, double scale_px,
                    sums *s) {
  // The window may move by 0.4 pitch and must stay inside the image.
  double pitch = g->pitch_px, edge = (REACH + 0.4) * pitch + 1, cut = 4 * scale_px;
  // Predictions far from the start come from many centres: one Newton step then ends well inside a
  // hundredth of a pixel.
  int n_steps = reach > 12 ? 1 : 2;
  *s = (sums){.weight = 0};
  for (int j = -reach; j <= reach; j++)
    for (int i = -reach; i <= reach; i++) {
      double want[2], at[2], light, terms[6];
      sv_lenslet_centre(g, i, j, want);
      if (!(want[0] > edge && want[0] < white->width_px - edge && want[1] > edge &&
            want[1] < white->height_px - edge))
        continue;
      s->n_seen++;
      at[0] = want[0];
      at[1] = want[1];
      if (!centre_of(white, f, pitch, n_steps, at, &light)) continue;
      double ex = at[0] - want[0], ey = at[1] - want[1], e2 = ex * ex + ey * ey;
      if (e2 >= cut * cut) continue;
      double t = 1 - e2 / (cut * cut), w = t * t; // Tukey's biweight
      add(s, w, i + (g->is_hexagonal && (j & 1) ? 0.5 : 0.0), j, at);
      field_terms(f, at[0], at[1], terms);
      for (int a = 0; a < 6; a++) {
        for (int b = 0; b < 6; b++) s->light[a][b] += w * terms[a] * terms[b];
        s->light[a][6] += w * terms[a] * light;
      }
      s->weight += w;
      s->square += w * e2;
      s->n_used++;
    }
}

// Solves the 3x3 normal equations for offset, col and row. False when the lenslets lie on one line.
static bool solve(const sums *s, sv_lenslet_grid *g) {
  const double *n = s->n;
  double c0 = n[3] * n[5] - n[4] * n[4], c1 = n[2] * n[4] - n[1] * n[5], c2 = n[1] * n[4] - n[2] * n[3];
  double c3 = n[0] * n[5] - n[2] * n[2], c4 = n[1] * n[2] - n[0] * n[4], c5 = n[0] * n[3] - n[1] * n[1];
  double det = n[0] * c0 + n[1] * c1 + n[2] * c2;
  if (!(det > 1e-6 * s->weight * s->weight * s->weight)) return false;
  for (int k = 0; k < 2; k++) {
    const double *b = k ? s->y : s->x;
    g->offset_px[k] = (c0 * b[0] + c1 * b[1] + c2 * b[2]) / det;
    g->col_px[k] = (c1 * b[0] + c3 * b[1] + c4 * b[2]) / det;
    g->row_px[k] = (c2 * b[0] + c4 * b[1] + c5 * b[2]) / det;
  }
  return true;
}

// Elimination with pivoting. With too few lenslets for six terms the field stays unchanged.
static void fit_field(sums *s, field *f) {
  double(*m)[7] = s->light;
  for (int c = 0; c < 6; c++) {
    int best = c;
    for (int r = c + 1; r < 6; r++)
      if (fabs(m[r][c]) > fabs(m[best][c])) best = r;
    if (!(fabs(m[best][c]) > 1e-9 * s->weight)) return;
    for (int k = 0; k < 7; k++) {
      double t = m[c][k];
      m[c][k] = m[best][k];
      m[best][k] = t;
    }
    for (int r = 0; r < 6; r++) {
      double share = r == c ? 0 : m[r][c] / m[c][c];
      for (int k = c; k < 7; k++) m[r][k] -= share * m[c][k];
    }
  }
  for (int c = 0; c < 6; c++) f->c[c] = m[c][6] / m[c][c];
}

// The region doubles; each fit predicts the centres of the next region to well under half a pitch.
static bool refine(sv_lenslet_grid *g, const sv_raw *white) {
  double side = white->width_px > white->height_px ? white->width_px : white->height_px;
  double scale_px = 0.1 * g->pitch_px;
  field f = {.c = {1}, .middle = {0.5 * white->width_px, 0.5 * white->height_px}, .unit_px = 0.5 * side};
  int last = (int)(0.75 * side / (0.8 * g->pitch_px)) + 2;
  for (int reach = 3, is_last = 0; !is_last; reach *= 2) {
    is_last = reach >= last;
    for (int pass = 0; pass < (is_last ? 3 : 2); pass++) {
      sums s;
      collect(g, white, &f, is_last ? last : reach, scale_px, &s);
      if (s.n_used < 8 || !solve(&s, g)) return false;
      g->rms_px = sqrt(s.square / s.weight);
      g->n_seen = s.n_seen;
      g->n_used = s.n_used;
      sv_lenslet_grid_settle(g, 0.5 * white->width_px, 0.5 * white->height_px);
      if (s.n_used >= 40) fit_field(&s, &f);
      // Residuals after this fit are smaller than those it was made from: never trust fewer than 2
      // %.
      scale_px = g->rms_px > 0.02 * g->pitch_px ? g->rms_px : 0.02 * g->pitch_px;
    }
  }
  return true;
}

sv_status sv_lenslet_find(sv_lenslet_grid *g, const char *name, const sv_raw *white, sv_arena *scratch,
                          sv_err *err) {
  if (white->width_px < 32 || white->height_px < 32 || white->n_channels != 1)
    return sv_fail(err, SV_E_FORMAT,
                   "%s: %dx%d pixels of %d channels; at least 32x32 grey ones were expected", name,
                   white->width_px, white->height_px, white->n_channels);
  sv_status s = sv_lenslet_coarse(g, name, white, scratch, err);
  if (s != SV_OK) return s;
  sv_lenslet_grid_settle(g, 0.5 * white->width_px, 0.5 * white->height_px);
  if (!refine(g, white) || 2 * g->n_used < g->n_seen || g->rms_px > 0.1 * g->pitch_px)
    return sv_fail(
        err, SV_E_FORMAT,
        "%s: a pattern of %.2f px, but only %d of %d lenslets are where it has them; a white image "
        "of a lenslet array was expected",
        name, g->pitch_px, g->n_used, g->n_seen);
  if (fabs(g->rotation_rad) > SV_LENSLET_MAX_TURN_RAD || g->pitch_px < SV_LENSLET_MIN_PITCH_PX ||
      g->pitch_px > SV_LENSLET_MAX_PITCH_PX)
    return sv_fail(err, SV_E_RANGE,
                   "%s: lenslets of %.2f px turned by %.2f degrees; %g to %g px and at most 10 degrees were "
                   "expected (turn the pictures first)",
                   name, g->pitch_px, g->rotation_rad * 180 / SV_PI, SV_LENSLET_MIN_PITCH_PX,
                   SV_LENSLET_MAX_PITCH_PX);
  return SV_OK;
}
