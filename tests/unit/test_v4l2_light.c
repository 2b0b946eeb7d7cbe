// SPDX-License-Identifier: Apache-2.0
// Exposure times of V4L2 cameras: shared by all, over each camera's response; in turn (brackets),
// and which frame has which.
#include <linux/videodev2.h>
#include <string.h>

#include "tests/common/test.h"
#include "tests/unit/v4l2_bench.h"

// lock=shared: one camera measures, all get its values, also after a fault.
TEST(light_is_shared) {
  static const int32_t first[3] = {300, 20, 3500}, second[3] = {90, 200, 6000};
  static const int at[3] = {1, 2, 4};
  int32_t before[FAKE_V4L2_N_CONTROLS];
  for (int i = 0; i < 3; i++) {
    fake.device[0].control[at[i]] = first[i];
    fake.device[1].control[at[i]] = second[i];
  }
  memcpy(before, fake.device[1].control, sizeof before);
  must_open("/dev/video0,/dev/video1,settle=100,lock=shared");
  assert_true(caps(0)->is_light_shared && caps(1)->is_light_locked);
  assert_int_equal(src.start(src.self), SV_OK);
  for (int i = 0; i < 3; i++) assert_int_equal(fake.device[1].control[at[i]], first[i]);
  assert_int_equal(fake.device[1].control[0], V4L2_EXPOSURE_MANUAL);
  fake_v4l2_unplug(&fake, 1);
  run_for(200 * SV_NS_PER_MS);
  fake_v4l2_plug(&fake, 1);
  run_for(200 * SV_NS_PER_MS);
  for (int i = 0; i < 3; i++) assert_int_equal(fake.device[1].control[at[i]], first[i]);
  close_all();
  assert_memory_equal(fake.device[1].control, before, sizeof before);
  must_open("/dev/video0,/dev/video1,settle=0");
  assert_false(caps(0)->is_light_shared); // each has its own values
  close_all();
  must_open("/dev/video0,/dev/video1,settle=0,exposure=8000,gain=20,wb=5000");
  assert_true(caps(0)->is_light_shared);
  close_all();
  fake.device[1].has_controls = false;
  assert_int_equal(open_spec("/dev/video0,/dev/video1,lock=shared"), SV_E_UNSUPPORTED);
  assert_contains(err.text, "which lock=shared would set");
}

// A camera that is known to be more sensitive than the first gets a shorter exposure time, within
// its control's range, and its frames tell it.
TEST(shared_light_is_over_the_response) {
  static const float responses[3][2] = {{1, 1.5f}, {2, 1}, {1, 0.05f}};
  static const int32_t must[3] = {200, 600, 5000};
  static float response[2];
  for (int k = 0; k < 3; k++) {
    fake.device[0].control[1] = 300;
    fake.device[1].control[1] = 90;
    must_open("/dev/video0,/dev/video1,settle=0,lock=shared");
    v.cfg.response = response;
    for (int i = 0; i < 2; i++) response[i] = responses[k][i]; // known later than the cameras
    assert_int_equal(src.start(src.self), SV_OK);
    assert_int_equal(fake.device[0].control[1], 300);
    assert_int_equal(fake.device[1].control[1], must[k]);
    assert_true(caps(1)->is_light_shared);
    for (int n = 0; n < 4; n++) {
      sv_frame f;
      assert_int_equal(src.dequeue(src.self, &f, fake.now_ns + SV_NS_PER_S), SV_OK);
      assert_int_equal(f.exposure_ns, (f.i_camera ? must[k] : 300) * 100 * SV_NS_PER_US);
      assert_int_equal(src.requeue(src.self, &f), SV_OK);
    }
    close_all();
  }
}

