// SPDX-License-Identifier: Apache-2.0
// The rings of pseudo-views and depth maps, their memory, and what a trainer makes of them.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/mathx.h"
#include "src/prior/align.h"
#include "src/prior/methods.h"
#include "src/prior/views.h"
#include "src/splat/constants.h"
#include "src/splat/neighbours.h"
#include "tests/common/test.h"

enum { W = 64, H = 64, N = 300 };

static _Alignas(64) unsigned char block[8 << 20], again[8 << 20];
static unsigned char px[H][W][3], brighter[H][W][4];
static sv_trainer trainer, other;
static sv_prior prior, other_prior;
static sv_kernels kernels;

static void run_in_order(void *self, sv_task_fn fn, void *arg, int n_tasks) {
  (void)self;
  for (int i = 0; i < n_tasks; i++) fn(arg, i, 0);
}

static void run_backwards(void *self, sv_task_fn fn, void *arg, int n_tasks) {
  (void)self;
  for (int i = n_tasks; i-- > 0;) fn(arg, i, i % 3);
}

static const sv_pool in_order = {NULL, 1, run_in_order}, backwards = {NULL, 3, run_backwards};

static sv_view view_at(float x) {
  return (sv_view){W, H, 60, 60, W / 2.0f, H / 2.0f, {1, 0, 0, 0, 1, 0, 0, 0, 1}, {-x, 0, 3}, 0, 0, 0};
}

static sv_train_cfg config(void) {
  sv_train_cfg c = sv_train_defaults();
  c.n_gaussians = N;
  c.cap_views = 2;
  c.cap_width_px = W;
  c.cap_height_px = H;
  c.n_threads = 3;
  c.has_images = true;
  return c;
}

static const sv_prior_cfg rings = {.cap_pseudo = 3, .cap_depths = 2, .every = 2};

static sv_prior *prior_of(sv_trainer *t) { return t->hooked; }

// method NONE: rings alone.
static void make_with(sv_trainer *t, sv_prior_method method, const sv_pool *pool, void *memory,
                      size_t bytes) {
  sv_arena a = sv_arena_make(memory, bytes);
  sv_err err = {0};
  sv_train_cfg c = config();
  sv_init_cfg init = {.kind = SV_INIT_SPHERE, .radius = 1, .opacity = 0.3f, .scale_factor = 1, .seed = 4};
  sv_prior_cfg pc = rings;
  if (method) {
    pc = (sv_prior_cfg){0};
    sv_prior_set_method(&pc, method, 2);
  }
  assert_int_equal(sv_trainer_init(t, &c, (sv_compute){&kernels, pool}, &a, &err), SV_OK);
  assert_int_equal(sv_prior_init(t == &trainer ? &prior : &other_prior, &pc, t, &a, &err), SV_OK);
  for (int i = 0; i < 2; i++) {
    const sv_view v = view_at(0.3f * (float)i);
    const sv_image_u8 im = {&px[0][0][0], W, H, 3, 3 * W};
    assert_int_equal(sv_train_add_view(t, &v, &im, &err), SV_OK);
  }
  assert_int_equal(sv_train_start(t, &init, NULL, 0, &a), SV_OK);
}

static void make(sv_trainer *t, const sv_pool *pool, void *memory, size_t bytes) {
  make_with(t, SV_PRIOR_NONE, pool, memory, bytes);
}

FIXTURE(setup) {
  sv_kernels_init(&kernels, ~0u);
  for (int i = 0; i < W * H * 3; i++) px[i / 3 / W][i / 3 % W][i % 3] = (unsigned char)(40 + i * 7 % 90);
  memset(brighter, 255, sizeof brighter);
  return 0;
}

