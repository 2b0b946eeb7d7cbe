// SPDX-License-Identifier: Apache-2.0
#include "src/splat/render.h"

#include <string.h>

#include "src/base/mathx.h"
#include "src/base/rng.h"
#include "src/splat/constants.h"
#include "src/splat/surface.h"

#define RANGE 512 // Gaussians projected by one task
#define BATCH 512 // Gaussians binned at a time

#define PAIRS_BYTES (2 * sizeof(sv_pair)) // of an intersection, with the sort's scratch
_Static_assert(PAIRS_BYTES <= SV_IGRAD_BYTES, "pairs and scratch lie in the gradients");

static int n_tiles_of(int w, int h) {
  return (sv_plane_pad(w) / SV_TILE_PX) * (sv_plane_pad(h) / SV_TILE_PX);
}

static size_t cap_pixels_of(const sv_renderer_cfg *cfg) {
  return cfg->cap_pixels ? cfg->cap_pixels : sv_plane_floats(cfg->cap_width_px, cfg->cap_height_px);
}

// Default capacity: 8 intersections for each Gaussian and 64 for each tile. A random start, whose
// splats are large, has about 12 for each Gaussian at the usual sizes.
static uint32_t cap_intersections_of(const sv_renderer_cfg *cfg) {
  if (cfg->cap_intersections) return cfg->cap_intersections;
  size_t by_n = 8 * (size_t)cfg->cap_gaussians, by_px = cap_pixels_of(cfg) / (SV_TILE_PX * SV_TILE_PX) * 64;
  size_t n = by_n + by_px;
  return n > 0x7fffffff ? 0x7fffffff : (uint32_t)n;
}

static void carve(sv_renderer *r, const sv_renderer_cfg *cfg, sv_arena *a) {
  size_t cap = (size_t)(cfg->cap_gaussians + 15) / 16 * 16, px = cap_pixels_of(cfg),
         n = cap_intersections_of(cfg);
  size_t n_tiles = px / (SV_TILE_PX * SV_TILE_PX), padded = n + SV_RENDER_CHUNKS * SV_BIN_SLACK;
  r->splat = SV_TAKE(a, sv_splat, cap);
  r->depth_key = SV_TAKE(a, uint32_t, cap);
  r->n_in_range = SV_TAKE(a, uint32_t, cap / RANGE + 1);
  r->n_intersections_in_range = SV_TAKE(a, uint32_t, cap / RANGE + 1);
  r->dropout_mask = SV_TAKE(a, uint16_t, cap / 16);
  r->intersection = SV_TAKE(a, sv_intersection, padded);
  r->list = SV_TAKE(a, uint32_t, n);
  r->tile_begin = SV_TAKE(a, uint32_t, n_tiles + 1);
  r->tile_order = SV_TAKE(a, uint32_t, n_tiles);
  r->write_offset = SV_TAKE(a, uint32_t, n_tiles * SV_RENDER_CHUNKS);
  r->write_end = SV_TAKE(a, uint32_t, n_tiles * SV_RENDER_CHUNKS);
  // The memory of the per-intersection gradients holds the pairs until they are sorted: the
  // backward pass fills it only then, and has read it before the next forward pass.
  uint8_t *igrad = SV_TAKE(a, uint8_t, cfg->has_grad ? padded * SV_IGRAD_BYTES : n * PAIRS_BYTES);
  r->igrad = cfg->has_grad ? igrad : NULL;
  r->pair = (sv_pair *)(void *)igrad;
  r->tmp = r->pair ? r->pair + n : NULL;
  r->scratch = SV_TAKE(a, float, (size_t)cfg->n_threads *SV_RASTER_SCRATCH_FLOATS);
  for (int c = 0; c < 3; c++) r->rgb.c[c] = SV_TAKE(a, float, px);
  r->depth = SV_TAKE(a, float, px);
  r->trans = SV_TAKE(a, float, px);
}

