// SPDX-License-Identifier: Apache-2.0
// A million frames through the capture side of the runtime, in virtual time, while its user is
// given one to four times the work it has time for: cameras with jitter, bursts, losses,
// duplicates, sequence resets and clock steps; a capture side and a user that run side by side,
// each with a time of its own. The ledger stays exact, memory flat, frames are taken up at once, no
// exposure is a half one, and what gives way does so in order: previews, training, exposures.
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>

#include "src/capture/governor.h"
#include "src/base/rng.h"
#include "src/sync/capture_queue.h"
#include "tests/common/test.h"

#define N_CAMERAS   3
#define N_BUFFERS   12
#define PERIOD_NS   33333333LL
#define CAP_WAITING 16 // a burst's

typedef struct {
  uint32_t sequence;
  sv_ns next_ns, step_ns; // next frame of its sensor; what its clock was set by
  int64_t slot;
  int n_waiting; // arrived, not dequeued
  sv_frame waiting[CAP_WAITING];
  int64_t slot_of[N_BUFFERS];
  bool is_taken[N_BUFFERS]; // waiting or on loan
  uint64_t n_sent, n_starved, n_lost, n_on_loan;
} camera_t;

static struct {
  camera_t cam[N_CAMERAS];
  sv_rng rng;
  sv_ns now_ns, burst_until_ns; // while the host is stalled nothing arrives, then everything at
                                // once
  uint64_t n_frames;
  bool is_clean; // no faults: for the count of what overload alone costs
} world;

static double chance(void) { return (double)sv_rng_f(&world.rng); }

static void put(camera_t *m, int c, sv_ns camera_ns, sv_ns arrival_ns, uint32_t sequence) {
  int b = 0;
  while (b < N_BUFFERS && m->is_taken[b]) b++;
  if (b == N_BUFFERS || m->n_waiting == CAP_WAITING) {
    m->n_starved++;
    return;
  }
  m->is_taken[b] = true;
  m->slot_of[b] = m->slot;
  m->waiting[m->n_waiting++] = (sv_frame){.i_camera = c,
                                          .i_buffer = b,
                                          .sequence = sequence,
                                          .camera_ns = camera_ns,
                                          .arrival_ns = arrival_ns,
                                          .exposure_ns = 8 * SV_NS_PER_MS};
}

// The sensor's next frame: on its way with all that can happen to it.
static void expose(int c) {
  camera_t *m = &world.cam[c];
  static const double drift[N_CAMERAS] = {50e-6, -50e-6, 20e-6};
  sv_ns true_ns = m->next_ns, delay_ns = (sv_ns)(4e6 + 1e6 * chance());
  double fault = world.is_clean ? 1 : chance();
  if (fault < 0.0002) m->sequence = 0;
  else if (fault < 0.0004) m->step_ns += (chance() < 0.5 ? -1 : 1) * 3600 * SV_NS_PER_S;
  sv_ns camera_ns = true_ns + (sv_ns)(drift[c] * (double)true_ns) + m->step_ns + c * 1000 * SV_NS_PER_S;
  sv_ns arrival_ns = true_ns + delay_ns;
  if (arrival_ns < world.burst_until_ns) arrival_ns = world.burst_until_ns;
  if (!world.is_clean && chance() < 0.0005) world.burst_until_ns = arrival_ns + 100 * SV_NS_PER_MS;
  world.n_frames++;
  uint32_t sequence = m->sequence++;
  if (fault > 0.99 && !world.is_clean) m->n_lost++;
  else {
    m->n_sent++;
    put(m, c, camera_ns, arrival_ns, sequence);
    if (fault > 0.985 && fault < 0.99) {
      m->n_sent++;
      put(m, c, camera_ns, arrival_ns, sequence);
    }
  }
  m->slot++;
  m->next_ns += PERIOD_NS;
}

// Sensors run ahead of the host by one frame, so that arrivals are known in time.
static void run_sensors(sv_ns until_ns) {
  for (;;) {
    int c = 0;
    for (int i = 1; i < N_CAMERAS; i++)
      if (world.cam[i].next_ns < world.cam[c].next_ns) c = i;
    if (world.cam[c].next_ns > until_ns) return;
    expose(c);
  }
}

static camera_t *earliest(void) {
  camera_t *best = NULL;
  for (int i = 0; i < N_CAMERAS; i++) {
    camera_t *m = &world.cam[i];
    if (m->n_waiting && (!best || m->waiting[0].arrival_ns < best->waiting[0].arrival_ns)) best = m;
  }
  return best;
}