TEST(test_rings) {
  static sv_prior p;
  static float map[W * H];
  sv_arena a = sv_arena_make(block, sizeof block);
  const sv_train_cfg c = config();
  sv_err err = {0};
  const sv_prior_cfg cfg = {.cap_pseudo = 3, .cap_depths = 2, .every = 1};
  const sv_view v = view_at(0);
  const sv_image_u8 im = {&px[0][0][0], W, H, 3, 3 * W}, small = {&px[0][0][0], W - 1, H, 3, 3 * W};
  int id, first = 0;
  assert_int_equal(sv_trainer_init(&trainer, &c, (sv_compute){&kernels, &in_order}, &a, &err), SV_OK);
  assert_int_equal(sv_prior_init(&p, &cfg, &trainer, &a, &err), SV_OK);
  assert_int_equal(sv_prior_n_alive(&p, 0), 0);
  assert_int_equal(sv_prior_submit_view(&p, &v, &small, 1, 1, &id), SV_E_RANGE);
  assert_int_equal(sv_prior_submit_view(&p, &v, &im, -1, 1, &id), SV_E_RANGE);
  for (int i = 0; i < 5; i++) { // the oldest two go
    assert_int_equal(sv_prior_submit_view(&p, &v, &im, 1, 0.1f * (float)(i + 1), &id), SV_OK);
    if (i == 0) first = id;
  }
  assert_int_equal(id, first + 4);
  assert_int_equal(sv_prior_n_alive(&p, 0), 3);
  assert_int_equal(sv_prior_n_alive(&p, 0.35f), 2); // expired
  assert_int_equal(sv_prior_n_alive(&p, 0.6f), 0);
  assert_int_equal(p.views[0].rgba[3], 255); // without alpha all counts
  assert_int_equal(sv_prior_submit_depth(&p, -1, &(sv_prior_map){map, W, H, SV_PRIOR_METRIC, 1}), SV_E_RANGE);
  assert_int_equal(sv_prior_submit_depth(&p, 0, &(sv_prior_map){map, W, 2 * H, SV_PRIOR_METRIC, 1}),
                   SV_E_RANGE);
  for (int i = 0; i < 3; i++) {
    map[0] = (float)i;
    assert_int_equal(sv_prior_submit_depth(&p, i, &(sv_prior_map){map, W, H, SV_PRIOR_METRIC, 1}), SV_OK);
  }
  assert_null(sv_prior_find_depth(&p, 0, &v)); // the oldest one's place was taken
  map[0] = 9;
  assert_int_equal(sv_prior_submit_depth(&p, 2, &(sv_prior_map){map, W, H, SV_PRIOR_RELATIVE, 1}), SV_OK);
  assert_non_null(sv_prior_find_depth(&p, 1, &v)); // a second map of a view replaces its first
  assert_true(sv_prior_find_depth(&p, 2, &v)->map[0] == 9);
  assert_int_equal(sv_prior_submit_depth(&p, id, &(sv_prior_map){map, W, H, SV_PRIOR_METRIC, 1}), SV_OK);
  const int kept = sv_prior_find_depth(&p, 1, &v) ? 1 : 2;
  for (int i = 0; i < 9; i++) { // maps of pseudo-views that are gone give their places to those of
                                // later ones
    for (int k = 0; k < 3; k++) assert_int_equal(sv_prior_submit_view(&p, &v, &im, 1, 1, &id), SV_OK);
    assert_int_equal(sv_prior_submit_depth(&p, id, &(sv_prior_map){map, W, H, SV_PRIOR_METRIC, 1}), SV_OK);
    assert_non_null(sv_prior_find_depth(&p, id, &v));
    assert_non_null(sv_prior_find_depth(&p, kept, &v));
  }
  assert_int_equal(sv_prior_submit_depth(&p, 1, &(sv_prior_map){map, W, H, SV_PRIOR_METRIC, 1}), SV_OK);
  const sv_view half = sv_view_scaled(&v, 2);
  assert_null(sv_prior_find_depth(&p, 1, &half));
}

