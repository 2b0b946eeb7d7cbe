// SPDX-License-Identifier: Apache-2.0
// The forward model of multiplexed sensors: its value against double, its adjoint against central
// differences and as a transposed matrix, the same bits for any thread count and instruction set;
// then the gradient of a whole training step on a region, through every lens that reaches into it.
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "platform/linux/linux.h"
#include "src/base/mathx.h"
#include "src/train/train.h"
#include "tests/common/step_gradient.h"
#include "tests/common/test.h"

#define W        90
#define H        70
#define N_LENSES 6
#define CAP_LENS (64 * 48)

static _Alignas(64) unsigned char block[64 << 20];

// --- a sensor ------------------------------------------------------------------------------------

static sv_lens lens[N_LENSES];
static uint8_t coverage[2][CAP_LENS];
static float image[N_LENSES][3][CAP_LENS]; // of the lenses, whole
static float row[W];

// Place, size and coverage: a corner, an edge, the middle; two with fractional coverage, one of
// them with none at its rim; the last one covers a single row.
static void make_lenses(void) {
  static const int at[N_LENSES][5] = {{0, 0, 40, 30, -1},  {25, 10, 40, 30, 0},  {50, 40, 40, 30, -1},
                                      {10, 25, 33, 41, 1}, {30, 20, 60, 40, -1}, {5, 69, 50, 1, -1}};
  sv_rng rng = sv_rng_make(3, 1);
  for (int i = 0; i < N_LENSES; i++) {
    const int *a = at[i];
    sv_pose pose = sv_pose_identity();
    pose.t[0] = 0.1 * (i - 2);
    pose.t[2] = 4;
    lens[i] = (sv_lens){sv_view_make(a[2], a[3], (const double[]){40, 40, 0.5 * a[2], 0.5 * a[3]}, &pose),
                        {a[0], a[1], a[2], a[3], a[4] < 0 ? NULL : coverage[a[4]]}};
    for (int k = 0; k < 3; k++)
      for (int p = 0; p < a[2] * a[3]; p++)
        // Dark pixels take the straight parts of the curves; 0 and 1 are the ends.
        image[i][k][p] = p % 7 == 0 ? 0.03f * sv_rng_f(&rng) : p % 31 == 0 ? (float)(p & 1) : sv_rng_f(&rng);
  }
  for (int c = 0; c < 2; c++)
    for (int p = 0; p < CAP_LENS; p++)
      coverage[c][p] = (uint8_t)(p % 5 == 0 ? 0 : p % 3 == 0 ? 255 : sv_rng_below(&rng, 256));
}

static sv_multiplexed make_measurement(bool is_linear) {
  make_lenses();
  return (sv_multiplexed){.width_px = W,
                          .height_px = H,
                          .n_lenses = N_LENSES,
                          .lenses = lens,
                          .max_overlap = sv_multiplexed_max_overlap(lens, N_LENSES, W, H, row),
                          .is_linear = is_linear};
}

static double weight(const sv_lens *l, int x, int y) { // of a sensor pixel
  const sv_footprint *f = &l->footprint;
  int u = x - f->x0_px, v = y - f->y0_px;
  if (u < 0 || v < 0 || u >= f->width_px || v >= f->height_px) return 0;
  return f->coverage ? f->coverage[v * f->width_px + u] / 255.0 : 1.0;
}

// --- in double -----------------------------------------------------------------------------------

static double decode(double v) { return v <= 0.04045 ? v / 12.92 : pow((v + 0.055) / 1.055, 2.4); }
static double encode(double l) { return l <= 0.0031308 ? 12.92 * l : 1.055 * pow(l, 1 / 2.4) - 0.055; }

// Sensor pixel with the value of lens `which` there replaced (-1: none).
static double reference(const sv_multiplexed *c, int k, int x, int y, int which, double instead) {
  double sum = 0;
  for (int m = 0; m < c->n_lenses; m++) {
    const sv_footprint *f = &c->lenses[m].footprint;
    double w = weight(&c->lenses[m], x, y);
    if (w == 0) continue;
    double v = (double)image[m][k][(y - f->y0_px) * f->width_px + x - f->x0_px];
    if (m == which) v = instead;
    sum += w * (c->is_linear ? decode(v) : v);
  }
  sum /= (double)c->max_overlap;
  return c->is_linear ? encode(sum) : sum;
}

// --- the model under test ------------------------------------------------------------------------

