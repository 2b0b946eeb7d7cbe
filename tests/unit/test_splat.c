// SPDX-License-Identifier: Apache-2.0
// Gaussian arrays and their start, nearest neighbours, and the renderer as a whole: memory, full
// pools, the same bits for any number of threads and any instruction set.
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "platform/linux/linux.h"
#include "src/splat/neighbours.h"
#include "src/splat/render.h"
#include "tests/common/test.h"

static _Alignas(64) uint8_t block[64 << 20];

static sv_arena fresh(void) { return sv_arena_make(block, sizeof block); }

// --- arrays --------------------------------------------------------------------------------------

TEST(test_put_get) {
  for (int degree = 0; degree <= 3; degree++) {
    sv_arena a = fresh();
    sv_gaussians g;
    sv_gaussian in = {.opacity_logit = 0.25f}, out;
    assert_int_equal(sv_gaussians_init(&g, 37, degree, &a), SV_OK);
    assert_int_equal(g.cap, 48);
    assert_int_equal(a.used_bytes, sv_gaussians_bytes(37, degree));
    for (int i = 0; i < 37; i++) {
      for (int k = 0; k < 3; k++) {
        in.mean[k] = (float)(i + k);
        in.log_scale[k] = (float)(-i - k);
      }
      for (int k = 0; k < 4; k++) in.quat_wxyz[k] = (float)(10 * i + k);
      for (int k = 0; k < 48; k++) in.sh[k / 3][k % 3] = (float)(100 * i + k + 1);
      sv_gaussians_put(&g, i, &in);
    }
    for (int i = 0; i < 37; i++) {
      sv_gaussians_get(&g, i, &out);
      for (int k = 0; k < 3; k++)
        assert_true(out.mean[k] == (float)(i + k) && out.log_scale[k] == (float)(-i - k));
      for (int k = 0; k < 4; k++) assert_true(out.quat_wxyz[k] == (float)(10 * i + k));
      for (int k = 0; k < 48; k++)
        assert_true(out.sh[k / 3][k % 3] ==
                    (k < 3 * (degree + 1) * (degree + 1) ? (float)(100 * i + k + 1) : 0));
      assert_true(out.opacity_logit == 0.25f && *sv_gaussians_at(&g, i, SV_ROW_LOGIT) == 0.25f);
    }
  }
}

TEST(test_init_limits) {
  sv_arena a = fresh();
  sv_gaussians g;
  assert_int_equal(sv_gaussians_init(&g, 0, 0, &a), SV_E_ARG);
  assert_int_equal(sv_gaussians_init(&g, 4000001, 0, &a), SV_E_ARG);
  assert_int_equal(sv_gaussians_init(&g, 10, 4, &a), SV_E_ARG);
  assert_int_equal(sv_gaussians_init(&g, 10, -1, &a), SV_E_ARG);
  assert_int_equal(sv_gaussians_bytes(10, 4), 0);
  size_t bytes = sv_gaussians_bytes(1000, 3);
  a = sv_arena_make(block, bytes);
  assert_int_equal(sv_gaussians_init(&g, 1000, 3, &a), SV_OK);
  a = sv_arena_make(block, bytes - 1);
  assert_int_equal(sv_gaussians_init(&g, 1000, 3, &a), SV_E_NOMEM);
}

// --- neighbours ----------------------------------------------------------------------------------

static double brute(const float *xyz, int n, int self) {
  double best[3] = {INFINITY, INFINITY, INFINITY}, sum = 0;
  int k = n - 1 < 3 ? n - 1 : 3;
  for (int i = 0; i < n; i++) {
    if (i == self) continue;
    double d2 = 0;
    for (int a = 0; a < 3; a++) d2 += pow((double)xyz[3 * i + a] - (double)xyz[3 * self + a], 2);
    for (int b = 0; b < 3; b++)
      if (d2 < best[b]) {
        double t = best[b];
        best[b] = d2;
        d2 = t;
      }
  }
  for (int b = 0; b < k; b++) sum += best[b] / k;
  return sum;
}