TEST(test_memory) {
  sv_train_cfg c = config();
  sv_prior_cfg pc = rings;
  sv_err err = {0};
  const size_t own = sv_trainer_bytes(&c), with = own + sv_prior_bytes(&pc, &c),
               px_floats = sv_plane_floats(W, H);
  assert_int_equal(sv_prior_bytes(&(sv_prior_cfg){0}, &c), 0);
  assert_true(with > own + (3 + 2 + 6) * 4 * px_floats);
  for (size_t less = 0; less < 2; less++) {
    sv_arena a = sv_arena_make(block, with - less);
    assert_int_equal(sv_trainer_init(&trainer, &c, (sv_compute){&kernels, &in_order}, &a, &err), SV_OK);
    assert_int_equal(sv_prior_init(&prior, &pc, &trainer, &a, &err), less ? SV_E_NOMEM : SV_OK);
  }
  sv_arena a = sv_arena_make(block, with);
  assert_int_equal(sv_trainer_init(&trainer, &c, (sv_compute){&kernels, &in_order}, &a, &err), SV_OK);
  pc.every = 0;
  assert_int_equal(sv_prior_init(&prior, &pc, &trainer, &a, &err), SV_E_ARG);
  pc = rings;
  c.has_images = false; // no room for the gradients of several images
  a = sv_arena_make(block, with);
  assert_int_equal(sv_trainer_init(&trainer, &c, (sv_compute){&kernels, &in_order}, &a, &err), SV_OK);
  assert_int_equal(sv_prior_init(&prior, &pc, &trainer, &a, &err), SV_E_ARG);
  c.has_motion = true;
  a = sv_arena_make(block, with);
  assert_int_equal(sv_trainer_init(&trainer, &c, (sv_compute){&kernels, &in_order}, &a, &err), SV_OK);
  assert_int_equal(sv_prior_init(&prior, &pc, &trainer, &a, &err), SV_E_UNSUPPORTED);
  c.has_images = true;
  assert_int_equal(sv_trainer_init(&trainer, &c, (sv_compute){&kernels, &in_order}, &a, &err),
                   SV_E_UNSUPPORTED);
}

TEST(test_views) {
  sv_view v[20];
  bool is_other = false;
  make(&trainer, &in_order, block, sizeof block);
  assert_int_equal(sv_prior_request_views(&prior, 0.4f, 20, v), SV_OK);
  for (int i = 0; i < 20; i++) {
    float eye[3], x[3], was[3];
    sv_view_centre(eye, &v[i]);
    for (int k = 0; k < 3; k++) { // the scene's centre stays where it was in the picture of one of
                                  // the views
      x[k] = v[i].t[k];
      for (int j = 0; j < 3; j++) x[k] += v[i].r[3 * k + j] * trainer.centre[j];
    }
    const float off = fabsf(x[0] - trainer.centre[0]) < 0.01f ? 0 : 0.3f;
    assert_true(fabsf(x[0] + off - trainer.centre[0]) < 1e-4f && fabsf(x[2] - 3 - trainer.centre[2]) < 1e-4f);
    const int near = sv_prior_nearest(&prior, &v[i]);
    sv_view_centre(was, &trainer.views[near].view);
    is_other |= near == 1;
    assert_true(fabsf(eye[0] - was[0]) < 1.5f);
  }
  assert_true(is_other);
  assert_int_equal(sv_prior_render(&prior, &v[0], 1.0f), SV_OK);
  int n_seen = 0;
  for (int y = 0; y < H; y++)
    for (int x = 0; x < W; x++) n_seen += prior.expected[y * trainer.render.rgb.stride + x] > 1.0f;
  assert_true(n_seen > 100);
}

static uint64_t train(sv_trainer *t, bool has_prior) {
  static float map[W * H];
  const sv_view v = view_at(-0.5f);
  const sv_image_u8 im = {&brighter[0][0][0], W, H, 4, 4 * W};
  int id = 0;
  for (int i = 0; i < W * H; i++) map[i] = i % 9 ? 2.0f + 0.02f * (float)(i % W) : -1.0f;
  for (int i = 0; i < W * H; i++) brighter[i / W][i % W][3] = i % W < W / 2 ? 255 : 0;
  if (has_prior) {
    assert_int_equal(sv_prior_submit_view(prior_of(t), &v, &im, 1, 2, &id), SV_OK);
    assert_int_equal(
        sv_prior_submit_depth(prior_of(t), id, &(sv_prior_map){map, W, H, SV_PRIOR_INVERSE, 0.1f}), SV_OK);
    assert_int_equal(
        sv_prior_submit_depth(prior_of(t), 0, &(sv_prior_map){map, W, H, SV_PRIOR_RELATIVE, 0.1f}), SV_OK);
  }
  for (int i = 0; i < 40; i++) assert_int_equal(sv_train_step(t, (float)i / 40, NULL), SV_OK);
  return sv_train_digest(t);
}