size_t sv_renderer_bytes(const sv_renderer_cfg *cfg) {
  sv_arena dry = sv_arena_dry();
  sv_renderer r;
  carve(&r, cfg, &dry);
  return dry.used_bytes;
}

sv_status sv_renderer_init(sv_renderer *r, const sv_renderer_cfg *cfg, sv_compute compute, sv_arena *arena) {
  if (cfg->cap_gaussians < 1 || cfg->n_threads < 1 || cfg->cap_width_px < 1 || cfg->cap_height_px < 1 ||
      cfg->cap_width_px > 16384 || cfg->cap_height_px > 16384)
    return SV_E_ARG;
  memset(r, 0, sizeof *r);
  r->cfg = *cfg;
  r->compute = compute;
  r->cfg.cap_pixels = cap_pixels_of(cfg);
  r->cfg.cap_intersections = cap_intersections_of(cfg);
  carve(r, cfg, arena);
  return arena->status < 0 ? arena->status : SV_OK;
}

// One block of scratch serves all stages of a thread.
_Static_assert(SV_PROJECT_SCRATCH_FLOATS <= SV_RASTER_SCRATCH_FLOATS, "scratch is too small");
_Static_assert(SV_SURFACE_SCRATCH_FLOATS <= SV_RASTER_SCRATCH_FLOATS, "scratch is too small");
_Static_assert(SV_SORT_CAP_BUCKETS <= SV_RASTER_SCRATCH_FLOATS, "scratch is too small");
static float *thread_scratch(const sv_renderer *r, int i_thread) {
  return r->scratch + (size_t)i_thread * SV_RASTER_SCRATCH_FLOATS;
}

// --- forward -------------------------------------------------------------------------------------

typedef struct {
  sv_renderer *r;
  const sv_kernels *k;
  const sv_raster_bwd_args *bwd;
  int n_blocks, n_ranges;
  int dropout; // in steps of 1 / DROPOUT_STEPS
  uint32_t dropout_seed;
  uint32_t colour; // backward on half of the tiles: theirs
} job;

#define DROPOUT_BITS  8
#define DROPOUT_STEPS (1 << DROPOUT_BITS)

// Sixteen bits, each set with probability share / DROPOUT_STEPS. From the last digit of share on, a
// random bit halves the probability, and adds a half where the digit is 1.
static uint16_t draw16(int share, uint32_t block, uint32_t seed) {
  uint32_t bits = 0;
  for (uint32_t digit = 0; digit < DROPOUT_BITS; digit++) {
    const uint32_t random = sv_hash3(block, seed, digit);
    bits = share >> digit & 1 ? bits | random : bits & random;
  }
  return (uint16_t)bits;
}

static void project_task(void *arg, int i_task, int i_thread) {
  job *j = arg;
  sv_renderer *r = j->r;
  int b0 = i_task * (RANGE / 16), b1 = b0 + RANGE / 16;
  if (b1 > j->n_blocks) b1 = j->n_blocks;
  int moved = b1 < r->n_moved_blocks ? b1 : r->n_moved_blocks;
  sv_project_counts n = {0, 0}, rest = {0, 0};
  for (int b = b0; b < b1 && j->dropout > 0; b++)
    r->dropout_mask[b] = draw16(j->dropout, (uint32_t)b, j->dropout_seed);
  if (b0 < moved) n = j->k->project(&r->moved, b0, moved, thread_scratch(r, i_thread));
  if (moved < b1) rest = j->k->project(&r->project, b0 > moved ? b0 : moved, b1, thread_scratch(r, i_thread));
  r->n_in_range[i_task] = n.n_visible + rest.n_visible;
  r->n_intersections_in_range[i_task] = n.n_intersections + rest.n_intersections;
}

// Ranges [range_begin(c), range_begin(c + 1)) belong to chunk c.
static int range_begin(const job *j, int chunk) {
  return sv_pool_share(j->n_ranges, chunk, SV_RENDER_CHUNKS);
}

