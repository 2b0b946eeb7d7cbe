// SPDX-License-Identifier: Apache-2.0
// The kernels of a step, one by one, on the data of a real step.
#include <string.h>

#include "tools/bench/bench.h"
#include "src/base/mathx.h"

#define N_GAUSSIANS 5000
#define N_BLOCKS    ((N_GAUSSIANS + 15) / 16)
#define WIDTH_PX    320
#define HEIGHT_PX   240
#define N_TILES     (WIDTH_PX * HEIGHT_PX / (SV_TILE_PX * SV_TILE_PX) + WIDTH_PX + HEIGHT_PX)
#define CASE_S      0.03

static const sv_bench_step size = {
    .n_gaussians = N_GAUSSIANS, .width_px = WIDTH_PX, .height_px = HEIGHT_PX, .n_threads = 1};

typedef struct {
  sv_trainer *t;
  const sv_kernels *k; // the variant that is timed
  sv_raster_bwd_args bwd;
  sv_newton_args newton;
  float cap[SV_CAP_ROWS]; // 0: nothing moves
  float damping[SV_CAP_ROWS];
  uint32_t *id; // [N_GAUSSIANS] visible ones
  uint32_t *at; // [tiles]
  float *block; // [SV_CAP_ROWS + 1][16]
  const uint8_t *picture;
  sv_bench_counts counts;
} ctx;

static void run_project(ctx *c) { c->k->project(&c->t->render.project, 0, N_BLOCKS, c->t->render.scratch); }
static void run_bin(ctx *c) {
  sv_renderer *r = &c->t->render;
  c->k->bin(r->splat, c->id, r->stats.n_visible, r->n_tiles_x, r->intersection);
}
// The lists of the tiles, from pairs in the order of the records. The slots hold the pairs: they
// are filled again by run_raster_bwd.
static void run_sort(ctx *c) {
  sv_renderer *r = &c->t->render;
  for (int t = 0; t < r->n_tiles; t++) c->at[t] = r->tile_begin[t];
  for (uint32_t i = 0; i < r->stats.n_visible; i++) {
    const sv_splat *s = r->splat + c->id[i];
    const uint32_t key = r->depth_key[c->id[i]];
    for (uint32_t k = s->intersection_offset; k < s->intersection_offset + s->n_intersections; k++)
      if (r->intersection[k].mask) r->pair[c->at[r->intersection[k].tile]++] = (sv_pair){key, k};
  }
  for (int t = 0; t < r->n_tiles; t++)
    c->k->sort(&(sv_sort_args){.pair = r->pair + r->tile_begin[t],
                               .n = c->at[t] - r->tile_begin[t],
                               .tmp = r->tmp + r->tile_begin[t],
                               .hist = (uint32_t *)(void *)r->scratch,
                               .order = r->list + r->tile_begin[t]});
}
static void run_raster(ctx *c) {
  sv_renderer *r = &c->t->render;
  for (uint32_t i = 0; i < (uint32_t)r->n_tiles; i++)
    c->k->raster(&r->raster, i, r->list + r->tile_begin[i], r->tile_begin[i + 1] - r->tile_begin[i],
                 r->scratch);
}
static void run_raster_bwd(ctx *c) {
  sv_renderer *r = &c->t->render;
  for (uint32_t i = 0; i < (uint32_t)r->n_tiles; i++)
    c->k->raster_bwd(&c->bwd, i, r->list + r->tile_begin[i], r->tile_begin[i + 1] - r->tile_begin[i],
                     r->scratch);
}
static void run_project_bwd(ctx *c) {
  for (int b = 0; b < N_BLOCKS; b++)
    sv_render_bwd_block(&c->t->render, b, 0, NULL,
                        &(sv_block_grads){c->block, c->block + 16 * SV_CAP_ROWS, NULL});
}
static void run_newton(ctx *c) {
  sv_gaussians *g = &c->t->g;
  for (int b = 0; b < N_BLOCKS; b++) {
    size_t at = (size_t)b * (size_t)g->n_rows * 16;
    c->k->newton(&c->newton, 0xffff, c->block,
                 &(sv_curvatures){c->t->v + at, sv_train_cross_at(c->t, 16 * b)}, g->param + at,
                 c->t->m + at);
  }
}
static void run_unpack(ctx *c) {
  sv_unpack_args a = {.src = c->picture,
                      .src_stride_bytes = 3 * WIDTH_PX,
                      .n_channels = 3,
                      .width_px = WIDTH_PX,
                      .height_px = HEIGHT_PX,
                      .k = 1,
                      .dst = {c->t->target.c[0], c->t->target.c[1], c->t->target.c[2]},
                      .dst_stride = c->t->target.stride,
                      .row1 = HEIGHT_PX,
                      .scratch = c->t->unpack_scratch};
  c->k->unpack(&a);
}