static double mean_of(sv_trainer *t, int x0, int x1) {
  const sv_view v = view_at(-0.5f);
  double sum = 0;
  assert_int_equal(sv_prior_render(prior_of(t), &v, 1), SV_OK);
  for (int y = 0; y < H; y++)
    for (int x = x0; x < x1; x++) sum += (double)t->render.rgb.c[1][y * t->render.rgb.stride + x];
  return sum / (H * (x1 - x0));
}

// A pseudo-view draws what is left of its mask's edge to itself; all of it with the same bits in
// any order of tasks.
TEST(test_steps) {
  make(&trainer, &in_order, block, sizeof block);
  (void)train(&trainer, false);
  const double left = mean_of(&trainer, 0, W / 2);
  make(&trainer, &in_order, block, sizeof block);
  make(&other, &backwards, again, sizeof again);
  const uint64_t digest = train(&trainer, true);
  assert_true(digest == train(&other, true));
  assert_true(mean_of(&trainer, 0, W / 2) > left + 0.05);
}

// --- methods -------------------------------------------------------------------------------------

static double dip_of(float *v, int n) {
  static int32_t hull[2 * 4096];
  sv_prior_sort(v, n);
  for (int i = 1; i < n; i++) assert_true(v[i - 1] <= v[i]);
  return sv_prior_dip(v, n, hull);
}

// Known values: evenly spaced ones 1/(2n), two equal heaps 1/4; what is unimodal has a dip of about
// the resolution of its distribution function, what is not has half of the trough's share.
TEST(test_dip) {
  static float v[4096];
  sv_rng r = sv_rng_make(5, 5);
  for (int n = 2; n < 40; n++) {
    for (int i = 0; i < n; i++) v[i] = (float)(7 * i % n); // any order
    if (n % 7) assert_true(fabs(dip_of(v, n) - 0.5 / n) < 1e-12);
  }
  for (int i = 0; i < 1000; i++) v[i] = (i & 1 ? 100.0f : 0.0f) + 1e-3f * sv_rng_f(&r);
  assert_true(fabs(dip_of(v, 1000) - 0.25) < 0.002);
  for (int i = 0; i < 4000; i++) v[i] = sv_rng_normal(&r);
  assert_true(dip_of(v, 4000) < 0.01);
  for (int i = 0; i < 4000; i++) v[i] = sv_rng_f(&r) * sv_rng_f(&r); // steep, one mode
  assert_true(dip_of(v, 4000) < 0.01);
  // a fifth apart
  for (int i = 0; i < 1000; i++) v[i] = (i % 5 == 0 ? 100.0f : 0.0f) + 1e-3f * sv_rng_f(&r);
  assert_true(fabs(dip_of(v, 1000) - 0.1) < 0.002);
  for (int i = 0; i < 100; i++) v[i] = 3;
  assert_true(dip_of(v, 100) == 0.5 / 100);
}

TEST(test_neighbours) {
  static float xyz[3 * 200], dist2[200];
  static int32_t nearest[3 * 200];
  sv_rng r = sv_rng_make(6, 1);
  sv_arena a = sv_arena_make(block, sizeof block);
  for (int i = 0; i < 600; i++) xyz[i] = sv_rng_f(&r);
  assert_int_equal(sv_neighbours_find(xyz, 200, dist2, nearest, &a), SV_OK);
  for (int i = 0; i < 200; i++) { // nobody else is nearer than the third
    float d[3];
    int n_nearer = 0;
    for (int k = 0; k < 3; k++) {
      const float *p = xyz + 3 * i, *q = xyz + 3 * nearest[3 * i + k];
      d[k] = (p[0] - q[0]) * (p[0] - q[0]) + (p[1] - q[1]) * (p[1] - q[1]) + (p[2] - q[2]) * (p[2] - q[2]);
    }
    assert_true(d[0] <= d[1] && d[1] <= d[2] && fabsf(dist2[i] - (d[0] + d[1] + d[2]) / 3) < 1e-6f);
    for (int j = 0; j < 200; j++) {
      const float *p = xyz + 3 * i, *q = xyz + 3 * j;
      n_nearer +=
          (p[0] - q[0]) * (p[0] - q[0]) + (p[1] - q[1]) * (p[1] - q[1]) + (p[2] - q[2]) * (p[2] - q[2]) <
          d[2];
    }
    assert_int_equal(n_nearer, 3); // itself, and two
  }
}