typedef struct {
  sv_forward f;
  sv_kernels k;
  sv_linux_pool threads;
  sv_pool pool;
  sv_planes rgb[N_LENSES], g, out[N_LENSES];
  float *err, *out_err[N_LENSES];
  sv_crop crop[N_LENSES];
  bool is_in[N_LENSES];
} bench;

static bench b;

static void open_bench(uint32_t isa_mask, int n_threads) {
  sv_arena a = sv_arena_make(block, sizeof block);
  sv_forward_cfg cfg = {.cap_width_px = W, .cap_height_px = H, .n_threads = n_threads};
  sv_err err;
  memset(&b, 0, sizeof b);
  sv_kernels_init(&b.k, isa_mask);
  assert_int_equal(sv_linux_pool_start(&b.threads, n_threads, -1, &err), SV_OK);
  b.pool = sv_linux_pool_port(&b.threads);
  size_t before = a.used_bytes;
  assert_int_equal(sv_forward_init(&b.f, &cfg, (sv_compute){&b.k, &b.pool}, &a), SV_OK);
  assert_int_equal(a.used_bytes - before, sv_forward_bytes(&cfg));
  assert_int_equal(sv_planes_init(&b.g, W, H, &a), SV_OK);
  b.err = SV_TAKE(&a, float, sv_plane_floats(W, H));
  for (int m = 0; m < N_LENSES; m++) {
    assert_int_equal(sv_planes_init(&b.rgb[m], W, H, &a), SV_OK);
    assert_int_equal(sv_planes_init(&b.out[m], W, H, &a), SV_OK);
    b.out_err[m] = SV_TAKE(&a, float, sv_plane_floats(W, H));
  }
  assert_int_equal(a.status, SV_OK);
}

static void close_bench(void) { sv_linux_pool_stop(&b.threads); }

static void run_forward(const sv_multiplexed *c, const sv_region *r) {
  assert_int_equal(sv_forward_begin(&b.f, r), SV_OK);
  for (int m = 0; m < c->n_lenses; m++) {
    sv_crop *crop = &b.crop[m];
    b.is_in[m] = sv_multiplexed_crop(c, m, r, crop);
    if (!b.is_in[m]) continue;
    assert_int_equal(
        sv_planes_resize(&b.rgb[m], crop->view.width_px, crop->view.height_px, sv_plane_floats(W, H)), SV_OK);
    for (int k = 0; k < 3; k++)
      for (int y = 0; y < crop->view.height_px; y++)
        memcpy(b.rgb[m].c[k] + y * b.rgb[m].stride,
               image[m][k] + (crop->lens_y + y) * c->lenses[m].footprint.width_px + crop->lens_x,
               sizeof(float) * (size_t)crop->view.width_px);
    sv_forward_add(&b.f, c, crop, &b.rgb[m], NULL);
  }
  sv_forward_finish(&b.f, c);
}

static void run_backward(const sv_multiplexed *c, const sv_region *r, uint64_t seed) {
  sv_rng rng = sv_rng_make(seed, 2);
  assert_int_equal(sv_planes_resize(&b.g, r->x1 - r->x0, r->y1 - r->y0, sv_plane_floats(W, H)), SV_OK);
  for (int y = 0; y < b.g.height_px; y++)
    for (int x = 0; x < b.g.width_px; x++) {
      for (int k = 0; k < 3; k++) b.g.c[k][y * b.g.stride + x] = 2 * sv_rng_f(&rng) - 1;
      b.err[y * b.g.stride + x] = sv_rng_f(&rng);
    }
  for (int m = 0; m < c->n_lenses; m++) {
    if (!b.is_in[m]) continue;
    size_t bytes = sv_plane_floats(W, H) * sizeof(float);
    // what was there does not matter
    for (int k = 0; k < 3; k++) memset(b.out[m].c[k], 0x7f, bytes);
    memset(b.out_err[m], 0x7f, bytes);
    sv_forward_bwd(&b.f, c, &b.crop[m], &b.rgb[m],
                   &(sv_forward_grad){&b.g, b.err, &b.out[m], b.out_err[m], NULL});
  }
}

// The whole sensor; parts of lenses at every side; inside one lens; one pixel; where only the
// fractional ones are.
static const sv_region REGIONS[] = {{0, 0, W, H},     {20, 15, 61, 48}, {0, 40, 33, 70}, {70, 0, 90, 20},
                                    {30, 30, 31, 31}, {9, 24, 44, 67},  {37, 11, 69, 43}};
