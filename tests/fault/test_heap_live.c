// SPDX-License-Identifier: Apache-2.0
// A moving scene live, five hundred exposures long: no heap, the memory block as it was to the
// byte, a ledger that adds up, and a model that stays good: at the end of an exposure's time about
// as good as one of a clip.
#include <stdio.h>
#include <stdlib.h>

#include "src/base/mathx.h"
#include "tests/common/test.h"
#include "tests/common/world.h"
#include "tests/fault/heap_count.h"

#define N_TINY              500
#define TINY_STEPS          12 // an exposure
#define HISTORY_S           5.0
#define LIVE_STEPS          30
#define N_CLIP              25
#define CLIP_STEPS          2000
#define MOST_LOSS_BODIES_DB 3.0 // beside a clip that knows what belongs together
#define MOST_LOSS_DB        2.0
#define N_PART              50 // exposures, at the start and at the end, whose means are compared

static world w;
static sv_ns step_ns;
static long n_readings;
static uint64_t n_seen;
static double sum, first_sum, last_sum;
static int n_exposures;

// A machine whose steps all take the same time, so that each exposure gets as many; it notes what
// each came to.
static sv_ns now_ns(void *self) {
  (void)self;
  if (w.app.moving.n_scored != n_seen) {
    const double psnr = w.app.moving.psnr_sum - sum;
    sum = w.app.moving.psnr_sum;
    n_seen = w.app.moving.n_scored;
    if (n_seen <= N_PART) first_sum += psnr;
    if ((int)n_seen > n_exposures - N_PART && (int)n_seen <= n_exposures) last_sum += psnr;
  }
  return w.machine_ns + step_ns * (sv_ns)world_stats(&w).step + 1000 * n_readings++;
}

static void open_live(const char *spec, int n_ring, double exposure_s, int steps_each) {
  world_open_well(&w, spec, n_ring, ~0u, 1);
  w.cfg.is_dynamic = w.cfg.is_continuous = true;
  w.cfg.exposure_s = exposure_s;
  w.cfg.steps = (uint32_t)((n_exposures + 2) * steps_each);
  w.port.machine.now_ns = now_ns;
  step_ns = (sv_ns)(exposure_s * 1e9 / steps_each);
  n_readings = 0;
  n_seen = 0;
  sum = first_sum = last_sum = 0;
}

static void run_flat(void) {
  assert_ok(world_init(&w), &w.err); // seals
  const size_t used = w.arena.used_bytes, high = w.arena.high_bytes;
  const int n = world_stats(&w).n_gaussians;
  sv_heap_arm();
  sv_status s = sv_app_run(&w.app, &w.err);
  sv_heap_disarm();
  sv_heap_report();
  if (s < 0) fail_msg("%s", w.err.text);
  sv_ledger l = sv_sync_ledger_sum(&w.app.queue.sync);
  print_message(
      "%d exposures, newest %.2f dB, the first %d %.2f dB, the last %.2f dB; %d of %d Gaussians move, %u "
      "renewed; %llu frames = %llu delivered + %llu dropped; %zu bytes before and after\n",
      (int)n_seen, w.app.moving.psnr_sum / (double)w.app.moving.n_scored, N_PART, first_sum / N_PART,
      last_sum / N_PART, world_stats(&w).n_moving, n, world_stats(&w).n_renewed,
      (unsigned long long)l.captured, (unsigned long long)l.delivered,
      (unsigned long long)sv_ledger_dropped(&l), used);
  assert_int_equal(sv_heap_count(), 0);
  assert_true(w.arena.used_bytes == used && w.arena.high_bytes == high && w.arena.is_sealed);
  assert_true((int)n_seen >= n_exposures && w.app.moving.n_scored == w.app.exposures.n_replaced);
  assert_true(sv_ledger_is_exact(&l) && l.pending == 0);
  assert_int_equal(world_stats(&w).n_gaussians, n);
}

static void skip_under_emulation(void) {
  if (!is_emulated()) return;
  print_message("skip thousands of steps: they take minutes under emulation\n");
  skip();
}

TEST(five_hundred_exposures) {
  skip_under_emulation();
  n_exposures = N_TINY;
  open_live("moving,rig=stereo,size=64x48,arc=0,fps=20", 4, 0.05, TINY_STEPS);
  w.cfg.train.n_gaussians = 400;
  w.cfg.train.sh_degree = 0;
  w.cfg.history_s = HISTORY_S;
  run_flat();
  const sv_history *h = &w.app.moving.history;
  assert_true(h->n_added >= N_TINY && h->n_lost == 0 && sv_history_used_bytes(h) <= h->cap_bytes);
  assert_true(sv_history_span_ns(h) >= (sv_ns)(HISTORY_S * 1e9));
  assert_true(last_sum / N_PART > 20); // 13 dB is an empty picture
  world_close(&w);
}

static double clip_psnr(const char *spec, int n_gaussians, int n_bodies) {
  double psnr;
  world_open_well(&w, spec, N_CLIP, ~0u, 1);
  w.cfg.is_dynamic = true;
  w.cfg.train.n_gaussians = n_gaussians;
  w.cfg.dynamic.n_bodies = n_bodies;
  w.cfg.steps = CLIP_STEPS;
  world_run_well(&w);
  assert_int_equal(sv_driver_training_psnr(&w.app.trainer, &psnr), SV_OK);
  world_close(&w);
  return psnr;
}

// The newest exposure when its time is up, after thirty steps, against what a clip comes to: one of
// the same motion, and one that has rigid bodies, which need all times. With SV_LONG=1 as large and
// as long as what the run is for.
TEST(as_good_as_a_clip) {
  const char *is_long = getenv("SV_LONG");
  const bool is_full = is_long && *is_long == '1';
  const int n = is_full ? 5000 : 2000;
  char spec[64];
  skip_under_emulation();
  snprintf(spec, sizeof spec, "moving,rig=stereo,size=%s,arc=0", is_full ? "320x240" : "160x120");
  const double clip = clip_psnr(spec, n, 0), bodies = clip_psnr(spec, n, SV_CAP_BODIES - 1);
  n_exposures = is_full ? 500 : 2 * N_PART;
  open_live(spec, 8, 0.45, LIVE_STEPS);
  w.cfg.train.n_gaussians = n;
  run_flat();
  print_message("a clip of %d exposures: %.2f dB, with rigid bodies %.2f dB\n", N_CLIP, clip, bodies);
  assert_true(first_sum / N_PART > clip - MOST_LOSS_DB && last_sum / N_PART > clip - MOST_LOSS_DB);
  assert_true(bodies > clip && sv_mind(first_sum, last_sum) / N_PART > bodies - MOST_LOSS_BODIES_DB);
  world_close(&w);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(five_hundred_exposures),
                                     cmocka_unit_test(as_good_as_a_clip)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