enum { SCATTERED, ON_A_LINE, ON_A_GRID, PAIRS, ALL_EQUAL, N_CLOUDS };

static void make_cloud(float *xyz, int n, int kind) {
  sv_rng r = sv_rng_make(9, (uint64_t)kind);
  for (int i = 0; i < 3 * n; i++) {
    float u = 2 * sv_rng_f(&r) - 1;
    xyz[i] = kind == ON_A_LINE && i % 3 ? 0.5f
             : kind == ON_A_GRID        ? floorf(4 * u)
             : kind == ALL_EQUAL        ? 0.3f
                                        : u;
  }
  for (int i = 1; kind == PAIRS && i < n; i += 2) memcpy(xyz + 3 * i, xyz + 3 * i - 3, 12);
}

TEST(test_neighbours) {
  static const int sizes[] = {1, 2, 3, 4, 5, 16, 100, 777};
  static float xyz[3 * 777], d2[777];
  for (int s = 0; s < 8; s++)
    for (int kind = 0; kind < N_CLOUDS; kind++) {
      int n = sizes[s];
      sv_arena a = sv_arena_make(block, sv_neighbours_bytes(n));
      make_cloud(xyz, n, kind);
      assert_int_equal(sv_neighbours(xyz, n, d2, &a), SV_OK);
      assert_int_equal(a.used_bytes, 0);
      assert_int_equal(a.high_bytes, sv_neighbours_bytes(n));
      for (int i = 0; i < n; i++) {
        double want = n > 1 ? brute(xyz, n, i) : 0;
        assert_true(fabs((double)d2[i] - want) <= 1e-5 * want + 1e-9);
      }
      a = sv_arena_make(block, sv_neighbours_bytes(n) - 1);
      assert_int_equal(sv_neighbours(xyz, n, d2, &a), SV_E_NOMEM);
    }
}

// --- the start -----------------------------------------------------------------------------------

static sv_status fill(sv_gaussians *g, int n, sv_init_kind kind, const sv_point *point, int n_points,
                      size_t less) {
  sv_arena a = fresh();
  sv_init_cfg cfg = {
      .kind = kind, .centre = {1, 2, 3}, .radius = 2, .opacity = 0.1f, .scale_factor = 1, .seed = 4};
  assert_int_equal(sv_gaussians_init(g, n, 1, &a), SV_OK);
  sv_arena scratch = sv_arena_make(block + (32 << 20), sv_init_scratch_bytes(n, n_points) - less);
  sv_status s = sv_gaussians_fill(g, &cfg, point, n_points, &scratch);
  assert_int_equal(scratch.used_bytes, 0);
  return s;
}

static void check_common(const sv_gaussians *g) {
  sv_gaussian v;
  for (int i = 0; i < g->n; i++) {
    sv_gaussians_get(g, i, &v);
    const double at[3] = {(double)v.mean[0], (double)v.mean[1], (double)v.mean[2]};
    assert_true(fabs((double)v.opacity_logit - log(0.1 / 0.9)) < 1e-5);
    assert_true(v.quat_wxyz[0] == 1 && v.quat_wxyz[1] == 0 && v.quat_wxyz[2] == 0 && v.quat_wxyz[3] == 0);
    for (int k = 0; k < 3; k++)
      assert_true(isfinite(v.mean[k]) && v.log_scale[k] == v.log_scale[0] && v.log_scale[k] > -17.0f &&
                  (double)v.log_scale[k] < fmax(0, log(0.1 * sv_norm3(at))));
    for (int k = 3; k < 12; k++) assert_true(v.sh[k / 3][k % 3] == 0);
  }
}

