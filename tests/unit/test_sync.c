// SPDX-License-Identifier: Apache-2.0
// Frames to exposures on synthetic streams: the ledger balances after every single push, each frame
// comes back exactly once, no exposure is wider than the limit, and a perfect stream loses nothing.
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/mathx.h"
#include "src/base/rng.h"
#include "src/sync/camera_stats.h"
#include "src/sync/sync.h"
#include "tests/common/test.h"

#define CAP_CAMERAS 4
#define PERIOD_NS   33333333LL
#define HOUR_NS     (3600 * SV_NS_PER_S)

typedef struct {
  double drift;
  sv_ns offset_ns, skew_ns; // camera clock - true time; true trigger delay
} camera_t;

typedef struct {
  int n_cameras;
  camera_t cam[CAP_CAMERAS];
  double jitter_ns; // mean of the exponential transport delay beyond the shortest
  double p_drop, p_dup, p_swap, p_reset, p_step, p_error;
} world_t;

static void use_one_clock(world_t *w) {
  for (int c = 0; c < 3; c++) {
    w->cam[c].drift = 0;
    w->cam[c].offset_ns = 1000 * SV_NS_PER_S;
  }
}

typedef struct {
  sv_sync sync;
  void *block;
  uint8_t *state; // [cap] of each frame pushed: 1 on loan, 2 came back
  int n_pushed, n_back, n_exposures, cap;
  sv_ns last_time_ns, limit_ns;
  uint32_t seq[CAP_CAMERAS];
  sv_ns step_ns[CAP_CAMERAS];
  uint64_t n_lost[CAP_CAMERAS], n_dup, n_swap, n_steps, n_resets, n_errors;
  bool has_held[CAP_CAMERAS];
  sv_frame held[CAP_CAMERAS];
} bench_t;

static void bench_open(bench_t *b, const world_t *w, sv_sync_cfg cfg, int cap) {
  sv_sync_camera cams[CAP_CAMERAS] = {0};
  for (int c = 0; c < w->n_cameras; c++)
    cams[c] = (sv_sync_camera){.clock = SV_CLOCK_CAMERA, .stamp = SV_STAMP_START};
  memset(b, 0, sizeof *b);
  cfg.n_cameras = w->n_cameras;
  cfg.cameras = cams;
  size_t bytes = sv_sync_bytes(&cfg);
  assert_true(bytes > 0);
  b->block = aligned_alloc(64, bytes);
  sv_arena a = sv_arena_make(b->block, bytes);
  assert_int_equal(sv_sync_init(&b->sync, &cfg, &a), SV_OK);
  assert_int_equal(a.used_bytes, bytes);
  b->cap = cap;
  b->state = calloc((size_t)cap, 1);
  b->last_time_ns = INT64_MIN;
  b->limit_ns = cfg.skew_limit_ns;
}

static void check_ledgers(const bench_t *b) {
  for (int c = 0; c < b->sync.cfg.n_cameras; c++)
    assert_true(sv_ledger_is_exact(sv_sync_ledger(&b->sync, c)));
}

static void back(bench_t *b, const sv_frame *f) {
  assert_int_equal(b->state[f->i_buffer], 1);
  b->state[f->i_buffer] = 2;
  b->n_back++;
}

static void drain(bench_t *b) {
  sv_exposure e;
  sv_frame frames[CAP_CAMERAS], f;
  while (sv_sync_pop_exposure(&b->sync, &e, frames) == SV_OK) {
    check_ledgers(b);
    b->n_exposures++;
    assert_true(e.skew_ns >= 0 && e.skew_ns <= b->limit_ns);
    int n = 0;
    for (int c = 0; c < b->sync.cfg.n_cameras; c++) {
      bool is_present = e.present[0] >> c & 1;
      assert_int_equal(is_present, frames[c].i_camera == c);
      if (is_present) {
        back(b, &frames[c]);
        n++;
      }
    }
    assert_true(n >= b->sync.cfg.min_cameras);
  }
  while (sv_sync_pop_return(&b->sync, &f) == SV_OK) back(b, &f);
  check_ledgers(b);
}

