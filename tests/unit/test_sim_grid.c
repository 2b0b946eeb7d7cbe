// SPDX-License-Identifier: Apache-2.0
// The simulator's shared sensors for grids and overlaps other than the defaults.
#include <math.h>
#include <string.h>

#include "platform/sim/sim.h"
#include "tests/common/test.h"

static uint8_t memory[8 << 20];
static sv_sim sim;
static uint8_t rgb[96 * 72 * 3];

static void make(const char *spec) {
  sv_sim_config cfg;
  sv_err err = {0};
  if (sv_sim_parse(&cfg, spec, &err) < 0) fail_msg("%s: %s", spec, err.text);
  sv_arena arena = sv_arena_make(memory, sizeof memory);
  if (sv_sim_init(&sim, &cfg, &arena, &err) < 0) fail_msg("%s: %s", spec, err.text);
}

// A multiplexed measurement is the linear sum of its lens images over the largest overlap, whatever
// the grid.
TEST(test_measurements_of_any_grid) {
  static const struct {
    const char *spec;
    int n_lenses, max_overlap;
  } cases[] = {{"textured,rig=multiplexed,frames=1,size=96x72,grid=2x3,overlap=1.5", 6, 4},
               {"textured,rig=multiplexed,frames=1,size=96x72,grid=3x3,overlap=3", 9, 9},
               {"textured,rig=multiplexed,frames=1,size=96x72,grid=1x4,overlap=1", 4, 1}};
  for (int k = 0; k < 3; k++) {
    static double sum[96 * 72 * 3];
    make(cases[k].spec);
    memset(sum, 0, sizeof sum);
    const sv_rig *rig = sv_sim_rig(&sim);
    assert_int_equal(rig->n_sub_views, cases[k].n_lenses);
    for (int i = 0; i < rig->n_sub_views; i++) {
      const sv_footprint *p = &rig->sub_views[i].footprint;
      sv_view v;
      double t;
      sv_sim_view(&sim, 0, i, &v, &t);
      sv_sim_render(&sim, &v, t, rgb, NULL);
      for (int j = 0; j < 3 * p->width_px * p->height_px; j++) {
        double s = rgb[j] / 255.0;
        int x = p->x0_px + j / 3 % p->width_px, y = p->y0_px + j / 3 / p->width_px;
        sum[3 * (y * 96 + x) + j % 3] += s <= 0.04045 ? s / 12.92 : pow((s + 0.055) / 1.055, 2.4);
      }
    }
    sv_frame f;
    sv_source src = sv_sim_source(&sim);
    assert_int_equal(src.start(src.self), SV_OK);
    assert_int_equal(src.dequeue(src.self, &f, sim.now_ns + SV_NS_PER_S), SV_OK);
    double worst = 0;
    for (int i = 0; i < 96 * 72 * 3; i++) {
      double lin = sum[i] / cases[k].max_overlap;
      double enc = lin <= 0.0031308 ? 12.92 * lin : 1.055 * pow(lin, 1 / 2.4) - 0.055;
      worst = fmax(worst, fabs((f.data[2 * i] | f.data[2 * i + 1] << 8) / 65535.0 - enc));
    }
    assert_true(worst < 0.004); // the sub-views were rounded to 8 bits here
  }
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_measurements_of_any_grid)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
