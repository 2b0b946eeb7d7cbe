// SPDX-License-Identifier: Apache-2.0
// The kernels of a step, one by one, on the data of a real step.
#include <stdlib.h>
#include <string.h>

#include "src/base/str.h"
#include "tools/lab/bench.h"

#define N_GAUSSIANS 5000
#define WIDTH_PX    320
#define HEIGHT_PX   240
#define CASE_S      0.03

typedef struct {
  sv_trainer *t;
  const sv_kernels *k; // the variant that is timed
  sv_raster_bwd_args bwd;
  sv_adam_args adam;
  float lr[SV_CAP_ROWS];
  sv_pair *pair;
  sv_planes grad;
  float *block; // [SV_CAP_ROWS + 1][16]
  uint8_t *picture;
} ctx;

static void run_project(ctx *c) {
  c->k->project(&c->t->render.project, 0, (N_GAUSSIANS + 15) / 16, c->t->render.scratch);
}
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
  for (int b = 0; b < (N_GAUSSIANS + 15) / 16; b++)
    sv_render_bwd_block(&c->t->render, c->k, b, 0, NULL, c->block, c->block + 16 * SV_CAP_ROWS, NULL);
}
static void run_adam(ctx *c) {
  sv_gaussians *g = &c->t->g;
  for (int b = 0; b < (N_GAUSSIANS + 15) / 16; b++) {
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

static bool has_variant(const char *op, sv_isa isa) {
  static const struct {
    const char *op;
    sv_isa isa;
  } all[] = {
#define OP(name)                    {#name, SV_ISA_REF},
#define VARIANT(name, lower, upper) {#name, SV_ISA_##upper},
#include "kernels/variants.inc"
#undef OP
#undef VARIANT
  };
  for (size_t i = 0; i < sizeof all / sizeof *all; i++)
    if (all[i].isa == isa && sv_str_eq(all[i].op, op)) return true;
  return false;
}

static double time_case(ctx *c, run_fn run, const sv_clock *clock) {
  double best = 1e9, sum = 0;
  for (int i = 0; i < 1000 && (i < 3 || sum < CASE_S); i++) { // the best: interruptions only add
    sv_ns t0 = clock->now_ns(clock->self);
    run(c);
    double dt = (double)(clock->now_ns(clock->self) - t0);
    sum += 1e-9 * dt;
    if (dt < best) best = dt;
  }
  return best;
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

static void time_all(ctx *c, sv_isa isa, const sv_clock *clock, lab_kernel_time *out, int *n) {
  for (size_t i = 0; i < sizeof cases / sizeof *cases && *n < LAB_CAP_KERNEL_TIMES; i++) {
    if (!has_variant(cases[i].op, isa)) continue;
    double items = n_items(c, cases[i].item), ns = time_case(c, cases[i].run, clock);
    out[(*n)++] = (lab_kernel_time){cases[i].op, sv_isa_name(isa), items > 0 ? ns / items : 0,
                                    item_names[cases[i].item]};
  }
}

static sv_status prepare(ctx *c, lab_bench_scene *b, sv_err *err) {
  sv_step_stats st;
  sv_status s = sv_train_step(&b->t, 1.0f, &st);
  if (s < 0) return sv_fail(err, s, "the step to be timed failed");
  c->t = &b->t;
  c->picture = b->picture;
  c->bwd = (sv_raster_bwd_args){.fwd = &b->t.render.raster,
                                .g_rgb = {b->t.grad.c[0], b->t.grad.c[1], b->t.grad.c[2]},
                                .err = b->t.err_plane,
                                .slot = b->t.render.slot};
  c->adam = (sv_adam_args){
      .beta1 = 0.9f, .beta2 = 0.999f, .eps = 1e-15f, .rsqrt_bias2 = 1, .lr = c->lr, .n_rows = b->t.g.n_rows};
  return SV_OK;
}

sv_status lab_bench_kernels(uint32_t mask, const sv_clock *clock, uint64_t seed, lab_kernel_time *out, int *n,
                            sv_err *err) {
  sv_status s = SV_OK;
  *n = 0;
  for (int isa = 0; isa < SV_N_ISAS && s == SV_OK; isa++) {
    if (!(mask & sv_cpu_isas() & SV_ISA_BIT(isa))) continue;
    sv_kernels k;
    sv_pool serial = sv_pool_serial();
    lab_bench_scene b;
    ctx c = {.k = &k};
    sv_kernels_init(&k, sv_isa_only((sv_isa)isa));
    s = lab_bench_scene_make(&b, &k, &serial, N_GAUSSIANS, WIDTH_PX, HEIGHT_PX, seed, err);
    c.pair = malloc(N_GAUSSIANS * sizeof *c.pair);
    c.block = aligned_alloc(64, (SV_CAP_ROWS + 1) * 16 * sizeof(float));
    if (s == SV_OK && (!c.pair || !c.block)) s = sv_fail(err, SV_E_NOMEM, "no memory to time the kernels");
    if (c.block) memset(c.block, 0, (SV_CAP_ROWS + 1) * 16 * sizeof(float));
    if (s == SV_OK) s = prepare(&c, &b, err);
    if (s == SV_OK) time_all(&c, (sv_isa)isa, clock, out, n);
    free(c.pair);
    free(c.block);
    lab_bench_scene_free(&b);
  }
  return s;
}