TEST(test_fill_random) {
  static const int sizes[] = {1, 2, 3, 4, 1000};
  for (int s = 0; s < 5; s++)
    for (int kind = SV_INIT_SPHERE; kind <= SV_INIT_CUBE; kind++) {
      sv_gaussians g;
      sv_gaussian v;
      int n = sizes[s], n_far = 0;
      assert_int_equal(fill(&g, n, (sv_init_kind)kind, NULL, 0, 0), SV_OK);
      check_common(&g);
      for (int i = 0; i < n; i++) {
        double d2 = 0, max = 0;
        sv_gaussians_get(&g, i, &v);
        for (int k = 0; k < 3; k++) {
          double d = fabs((double)v.mean[k] - (k + 1));
          d2 += d * d;
          max = d > max ? d : max;
        }
        assert_true(kind == SV_INIT_SPHERE ? d2 <= 4.0001 : max <= 2.0001);
        n_far += d2 > 0.25 * 4; // outside half the radius: 7/8 of a ball's volume
      }
      if (n == 1000 && kind == SV_INIT_SPHERE) assert_in_range(n_far, 835, 915);
      assert_int_equal(fill(&g, n, (sv_init_kind)kind, NULL, 0, 1), SV_E_NOMEM);
    }
}

// Which of the points a slot's DC colour names; they carry their index there.
static int point_of(const sv_gaussians *g, int i) {
  sv_gaussian v;
  sv_gaussians_get(g, i, &v);
  return (int)lround(((double)v.sh[0][0] * SV_SH_C0 + 0.5) * 1000);
}

TEST(test_fill_points) {
  enum { CAP = 300 };
  static sv_point point[CAP];
  static const int cases[][2] = {{1, 1},    {2, 1},    {3, 2},   {100, 300}, {100, 100},
                                 {100, 37}, {100, 99}, {1, 300}, {64, 3}};
  for (int i = 0; i < CAP; i++)
    point[i] = (sv_point){{(float)i, (float)(i % 7), (float)(i % 5)}, {0.001f * (float)i, 0.5f, 1}};
  for (int c = 0; c < 9; c++) {
    int n = cases[c][0], n_points = cases[c][1], used[CAP] = {0};
    sv_gaussians g;
    sv_gaussian v;
    assert_int_equal(fill(&g, n, SV_INIT_POINTS, point, n_points, 0), SV_OK);
    check_common(&g);
    for (int i = 0; i < n; i++) {
      int p = point_of(&g, i);
      assert_in_range(p, 0, n_points - 1);
      sv_gaussians_get(&g, i, &v);
      double off = 0;
      for (int k = 0; k < 3; k++) off = fmax(off, fabs((double)v.mean[k] - (double)point[p].mean[k]));
      if (used[p]++ == 0) assert_true(off == 0 || i >= n_points);
      else assert_true(off > 0 && off < 0.2);
    }
    for (int p = 0; p < n_points; p++) // every point before any point twice
      assert_in_range(used[p], n / n_points, (n + n_points - 1) / n_points);
    assert_int_equal(fill(&g, n, SV_INIT_POINTS, point, n_points, 1), SV_E_NOMEM);
  }
  sv_gaussians g;
  assert_int_equal(fill(&g, 4, SV_INIT_POINTS, point, 0, 0), SV_E_ARG);
}

TEST(test_radius) {
  sv_gaussians g;
  float centre[3];
  assert_int_equal(fill(&g, 1000, SV_INIT_SPHERE, NULL, 0, 0), SV_OK);
  *sv_gaussians_at(&g, 5, 0) = 1000; // one far away must not matter to the radius
  sv_arena a = sv_arena_make(block + (32 << 20), 1 << 20);
  double r = (double)sv_gaussians_radius(&g, &a, centre), median = 2 * cbrt(0.5);
  assert_true(fabs(r - 1.5 * median) < 0.6); // the centroid itself has moved by about 1
  assert_int_equal(a.used_bytes, 0);
}

// --- the renderer --------------------------------------------------------------------------------

enum { N = 1500, W = 150, H = 90 };

typedef struct {
  sv_gaussians g;
  sv_renderer r;
  sv_planes grad;
  float *row, *err;
  sv_render_options o;
  sv_view view;
} scene;

