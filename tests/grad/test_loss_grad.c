// SPDX-License-Identifier: Apache-2.0
// Every loss of losses.inc: first its value against a plain double implementation, then its
// gradient against central differences of that implementation, borders included; then the same bits
// for any thread count, padding zero, and memory exactly as announced.
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/rng.h"
#include "src/loss/depth.h"
#include "src/loss/pearson.h"
#include "src/loss/photometric.h"
#include "src/loss/tv.h"
#include "tests/common/test.h"
#include "tests/grad/surface_double.h"

enum { CAP_W = 45, CAP_H = 40 };

// --- fixtures ------------------------------------------------------------------------------------
static uint8_t block[4 << 20];

// A pool that runs tasks in reverse and claims several threads: order must not matter.
static void run_backwards(void *self, sv_task_fn fn, void *arg, int n_tasks) {
  int n_threads = *(int *)self;
  for (int i = n_tasks; i-- > 0;) fn(arg, i, i % n_threads);
}

typedef struct {
  sv_planes x, y, grad;
  float *err;
  int w, h;
} scene;

static scene make_scene(sv_arena *a, int w, int h, uint64_t seed) {
  scene s = {.w = w, .h = h};
  sv_rng r = sv_rng_make(seed, 3);
  assert_int_equal(sv_planes_init(&s.x, w, h, a), SV_OK);
  assert_int_equal(sv_planes_init(&s.y, w, h, a), SV_OK);
  assert_int_equal(sv_planes_init(&s.grad, w, h, a), SV_OK);
  s.err = SV_TAKE(a, float, sv_plane_floats(w, h));
  for (int c = 0; c < 3; c++)
    for (size_t i = 0; i < sv_plane_floats(w, h); i++) {
      bool is_in = (int)i % s.x.stride < w && (int)i / s.x.stride < h;
      float u = sv_rng_f(&r), smooth = 0.5f + 0.4f * sinf((float)i * 0.05f + (float)c);
      // garbage in the padding must not matter
      s.x.c[c][i] = is_in ? 0.6f * smooth + 0.4f * u : NAN;
      s.y.c[c][i] = is_in ? 0.7f * smooth + 0.3f * sv_rng_f(&r) : NAN;
      s.grad.c[c][i] = 7; // and stale values must go
      s.err[i] = 7;
    }
  return s;
}

static double *to_double(const sv_planes *p) {
  double *d = malloc(sizeof *d * 3 * (size_t)(p->width_px * p->height_px));
  for (int c = 0; c < 3; c++)
    for (int y = 0; y < p->height_px; y++)
      for (int x = 0; x < p->width_px; x++)
        d[(c * p->height_px + y) * p->width_px + x] = (double)p->c[c][y * p->stride + x];
  return d;
}

// --- the photometric loss in double --------------------------------------------------------------
static double gauss[11];

static void blur(const double *in, double *out, int w, int h) {
  double *t = calloc((size_t)(w * h), sizeof *t);
  for (int y = 0; y < h; y++)
    for (int x = 0; x < w; x++) {
      double s = 0;
      for (int k = -5; k <= 5; k++)
        if (x + k >= 0 && x + k < w) s += gauss[k + 5] * in[y * w + x + k];
      t[y * w + x] = s;
    }
  for (int y = 0; y < h; y++)
    for (int x = 0; x < w; x++) {
      double s = 0;
      for (int k = -5; k <= 5; k++)
        if (y + k >= 0 && y + k < h) s += gauss[k + 5] * t[(y + k) * w + x];
      out[y * w + x] = s;
    }
  free(t);
}

