// SPDX-License-Identifier: Apache-2.0
#include "src/run/selftest.h"

#include <string.h>

#include "src/base/mathx.h"

#define N_STEPS     8
#define N_GAUSSIANS 500
#define WIDTH       93 // not a multiple of 4, 16 or 32
#define HEIGHT      70
#define STRIDE      96

static uint64_t fold(uint64_t h, const void *data, size_t bytes) {
  const uint8_t *p = data;
  for (size_t i = 0; i < bytes; i++) h = (h ^ p[i]) * 1099511628211ull;
  return h;
}

static void noise_picture(uint8_t *px, uint64_t seed) {
  sv_rng rng = sv_rng_make(seed, 5);
  for (int y = 0; y < HEIGHT; y++)
    for (int x = 0; x < WIDTH; x++)
      for (int c = 0; c < 3; c++) {
        int smooth = 128 + (int)(100.0 * sv_sin(0.05 * x * (c + 1)) * sv_cos(0.07 * y));
        px[(y * WIDTH + x) * 3 + c] = (uint8_t)sv_clampi(smooth + (int)sv_rng_below(&rng, 20), 0, 255);
      }
}

static sv_status train(sv_selftest *t, const sv_kernels *k, const sv_pool *pool, sv_arena *a,
                       sv_selftest_line *out) {
  sv_err err;
  sv_train_cfg c = sv_train_defaults();
  c.n_gaussians = N_GAUSSIANS;
  c.sh_degree = 3;
  c.cap_views = 2;
  c.cap_width_px = WIDTH;
  c.cap_height_px = HEIGHT;
  c.start_scale = 1;
  c.weight_tv = 1e-3f;
  c.is_antialiased = true;
  c.relocate_every = 3;
  c.relocate_from = 0;
  size_t mark = sv_arena_mark(a);
  sv_status s = sv_trainer_init(&t->trainer, &c, (sv_compute){k, pool}, a, &err);
  sv_arena scratch = sv_arena_sub(a, sv_init_scratch_bytes(N_GAUSSIANS, 0) + 4096);
  uint8_t *px = SV_TAKE(a, uint8_t, 2 * WIDTH * HEIGHT * 3);
  if (s < 0 || a->status < 0) return SV_E_NOMEM;
  for (int i = 0; i < 2; i++) {
    sv_pose pose;
    double eye[3] = {3, i - 0.5, 0.7}, at[3] = {0, 0, 0}, up[3] = {0, 0, 1};
    if (!sv_pose_look_at(&pose, eye, at, up)) return SV_E_ARG;
    sv_view view = sv_view_make(WIDTH, HEIGHT, (const double[]){90, 91, 47, 34.5}, &pose);
    sv_image_u8 im = {px + i * WIDTH * HEIGHT * 3, WIDTH, HEIGHT, 3, WIDTH * 3};
    noise_picture(px + i * WIDTH * HEIGHT * 3, (uint64_t)i + 1);
    if ((s = sv_train_add_view(&t->trainer, &view, &im, &err)) < 0) return s;
  }
  sv_init_cfg init = {
      .kind = SV_INIT_SPHERE, .radius = 1.0f, .opacity = 0.3f, .scale_factor = 1.0f, .seed = 3};
  if ((s = sv_train_start(&t->trainer, &init, NULL, 0, &scratch)) < 0) return s;
  for (int i = 0; i < N_STEPS; i++) {
    sv_step_stats st;
    // Late in the run, so that all SH degrees take part.
    if ((s = sv_train_step(&t->trainer, 0.7f, &st)) < 0) return s;
    out->loss = st.loss;
  }
  out->digest = sv_train_digest(&t->trainer);
  sv_arena_reset(a, mark);
  return SV_OK;
}

typedef struct {
  uint8_t src[WIDTH * HEIGHT * 3], dst[WIDTH * HEIGHT * 3];
  sv_remap_tap table[WIDTH * HEIGHT];
  float plane[3][STRIDE * HEIGHT], out[STRIDE * HEIGHT], slope[STRIDE * HEIGHT], scratch[STRIDE + 32];
} pictures_work;

static void fill_pictures(pictures_work *w) {
  sv_rng rng = sv_rng_make(17, 3);
  noise_picture(w->src, 9);
  for (int i = 0; i < WIDTH * HEIGHT; i++) {
    bool is_none = sv_rng_below(&rng, 50) == 0;
    w->table[i] = (sv_remap_tap){is_none ? SV_REMAP_NONE : (int16_t)sv_rng_below(&rng, WIDTH),
                                 (int16_t)sv_rng_below(&rng, HEIGHT), (uint8_t)sv_rng_u32(&rng),
                                 (uint8_t)sv_rng_u32(&rng)};
  }
  for (int c = 0; c < 3; c++)
    for (int i = 0; i < STRIDE * HEIGHT; i++) w->plane[c][i] = sv_rng_f(&rng);
}