static void put(int i, float x, float y, float z, float log_scale, float opacity_logit) {
  float *p = sv_gaussians_at(&trainer.g, i, 0);
  p[0] = x;
  p[16] = y;
  p[32] = z;
  for (int k = 0; k < 3; k++) p[16 * (SV_ROW_SCALE + k)] = log_scale;
  p[16 * SV_ROW_LOGIT] = opacity_logit;
}

// A lattice with a far-off point: new ones come to the middles of the edges to its neighbours, in
// dead Gaussians alone.
TEST(test_unpool) {
  make_with(&trainer, SV_PRIOR_FSGS, &in_order, block, sizeof block);
  prior.cfg.unpool_share = 1;
  for (int i = 0; i < N; i++)
    put(i, 0.1f * (float)(i % 7), 0.1f * (float)(i / 7 % 7), 0.1f * (float)(i / 49), -3,
        i < 290 ? 2.0f : -9.0f);
  put(0, 9, 9, 9, -3, 2);
  assert_int_equal(sv_prior_unpool(&prior), 3);
  for (int i = 290; i < 293; i++) {
    assert_true(*sv_gaussians_at(&trainer.g, i, 0) > 4 && *sv_gaussians_at(&trainer.g, i, 0) < 6);
    assert_true(*sv_gaussians_at(&trainer.g, i, SV_ROW_LOGIT) == 2.0f);
  }
  assert_true(*sv_gaussians_at(&trainer.g, 293, SV_ROW_LOGIT) == -9.0f);
  for (int i = 0; i < N; i++) *sv_gaussians_at(&trainer.g, i, SV_ROW_LOGIT) = 2.0f;
  assert_int_equal(sv_prior_unpool(&prior), 0); // no slot to be had
}

// A wall, and before a small part of it a heavy veil that leaves a bit of the wall to be seen: the
// veil is taken.
TEST(test_prune) {
  uint32_t n_pruned;
  make_with(&trainer, SV_PRIOR_SPARSEGS, &in_order, block, sizeof block);
  for (int i = 0; i < 256; i++) put(i, 0.16f * (float)(i % 16 - 8), 0.16f * (float)(i / 16 - 8), 1, -2.2f, 5);
  for (int i = 256; i < N; i++)
    put(i, 0.05f * (float)(i % 6 - 3), 0.05f * (float)(i / 6 % 7 - 3), -1.5f, -3, 0.2f);
  assert_int_equal(sv_prior_prune(&prior, &n_pruned), SV_OK);
  int n_veil = 0, n_wall = 0;
  for (int i = 0; i < N; i++)
    if (*sv_gaussians_at(&trainer.g, i, SV_ROW_LOGIT) < -5) {
      n_veil += i >= 256;
      n_wall += i < 256;
    }
  assert_int_equal(n_veil + n_wall, n_pruned);
  assert_true(n_veil > 10 && n_wall < 10);
}

// A method's run: the same bits in any order of tasks; relocation puts pruned slots to use.
TEST(test_methods) {
  for (int m = SV_PRIOR_FSGS; m <= SV_PRIOR_SPARSEGS; m++) {
    static float map[W * H];
    for (int i = 0; i < W * H; i++) map[i] = 1.0f + 0.01f * (float)(i % W);
    make_with(&trainer, (sv_prior_method)m, &in_order, block, sizeof block);
    make_with(&other, (sv_prior_method)m, &backwards, again, sizeof again);
    for (int k = 0; k < 2; k++) {
      sv_trainer *t = k ? &other : &trainer;
      t->cfg.relocate_every = 10;
      prior_of(t)->cfg.unpool_distance = 1.2f;
      for (int i = 0; i < 30; i++) *sv_gaussians_at(&t->g, 9 * i, SV_ROW_LOGIT) = -9;
      assert_int_equal(
          sv_prior_submit_depth(prior_of(t), 0, &(sv_prior_map){map, W, H, SV_PRIOR_RELATIVE, 0.05f}), SV_OK);
      for (int i = 0; i < 120; i++) assert_int_equal(sv_train_step(t, (float)i / 120, NULL), SV_OK);
    }
    assert_true(sv_train_digest(&trainer) == sv_train_digest(&other));
    assert_true(prior.n_warped > 3);
    if (m == SV_PRIOR_FSGS) assert_true(prior.n_unpooled > 0);
    else assert_true(prior.n_pruned > 0 && trainer.n_relocated > 0);
  }
}