static void push(bench_t *b, sv_frame f, bool is_drained) {
  assert_true(b->n_pushed < b->cap);
  f.i_buffer = b->n_pushed;
  b->state[b->n_pushed++] = 1;
  assert_true(sv_sync_push(&b->sync, &f) >= 0);
  check_ledgers(b);
  if (is_drained) drain(b);
}

static void bench_close(bench_t *b) {
  assert_int_equal(sv_sync_flush(&b->sync), SV_OK);
  drain(b);
  assert_int_equal(b->n_back, b->n_pushed);
  sv_ledger sum = sv_sync_ledger_sum(&b->sync);
  assert_int_equal(sum.pending, 0);
  assert_true(sv_ledger_is_exact(&sum));
  free(b->block);
  free(b->state);
}

static sv_frame make_frame(bench_t *b, const world_t *w, sv_rng *r, int c, int k) {
  const camera_t *m = &w->cam[c];
  sv_ns t_ns = (sv_ns)k * PERIOD_NS + m->skew_ns;
  double delay = 5e6 - (w->jitter_ns > 0 ? w->jitter_ns * sv_log(1 - (double)sv_rng_f(r)) : 0);
  if (delay > 25e6) delay = 25e6; // stays within the frame time
  return (sv_frame){.i_camera = c,
                    .sequence = b->seq[c]++,
                    .camera_ns = t_ns + (sv_ns)(m->drift * (double)t_ns) + m->offset_ns + b->step_ns[c],
                    .arrival_ns = 1000 * SV_NS_PER_S + t_ns + (sv_ns)delay,
                    .exposure_ns = 8000000};
}

static bool happens(sv_rng *r, double p, uint64_t *count) {
  bool is_hit = sv_rng_f(r) < p;
  *count += is_hit;
  return is_hit;
}

static void play_frame(bench_t *b, const world_t *w, sv_rng *r, int c, int k) {
  if (happens(r, w->p_reset, &b->n_resets)) b->seq[c] = 0;
  if (happens(r, w->p_step, &b->n_steps)) b->step_ns[c] += sv_rng_below(r, 2) ? HOUR_NS : -HOUR_NS;
  sv_frame f = make_frame(b, w, r, c, k);
  if (sv_rng_f(r) < w->p_drop) {
    b->n_lost[c]++;
    return;
  }
  if (happens(r, w->p_error, &b->n_errors)) f.is_error = true;
  if (sv_rng_f(r) < w->p_swap && !b->has_held[c]) { // comes after its successor
    b->held[c] = f;
    b->has_held[c] = true;
    b->n_swap++;
    return;
  }
  push(b, f, true);
  if (happens(r, w->p_dup, &b->n_dup)) push(b, f, true);
  if (b->has_held[c]) {
    push(b, b->held[c], true);
    b->has_held[c] = false;
  }
}

static void play(bench_t *b, const world_t *w, uint64_t seed, int k0, int n) {
  sv_rng r = sv_rng_make(seed, 1);
  for (int k = k0; k < k0 + n; k++)
    for (int c = 0; c < w->n_cameras; c++) play_frame(b, w, &r, (c + k) % w->n_cameras, k);
}

static world_t world3(void) {
  return (world_t){
      .n_cameras = 3,
      .cam = {{50e-6, 17 * HOUR_NS, 0}, {-50e-6, -5 * HOUR_NS, 40000}, {20e-6, 123456789, -30000}}};
}