// One channel, by the paper's formula, of windows on every second row.
static double sum_ssim(const double *x, const double *y, int w, int h, int phase) {
  const int n = w * h;
  double *b = malloc(sizeof *b * 8 * (size_t)n), *m1 = b, *m2 = b + n, *xx = b + 2 * n, *yy = b + 3 * n,
         *xy = b + 4 * n, *t = b + 5 * n, sum = 0;
  blur(x, m1, w, h);
  blur(y, m2, w, h);
  for (int i = 0; i < n; i++) t[i] = x[i] * x[i];
  blur(t, xx, w, h);
  for (int i = 0; i < n; i++) t[i] = y[i] * y[i];
  blur(t, yy, w, h);
  for (int i = 0; i < n; i++) t[i] = x[i] * y[i];
  blur(t, xy, w, h);
  for (int i = 0; i < n; i++) {
    if (i / w % 2 != phase) continue;
    double s1 = xx[i] - m1[i] * m1[i], s2 = yy[i] - m2[i] * m2[i], s12 = xy[i] - m1[i] * m2[i];
    sum += (2 * m1[i] * m2[i] + 1e-4) * (2 * s12 + 9e-4) /
           ((m1[i] * m1[i] + m2[i] * m2[i] + 1e-4) * (s1 + s2 + 9e-4));
  }
  free(b);
  return sum;
}

static double photometric_double(const double *x, const double *y, int w, int h, int phase, double lambda) {
  const int n = 3 * w * h;
  double l1 = 0, ssim = 0;
  for (int i = 0; i < n; i++) l1 += fabs(x[i] - y[i]);
  for (int c = 0; c < 3; c++) ssim += sum_ssim(x + c * w * h, y + c * w * h, w, h, phase);
  return (1 - lambda) * l1 / n + lambda * (1 - ssim / (3 * w * ((h - phase + 1) / 2)));
}

static sv_photometric make_photometric(sv_arena *a, sv_compute compute, bool has_ssim) {
  sv_photometric p;
  sv_photometric_cfg cfg = {CAP_W, CAP_H, compute.pool->n_threads, has_ssim};
  size_t before = a->used_bytes;
  assert_int_equal(sv_photometric_init(&p, &cfg, compute, a), SV_OK);
  assert_int_equal(a->used_bytes - before, sv_photometric_bytes(&cfg));
  return p;
}

static void assert_padding_zero(const float *plane, const sv_planes *p) {
  for (int r = 0; r < p->rows_padded; r++)
    for (int i = r < p->height_px ? p->width_px : 0; i < p->stride; i++)
      assert_true(plane[r * p->stride + i] == 0);
}

static void photometric_case(int w, int h, int phase, float lambda) {
  sv_arena a = sv_arena_make(block, sizeof block);
  scene s = make_scene(&a, w, h, (uint64_t)(w * 100 + h));
  sv_pool pool = sv_pool_serial();
  sv_kernels k;
  sv_kernels_init(&k, ~0u);
  sv_photometric p = make_photometric(&a, (sv_compute){&k, &pool}, lambda != 0);
  p.phase = phase;
  const sv_photometric_value v = sv_photometric_loss(&p, &s.x, &s.y, &s.grad, s.err, lambda);
  const double got = v.loss;
  double *x = to_double(&s.x), *y = to_double(&s.y),
         want = photometric_double(x, y, w, h, phase, (double)lambda);
  if (fabs(got - want) > 2e-6)
    fail_msg("%dx%d l %g: value %.9g, in double %.9g", w, h, (double)lambda, got, want);
  const double n = 3.0 * w * h, step = 1e-6;
  for (int c = 0; c < 3; c++)
    for (int i = 0; i < w * h; i += 1 + (w * h > 300) * 6) {
      int at = c * w * h + i;
      double keep = x[at], plus, minus;
      if (fabs(keep - y[at]) < 1e-5) continue; // |x - y| has a corner there
      x[at] = keep + step;
      plus = photometric_double(x, y, w, h, phase, (double)lambda);
      x[at] = keep - step;
      minus = photometric_double(x, y, w, h, phase, (double)lambda);
      x[at] = keep;
      double numeric = n * (plus - minus) / (2 * step),
             analytic = n * (double)s.grad.c[c][i / w * s.grad.stride + i % w];
      if (fabs(numeric - analytic) > 1e-3 * fmax(1, fabs(numeric)))
        fail_msg("%dx%d l %g channel %d pixel (%d,%d): gradient %.7g, numeric %.7g", w, h, (double)lambda, c,
                 i % w, i / w, analytic, numeric);
    }
  for (int i = 0; i < w * h; i++) {
    double e =
        (fabs(x[i] - y[i]) + fabs(x[w * h + i] - y[w * h + i]) + fabs(x[2 * w * h + i] - y[2 * w * h + i])) /
        3;
    assert_true(fabs(e - (double)s.err[i / w * s.x.stride + i % w]) < 1e-6);
  }
  for (int c = 0; c < 3; c++) assert_padding_zero(s.grad.c[c], &s.grad);
  assert_padding_zero(s.err, &s.grad);
  double alone = sv_photometric_loss(&p, &s.x, &s.y, NULL, NULL, lambda).loss;
  assert_true(alone == got);
  free(x);
  free(y);
}

