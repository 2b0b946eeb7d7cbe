// SPDX-License-Identifier: Apache-2.0
// What a step asks for, counted, and the least time it can take.
#include "tools/bench/bench.h"

#include "src/base/mathx.h"
#include "src/train/optimize.h"

static const sv_bench_op ops_of[SV_N_STAGES][2] = {
    [SV_STAGE_TARGET] = {SV_BENCH_UNPACK, SV_N_BENCH_OPS},
    [SV_STAGE_PROJECT] = {SV_BENCH_PROJECT, SV_N_BENCH_OPS},
    [SV_STAGE_ORDER] = {SV_BENCH_SORT, SV_BENCH_BIN},
    [SV_STAGE_RASTER] = {SV_BENCH_RASTER, SV_N_BENCH_OPS},
    [SV_STAGE_LOSS] = {SV_BENCH_SSIM, SV_BENCH_SSIM_BWD},
    [SV_STAGE_CURVATURE] = {SV_BENCH_RASTER_BWD, SV_BENCH_PROJECT_BWD},
    [SV_STAGE_RASTER_BWD] = {SV_BENCH_RASTER_BWD, SV_N_BENCH_OPS},
    [SV_STAGE_OPTIMISE] = {SV_BENCH_PROJECT_BWD, SV_BENCH_NEWTON},
};

// Operations of one pair, kernels/raster/raster_vec.c without depth: quadric 4, 2^x 11, min 1,
// weight and transmittance 2, three colours 6; and backward the same but for the colours and the
// min, then 6 gradients of colour, 5 for their product, 2 suffix, 2 quotient, 2 to dL/d(ln alpha),
// 5 moments. Errors: ERROR_FLOP. What a column of pixels has in common (6 once an intersection) is
// not counted.
#define FORWARD_FLOP  24.0
#define BACKWARD_FLOP 39.0
// A row of blocks, each of its lanes: offset 1; backward the moments 9 as well. An intersection:
// its nine sums of sixteen lanes.
#define FORWARD_ROW_FLOP           1.0
#define BACKWARD_ROW_FLOP          10.0
#define BACKWARD_INTERSECTION_FLOP 135.0
// What a step with errors asks for besides: of a pair, an intersection, a channel of a pixel.
#define ERROR_FLOP        2.0
#define ERROR_RECORD_FLOP 15.0

// The instructions for that through the ports of the multiply-adds, a vector of pairs each, with
// AVX-512: quadric 2, 2^x 6, min 1, comparisons 2, weight and transmittance 2, colours 3; and
// backward the same but for the last and the min, then 3 gradients, 3, 1, 4 (a division takes the
// place of three), 1, 3. What a row of blocks has in common once a row: the offset 1, and backward
// 5 of the moments, too. Loads, stores, and what is done once for an intersection are free here.
#define FORWARD_SLOTS      16.0
#define BACKWARD_SLOTS     27.0
#define FORWARD_ROW_SLOTS  1.0
#define BACKWARD_ROW_SLOTS 6.0
#define BLOCK_PX           16.0

// One channel of one pixel, kernels/ssim/ssim_vec.c: squares and product 4; on every second row
// four maps of two blurs of 16, the point 27, and three maps of a blur of 16; backward three maps
// of a blur of 7.5 along columns, and 9.
#define SSIM_FLOP     105.5
#define SSIM_BWD_FLOP 31.5

// One Gaussian, kernels/project/project_vec.c: geometry 270 (four 2^x among it), the splat 66, a
// colour 6 a coefficient; backward the geometry again, screen 29, camera 94, shape 140, place 31,
// colour 17 a coefficient.
#define PROJECT_FLOP     336.0
#define PROJECT_BWD_FLOP 564.0
#define BIN_ROW_FLOP     35.0 // two chords of an ellipse
#define NEWTON_FLOP      10.0