TEST(perfect_streams_lose_nothing) {
  world_t w = world3();
  bench_t b;
  bench_open(&b, &w, (sv_sync_cfg){.skew_limit_ns = 500000, .queue_len = 4}, 40000);
  play(&b, &w, 1, 0, 10000);
  sv_ledger sum = sv_sync_ledger_sum(&b.sync);
  assert_int_equal(b.n_exposures, 10000);
  assert_int_equal(sum.captured, 30000);
  assert_int_equal(sum.delivered, 30000);
  for (int i = 0; i < SV_N_SYNC_EVENTS; i++) assert_int_equal(b.sync.streams[0].events[i], 0);
  // True skew is 70 us, and the drift of the first seconds adds to it before it is known.
  assert_true(sv_skew_percentile_ns(&b.sync.skew, 50) < 80000);
  bench_close(&b);
}

TEST(common_clock_is_exact) {
  world_t w = world3();
  use_one_clock(&w);
  w.jitter_ns = 3e6;
  bench_t b;
  bench_open(&b, &w,
             (sv_sync_cfg){.skew_limit_ns = 70000, .queue_len = 4, .clock_mode = SV_SYNC_CLOCK_COMMON},
             40000);
  play(&b, &w, 2, 0, 10000);
  assert_int_equal(b.n_exposures, 10000);
  assert_int_equal(b.sync.skew.max_ns, 70000);
  assert_int_equal(sv_skew_percentile_ns(&b.sync.skew, 99), 70000);
  bench_close(&b);
}

TEST(jitter_and_drift_are_estimated) {
  world_t w = world3();
  w.jitter_ns = 1e6;
  bench_t b;
  bench_open(&b, &w, (sv_sync_cfg){.skew_limit_ns = 10000000, .queue_len = 4}, 40000);
  play(&b, &w, 3, 0, 1000); // settle
  memset(&b.sync.skew, 0, sizeof b.sync.skew);
  play(&b, &w, 4, 1000, 9000);
  print_message("skew with 50 ppm and 1 ms jitter (70 us true): p50 %lld p99 %lld max %lld ns\n",
                (long long)sv_skew_percentile_ns(&b.sync.skew, 50),
                (long long)sv_skew_percentile_ns(&b.sync.skew, 99), (long long)b.sync.skew.max_ns);
  assert_int_equal(b.n_exposures, 10000);
  assert_true(sv_skew_percentile_ns(&b.sync.skew, 99) <= 250000);
  assert_true(b.sync.skew.max_ns <= 1000000);
  for (int c = 0; c < 3; c++) {
    double ppm = -b.sync.streams[c].clock.drift * 1e6; // host against camera
    assert_true(ppm - w.cam[c].drift * 1e6 < 20 && ppm - w.cam[c].drift * 1e6 > -20);
  }
  bench_close(&b);
}

TEST(losses_are_counted_one_by_one) {
  world_t w = world3();
  w.p_drop = 0.03;
  bench_t b;
  bench_open(&b, &w, (sv_sync_cfg){.skew_limit_ns = 500000, .queue_len = 4}, 40000);
  play(&b, &w, 5, 0, 10000);
  w.p_drop = 0;
  play(&b, &w, 6, 10000, 1); // a last frame each shows the gaps at the end
  for (int c = 0; c < 3; c++) {
    const sv_ledger *l = sv_sync_ledger(&b.sync, c);
    assert_int_equal(l->captured, 10001);
    assert_int_equal(l->dropped[SV_DROP_SEQUENCE_GAP], b.n_lost[c]);
    assert_int_equal(l->delivered + l->dropped[SV_DROP_NO_PARTNER] + b.n_lost[c], 10001);
  }
  assert_true(b.n_exposures > 9000 && b.n_exposures < 9300); // 0.97^3
  bench_close(&b);
}