static void check_photometric(void) {
  photometric_case(1, 1, 0, 0.2f);
  photometric_case(4, 3, 1, 1.0f);
  photometric_case(13, 9, 0, 0.2f);
  photometric_case(16, 16, 1, 1.0f);
  photometric_case(17, 12, 0, 0.0f);
  photometric_case(33, 21, 1, 0.5f);
  photometric_case(CAP_W, CAP_H, 0, 0.2f);
  photometric_case(CAP_W, CAP_H, 1, 0.2f);
}

TEST(photometric_threads) {
  sv_arena a = sv_arena_make(block, sizeof block);
  scene s = make_scene(&a, CAP_W, CAP_H, 5);
  size_t bytes = sizeof(float) * sv_plane_floats(CAP_W, CAP_H);
  float *first[3] = {0};
  double want = 0;
  for (int isa = 0; isa < SV_N_ISAS; isa++) { // and for every variant with the same bits
    if (isa == SV_ISA_SSE41 || !(sv_cpu_isas() & SV_ISA_BIT(isa))) continue;
    for (int n_threads = 1; n_threads <= 4; n_threads++) {
      sv_pool pool = {&n_threads, n_threads, run_backwards};
      sv_kernels k;
      sv_kernels_init(&k, sv_isa_only((sv_isa)isa));
      sv_photometric p = make_photometric(&a, (sv_compute){&k, &pool}, true);
      double got = sv_photometric_loss(&p, &s.x, &s.y, &s.grad, s.err, 0.2f).loss;
      for (int c = 0; c < 3; c++) {
        if (!first[c]) {
          first[c] = memcpy(malloc(bytes), s.grad.c[c], bytes);
          want = got;
        }
        assert_true(got == want);
        assert_memory_equal(first[c], s.grad.c[c], bytes);
      }
    }
  }
  for (int c = 0; c < 3; c++) free(first[c]);
}

// --- total variation -----------------------------------------------------------------------------
static double tv_double(const double *x, int w, int h, bool is_squared) {
  double v = 0, u = 0;
  for (int c = 0; c < 3; c++, x += w * h)
    for (int i = 0; i < w * h; i++) {
      double dv = i / w + 1 < h ? x[i + w] - x[i] : 0, dh = i % w + 1 < w ? x[i + 1] - x[i] : 0;
      v += is_squared ? dv * dv : fabs(dv);
      u += is_squared ? dh * dh : fabs(dh);
    }
  return (h > 1 ? v / (3.0 * w * (h - 1)) : 0) + (w > 1 ? u / (3.0 * h * (w - 1)) : 0);
}

