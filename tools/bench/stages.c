// SPDX-License-Identifier: Apache-2.0
// One step taken apart: its stages between two looks at the clock.
#include "tools/bench/bench.h"
#include "src/base/mathx.h"
#include "src/train/curvature.h"
#include "src/train/optimize.h"

#define CASE_S   0.5  // a case is repeated for so long,
#define LEAST    5    // and at least so often
#define PROGRESS 0.5f // full size, all SH degrees, and exploration: what most steps are
#define RANGE    32   // blocks a task, as sv_render projects
#define ROWS     16   // of pixels a task

typedef struct {
  sv_trainer *t;
  const sv_kernels *k;
} job;

static void unpack_task(void *arg, int i_task, int i_thread) {
  const job *j = arg;
  sv_trainer *t = j->t;
  const sv_image_u8 *im = &t->views[0].image;
  sv_unpack_args a = {.src = im->px,
                      .src_stride_bytes = (size_t)im->stride_bytes,
                      .n_channels = im->n_channels,
                      .width_px = im->width_px,
                      .height_px = im->height_px,
                      .k = 1,
                      .dst = {t->target.c[0], t->target.c[1], t->target.c[2]},
                      .dst_stride = t->target.stride,
                      .row0 = i_task * ROWS,
                      .row1 = sv_mini(i_task * ROWS + ROWS, im->height_px)};
  a.scratch = t->unpack_scratch + (size_t)i_thread * SV_UNPACK_SCRATCH_FLOATS((size_t)t->cfg.cap_width_px);
  j->k->unpack(&a);
}

static float *scratch_of(const sv_renderer *r, int i_thread) {
  return r->scratch + (size_t)i_thread * SV_RASTER_SCRATCH_FLOATS;
}

static void project_task(void *arg, int i_task, int i_thread) {
  const job *j = arg;
  const sv_renderer *r = &j->t->render;
  int n = (j->t->g.n + 15) / 16, b0 = i_task * RANGE;
  j->k->project(&r->project, b0, sv_mini(b0 + RANGE, n), scratch_of(r, i_thread));
}

static void raster_task(void *arg, int i_task, int i_thread) {
  const job *j = arg;
  const sv_renderer *r = &j->t->render;
  uint32_t tile = r->tile_order[i_task], at = r->tile_begin[tile];
  j->k->raster(&r->raster, tile, r->list + at, r->tile_begin[tile + 1] - at, scratch_of(r, i_thread));
}

static double now_ms(const sv_bench *b) { return sv_ns_to_ms(b->cfg.clock.now_ns(b->cfg.clock.self)); }

// A rendering, then two of its stages again on what it left.
static sv_status time_render(sv_bench *b, const sv_pool *pool, const sv_render_options *o, job *j, int i) {
  sv_trainer *t = j->t;
  sv_bench_samples *m = &b->samples;
  double t0 = now_ms(b);
  sv_status s = sv_render(&t->render, &t->g, &t->views[0].view, o);
  double t1 = now_ms(b);
  if (s < 0) return s;
  sv_pool_run(pool, raster_task, j, t->render.n_tiles);
  double t2 = now_ms(b);
  sv_pool_run(pool, project_task, j, ((t->g.n + 15) / 16 + RANGE - 1) / RANGE);
  double t3 = now_ms(b);
  m->render[i] = t1 - t0;
  m->stage[SV_STAGE_RASTER][i] = t2 - t1;
  m->stage[SV_STAGE_PROJECT][i] = t3 - t2;
  return SV_OK;
}

