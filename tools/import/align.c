// SPDX-License-Identifier: Apache-2.0
#include "tools/import/align.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define N_PARTS      8
#define LEAST_PART_S 2.0

typedef struct {
  double re, im;
} complex_t;

// In place, n a power of two; sign -1 forward, +1 backward without the division by n.
static void fft(complex_t *x, size_t n, int sign) {
  for (size_t i = 1, j = 0; i < n; i++) {
    size_t bit = n >> 1;
    for (; j & bit; bit >>= 1) j ^= bit;
    j ^= bit;
    if (i < j) {
      const complex_t t = x[i];
      x[i] = x[j];
      x[j] = t;
    }
  }
  for (size_t half = 1; half < n; half *= 2) {
    const double angle = sign * 3.14159265358979323846 / (double)half;
    for (size_t k = 0; k < half; k++) {
      const double c = cos(angle * (double)k), s = sin(angle * (double)k);
      for (size_t i = k; i < n; i += 2 * half) {
        complex_t *u = &x[i], *v = &x[i + half];
        const complex_t t = {v->re * c - v->im * s, v->re * s + v->im * c};
        *v = (complex_t){u->re - t.re, u->im - t.im};
        *u = (complex_t){u->re + t.re, u->im + t.im};
      }
    }
  }
}

// A signal without its mean.
static void load(complex_t *x, size_t n, const lab_signal *a) {
  double mean = 0;
  memset(x, 0, n * sizeof *x);
  for (int i = 0; i < a->n; i++) mean += a->samples[i];
  mean /= a->n;
  for (int i = 0; i < a->n; i++) x[i].re = a->samples[i] - mean;
}

// x becomes the cross-spectrum; each frequency has the same weight when it is whitened, but for
// those that neither signal holds.
static void cross(complex_t *x, const complex_t *y, size_t n, bool is_whitened) {
  double mean = 0;
  for (size_t i = 0; i < n; i++) {
    const complex_t p = {x[i].re * y[i].re + x[i].im * y[i].im, x[i].re * y[i].im - x[i].im * y[i].re};
    x[i] = p;
    mean += hypot(p.re, p.im) / (double)n;
  }
  for (size_t i = 0; i < n && is_whitened; i++) {
    const double k = 1 / (hypot(x[i].re, x[i].im) + 1e-3 * mean + 1e-300);
    x[i].re *= k;
    x[i].im *= k;
  }
}

typedef struct {
  const lab_signal *a, *b;
  bool is_whitened;
  int from, to; // delays in samples
} search;

// The highest place of a correlation and its height over the RMS; a parabola tells the place
// between samples. Delays are modulo n.
static double highest(const complex_t *c, size_t n, const search *s, double *delay) {
  double sum = 0, best = -1;
  long at = 0;
  for (size_t i = 0; i < n; i++) sum += c[i].re * c[i].re;
  for (long d = s->from; d <= s->to; d++) {
    const double v = c[d < 0 ? (size_t)(d + (long)n) : (size_t)d].re;
    if (v <= best) continue;
    best = v;
    at = d;
  }
  const double l = c[(size_t)(at - 1 + (long)n) % n].re, r = c[(size_t)(at + 1 + (long)n) % n].re;
  const double curve = l - 2 * best + r;
  *delay = (double)at + (curve < 0 ? 0.5 * (l - r) / curve : 0);
  return sum > 0 ? best / sqrt(sum / (double)n) : 0;
}

static sv_status correlate(const search *s, double *delay, double *peak, sv_err *err) {
  size_t n = 2;
  while (n < (size_t)s->a->n + (size_t)s->b->n) n *= 2;
  complex_t *x = malloc(n * sizeof *x), *y = malloc(n * sizeof *y);
  if (x && y) {
    load(x, n, s->a);
    load(y, n, s->b);
    fft(x, n, -1);
    fft(y, n, -1);
    cross(x, y, n, s->is_whitened);
    fft(x, n, 1);
    *peak = highest(x, n, s, delay);
  }
  const bool is_done = x && y;
  free(x);
  free(y);
  return is_done ? SV_OK : sv_fail(err, SV_E_NOMEM, "no memory to align %d samples", s->a->n);
}

// The spread of the delays of parts of what both signals have, about the delay of the whole.
static sv_status spread(const search *whole, double delay, double rate_hz, double *sigma, sv_err *err) {
  const long d = lrint(delay), start = d < 0 ? -d : 0;
  long end = whole->b->n - d;
  double sum = 0;
  int n = 0;
  if (end > whole->a->n) end = whole->a->n;
  const double least = LEAST_PART_S * rate_hz;
  const long fitting = (long)((double)(end - start) / least);
  const int n_parts = fitting > N_PARTS ? N_PARTS : (int)fitting;
  *sigma = 0;
  for (int i = 0; i < n_parts && n_parts > 1; i++) {
    const long length = (end - start) / n_parts, at = start + i * length;
    const lab_signal a = {whole->a->samples + at, (int)length}, b = {whole->b->samples + at + d, (int)length};
    const int room = (int)(0.02 * rate_hz);
    const search part = {&a, &b, whole->is_whitened, -room, room};
    double rest, peak;
    sv_status s = correlate(&part, &rest, &peak, err);
    if (s != SV_OK) return s;
    if (peak < LAB_DELAY_LEAST_PEAK) continue; // silence
    sum += (rest + (double)d - delay) * (rest + (double)d - delay);
    n++;
  }
  if (n > 1) *sigma = sqrt(sum / n);
  return SV_OK;
}

sv_status lab_delay_find(lab_delay *out, const lab_signal *a, const lab_signal *b, double rate_hz,
                         bool is_whitened, sv_err *err) {
  double delay = 0, sigma = 0;
  *out = (lab_delay){0};
  if (a->n < 16 || b->n < 16) return sv_fail(err, SV_E_NOT_FOUND, "too short to align: %d samples", a->n);
  const search whole = {a, b, is_whitened, 1 - a->n, b->n - 1};
  sv_status s = correlate(&whole, &delay, &out->peak, err);
  if (s == SV_OK && out->peak < LAB_DELAY_LEAST_PEAK)
    return sv_fail(err, SV_E_NOT_FOUND,
                   "they have nothing in common: the correlation's peak is %.1f times its RMS", out->peak);
  if (s == SV_OK && is_whitened) s = spread(&whole, delay, rate_hz, &sigma, err);
  out->delay_s = delay / rate_hz;
  out->sigma_s = sqrt(sigma * sigma + 1.0 / 12) / rate_hz;
  return s;
}
