// SPDX-License-Identifier: Apache-2.0
// Every system call of the V4L2 source fails once, for each call in turn: transient (this one) and
// lasting (it and all after it). Whatever happens, the other camera runs, no buffer is lost, and
// all is given back at the end; after a transient failure the camera runs again. Then: no heap call
// from open to close, MJPEG decoding included.
#include <errno.h>
#include <stdio.h>
#include <string.h>

#include "platform/codec/codec.h"
#include "tests/common/fake_v4l2.h"
#include "tests/common/test.h"
#include "tests/fault/heap_count.h"

#define SPEC "/dev/video0,/dev/video1,settle=40,stall=200,buffers=5"

static fake_v4l2 fake;
static sv_v4l2 v;
static sv_err err;

static sv_status open_spec(const char *spec) {
  sv_camera_options o;
  sv_v4l2_sys sys = fake_v4l2_sys(&fake);
  sv_clock clock = fake_v4l2_clock(&fake);
  sv_arena arena = sv_arena_make(fake.block, sizeof fake.block);
  sv_status s = sv_camera_parse("v4l2", spec, &o, &err);
  return s < 0 ? s : sv_v4l2_init(&v, &o, &sys, &clock, &arena, &err);
}

// Holds up to three frames of each camera, as sync does; n[i] counts the frames of a camera.
static void run(sv_source *src, sv_ns ns, int n[2]) {
  sv_frame held[2][3], f;
  int n_held[2] = {0, 0};
  for (sv_ns end = fake.now_ns + ns; fake.now_ns < end;) {
    sv_status s = src->dequeue(src->self, &f, end);
    if (s == SV_E_DEVICE || s == SV_AGAIN) {
      if (s == SV_AGAIN && fake.now_ns < end) fake.now_ns += SV_NS_PER_MS; // a signal came
      continue;
    }
    assert_int_equal(s, SV_OK);
    int c = f.i_camera;
    assert_true(c == 0 || c == 1);
    if (!f.is_error) {
      n[c]++;
      assert_true(fake_v4l2_is_frame(f.data, c, f.sequence));
    }
    if (n_held[c] == 3) { // the oldest goes back, its picture as it was
      if (!held[c][0].is_error) assert_true(fake_v4l2_is_frame(held[c][0].data, c, held[c][0].sequence));
      assert_int_equal(src->requeue(src->self, &held[c][0]), SV_OK);
      held[c][0] = held[c][1];
      held[c][1] = held[c][2];
      n_held[c]--;
    }
    held[c][n_held[c]++] = f;
  }
  for (int c = 0; c < 2; c++)
    for (int i = 0; i < n_held[c]; i++) assert_int_equal(src->requeue(src->self, &held[c][i]), SV_OK);
}

// One session with a failure at call `at` of camera 0. False: the session has fewer calls. is_hdmi:
// camera 0 has a signal of its own, and frames of two planes.
static bool is_hdmi;
static bool session(long at, bool is_lasting, int error) {
  fake_v4l2_init(&fake, 2);
  fake.device[0].is_hdmi = fake.device[0].is_mplane = fake.device[1].is_mplane = is_hdmi;
  fake.fail_at = at;
  fake.is_lasting = is_lasting;
  fake.fail_errno = error;
  sv_status s = open_spec(is_hdmi ? SPEC ",format=NM12" : SPEC);
  if (s >= 0) {
    sv_source src = sv_v4l2_source(&v);
    bool was_hit_before = fake.was_hit;
    int n[2] = {0, 0}, later[2] = {0, 0};
    s = src.start(src.self);
    assert_true(s == SV_OK || s == SV_E_DEVICE);
    if (s == SV_OK) {
      run(&src, 400 * SV_NS_PER_MS, n);
      run(&src, 400 * SV_NS_PER_MS, later);
      assert_in_range(later[1], 8, 11); // the other runs on
      if (!is_lasting && later[0] < 6)  // of ten: it is back after three
        fail_msg("call %ld (errno %d, before start %d): %d frames of camera 0 later", at, error,
                 was_hit_before, later[0]);
    }
    assert_int_equal(src.stop(src.self), SV_OK);
  } else {
    assert_true(fake.was_hit); // nothing else can be the reason
    assert_true(err.text[0] && !strchr(err.text, '\n'));
  }
  sv_v4l2_close(&v);
  assert_int_equal(fake_v4l2_n_open(&fake), 0);
  assert_int_equal(fake_v4l2_n_mapped(&fake), 0);
  return fake.was_hit;
}

TEST(every_call_fails_once) {
  static const int errors[] = {EIO, ENODEV, EBUSY, ENOMEM};
  for (size_t e = 0; e < sizeof errors / sizeof *errors; e++) {
    long n = 1;
    while (session(n, false, errors[e])) n++;
    assert_true(n > 150); // or nothing was tried
    if (e == 0) printf("%ld calls failed once\n", n - 1);
  }
}

TEST(every_call_fails_from_there_on) {
  long n = 1;
  while (session(n, true, ENODEV)) n++;
  assert_true(n > 100);
}

TEST(every_call_of_a_receiver_fails) {
  is_hdmi = true;
  for (int is_lasting = 0; is_lasting < 2; is_lasting++) {
    long n = 1;
    while (session(n, is_lasting, ENODEV)) n++;
    assert_true(n > 100);
    printf("%ld calls of a receiver failed\n", n - 1);
  }
  is_hdmi = false;
}

TEST(no_heap_call_while_cameras_come_and_go) {
  static uint8_t block[2 << 20], rgb[FAKE_V4L2_WIDTH_PX * FAKE_V4L2_HEIGHT_PX * 3];
  sv_arena arena = sv_arena_make(block, sizeof block);
  sv_codec codec;
  sv_codec_cfg cc = {FAKE_V4L2_WIDTH_PX, FAKE_V4L2_HEIGHT_PX, false};
  sv_picture out = {FAKE_V4L2_WIDTH_PX, FAKE_V4L2_HEIGHT_PX, FAKE_V4L2_WIDTH_PX * 3, SV_PIX_RGB8, rgb};
  fake_v4l2_init(&fake, 2);
  assert_int_equal(sv_codec_init(&codec, &cc, &arena), SV_OK);
  sv_heap_arm();
  assert_int_equal(open_spec(SPEC ",format=MJPG"), SV_OK);
  sv_source src = sv_v4l2_source(&v);
  assert_int_equal(src.start(src.self), SV_OK);
  int n = 0;
  for (int i = 0; i < 400; i++) {
    sv_frame f;
    if (i == 200) fake_v4l2_unplug(&fake, 0);
    if (i == 260) fake_v4l2_plug(&fake, 0);
    if (src.dequeue(src.self, &f, fake.now_ns + SV_NS_PER_S) != SV_OK) continue;
    n += sv_codec_decode(&codec, f.data, f.data_bytes, &out, &err) == SV_OK;
    assert_int_equal(src.requeue(src.self, &f), SV_OK);
  }
  assert_int_equal(src.stop(src.self), SV_OK);
  sv_v4l2_close(&v);
  sv_heap_disarm();
  sv_heap_report();
  assert_true(n > 380);
  assert_int_equal(sv_heap_count(), 0);
  sv_codec_close(&codec);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(every_call_fails_once),
      cmocka_unit_test(every_call_fails_from_there_on),
      cmocka_unit_test(every_call_of_a_receiver_fails),
      cmocka_unit_test(no_heap_call_while_cameras_come_and_go),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