TEST(duplicates_and_swaps_are_named) {
  world_t w = world3();
  w.p_dup = 0.02;
  w.p_swap = 0.01;
  bench_t b;
  bench_open(&b, &w, (sv_sync_cfg){.skew_limit_ns = 500000, .queue_len = 4}, 40000);
  play(&b, &w, 7, 0, 10000);
  w.p_dup = w.p_swap = 0;
  play(&b, &w, 8, 10000, 1);
  sv_ledger sum = sv_sync_ledger_sum(&b.sync);
  assert_int_equal(sum.dropped[SV_DROP_DUPLICATE], b.n_dup);
  assert_int_equal(sum.dropped[SV_DROP_OUT_OF_ORDER], b.n_swap);
  assert_int_equal(sum.dropped[SV_DROP_SEQUENCE_GAP], 0); // what came late was no loss
  assert_int_equal(sum.captured, 3 * 10001 + b.n_dup);
  bench_close(&b);
}

TEST(everything_at_once_stays_exact) {
  world_t w = world3();
  w.n_cameras = 4;
  w.cam[3] = (camera_t){-10e-6, 99 * HOUR_NS, 10000};
  w = (world_t){w.n_cameras, {w.cam[0], w.cam[1], w.cam[2], w.cam[3]}, 5e5, 0.02, 0.01, 0.005, 0.0005, 0.0003,
                0.005};
  for (int policy = 0; policy < 2; policy++) {
    bench_t b;
    bench_open(&b, &w, (sv_sync_cfg){.skew_limit_ns = 2000000, .queue_len = 8, .min_cameras = policy ? 2 : 0},
               220000);
    play(&b, &w, 11 + (uint64_t)policy, 0, 50000); // 200,000 frames
    sv_ledger sum = sv_sync_ledger_sum(&b.sync);
    uint64_t n_steps = 0, n_resets = 0;
    for (int c = 0; c < 4; c++) {
      n_steps += b.sync.streams[c].events[SV_SYNC_EVENT_CLOCK_STEP];
      n_resets += b.sync.streams[c].events[SV_SYNC_EVENT_SEQUENCE_RESET];
    }
    print_message(
        "policy %d: %d exposures, captured %llu, delivered %llu, steps %llu of %llu, resets %llu of %llu\n",
        policy, b.n_exposures, (unsigned long long)sum.captured, (unsigned long long)sum.delivered,
        (unsigned long long)n_steps, (unsigned long long)b.n_steps, (unsigned long long)n_resets,
        (unsigned long long)b.n_resets);
    assert_true(b.n_exposures > (policy ? 47000 : 40000));
    assert_true(n_steps >= b.n_steps * 9 / 10 && n_resets >= b.n_resets * 9 / 10);
    assert_true(sum.dropped[SV_DROP_ERROR_FLAG] > 0 && sum.dropped[SV_DROP_CLOCK_STEP] > 0);
    assert_true(sum.dropped[SV_DROP_ERROR_FLAG] >= b.n_errors);
    bench_close(&b);
  }
}

TEST(a_step_of_an_hour_relocks) {
  for (int dir = -1; dir <= 1; dir += 2)
    for (int mode = 0; mode < 2; mode++) {
      world_t w = world3();
      if (mode) use_one_clock(&w);
      bench_t b;
      sv_sync_cfg cfg = {
          .skew_limit_ns = 500000, .queue_len = 4, .clock_mode = mode ? SV_SYNC_CLOCK_COMMON : 0};
      // the estimate keeps the shortest delay, 5 ms here
      cfg.skew_limit_ns = mode ? 8000000 : 500000;
      bench_open(&b, &w, cfg, 4000);
      play(&b, &w, 1, 0, 300);
      b.step_ns[1] = dir * HOUR_NS;
      play(&b, &w, 2, 300, 300);
      b.step_ns[1] = 0;
      play(&b, &w, 3, 600, 300);
      assert_int_equal(sv_sync_ledger(&b.sync, 1)->dropped[SV_DROP_CLOCK_STEP], 2);
      assert_int_equal(b.n_exposures, 898); // one exposure a step
      sv_sync_event e;
      assert_int_equal(sv_sync_pop_event(&b.sync, &e), SV_OK);
      assert_int_equal(e.kind, SV_SYNC_EVENT_CLOCK_STEP);
      assert_true(e.detail - dir * HOUR_NS < SV_NS_PER_MS && e.detail - dir * HOUR_NS > -SV_NS_PER_MS);
      bench_close(&b);
    }
}