// Where the first Gaussians cover the surface, there is nothing to unpool into.
TEST(test_covered) {
  for (int is_covered = 0; is_covered < 2; is_covered++) {
    make_with(&trainer, SV_PRIOR_FSGS, &in_order, block, sizeof block);
    trainer.cfg.relocate_every = 10;
    prior.cfg.unpool_distance = 1.2f;
    prior.is_covered = is_covered;
    for (int i = 0; i < 30; i++) *sv_gaussians_at(&trainer.g, 9 * i, SV_ROW_LOGIT) = -9;
    for (int i = 0; i < 30; i++)
      assert_int_equal(sv_train_step(&trainer, 0.1f + (float)i / 120, NULL), SV_OK);
    assert_true((prior.n_unpooled > 0) == !is_covered);
  }
}

// Carried by true depth, a picture is where it belongs.
TEST(test_warp) {
  static float map[W * H];
  make_with(&trainer, SV_PRIOR_SPARSEGS, &in_order, block, sizeof block);
  for (int i = 0; i < W * H; i++) map[i] = 3;
  for (int i = 0; i < 2; i++)
    assert_int_equal(sv_prior_submit_depth(&prior, i, &(sv_prior_map){map, W, H, SV_PRIOR_METRIC, 1}), SV_OK);
  trainer.cfg.novel_rad = 0; // the same view again
  assert_int_equal(sv_prior_warp(&prior, 1), SV_OK);
  const uint8_t *rgba = prior.views[0].rgba;
  int n_same = 0;
  for (int y = 4; y < H - 4; y++)
    for (int x = 4; x < W - 4; x++) {
      const uint8_t *p = rgba + 4 * (y * W + x);
      assert_int_equal(p[3], 255);
      n_same += p[0] == px[y][x][0];
    }
  assert_true(n_same > (H - 8) * (W - 8) * 9 / 10);
}

// Estimated depth of masked pixels is not known.
TEST(test_masked_depth) {
  static uint8_t mask[W * H];
  static float map[W * H];
  const sv_prior_map m = {map, W, H, SV_PRIOR_METRIC, 1};
  const sv_pool serial = sv_pool_serial();
  make(&trainer, &serial, block, sizeof block);
  for (int i = 0; i < W * H; i++) {
    mask[i] = i % 5 > 0;
    map[i] = 2;
  }
  trainer.views[1].image.mask = mask;
  for (int v = 0; v < 2; v++) {
    assert_int_equal(sv_prior_submit_depth(&prior, v, &m), SV_OK);
    const sv_prior_depth *d = sv_prior_find_depth(&prior, v, &trainer.views[v].view);
    assert_non_null(d);
    for (int i = 0; i < W * H; i++) assert_true((d->map[i] < 0) == (v == 1 && i % 5 == 0));
  }
}

// --- scale and shift -----------------------------------------------------------------------------

// Depth of a view's pixel on what the ball around the origin holds: the front half of it, above a
// disc that reaches its far side. 0: nothing.
static float depth_in_ball(const sv_view *v, int x, int y) {
  const float dx = ((float)x + 0.5f - v->cx) / v->fx, dy = ((float)y + 0.5f - v->cy) / v->fy;
  const float a = dx * dx + dy * dy + 1, half = v->t[2], disc = half * half - a * (half * half - 0.64f);
  if (disc <= 0) return 0;
  return (half + (y < H / 2 ? -1.0f : 1.0f) * sqrtf(disc)) / a;
}

