// SPDX-License-Identifier: Apache-2.0
#include "src/rig/footprint.h"

#include <math.h>
#include <string.h>

#include "src/base/mathx.h"

#define BINS     65536
#define MAX_LOSS 0.98 // a plateau above this share of full scale is clipped

typedef struct {
  const char *name;
  int w, h;
  float *v;       // [h][w] values; later coverage, not clamped
  uint32_t *bins; // [BINS]
  double dark, dark_noise, plateau, noise;
  int n_dead;
  int x0, y0, x1, y1; // the rectangle
} work;

size_t sv_footprint_bytes(int width_px, int height_px) {
  return sizeof(uint32_t) * BINS + sizeof(float) * (size_t)width_px * (size_t)height_px + 4 * SV_ARENA_ALIGN;
}

// --- values --------------------------------------------------------------------------------------

static float at(const work *k, int x, int y) { return k->v[(size_t)y * (size_t)k->w + (size_t)x]; }

// A pixel that differs from all but one neighbour by a tenth of full range is dead (two dead pixels
// may touch). A rim always has several pixels of the same kind.
static float without_dead(const sv_raw *r, int x, int y, int *n_dead) {
  float v = sv_raw_at(r, x, y, 0), s[8];
  int n = 0;
  for (int dy = -1; dy <= 1; dy++)
    for (int dx = -1; dx <= 1; dx++) {
      int u = x + dx, w = y + dy, i = n;
      if ((!dx && !dy) || u < 0 || w < 0 || u >= r->width_px || w >= r->height_px) continue;
      float t = sv_raw_at(r, u, w, 0);
      for (; i > 0 && s[i - 1] > t; i--) s[i] = s[i - 1]; // sorted
      s[i] = t;
      n++;
    }
  if (n < 3) return v;
  float lo = s[1], hi = s[n - 2], limit = 0.1f * sv_maxf(hi, 0.05f);
  if (v <= hi + limit && v >= lo - limit) return v;
  ++*n_dead;
  return 0.5f * (s[(n - 1) / 2] + s[n / 2]);
}

static int bin_of(float v) { return sv_clampi((int)(v * (float)(BINS - 1) + 0.5f), 0, BINS - 1); }
static double value_of(int bin) { return (double)bin / (BINS - 1); }

static void load(work *k, const sv_raw *r) {
  memset(k->bins, 0, sizeof *k->bins * BINS);
  for (int y = 0; y < k->h; y++)
    for (int x = 0; x < k->w; x++) {
      float v = without_dead(r, x, y, &k->n_dead);
      k->v[(size_t)y * (size_t)k->w + (size_t)x] = v;
      k->bins[bin_of(v)]++;
    }
}

// The bin below which `share` of those in [lo, hi) are.
static int quantile(const work *k, int lo, int hi, double share) {
  double n = 0, sum = 0;
  for (int i = lo; i < hi; i++) n += k->bins[i];
  for (int i = lo; i < hi; i++)
    if ((sum += k->bins[i]) >= share * n && k->bins[i]) return i;
  return lo;
}

// Otsu 1979: the threshold with the smallest variance inside both classes. 0: only one value.
static int two_classes(const work *k) {
  double n = 0, total = 0, n0 = 0, sum0 = 0, best = -1;
  int split = 0;
  for (int i = 0; i < BINS; i++) {
    n += k->bins[i];
    total += (double)i * k->bins[i];
  }
  for (int i = 0; i < BINS - 1; i++) {
    n0 += k->bins[i];
    sum0 += (double)i * k->bins[i];
    if (n0 == 0 || n0 == n || !k->bins[i]) continue;
    double d = sum0 / n0 - (total - sum0) / (n - n0), between = n0 * (n - n0) * d * d;
    if (between > best) {
      best = between;
      split = i + 1;
    }
  }
  return split;
}

// Dark level, its noise, and a first plateau from the histogram.
static sv_status levels(work *k, double dark, sv_err *err) {
  int split = two_classes(k), low = quantile(k, 0, split, 0.5), high = quantile(k, split, BINS, 0.5);
  // Half of the dark class lies below its median: its lower quartile tells the noise without the
  // lit rim.
  k->dark_noise = 1.4826 * (value_of(low) - value_of(quantile(k, 0, low + 1, 0.5)));
  k->dark = dark >= 0 ? dark : value_of(low);
  k->plateau = value_of(high);
  if (!split && dark < 0) k->dark = k->plateau; // nothing to tell apart
  if (!(k->plateau - k->dark > 0.02) || k->plateau - k->dark < 8 * k->dark_noise)
    return sv_fail(err, SV_E_FORMAT,
                   "%s: no lit lens stands out (dark %.4f, bright %.4f of 1); a white image through one lens "
                   "was expected",
                   k->name, k->dark, k->plateau);
  if (dark < 0 && k->dark > 0.5 * k->plateau)
    return sv_fail(err, SV_E_FORMAT,
                   "%s: the dark part is half as bright as the lit one (%.3f, %.3f); give the dark level, or "
                   "mask the other lenses",
                   k->name, k->dark, k->plateau);
  if (quantile(k, split, BINS, 0.9) >= MAX_LOSS * (BINS - 1))
    return sv_fail(err, SV_E_FORMAT, "%s: overexposed; a plateau below %.2f of full scale was expected",
                   k->name, MAX_LOSS);
  return SV_OK;
}

