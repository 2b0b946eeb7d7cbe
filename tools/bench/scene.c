// SPDX-License-Identifier: Apache-2.0
#include <limits.h>
#include <string.h>

#include "tools/bench/bench.h"
#include "src/base/mathx.h"

#define DISTANCE 4.0
#define DEEP     10.0 // Gaussians over a pixel, counted to one standard deviation

// A camera four units from the scene, which fills its picture.
static sv_view camera(int w, int h) {
  sv_pose p = sv_pose_identity();
  p.t[2] = DISTANCE;
  double f = 0.5 * sv_maxi(w, h) * DISTANCE / 1.3;
  return sv_view_make(w, h, (const double[]){f, f, 0.5 * w, 0.5 * h}, &p);
}

static void fill_gaussians(sv_gaussians *g, uint64_t seed) {
  sv_rng rng = sv_rng_make(seed, 11);
  // n discs of radius r cover an image of area about (2 x 1.2)^2 DEEP times when n pi r^2 = DEEP x
  // area.
  double r = sqrt(DEEP * 5.76 / (SV_PI * g->n));
  for (int i = 0; i < g->n; i++) {
    sv_gaussian v = {.quat_wxyz = {1, 0, 0, 0}};
    double d[3], n;
    do {
      for (int k = 0; k < 3; k++) d[k] = 2 * (double)sv_rng_f(&rng) - 1;
      n = sv_norm3(d);
    } while (!(n > 0.05 && n <= 1));
    double to = i & 1 ? 1.2 : 1.2 * n; // every second one on the surface
    double size = sv_log(r * 0.6) + 0.5 * (double)sv_rng_normal(&rng);
    for (int k = 0; k < 3; k++) v.mean[k] = (float)(d[k] / n * to);
    for (int k = 0; k < 4; k++) v.quat_wxyz[k] = sv_rng_normal(&rng);
    for (int k = 0; k < 3; k++)
      v.log_scale[k] = (float)(size + (k == 2 ? -1.2 : 0.3 * (double)sv_rng_normal(&rng)));
    v.opacity_logit = 6.0f * sv_rng_f(&rng) - 3.0f;
    for (int k = 0; k < 4; k++)
      for (int c = 0; c < 3; c++) v.sh[k][c] = (k ? 0.1f : 1.0f) * sv_rng_normal(&rng);
    sv_gaussians_put(g, i, &v);
  }
}

static void fill_picture(uint8_t *px, int w, int h, uint64_t seed) {
  for (int y = 0; y < h; y++)
    for (int x = 0; x < w; x++)
      for (int c = 0; c < 3; c++) {
        double v = 128 + 80 * sv_sin(0.05 * x * (c + 1) + 0.03 * y) +
                   sv_hash3((uint32_t)x, (uint32_t)y, (uint32_t)seed) % 16;
        *px++ = (uint8_t)(v < 0 ? 0 : v > 255 ? 255 : v);
      }
}

static sv_train_cfg train_cfg(const sv_bench_step *size) {
  sv_train_cfg c = sv_train_defaults();
  c.n_gaussians = size->n_gaussians;
  c.cap_views = 1;
  c.cap_width_px = size->width_px;
  c.cap_height_px = size->height_px;
  c.n_threads = size->n_threads;
  c.relocate_every = INT_MAX;                    // a step without its rare work
  c.newton.first_steps = c.newton.half_from = 0; // as in long runs
  // Nothing moves
  c.lr = (sv_learning_rates){1e-25f, 1e-25f, 1e-25f, 1e-25f, 1e-25f, 1e-25f, 1e-25f};
  c.newton.cap_mean = 1e-25f;
  // nothing may be left out of what is timed
  c.cap_intersections = 64u * (uint32_t)c.n_gaussians + 40000u;
  return c;
}

static size_t picture_bytes(const sv_bench_step *size) {
  return 3 * (size_t)size->width_px * (size_t)size->height_px;
}

size_t sv_bench_scene_bytes(const sv_bench_step *size) {
  sv_train_cfg c = train_cfg(size);
  return sv_trainer_bytes(&c) + sv_init_scratch_bytes(c.n_gaussians, 0) + picture_bytes(size) +
         4 * SV_ARENA_ALIGN;
}

sv_status sv_bench_scene_make(sv_bench_scene *b, const sv_bench_step *size, sv_compute compute, uint64_t seed,
                              sv_arena *a, sv_err *err) {
  sv_train_cfg c = train_cfg(size);
  int w = size->width_px, h = size->height_px;
  c.seed = seed;
  b->picture = SV_TAKE(a, uint8_t, picture_bytes(size));
  sv_arena scratch = sv_arena_sub(a, sv_init_scratch_bytes(c.n_gaussians, 0) + SV_ARENA_ALIGN);
  if (a->status < 0) return sv_fail(err, a->status, "no room for a scene of %d Gaussians", c.n_gaussians);
  sv_status s = sv_trainer_init(&b->t, &c, compute, a, err);
  if (s < 0) return s;
  fill_picture(b->picture, w, h, seed);
  sv_view v = camera(w, h);
  sv_image_u8 im = {.px = b->picture, .width_px = w, .height_px = h, .n_channels = 3, .stride_bytes = 3 * w};
  if ((s = sv_train_add_view(&b->t, &v, &im, err)) < 0) return s;
  sv_init_cfg init = {
      .kind = SV_INIT_SPHERE, .radius = 1.2f, .opacity = 0.1f, .scale_factor = 1, .seed = seed};
  s = sv_train_start(&b->t, &init, NULL, 0, &scratch);
  if (s < 0) return sv_fail(err, s, "a scene of %d Gaussians cannot be started", c.n_gaussians);
  fill_gaussians(&b->t.g, seed);
  return SV_OK;
}
