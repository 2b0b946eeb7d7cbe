// SPDX-License-Identifier: Apache-2.0
// Skew on the simulator, against what it knows: measured skew within 100 us of the true difference
// of mid-exposures at 50 ppm and 1 ms of jitter (of the arrivals, of the stamps, of both); again so
// within 2 s of any clock step; free cameras brought together by the length of their frames;
// triggered ones; and the exposures of a real recording counted by hand.
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "platform/sim/sim.h"
#include "src/sync/frame_length.h"
#include "src/sync/sync.h"
#include "tests/common/test.h"

#define CAP_SKEWS 40000

static _Alignas(64) uint8_t block[4 << 20];
static sv_sim sim;
static sv_sync sync_of;
static sv_source source;
static struct {
  sv_ns time_ns, error_ns; // of each exposure: measured - true skew
} seen[CAP_SKEWS];
static int n_seen;

static void open_sim(const char *spec, sv_ns skew_limit_ns) {
  sv_err err;
  sv_sim_config cfg;
  sv_camera_caps caps;
  sv_sync_camera cams[SV_SIM_CAP_CAMERAS];
  sv_arena a = sv_arena_make(block, sizeof block);
  if (sv_sim_parse(&cfg, spec, &err) < 0 || sv_sim_init(&sim, &cfg, &a, &err) < 0) fail_msg("%s", err.text);
  source = sv_sim_source(&sim);
  for (int i = 0; i < source.n_cameras; i++) {
    assert_int_equal(source.caps(source.self, i, &caps), SV_OK);
    cams[i] = sv_sync_camera_of(&caps);
  }
  sv_sync_cfg sc = {
      .n_cameras = source.n_cameras, .cameras = cams, .skew_limit_ns = skew_limit_ns, .queue_len = 4};
  assert_int_equal(sv_sync_init(&sync_of, &sc, &a), SV_OK);
  n_seen = 0;
}

static void take_exposures(double true_skew_us) {
  sv_exposure e;
  sv_frame frames[SV_SIM_CAP_CAMERAS], f;
  while (sv_sync_pop_exposure(&sync_of, &e, frames) == SV_OK) {
    assert_true(n_seen < CAP_SKEWS);
    seen[n_seen].time_ns = e.time_ns;
    seen[n_seen++].error_ns = e.skew_ns - (sv_ns)(true_skew_us * 1e3);
    for (int i = 0; i < source.n_cameras; i++)
      assert_int_equal(source.requeue(source.self, &frames[i]), SV_OK);
  }
  while (sv_sync_pop_return(&sync_of, &f) == SV_OK) assert_int_equal(source.requeue(source.self, &f), SV_OK);
}

static void play(double true_skew_us, sv_frame_length *loop) {
  sv_frame f;
  sv_status s;
  assert_int_equal(source.start(source.self), SV_OK);
  while ((s = source.dequeue(source.self, &f, INT64_MAX / 8)) != SV_END) {
    sv_ns wanted_ns;
    int64_t set_ns;
    assert_int_equal(s, SV_OK);
    int c = f.i_camera;
    assert_true(sv_sync_push(&sync_of, &f) >= 0);
    if (loop && sv_frame_length_frame(loop, c, sync_of.streams[c].last_mid_host_ns, &wanted_ns)) {
      sv_ns was_ns = loop->cameras[c].set_ns;
      assert_int_equal(source.set_control(source.self, c, SV_CONTROL_FRAME_DURATION_NS, wanted_ns, &set_ns),
                       SV_OK);
      sv_frame_length_set(loop, c, set_ns);
      sv_sync_lengthened(&sync_of, c, set_ns - was_ns);
    }
    take_exposures(true_skew_us);
  }
  assert_int_equal(sv_sync_flush(&sync_of), SV_OK);
  take_exposures(true_skew_us);
  sv_ledger l = sv_sync_ledger_sum(&sync_of);
  assert_true(sv_ledger_is_exact(&l) && l.pending == 0);
  assert_int_equal(source.stop(source.self), SV_OK);
}

static int by_size(const void *a, const void *b) {
  sv_ns x = *(const sv_ns *)a, y = *(const sv_ns *)b;
  return x < y ? -1 : x > y;
}

// p99 of |measured - true| over the exposures from from_s to until_s of simulated time, us.
static double p99_us(double from_s, double until_s, int *n) {
  static sv_ns size[CAP_SKEWS];
  *n = 0;
  for (int i = 0; i < n_seen; i++) {
    double t_s = sv_ns_to_s(seen[i].time_ns - SV_SIM_EPOCH_NS);
    if (t_s >= from_s && t_s < until_s)
      size[(*n)++] = seen[i].error_ns < 0 ? -seen[i].error_ns : seen[i].error_ns;
  }
  if (!*n) return -1;
  qsort(size, (size_t)*n, sizeof *size, by_size);
  return (double)size[(*n * 99 + 99) / 100 - 1] * 1e-3;
}