// --- the rectangle -------------------------------------------------------------------------------

// Pixels above half the plateau in one row (is_row) or column, within [from, to).
static int count_core(const work *k, bool is_row, int line, int from, int to) {
  float half = (float)(0.5 * (k->dark + k->plateau));
  int n = 0;
  for (int i = from; i < to; i++) n += (is_row ? at(k, i, line) : at(k, line, i)) > half;
  return n;
}

// Contiguous lines with core pixels around the fullest one: detached parts are not the lens.
static void core_range(const work *k, bool is_row, int from, int to, int *lo, int *hi) {
  int n_lines = is_row ? k->h : k->w, best = -1, fullest = 0;
  for (int i = 0; i < n_lines; i++) {
    int n = count_core(k, is_row, i, from, to);
    if (n > best) {
      best = n;
      fullest = i;
    }
  }
  *lo = fullest;
  *hi = fullest + 1;
  while (*lo > 0 && count_core(k, is_row, *lo - 1, from, to)) --*lo;
  while (*hi < n_lines && count_core(k, is_row, *hi, from, to)) ++*hi;
}

// Mean coverage of a line over [from, to).
static double line_mean(const work *k, bool is_row, int line, int from, int to) {
  double sum = 0;
  for (int i = from; i < to; i++) sum += (double)(is_row ? at(k, i, line) : at(k, line, i));
  return (sum / (to - from) - k->dark) / (k->plateau - k->dark);
}

// Grows outwards while a line is lit: more than four deviations of its mean, and 1/255 of a pixel
// in all.
static void grow(work *k) {
  double sigma = k->dark_noise / (k->plateau - k->dark);
  for (int pass = 0; pass < 2; pass++) {
    double nx = k->x1 - k->x0, ny = k->y1 - k->y0;
    double row = 4 * sigma / sqrt(nx) + 0.5 / (255 * nx), col = 4 * sigma / sqrt(ny) + 0.5 / (255 * ny);
    while (k->y0 > 0 && line_mean(k, true, k->y0 - 1, k->x0, k->x1) > row) k->y0--;
    while (k->y1 < k->h && line_mean(k, true, k->y1, k->x0, k->x1) > row) k->y1++;
    while (k->x0 > 0 && line_mean(k, false, k->x0 - 1, k->y0, k->y1) > col) k->x0--;
    while (k->x1 < k->w && line_mean(k, false, k->x1, k->y0, k->y1) > col) k->x1++;
  }
}

static void find_rectangle(work *k) {
  core_range(k, true, 0, k->w, &k->y0, &k->y1);
  core_range(k, false, k->y0, k->y1, &k->x0, &k->x1);
  core_range(k, true, k->x0, k->x1, &k->y0, &k->y1);
  grow(k);
}

// --- the plateau ---------------------------------------------------------------------------------

// Standard deviation of a pixel on the plateau: median difference of neighbours that are both on
// it.
static double plateau_noise(work *k) {
  float bright = (float)(k->dark + 0.8 * (k->plateau - k->dark));
  uint32_t n = 0;
  memset(k->bins, 0, sizeof *k->bins * BINS);
  for (int y = k->y0; y < k->y1; y++)
    for (int x = k->x0; x + 1 < k->x1; x++) {
      float a = at(k, x, y), b = at(k, x + 1, y);
      if (a > bright && b > bright) {
        k->bins[bin_of(fabsf(a - b))]++;
        n++;
      }
    }
  return n ? value_of(quantile(k, 0, BINS, 0.5)) / (0.6745 * 1.41421356) : 0;
}

typedef struct {
  int n; // pixels
  float mean, lo, hi;
} patch;

// Mean and range over (2 r + 1)^2 pixels, cut at the rectangle.
static patch patch_at(const work *k, int x, int y, int r) {
  int xa = sv_maxi(x - r, k->x0), xb = sv_mini(x + r + 1, k->x1);
  int ya = sv_maxi(y - r, k->y0), yb = sv_mini(y + r + 1, k->y1);
  float sum = 0, first = at(k, x, y);
  patch p = {0, 0, first, first};
  for (int b = ya; b < yb; b++)
    for (int a = xa; a < xb; a++, p.n++) {
      float v = at(k, a, b);
      sum += v;
      p.lo = sv_minf(p.lo, v);
      p.hi = sv_maxf(p.hi, v);
    }
  p.mean = sum / (float)p.n;
  return p;
}