// A host that is held up for seconds and then gets everything at once: no clock has stepped.
TEST(a_held_up_host_is_no_step) {
  for (int mode = 0; mode < 2; mode++) {
    world_t w = world3();
    if (mode) use_one_clock(&w);
    bench_t b;
    sv_rng r = sv_rng_make(5, 1);
    bench_open(
        &b, &w,
        (sv_sync_cfg){.skew_limit_ns = 500000, .queue_len = 4, .clock_mode = mode ? SV_SYNC_CLOCK_COMMON : 0},
        4000);
    play(&b, &w, 1, 0, 300);
    sv_ns until_ns = 1000 * SV_NS_PER_S + 380 * PERIOD_NS;
    for (int k = 300; k < 380; k++)
      for (int c = 0; c < 3; c++) {
        sv_frame f = make_frame(&b, &w, &r, c, k);
        f.arrival_ns = until_ns + k * 1000;
        push(&b, f, true);
      }
    play(&b, &w, 2, 380, 300);
    assert_int_equal(b.n_exposures, 680);
    for (int c = 0; c < 3; c++) assert_int_equal(b.sync.streams[c].events[SV_SYNC_EVENT_CLOCK_STEP], 0);
    bench_close(&b);
  }
}

// The same while the streams start, before anything is known of clocks and rates: the first frames
// wait, as many as there are buffers; what comes meanwhile is lost; then all arrive at once.
static void hold_up_at(int mode, int i_first, sv_ns held_ns, int n_buffers) {
  world_t w = world3();
  if (mode) use_one_clock(&w);
  bench_t b;
  sv_rng r = sv_rng_make(5, 1);
  sv_sync_cfg cfg = {.skew_limit_ns = mode ? 500000 : 8000000,
                     .queue_len = 4,
                     .clock_mode = mode ? SV_SYNC_CLOCK_COMMON : 0};
  bench_open(&b, &w, cfg, 4000);
  int n_held = (int)(held_ns / PERIOD_NS), n_kept = n_held < n_buffers ? n_held : n_buffers;
  sv_ns until_ns = 1000 * SV_NS_PER_S + i_first * PERIOD_NS + held_ns;
  play(&b, &w, 1, 0, i_first);
  for (int k = i_first; k < i_first + n_kept; k++)
    for (int c = 0; c < 3; c++) {
      sv_frame f = make_frame(&b, &w, &r, c, k);
      f.arrival_ns = until_ns + (k * 3 + c) * 20000;
      push(&b, f, true);
    }
  for (int c = 0; c < 3; c++) b.seq[c] += (uint32_t)(n_held - n_kept);
  play(&b, &w, 2, i_first + n_held, 200);
  for (int c = 0; c < 3; c++) {
    if (b.sync.streams[c].events[SV_SYNC_EVENT_CLOCK_STEP])
      fail_msg("mode %d, frame %d held up for %lld ms, %d buffers: camera %d's clock has stepped", mode,
               i_first, (long long)(held_ns / SV_NS_PER_MS), n_buffers, c);
    const sv_ledger *l = sv_sync_ledger(&b.sync, c);
    assert_int_equal(l->dropped[SV_DROP_CLOCK_STEP], 0);
    assert_int_equal(l->dropped[SV_DROP_SEQUENCE_GAP], (uint64_t)(n_held - n_kept));
    // With a single clock nothing is lost. Otherwise the first frames have no common time yet.
    if (mode) assert_int_equal(l->delivered, (uint64_t)(i_first + n_kept + 200));
    else assert_true(l->delivered >= 195);
  }
  bench_close(&b);
}

