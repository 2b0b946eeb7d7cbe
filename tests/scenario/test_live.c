// SPDX-License-Identifier: Apache-2.0
// Capture that goes on while training: the newest exposures are what is trained on, each picture at
// its own pose; the ledger stays exact; in turns on the virtual clock, and with a thread for the
// cameras.
#include <string.h>

#include "tests/common/test.h"
#include "tests/common/world.h"

static world w;

static void open_live(const char *spec, int n_exposures) {
  world_open_well(&w, spec, n_exposures, ~0u, 2);
  w.cfg.train.n_gaussians = 200;
  w.cfg.is_continuous = true;
  w.cfg.preview_every_s = 0.2;
}

static void run_well(void) {
  world_run_well(&w);
  assert_int_equal(w.n_out, w.n_back);
  for (int i = 0; i < w.cfg.n_cameras; i++) {
    const sv_ledger *l = sv_sync_ledger(&w.app.queue.sync, i);
    assert_true(sv_ledger_is_exact(l) && l->pending == 0);
    assert_int_equal(l->delivered, (uint64_t)w.app.exposures.n + w.app.exposures.n_replaced);
  }
}

// Each training view: its exposure's picture (rendered again at the view's place it is the same),
// and its pose.
static void check_views(void) {
  static uint8_t rgb[64 * 48 * 3];
  int n_sub = w.cfg.rig->n_sub_views;
  assert_int_equal(world_stats(&w).n_views, w.app.exposures.n * n_sub);
  for (int i = 0; i < world_stats(&w).n_views; i++) {
    const sv_train_view *tv = &w.app.trainer.views[i];
    const sv_exposure *e = &w.app.exposures.exposure[i / n_sub];
    sv_image_u8 image;
    sv_view view;
    sv_exposures_get(&w.app.exposures, i / n_sub, i % n_sub, &image, &view);
    const size_t n = offsetof(sv_view, i_sub_view) + sizeof view.i_sub_view; // padding may differ
    assert_memory_equal(&tv->view, &view, n);
    assert_ptr_equal(tv->view.fisheye, view.fisheye);
    assert_true(tv->image.px == image.px);
    sv_sim_render(&w.sim, &view, sv_ns_to_s(e->time_ns - SV_SIM_EPOCH_NS), rgb, NULL);
    assert_memory_equal(rgb, image.px, sizeof rgb);
  }
}

static bool has_live_line(const char *begin, const char *part) {
  for (int i = 0; i < w.n_lines; i++)
    if (w.level[i] == SV_LOG_LIVE && !strncmp(w.line[i], begin, strlen(begin)) && strstr(w.line[i], part))
      return true;
  return false;
}

TEST(in_turns_on_the_virtual_clock) {
  open_live("textured,rig=stereo,size=64x48,fps=30", 4);
  w.machine_tick_ns = 4 * SV_NS_PER_MS;
  w.cfg.steps = 200;
  run_well();
  print_message("%llu exposures replaced in %u steps, %d pictures published\n",
                (unsigned long long)w.app.exposures.n_replaced, world_stats(&w).step, w.n_images);
  assert_true(w.app.exposures.n_replaced >= 20);
  assert_true(w.app.exposures.exposure[0].id >= 20); // the newest ones
  assert_true(w.n_images >= 3);
  assert_int_equal(world_stats(&w).step, 200);
  assert_true(has_live_line("capture  ", " | right 30.0 fps "));
  assert_true(
      // the cameras, while it trains
      has_live_line("train [", " | left 30.0 fps +0.000 ms dropped "));
  check_views();
  world_close(&w);
}

// Training that takes all of the time: exposures are left out as a whole, and counted.
TEST(too_slow_for_its_cameras) {
  open_live("textured,rig=stereo,size=64x48,fps=30,buffers=8", 4);
  w.machine_tick_ns = 60 * SV_NS_PER_MS;
  w.cfg.steps = 60;
  run_well();
  const sv_ledger *l = sv_sync_ledger(&w.app.queue.sync, 0), *r = sv_sync_ledger(&w.app.queue.sync, 1);
  print_message("%llu of %llu frames left out\n", (unsigned long long)l->dropped[SV_DROP_OVERLOAD],
                (unsigned long long)l->captured);
  assert_true(l->dropped[SV_DROP_OVERLOAD] > 10);
  assert_int_equal(l->dropped[SV_DROP_OVERLOAD], r->dropped[SV_DROP_OVERLOAD]);
  assert_int_equal(w.app.capture.governor.slowdown, SV_GOVERNOR_SLOWEST);
  check_views();
  world_close(&w);
}