static sv_status src_dequeue(void *self, sv_frame *f, sv_ns until_ns) {
  (void)self;
  run_sensors(until_ns > world.now_ns ? until_ns : world.now_ns);
  camera_t *m = earliest();
  if (!m || m->waiting[0].arrival_ns > (until_ns > world.now_ns ? until_ns : world.now_ns)) {
    if (until_ns > world.now_ns) world.now_ns = until_ns;
    return SV_AGAIN;
  }
  if (m->waiting[0].arrival_ns > world.now_ns) world.now_ns = m->waiting[0].arrival_ns;
  *f = m->waiting[0];
  memmove(m->waiting, m->waiting + 1, (size_t)--m->n_waiting * sizeof *m->waiting);
  m->n_on_loan++;
  return SV_OK;
}

static sv_status src_requeue(void *self, const sv_frame *f) {
  (void)self;
  camera_t *m = &world.cam[f->i_camera];
  assert_true(m->is_taken[f->i_buffer]);
  m->is_taken[f->i_buffer] = false;
  m->n_on_loan--;
  // What one frame costs the capture side, mostly 30 us, at times ten times as much.
  world.now_ns += chance() < 0.01 ? 300 * SV_NS_PER_US : 30 * SV_NS_PER_US;
  return SV_OK;
}

static sv_status src_start(void *self) {
  (void)self;
  return SV_OK;
}
static sv_ns clock_now(void *self) {
  (void)self;
  return world.now_ns;
}
static void clock_sleep(void *self, sv_ns ns) {
  (void)self;
  if (ns > world.now_ns) world.now_ns = ns;
}

// --- the user ------------------------------------------------------------------------------------

typedef struct {
  double load; // 1..4
  sv_governor governor;
  sv_ns now_ns;
  uint64_t n_exposures;
  sv_ns train_ns, train_since_ns;
} user_t;

static sv_capture_queue queue;
static user_t user;

static void check_exposure(const sv_exposure_slot *t) {
  int64_t slot = world.cam[0].slot_of[t->frames[0].i_buffer];
  assert_int_equal(t->exposure.present[0], (1u << N_CAMERAS) - 1);
  for (int i = 0; i < N_CAMERAS; i++) {
    assert_int_equal(t->frames[i].i_camera, i);
    assert_int_equal(world.cam[i].slot_of[t->frames[i].i_buffer], slot); // all of one instant
  }
}

// One piece of work, and the time that it takes at this load.
static void user_works(void) {
  sv_exposure_slot *t;
  sv_ns from_ns = user.now_ns;
  sv_work work = sv_governor_next(&user.governor, from_ns, sv_capture_queue_n_ready(&queue) > 0);
  double ms[SV_N_WORKS] = {[SV_WORK_EXPOSURE] = 8, [SV_WORK_TRAIN] = 3, [SV_WORK_PREVIEW] = 20};
  user.now_ns += (sv_ns)(ms[work] * user.load * (0.8 + 0.4 * chance()) * 1e6);
  if (work == SV_WORK_EXPOSURE) {
    assert_int_equal(sv_capture_queue_take(&queue, &t), SV_OK);
    check_exposure(t);
    user.n_exposures++;
    sv_capture_queue_give_back(&queue, t, true);
  }
  if (work == SV_WORK_TRAIN) user.train_ns += user.now_ns - from_ns;
  sv_governor_done(&user.governor, work, from_ns, user.now_ns);
}

static void check_ledgers(void) {
  for (int c = 0; c < N_CAMERAS; c++) assert_true(sv_ledger_is_exact(sv_sync_ledger(&queue.sync, c)));
}

// Both sides side by side, whichever is behind first, until so many frames were exposed.
static void run_until(uint64_t n_frames) {
  sv_ns capture_ns = world.now_ns;
  while (world.n_frames < n_frames) {
    if (capture_ns <= user.now_ns) {
      world.now_ns = capture_ns;
      camera_t *m = earliest();
      sv_ns until_ns =
          m && m->waiting[0].arrival_ns > capture_ns ? m->waiting[0].arrival_ns : capture_ns + SV_NS_PER_MS;
      assert_true(sv_capture_queue_step(&queue, until_ns) >= 0);
      capture_ns = world.now_ns;
    } else user_works();
    if (world.n_frames % 1024 == 0) check_ledgers();
  }
  world.now_ns = capture_ns;
}