sv_bench_cost sv_bench_cost_of(sv_bench_op op, const sv_bench_counts *n) {
  const double px = n->n_pixels, all = n->n_gaussians, visible = n->n_visible,
               intersections = n->n_intersections;
  const double touched = n->n_touched, rows = n->n_rows, pairs = (double)n->pairs;
  const double row_lanes = BLOCK_PX * (double)n->block_rows;
  const double coef = (rows - SV_ROW_SH) / 3.0, intersection = sizeof(sv_intersection) + sizeof(uint32_t);
  const double igrad = SV_IGRAD_BYTES;
  switch (op) {
  case SV_BENCH_UNPACK: return (sv_bench_cost){3 * px, (3 + 12) * px};
  case SV_BENCH_PROJECT:
    return (sv_bench_cost){(PROJECT_FLOP + 6 * coef) * all,
                           4 * rows * all + sizeof(sv_splat) * all + 4 * visible};
  case SV_BENCH_SORT: return (sv_bench_cost){0, (2 * sizeof(sv_pair) + sizeof(uint32_t)) * intersections};
  case SV_BENCH_BIN:
    return (sv_bench_cost){BIN_ROW_FLOP * (double)n->rows,
                           sizeof(sv_splat) * visible + intersection * intersections};
  case SV_BENCH_RASTER:
    return (sv_bench_cost){FORWARD_FLOP * pairs + FORWARD_ROW_FLOP * row_lanes,
                           (intersection + 8) * intersections + sizeof(sv_splat) * visible + 12 * px};
  case SV_BENCH_SSIM: return (sv_bench_cost){3 * SSIM_FLOP * px, 3 * (8 + 6) * px};
  case SV_BENCH_SSIM_BWD: return (sv_bench_cost){3 * SSIM_BWD_FLOP * px, 3 * (8 + 6 + 4) * px};
  case SV_BENCH_RASTER_BWD:
    return (sv_bench_cost){BACKWARD_FLOP * pairs + BACKWARD_ROW_FLOP * row_lanes +
                               BACKWARD_INTERSECTION_FLOP * intersections,
                           (intersection + igrad) * intersections + sizeof(sv_splat) * visible + 28 * px};
  case SV_BENCH_PROJECT_BWD:
    return (sv_bench_cost){(PROJECT_BWD_FLOP + 17 * coef) * touched + SV_IGRAD_ERR * intersections,
                           (sizeof(sv_intersection) + igrad) * intersections + sizeof(sv_splat) * visible +
                               4 * rows * touched};
  case SV_BENCH_NEWTON:
    return (sv_bench_cost){NEWTON_FLOP * rows * touched, (2 * 4 + 3 * 2) * rows * touched};
  default: return (sv_bench_cost){0, 0};
  }
}

double sv_bench_arrays_bytes(const sv_bench_counts *n) {
  // parameters and two moments of 16 bits; intersection, its place in a list, pair to sort, igrad
  const double gaussian = (4 + 2 * 2) * n->n_rows + (double)sizeof(sv_splat);
  const double intersection = sizeof(sv_intersection) + sizeof(uint32_t) + sizeof(sv_pair) + SV_IGRAD_BYTES;
  const double pixel =
      3 + 4 * (3 + 3 + 3 + 1); // the image; planes of it, of the rendering, its gradient, errors
  return gaussian * n->n_gaussians + intersection * n->n_intersections + pixel * n->n_pixels;
}

// Nothing is copied slower out of a smaller block than out of a larger one, unless something
// disturbed it.
static double copy_rate(const sv_bench_peak *p, double bytes) {
  double above = 0, size_above = 0; // of the next larger size
  for (int i = p->n_copy_sizes - 1; i >= 0; i--) {
    const double size = (double)p->copy_bytes[i], rate = sv_maxd(p->copy_bytes_per_s[i], above);
    if (bytes >= size) {
      if (size_above <= 0) return rate;
      return rate + (above - rate) * sv_log(bytes / size) / sv_log(size_above / size);
    }
    above = rate;
    size_above = size;
  }
  return above;
}

double sv_bench_bound_s(const sv_bench_peak *peak, sv_bench_cost cost, double arrays_bytes) {
  double flop_s = peak->flop_per_s > 0 ? cost.flop / peak->flop_per_s : 0;
  double rate = copy_rate(peak, arrays_bytes), bytes_s = rate > 0 ? cost.bytes / rate : 0;
  return flop_s > bytes_s ? flop_s : bytes_s;
}

// By how much the ports hold up blending for longer than its bound says.
static double more_ms(const sv_bench_step *r, const sv_bench_peak *peak, sv_bench_stage stage, double a_pair,
                      double a_row) {
  double slots = a_pair * (double)r->n.pairs + a_row * BLOCK_PX * (double)r->n.block_rows;
  double ms = peak->flop_per_s > 0 ? 1e3 * slots / (0.5 * peak->flop_per_s) : 0;
  return ms > r->stage_bound_ms[stage] ? ms - r->stage_bound_ms[stage] : 0;
}

// A step's share of the time of errors.
static double errors_ms(const sv_bench_step *r, const sv_bench_peak *peak) {
  double flop =
      ERROR_FLOP * ((double)r->n.pairs + 3.0 * r->n.n_pixels) + ERROR_RECORD_FLOP * r->n.n_intersections;
  return peak->flop_per_s > 0 ? 1e3 * flop / peak->flop_per_s / SV_TRAIN_ERROR_EVERY : 0;
}