// Exposure times in turn: each frame tells the one that it was taken with, or that it is not known.
TEST(brackets_are_told) {
  static const char *const options[] = {"brackets=1:0.1,bracket-delay=2", "brackets=0.1:0.5:1",
                                        "brackets=1:0.1,clock=boottime", "brackets=1:0.1,lock=shared"};
  for (int k = 0; k < 4; k++) {
    char spec[120];
    int n[2] = {0}, n_unsettled = 0, n_times[2] = {0}, n_both = 0;
    sv_ns last_ns[2] = {0}, at_ns[2] = {0};
    fake_v4l2_init(&fake, 2);
    for (int i = 0; i < 2; i++) {
      fake.device[i].n_delay = k == 0 ? 2 : 3;
      fake.device[i].control[1] = 300;
    }
    sv_fmt(spec, sizeof spec, "/dev/video0,/dev/video1,settle=100,%s", options[k]);
    must_open(spec);
    assert_true(caps(0)->n_brackets == (k == 1 ? 3 : 2) && !caps(0)->is_light_locked &&
                caps(0)->is_exposure_told);
    assert_int_equal(src.start(src.self), SV_OK);
    for (sv_ns end_ns = fake.now_ns + 4 * SV_NS_PER_S; fake.now_ns < end_ns;) {
      sv_frame f;
      if (src.dequeue(src.self, &f, end_ns) != SV_OK) continue;
      const int i = f.i_camera;
      n[i]++;
      n_unsettled += f.is_unsettled;
      if (!f.is_unsettled) {
        if (f.exposure_ns != fake_v4l2_exposure_ns(&fake.device[i], f.sequence))
          fail_msg("%s: frame %u of camera %d was taken in %d us, which is said to be %d", options[k],
                   f.sequence, i, (int)(fake_v4l2_exposure_ns(&fake.device[i], f.sequence) / 1000),
                   (int)(f.exposure_ns / 1000));
        n_times[i] += f.exposure_ns != last_ns[i];
        last_ns[i] = f.exposure_ns;
        at_ns[i] = f.camera_ns;
        if (i == 1) n_both += at_ns[1] - at_ns[0] < 2 * SV_NS_PER_MS; // one exposure
      }
      assert_int_equal(src.requeue(src.self, &f), SV_OK);
    }
    print_message("%s: %d and %d frames, %d of them unsettled, %d and %d changes, %d exposures\n", options[k],
                  n[0], n[1], n_unsettled, n_times[0], n_times[1], n_both);
    assert_true(n[0] > 95 && n_times[0] >= 11 && n_times[1] >= 11 && n_both >= n_times[0] - 1);
    close_all();
    assert_int_equal(fake.device[1].control[1], 300); // as before
  }
}

// What a control cannot do is told once, and frames tell what was done.
TEST(brackets_out_of_range) {
  int64_t id = 0;
  fake.device[0].control[1] = 3000;
  must_open("/dev/video0,settle=0,brackets=1:10");
  assert_int_equal(src.start(src.self), SV_OK);
  run_for(2 * SV_NS_PER_S);
  assert_int_equal(n_events(SV_CAMERA_CONTROL, &id), 1);
  assert_int_equal(id, V4L2_CID_EXPOSURE_ABSOLUTE);
  close_all();
  fake.device[0].has_controls = false;
  assert_int_equal(open_spec("/dev/video0,brackets=1:0.1"), SV_E_UNSUPPORTED);
  assert_contains(err.text, "cannot be set (brackets=)");
  assert_int_equal(open_spec("/dev/video0,brackets=1:0.1,lock=off"), SV_E_ARG);
  assert_contains(err.text, "expected lock=on");
  assert_int_equal(open_spec("/dev/video0,brackets=1"), SV_E_ARG);
  assert_int_equal(open_spec("/dev/video0,brackets=1:2:3:4:5"), SV_E_ARG);
  assert_int_equal(open_spec("/dev/video0,brackets=1:0"), SV_E_ARG);
}

// A camera that comes back goes on with the others.
TEST(brackets_outlive_a_fault) {
  must_open(BOTH ",brackets=1:0.1");
  assert_int_equal(src.start(src.self), SV_OK);
  run_for(SV_NS_PER_S);
  fake_v4l2_unplug(&fake, 0);
  tally t = run_for(SV_NS_PER_S);
  the_other_is_untouched(&t, 25);
  fake_v4l2_plug(&fake, 0);
  run_for(SV_NS_PER_S / 2);
  int n_long[2] = {0}, n_short[2] = {0};
  for (sv_ns end_ns = fake.now_ns + SV_NS_PER_S; fake.now_ns < end_ns;) {
    sv_frame f;
    if (src.dequeue(src.self, &f, end_ns) != SV_OK) continue;
    n_long[f.i_camera] += !f.is_unsettled && f.exposure_ns == 157 * 100 * SV_NS_PER_US;
    n_short[f.i_camera] += !f.is_unsettled && f.exposure_ns == 16 * 100 * SV_NS_PER_US;
    assert_int_equal(src.requeue(src.self, &f), SV_OK);
  }
  for (int i = 0; i < 2; i++) assert_true(n_long[i] >= 2 && n_short[i] >= 2);
  assert_int_equal(n_events(SV_CAMERA_RETURNED, NULL), 1);
  close_all();
}

int main(void) {
#define T(f) cmocka_unit_test_setup(f, clean)
  const struct CMUnitTest tests[] = {
      T(light_is_shared),       T(shared_light_is_over_the_response), T(brackets_are_told),
      T(brackets_out_of_range), T(brackets_outlive_a_fault),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
