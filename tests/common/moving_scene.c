// SPDX-License-Identifier: Apache-2.0
#include "tests/common/moving_scene.h"

#include "src/train/objective.h"

#include <math.h>
#include <string.h>

#define N_WALL 300
#define N_BALL 60

static uint8_t to_byte(float x) { return (uint8_t)(x <= 0 ? 0 : x >= 1 ? 255 : x * 255 + 0.5f); }

static void place(sv_gaussians *g, float time) {
  sv_rng rng = sv_rng_make(3, 1);
  for (int i = 0; i < N_WALL + N_BALL; i++) {
    bool is_wall = i < N_WALL;
    float u = 2 * sv_rng_f(&rng) - 1, v = 2 * sv_rng_f(&rng) - 1, d = sv_rng_f(&rng);
    sv_gaussian q = {.quat_wxyz = {1, 0, 0, 0}, .opacity_logit = 3};
    q.mean[0] = is_wall ? 1.2f * u : 0.25f * u + 0.6f * (float)sin(3.0 * ((double)time - 0.5));
    q.mean[1] = is_wall ? 1.2f * v : 0.25f * v;
    q.mean[2] = is_wall ? 0.5f : -0.4f + 0.2f * d;
    for (int k = 0; k < 3; k++) q.log_scale[k] = is_wall ? -2.3f : -2.7f;
    q.sh[0][0] = is_wall ? u : 1.5f;
    q.sh[0][1] = is_wall ? v : -1.0f;
    q.sh[0][2] = d - (is_wall ? 0.5f : 1.5f);
    sv_gaussians_put(g, i, &q);
  }
}

static sv_view camera(int i, float time) {
  sv_pose p;
  const double eye[3] = {i ? 0.5 : -0.5, 0, -3}, at[3] = {0, 0, 0}, up[3] = {0, -1, 0};
  (void)sv_pose_look_at(&p, eye, at, up);
  sv_view v = sv_view_make(MS_WIDTH, MS_HEIGHT, (const double[]){70, 70, 32, 32}, &p);
  v.time = time;
  v.i_sub_view = i;
  return v;
}

void moving_scene_make(moving_scene *s, void *mem, size_t bytes) {
  sv_arena a = sv_arena_make(mem, bytes);
  sv_kernels k;
  sv_gaussians g;
  sv_renderer r;
  sv_pool pool = sv_pool_serial();
  sv_renderer_cfg c = {
      .cap_gaussians = N_WALL + N_BALL, .cap_width_px = MS_WIDTH, .cap_height_px = MS_HEIGHT, .n_threads = 1};
  sv_render_options o = {.near_z = 0.01f};
  sv_kernels_init(&k, SV_ISA_BIT(SV_ISA_REF)); // the same truth everywhere
  memset(s, 0, sizeof *s);
  if (sv_gaussians_init(&g, N_WALL + N_BALL, 0, &a) < 0 ||
      sv_renderer_init(&r, &c, (sv_compute){&k, &pool}, &a) < 0)
    return;
  for (int t = 0; t < MS_TIMES; t++) {
    float time = (float)t / (MS_TIMES - 1);
    place(&g, time);
    for (int i = 0; i < MS_CAMERAS; i++) {
      s->view[t][i] = camera(i, time);
      if (sv_render(&r, &g, &s->view[t][i], &o) < 0) return;
      for (int p = 0; p < MS_WIDTH * MS_HEIGHT; p++)
        for (int ch = 0; ch < 3; ch++)
          s->px[t][i][3 * p + ch] = to_byte(r.rgb.c[ch][p / MS_WIDTH * r.rgb.stride + p % MS_WIDTH]);
    }
  }
}