static void gaussians_of(const job *j, int chunk, uint32_t *begin, uint32_t *end) {
  const uint32_t n = 16 * (uint32_t)j->n_blocks;
  *begin = (uint32_t)range_begin(j, chunk) * RANGE;
  *end = (uint32_t)range_begin(j, chunk + 1) * RANGE;
  if (*end > n) *end = n;
}

// Intersections of all ranges. Those of a chunk follow the previous chunk's and the binning's
// padding.
static uint64_t add_up(job *j) {
  sv_renderer *r = j->r;
  uint64_t sum = 0;
  r->stats.n_visible = 0;
  for (int c = 0; c < SV_RENDER_CHUNKS; c++) {
    r->chunk_begin[c] = (uint32_t)sum + (uint32_t)c * SV_BIN_SLACK;
    for (int i = range_begin(j, c); i < range_begin(j, c + 1); i++) {
      sum += r->n_intersections_in_range[i];
      r->stats.n_visible += r->n_in_range[i];
    }
  }
  r->chunk_begin[SV_RENDER_CHUNKS] = (uint32_t)sum + SV_RENDER_CHUNKS * SV_BIN_SLACK;
  return sum;
}

// When there are more intersections than memory, the farthest splats are dropped: in the order of
// depth, then index, all from the first one that does not fit. A radix search finds its depth, then
// a scan its index. This is rare, so one thread does it.
static void drop_farthest(job *j) {
  enum { DIGIT = 8, DIGITS = 1 << DIGIT };
  sv_renderer *r = j->r;
  const uint32_t n = 16 * (uint32_t)j->n_blocks;
  uint64_t left = r->cfg.cap_intersections, sum[DIGITS];
  uint32_t key = 0, known = 0; // the digits that are known, and their mask
  for (int shift = 32 - DIGIT; shift >= 0; shift -= DIGIT) {
    uint32_t d = 0;
    memset(sum, 0, sizeof sum);
    for (uint32_t i = 0; i < n; i++)
      if (r->splat[i].n_intersections && (r->depth_key[i] & known) == key)
        sum[r->depth_key[i] >> shift & (DIGITS - 1)] += r->splat[i].n_intersections;
    for (; d < DIGITS - 1 && sum[d] <= left; d++) left -= sum[d];
    key |= d << shift;
    known |= (uint32_t)(DIGITS - 1) << shift;
  }
  bool is_full = false;
  for (uint32_t i = 0; i < n; i++) {
    sv_splat *s = r->splat + i;
    if (!s->n_intersections || r->depth_key[i] < key) continue;
    if (r->depth_key[i] == key && !is_full && s->n_intersections <= left) {
      left -= s->n_intersections;
      continue;
    }
    is_full = is_full || r->depth_key[i] == key;
    r->n_intersections_in_range[i / RANGE] -= s->n_intersections;
    r->stats.n_dropped++;
    s->n_intersections = 0;
  }
}

// Intersections with their block masks, and the count of each tile, for a batch of Gaussians that
// fits into the nearest cache.
static void bin_task(void *arg, int c, int i_thread) {
  job *j = arg;
  sv_renderer *r = j->r;
  uint32_t at = r->chunk_begin[c], intersection = at, i, end, id[BATCH];
  uint32_t *count = r->write_offset + (size_t)c * (size_t)r->n_tiles;
  (void)i_thread;
  gaussians_of(j, c, &i, &end);
  memset(count, 0, (size_t)r->n_tiles * sizeof *count);
  while (i < end) {
    uint32_t n = 0;
    for (const uint32_t last = i + BATCH < end ? i + BATCH : end; i < last; i++) {
      sv_splat *s = r->splat + i;
      s->intersection_offset = at;
      at += s->n_intersections;
      id[n] = i; // kept when it is visible, which cannot be predicted
      n += s->n_intersections != 0;
    }
    j->k->bin(r->splat, id, n, r->n_tiles_x, r->intersection);
    for (; intersection < at; intersection++)
      count[r->intersection[intersection].tile] += r->intersection[intersection].mask != 0;
  }
}