// A camera that is 3 from the origin sees relief that fills a ball of radius 0.8, by an inverse
// depth of unknown scale and shift: the ball tells both, though the bounds are of another size.
TEST(test_ball_tells_scale) {
  static float map[W * H];
  const sv_bounds bounds = {.radius = 1.3f};
  make(&trainer, &in_order, block, sizeof block);
  const sv_view *v = &trainer.views[0].view;
  for (int y = 0; y < H; y++)
    for (int x = 0; x < W; x++) {
      const float z = depth_in_ball(v, x, y);
      map[y * W + x] = z > 0 ? 7.0f / z + 2.0f : 2.0f;
    }
  assert_int_equal(sv_prior_submit_depth(&prior, 0, &(sv_prior_map){map, W, H, SV_PRIOR_INVERSE, 1}), SV_OK);
  assert_int_equal(sv_prior_align_to_ball(&prior, &bounds), 1);
  const sv_prior_depth *d = sv_prior_find_depth(&prior, 0, v);
  assert_int_equal(d->kind, SV_PRIOR_ALIGNED);
  int n_known = 0;
  float off = 0;
  for (int y = 0; y < H; y++)
    for (int x = 0; x < W; x++) {
      const float z = depth_in_ball(v, x, y);
      assert_true((d->map[y * W + x] < 0) == (z == 0)); // what is infinitely far is no surface
      if (z > 0 && fabsf(1 / d->map[y * W + x] - z) > 0.3f)
        fail_msg("pixel %d, %d: depth %.2f for %.2f", x, y, (double)(1 / d->map[y * W + x]), (double)z);
      off += z > 0 ? fabsf(1 / d->map[y * W + x] - z) : 0;
      n_known += z > 0;
    }
  if (!(off < 0.12f * (float)n_known)) fail_msg("mean error of depth %.3f", (double)(off / (float)n_known));
  assert_int_equal(sv_prior_align_to_ball(&prior, &bounds), 0); // it has its scale
}

// Depth that the rig measured in one half of the picture tells scale and shift in the other, and
// needs no prior where it is.
TEST(test_stereo_tells_scale) {
  static float map[W * H], depth[W * H];
  make(&trainer, &in_order, block, sizeof block);
  for (int i = 0; i < W * H; i++) {
    const float z = 2.0f + 0.02f * (float)(i % W) + 0.01f * (float)(i / W);
    map[i] = 3.0f / z + 0.5f;
    depth[i] = i % W < W / 2 ? z : -1.0f;
    if (i % 11 == 0 && depth[i] > 0) depth[i] = 1.0f; // wrong matches
  }
  assert_int_equal(sv_prior_submit_depth(&prior, 1, &(sv_prior_map){map, W, H, SV_PRIOR_INVERSE, 1}), SV_OK);
  sv_prior_depth *d = sv_prior_find_depth(&prior, 1, &trainer.views[1].view);
  assert_true(sv_prior_align_to_depth(&prior, d, depth));
  assert_int_equal(d->kind, SV_PRIOR_ALIGNED);
  for (int i = 0; i < W * H; i++) {
    const float z = 2.0f + 0.02f * (float)(i % W) + 0.01f * (float)(i / W);
    assert_true(i % W < W / 2 ? d->map[i] < 0 : fabsf(1 / d->map[i] - z) < 0.01f * z);
  }
  for (int i = 0; i < W * H; i++) depth[i] = -1.0f;
  assert_int_equal(sv_prior_submit_depth(&prior, 1, &(sv_prior_map){map, W, H, SV_PRIOR_INVERSE, 1}), SV_OK);
  assert_false(sv_prior_align_to_depth(&prior, d, depth));
  assert_int_equal(d->kind, SV_PRIOR_INVERSE);
}