TEST(a_host_held_up_at_the_start_is_no_step) {
  static const sv_ns held_ns[] = {1300 * SV_NS_PER_MS, 3 * SV_NS_PER_S, 6 * SV_NS_PER_S};
  for (int mode = 0; mode < 2; mode++)
    for (int i_first = 0; i_first < 5; i_first++)
      for (int h = 0; h < 3; h++)
        for (int n_buffers = 1; n_buffers <= 32; n_buffers *= 2)
          hold_up_at(mode, i_first, held_ns[h], n_buffers);
}

TEST(missing_camera_policies) {
  world_t w = world3();
  for (int policy = 0; policy < 2; policy++) {
    bench_t b;
    bench_open(&b, &w, (sv_sync_cfg){.skew_limit_ns = 500000, .queue_len = 6, .min_cameras = policy ? 1 : 0},
               4000);
    play(&b, &w, 1, 0, 100);
    world_t two = w;
    two.n_cameras = 2; // the third falls silent
    play(&b, &two, 2, 100, 200);
    int n = b.n_exposures;
    if (policy) assert_true(n >= 290);
    else assert_int_equal(n, 100);
    const uint64_t *d = sv_sync_ledger(&b.sync, 0)->dropped;
    if (!policy) assert_true(d[SV_DROP_NO_PARTNER] > 190 && d[SV_DROP_OVERFLOW] == 0);
    b.seq[2] += 200;
    play(&b, &w, 3, 300, 100);
    assert_true(b.n_exposures >= n + 95);
    assert_int_equal(sv_sync_ledger(&b.sync, 2)->dropped[SV_DROP_SEQUENCE_GAP], 200);
    bench_close(&b);
  }
}

// With a skew limit of many frames, a queue is full long before the limit. Exposures that go out
// without a silent or late camera must not consume the frames that it delivers when it is back.
TEST(a_camera_is_back_at_once_at_any_skew_limit) {
  world_t w = world3();
  for (int c = 0; c < 3; c++) w.cam[c].skew_ns = c * 9 * SV_NS_PER_MS;
  for (int i = 0; i < 3 * 2 * 2; i++) {
    int c = i % 3, n_before = i / 3 % 2 * 60; // 0: it is late at the start
    bool has_part = i / 6;
    bench_t b;
    sv_rng r = sv_rng_make(1, 1);
    bench_open(
        &b, &w,
        (sv_sync_cfg){.skew_limit_ns = 300 * SV_NS_PER_MS, .queue_len = 4, .min_cameras = has_part ? 2 : 0},
        2000);
    play(&b, &w, 1, 0, n_before);
    for (int k = n_before; k < n_before + 100; k++)
      for (int o = 0; o < 3; o++)
        if (o != c) play_frame(&b, &w, &r, o, k);
    int n = b.n_exposures;
    if (has_part) assert_true(n > n_before + 90);
    else assert_int_equal(n, n_before);
    play(&b, &w, 2, n_before + 100, 100);
    uint64_t n_whole = sv_sync_ledger(&b.sync, c)->delivered - (uint64_t)n_before;
    assert_true(n_whole >= 95);
    assert_true(sv_sync_ledger(&b.sync, c)->dropped[SV_DROP_LATE] <= 4);
    bench_close(&b);
  }
}

TEST(late_frames_are_named) {
  world_t w = world3();
  bench_t b;
  sv_rng r = sv_rng_make(1, 1);
  bench_open(&b, &w, (sv_sync_cfg){.skew_limit_ns = 500000, .queue_len = 4, .min_cameras = 2}, 100);
  play(&b, &w, 1, 0, 10);
  sv_frame late[6];
  for (int k = 10; k < 16; k++) {
    push(&b, make_frame(&b, &w, &r, 0, k), true);
    push(&b, make_frame(&b, &w, &r, 1, k), true);
    late[k - 10] = make_frame(&b, &w, &r, 2, k);
  }
  int n = b.n_exposures; // the full queue closed some without the third camera
  assert_true(n > 10);
  for (int k = 0; k < 6; k++) push(&b, late[k], true);
  assert_int_equal(sv_sync_ledger(&b.sync, 2)->dropped[SV_DROP_LATE], (uint64_t)(n - 10));
  assert_int_equal(b.n_exposures, 16);
  bench_close(&b);
}