// A thread of their own: as many exposures as the simulator makes, beside the training.
TEST(with_a_thread) {
  open_live("textured,rig=stereo,size=64x48,fps=30,frames=600,buffers=8", 4);
  w.port.worker = world_worker(&w);
  w.cfg.steps = 150;
  run_well();
  print_message("%llu exposures replaced in %u steps\n", (unsigned long long)w.app.exposures.n_replaced,
                world_stats(&w).step);
  assert_int_equal(world_stats(&w).step, 150);
  check_views();
  world_close(&w);
}

// A camera that goes, a source that ends, a stop request: training goes on with what is there.
TEST(cameras_that_go) {
  static const char *const specs[] = {
      "textured,rig=stereo,size=64x48,fps=30,fault=unplug:1:12",
      "textured,rig=stereo,size=64x48,fps=30,frames=10",
      "textured,rig=stereo,size=64x48,fps=30,fault=error:0:8:5+dup:1:14:3+seqreset:0:20"};
  for (int i = 0; i < 3; i++) {
    open_live(specs[i], 4);
    w.machine_tick_ns = 4 * SV_NS_PER_MS;
    w.cfg.steps = 100;
    run_well();
    assert_int_equal(world_stats(&w).step, 100);
    check_views();
    world_close(&w);
  }
  open_live("textured,rig=stereo,size=64x48,fps=30", 4);
  w.cfg.steps = 100;
  w.stop_at_step = 30;
  assert_int_equal(world_run(&w), SV_E_INTERRUPTED);
  assert_int_equal(w.n_out, w.n_back);
  assert_false(w.app.queue.is_running);
  world_close(&w);
}

// A machine whose steps take long at full size and a third of that at half size.
static sv_ns slow_step_ns, spent_ns;
static uint32_t counted_step;
static long n_readings;

static sv_ns now_on_slow_machine(void *self) {
  (void)self;
  const uint32_t step = world_stats(&w).step;
  const bool is_reduced = w.app.dynamic.cfg.min_scale > 1;
  spent_ns += (sv_ns)(step - counted_step) * (is_reduced ? slow_step_ns / 3 : slow_step_ns);
  counted_step = step;
  return w.machine_ns + spent_ns + 1000 * n_readings++;
}

// Steps that are too slow: the time of an exposure is held, and images are reduced; fast ones: they
// are not.
static void check_size(sv_ns step_ns, bool is_reduced) {
  world_open_well(&w, "moving,rig=stereo,size=64x48,arc=0,fps=10", 4, ~0u, 1);
  w.cfg.is_dynamic = w.cfg.is_continuous = true;
  w.cfg.exposure_s = 0.1;
  w.cfg.steps = (uint32_t)(3 * SV_NS_PER_S / step_ns);
  w.cfg.train.n_gaussians = 300;
  w.port.machine.now_ns = now_on_slow_machine;
  slow_step_ns = step_ns;
  n_readings = 0;
  spent_ns = 0;
  counted_step = 0;
  world_run_well(&w);
  const sv_app_moving *m = &w.app.moving;
  const sv_ledger l = sv_sync_ledger_sum(&w.app.queue.sync);
  print_message("steps of %.0f ms: %llu exposures, %llu at half size, %.1f steps each\n",
                sv_ns_to_ms(step_ns), (unsigned long long)m->n_scored, (unsigned long long)m->n_reduced,
                (double)m->steps_mean);
  assert_true(sv_ledger_is_exact(&l) && l.pending == 0);
  // Ten a second, but for the last one
  assert_true((double)m->n_scored >= 10 * sv_ns_to_s(spent_ns) - 2);
  assert_true((m->n_reduced > 0) == is_reduced && m->n_reduced < m->n_scored);
  assert_true(world_has_line(&w, "images of half the size") == is_reduced);
  world_close(&w);
}

TEST(steps_that_are_too_slow) {
  check_size(25 * SV_NS_PER_MS, true);
  check_size(5 * SV_NS_PER_MS, false);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(in_turns_on_the_virtual_clock),
      cmocka_unit_test(too_slow_for_its_cameras),
      cmocka_unit_test(with_a_thread),
      cmocka_unit_test(cameras_that_go),
      cmocka_unit_test(steps_that_are_too_slow),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