// 95th percentile of the means of whole patches; their noise would raise it by 1.645 deviations.
static void find_plateau(work *k) {
  float half = (float)(0.5 * (k->dark + k->plateau));
  double sigma = plateau_noise(k);
  uint32_t n = 0;
  memset(k->bins, 0, sizeof *k->bins * BINS);
  for (int y = k->y0; y < k->y1; y += 2)
    for (int x = k->x0; x < k->x1; x += 2) {
      patch p = patch_at(k, x, y, 3);
      if (p.n == 49 && p.lo > half) {
        k->bins[bin_of(p.mean)]++;
        n++;
      }
    }
  if (n >= 8) k->plateau = value_of(quantile(k, 0, BINS, 0.95)) - 1.645 * sigma / 7;
  k->noise = sigma / (k->plateau - k->dark);
}

// --- coverage ------------------------------------------------------------------------------------

static double write_coverage(work *k, uint8_t *coverage) {
  float scale = (float)(1 / (k->plateau - k->dark)), dark = (float)k->dark;
  // The range of 25 normal values is 4 deviations, above 6.5 in one case of a thousand. Noise is
  // smaller on the dark side, where the same limit averages over a few more pixels.
  float limit = (float)(6.5 * k->noise) / scale;
  double area = 0;
  for (int y = k->y0; y < k->y1; y++)
    for (int x = k->x0; x < k->x1; x++) {
      patch p = patch_at(k, x, y, 2);
      float v = (p.hi - p.lo <= limit ? p.mean : at(k, x, y)) - dark;
      uint8_t c = (uint8_t)(sv_clampf(v * scale, 0, 1) * 255 + 0.5f);
      *coverage++ = c;
      area += c / 255.0;
    }
  return area;
}

static sv_status measure(work *k, const sv_white_image *white, sv_err *err) {
  load(k, white->raw);
  sv_status s = levels(k, white->dark, err);
  if (s != SV_OK) return s;
  find_rectangle(k);
  find_plateau(k);
  return SV_OK;
}

sv_status sv_footprint_measure(sv_footprint *f, sv_footprint_stats *stats, const sv_white_image *white,
                               sv_arena *out_arena, sv_arena *scratch, sv_err *err) {
  size_t mark = sv_arena_mark(scratch);
  const char *name = white->name;
  work k = {.name = name, .w = white->raw->width_px, .h = white->raw->height_px};
  if (k.w < 3 || k.h < 3 || white->raw->n_channels != 1)
    return sv_fail(err, SV_E_FORMAT, "%s: %dx%d pixels of %d channels; a grey picture was expected", name,
                   k.w, k.h, white->raw->n_channels);
  k.bins = SV_TAKE(scratch, uint32_t, BINS);
  k.v = SV_TAKE(scratch, float, (size_t)k.w *(size_t)k.h);
  sv_status s = k.bins && k.v ? measure(&k, white, err)
                              : sv_fail(err, scratch->status, "%s: its footprint needs %zu bytes of scratch",
                                        name, sv_footprint_bytes(k.w, k.h));
  if (s == SV_OK) {
    size_t n = (size_t)(k.x1 - k.x0) * (size_t)(k.y1 - k.y0);
    uint8_t *coverage = SV_TAKE(out_arena, uint8_t, n);
    if (!coverage) s = sv_fail(err, out_arena->status, "%s: no memory for %zu pixels of coverage", name, n);
    else {
      double area = write_coverage(&k, coverage);
      *f = (sv_footprint){k.x0, k.y0, k.x1 - k.x0, k.y1 - k.y0, coverage};
      *stats = (sv_footprint_stats){k.dark, k.plateau, k.noise, area, k.n_dead};
    }
  }
  sv_arena_reset(scratch, mark);
  return s;
}

sv_status sv_footprint_sum(const sv_footprint *f, int n, sv_overlap_map *map, sv_err *err) {
  const int width = map->width_px, height = map->height_px;
  float *sum = map->sum;
  size_t n_px = (size_t)width * (size_t)height;
  for (size_t i = 0; i < n_px; i++) sum[i] = 0;
  for (int m = 0; m < n; m++) {
    const sv_footprint *p = &f[m];
    if (p->x0_px < 0 || p->y0_px < 0 || p->width_px < 1 || p->height_px < 1 ||
        p->width_px > width - p->x0_px || p->height_px > height - p->y0_px)
      return sv_fail(err, SV_E_RANGE, "footprint %d: %dx%d at %d,%d is not on the sensor of %dx%d", m,
                     p->width_px, p->height_px, p->x0_px, p->y0_px, width, height);
    for (int y = 0; y < p->height_px; y++) {
      float *to = sum + (size_t)(p->y0_px + y) * (size_t)width + (size_t)p->x0_px;
      const uint8_t *c = p->coverage ? p->coverage + (size_t)y * (size_t)p->width_px : NULL;
      for (int x = 0; x < p->width_px; x++) to[x] += c ? (float)c[x] * (1.0f / 255) : 1.0f;
    }
  }
  map->max_overlap = 0;
  for (size_t i = 0; i < n_px; i++) map->max_overlap = sv_maxf(map->max_overlap, sum[i]);
  return SV_OK;
}