// The rest of a step, in its order. The projection that time_render left has no records: it renders
// again.
static sv_status time_rest(sv_bench *b, const sv_pool *pool, const sv_render_options *o, job *j, int i,
                           uint32_t *n_touched) {
  sv_trainer *t = j->t;
  sv_bench_samples *m = &b->samples;
  double t0 = now_ms(b);
  sv_pool_run(pool, unpack_task, j, (t->views[0].image.height_px + ROWS - 1) / ROWS);
  double t1 = now_ms(b);
  sv_status s = sv_render(&t->render, &t->g, &t->views[0].view, o);
  if (s < 0) return s;
  double t2 = now_ms(b);
  float *const errors = sv_train_is_error_due(t, PROGRESS) ? t->err_plane : NULL;
  sv_photometric_loss(&t->photometric, &t->render.rgb, &t->target, &t->grad, errors, t->cfg.weight_ssim);
  double t3 = now_ms(b);
  m->stage[SV_STAGE_LOSS][i] = t3 - t2;
  s = sv_train_curvature(t, &(sv_train_residual){.l1 = 0.1}, &t->target);
  m->stage[SV_STAGE_CURVATURE][i] = (now_ms(b) - t3) / t->cfg.newton.every;
  if (s < 0) return s;
  t3 = now_ms(b);
  s = sv_render_bwd(&t->render, &t->grad, NULL, NULL, errors);
  double t4 = now_ms(b);
  if (s < 0) return s;
  *n_touched = sv_train_optimise(t, PROGRESS);
  double t5 = now_ms(b);
  m->stage[SV_STAGE_TARGET][i] = t1 - t0;
  m->stage[SV_STAGE_RASTER_BWD][i] = t4 - t3;
  m->stage[SV_STAGE_OPTIMISE][i] = t5 - t4;
  return SV_OK;
}

// What remains of a rendering: of its times, as single samples differ by more than this stage
// takes.
static double rest(double render, double raster, double project) {
  double r = render - raster - project;
  return r > 0 ? r : 0;
}

static void find_order(sv_bench_step *r) {
  const sv_bench_times *a = &r->render_ms, *b = &r->stage_ms[SV_STAGE_RASTER],
                       *c = &r->stage_ms[SV_STAGE_PROJECT];
  r->stage_ms[SV_STAGE_ORDER] = (sv_bench_times){.median = rest(a->median, b->median, c->median),
                                                 .least = rest(a->least, b->least, c->least),
                                                 .q1 = rest(a->q1, b->q1, c->q1),
                                                 .q3 = rest(a->q3, b->q3, c->q3)};
}

sv_status sv_bench_time_scene(sv_bench *b, const sv_pool *pool, sv_bench_step *r) {
  sv_trainer *t = &b->scene.t;
  sv_render_options o = sv_train_render_options(t, PROGRESS, false);
  sv_bench_samples *m = &b->samples;
  job j = {.t = t, .k = b->cfg.k};
  uint32_t n_touched = 0;
  double begin = now_ms(b);
  int n = 0;
  for (; n < SV_BENCH_CAP_SAMPLES && (n < LEAST || now_ms(b) - begin < 1e3 * CASE_S); n++) {
    sv_step_stats st;
    double t0 = now_ms(b);
    sv_status s = SV_OK;
    // As many as have one estimate of the curvature.
    for (int i = 0; i < t->cfg.newton.every && s >= 0; i++) s = sv_train_step(t, PROGRESS, &st);
    m->step[n] = (now_ms(b) - t0) / t->cfg.newton.every;
    if (s >= 0 && n == 0) r->n = sv_bench_count(t);
    if (s >= 0) s = time_render(b, pool, &o, &j, n);
    if (s >= 0) s = time_rest(b, pool, &o, &j, n, &n_touched);
    if (s < 0) return s;
  }
  r->n.n_touched = n_touched;
  r->n_samples = n - 1; // the first warms the caches up
  r->step_ms = sv_bench_times_of(m->step + 1, n - 1);
  r->render_ms = sv_bench_times_of(m->render + 1, n - 1);
  for (int k = 0; k < SV_N_STAGES; k++)
    if (k != SV_STAGE_ORDER) r->stage_ms[k] = sv_bench_times_of(m->stage[k] + 1, n - 1);
  find_order(r);
  return SV_OK;
}
