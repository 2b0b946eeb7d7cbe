// SPDX-License-Identifier: Apache-2.0
#include "src/rig/lenslet_lattice.h"

#include <math.h>
#include <string.h>

#include "src/base/mathx.h"

#define N       512 // side of the transform, a power of two
#define CAP_LAG 64  // longest period looked for, px

// Frequencies, in cycles per pixel, that a lattice's first harmonics can have: below is the
// fall-off of the whole field, above is noise.
#define MIN_FREQUENCY (1.0 / 64)
#define MAX_FREQUENCY 0.3

typedef struct {
  float re, im;
} complex_f;

typedef struct {
  complex_f *f, *twiddle, *column; // [N][N], [N/2], [N]
  float *hann_x, *hann_y;          // [N], 0 outside of the window
  float *share_x, *share_y;        // [CAP_LAG + 2] autocorrelation of the windows, 1 at 0
  int x0, y0, w, h;                // the examined part of the image
  int cap_lag;
  double mean;
} work;

size_t sv_lenslet_coarse_bytes(void) {
  return sizeof(complex_f) * (N * N + N / 2 + N) + sizeof(float) * (2 * N + 2 * (CAP_LAG + 2)) +
         8 * SV_ARENA_ALIGN;
}

static bool take(work *k, sv_arena *a) {
  k->f = SV_TAKE(a, complex_f, N * N);
  k->twiddle = SV_TAKE(a, complex_f, N / 2);
  k->column = SV_TAKE(a, complex_f, N);
  k->hann_x = SV_TAKE(a, float, N);
  k->hann_y = SV_TAKE(a, float, N);
  k->share_x = SV_TAKE(a, float, CAP_LAG + 2);
  k->share_y = SV_TAKE(a, float, CAP_LAG + 2);
  return a->status == SV_OK;
}

// --- Fourier transform: radix 2, decimation in time ----------------------------------------------

static void fft(complex_f *a, const complex_f *twiddle) {
  for (int i = 1, j = 0; i < N; i++) {
    int bit = N >> 1;
    for (; j & bit; bit >>= 1) j ^= bit;
    j ^= bit;
    if (i < j) {
      complex_f t = a[i];
      a[i] = a[j];
      a[j] = t;
    }
  }
  for (int half = 1; half < N; half <<= 1)
    for (int start = 0; start < N; start += 2 * half)
      for (int i = 0; i < half; i++) {
        complex_f w = twiddle[i * (N / 2 / half)], *p = a + start + i, *q = p + half;
        complex_f t = {q->re * w.re - q->im * w.im, q->re * w.im + q->im * w.re};
        *q = (complex_f){p->re - t.re, p->im - t.im};
        p->re += t.re;
        p->im += t.im;
      }
}

static void fft_2d(work *k) {
  for (int y = 0; y < N; y++) fft(k->f + y * N, k->twiddle);
  for (int x = 0; x < N; x++) {
    for (int y = 0; y < N; y++) k->column[y] = k->f[y * N + x];
    fft(k->column, k->twiddle);
    for (int y = 0; y < N; y++) k->f[y * N + x] = k->column[y];
  }
}

// --- autocorrelation -----------------------------------------------------------------------------

static void window(float *hann, float *share, int n) {
  memset(hann, 0, N * sizeof *hann);
  for (int i = 0; i < n; i++) hann[i] = (float)(0.5 - 0.5 * sv_cos(2 * SV_PI * (i + 0.5) / n));
  double zero = 0;
  for (int lag = 0; lag < CAP_LAG + 2; lag++) {
    double sum = 0;
    for (int i = 0; i < N; i++) sum += (double)hann[i] * (double)hann[(i + lag) % N];
    if (!lag) zero = sum;
    share[lag] = (float)(sum / zero);
  }
}

static float value(const work *k, const sv_raw *white, int x, int y) {
  return sv_raw_at(white, k->x0 + x, k->y0 + y, 0) - (float)k->mean;
}

static void load(work *k, const sv_raw *white) {
  k->w = sv_mini(white->width_px, N);
  k->h = sv_mini(white->height_px, N);
  k->x0 = (white->width_px - k->w) / 2;
  k->y0 = (white->height_px - k->h) / 2;
  k->cap_lag = sv_mini(CAP_LAG, sv_mini(k->w, k->h) / 3);
  for (int i = 0; i < N / 2; i++)
    k->twiddle[i] = (complex_f){(float)sv_cos(2 * SV_PI * i / N), (float)-sv_sin(2 * SV_PI * i / N)};
  window(k->hann_x, k->share_x, k->w);
  window(k->hann_y, k->share_y, k->h);
  double sum = 0, weight = 0;
  k->mean = 0;
  for (int y = 0; y < k->h; y++)
    for (int x = 0; x < k->w; x++) {
      double w = (double)(k->hann_x[x] * k->hann_y[y]);
      sum += w * (double)value(k, white, x, y);
      weight += w;
    }
  k->mean = sum / weight;
  memset(k->f, 0, sizeof(complex_f) * N * N);
  for (int y = 0; y < k->h; y++)
    for (int x = 0; x < k->w; x++) k->f[y * N + x].re = value(k, white, x, y) * k->hann_x[x] * k->hann_y[y];
}