#define DRIFT "textured,rig=stereo,size=16x16,fps=30,skew_us=400,drift_ppm=50,offset_ms=-350000"

TEST(skew_is_true) {
  static const struct {
    const char *what, *spec;
    double settle_s;
  } runs[] = {
      {"arrivals", DRIFT ",delay_jitter_us=1000,frames=3000", 3},
      {"stamps", DRIFT ",jitter_us=1000,frames=6000", 100},
      {"both", DRIFT ",jitter_us=1000,delay_jitter_us=1000,frames=6000", 100},
      {"stamps of the host's clock",
       "textured,rig=stereo,size=16x16,fps=30,skew_us=400,jitter_us=1000,frames=6000", 100},
  };
  for (size_t i = 0; i < sizeof runs / sizeof *runs; i++) {
    int n, n_start;
    open_sim(runs[i].spec, 10 * SV_NS_PER_MS);
    play(400, NULL);
    double start = p99_us(3, runs[i].settle_s + 3, &n_start), p99 = p99_us(runs[i].settle_s, 1e9, &n);
    print_message(
        "1 ms of jitter of %s: p99 of the error %.1f us over %d exposures from %.0f s on (before: %.1f us)\n",
        runs[i].what, p99, n, runs[i].settle_s, start);
    assert_true(n > 2900 && p99 >= 0 && p99 <= 100);
    assert_true(start < 1000);
    assert_true((uint64_t)n_seen >= sync_of.streams[0].ledger.captured - 2);
  }
}

TEST(steps_are_over_in_two_seconds) {
  static const int step_ms[] = {3600000, -3600000, 1000, -1000, 200, -200, 50, -50, 12};
  static const char *const jitter[] = {"delay_jitter_us=1000", "jitter_us=1000"};
  for (int k = 0; k < 2; k++)
    for (size_t i = 0; i < sizeof step_ms / sizeof *step_ms; i++) {
      char spec[200];
      int n, at_s = k ? 120 : 20; // stamps that scatter take longer to be known
      snprintf(spec, sizeof spec, DRIFT ",%s,frames=%d,fault=clockstep:1:%d:%d", jitter[k], (at_s + 20) * 30,
               at_s * 30, step_ms[i]);
      if (k && step_ms[i] != -3600000 && step_ms[i] != 200) continue; // two are enough
      open_sim(spec, 15 * SV_NS_PER_MS);
      play(400, NULL);
      double p99 = p99_us(at_s + 2, at_s + 20, &n);
      int n_after = n;
      double before = p99_us(at_s - 5, at_s, &n);
      print_message("step of %d ms, %s: p99 of the error %.1f us from 2 s after it (%.1f us before), %d of "
                    "540 exposures\n",
                    step_ms[i], jitter[k], p99, before, n_after);
      assert_true(p99 >= 0 && p99 <= 100 && n_after >= 538 - (step_ms[i] < 0) * 8);
      assert_int_equal(sync_of.streams[1].events[SV_SYNC_EVENT_CLOCK_STEP], 1);
    }
}

// Oscillators 60 ppm apart and 7 ms of phase: left alone they drift out of the limit, corrected
// they meet.
TEST(frame_lengths_bring_cameras_together) {
  static const char spec[] =
      "textured,rig=stereo,size=16x16,fps=30,skew_us=7000,rate_ppm=30,frames=9000,delay_jitter_us=500";
  sv_frame_length loop;
  static _Alignas(64) uint8_t loop_block[1024];
  uint64_t alone = 0;
  for (int is_on = 0; is_on < 2; is_on++) {
    int n;
    sv_arena a = sv_arena_make(loop_block, sizeof loop_block);
    open_sim(spec, 5 * SV_NS_PER_MS);
    assert_int_equal(
        sv_frame_length_init(&loop, &(sv_frame_length_cfg){.n_cameras = 2, .period_ns = sim.period_ns}, &a),
        SV_OK);
    play(0, is_on ? &loop : NULL);
    if (!is_on) {
      alone = sync_of.streams[0].ledger.delivered;
      continue;
    }
    double p99 = p99_us(30, 1e9, &n);
    print_message(
        "free cameras, 60 ppm, 7 ms apart: %llu of 9000 exposures alone; corrected %d of the last 8100, skew "
        "p99 %.1f us, %llu commands\n",
        (unsigned long long)alone, n, p99, (unsigned long long)loop.n_commands);
    assert_true(alone < 6000 && n >= 8090 && p99 <= 100);
  }
}