static void make_scene(scene *s, sv_arena *a, int n, uint32_t cap_intersections, int n_threads) {
  sv_rng r = sv_rng_make(21, 1);
  memset(s, 0, sizeof *s);
  assert_int_equal(sv_gaussians_init(&s->g, n, 2, a), SV_OK);
  for (int i = 0; i < n; i++) {
    sv_gaussian v;
    for (int k = 0; k < 3; k++) {
      v.mean[k] = 2.2f * sv_rng_f(&r) - 1.1f;
      v.log_scale[k] = -4 + 1.5f * sv_rng_f(&r);
    }
    for (int k = 0; k < 4; k++) v.quat_wxyz[k] = sv_rng_normal(&r);
    v.opacity_logit = 2 * sv_rng_normal(&r);
    for (int k = 0; k < 48; k++) v.sh[k / 3][k % 3] = 0.3f * sv_rng_normal(&r);
    sv_gaussians_put(&s->g, i, &v);
  }
  sv_renderer_cfg cfg = {.cap_gaussians = n,
                         .cap_width_px = W,
                         .cap_height_px = H,
                         .cap_intersections = cap_intersections,
                         .n_threads = n_threads,
                         .has_grad = true};
  assert_int_equal(sv_renderer_init(&s->r, &cfg, (sv_compute){0}, a), SV_OK);
  assert_int_equal(sv_planes_init(&s->grad, W, H, a), SV_OK);
  for (int i = 0; i < 3 * W * H; i++)
    s->grad.c[i % 3][i / 3 / W * s->grad.stride + i / 3 % W] = sv_rng_f(&r) - 0.5f;
  s->row = SV_TAKE(a, float, s->g.cap * s->g.n_rows);
  s->err = SV_TAKE(a, float, s->g.cap);
  double eye[3] = {2.3, 0.6, 0.5}, at[3] = {0, 0, 0}, up[3] = {0, 0, 1};
  sv_pose pose;
  assert_true(sv_pose_look_at(&pose, eye, at, up));
  s->view = sv_view_make(W, H, (const double[]){140, 138, 74, 46}, &pose);
  s->o = (sv_render_options){.sh_degree = 2, .near_z = 0.05f, .has_depth = true, .bg = {0.1f, 0.2f, 0.3f}};
}

static void render_both(scene *s, const sv_kernels *k, const sv_pool *pool) {
  s->r.compute = (sv_compute){k, pool};
  assert_int_equal(sv_render(&s->r, &s->g, &s->view, &s->o), SV_OK);
  assert_int_equal(sv_render_bwd(&s->r, &s->grad, s->grad.c[0], s->grad.c[1], s->grad.c[2]), SV_OK);
  for (int b = 0; b < s->g.cap / 16; b++) {
    float pose[6];
    (void)sv_render_bwd_block(
        &s->r, b, 0, NULL,
        &(sv_block_grads){s->row + (size_t)b * 16 * (size_t)s->g.n_rows, s->err + 16 * b, pose});
  }
}

static uint64_t digest(uint64_t h, const void *p, size_t n) {
  const uint8_t *b = p;
  for (size_t i = 0; i < n; i++) h = (h ^ b[i]) * 0x100000001b3u;
  return h;
}

static uint64_t digest_of(const scene *s) {
  size_t px = sv_plane_floats(W, H) * sizeof(float);
  uint64_t h = 0xcbf29ce484222325u;
  for (int c = 0; c < 3; c++) h = digest(h, s->r.rgb.c[c], px);
  h = digest(h, s->r.depth, px);
  h = digest(h, s->r.trans, px);
  h = digest(h, s->row, (size_t)s->g.cap * (size_t)s->g.n_rows * sizeof(float));
  return digest(h, s->err, (size_t)s->g.cap * sizeof(float));
}