#define N_REGIONS (sizeof REGIONS / sizeof *REGIONS)

// --- geometry ------------------------------------------------------------------------------------

TEST(test_m_max) {
  sv_multiplexed c = make_measurement(true);
  double most = 0;
  for (int y = 0; y < H; y++)
    for (int x = 0; x < W; x++) {
      double sum = 0;
      for (int m = 0; m < N_LENSES; m++) sum += weight(&lens[m], x, y);
      most = fmax(most, sum);
    }
  assert_true(fabs((double)c.max_overlap - most) < 1e-5);
  assert_true(c.max_overlap > 3 && c.max_overlap <= 4);
  sv_err err;
  assert_int_equal(sv_multiplexed_check(&c, &err), SV_OK);
  static uint8_t dark[CAP_LENS];
  sv_lens none = lens[1];
  none.footprint.coverage = dark;
  assert_true(sv_multiplexed_max_overlap(&none, 1, W, H, row) == 0);
  for (int i = 0; i < 4; i++) {
    sv_lens bad = lens[0];
    sv_multiplexed one = {W, H, 1, &bad, 1, true};
    if (i == 0) bad.footprint.x0_px = W - 39;
    if (i == 1) bad.footprint.y0_px = -1;
    if (i == 2) bad.view.width_px++;
    if (i == 3) one.max_overlap = 0;
    assert_int_equal(sv_multiplexed_check(&one, &err), SV_E_RANGE);
    assert_true(strlen(err.text) > 15);
  }
}

// A crop is the same camera: a point has the same place on the sensor.
TEST(test_crops) {
  sv_multiplexed c = make_measurement(true);
  for (size_t i = 0; i < N_REGIONS; i++)
    for (int m = 0; m < N_LENSES; m++) {
      const sv_region *r = &REGIONS[i];
      const sv_footprint *f = &lens[m].footprint;
      sv_crop crop;
      int n = 0;
      for (int y = r->y0; y < r->y1; y++)
        for (int x = r->x0; x < r->x1; x++)
          n += x >= f->x0_px && x < f->x0_px + f->width_px && y >= f->y0_px && y < f->y0_px + f->height_px;
      assert_int_equal(sv_multiplexed_crop(&c, m, r, &crop), n > 0);
      if (!n) continue;
      assert_int_equal(crop.view.width_px * crop.view.height_px, n);
      assert_int_equal(r->x0 + crop.x_px, f->x0_px + crop.lens_x);
      assert_int_equal(r->y0 + crop.y_px, f->y0_px + crop.lens_y);
      assert_true(crop.view.cx + (float)(r->x0 + crop.x_px) == lens[m].view.cx + (float)f->x0_px);
      assert_true(crop.view.cy + (float)(r->y0 + crop.y_px) == lens[m].view.cy + (float)f->y0_px);
      assert_true(crop.view.fx == lens[m].view.fx && crop.lens == &lens[m]);
    }
}

// --- value and adjoint ---------------------------------------------------------------------------

static void check_value(const sv_multiplexed *c, const sv_region *r, double *worst) {
  for (int k = 0; k < 3; k++)
    for (int y = r->y0; y < r->y1; y++)
      for (int x = r->x0; x < r->x1; x++) {
        double is = (double)b.f.predicted.c[k][(y - r->y0) * b.f.predicted.stride + x - r->x0];
        double d = fabs(is - reference(c, k, x, y, -1, 0));
        *worst = fmax(*worst, d);
        if (!(d < 4e-6)) fail_msg("pixel %d %d of channel %d: %.7f, off by %.2g", x, y, k, is, d);
      }
}

// The slope at 0 of the linear part is 12.92, so that h is small against what light there is.
static void check_adjoint(const sv_multiplexed *c, const sv_region *r, int m, double *worst) {
  const sv_crop *crop = &b.crop[m];
  const sv_planes *out = &b.out[m];
  const double h = 1e-6;
  for (int k = 0; k < 3; k++)
    for (int v = 0; v < crop->view.height_px; v++)
      for (int u = 0; u < crop->view.width_px; u++) {
        int x = r->x0 + crop->x_px + u, y = r->y0 + crop->y_px + v;
        double at = (double)b.rgb[m].c[k][v * b.rgb[m].stride + u];
        double light = reference(c, k, x, y, -1, 0);
        if (c->is_linear && (fabs(at - 0.04045) < 1e-4 || fabs(light - 0.04045) < 1e-3))
          continue; // the kinks
        double g = (double)b.g.c[k][(y - r->y0) * b.g.stride + x - r->x0];
        double d = g * (reference(c, k, x, y, m, at + h) - reference(c, k, x, y, m, at - h)) / (2 * h);
        double is = (double)out->c[k][v * out->stride + u], off = fabs(is - d) / (1e-2 + fabs(d));
        *worst = fmax(*worst, off);
        if (!(off < 2e-4)) fail_msg("lens %d, %d %d, channel %d: %.7f, expected %.7f", m, u, v, k, is, d);
      }
}

