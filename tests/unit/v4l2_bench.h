// SPDX-License-Identifier: Apache-2.0
// C only. After cmocka's headers: two V4L2 cameras behind their table of system calls, for the
// tests of the source.
#ifndef SV_TESTS_UNIT_V4L2_BENCH_H
#define SV_TESTS_UNIT_V4L2_BENCH_H

#include <stdint.h>

#include "tests/common/fake_v4l2.h"
#include "tests/common/test.h"

static fake_v4l2 fake;
static sv_v4l2 v;
static sv_source src;
static sv_err err;
static sv_arena arena;

static sv_status open_spec(const char *spec) {
  sv_camera_options o;
  sv_v4l2_sys sys = fake_v4l2_sys(&fake);
  sv_clock clock = fake_v4l2_clock(&fake);
  arena = sv_arena_make(fake.block, sizeof fake.block);
  sv_status s = sv_camera_parse("v4l2", spec, &o, &err);
  if (s >= 0) s = sv_v4l2_init(&v, &o, &sys, &clock, &arena, &err);
  if (s >= 0) src = sv_v4l2_source(&v);
  return s;
}

static void must_open(const char *spec) {
  if (open_spec(spec) < 0) fail_msg("%s", err.text);
}

FIXTURE(clean) {
  fake_v4l2_init(&fake, 2);
  return 0;
}

static void close_all(void) {
  sv_v4l2_close(&v);
  assert_int_equal(fake_v4l2_n_open(&fake), 0);
  assert_int_equal(fake_v4l2_n_mapped(&fake), 0);
}

static const sv_camera_caps *caps(int i) {
  static sv_camera_caps c;
  assert_int_equal(src.caps(src.self, i, &c), SV_OK);
  return &c;
}

// Frames of each camera in so much time, each handed back at once; failures are counted, too.
typedef struct {
  int n[2], n_error[2], n_failed[2];
  sv_ns first_ns[2]; // arrival of the first good frame
} tally;
static tally run_for(sv_ns ns) {
  tally t = {{0}, {0}, {0}, {0}};
  sv_frame f;
  for (sv_ns end = fake.now_ns + ns; fake.now_ns < end;) {
    sv_status s = src.dequeue(src.self, &f, end);
    if (s == SV_E_DEVICE) t.n_failed[f.i_camera]++;
    if (s != SV_OK) continue;
    t.n_error[f.i_camera] += f.is_error;
    if (!f.is_error && !t.n[f.i_camera]++) t.first_ns[f.i_camera] = f.arrival_ns;
    assert_int_equal(src.requeue(src.self, &f), SV_OK);
  }
  return t;
}

// How many events of a kind camera 0 had; all are taken, and none may be of camera 1.
static uint64_t n_events(sv_camera_event_kind kind, int64_t *detail) {
  sv_camera_event e;
  uint64_t n = 0;
  while (src.event(src.self, &e) == SV_OK) {
    assert_int_equal(e.i_camera, 0);
    if (e.kind != kind) continue;
    n++;
    if (detail) *detail = e.detail;
  }
  return n;
}

#define BOTH   "/dev/video0,/dev/video1,settle=0"
#define PERIOD FAKE_V4L2_PERIOD_NS

// In all of them camera 1 goes on: 25 frames a second, sequence without a gap, its stream started
// once.
static void the_other_is_untouched(const tally *t, int n_frames) {
  assert_in_range(t->n[1], n_frames - 1, n_frames + 1);
  assert_int_equal(t->n_error[1] + t->n_failed[1], 0);
  assert_int_equal(fake.device[1].n_streamons, 1);
}

#endif