// Prefetches the lines that the chunk's pairs are written to: gradients were there since, and a
// store to a missing line stalls the stores behind it. Always inline: compilers drop calls of a
// function that only prefetches.
static inline __attribute__((always_inline)) void prefetch_pairs(const sv_renderer *r, int c) {
  const uint32_t *at = r->write_offset + (size_t)c * (size_t)r->n_tiles;
  const uint32_t *end = r->write_end + (size_t)c * (size_t)r->n_tiles;
  for (int t = 0; t < r->n_tiles; t++)
    for (uint32_t p = at[t]; p < end[t]; p += 64 / sizeof(sv_pair)) __builtin_prefetch(r->pair + p, 1);
}

static void scatter_task(void *arg, int c, int i_thread) {
  job *j = arg;
  sv_renderer *r = j->r;
  uint32_t *at = r->write_offset + (size_t)c * (size_t)r->n_tiles;
  (void)i_thread;
  prefetch_pairs(r, c);
  for (uint32_t i = r->chunk_begin[c]; i < r->chunk_begin[c + 1] - SV_BIN_SLACK; i++) {
    const sv_intersection *intersection = r->intersection + i;
    if (intersection->mask) r->pair[at[intersection->tile]++] = (sv_pair){r->depth_key[intersection->id], i};
  }
}

// Counts per (chunk, tile) -> write positions: tile by tile, chunks in the order of their
// Gaussians.
static void place_tiles(sv_renderer *r) {
  const size_t n_tiles = (size_t)r->n_tiles;
  uint32_t *begin = r->tile_begin, sum = 0;
  memset(begin, 0, (n_tiles + 1) * sizeof *begin);
  for (size_t c = 0; c < SV_RENDER_CHUNKS; c++)
    for (size_t t = 0; t < n_tiles; t++) begin[t] += r->write_offset[c * n_tiles + t];
  for (size_t t = 0; t <= n_tiles; t++) {
    const uint32_t n = begin[t];
    begin[t] = sum;
    sum += n;
  }
  const uint32_t *from = begin; // where the chunk in front ends
  for (size_t c = 0; c < SV_RENDER_CHUNKS; c++) {
    uint32_t *at = r->write_offset + c * n_tiles, *end = r->write_end + c * n_tiles;
    for (size_t t = 0; t < n_tiles; t++) {
      end[t] = from[t] + at[t];
      at[t] = from[t];
    }
    from = end;
  }
}

static void bin_all(job *j) {
  sv_renderer *r = j->r;
  const sv_pool *pool = r->compute.pool;
  r->stats.n_dropped = 0;
  if (add_up(j) > r->cfg.cap_intersections) {
    drop_farthest(j);
    (void)add_up(j);
  }
  sv_pool_run(pool, bin_task, j, SV_RENDER_CHUNKS);
  place_tiles(r);
  sv_pool_run(pool, scatter_task, j, SV_RENDER_CHUNKS);
  r->stats.n_intersections = r->tile_begin[r->n_tiles];
}

// Steps of a quarter octave: the longest lists first.
static uint32_t length_bucket(uint32_t n) {
  if (n < 4) return 131 - n;
  const uint32_t zeros = (uint32_t)__builtin_clz(n), next = n << zeros >> 29 & 3;
  return 4 * zeros + 3 - next;
}

// Each thread begins with tiles that lie together, as they share splats, the longest lists first;
// it helps others out from the end, where lists are short, so that all are done at the same time.
static void order_share(sv_renderer *r, int begin, int end) {
  uint32_t count[132] = {0};
  for (int t = begin; t < end; t++) count[length_bucket(r->tile_begin[t + 1] - r->tile_begin[t])]++;
  for (uint32_t b = 0, sum = (uint32_t)begin; b < 132; b++) {
    uint32_t n = count[b];
    count[b] = sum;
    sum += n;
  }
  for (int t = begin; t < end; t++)
    r->tile_order[count[length_bucket(r->tile_begin[t + 1] - r->tile_begin[t])]++] = (uint32_t)t;
}