static void open_queue(void) {
  static _Alignas(64) uint8_t block[1 << 20];
  static sv_camera_caps caps[N_CAMERAS];
  sv_arena a = sv_arena_make(block, sizeof block);
  sv_source source = {.n_cameras = N_CAMERAS,
                      .start = src_start,
                      .dequeue = src_dequeue,
                      .requeue = src_requeue,
                      .stop = src_start};
  sv_clock clock = {NULL, clock_now, clock_sleep};
  for (int i = 0; i < N_CAMERAS; i++)
    caps[i] = (sv_camera_caps){.fps = 30, .clock = SV_CLOCK_CAMERA, .stamp = SV_STAMP_START};
  sv_capture_queue_cfg cfg = {.n_cameras = N_CAMERAS,
                              .caps = caps,
                              .skew_limit_ns = 5 * SV_NS_PER_MS,
                              .queue_len = 6,
                              .cap_ready = 3};
  memset(&world, 0, sizeof world);
  memset(&user, 0, sizeof user);
  world.rng = sv_rng_make(7, 1);
  for (int i = 0; i < N_CAMERAS; i++) world.cam[i].next_ns = PERIOD_NS + i * 100 * SV_NS_PER_US;
  assert_int_equal(sv_capture_queue_init(&queue, &cfg, &source, &clock, &a), SV_OK);
  assert_int_equal(a.used_bytes, sv_capture_queue_bytes(&cfg));
  sv_arena_seal(&a);
  sv_governor_cfg gc = sv_governor_defaults(250 * SV_NS_PER_MS);
  sv_governor_init(&user.governor, &gc, 0);
  user.load = 1;
  assert_int_equal(sv_capture_queue_start(&queue, NULL), SV_OK);
}

static void close_queue(void) {
  assert_int_equal(sv_capture_queue_stop(&queue), SV_OK);
  for (int c = 0; c < N_CAMERAS; c++) {
    const sv_ledger *l = sv_sync_ledger(&queue.sync, c);
    const camera_t *m = &world.cam[c];
    assert_true(sv_ledger_is_exact(l) && l->pending == 0);
    assert_int_equal(l->delivered, user.n_exposures); // the same for all: no half exposures
    assert_int_equal(m->n_on_loan, 0);
    // Each frame that could be dequeued was, and is in the ledger; of those lost before, the gaps
    // that the numbers tell of.
    uint64_t came = m->n_sent - m->n_starved - (uint64_t)m->n_waiting;
    assert_true(l->captured >= came && l->captured <= came + m->n_lost + m->n_starved);
  }
  assert_int_equal(queue.sync.skew.n, user.n_exposures); // not of those that nobody took
  assert_int_equal(queue.n_device_errors, 0);
}

static long peak_kib(void) {
  struct rusage r;
  getrusage(RUSAGE_SELF, &r);
  return r.ru_maxrss;
}

typedef struct {
  uint64_t n_overload, n_delivered;
  double train_share;
  int slowdown;
} phase_t;

static phase_t run_phase(double load, uint64_t n_frames) {
  uint64_t delivered = user.n_exposures;
  run_until(world.n_frames + 6000); // until what the last load left is gone
  user.load = load;
  run_until(world.n_frames + 6000);
  phase_t p = {.n_overload = queue.sync.streams[0].ledger.dropped[SV_DROP_OVERLOAD]};
  sv_ns since_ns = user.now_ns;
  user.train_ns = 0;
  run_until(world.n_frames + n_frames - 12000);
  p.n_overload = queue.sync.streams[0].ledger.dropped[SV_DROP_OVERLOAD] - p.n_overload;
  p.n_delivered = user.n_exposures - delivered;
  p.train_share = (double)user.train_ns / (double)(user.now_ns - since_ns);
  p.slowdown = user.governor.slowdown;
  print_message(
      "load %.0fx: previews every 1/%d, training %.0f %% of the time, %llu exposures, %llu left out\n", load,
      p.slowdown, 100 * p.train_share, (unsigned long long)p.n_delivered, (unsigned long long)p.n_overload);
  return p;
}