static void tv_case(int w, int h, sv_tv_form form) {
  sv_arena a = sv_arena_make(block, sizeof block);
  scene s = make_scene(&a, w, h, 77);
  sv_tv t;
  sv_tv_cfg cfg = {CAP_W, CAP_H, 3};
  size_t before = a.used_bytes;
  sv_kernels k;
  sv_kernels_init(&k, ~0u);
  int n_threads = 3;
  sv_pool pool = {&n_threads, n_threads, run_backwards};
  assert_int_equal(sv_tv_init(&t, &cfg, (sv_compute){&k, &pool}, &a), SV_OK);
  assert_int_equal(a.used_bytes - before, sv_tv_bytes(&cfg));
  const double weight = 0.25, step = 1e-7, n = 3.0 * w * h;
  double got = sv_tv_loss(&t, &s.x, &s.grad, form, (float)weight);
  double *x = to_double(&s.x), want = weight * tv_double(x, w, h, form == SV_TV_SQUARED);
  if (fabs(got - want) > 1e-6 * fmax(1e-3, want))
    fail_msg("tv %dx%d: value %.9g, in double %.9g", w, h, got, want);
  for (int c = 0; c < 3; c++)
    for (int i = 0; i < w * h; i++) {
      int at = c * w * h + i;
      double keep = x[at], plus, minus;
      x[at] = keep + step;
      plus = tv_double(x, w, h, form == SV_TV_SQUARED);
      x[at] = keep - step;
      minus = tv_double(x, w, h, form == SV_TV_SQUARED);
      x[at] = keep;
      // the gradient was added to 7
      double numeric = weight * (plus - minus) / (2 * step),
             analytic = (double)s.grad.c[c][i / w * s.grad.stride + i % w] - 7;
      if (fabs(numeric - analytic) > 2e-6 + 2e-4 / n)
        fail_msg("tv form %d %dx%d channel %d pixel (%d,%d): gradient %.7g, numeric %.7g", (int)form, w, h, c,
                 i % w, i / w, analytic, numeric);
    }
  free(x);
}

static void check_tv(void) {
  for (int form = 0; form < 2; form++) {
    tv_case(1, 1, (sv_tv_form)form);
    tv_case(1, 7, (sv_tv_form)form);
    tv_case(9, 1, (sv_tv_form)form);
    tv_case(17, 12, (sv_tv_form)form);
    tv_case(33, 20, (sv_tv_form)form);
  }
}

// --- Pearson -------------------------------------------------------------------------------------
static double one_minus_r(const double *d, const sv_pearson_input *in, sv_pearson_patch q) {
  double n = 0, md = 0, mt = 0, aa = 0, bb = 0, ab = 0;
  for (int pass = 0; pass < 2; pass++) {
    for (int y = q.y0; y < q.y1; y++)
      for (int x = q.x0; x < q.x1; x++) {
        int i = y * in->stride + x;
        if (in->mask && !in->mask[i]) continue;
        double t = (double)in->prior[i];
        if (pass == 0) {
          n++;
          md += d[i];
          mt += t;
        } else {
          aa += (d[i] - md) * (d[i] - md);
          bb += (t - mt) * (t - mt);
          ab += (d[i] - md) * (t - mt);
        }
      }
    if (pass == 0) {
      md /= n;
      mt /= n;
    }
  }
  return 1 - ab / sqrt(aa * bb);
}

static double pearson_double(const double *d, const sv_pearson_input *in) {
  const sv_pearson_patch all = {0, 0, in->width_px, in->height_px};
  double s = 0;
  if (!in->patches) return (double)in->weight * one_minus_r(d, in, all);
  for (int i = 0; i < in->n_patches; i++) s += one_minus_r(d, in, in->patches[i]);
  return (double)in->weight * s / in->n_patches;
}

