// SPDX-License-Identifier: Apache-2.0
// The kernels of a step, one by one, on the data of a real step.
#include <string.h>

#include "src/app/bench.h"
#include "src/base/str.h"

#define N_GAUSSIANS 5000
#define N_BLOCKS    ((N_GAUSSIANS + 15) / 16)
#define WIDTH_PX    320
#define HEIGHT_PX   240
#define CASE_S      0.03

static const sv_bench_step size = {
    .n_gaussians = N_GAUSSIANS, .width_px = WIDTH_PX, .height_px = HEIGHT_PX, .n_threads = 1};

typedef struct {
  sv_trainer *t;
  const sv_kernels *k; // the variant that is timed
  sv_raster_bwd_args bwd;
  sv_adam_args adam;
  float lr[SV_CAP_ROWS];
  sv_pair *pair; // [N_GAUSSIANS]
  float *block;  // [SV_CAP_ROWS + 1][16]
  const uint8_t *picture;
} ctx;

static void run_project(ctx *c) { c->k->project(&c->t->render.project, 0, N_BLOCKS, c->t->render.scratch); }
static void run_bin(ctx *c) {
  sv_renderer *r = &c->t->render;
  c->k->bin(r->splat, r->order, r->stats.n_visible, r->n_tiles_x, r->rec);
}
static void run_sort(ctx *c) {
  sv_renderer *r = &c->t->render;
  for (uint32_t i = 0; i < N_GAUSSIANS; i++) c->pair[i] = (sv_pair){r->depth_key[i], i};
  c->k->sort(c->pair, r->tmp, N_GAUSSIANS, r->hist);
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
    sv_render_bwd_block(&c->t->render, c->k, b, 0, NULL, c->block, c->block + 16 * SV_CAP_ROWS, NULL);
}
static void run_adam(ctx *c) {
  sv_gaussians *g = &c->t->g;
  for (int b = 0; b < N_BLOCKS; b++) {
    size_t at = (size_t)b * (size_t)g->n_rows * 16;
    c->k->adam(&c->adam, 0xffff, c->block, g->param + at, c->t->m + at, c->t->v + at);
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
typedef enum { ITEM_GAUSSIAN, ITEM_RECORD, ITEM_PAIR, ITEM_PIXEL } item_kind;
static const char *const item_names[] = {"Gaussian", "record", "pixel-splat pair", "pixel"};

// How each op of a step is run here; names as in variants.inc. The order keeps every op's input whole.
static const struct {
  const char *op;
  run_fn run;
  item_kind item;
} cases[] = {{"project", run_project, ITEM_GAUSSIAN},
             {"sort", run_sort, ITEM_GAUSSIAN},
             {"raster", run_raster, ITEM_PAIR},
             {"raster_bwd", run_raster_bwd, ITEM_PAIR},
             {"project_bwd", run_project_bwd, ITEM_GAUSSIAN},
             {"unpack", run_unpack, ITEM_PIXEL},
             {"bin", run_bin, ITEM_RECORD},
             {"adam", run_adam, ITEM_GAUSSIAN}};

static double time_case(ctx *c, run_fn run, const sv_clock *clock) {
  double best_ns = 1e30, sum_ns = 0;
  for (int i = 0; i < 1000 && (i < 3 || sum_ns < 1e9 * CASE_S); i++) { // the best: interruptions only add
    sv_ns t0 = clock->now_ns(clock->self);
    run(c);
    double dt = (double)(clock->now_ns(clock->self) - t0);
    sum_ns += dt;
    if (dt < best_ns) best_ns = dt;
  }
  return best_ns;
}

static double n_items(const ctx *c, item_kind item) {
  const sv_renderer *r = &c->t->render;
  switch (item) {
  case ITEM_RECORD: return r->stats.n_recs;
  case ITEM_PAIR: return (double)sv_render_count_pairs(r);
  case ITEM_PIXEL: return WIDTH_PX * HEIGHT_PX;
  default: return N_GAUSSIANS;
  }
}

static void time_all(sv_bench *b, ctx *c, sv_isa isa) {
  for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
    if (!sv_kernel_exists(cases[i].op, isa)) continue;
    double items = n_items(c, cases[i].item), ns = time_case(c, cases[i].run, &b->cfg.clock);
    sv_bench_kernel r = {.op = cases[i].op,
                         .item = item_names[cases[i].item],
                         .isa = isa,
                         .ns_per_item = items > 0 ? ns / items : 0,
                         .is_pairs = cases[i].item == ITEM_PAIR};
    sv_bench_put_kernel(b, &r);
  }
}

#define BLOCK_FLOATS ((SV_CAP_ROWS + 1) * 16)

size_t sv_bench_kernel_bytes(void) {
  return sv_bench_scene_bytes(&size) + N_GAUSSIANS * sizeof(sv_pair) + BLOCK_FLOATS * sizeof(float) +
         2 * SV_ARENA_ALIGN;
}

// One real step leaves the data that the kernels are timed on.
static sv_status prepare(ctx *c, sv_bench_scene *scene, sv_arena *a, sv_err *err) {
  sv_trainer *t = &scene->t;
  sv_step_stats st;
  c->pair = SV_TAKE(a, sv_pair, N_GAUSSIANS);
  c->block = SV_TAKE(a, float, BLOCK_FLOATS);
  if (a->status < 0) return sv_fail(err, a->status, "no room to time the kernels");
  memset(c->block, 0, BLOCK_FLOATS * sizeof(float));
  sv_status s = sv_train_step(t, 1.0f, &st);
  if (s < 0) return sv_fail(err, s, "the step to be timed failed");
  c->t = t;
  c->picture = scene->picture;
  c->bwd = (sv_raster_bwd_args){.fwd = &t->render.raster,
                                .g_rgb = {t->grad.c[0], t->grad.c[1], t->grad.c[2]},
                                .err = t->err_plane,
                                .slot = t->render.slot};
  c->adam = (sv_adam_args){
      .beta1 = 0.9f, .beta2 = 0.999f, .eps = 1e-15f, .rsqrt_bias2 = 1, .lr = c->lr, .n_rows = t->g.n_rows};
  return SV_OK;
}

static sv_status time_variant(sv_bench *b, sv_isa isa, sv_err *err) {
  sv_kernels k;
  sv_pool serial = sv_pool_serial();
  ctx c = {.k = &k};
  size_t mark = sv_arena_mark(b->arena);
  sv_kernels_init(&k, sv_isa_only(isa));
  sv_status s = sv_bench_scene_make(&b->scene, &size, &k, &serial, b->cfg.seed, b->arena, err);
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