// Power spectrum of the band, transformed back: f[lag y][lag x].re, negative lags from the end.
static void autocorrelate(work *k) {
  fft_2d(k);
  for (int y = 0; y < N; y++)
    for (int x = 0; x < N; x++) {
      complex_f *p = &k->f[y * N + x];
      double fx = (double)(x < N / 2 ? x : x - N) / N, fy = (double)(y < N / 2 ? y : y - N) / N;
      double q = fx * fx + fy * fy;
      bool is_in = q >= MIN_FREQUENCY * MIN_FREQUENCY && q <= MAX_FREQUENCY * MAX_FREQUENCY;
      *p = (complex_f){is_in ? p->re * p->re + p->im * p->im : 0, 0};
    }
  fft_2d(k); // of a symmetric image: the inverse equals the forward transform
}

// As a share of lag 0, with the windows' own fall-off divided out.
static double at_lag(const work *k, int x, int y) {
  float c = k->f[(y & (N - 1)) * N + (x & (N - 1))].re;
  int ax = x < 0 ? -x : x, ay = y < 0 ? -y : y;
  return (double)c / ((double)k->f[0].re * (double)k->share_x[ax] * (double)k->share_y[ay]);
}

// A lattice's correlation is low half-way to one of its points; that of stripes is not, along them.
static bool is_low_between(const work *k, double x, double y, double v) {
  return at_lag(k, (int)floor(0.5 * x + 0.5), (int)floor(0.5 * y + 0.5)) < 0.7 * v;
}

static bool is_peak(const work *k, int x, int y, double v) {
  if (!is_low_between(k, x, y, v)) return false;
  for (int dy = -1; dy <= 1; dy++)
    for (int dx = -1; dx <= 1; dx++)
      if ((dx || dy) && at_lag(k, x + dx, y + dy) > v) return false;
  return true;
}

// Middle of the parabola through three values.
static double vertex(double a, double b, double c) {
  double d = a - 2 * b + c;
  return d < 0 ? 0.5 * (a - c) / d : 0;
}

// Shortest peak of at least `min`, at 30 degrees or more from `from` (may be NULL). Returns the
// largest value among the peaks when out is NULL, else 1 when there is one.
static double search(const work *k, double least, const double *from, double *out) {
  double best = 0, shortest = 1e30;
  for (int y = 0; y <= k->cap_lag; y++)
    for (int x = y ? -k->cap_lag : 1; x <= k->cap_lag; x++) {
      double r2 = (double)x * x + (double)y * y, v;
      if (r2 < 4.2 * 4.2 || r2 > (double)k->cap_lag * k->cap_lag) continue;
      if ((v = at_lag(k, x, y)) < least || !is_peak(k, x, y, v)) continue;
      if (!out) {
        if (v > best) best = v;
        continue;
      }
      double cross = from ? from[0] * y - from[1] * x : 0;
      if (r2 >= shortest || (from && cross * cross < 0.25 * r2 * (from[0] * from[0] + from[1] * from[1])))
        continue;
      if (from &&
          !(is_low_between(k, x - from[0], y - from[1], v) && is_low_between(k, x + from[0], y + from[1], v)))
        continue;
      shortest = r2;
      best = 1;
      out[0] = x + vertex(at_lag(k, x - 1, y), v, at_lag(k, x + 1, y));
      out[1] = y + vertex(at_lag(k, x, y - 1), v, at_lag(k, x, y + 1));
    }
  return best;
}

// --- lattice -------------------------------------------------------------------------------------

// The lattice step closest to the +x axis becomes col; the rest follows.
static sv_status choose_steps(sv_lenslet_grid *g, const double a[2], const double b_in[2], const char *name,
                              sv_err *err) {
  double b[2] = {b_in[0], b_in[1]}, dot = a[0] * b[0] + a[1] * b[1], cross = a[0] * b[1] - a[1] * b[0];
  if (dot < 0) {
    b[0] = -b[0];
    b[1] = -b[1];
    dot = -dot;
    cross = -cross;
  }
  double la = sqrt(a[0] * a[0] + a[1] * a[1]), lb = sqrt(b[0] * b[0] + b[1] * b[1]);
  double angle_deg = sv_atan2(cross < 0 ? -cross : cross, dot) * 180 / SV_PI;
  g->is_hexagonal = angle_deg < 75;
  if (lb > 1.15 * la || angle_deg < 50 || (angle_deg > 70 && angle_deg < 80))
    return sv_fail(err, SV_E_FORMAT,
                   "%s: its pattern repeats every %.1f and %.1f px at %.0f degrees; lenslets in a square or "
                   "hexagonal array were expected",
                   name, la, lb, angle_deg);
  double steps[3][2] = {{a[0], a[1]}, {b[0], b[1]}, {b[0] - a[0], b[1] - a[1]}};
  int n = g->is_hexagonal ? 3 : 2, best = 0;
  for (int i = 1; i < n; i++)
    if (fabs(steps[i][1]) / (fabs(steps[i][0]) + 1e-9) < fabs(steps[best][1]) / (fabs(steps[best][0]) + 1e-9))
      best = i;
  double *c = steps[best], *d = steps[(best + 1) % n], sign = c[0] < 0 ? -1 : 1;
  for (int i = 0; i < 2; i++) g->col_px[i] = c[i] * sign;
  double cc = c[0] * c[0] + c[1] * c[1], along = (d[0] * g->col_px[0] + d[1] * g->col_px[1]) / cc;
  // d ends half a step along, in an ideal array
  double half = g->is_hexagonal ? (along < 0 ? -0.5 : 0.5) : 0;
  for (int i = 0; i < 2; i++) g->row_px[i] = d[i] - half * g->col_px[i];
  if (g->row_px[1] < 0) {
    g->row_px[0] = -g->row_px[0];
    g->row_px[1] = -g->row_px[1];
  }
  return SV_OK;
}