// A plane whose map is off by a wave as long as the picture: measured depth in every second
// block of pixels tells the wave also between them, and the map is trusted the more the less noise
// it has.
TEST(test_smooth_errors) {
  static float map[W * H], depth[W * H];
  float trust[2];
  for (int is_noisy = 0; is_noisy < 2; is_noisy++) {
    sv_rng r = sv_rng_make(5, 1);
    make(&trainer, &in_order, block, sizeof block);
    for (int i = 0; i < W * H; i++) {
      const float z = 2.0f + 0.02f * (float)(i % W) + 0.01f * (float)(i / W);
      const float wave = 0.05f * (float)sv_sin(2 * SV_PI * (double)(i % W) / W);
      map[i] = (1.0f + wave + 0.05f * (float)is_noisy * sv_rng_normal(&r)) / z;
      depth[i] = (i % W / 3 + i / W / 3) % 2 ? z : -1.0f;
    }
    assert_int_equal(sv_prior_submit_depth(&prior, 1, &(sv_prior_map){map, W, H, SV_PRIOR_INVERSE, 1}),
                     SV_OK);
    sv_prior_depth *d = sv_prior_find_depth(&prior, 1, &trainer.views[1].view);
    assert_true(sv_prior_align_to_depth(&prior, d, depth));
    double off = 0;
    int n = 0;
    for (int i = 0; i < W * H; i++) {
      const float z = 2.0f + 0.02f * (float)(i % W) + 0.01f * (float)(i / W);
      if (d->map[i] < 0) continue;
      off += fabs((double)(d->map[i] * z) - 1);
      n++;
    }
    if (!is_noisy && !(off < 0.012 * n)) fail_msg("mean error %.4f, of a wave of 0.032", off / n);
    trust[is_noisy] = d->trust;
  }
  assert_true(trust[0] > 4 * trust[1] && trust[1] > 0);
}

// The model as two views see it tells scale and shift of a map that the ball solved wrong. A single
// view confirms nothing.
TEST(test_model_tells_scale) {
  static float truth[W * H], map[W * H];
  const sv_bounds bounds = {.radius = 1.3f};
  int n_solved, n = 0;
  double before = 0, after = 0;
  make(&trainer, &in_order, block, sizeof block);
  const sv_view *v = &trainer.views[0].view;
  assert_int_equal(sv_prior_render(&prior, v, 1), SV_OK);
  for (int y = 0; y < H; y++)
    for (int x = 0; x < W; x++) {
      const float z = prior.expected[y * trainer.render.rgb.stride + x];
      truth[y * W + x] = z > 0 ? 1 / z : -1.0f;
      map[y * W + x] = z > 0 ? 1.7f / z - 0.1f : -1.0f;
    }
  assert_int_equal(sv_prior_submit_depth(&prior, 0, &(sv_prior_map){map, W, H, SV_PRIOR_INVERSE, 1}), SV_OK);
  assert_int_equal(sv_prior_align_to_ball(&prior, &bounds), 1);
  const sv_prior_depth *d = sv_prior_find_depth(&prior, 0, v);
  const float guessed = d->trust;
  for (int i = 0; i < W * H; i++) before += truth[i] > 0 ? fabs((double)(d->map[i] - truth[i])) : 0;
  trainer.n_views = 1;
  assert_int_equal(sv_prior_realign(&prior, 1, &n_solved), SV_OK);
  assert_int_equal(n_solved, 0);
  trainer.n_views = 2;
  assert_int_equal(sv_prior_realign(&prior, 1, &n_solved), SV_OK);
  assert_int_equal(n_solved, 1);
  for (int i = 0; i < W * H; i++) {
    after += truth[i] > 0 ? fabs((double)(d->map[i] - truth[i])) : 0;
    n += truth[i] > 0;
  }
  if (!(after < 0.1 * before && after < 0.002 * n))
    fail_msg("mean error of inverse depth %.4f, before %.4f", after / n, before / n);
  assert_true(d->trust > 2 * guessed);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_rings),
                                     cmocka_unit_test(test_memory),
                                     cmocka_unit_test(test_views),
                                     cmocka_unit_test(test_steps),
                                     cmocka_unit_test(test_dip),
                                     cmocka_unit_test(test_smooth_errors),
                                     cmocka_unit_test(test_model_tells_scale),
                                     cmocka_unit_test(test_neighbours),
                                     cmocka_unit_test(test_unpool),
                                     cmocka_unit_test(test_prune),
                                     cmocka_unit_test(test_warp),
                                     cmocka_unit_test(test_methods),
                                     cmocka_unit_test(test_covered),
                                     cmocka_unit_test(test_masked_depth),
                                     cmocka_unit_test(test_ball_tells_scale),
                                     cmocka_unit_test(test_stereo_tells_scale)};
  return cmocka_run_group_tests(tests, setup, NULL);
}