TEST(a_full_pool_drops_the_oldest_exposure) {
  world_t w = world3();
  bench_t b;
  sv_rng r = sv_rng_make(1, 1);
  bench_open(&b, &w, (sv_sync_cfg){.skew_limit_ns = 500000, .queue_len = 4}, 200);
  sv_frame f;
  for (int k = 0; k < 10; k++)
    for (int c = 0; c < 3; c++) {
      push(&b, make_frame(&b, &w, &r, c, k), false); // nobody takes exposures
      while (sv_sync_pop_return(&b.sync, &f) == SV_OK) back(&b, &f);
    }
  for (int c = 0; c < 3; c++) {
    assert_int_equal(sv_sync_ledger(&b.sync, c)->dropped[SV_DROP_OVERFLOW], 6);
    assert_int_equal(sv_sync_ledger(&b.sync, c)->pending, 4);
  }
  drain(&b);
  assert_int_equal(b.n_exposures, 4);
  bench_close(&b);
}

TEST(a_full_return_queue_refuses_without_counting) {
  world_t w = world3();
  bench_t b;
  sv_rng r = sv_rng_make(1, 1);
  bench_open(&b, &w, (sv_sync_cfg){.skew_limit_ns = 500000, .queue_len = 2}, 200);
  sv_status s = SV_OK;
  for (int k = 0; k < 40 && s != SV_E_FULL; k++) {
    sv_frame f = make_frame(&b, &w, &r, 0, k);
    f.is_error = true;
    f.i_buffer = b.n_pushed;
    sv_ledger before = *sv_sync_ledger(&b.sync, 0);
    s = sv_sync_push(&b.sync, &f);
    if (s == SV_E_FULL) assert_memory_equal(&before, sv_sync_ledger(&b.sync, 0), sizeof before);
    else b.state[b.n_pushed++] = 1;
  }
  assert_int_equal(s, SV_E_FULL);
  bench_close(&b);
}

TEST(stamps_and_numbers_of_any_size) {
  world_t w = world3();
  bench_t b;
  bench_open(&b, &w, (sv_sync_cfg){.skew_limit_ns = 500000, .queue_len = 4}, 40000);
  sv_rng r = sv_rng_make(42, 1);
  static const sv_ns odd[] = {
      0, 1, -1, INT64_MAX, INT64_MIN, INT64_MAX / 4, HOUR_NS, -HOUR_NS, INT64_MAX / 5, INT64_MIN / 5};
  for (int i = 0; i < 30000; i++) {
    sv_frame f = {.i_camera = (int)sv_rng_below(&r, 3),
                  .sequence = sv_rng_below(&r, 4) ? (uint32_t)i : sv_rng_u32(&r),
                  .camera_ns = odd[sv_rng_below(&r, 10)],
                  .arrival_ns = odd[sv_rng_below(&r, 10)],
                  .exposure_ns = odd[sv_rng_below(&r, 10)]};
    push(&b, f, true);
  }
  bench_close(&b);
}

TEST(middle_of_exposure_by_stamp_source) {
  sv_sync_camera cams[3] = {{.clock = SV_CLOCK_MONOTONIC, .stamp = SV_STAMP_START},
                            {.clock = SV_CLOCK_MONOTONIC, .stamp = SV_STAMP_MIDDLE},
                            {.clock = SV_CLOCK_MONOTONIC, .stamp = SV_STAMP_END}};
  sv_sync_cfg cfg = {.n_cameras = 3, .cameras = cams, .skew_limit_ns = 10, .queue_len = 2};
  static _Alignas(64) uint8_t block[64 << 10];
  sv_arena a = sv_arena_make(block, sizeof block);
  sv_sync s;
  assert_int_equal(sv_sync_init(&s, &cfg, &a), SV_OK);
  for (int c = 0; c < 3; c++) {
    sv_frame f = {
        .i_camera = c, .camera_ns = 1000000 + c * 5000, .arrival_ns = 2000000, .exposure_ns = 10000};
    assert_int_equal(sv_sync_push(&s, &f), SV_OK);
  }
  sv_exposure e;
  sv_frame frames[3];
  assert_int_equal(sv_sync_pop_exposure(&s, &e, frames), SV_OK);
  assert_int_equal(e.time_ns, 1005000);
  assert_int_equal(e.skew_ns, 0);
}