typedef void (*run_fn)(ctx *c);
// A few rows at a time, as the loss does it: those whose maps, and those that five more on either
// side have, there is room for.
enum { REACH = 5 };
static int band_rows(const ctx *c) { return 2 * c->t->photometric.cap_map_rows - 2 * REACH; }
static sv_ssim_args ssim_args(ctx *c, int channel, int row0) {
  sv_photometric *p = &c->t->photometric;
  const size_t map = (size_t)p->cap_map_rows * (size_t)c->t->target.stride;
  return (sv_ssim_args){.x = c->t->render.rgb.c[channel],
                        .y = c->t->target.c[channel],
                        .width_px = WIDTH_PX,
                        .height_px = HEIGHT_PX,
                        .stride = c->t->target.stride,
                        .row0 = row0 / 2,
                        .row1 = sv_mini(HEIGHT_PX, row0 + band_rows(c)) / 2,
                        .dm1 = p->map,
                        .ds1 = p->map + map,
                        .ds12 = p->map + 2 * map,
                        .map_row0 = row0 / 2,
                        .row_ssim = p->row_ssim,
                        .scratch = p->scratch[0]};
}
static void run_ssim(ctx *c) {
  for (int row = 0; row < HEIGHT_PX; row += band_rows(c))
    for (int i = 0; i < 3; i++) {
      sv_ssim_args a = ssim_args(c, i, row);
      c->k->ssim(&a);
    }
}
static void bwd_band(ctx *c, int channel, int row0) { // of maps that are there
  sv_ssim_args f = ssim_args(c, channel, row0);
  sv_ssim_bwd_args a = {.x = f.x,
                        .y = f.y,
                        .dm1 = f.dm1,
                        .ds1 = f.ds1,
                        .ds12 = f.ds12,
                        .map_row0 = (sv_maxi(0, row0 - REACH) + 1) / 2,
                        .width_px = WIDTH_PX,
                        .height_px = HEIGHT_PX,
                        .stride = f.stride,
                        .row0 = row0,
                        .row1 = sv_mini(HEIGHT_PX, row0 + band_rows(c)),
                        .w_l1 = 0.8f,
                        .w_ssim = -0.2f,
                        .grad = c->t->grad.c[channel],
                        .row_l1 = c->t->photometric.row_l1,
                        .scratch = f.scratch};
  c->k->ssim_bwd(&a);
}
static void run_ssim_bwd(ctx *c) {
  for (int row = 0; row < HEIGHT_PX; row += band_rows(c))
    for (int i = 0; i < 3; i++) bwd_band(c, i, row);
}

typedef void (*run_fn)(ctx *c);

// How each op of a step is run here. The order keeps every op's input whole: binning widens the
// masks again, and projecting forgets which records are whose.
static const struct {
  sv_bench_op op;
  run_fn run;
} cases[] = {{SV_BENCH_SORT, run_sort},
             {SV_BENCH_RASTER, run_raster},
             {SV_BENCH_RASTER_BWD, run_raster_bwd},
             {SV_BENCH_SSIM, run_ssim},
             {SV_BENCH_SSIM_BWD, run_ssim_bwd},
             {SV_BENCH_PROJECT_BWD, run_project_bwd},
             {SV_BENCH_NEWTON, run_newton},
             {SV_BENCH_UNPACK, run_unpack},
             {SV_BENCH_BIN, run_bin},
             {SV_BENCH_PROJECT, run_project}};

static sv_bench_times time_case(sv_bench *b, ctx *c, run_fn run) {
  const sv_clock *clock = &b->cfg.clock;
  double *ns = b->samples.step, sum_ns = 0;
  int n = 0;
  for (; n < SV_BENCH_CAP_SAMPLES && (n < 5 || sum_ns < 1e9 * CASE_S); n++) {
    sv_ns t0 = clock->now_ns(clock->self);
    run(c);
    ns[n] = (double)(clock->now_ns(clock->self) - t0);
    sum_ns += ns[n];
  }
  return sv_bench_times_of(ns + 1, n - 1); // the first warms the caches up
}

static double n_items(sv_bench_op op, const sv_bench_counts *n) {
  switch (op) {
  case SV_BENCH_SORT:
  case SV_BENCH_BIN: return n->n_intersections;
  case SV_BENCH_RASTER:
  case SV_BENCH_RASTER_BWD: return (double)n->pairs;
  case SV_BENCH_UNPACK:
  case SV_BENCH_SSIM:
  case SV_BENCH_SSIM_BWD: return n->n_pixels;
  default: return n->n_gaussians;
  }
}

