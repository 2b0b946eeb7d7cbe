// SPDX-License-Identifier: Apache-2.0
// The V4L2 source on what only some devices have: frames of two planes, inputs with a signal of
// their own, sensors whose frame length can be set.
#include <errno.h>
#include <string.h>

#include "tests/common/test.h"
#include "tests/unit/v4l2_bench.h"

// --- two planes ----------------------------------------------------------------------------------
TEST(two_planes_are_one_frame) {
  sv_frame f;
  size_t y_bytes = FAKE_V4L2_WIDTH_PX * FAKE_V4L2_HEIGHT_PX;
  fake.device[0].is_mplane = true;
  must_open("/dev/video0,settle=0,format=NM12,buffers=4");
  assert_int_equal(caps(0)->format, SV_PIX_NV12);
  assert_int_equal(caps(0)->frame_bytes, y_bytes);
  assert_int_equal(fake_v4l2_n_mapped(&fake), 8);
  assert_int_equal(src.start(src.self), SV_OK);
  assert_int_equal(src.dequeue(src.self, &f, fake.now_ns + SV_NS_PER_S), SV_OK);
  assert_false(f.is_error);
  assert_true(fake_v4l2_is_frame(f.data, 0, f.sequence));
  for (size_t i = 0; i < y_bytes / 2; i++) assert_int_equal(f.chroma[i], f.data[0]);
  assert_int_equal(f.chroma_stride_bytes, FAKE_V4L2_WIDTH_PX);
  fake_v4l2_unplug(&fake, 0); // both stay readable
  run_for(100 * SV_NS_PER_MS);
  assert_true(fake_v4l2_is_frame(f.data, 0, f.sequence));
  assert_int_equal(f.chroma[y_bytes / 2 - 1], f.data[0]);
  fake_v4l2_plug(&fake, 0);
  assert_int_equal(src.requeue(src.self, &f), SV_OK);
  assert_true(run_for(400 * SV_NS_PER_MS).n[0] > 5);
  assert_int_equal(n_events(SV_CAMERA_SHORT_FRAME, NULL), 0);
  fake.device[0].has_short_chroma = true;
  tally t = run_for(200 * SV_NS_PER_MS);
  assert_int_equal(t.n[0], 0);
  assert_int_equal(n_events(SV_CAMERA_SHORT_FRAME, NULL), (uint64_t)t.n_error[0]);
  close_all();
  assert_true(open_spec("/dev/video0,format=NM12,dmabuf=on") < 0);
  assert_contains(err.text, "one plane");
  fake.device[0].is_mplane = false;
  assert_true(open_spec("/dev/video0,format=NM12") < 0);
  assert_int_equal(fake_v4l2_n_open(&fake), 0);
}

// --- a signal of its own -------------------------------------------------------------------------
TEST(a_signal_that_changes_or_goes_is_named) {
  static const int gone[] = {ENOLINK, ENOLCK, ERANGE};
  int64_t detail = -1, error = 0;
  fake.device[0].is_hdmi = true;
  must_open(BOTH);
  assert_int_equal(src.start(src.self), SV_OK);
  run_for(200 * SV_NS_PER_MS);
  for (int i = 0; i < 4; i++) { // none; another size
    if (i < 3) fake_v4l2_signal(&fake, 0, 0, gone[i]);
    else fake_v4l2_signal(&fake, 0, 32, 0);
    tally t = run_for(SV_NS_PER_S);
    assert_int_equal(t.n[0], 0);
    assert_int_equal(t.n_failed[0], 1);
    the_other_is_untouched(&t, 25);
    sv_camera_event e;
    int n_signal = 0, n_wrong = 0;
    while (src.event(src.self, &e) == SV_OK) {
      assert_int_equal(e.i_camera, 0);
      if (e.kind == SV_CAMERA_SIGNAL) {
        n_signal++;
        detail = e.detail;
      }
      if (e.kind == SV_CAMERA_LOST) error = e.detail;
      n_wrong += e.kind == SV_CAMERA_WRONG_SIZE;
    }
    assert_int_equal(n_signal, 1);
    assert_int_equal(detail, i < 3 ? 0 : 32 << 16 | FAKE_V4L2_HEIGHT_PX);
    assert_int_equal(error, i < 3 ? gone[i] : ESTALE);
    assert_int_equal(n_wrong, i == 3); // sizes that were told at the start must hold
    fake_v4l2_signal(&fake, 0, 0, 0);
    sv_ns back_ns = fake.now_ns;
    t = run_for(SV_NS_PER_S);
    assert_true(t.n[0] > 20 && t.first_ns[0] - back_ns <= 3 * PERIOD);
    assert_int_equal(n_events(SV_CAMERA_RETURNED, NULL), 1);
  }
  fake_v4l2_signal(&fake, 0, 0, 0); // something else has changed, such as colours: no fault
  tally t = run_for(SV_NS_PER_S);
  the_other_is_untouched(&t, 25);
  assert_in_range(t.n[0], 24, 26);
  assert_int_equal(n_events(SV_CAMERA_LOST, NULL), 0);
  close_all();
  fake_v4l2_signal(&fake, 0, 0, ENOLINK);
  assert_true(open_spec(BOTH) < 0);
  assert_contains(err.text, "/dev/video0: there is no signal at its input");
  assert_int_equal(fake_v4l2_n_open(&fake), 0);
  // The size follows the signal that is there.
  fake_v4l2_signal(&fake, 0, 32, 0);
  must_open("/dev/video0");
  assert_int_equal(caps(0)->width_px, 32);
  close_all();
}