TEST(bad_configs_are_refused) {
  sv_sync_camera cam = {0};
  sv_sync s;
  sv_sync_cfg good = {.n_cameras = 1, .cameras = &cam, .skew_limit_ns = 1, .queue_len = 2}, bad[6];
  for (int i = 0; i < 6; i++) bad[i] = good;
  bad[0].n_cameras = 0;
  bad[1].cameras = NULL;
  bad[2].queue_len = 1;
  bad[3].skew_limit_ns = -1;
  bad[4].min_cameras = 2;
  bad[5].max_drift = 1;
  static _Alignas(64) uint8_t block[64 << 10];
  for (int i = 0; i < 6; i++) {
    sv_arena a = sv_arena_make(block, sizeof block);
    assert_int_equal(sv_sync_bytes(&bad[i]), 0);
    assert_int_equal(sv_sync_init(&s, &bad[i], &a), SV_E_ARG);
  }
  size_t need = sv_sync_bytes(&good);
  sv_arena a = sv_arena_make(block, need - 1);
  assert_int_equal(sv_sync_init(&s, &good, &a), SV_E_NOMEM);
}

TEST(rates_are_those_of_the_stamps) {
  sv_camera_stat stat[1] = {{0}};
  sv_frame f = {.camera_ns = 7 * HOUR_NS};
  // A burst: all arrive at once, with stamps 40 ms apart; then the camera's clock steps.
  for (int i = 0; i < 20; i++, f.camera_ns += 40000000, f.arrival_ns += 1000) sv_camera_stat_frame(stat, &f);
  assert_true(stat[0].interval_ns > 39.99e6 && stat[0].interval_ns < 40.01e6);
  f.camera_ns -= HOUR_NS;
  f.arrival_ns += 40000000 - 1000;
  sv_camera_stat_frame(stat, &f);
  f.camera_ns += HOUR_NS;
  f.arrival_ns += 40000000;
  sv_camera_stat_frame(stat, &f);
  assert_true(stat[0].interval_ns > 39.99e6 && stat[0].interval_ns < 40.01e6);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(perfect_streams_lose_nothing),
      cmocka_unit_test(common_clock_is_exact),
      cmocka_unit_test(jitter_and_drift_are_estimated),
      cmocka_unit_test(losses_are_counted_one_by_one),
      cmocka_unit_test(duplicates_and_swaps_are_named),
      cmocka_unit_test(everything_at_once_stays_exact),
      cmocka_unit_test(a_step_of_an_hour_relocks),
      cmocka_unit_test(a_held_up_host_is_no_step),
      cmocka_unit_test(a_host_held_up_at_the_start_is_no_step),
      cmocka_unit_test(missing_camera_policies),
      cmocka_unit_test(a_camera_is_back_at_once_at_any_skew_limit),
      cmocka_unit_test(late_frames_are_named),
      cmocka_unit_test(a_full_pool_drops_the_oldest_exposure),
      cmocka_unit_test(a_full_return_queue_refuses_without_counting),
      cmocka_unit_test(stamps_and_numbers_of_any_size),
      cmocka_unit_test(middle_of_exposure_by_stamp_source),
      cmocka_unit_test(rates_are_those_of_the_stamps),
      cmocka_unit_test(bad_configs_are_refused),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