TEST(test_same_bits) {
  uint64_t want[2] = {0, 0}; // of those with FMA, of SSE4.1
  for (int isa = 0; isa < SV_N_ISAS; isa++)
    for (int n_threads = 1; n_threads <= 4; n_threads *= 2) {
      sv_arena a = fresh();
      scene s;
      sv_kernels k;
      sv_linux_pool threads;
      if (!(sv_cpu_isas() & SV_ISA_BIT(isa))) continue;
      sv_kernels_init(&k, sv_isa_only((sv_isa)isa));
      assert_int_equal(sv_linux_pool_start(&threads, n_threads, -1, NULL), SV_OK);
      sv_pool pool = sv_linux_pool_port(&threads);
      make_scene(&s, &a, N, 0, n_threads);
      render_both(&s, &k, &pool);
      assert_true(s.r.stats.n_visible > N / 2 && s.r.stats.n_dropped == 0 &&
                  sv_render_count_pairs(&s.r) > 100000);
      uint64_t h = digest_of(&s), *w = want + (isa == SV_ISA_SSE41);
      s.o.dropout = 0.3f;
      render_both(&s, &k, &pool);
      h = 31 * h + digest_of(&s);
      sv_linux_pool_stop(&threads);
      if (!*w) *w = h;
      assert_true(*w == h);
    }
}

// Each is left out as often as asked for, and the light that goes through is what it was, in the
// mean of many draws: the transmittances of a pixel's splats are drawn independently of each other.
TEST(test_dropout) {
  enum { DRAWS = 256 };
  const float share = 0.25f;
  const sv_pool pool = sv_pool_serial();
  sv_arena a = fresh();
  scene s;
  sv_kernels k;
  double off = 0, most = 0;
  sv_kernels_init(&k, sv_cpu_isas());
  make_scene(&s, &a, N, 0, 1);
  for (int i = 0; i < N; i++)
    *sv_gaussians_at(&s.g, i, SV_ROW_LOGIT) = -0.5f; // 0.38: alpha stays below its limit
  s.r.compute = (sv_compute){&k, &pool};
  assert_int_equal(sv_render(&s.r, &s.g, &s.view, &s.o), SV_OK);
  const size_t n = sv_plane_floats(W, H);
  float *whole = SV_TAKE(&a, float, n), *mean = SV_TAKE(&a, float, n);
  uint32_t *n_out = SV_TAKE(&a, uint32_t, N), sum = 0;
  memcpy(whole, s.r.trans, n * sizeof *whole);
  memset(mean, 0, n * sizeof *mean);
  memset(n_out, 0, N * sizeof *n_out);
  s.o.dropout = share;
  for (uint32_t d = 0; d < DRAWS; d++) {
    s.o.dropout_seed = d;
    assert_int_equal(sv_render(&s.r, &s.g, &s.view, &s.o), SV_OK);
    for (size_t i = 0; i < n; i++) mean[i] += s.r.trans[i] / DRAWS;
    for (int i = 0; i < N; i++) {
      const bool is_out = s.r.dropout_mask[i / 16] >> i % 16 & 1;
      assert_true(!is_out || s.r.splat[i].n_intersections == 0);
      n_out[i] += is_out;
    }
  }
  for (int i = 0; i < N; i++) {
    sum += n_out[i];
    assert_in_range(n_out[i], DRAWS / 4 - 35, DRAWS / 4 + 35); // five standard deviations
  }
  assert_true(fabs((double)sum / (N * DRAWS) - (double)share) < 0.004);
  for (int y = 0; y < H; y++)
    for (int x = 0; x < W; x++) {
      const double d = (double)mean[y * s.r.rgb.stride + x] - (double)whole[y * s.r.rgb.stride + x];
      off += d / (W * H);
      most = fmax(most, fabs(d));
    }
  assert_true(fabs(off) < 0.002 && most < 0.06);
}