static void time_all(sv_bench *b, ctx *c, sv_isa isa) {
  for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
    sv_bench_op op = cases[i].op;
    if (!sv_kernel_exists(sv_bench_op_name(op), isa)) continue;
    double items = n_items(op, &c->counts), per = items > 0 ? 1 / items : 0;
    sv_bench_cost cost = sv_bench_cost_of(op, &c->counts);
    sv_bench_times t = time_case(b, c, cases[i].run);
    sv_bench_kernel r = {.op = op,
                         .isa = isa,
                         .ns = {t.median * per, t.least * per, t.q1 * per, t.q3 * per},
                         .cost = {cost.flop * per, cost.bytes * per}};
    sv_bench_put_kernel(b, &r);
  }
}

#define BLOCK_FLOATS ((SV_CAP_ROWS + 1) * 16)

size_t sv_bench_kernel_bytes(void) {
  return sv_bench_scene_bytes(&size) + (N_GAUSSIANS + N_TILES) * sizeof(uint32_t) +
         BLOCK_FLOATS * sizeof(float) + 3 * SV_ARENA_ALIGN;
}

static void list_visible(ctx *c) {
  const sv_renderer *r = &c->t->render;
  uint32_t n = 0;
  for (uint32_t i = 0; i < N_GAUSSIANS; i++) {
    if (!r->splat[i].n_intersections) continue;
    c->id[n++] = i;
  }
}

// One real step leaves the data that the kernels are timed on.
static sv_status prepare(ctx *c, sv_bench_scene *scene, sv_arena *a, sv_err *err) {
  sv_trainer *t = &scene->t;
  sv_step_stats st;
  c->id = SV_TAKE(a, uint32_t, N_GAUSSIANS);
  c->at = SV_TAKE(a, uint32_t, N_TILES);
  c->block = SV_TAKE(a, float, BLOCK_FLOATS);
  if (a->status < 0) return sv_fail(err, a->status, "no room to time the kernels");
  memset(c->block, 0, BLOCK_FLOATS * sizeof(float));
  sv_status s = sv_train_step(t, 1.0f, &st);
  if (s < 0) return sv_fail(err, s, "the step to be timed failed");
  c->counts = sv_bench_count(t);
  c->counts.n_touched = st.n_touched;
  c->t = t;
  list_visible(c);
  c->picture = scene->picture;
  c->bwd = (sv_raster_bwd_args){.fwd = &t->render.raster,
                                .g_rgb = {t->grad.c[0], t->grad.c[1], t->grad.c[2]},
                                .igrad = t->render.igrad};
  for (int i = 0; i < SV_CAP_ROWS; i++) c->damping[i] = 1;
  c->newton = (sv_newton_args){.beta1 = 0.9f,
                               .rate = 0.1f,
                               .damping = c->damping,
                               .cap_mean = 1e-25f,
                               .cap = c->cap,
                               .n_rows = t->g.n_rows};
  return SV_OK;
}

static sv_status time_variant(sv_bench *b, sv_isa isa, sv_err *err) {
  sv_kernels k;
  sv_pool serial = sv_pool_serial();
  ctx c = {.k = &k};
  size_t mark = sv_arena_mark(b->arena);
  sv_kernels_init(&k, sv_isa_only(isa));
  sv_status s = sv_bench_scene_make(&b->scene, &size, (sv_compute){&k, &serial}, b->cfg.seed, b->arena, err);
  if (s >= 0) s = prepare(&c, &b->scene, b->arena, err);
  if (s >= 0) time_all(b, &c, isa);
  sv_arena_reset(b->arena, mark);
  return s < 0 ? s : SV_OK;
}

sv_status sv_bench_kernels(sv_bench *b, sv_err *err) {
  bool has_room = sv_bench_kernel_bytes() <= b->arena->cap_bytes - b->arena->used_bytes;
  sv_bench_put_kernels_begin(b);
  if (!has_room) {
    sv_bench_step all = size;
    all.bytes = sv_bench_kernel_bytes();
    sv_bench_put_skipped(b, &all);
    return SV_OK;
  }
  for (int isa = 0; isa < SV_N_ISAS; isa++) {
    if (!(b->cfg.isa_mask & sv_cpu_isas() & SV_ISA_BIT(isa))) continue;
    if (b->cfg.console.is_stop_requested(b->cfg.console.self))
      return sv_fail(err, SV_E_INTERRUPTED, "stopped by request");
    sv_status s = time_variant(b, (sv_isa)isa, err);
    if (s < 0) return s;
  }
  return SV_OK;
}