// Phase, in cycles, of the picture at one frequency (cycles per px) about the middle of the part
// looked at.
static double phase(const work *k, const sv_raw *white, const double b[2]) {
  double cx = sv_cos(2 * SV_PI * b[0]), sx = -sv_sin(2 * SV_PI * b[0]), re = 0, im = 0;
  for (int y = 0; y < k->h; y++) {
    double at = b[0] * (0.5 - 0.5 * k->w) + b[1] * (y + 0.5 - 0.5 * k->h);
    double wr = sv_cos(2 * SV_PI * at), wi = -sv_sin(2 * SV_PI * at), sum_re = 0, sum_im = 0;
    for (int x = 0; x < k->w; x++) {
      double v = (double)(value(k, white, x, y) * k->hann_x[x]), t = wr * cx - wi * sx;
      sum_re += v * wr;
      sum_im += v * wi;
      wi = wr * sx + wi * cx;
      wr = t;
    }
    re += (double)k->hann_y[y] * sum_re;
    im += (double)k->hann_y[y] * sum_im;
  }
  return sv_atan2(im, re) / (2 * SV_PI);
}

// A bright spot at c has the coefficient exp(-2 pi i b c) for the reciprocal steps b.
static void locate(const work *k, sv_lenslet_grid *g, const sv_raw *white) {
  double a1[2], a2[2], half = g->is_hexagonal ? 0.5 : 0;
  for (int i = 0; i < 2; i++) {
    a1[i] = g->col_px[i];
    a2[i] = g->row_px[i] + half * g->col_px[i];
  }
  double det = a1[0] * a2[1] - a1[1] * a2[0];
  double b1[2] = {a2[1] / det, -a2[0] / det}, b2[2] = {-a1[1] / det, a1[0] / det};
  double p1 = phase(k, white, b1), p2 = phase(k, white, b2);
  g->offset_px[0] = k->x0 + 0.5 * k->w - p1 * a1[0] - p2 * a2[0];
  g->offset_px[1] = k->y0 + 0.5 * k->h - p1 * a1[1] - p2 * a2[1];
}

static sv_status coarse(work *k, sv_lenslet_grid *g, const char *name, const sv_raw *white, sv_err *err) {
  double a[2], b[2];
  load(k, white);
  autocorrelate(k);
  // A lattice with noise and some dead lenslets stays well above this; a photograph does not reach
  // it.
  double best = k->f[0].re > 0 ? search(k, 0, NULL, NULL) : 0;
  if (best < 0.25)
    return sv_fail(err, SV_E_FORMAT,
                   "%s: no repeating pattern (strongest repetition %.2f of 1); a white image of a lenslet "
                   "array was expected, with pitches from %g to %g px",
                   name, best, SV_LENSLET_MIN_PITCH_PX, SV_LENSLET_MAX_PITCH_PX);
  if (search(k, 0.7 * best, NULL, a) != 1 || search(k, 0.7 * best, a, b) != 1)
    return sv_fail(err, SV_E_FORMAT,
                   "%s: its pattern repeats in one direction only; a white image of a lenslet array was "
                   "expected",
                   name);
  sv_status s = choose_steps(g, a, b, name, err);
  if (s == SV_OK) locate(k, g, white);
  return s;
}

sv_status sv_lenslet_coarse(sv_lenslet_grid *g, const char *name, const sv_raw *white, sv_arena *scratch,
                            sv_err *err) {
  size_t mark = sv_arena_mark(scratch);
  work k;
  *g = (sv_lenslet_grid){.pitch_px = 0};
  sv_status s = take(&k, scratch)
                    ? coarse(&k, g, name, white, err)
                    : sv_fail(err, scratch->status, "%s: finding its lenslets needs %zu bytes of scratch",
                              name, sv_lenslet_coarse_bytes());
  sv_arena_reset(scratch, mark);
  return s;
}