TEST(triggered_cameras_expose_together) {
  int n;
  open_sim("textured,rig=phone,size=16x16,fps=30,skew_us=7000,rate_ppm=200,frames=600", SV_NS_PER_MS);
  assert_int_equal(source.trigger(source.self, true), SV_OK);
  play(0, NULL);
  assert_int_equal(n_seen, 600);
  assert_true(p99_us(0, 1e9, &n) < 1e-9);
}

// --- a recording ---------------------------------------------------------------------------------

#define CAP_ROWS 256
static double rows[4][CAP_ROWS];
static int n_rows[4];

static int by_time(const void *a, const void *b) {
  double x = *(const double *)a, y = *(const double *)b;
  return x < y ? -1 : x > y;
}

static void read_rows(const char *path) {
  char line[200];
  FILE *f = fopen(path, "r");
  if (!f) fail_msg("%s cannot be read", path);
  memset(n_rows, 0, sizeof n_rows);
  while (fgets(line, sizeof line, f)) {
    int index, cam;
    double t_s;
    if (sscanf(line, "%d,%d,%lf", &index, &cam, &t_s) != 3 || cam < 0 || cam > 3) continue;
    assert_true(n_rows[cam] < CAP_ROWS);
    rows[cam][n_rows[cam]++] = t_s;
  }
  fclose(f);
  for (int c = 0; c < 4; c++) {
    assert_int_equal(n_rows[c], 57);
    qsort(rows[c], (size_t)n_rows[c], sizeof **rows, by_time);
  }
}

// By the definition, without queues or waiting: the most exposures of one frame of each camera
// within the limit, in order of time. Greedy from the oldest head is best: when the heads do not
// fit, the oldest one fits with nothing later either.
static int count_directly(double limit_s) {
  int at[4] = {0}, n = 0;
  for (;;) {
    int oldest = 0;
    double first = 1e300, last = -1e300;
    for (int c = 0; c < 4; c++) {
      if (at[c] >= n_rows[c]) return n;
      if (rows[c][at[c]] < first) {
        first = rows[c][at[c]];
        oldest = c;
      }
      if (rows[c][at[c]] > last) last = rows[c][at[c]];
    }
    if (last - first > limit_s) at[oldest]++;
    else {
      n++;
      for (int c = 0; c < 4; c++) at[c]++;
    }
  }
}

static int count_by_sync(sv_ns limit_ns) {
  sv_sync_camera cams[4] = {{0}};
  int at[4] = {0}, n = 0;
  sv_arena a = sv_arena_make(block, sizeof block);
  sv_exposure e;
  sv_frame frames[4], f;
  for (int c = 0; c < 4; c++)
    cams[c] = (sv_sync_camera){.clock = SV_CLOCK_MONOTONIC, .stamp = SV_STAMP_MIDDLE};
  sv_sync_cfg cfg = {.n_cameras = 4, .cameras = cams, .skew_limit_ns = limit_ns, .queue_len = 16};
  assert_int_equal(sv_sync_init(&sync_of, &cfg, &a), SV_OK);
  for (;;) {
    int c = -1;
    for (int i = 0; i < 4; i++)
      if (at[i] < n_rows[i] && (c < 0 || rows[i][at[i]] < rows[c][at[c]])) c = i;
    if (c < 0) break;
    sv_ns t_ns = (sv_ns)floor(rows[c][at[c]] * 1e9 + 0.5);
    f = (sv_frame){.i_camera = c, .sequence = (uint32_t)at[c]++, .camera_ns = t_ns, .arrival_ns = t_ns};
    assert_true(sv_sync_push(&sync_of, &f) >= 0);
    while (sv_sync_pop_exposure(&sync_of, &e, frames) == SV_OK) n++;
    while (sv_sync_pop_return(&sync_of, &f) == SV_OK) {
    }
  }
  return n;
}

TEST(a_recording_counted_by_hand) {
  static const int limits_ms[] = {1, 5, 20, 50};
  read_rows("tests/data/webcams_board/timestamps_all.csv");
  for (size_t i = 0; i < sizeof limits_ms / sizeof *limits_ms; i++) {
    int direct = count_directly(limits_ms[i] * 1e-3), ours = count_by_sync(limits_ms[i] * SV_NS_PER_MS);
    print_message("recording of four webcams, skew limit %d ms: %d exposures, counted directly %d\n",
                  limits_ms[i], ours, direct);
    assert_int_equal(ours, direct);
  }
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(skew_is_true),
      cmocka_unit_test(steps_are_over_in_two_seconds),
      cmocka_unit_test(frame_lengths_bring_cameras_together),
      cmocka_unit_test(triggered_cameras_expose_together),
      cmocka_unit_test(a_recording_counted_by_hand),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