static void order_tiles(sv_renderer *r, int n_threads) {
  for (int k = 0; k < n_threads; k++)
    order_share(r, sv_pool_share(r->n_tiles, k, n_threads), sv_pool_share(r->n_tiles, k + 1, n_threads));
}

// Pairs that the sort can move to and fro within a thread's scratch, behind its buckets; most lists
// are shorter.
#define NEAR_PAIRS                                                                                           \
  ((uint32_t)((SV_RASTER_SCRATCH_FLOATS - SV_SORT_CAP_BUCKETS) * sizeof(float) / sizeof(sv_pair)))

// Front to back, equal depths by index: the sort is stable.
static void raster_task(void *arg, int i_task, int i_thread) {
  job *j = arg;
  sv_renderer *r = j->r;
  const uint32_t t = r->tile_order[i_task], begin = r->tile_begin[t], n = r->tile_begin[t + 1] - begin;
  float *scratch = thread_scratch(r, i_thread);
  j->k->sort(&(sv_sort_args){.pair = r->pair + begin,
                             .n = n,
                             .tmp = n <= NEAR_PAIRS ? (sv_pair *)(void *)(scratch + SV_SORT_CAP_BUCKETS)
                                                    : r->tmp + begin,
                             .hist = (uint32_t *)(void *)scratch,
                             .order = r->list + begin});
  j->k->raster(&r->raster, t, r->list + begin, n, scratch);
}

static sv_kview make_kview(const sv_view *v, const sv_render_options *o) {
  sv_kview k = {.width_px = v->width_px,
                .height_px = v->height_px,
                .fx = v->fx,
                .fy = v->fy,
                .cx = v->cx,
                .cy = v->cy,
                .near_z = o->near_z,
                .dilation_px2 = o->dilation_px2 > 0.0f ? o->dilation_px2 : SV_DILATION_PX2,
                .is_antialiased = o->is_antialiased,
                .fisheye = v->fisheye};
  memcpy(k.r, v->r, sizeof k.r);
  memcpy(k.t, v->t, sizeof k.t);
  sv_view_centre(k.centre, v);
  sv_kview_set_limits(&k);
  return k;
}

// Opacity compensation of dropout: keeps the mean transmittance.
static float log2_compensation(int dropout) {
  const double kept = 1.0 - (double)dropout / DROPOUT_STEPS;
  return dropout > 0 ? (float)(-sv_log(kept) / 0.6931471805599453) : 0.0f;
}

static sv_status set_size(sv_renderer *r, int w, int h) {
  size_t px = sv_plane_floats(w, h);
  if (w < 1 || h < 1 || w > r->cfg.cap_width_px || h > r->cfg.cap_height_px || px > r->cfg.cap_pixels)
    return SV_E_RANGE;
  r->rgb.width_px = w;
  r->rgb.height_px = h;
  r->rgb.stride = sv_plane_pad(w);
  r->rgb.rows_padded = sv_plane_pad(h);
  r->n_tiles_x = r->rgb.stride / SV_TILE_PX;
  r->n_tiles = n_tiles_of(w, h);
  return SV_OK;
}