static uint64_t pictures(const sv_kernels *k, pictures_work *w) {
  uint64_t h = 14695981039346656037ull;
  fill_pictures(w);
  sv_remap_args r = {.src = w->src,
                     .src_width_px = WIDTH,
                     .src_height_px = HEIGHT,
                     .src_stride_bytes = WIDTH * 3,
                     .table = w->table,
                     .dst = w->dst,
                     .dst_width_px = WIDTH,
                     .dst_stride_bytes = WIDTH * 3,
                     .row1 = HEIGHT};
  k->remap(&r);
  h = fold(h, w->dst, sizeof w->dst);
  sv_pack_args p = {.src = {w->plane[0], w->plane[1], w->plane[2]},
                    .width_px = WIDTH,
                    .stride = STRIDE,
                    .dst = w->dst,
                    .dst_stride_bytes = WIDTH * 3,
                    .row1 = HEIGHT};
  k->pack(&p);
  h = fold(h, w->dst, sizeof w->dst);
  sv_curve_args c = {.src = w->plane[0], .dst = w->out, .slope = w->slope, .n = STRIDE * HEIGHT};
  k->srgb_to_linear(&c);
  h = fold(fold(h, w->out, sizeof w->out), w->slope, sizeof w->slope);
  k->linear_to_srgb(&c);
  h = fold(fold(h, w->out, sizeof w->out), w->slope, sizeof w->slope);
  sv_resize_args z = {.src = w->plane[1],
                      .src_width_px = WIDTH,
                      .src_height_px = HEIGHT,
                      .src_stride = STRIDE,
                      .dst = w->out,
                      .dst_width_px = 61,
                      .dst_height_px = 33,
                      .dst_stride = 64,
                      .row1 = 33,
                      .scratch = w->scratch};
  k->resize(&z);
  h = fold(h, w->out, 64 * 33 * sizeof(float));
  z.dst_width_px = WIDTH / 2;
  z.dst_height_px = HEIGHT / 2;
  z.row1 = HEIGHT / 2;
  k->half(&z);
  h = fold(h, w->out, 64 * (HEIGHT / 2) * sizeof(float));
  k->half_bwd(&(sv_half_bwd_args){.grad = w->plane[1],
                                  .width_px = WIDTH / 2,
                                  .stride = STRIDE,
                                  .src_grad = w->out,
                                  .src_stride = STRIDE,
                                  .row1 = HEIGHT / 2});
  return fold(h, w->out, STRIDE * (HEIGHT / 2 * 2) * sizeof(float));
}

static void compare(sv_selftest *t, sv_selftest_line l, const sv_selftest_line *ref, const char *what,
                    bool has_loss) {
  l.what = what;
  l.is_exact = l.isa != SV_ISA_SSE41;
  l.expected = ref->digest;
  l.expected_loss = ref->loss;
  bool is_near = has_loss && fabs(l.loss - ref->loss) < 1e-3 * fabs(ref->loss);
  l.is_ok = l.digest == l.expected || (!l.is_exact && (is_near || !has_loss));
  t->line[t->n_lines++] = l;
  t->n_failed += !l.is_ok;
}

sv_status sv_selftest_run(sv_selftest *t, sv_arena *arena, sv_err *err) {
  sv_pool pool = sv_pool_serial();
  sv_selftest_line training = {0}, picture = {0};
  size_t mark = sv_arena_mark(arena);
  pictures_work *w = SV_TAKE(arena, pictures_work, 1);
  if (!w) return sv_fail(err, SV_E_NOMEM, "the selftest has no room for its pictures");
  t->n_lines = t->n_failed = 0;
  for (int isa = 0; isa < SV_N_ISAS; isa++) {
    sv_kernels k;
    sv_selftest_line l = {.isa = (sv_isa)isa};
    if (!(sv_cpu_isas() & SV_ISA_BIT(isa))) continue;
    sv_kernels_init(&k, sv_isa_only((sv_isa)isa));
    sv_status s = train(t, &k, &pool, arena, &l);
    if (s < 0)
      return sv_fail(err, s, "the selftest could not train with the %s kernels: %s", sv_isa_name((sv_isa)isa),
                     sv_status_text(s));
    if (isa == SV_ISA_REF) training = l;
    else compare(t, l, &training, "training", true);
    l.digest = pictures(&k, w);
    if (isa == SV_ISA_REF) picture = l;
    else compare(t, l, &picture, "pictures", false);
  }
  sv_arena_reset(arena, mark);
  return SV_OK;
}
