// SPDX-License-Identifier: Apache-2.0
// Lens images of a multiplexed sensor, told apart (src/train/demultiplex.h).
#include <math.h>
#include <stdlib.h>

#include "src/train/demultiplex.h"
#include "src/train/step.h"
#include "tests/common/test.h"
#include "tests/common/world.h"

static world w;
static uint8_t memory[16 << 20];

// Light of a display value (IEC 61966-2-1).
static double light_of(double v) { return v <= 0.04045 ? v / 12.92 : pow((v + 0.055) / 1.055, 2.4); }

static sv_lens_images told_apart(int n_steps) {
  world_open_well(&w, "textured,rig=multiplexed,grid=3x3,size=160x120", 1, ~0u, 2);
  w.cfg.train.n_gaussians = 1000;
  w.cfg.train.region_px = 64;
  w.cfg.steps = n_steps;
  world_run_well(&w);
  sv_lens_images out = {0};
  sv_arena a = sv_arena_make(memory, sizeof memory);
  assert_true(sv_demultiplex_bytes(&w.app.trainer.cfg) < sizeof memory);
  assert_int_equal(sv_demultiplex(&w.app.trainer, &a, &out), SV_OK);
  assert_int_equal(out.lenses->n_views, 9);
  return out;
}

static int value_at(const sv_trainer *lenses, const sv_multiplexed *c, int m, int x, int y, int k) {
  const sv_footprint *f = &c->lenses[m].footprint;
  const sv_image_u8 *im = &lenses->views[m].image;
  if (x < f->x0_px || y < f->y0_px || x >= f->x0_px + f->width_px || y >= f->y0_px + f->height_px) return -1;
  return im->px[(size_t)(y - f->y0_px) * (size_t)im->stride_bytes + (size_t)(3 * (x - f->x0_px) + k)];
}

// Largest difference of the measurement from the sum of the images, and (is_alone) of those pixels
// that one lens alone lights from it, in light.
static double worst(const sv_trainer *lenses, bool is_alone, int *n) {
  const sv_train_measurement *tm = &w.app.trainer.measurements[0];
  const sv_multiplexed *c = &tm->model;
  double most = 0;
  *n = 0;
  for (int y = 0; y < c->height_px; y++)
    for (int x = 0; x < c->width_px; x++)
      for (int k = 0; k < 3; k++) {
        double sum = 0, y_light = light_of(tm->px[3 * (y * c->width_px + x) + k] / 65535.0) * c->max_overlap;
        int n_lit = 0;
        bool is_clipped = false;
        for (int m = 0; m < c->n_lenses; m++) {
          int v = value_at(lenses, c, m, x, y, k);
          is_clipped |= v == 0 || v == 255;
          n_lit += v >= 0;
          sum += v >= 0 ? light_of(v / 255.0) : 0;
        }
        if (!n_lit || is_clipped || (is_alone && n_lit > 1)) continue;
        ++*n;
        most = fmax(most, fabs(sum - y_light));
      }
  return most;
}

// Whatever the model is like.
TEST(test_sum_is_the_measurement) {
  for (int n_steps = 1; n_steps <= 40; n_steps += 39) {
    const sv_trainer *lenses = told_apart(n_steps).lenses;
    int n, n_alone;
    const double all = worst(lenses, false, &n), alone = worst(lenses, true, &n_alone);
    print_message("%d steps: sum off by %.4f of %d values; one lens alone %.4f of %d\n", n_steps, all, n,
                  alone, n_alone);
    assert_true(n_alone > 1000 && n > n_alone);
    assert_true(alone < 0.005); // 8 bits
    assert_true(all < 0.02);    // of four images
    world_close(&w);
  }
}

// The model's depth, as the renderer tells it for a whole lens image.
TEST(test_depth_is_the_models) {
  const sv_lens_images images = told_apart(200);
  sv_trainer *t = &w.app.trainer;
  const sv_view *v = &images.lenses->views[4].view;
  const sv_render_options o = sv_train_render_options(t, 1.0f, true);
  assert_int_equal(sv_render(&t->render, &t->g, v, &o), SV_OK);
  int n = 0;
  for (int y = 0; y < v->height_px; y++)
    for (int x = 0; x < v->width_px; x++) {
      const size_t at = (size_t)y * (size_t)t->render.rgb.stride + (size_t)x;
      const double alpha = 1.0 - (double)t->render.trans[at];
      const double got = (double)images.depth[4][y * v->width_px + x];
      if (alpha < 0.49) assert_true(got == 0);
      if (alpha < 0.51) continue;
      assert_true(fabs(got - (double)t->render.depth[at] / alpha) < 0.01 * got);
      n++;
    }
  assert_true(n > 100);
  world_close(&w);
}

// The caps are those of the settings.
TEST(test_caps) {
  told_apart(1);
  sv_lens_images out = {0};
  sv_arena a = sv_arena_make(memory, sizeof memory), small = sv_arena_make(memory, 1000);
  assert_true(sv_demultiplex(&w.app.trainer, &small, &out) < 0);
  w.app.trainer.cfg.cap_lenses = 8;
  assert_int_equal(sv_demultiplex(&w.app.trainer, &a, &out), SV_E_RANGE);
  world_close(&w);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_sum_is_the_measurement),
      cmocka_unit_test(test_depth_is_the_models),
      cmocka_unit_test(test_caps),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