sv_status sv_render(sv_renderer *r, const sv_gaussians *g, const sv_view *view, const sv_render_options *o) {
  const sv_pool *pool = r->compute.pool;
  sv_status s = set_size(r, view->width_px, view->height_px);
  if (s < 0) return s;
  if (g->n > r->cfg.cap_gaussians || pool->n_threads > r->cfg.n_threads) return SV_E_RANGE;
  const int dropout = sv_mini((int)(o->dropout * DROPOUT_STEPS + 0.5f), DROPOUT_STEPS - 1);
  r->project = (sv_project_args){.param = g->param,
                                 .n_rows = g->n_rows,
                                 .sh_degree = o->sh_degree < g->sh_degree ? o->sh_degree : g->sh_degree,
                                 .n_gaussians = g->n,
                                 .view = make_kview(view, o),
                                 .splat = r->splat,
                                 .depth_key = r->depth_key,
                                 .dropout_mask = dropout > 0 ? r->dropout_mask : NULL,
                                 .log2_compensation = log2_compensation(dropout)};
  r->moved = r->project;
  r->moved.param = g->moved;
  r->n_moved_blocks = g->moved ? (g->n_moved + 15) / 16 : 0;
  job j = {.r = r,
           .k = r->compute.k,
           .n_blocks = (g->n + 15) / 16,
           .n_ranges = (g->n + RANGE - 1) / RANGE,
           .dropout = dropout,
           .dropout_seed = o->dropout_seed};
  sv_pool_run(pool, project_task, &j, j.n_ranges);
  bin_all(&j);
  order_tiles(r, pool->n_threads);
  r->raster = (sv_raster_args){.splat = r->splat,
                               .intersection = r->intersection,
                               .n_tiles_x = r->n_tiles_x,
                               .stride = r->rgb.stride,
                               .bg = {o->bg[0], o->bg[1], o->bg[2]},
                               .rgb = {r->rgb.c[0], r->rgb.c[1], r->rgb.c[2]},
                               .depth = o->has_depth ? r->depth : NULL,
                               .trans = o->has_depth ? r->trans : NULL};
  sv_pool_run(pool, raster_task, &j, r->n_tiles);
  return SV_OK;
}

// --- backward ------------------------------------------------------------------------------------

static void raster_bwd_task(void *arg, int i_task, int i_thread) {
  job *j = arg;
  sv_renderer *r = j->r;
  uint32_t t = r->tile_order[i_task], begin = r->tile_begin[t];
  j->k->raster_bwd(j->bwd, t, r->list + begin, r->tile_begin[t + 1] - begin, thread_scratch(r, i_thread));
}

// Gaussians in such tiles alone count as touched, with gradients of 0. Gradients of intersections
// without a mask are undefined.
static void clear_gradients(sv_renderer *r, uint32_t tile) {
  for (uint32_t i = r->tile_begin[tile]; i < r->tile_begin[tile + 1]; i++)
    memset(r->igrad + (size_t)r->list[i] * SV_IGRAD_BYTES, 0, SV_IGRAD_BYTES);
}

static bool is_of_colour(const sv_renderer *r, uint32_t tile, uint32_t colour) {
  const uint32_t n_x = (uint32_t)r->n_tiles_x;
  return ((tile / n_x + tile % n_x) & 1) == colour;
}

static void raster_bwd_half_task(void *arg, int i_task, int i_thread) {
  job *j = arg;
  const uint32_t tile = j->r->tile_order[i_task];
  if (is_of_colour(j->r, tile, j->colour)) raster_bwd_task(arg, i_task, i_thread);
  else clear_gradients(j->r, tile);
}

sv_status sv_render_bwd(sv_renderer *r, const sv_planes *g_rgb, const float *g_depth, const float *g_trans,
                        const float *err) {
  if (!r->igrad || g_rgb->stride != r->rgb.stride || g_rgb->rows_padded != r->rgb.rows_padded)
    return SV_E_ARG;
  if ((g_depth || g_trans) && !r->raster.depth) return SV_E_ARG;
  sv_raster_bwd_args a = {.fwd = &r->raster,
                          .g_rgb = {g_rgb->c[0], g_rgb->c[1], g_rgb->c[2]},
                          .g_depth = g_depth,
                          .g_trans = g_trans,
                          .err = err,
                          .igrad = r->igrad};
  job j = {.r = r, .k = r->compute.k, .bwd = &a};
  sv_pool_run(r->compute.pool, raster_bwd_task, &j, r->n_tiles);
  return SV_OK;
}