static void check_err_and_padding(const sv_multiplexed *c, const sv_region *r, int m) {
  const sv_crop *crop = &b.crop[m];
  const sv_planes *out = &b.out[m];
  assert_true(out->width_px == crop->view.width_px && out->height_px == crop->view.height_px);
  for (int v = 0; v < out->rows_padded; v++)
    for (int u = 0; u < out->stride; u++) {
      int x = r->x0 + crop->x_px + u, y = r->y0 + crop->y_px + v, at = v * out->stride + u;
      bool is_in = u < out->width_px && v < out->height_px;
      for (int k = 0; k < 3 && !is_in; k++) assert_true(out->c[k][at] == 0);
      double e = is_in ? weight(&c->lenses[m], x, y) / (double)c->max_overlap *
                             (double)b.err[(y - r->y0) * b.g.stride + x - r->x0]
                       : 0;
      assert_true(fabs((double)b.out_err[m][at] - e) < 1e-6);
    }
}

TEST(test_value_and_adjoint) {
  for (int is_linear = 0; is_linear < 2; is_linear++) {
    double worst[2] = {0, 0};
    sv_multiplexed c = make_measurement(is_linear);
    for (int isa = 0; isa < SV_N_ISAS; isa++) {
      if (!(sv_cpu_isas() & SV_ISA_BIT(isa))) continue;
      open_bench(sv_isa_only((sv_isa)isa), 2);
      for (size_t i = 0; i < N_REGIONS; i++) {
        run_forward(&c, &REGIONS[i]);
        run_backward(&c, &REGIONS[i], 40 + i);
        check_value(&c, &REGIONS[i], &worst[0]);
        for (int m = 0; m < N_LENSES; m++) {
          if (!b.is_in[m]) continue;
          check_adjoint(&c, &REGIONS[i], m, &worst[1]);
          check_err_and_padding(&c, &REGIONS[i], m);
        }
      }
      close_bench();
    }
    print_message("%s: value off by at most %.2g, adjoint by %.2g of its size\n",
                  is_linear ? "light" : "display values", worst[0], worst[1]);
  }
}

// Display values are added linearly: y = A x, and the adjoint is A transposed.
TEST(test_dot_product) {
  sv_multiplexed c = make_measurement(false);
  open_bench(~0u, 2);
  for (size_t i = 0; i < N_REGIONS; i++) {
    double ax_y = 0, x_aty = 0, size = 0;
    run_forward(&c, &REGIONS[i]);
    run_backward(&c, &REGIONS[i], 80 + i);
    for (int k = 0; k < 3; k++) {
      for (int y = 0; y < b.g.height_px; y++)
        for (int x = 0; x < b.g.width_px; x++)
          ax_y +=
              (double)b.f.predicted.c[k][y * b.f.predicted.stride + x] * (double)b.g.c[k][y * b.g.stride + x];
      for (int m = 0; m < N_LENSES; m++)
        for (int y = 0; b.is_in[m] && y < b.out[m].height_px; y++)
          for (int x = 0; x < b.out[m].width_px; x++) {
            double p = (double)b.rgb[m].c[k][y * b.rgb[m].stride + x] *
                       (double)b.out[m].c[k][y * b.out[m].stride + x];
            x_aty += p;
            size += fabs(p);
          }
    }
    assert_true(fabs(ax_y - x_aty) < 1e-6 * (size + 1e-3));
  }
  close_bench();
}

// --- the same bits -------------------------------------------------------------------------------

static uint64_t hash(uint64_t h, const float *v, size_t n) {
  const unsigned char *p = (const unsigned char *)v;
  for (size_t i = 0; i < n * sizeof *v; i++) h = (h ^ p[i]) * 1099511628211ull;
  return h;
}