// --- frame length --------------------------------------------------------------------------------
static sv_status set_duration(int64_t ns, int64_t *actual) {
  *actual = 0;
  return src.set_control(src.self, 0, SV_CONTROL_FRAME_DURATION_NS, ns, actual);
}

TEST(the_length_of_frames_can_be_set) {
  int64_t actual;
  must_open(BOTH); // neither blanking nor a rate that can be set
  assert_int_equal(src.start(src.self), SV_OK);
  assert_int_equal(set_duration(40 * SV_NS_PER_MS, &actual), SV_E_UNSUPPORTED);
  close_all();
  fake.device[0].has_blanking = true; // lines of 400 us
  must_open(BOTH);
  assert_int_equal(src.start(src.self), SV_OK);
  sv_camera_caps caps;
  assert_int_equal(src.caps(src.self, 0, &caps), SV_OK);
  assert_int_equal(caps.readout_ns, 48 * 400 * SV_NS_PER_US);
  assert_int_equal(src.caps(src.self, 1, &caps), SV_OK);
  assert_int_equal(caps.readout_ns, 0); // not told
  assert_int_equal(set_duration(41 * SV_NS_PER_MS + 100000, &actual), SV_OK);
  assert_int_equal(actual, 41200 * SV_NS_PER_US);
  tally t = run_for(100 * actual);
  assert_in_range(t.n[0], 99, 101);
  assert_int_equal(set_duration(SV_NS_PER_MS, &actual), SV_E_RANGE);
  assert_int_equal(set_duration(3 * SV_NS_PER_S, &actual), SV_E_RANGE);
  close_all();
  assert_int_equal(fake.device[0].control[6], 52); // as it was before
  fake_v4l2_init(&fake, 2);
  fake.device[0].can_set_rate = true;
  must_open(BOTH);
  assert_int_equal(src.start(src.self), SV_OK);
  assert_int_equal(set_duration(40020 * SV_NS_PER_US, &actual), SV_OK);
  assert_int_equal(actual, 40020 * SV_NS_PER_US);
  assert_int_equal(set_duration(FAKE_V4L2_PERIOD_NS, &actual), SV_OK);
  fake.device[0].is_coarse = true; // would double it
  assert_int_equal(set_duration(40030 * SV_NS_PER_US, &actual), SV_E_UNSUPPORTED);
  t = run_for(SV_NS_PER_S);
  assert_in_range(t.n[0], 24, 26);
  close_all();
}

int main(void) {
#define T(f) cmocka_unit_test_setup(f, clean)
  const struct CMUnitTest tests[] = {
      T(two_planes_are_one_frame),
      T(a_signal_that_changes_or_goes_is_named),
      T(the_length_of_frames_can_be_set),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