sv_status sv_render_bwd_half(sv_renderer *r, const sv_planes *g_rgb, uint32_t colour) {
  if (!r->igrad || g_rgb->stride != r->rgb.stride || g_rgb->rows_padded != r->rgb.rows_padded)
    return SV_E_ARG;
  sv_raster_bwd_args a = {
      .fwd = &r->raster, .g_rgb = {g_rgb->c[0], g_rgb->c[1], g_rgb->c[2]}, .igrad = r->igrad};
  job j = {.r = r, .k = r->compute.k, .bwd = &a, .colour = colour};
  sv_pool_run(r->compute.pool, raster_bwd_half_task, &j, r->n_tiles);
  return SV_OK;
}

uint32_t sv_render_bwd_block(const sv_renderer *r, int block, int i_thread, const sv_regularisers *reg,
                             const sv_block_grads *out) {
  sv_project_bwd_args a = {.fwd = block < r->n_moved_blocks ? &r->moved : &r->project,
                           .intersection = r->intersection,
                           .igrad = r->igrad,
                           .pose_grad = out->pose,
                           .reg_opacity = reg ? reg->opacity : 0.0f,
                           .reg_scale = reg ? reg->scale : 0.0f};
  return r->compute.k->project_bwd(&a, block, out->param, out->err, thread_scratch(r, i_thread));
}

uint64_t sv_render_count_pairs(const sv_renderer *r) {
  uint64_t n = 0;
  for (uint32_t i = 0; i < r->stats.n_intersections; i++)
    n += 16u * (uint64_t)__builtin_popcountll(r->intersection[r->list[i]].mask);
  return n;
}

void sv_render_expected_depth(const sv_renderer *r, float alpha_min, float *out) {
  for (int y = 0; y < r->rgb.height_px; y++)
    for (int x = 0; x < r->rgb.width_px; x++) {
      long o = (long)y * r->rgb.stride + x;
      float alpha = 1.0f - r->trans[o];
      out[o] = alpha > alpha_min ? r->depth[o] / (alpha > 1e-10f ? alpha : 1e-10f) : 0.0f;
    }
}

const sv_depth_slab sv_surface_slab = {.from = 0.75f, .to = 0.6f, .near = 0.02f};

typedef struct {
  sv_renderer *r;
  sv_surface surface;
  sv_surface_args args;
} surface_job;

static void slopes_task(void *arg, int i_range, int i_thread) {
  const surface_job *j = arg;
  (void)i_thread;
  sv_surface_slopes(&j->surface, i_range * RANGE, (i_range + 1) * RANGE, j->r->splat);
}

static void surface_task(void *arg, int i_task, int i_thread) {
  const surface_job *j = arg;
  const sv_renderer *r = j->r;
  const uint32_t t = r->tile_order[i_task], begin = r->tile_begin[t];
  r->compute.k->surface(&j->args, t, r->list + begin, r->tile_begin[t + 1] - begin,
                        thread_scratch(r, i_thread));
}

void sv_render_surface(sv_renderer *r, const sv_gaussians *g, const sv_view *view, sv_depth_slab slab,
                       float *out) {
  surface_job j = {.r = r,
                   .surface = {g, view, r->project.view.dilation_px2},
                   .args = {.splat = r->splat,
                            .intersection = r->intersection,
                            .n_tiles_x = r->n_tiles_x,
                            .stride = r->rgb.stride,
                            .from = slab.from,
                            .to = slab.to,
                            .near = slab.near,
                            .depth = out}};
  sv_pool_run(r->compute.pool, slopes_task, &j, (g->n + RANGE - 1) / RANGE);
  sv_pool_run(r->compute.pool, surface_task, &j, r->n_tiles);
}