static void pearson_case(bool has_patches, bool has_mask) {
  enum { W = 23, H = 35, S = 32 };
  // overlapping
  static const sv_pearson_patch patches[3] = {{0, 0, 8, 8}, {4, 5, 20, 30}, {15, 20, 23, 35}};
  static float d[H * S], t[H * S], grad[H * S];
  static double x[H * S];
  static uint8_t mask[H * S];
  sv_rng r = sv_rng_make(9, 1);
  for (int i = 0; i < H * S; i++) {
    bool is_in = i % S < W;
    d[i] = is_in ? 3 + sv_rng_f(&r) : NAN;
    t[i] = is_in ? 0.4f * d[i] + sv_rng_f(&r) : NAN;
    mask[i] = sv_rng_below(&r, 5) != 0;
    grad[i] = 0;
    x[i] = (double)d[i];
  }
  sv_arena a = sv_arena_make(block, sizeof block);
  sv_pearson p;
  sv_pearson_cfg cfg = {3};
  size_t before = a.used_bytes;
  int n_threads = 2;
  sv_pool pool = {&n_threads, n_threads, run_backwards};
  assert_int_equal(sv_pearson_init(&p, &cfg, (sv_compute){NULL, &pool}, &a), SV_OK);
  assert_int_equal(a.used_bytes - before, sv_pearson_bytes(&cfg));
  sv_pearson_input in = {d, t, has_mask ? mask : NULL, W, H, S, has_patches ? patches : NULL, 3, 0.15f};
  double got = sv_pearson_loss(&p, &in, grad), want = pearson_double(x, &in);
  if (fabs(got - want) > 1e-10) fail_msg("pearson: value %.12g, in double %.12g", got, want);
  for (int i = 0; i < H * S; i++) {
    double keep = x[i], step = 1e-6, plus, minus;
    if (i % S >= W) {
      assert_true(grad[i] == 0);
      continue;
    }
    x[i] = keep + step;
    plus = pearson_double(x, &in);
    x[i] = keep - step;
    minus = pearson_double(x, &in);
    x[i] = keep;
    double numeric = (plus - minus) / (2 * step);
    if (fabs(numeric - (double)grad[i]) > 1e-8 + 1e-5 * fabs(numeric))
      fail_msg("pearson patches %d mask %d pixel %d: gradient %.8g, numeric %.8g", has_patches, has_mask, i,
               (double)grad[i], numeric);
  }
}

static void pearson_flat(void) { // no contrast, too few pixels: finite, no gradient
  float d[32] = {0}, t[32], grad[32] = {0};
  uint8_t mask[32] = {1};
  sv_arena a = sv_arena_make(block, sizeof block);
  sv_pearson p;
  sv_pearson_cfg cfg = {1};
  sv_pool pool = sv_pool_serial();
  assert_int_equal(sv_pearson_init(&p, &cfg, (sv_compute){NULL, &pool}, &a), SV_OK);
  for (int i = 0; i < 32; i++) {
    d[i] = 2;
    t[i] = (float)i;
  }
  sv_pearson_input in = {d, t, NULL, 32, 1, 32, NULL, 0, 1.0f};
  assert_true(sv_pearson_loss(&p, &in, grad) == 1);
  in.mask = mask;
  assert_true(sv_pearson_loss(&p, &in, grad) == 1);
  for (int i = 0; i < 32; i++) assert_true(grad[i] == 0);
}

static void check_pearson(void) {
  for (int i = 0; i < 4; i++) pearson_case(i & 1, i >> 1);
  pearson_flat();
}

// --- depth ---------------------------------------------------------------------------------------
enum { DEPTH_W = 13, DEPTH_H = 7, DEPTH_S = 32, DEPTH_N = 32 * DEPTH_S };

// The loss as a function of what the rasterizer gives, sum of w z and what light is left, in
// double.
static double depth_double(const double *depth, const double *trans, const float *prior, const uint8_t *known,
                           bool is_inverse) {
  double sum = 0, n = 0;
  for (int y = 0; y < DEPTH_H; y++)
    for (int x = 0; x < DEPTH_W; x++) {
      const int i = y * DEPTH_S + x;
      const double alpha = 1 - trans[i], e = depth[i] / alpha;
      if (!known[i] || alpha < 0.5) continue;
      sum += fabs((is_inverse ? 1 / e : e) - (double)prior[i]);
      n++;
    }
  return 0.3 * sum / (n * 1.7);
}