TEST(test_memory) {
  for (int has_grad = 0; has_grad < 2; has_grad++) {
    sv_renderer_cfg cfg = {
        .cap_gaussians = 100, .cap_width_px = 70, .cap_height_px = 33, .n_threads = 2, .has_grad = has_grad};
    sv_renderer r;
    size_t bytes = sv_renderer_bytes(&cfg);
    sv_arena a = sv_arena_make(block, bytes);
    assert_int_equal(sv_renderer_init(&r, &cfg, (sv_compute){0}, &a), SV_OK);
    assert_int_equal(a.used_bytes, bytes);
    a = sv_arena_make(block, bytes - 1);
    assert_int_equal(sv_renderer_init(&r, &cfg, (sv_compute){0}, &a), SV_E_NOMEM);
    sv_renderer_cfg bad = cfg;
    bad.cap_gaussians = 0;
    assert_int_equal(sv_renderer_init(&r, &bad, (sv_compute){0}, &a), SV_E_ARG);
    bad = cfg;
    bad.cap_width_px = 16385;
    assert_int_equal(sv_renderer_init(&r, &bad, (sv_compute){0}, &a), SV_E_ARG);
  }
}

TEST(test_limits) {
  sv_arena a = fresh();
  scene s;
  sv_kernels k;
  sv_pool pool = sv_pool_serial();
  sv_kernels_init(&k, ~0u);
  make_scene(&s, &a, 40, 0, 1);
  s.r.compute = (sv_compute){&k, &pool};
  sv_view v = s.view;
  v.width_px = W + 1;
  assert_int_equal(sv_render(&s.r, &s.g, &v, &s.o), SV_E_RANGE);
  v = s.view;
  v.height_px = H + 1;
  assert_int_equal(sv_render(&s.r, &s.g, &v, &s.o), SV_E_RANGE);
  v = s.view;
  v.width_px = 0;
  assert_int_equal(sv_render(&s.r, &s.g, &v, &s.o), SV_E_RANGE);
  sv_gaussians more = s.g;
  more.n = 41;
  assert_int_equal(sv_render(&s.r, &more, &s.view, &s.o), SV_E_RANGE);
  pool.n_threads = 2;
  assert_int_equal(sv_render(&s.r, &s.g, &s.view, &s.o), SV_E_RANGE);
  pool.n_threads = 1;
  s.o.has_depth = false;
  assert_int_equal(sv_render(&s.r, &s.g, &s.view, &s.o), SV_OK);
  assert_int_equal(sv_render_bwd(&s.r, &s.grad, s.grad.c[0], NULL, NULL),
                   SV_E_ARG); // no depth was drawn
  sv_planes small = s.grad;
  small.stride -= 32;
  assert_int_equal(sv_render_bwd(&s.r, &small, NULL, NULL, NULL), SV_E_ARG);
}

TEST(test_nothing_visible) {
  sv_arena a = fresh();
  scene s;
  sv_kernels k;
  sv_pool pool = sv_pool_serial();
  sv_kernels_init(&k, ~0u);
  make_scene(&s, &a, 100, 0, 1);
  render_both(&s, &k, &pool); // something is left over from a picture before
  for (int i = 0; i < 100; i++) *sv_gaussians_at(&s.g, i, SV_ROW_LOGIT) = -9;
  render_both(&s, &k, &pool);
  assert_int_equal(s.r.stats.n_visible, 0);
  assert_int_equal(sv_render_count_pairs(&s.r), 0);
  for (int i = 0; i < W * H; i++) {
    int o = i / W * s.r.rgb.stride + i % W;
    assert_true(s.r.rgb.c[0][o] == 0.1f && s.r.rgb.c[2][o] == 0.3f && s.r.trans[o] == 1 && s.r.depth[o] == 0);
  }
  for (int i = 0; i < s.g.cap * s.g.n_rows; i++) assert_true(s.row[i] == 0);
}

static const sv_renderer *sorted; // by_depth sorts slots of it

static int by_depth(const void *a, const void *b) {
  const uint32_t i = *(const uint32_t *)a, k = *(const uint32_t *)b;
  const uint32_t z = sorted->depth_key[i], w = sorted->depth_key[k];
  return z != w ? (z < w ? -1 : 1) : i < k ? -1 : i > k;
}