TEST(a_million_frames) {
  phase_t p[4];
  open_queue();
  run_until(1000);
  long before_kib = peak_kib();
  for (int i = 0; i < 4; i++) p[i] = run_phase(i + 1, 250000);
  long grown_kib = peak_kib() - before_kib;
  sv_ns p999_ns = sv_skew_percentile_ns(&queue.latency, 99.9);
  sv_ledger l = sv_sync_ledger_sum(&queue.sync);
  print_message("%llu frames: %llu captured = %llu delivered + %llu dropped + %llu pending; dequeue latency "
                "p50 %.3f ms, "
                "p99.9 %.3f ms, max %.3f ms; memory grew by %ld KiB\n",
                (unsigned long long)world.n_frames, (unsigned long long)l.captured,
                (unsigned long long)l.delivered, (unsigned long long)sv_ledger_dropped(&l),
                (unsigned long long)l.pending, (double)sv_skew_percentile_ns(&queue.latency, 50) * 1e-6,
                (double)p999_ns * 1e-6, (double)queue.latency.max_ns * 1e-6, grown_kib);
  assert_true(world.n_frames >= 1000000);
  assert_true(p999_ns < 2 * SV_NS_PER_MS);
  assert_true(grown_kib < 256);
  // In this order things give way. (A burst of more exposures than may wait costs some at any
  // load.)
  assert_true(p[0].slowdown == 1 && p[0].n_overload < p[0].n_delivered / 1000 && p[0].train_share > 0.4);
  assert_true(p[1].slowdown > 1 && p[1].n_overload < p[1].n_delivered / 1000 && p[1].train_share > 0.38);
  assert_true(p[2].slowdown == SV_GOVERNOR_SLOWEST && p[2].n_overload < p[2].n_delivered / 100);
  assert_true(p[2].train_share < 0.4 && p[2].train_share > 0.15);
  assert_true(p[3].n_overload > 1000 && p[3].n_delivered > 70000);
  assert_true(p[3].train_share > 0.08 && p[3].train_share < 0.2);
  for (int k = 0; k < SV_N_SYNC_EVENTS; k++) // each of these has happened, and was named
    if (k != SV_SYNC_EVENT_BAD_FRAME && k != SV_SYNC_EVENT_OUT_OF_ORDER && k != SV_SYNC_EVENT_OVERFLOW)
      if (k != SV_SYNC_EVENT_PARTNER_TIMEOUT) assert_true(queue.sync.streams[1].events[k] > 0);
  close_queue();
}

// When the user comes back from a long absence, the load goes and everything has its own pace
// again.
TEST(overload_passes) {
  open_queue();
  world.is_clean = true;
  run_phase(4, 60000);
  phase_t p = run_phase(1, 60000);
  assert_int_equal(p.slowdown, 1);
  assert_int_equal(p.n_overload, 0);
  close_queue();
}

// A user that takes nothing at all: whole exposures go, buffers keep moving.
TEST(an_absent_user_loses_whole_exposures) {
  open_queue();
  world.is_clean = true;
  user.now_ns = INT64_MAX / 4;
  run_until(3000);
  for (int c = 0; c < N_CAMERAS; c++) {
    assert_int_equal(world.cam[c].n_starved, 0);
    assert_true(sv_sync_ledger(&queue.sync, c)->dropped[SV_DROP_OVERLOAD] >= 990);
    assert_int_equal(sv_sync_ledger(&queue.sync, c)->delivered,
                     3); // ready, and dropped for `stopped` in the end
  }
  close_queue();
}

TEST(bad_configs_are_refused) {
  static _Alignas(64) uint8_t block[1 << 16];
  sv_source source = {.n_cameras = 1};
  sv_clock clock = {NULL, clock_now, clock_sleep};
  sv_camera_caps caps = {.fps = 30};
  sv_err err;
  sv_capture_queue_cfg good = {.n_cameras = 1, .caps = &caps, .queue_len = 2, .cap_ready = 1}, bad[4];
  for (int i = 0; i < 4; i++) bad[i] = good;
  bad[0].n_cameras = 0;
  bad[1].cap_ready = 0;
  bad[2].queue_len = 0;
  bad[3].caps = NULL;
  for (int i = 0; i < 4; i++) {
    sv_arena a = sv_arena_make(block, sizeof block);
    assert_int_equal(sv_capture_queue_init(&queue, &bad[i], &source, &clock, &a), SV_E_ARG);
  }
  sv_arena a = sv_arena_make(block, sv_capture_queue_bytes(&good) - 1);
  assert_int_equal(sv_capture_queue_init(&queue, &good, &source, &clock, &a), SV_E_NOMEM);
  a = sv_arena_make(block, sizeof block);
  good.method = SV_SYNC_METHOD_TRIGGER; // and the source has no such line
  assert_int_equal(sv_capture_queue_init(&queue, &good, &source, &clock, &a), SV_OK);
  assert_int_equal(sv_capture_queue_start(&queue, &err), SV_E_UNSUPPORTED);
  assert_contains(err.text, "trigger");
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(a_million_frames),
      cmocka_unit_test(overload_passes),
      cmocka_unit_test(an_absent_user_loses_whole_exposures),
      cmocka_unit_test(bad_configs_are_refused),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