static void depth_case(bool is_inverse) {
  static float depth[DEPTH_N], trans[DEPTH_N], prior[DEPTH_N], out[DEPTH_N], g[DEPTH_N], g_depth[DEPTH_N],
      g_trans[DEPTH_N];
  static double d[DEPTH_N], t[DEPTH_N];
  static uint8_t known[DEPTH_N], mask[DEPTH_N];
  sv_rng r = sv_rng_make(21, 2);
  for (int i = 0; i < DEPTH_N; i++) {
    trans[i] = 0.7f * sv_rng_f(&r);
    depth[i] = (1.0f - trans[i]) * (1.0f + sv_rng_f(&r));
    prior[i] = is_inverse ? 0.4f + 0.6f * sv_rng_f(&r) : 1.0f + sv_rng_f(&r);
    known[i] = mask[i] = sv_rng_below(&r, 6) != 0;
    d[i] = (double)depth[i];
    t[i] = (double)trans[i];
    g[i] = 0;
  }
  const sv_depth_input in = {depth, trans, DEPTH_W, DEPTH_H, DEPTH_S, 0.5f, is_inverse};
  sv_depth_expected(&in, out, mask);
  const double got =
      sv_depth_loss(&(sv_depth_pair){out, prior, mask, DEPTH_W, DEPTH_H, DEPTH_S, 1.7f, 0.3f}, g);
  const double want = depth_double(d, t, prior, known, is_inverse), step = 1e-6;
  if (fabs(got - want) > 1e-6 * want) fail_msg("depth: value %.9g, in double %.9g", got, want);
  sv_depth_expected_bwd(&in, out, mask, g, &(sv_depth_grad){g_depth, g_trans, 32});
  for (int i = 0; i < DEPTH_N; i++) {
    if (i % DEPTH_S >= DEPTH_W || i / DEPTH_S >= DEPTH_H) {
      assert_true(g_depth[i] == 0 && g_trans[i] == 0);
      continue;
    }
    for (int k = 0; k < 2; k++) {
      double *x = k ? &t[i] : &d[i], keep = *x;
      *x = keep + step;
      const double plus = depth_double(d, t, prior, known, is_inverse);
      *x = keep - step;
      const double numeric = (plus - depth_double(d, t, prior, known, is_inverse)) / (2 * step),
                   analytic = (double)(k ? g_trans[i] : g_depth[i]);
      *x = keep;
      if (fabs(numeric - analytic) > 1e-8 + 1e-4 * fabs(numeric))
        fail_msg("depth inverse %d pixel %d by %s: gradient %.8g, numeric %.8g", is_inverse, i,
                 k ? "trans" : "depth", analytic, numeric);
    }
  }
}

static void check_depth(void) {
  depth_case(false);
  depth_case(true);
  float none = 3, grad = 0;
  uint8_t mask = 0;
  assert_true(sv_depth_loss(&(sv_depth_pair){&none, &none, &mask, 1, 1, 1, 1, 1}, &grad) == 0 && grad == 0);
}

// --- memory --------------------------------------------------------------------------------------
TEST(one_byte_short) {
  sv_photometric_cfg cfg = {CAP_W, CAP_H, 2, true};
  sv_photometric p;
  const sv_compute compute = {0};
  size_t need = sv_photometric_bytes(&cfg);
  uint8_t *aligned = block + (-(uintptr_t)block & (SV_ARENA_ALIGN - 1));
  sv_arena a = sv_arena_make(aligned, need), b = sv_arena_make(aligned, need - 1);
  assert_int_equal(sv_photometric_init(&p, &cfg, compute, &a), SV_OK);
  assert_int_equal(sv_photometric_init(&p, &cfg, compute, &b), SV_E_NOMEM);
  cfg.n_threads = 0;
  assert_int_equal(sv_photometric_init(&p, &cfg, compute, &a), SV_E_ARG);
}

#define LOSS(name, sentence)                                                                                 \
  static void test_##name(void **state) {                                                                    \
    (void)state;                                                                                             \
    check_##name();                                                                                          \
  }
#include "src/loss/losses.inc"
#undef LOSS

int main(void) {
  double sum = 0;
  for (int k = -5; k <= 5; k++) sum += gauss[k + 5] = exp(-k * k / (2 * 1.5 * 1.5));
  for (int k = 0; k < 11; k++) gauss[k] /= sum;
  const struct CMUnitTest tests[] = {
#define LOSS(name, sentence) cmocka_unit_test(test_##name),
#include "src/loss/losses.inc"
#undef LOSS
      cmocka_unit_test(photometric_threads),
      cmocka_unit_test(one_byte_short),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