// Visible slots front to back, equal depths by slot.
static uint32_t list_visible(const scene *s, uint32_t order[N]) {
  uint32_t n = 0;
  for (uint32_t i = 0; i < N; i++)
    if (s->r.splat[i].n_intersections) order[n++] = i;
  sorted = &s->r;
  qsort(order, n, sizeof *order, by_depth);
  return n;
}

// Three at each place, so that the pool ends among equal depths, too.
static void pile_up(scene *s) {
  for (int i = 0; i < N; i++)
    for (int k = 0; k < 3; k++) *sv_gaussians_at(&s->g, i, k) = *sv_gaussians_at(&s->g, i - i % 3, k);
}

TEST(test_full_pool) {
  static const uint32_t caps[] = {1, 2, 50, 51, 52, 53, 400, 1500};
  sv_kernels k;
  sv_pool pool = sv_pool_serial();
  sv_kernels_init(&k, ~0u);
  for (int c = 0; c < 16; c++) {
    sv_arena a = fresh();
    static scene s, few;
    static uint32_t order[N];
    const uint32_t cap = caps[c / 2];
    make_scene(&few, &a, N, 0, 1); // plenty of room
    if (c & 1) pile_up(&few);
    render_both(&few, &k, &pool);
    uint32_t n = list_visible(&few, order), n_kept = 0, n_intersections = 0;
    while (n_kept < n && few.r.splat[order[n_kept]].n_intersections <= cap - n_intersections)
      n_intersections += few.r.splat[order[n_kept++]].n_intersections;
    assert_true(few.r.stats.n_dropped == 0 && n_kept < n && (cap < 50 || n_kept > 0));
    for (uint32_t i = n_kept; i < n; i++) *sv_gaussians_at(&few.g, (int)order[i], SV_ROW_LOGIT) = -30;
    render_both(&few, &k, &pool); // only the nearest
    assert_int_equal(few.r.stats.n_visible, n_kept);
    make_scene(&s, &a, N, cap, 1);
    if (c & 1) pile_up(&s);
    render_both(&s, &k, &pool);
    assert_int_equal(s.r.stats.n_visible, n);
    assert_int_equal(s.r.stats.n_dropped, n - n_kept);
    assert_true(s.r.stats.n_intersections <= cap);
    assert_true(digest_of(&s) == digest_of(&few));
  }
}

TEST(test_smaller_view) {
  sv_arena a = fresh();
  scene s;
  sv_kernels k;
  sv_pool pool = sv_pool_serial();
  sv_kernels_init(&k, ~0u);
  make_scene(&s, &a, 200, 0, 1);
  s.r.compute = (sv_compute){&k, &pool};
  static const int sizes[][2] = {{1, 1}, {33, 90}, {150, 1}, {64, 64}, {150, 90}};
  for (int i = 0; i < 5; i++) { // one renderer, any size up to its caps
    sv_view v = s.view;
    v.width_px = sizes[i][0];
    v.height_px = sizes[i][1];
    assert_int_equal(sv_render(&s.r, &s.g, &v, &s.o), SV_OK);
    assert_int_equal(s.r.rgb.width_px, v.width_px);
    assert_int_equal(s.r.rgb.stride % 32, 0);
    for (int y = 0; y < v.height_px; y++)
      for (int x = 0; x < v.width_px; x++) {
        float t = s.r.trans[y * s.r.rgb.stride + x];
        assert_true(t > 0 && t <= 1);
      }
  }
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_put_get),         cmocka_unit_test(test_init_limits),
      cmocka_unit_test(test_neighbours),      cmocka_unit_test(test_fill_random),
      cmocka_unit_test(test_fill_points),     cmocka_unit_test(test_radius),
      cmocka_unit_test(test_same_bits),       cmocka_unit_test(test_dropout),
      cmocka_unit_test(test_memory),          cmocka_unit_test(test_limits),
      cmocka_unit_test(test_nothing_visible), cmocka_unit_test(test_full_pool),
      cmocka_unit_test(test_smaller_view),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