void sv_bench_bound(sv_bench_step *r, const sv_bench_peak *peak) {
  const double probes = r->n.n_probe_steps > 0 ? 1.0 / r->n.n_probe_steps : 0, // a step,
      // Each on half of the tiles
      blended = 0.5 * probes;
  const double flop = sv_bench_cost_of(SV_BENCH_RASTER, &r->n).flop +
                      (1 + blended) * sv_bench_cost_of(SV_BENCH_RASTER_BWD, &r->n).flop;
  const double arrays_bytes = sv_bench_arrays_bytes(&r->n);
  r->bound_ms = 0;
  for (int s = 0; s < SV_N_STAGES; s++) {
    r->stage_bound_ms[s] = 0;
    for (int i = 0; i < 2; i++) {
      const double share = s != SV_STAGE_CURVATURE               ? 1
                           : ops_of[s][i] == SV_BENCH_RASTER_BWD ? blended
                                                                 : probes;
      const sv_bench_cost cost = sv_bench_cost_of(ops_of[s][i], &r->n);
      r->stage_bound_ms[s] += 1e3 * share * sv_bench_bound_s(peak, cost, arrays_bytes);
    }
    if (s == SV_STAGE_RASTER_BWD) r->stage_bound_ms[s] += errors_ms(r, peak);
    r->bound_ms += r->stage_bound_ms[s];
  }
  r->pixel_bound_ms = peak->flop_per_s > 0 ? 1e3 * flop / peak->flop_per_s : 0;
  r->slot_bound_ms =
      r->bound_ms + more_ms(r, peak, SV_STAGE_RASTER, FORWARD_SLOTS, FORWARD_ROW_SLOTS) +
      (1 + blended) * more_ms(r, peak, SV_STAGE_RASTER_BWD, BACKWARD_SLOTS, BACKWARD_ROW_SLOTS);
}

// --- useful lanes --------------------------------------------------------------------------------

// Light that a splat leaves of t at a pixel; negative when the pixel stops. *blended: whether it
// took part.
static float blend(const sv_splat *s, float dx, float dy, float t, bool *blended) {
  float power = s->qa * dx * dx + s->qb * dx * dy + s->qc * dy * dy + s->lo;
  *blended = false;
  if (t < SV_T_MIN || power < SV_POWER_MIN) return t;
  float a = (float)sv_exp((double)(power + SV_POWER_SHIFT) * 0.693147180559945);
  if (a > SV_ALPHA_MAX) a = SV_ALPHA_MAX;
  *blended = true;
  return t * (1.0f - a);
}

// Pixel by pixel of a splat on a tile, whatever shapes the kernels work on.
static uint64_t count_useful(const sv_renderer *r, const sv_splat *s, int tx, int ty) {
  const int x0 = sv_maxi(4 * s->bx0, SV_TILE_PX * tx), x1 = sv_mini(4 * s->bx1 + 4, SV_TILE_PX * (tx + 1));
  const int y0 = sv_maxi(4 * s->by0, SV_TILE_PX * ty), y1 = sv_mini(4 * s->by1 + 4, SV_TILE_PX * (ty + 1));
  uint64_t n = 0;
  for (int y = y0; y < y1 && y < r->rgb.height_px; y++)
    for (int x = x0; x < x1 && x < r->rgb.width_px; x++) {
      float *t = r->depth + (size_t)y * (size_t)r->rgb.stride + x;
      bool blended;
      *t = blend(s, s->u_px - ((float)x + 0.5f), s->v_px - ((float)y + 0.5f), *t, &blended);
      n += blended;
    }
  return n;
}

// Rows of the tile that have blocks.
static uint32_t count_rows(uint64_t mask) {
  uint32_t n = 0;
  for (; mask; mask >>= 8) n += (mask & 255) != 0;
  return n;
}

sv_bench_counts sv_bench_count(sv_trainer *t) {
  sv_renderer *r = &t->render;
  sv_bench_counts n = {.pairs = sv_render_count_pairs(r),
                       .n_gaussians = (uint32_t)t->g.n,
                       .n_visible = r->stats.n_visible,
                       .n_intersections = r->stats.n_intersections,
                       .n_pixels = (uint32_t)(r->rgb.width_px * r->rgb.height_px),
                       .n_rows = t->g.n_rows,
                       .n_probe_steps = t->cfg.newton.every};
  for (int i = 0; i < r->rgb.stride * r->rgb.rows_padded; i++) r->depth[i] = 1.0f;
  for (int i = 0; i < t->g.n; i++)
    if (r->splat[i].n_intersections) n.rows += (uint64_t)(r->splat[i].by1 - r->splat[i].by0 + 1);
  for (int k = 0; k < r->n_tiles; k++)
    for (uint32_t i = r->tile_begin[k]; i < r->tile_begin[k + 1]; i++) {
      const sv_intersection *intersection = r->intersection + r->list[i];
      n.useful += count_useful(r, r->splat + intersection->id, k % r->n_tiles_x, k / r->n_tiles_x);
      n.block_rows += count_rows(intersection->mask);
    }
  return n;
}