moving_scene_settings moving_scene_cfg(sv_deform_kind kind, int n, int n_steps) {
  sv_train_cfg c = sv_train_defaults();
  c.n_gaussians = n;
  c.sh_degree = 0;
  c.cap_views = MS_TIMES * MS_CAMERAS;
  c.cap_width_px = MS_WIDTH;
  c.cap_height_px = MS_HEIGHT;
  c.start_scale = 1;
  c.relocate_every = 20;
  c.reg_opacity = 0.05f;
  c.expected_steps = n_steps;
  c.has_motion = kind != SV_DEFORM_NONE;
  moving_scene_settings m = {.train = c, .dynamic = sv_dynamic_defaults(), .held_out = -1};
  m.dynamic.kind = kind;
  // Beside rates of means that are a still scene's.
  m.dynamic.lr_pos = 30;
  m.dynamic.lr_rot = m.dynamic.lr_colour = 2e-3f;
  m.dynamic.lr_body = 20;
  (void)sv_field_preset("tiny", &m.dynamic.field);
  sv_dynamic_set_times(&m.dynamic, n_steps, MS_TIMES - 1);
  return m;
}

bool moving_scene_start(const moving_scene *s, sv_trainer *t, sv_dynamic *dyn,
                        const moving_scene_settings *cfg, sv_compute compute, sv_arena a) {
  sv_train_cfg c = cfg->train;
  c.n_threads = compute.pool->n_threads;
  c.has_motion = cfg->dynamic.kind != SV_DEFORM_NONE;
  if (sv_trainer_init(t, &c, compute, &a, NULL) < 0) return false;
  if (sv_dynamic_init(dyn, &cfg->dynamic, t, &a, NULL) < 0) return false;
  for (int i = 0; i < MS_TIMES * MS_CAMERAS; i++) {
    int time = i / MS_CAMERAS, camera_i = i % MS_CAMERAS;
    sv_image_u8 im = {.px = s->px[time][camera_i],
                      .width_px = MS_WIDTH,
                      .height_px = MS_HEIGHT,
                      .n_channels = 3,
                      .stride_bytes = 3 * MS_WIDTH};
    if (time != cfg->held_out && sv_train_add_view(t, &s->view[time][camera_i], &im, NULL) < 0) return false;
  }
  sv_init_cfg init = {.kind = SV_INIT_SPHERE, .radius = 1.3f, .opacity = 0.1f, .scale_factor = 1, .seed = 1};
  sv_arena scratch = sv_arena_sub(&a, sv_init_scratch_bytes(c.n_gaussians, 1) + 4096);
  return sv_train_start(t, &init, NULL, 0, &scratch) >= 0;
}

void moving_scene_plant_body(sv_dynamic *dyn) {
  const sv_trainer *t = dyn->t;
  sv_bodies *b = &dyn->deform.motion.bodies;
  for (int i = 0; i < t->n_views; i++) (void)sv_bodies_add_knot(b, t->views[i].view.time);
  b->n = 2;
  b->radius[1] = 0.3f;
  for (int k = 0; k < 3; k++) b->centre[1][k] = *sv_gaussians_at(&t->g, 0, SV_ROW_MEAN + k);
  for (int i = 0; i < b->n_knots; i++) {
    const float far = b->time[i] - t->reference_time, w = sqrtf(1.0f - 0.05f * far * far);
    if (far != 0)
      *sv_bodies_knot(b, 1, i) =
          (sv_rigid){{w, 0.2f * far, 0, 0.1f * far}, {0.05f * far, -0.02f * far, 0.01f * far}};
  }
  for (int i = 0; i < dyn->deform.motion.n_moving; i += 2) b->of[i] = 1;
}

double moving_scene_psnr(const moving_scene *s, sv_trainer *t, int i_time, bool is_still) {
  double sum = 0;
  sv_render_options o = sv_train_render_options(t, 1.0f, false);
  for (int i = 0; i < MS_CAMERAS; i++) {
    double mse = 0;
    sv_train_set_time(t, s->view[i_time][i].time);
    if (is_still) t->g.n_moved = 0;
    if (sv_render(&t->render, &t->g, &s->view[i_time][i], &o) < 0) return -1;
    for (int p = 0; p < MS_WIDTH * MS_HEIGHT; p++)
      for (int ch = 0; ch < 3; ch++) {
        double d = (double)t->render.rgb.c[ch][p / MS_WIDTH * t->render.rgb.stride + p % MS_WIDTH] -
                   s->px[i_time][i][3 * p + ch] / 255.0;
        mse += d * d / (3.0 * MS_WIDTH * MS_HEIGHT);
      }
    sum += -10 * log10(mse) / MS_CAMERAS;
  }
  return sum;
}