static uint64_t digest(uint32_t isa_mask, int n_threads, bool is_linear) {
  sv_multiplexed c = make_measurement(is_linear);
  uint64_t h = 14695981039346656037ull;
  open_bench(isa_mask, n_threads);
  for (size_t i = 0; i < N_REGIONS; i++) {
    run_forward(&c, &REGIONS[i]);
    run_backward(&c, &REGIONS[i], 7);
    for (int k = 0; k < 3; k++)
      h = hash(h, b.f.predicted.c[k], sv_plane_floats(b.f.predicted.width_px, b.f.predicted.height_px));
    for (int m = 0; m < N_LENSES; m++) {
      if (!b.is_in[m]) continue;
      size_t n = sv_plane_floats(b.out[m].width_px, b.out[m].height_px);
      for (int k = 0; k < 3; k++) h = hash(h, b.out[m].c[k], n);
      h = hash(h, b.out_err[m], n);
    }
  }
  close_bench();
  return h;
}

TEST(test_same_bits) {
  for (int is_linear = 0; is_linear < 2; is_linear++) {
    uint64_t ref = digest(SV_ISA_BIT(SV_ISA_REF), 1, is_linear);
    for (int n = 1; n <= 4; n *= 2) assert_true(digest(~0u, n, is_linear) == ref);
    for (int isa = 0; isa < SV_N_ISAS; isa++)
      if ((sv_cpu_isas() & SV_ISA_BIT(isa)) && isa != SV_ISA_SSE41)
        assert_true(digest(sv_isa_only((sv_isa)isa), 2, is_linear) == ref);
  }
}

// --- a training step -----------------------------------------------------------------------------

#define REGION_PX 32

static sv_trainer t;
static uint16_t measured[3 * W * H], clear[W * H];

static void open_training(const sv_multiplexed *c, const sv_kernels *k, const sv_pool *pool, float tv) {
  sv_arena a = sv_arena_make(block, sizeof block);
  sv_err err;
  sv_train_cfg cfg = sv_train_defaults();
  step_gradient_settings(&cfg);
  cfg.cap_views = 0;
  cfg.cap_measurements = 1;
  cfg.region_px = REGION_PX;
  cfg.cap_regions = sv_train_n_regions(W, H, REGION_PX);
  cfg.cap_width_px = cfg.cap_height_px = REGION_PX;
  cfg.n_threads = pool->n_threads;
  cfg.weight_tv = tv;
  if (sv_trainer_init(&t, &cfg, (sv_compute){k, pool}, &a, &err) < 0) fail_msg("%s", err.text);
  // The nearest and the farthest value there are: the absolute difference has no kink in between.
  for (int i = 0; i < 3 * W * H; i++) measured[i] = i / 40 % 2 ? 65535 : 0;
  assert_ok(sv_train_add_measurement(&t, c, measured, &err), &err);
  step_gradient_start(&t, 0.9f, &a);
}

// has_backdrop: over random backgrounds, to which the lenses are open by a half.
static void check_training(bool is_linear, float tv, bool has_backdrop) {
  sv_kernels k;
  sv_pool pool = sv_pool_serial();
  sv_multiplexed c = make_measurement(is_linear);
  step_gradient sum = {0};
  char what[80];
  step_gradient_kernels(&k);
  open_training(&c, &k, &pool, tv);
  if (has_backdrop) {
    for (int i = 0; i < W * H; i++) clear[i] = 32768;
    sv_train_set_clear(&t, clear);
    t.cfg.random_until = 1;
  }
  int n = t.n_regions;
  assert_int_equal(n, 3 * 3);
  for (int i = 0; i < n; i++) step_gradient_check(&t, &sum);
  snprintf(what, sizeof what, "region step, %s, tv %g%s", is_linear ? "light" : "display values", (double)tv,
           has_backdrop ? ", random backgrounds" : "");
  step_gradient_agrees(&sum, what, 300, 500, 10);
}

TEST(test_training_step) {
  if (is_emulated()) {
    print_message("skip the quotients of whole steps: they take minutes under emulation\n");
    skip();
  }
  check_training(true, 0, false);
  check_training(false, 0, false);
  check_training(true, 20.0f, false);
  check_training(true, 0, true);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_m_max),
      cmocka_unit_test(test_crops),
      cmocka_unit_test(test_value_and_adjoint),
      cmocka_unit_test(test_dot_product),
      cmocka_unit_test(test_same_bits),
      cmocka_unit_test(test_training_step),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
