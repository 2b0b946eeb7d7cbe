// SPDX-License-Identifier: Apache-2.0
// The V4L2 source against cameras behind its table of system calls: formats, controls, and each
// fault with its named event, the other camera untouched, and the recovery.
#include <errno.h>
#include <linux/videodev2.h>
#include <string.h>

#include "platform/v4l2/format.h"
#include "src/sync/capture_queue.h"
#include "tests/common/test.h"
#include "tests/unit/v4l2_bench.h"

// --- opening -------------------------------------------------------------------------------------
TEST(every_format_is_described) {
  for (int i = 0; i < sv_v4l2_n_formats; i++)
    for (int is_mplane = 0; is_mplane < 2; is_mplane++) {
      char spec[64];
      const sv_v4l2_format *f = &sv_v4l2_formats[i];
      if (f->format == SV_PIX_JPEG && strcmp(f->name, "MJPG") != 0) continue;
      if (!strcmp(f->name, "NM12")) continue; // two planes: a test of its own
      fake_v4l2_init(&fake, 1);
      fake.device[0].is_mplane = is_mplane;
      sv_fmt(spec, sizeof spec, "/dev/video0,settle=0,format=%.4s", f->name);
      must_open(spec);
      assert_int_equal(caps(0)->format, f->format);
      assert_int_equal(caps(0)->width_px, FAKE_V4L2_WIDTH_PX);
      size_t bytes = sv_pixel_frame_bytes(f->format, FAKE_V4L2_WIDTH_PX, FAKE_V4L2_HEIGHT_PX);
      if (bytes) assert_int_equal(caps(0)->frame_bytes, bytes);
      assert_int_equal(src.start(src.self), SV_OK);
      sv_frame fr;
      assert_int_equal(src.dequeue(src.self, &fr, fake.now_ns + SV_NS_PER_S), SV_OK);
      assert_false(fr.is_error);
      if (bytes) assert_int_equal(fr.data_bytes, bytes);
      close_all();
    }
}

TEST(stamps_and_rates_are_told) {
  must_open("/dev/video0,settle=0");
  assert_int_equal(caps(0)->clock, SV_CLOCK_MONOTONIC);
  assert_int_equal(caps(0)->stamp, SV_STAMP_START);
  assert_true(caps(0)->fps == 25);
  assert_string_equal(caps(0)->name, "video0");
  close_all();
  must_open("/dev/video0,settle=0,clock=boottime,stamp=middle");
  assert_int_equal(caps(0)->clock, SV_CLOCK_BOOTTIME);
  assert_int_equal(caps(0)->stamp, SV_STAMP_MIDDLE);
  close_all();
}

TEST(the_part_of_the_sensor_is_told) {
  fake_device *d = &fake.device[0];
  must_open("/dev/video0,settle=0");
  assert_int_equal(caps(0)->area.sensor_width_px, 0); // it does not say
  close_all();
  const int crop[4] = {640, 480, 2560, 1920};
  memcpy(d->crop_px, crop, sizeof crop);
  d->bounds_px[0] = 4056;
  d->bounds_px[1] = 3040;
  must_open("/dev/video0,settle=0");
  const sv_sensor_area *a = &caps(0)->area;
  assert_true(a->sensor_width_px == 4056 && a->sensor_height_px == 3040 && a->x0_px == 640 &&
              a->y0_px == 480 && a->width_px == 2560 && a->height_px == 1920);
  close_all();
  d->is_letterbox = true;
  must_open("/dev/video0,settle=0");
  assert_int_equal(caps(0)->area.sensor_width_px, 0);
  close_all();
}

TEST(sync_is_of_each_camera) {
  sv_camera_options o;
  assert_ok(sv_camera_parse("libcamera", "sync=server,0,1,2", &o, &err), &err);
  assert_true(o.sync[0] == SV_RPI_SYNC_SERVER && o.sync[1] == SV_RPI_SYNC_CLIENT &&
              o.sync[2] == SV_RPI_SYNC_CLIENT);
  assert_ok(sv_camera_parse("libcamera", "0,1,sync=client", &o, &err), &err);
  assert_true(o.sync[0] == SV_RPI_SYNC_CLIENT && o.sync[1] == SV_RPI_SYNC_CLIENT);
  assert_ok(sv_camera_parse("libcamera", "0,1,2,sync=client:server:off", &o, &err), &err);
  assert_true(o.sync[0] == SV_RPI_SYNC_CLIENT && o.sync[1] == SV_RPI_SYNC_SERVER &&
              o.sync[2] == SV_RPI_SYNC_OFF);
  assert_true(sv_camera_has_sync(&o));
  assert_ok(sv_camera_parse("libcamera", "0,1,sync=off", &o, &err), &err);
  assert_false(sv_camera_has_sync(&o));
}

TEST(a_fast_enough_format_is_chosen) {
  must_open("/dev/video0");
  assert_int_equal(caps(0)->format, SV_PIX_NV12); // the preferred one
  close_all();
  fake.device[0].max_fps_raw = 5; // as USB 2 does at large sizes
  must_open("/dev/video0");
  assert_int_equal(caps(0)->format, SV_PIX_JPEG);
  close_all();
  must_open("/dev/video0,fps=5");
  assert_int_equal(caps(0)->format, SV_PIX_NV12);
  close_all();
}

TEST(what_cannot_be_opened_is_refused_with_a_sentence) {
  static const struct {
    const char *spec, *says;
  } bad[] = {{"/dev/video7", "/dev/video7: the camera cannot be opened"},
             {"/dev/video0,size=640x480", "no format of 640x480 px"},
             {"/dev/video0,format=H264", "format H264 is not known"},
             {"/dev/video0,/dev/video0", "named twice"},
             {"size=640x480", "expected a camera before the options"},
             {"", "no camera is named, expected names"},
             {"/dev/video0,speed=1", "\"speed=1\" is not an option"},
             {"/dev/video0,size=4x4", "\"size=4x4\""},
             {"/dev/video0,buffers=2", "\"buffers=2\""},
             {"/dev/video0,fps=nan", "\"fps=nan\""},
             {"/dev/video0,sync=server", "libcamera only"},
             {"/dev/video0,/dev/video1,sync=server:server", "names 2 servers"},
             {"/dev/video0,/dev/video1,sync=off:client:client", "3 words for 2 cameras"},
             {"/dev/video0,sync=server:", "\"sync=server:\""},
             {"/dev/video0,sync=master", "\"sync=master\""}};
  for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
    assert_true(open_spec(bad[i].spec) < 0);
    if (!strstr(err.text, bad[i].says)) fail_msg("%s: %s", bad[i].spec, err.text);
    assert_int_equal(fake_v4l2_n_open(&fake), 0);
  }
  fake.device[1].is_busy = true;
  assert_true(open_spec(BOTH) < 0);
  assert_contains(err.text, "/dev/video1");
  assert_contains(err.text, "another program uses it");
  assert_int_equal(fake_v4l2_n_mapped(&fake), 0);
  fake.device[0].has_controls = false;
  assert_true(open_spec("/dev/video0,exposure=5000") < 0);
  assert_contains(err.text, "exposure time cannot be set");
  assert_int_equal(fake_v4l2_n_open(&fake), 0);
}

TEST(cameras_are_listed) {
  char text[2048];
  sv_str s = sv_str_make(text, sizeof text);
  sv_v4l2_sys sys = fake_v4l2_sys(&fake);
  assert_int_equal(sv_v4l2_list(&s, &sys), 2);
  assert_contains(text, "v4l2:/dev/video1");
  assert_contains(text, "fake camera (fake:0)  YUYV,GREY,MJPG 64x48@25\n");
  assert_int_equal(fake_v4l2_n_open(&fake), 0);
}

TEST(buffers_are_exported) {
  sv_frame f;
  must_open("/dev/video0,settle=0,dmabuf=on,buffers=4");
  assert_int_equal(fake.n_exported, 4);
  assert_int_equal(src.start(src.self), SV_OK);
  assert_int_equal(src.dequeue(src.self, &f, fake.now_ns + SV_NS_PER_S), SV_OK);
  assert_true(sv_v4l2_dmabuf(&v, &f) >= 0);
  assert_int_equal(src.requeue(src.self, &f), SV_OK);
  assert_int_equal(sv_v4l2_dmabuf(&v, &f), -1);
  close_all();
}

// --- trigger -------------------------------------------------------------------------------------
static int n_pulse_starts, n_pulse_stops, n_streaming;
static int streams(void) { return fake.device[0].is_streaming + fake.device[1].is_streaming; }
static sv_status pulses_start(void *self) {
  (void)self;
  n_pulse_starts++;
  n_streaming += streams();
  return SV_OK;
}
static void pulses_stop(void *self) {
  (void)self;
  n_pulse_stops++;
  n_streaming += streams();
}

TEST(pulses_come_while_all_cameras_stream) {
  static sv_trigger line;
  line = (sv_trigger){.kind = SV_LINE_GPIO};
  must_open(BOTH);
  assert_null(src.trigger); // nobody makes pulses
  v.cfg.trigger = (sv_camera_trigger){NULL, &line, pulses_start, pulses_stop};
  src = sv_v4l2_source(&v);
  n_pulse_starts = n_pulse_stops = n_streaming = 0;
  assert_int_equal(src.trigger(src.self, false), SV_OK);
  assert_int_equal(src.start(src.self), SV_OK);
  assert_int_equal(src.stop(src.self), SV_OK);
  assert_int_equal(n_pulse_starts + n_pulse_stops, 0);
  sv_copy(line.mode, sizeof line.mode, "trigger_mode:1"); // which they do not have
  assert_int_equal(src.trigger(src.self, true), SV_E_UNSUPPORTED);
  assert_int_equal(n_events(SV_CAMERA_TRIGGER, NULL), 1);
  for (int i = 0; i < 2; i++) fake.device[i].has_trigger = true;
  assert_int_equal(src.trigger(src.self, true), SV_OK);
  assert_int_equal(src.start(src.self), SV_OK);
  assert_int_equal(fake.device[0].control[7] + fake.device[1].control[7], 2);
  assert_int_equal(src.trigger(src.self, false), SV_E_ARG); // not while they run
  assert_int_equal(n_pulse_starts, 1);
  assert_int_equal(src.stop(src.self), SV_OK);
  assert_int_equal(n_pulse_stops, 1);
  assert_int_equal(n_streaming, 4); // both at the first pulse, and both at the last
  line.kind = SV_LINE_NONE;
  assert_int_equal(src.trigger(src.self, true), SV_E_UNSUPPORTED);
  close_all();
  assert_int_equal(fake.device[0].control[7] + fake.device[1].control[7], 0); // as before
}

// --- controls ------------------------------------------------------------------------------------
TEST(controls_hold_still_and_are_given_back) {
  int32_t before[FAKE_V4L2_N_CONTROLS];
  fake_device *d = &fake.device[0];
  memcpy(before, d->control, sizeof before);
  must_open("/dev/video0,exposure=8000,settle=200");
  sv_ns t0 = fake.now_ns;
  assert_int_equal(src.start(src.self), SV_OK);
  assert_true(fake.now_ns - t0 >= 200 * SV_NS_PER_MS); // time to settle
  assert_int_equal(d->control[0], V4L2_EXPOSURE_MANUAL);
  assert_int_equal(d->control[1], 80);
  assert_int_equal(d->control[2], before[2]); // where the automatic control has left it
  assert_int_equal(d->control[3], 0);
  sv_frame f;
  assert_int_equal(src.dequeue(src.self, &f, fake.now_ns + SV_NS_PER_S), SV_OK);
  assert_int_equal(f.exposure_ns, 8 * SV_NS_PER_MS);
  assert_int_equal(src.requeue(src.self, &f), SV_OK);
  int64_t actual;
  assert_int_equal(src.set_control(src.self, 0, SV_CONTROL_EXPOSURE_NS, 5 * SV_NS_PER_MS, &actual), SV_OK);
  assert_int_equal(actual, 5 * SV_NS_PER_MS);
  assert_int_equal(src.set_control(src.self, 0, SV_CONTROL_EXPOSURE_NS, 1, &actual), SV_E_RANGE);
  assert_int_equal(src.set_control(src.self, 0, SV_CONTROL_GAIN_MILLI, 1, &actual), SV_E_UNSUPPORTED);
  fake_v4l2_unplug(&fake, 0); // comes back with its own ideas
  run_for(200 * SV_NS_PER_MS);
  fake_v4l2_plug(&fake, 0);
  run_for(200 * SV_NS_PER_MS);
  assert_int_equal(d->control[0], V4L2_EXPOSURE_MANUAL);
  assert_int_equal(d->control[1], 50);
  assert_int_equal(d->control[3], 0);
  close_all();
  assert_memory_equal(d->control, before, sizeof before);
}

TEST(unlocked_controls_are_left_alone) {
  int32_t before[FAKE_V4L2_N_CONTROLS];
  memcpy(before, fake.device[0].control, sizeof before);
  must_open("/dev/video0,lock=off");
  assert_int_equal(src.start(src.self), SV_OK);
  assert_memory_equal(fake.device[0].control, before, sizeof before);
  close_all();
}

// --- faults --------------------------------------------------------------------------------------
TEST(an_unplugged_camera_comes_back) {
  sv_frame held[3], other;
  int64_t error = 0;
  must_open(BOTH);
  assert_int_equal(src.start(src.self), SV_OK);
  for (int n = 0; n < 3;) { // three frames of camera 0 are in use when it goes
    sv_frame *f = &held[n];
    assert_int_equal(src.dequeue(src.self, f, fake.now_ns + SV_NS_PER_S), SV_OK);
    if (f->i_camera == 0) n++;
    else assert_int_equal(src.requeue(src.self, f), SV_OK);
  }
  fake_v4l2_unplug(&fake, 0);
  tally t = run_for(SV_NS_PER_S);
  the_other_is_untouched(&t, 25);
  assert_int_equal(t.n[0], 0);
  assert_int_equal(t.n_failed[0], 1); // said once
  assert_int_equal(n_events(SV_CAMERA_LOST, &error), 1);
  assert_int_equal(error, ENODEV);
  for (int i = 0; i < 3; i++) assert_true(fake_v4l2_is_frame(held[i].data, 0, held[i].sequence));
  assert_int_equal(src.requeue(src.self, &held[0]), SV_OK);
  assert_true(src.requeue(src.self, &held[0]) < 0);
  fake_v4l2_plug(&fake, 0);
  sv_ns back_ns = fake.now_ns;
  t = run_for(SV_NS_PER_S);
  assert_true(t.first_ns[0] - back_ns <= 3 * PERIOD);
  the_other_is_untouched(&t, 25);
  assert_int_equal(n_events(SV_CAMERA_RETURNED, NULL), 1);
  for (int i = 1; i < 3; i++) { // what is still held has not been written over
    assert_true(fake_v4l2_is_frame(held[i].data, 0, held[i].sequence));
    assert_int_equal(src.requeue(src.self, &held[i]), SV_OK);
  }
  assert_int_equal(src.dequeue(src.self, &other, fake.now_ns + SV_NS_PER_S), SV_OK);
  close_all();
}

TEST(a_broken_queue_is_opened_again) {
  must_open(BOTH);
  assert_int_equal(src.start(src.self), SV_OK);
  run_for(200 * SV_NS_PER_MS);
  fake.device[0].is_fatal = true; // POLLERR, then EIO
  sv_ns fault_ns = fake.now_ns;
  tally t = run_for(SV_NS_PER_S);
  assert_true(t.first_ns[0] - fault_ns <= 3 * PERIOD);
  the_other_is_untouched(&t, 25);
  int64_t error = 0;
  assert_int_equal(n_events(SV_CAMERA_LOST, &error), 1);
  assert_int_equal(error, EIO);
  close_all();
}

TEST(a_camera_that_does_not_start_is_tried_again) {
  must_open(BOTH);
  fake.device[0].is_streamon_failing = true;
  assert_int_equal(src.start(src.self), SV_OK); // the other one runs
  tally t = run_for(SV_NS_PER_S);
  assert_int_equal(t.n[0], 0);
  the_other_is_untouched(&t, 25);
  fake.device[0].is_streamon_failing = false;
  sv_ns back_ns = fake.now_ns;
  t = run_for(SV_NS_PER_S);
  assert_true(t.first_ns[0] - back_ns <= 3 * PERIOD);
  assert_int_equal(src.stop(src.self), SV_OK);
  fake.device[0].is_streamon_failing = fake.device[1].is_streamon_failing = true;
  assert_int_equal(src.start(src.self), SV_E_DEVICE); // none runs
  close_all();
}

// Through the runtime's capture side: what a user reads.
TEST(what_is_wrong_is_said_of_each_camera) {
  static uint8_t block[1 << 18];
  static sv_capture_queue in;
  sv_camera_caps both[2];
  sv_clock clock = fake_v4l2_clock(&fake);
  sv_arena own = sv_arena_make(block, sizeof block);
  char text[200];
  must_open("/dev/video0,/dev/video1,settle=0");
  both[0] = *caps(0);
  both[1] = *caps(1);
  sv_capture_queue_cfg cfg = {
      .n_cameras = 2, .caps = both, .skew_limit_ns = SV_NS_PER_MS, .queue_len = 4, .cap_ready = 2};
  assert_int_equal(sv_capture_queue_init(&in, &cfg, &src, &clock, &own), SV_OK);
  fake.device[0].is_streamon_failing = fake.device[1].is_streamon_failing = true;
  assert_int_equal(sv_capture_queue_start(&in, &err), SV_E_DEVICE);
  assert_string_equal(err.text,
                      "the cameras did not start: video0: lost: the device failed or is gone (error 5)");
  sv_str line = sv_str_make(text, sizeof text);
  sv_camera_event e = {.kind = SV_CAMERA_STALLED, .i_camera = 1, .detail = 1127744960};
  sv_camera_event_line(&line, &e, both, 2);
  assert_string_equal(text, "video1: stalled: no frame came for too long (after 1128 ms)");
  close_all();
}

TEST(a_stalled_camera_is_started_again) {
  int64_t ns = 0;
  must_open(BOTH ",stall=300");
  assert_int_equal(src.start(src.self), SV_OK);
  run_for(200 * SV_NS_PER_MS);
  fake.device[0].is_silent = true;
  tally t = run_for(500 * SV_NS_PER_MS);
  the_other_is_untouched(&t, 12);
  assert_int_equal(n_events(SV_CAMERA_STALLED, &ns), 1);
  assert_in_range(ns, 300 * SV_NS_PER_MS, 360 * SV_NS_PER_MS);
  assert_int_equal(fake.device[0].n_streamons, 2);
  run_for(SV_NS_PER_S); // longer: it is opened anew
  assert_true(n_events(SV_CAMERA_LOST, NULL) >= 1);
  fake.device[0].is_silent = false;
  sv_ns back_ns = fake.now_ns;
  t = run_for(SV_NS_PER_S);
  assert_true(t.first_ns[0] - back_ns <= 3 * PERIOD);
  close_all();
}

TEST(a_host_held_up_is_no_stall) {
  must_open(BOTH ",stall=300");
  assert_int_equal(src.start(src.self), SV_OK);
  run_for(200 * SV_NS_PER_MS);
  fake.now_ns += 5 * SV_NS_PER_S; // frames wait in the driver meanwhile
  tally t = run_for(400 * SV_NS_PER_MS);
  assert_true(t.n[0] > 10 && t.n[1] > 10);
  assert_int_equal(n_events(SV_CAMERA_STALLED, NULL), 0);
  assert_int_equal(fake.device[0].n_streamons, 1);
  fake.device[0].is_silent = true; // a real one, seen by a reader who seldom looks
  for (int i = 0; i < 6; i++) {
    fake.now_ns += 400 * SV_NS_PER_MS;
    run_for(2 * SV_NS_PER_MS);
  }
  assert_true(n_events(SV_CAMERA_STALLED, NULL) >= 1);
  close_all();
}

TEST(damaged_frames_are_named) {
  static const struct {
    const char *options;
    size_t field;
    sv_camera_event_kind kind;
  } kinds[] = {{"", offsetof(fake_device, is_short), SV_CAMERA_SHORT_FRAME},
               {"", offsetof(fake_device, is_flagged), SV_CAMERA_DAMAGED},
               {",format=MJPG", offsetof(fake_device, is_short), SV_CAMERA_SHORT_FRAME},
               {",format=MJPG", offsetof(fake_device, is_wrong_jpeg), SV_CAMERA_WRONG_SIZE}};
  for (size_t i = 0; i < sizeof kinds / sizeof *kinds; i++) {
    char spec[64];
    fake_v4l2_init(&fake, 2);
    bool *is_on = (bool *)((char *)&fake.device[0] + kinds[i].field);
    sv_fmt(spec, sizeof spec, "%s%s", BOTH, kinds[i].options);
    must_open(spec);
    assert_int_equal(src.start(src.self), SV_OK);
    run_for(400 * SV_NS_PER_MS);
    *is_on = true;
    tally t = run_for(400 * SV_NS_PER_MS);
    assert_int_equal(t.n[0], 0);
    assert_in_range(t.n_error[0], 9, 11);
    the_other_is_untouched(&t, 10);
    // each one, by its name
    assert_int_equal(n_events(kinds[i].kind, NULL), (uint64_t)t.n_error[0]);
    *is_on = false;
    t = run_for(400 * SV_NS_PER_MS);
    assert_in_range(t.n[0], 9, 11);
    close_all();
  }
}

TEST(another_size_is_not_taken) {
  must_open(BOTH);
  assert_int_equal(src.start(src.self), SV_OK);
  fake_v4l2_unplug(&fake, 0);
  run_for(200 * SV_NS_PER_MS);
  fake_v4l2_plug(&fake, 0);
  fake.device[0].is_other_size = true;
  tally t = run_for(SV_NS_PER_S);
  assert_int_equal(t.n[0], 0);
  the_other_is_untouched(&t, 25);
  assert_int_equal(n_events(SV_CAMERA_WRONG_SIZE, NULL), 1);
  fake.device[0].is_other_size = false;
  sv_ns back_ns = fake.now_ns;
  t = run_for(SV_NS_PER_S);
  assert_true(t.first_ns[0] - back_ns <= 3 * PERIOD);
  close_all();
}

TEST(another_camera_is_not_taken) {
  must_open(BOTH);
  assert_int_equal(src.start(src.self), SV_OK);
  fake_v4l2_unplug(&fake, 0);
  run_for(200 * SV_NS_PER_MS);
  fake_v4l2_plug(&fake, 0);
  fake.device[0].is_other_camera = true;
  assert_int_equal(run_for(SV_NS_PER_S).n[0], 0);
  fake.device[0].is_other_camera = false;
  assert_true(run_for(SV_NS_PER_S).n[0] > 20);
  close_all();
}

TEST(a_hungry_reader_is_no_fault) {
  sv_frame f[8];
  must_open("/dev/video0,settle=0,buffers=8,stall=100");
  assert_int_equal(src.start(src.self), SV_OK);
  for (int i = 0; i < 8; i++)
    assert_int_equal(src.dequeue(src.self, &f[i], fake.now_ns + SV_NS_PER_S), SV_OK);
  assert_int_equal(src.dequeue(src.self, &f[0], fake.now_ns + SV_NS_PER_S), SV_AGAIN);
  assert_int_equal(n_events(SV_CAMERA_STARVED, NULL), 1);
  assert_int_equal(fake.device[0].n_streamons, 1);
  sv_frame back = {.i_camera = 0, .i_buffer = f[1].i_buffer};
  assert_int_equal(src.requeue(src.self, &back), SV_OK);
  assert_int_equal(src.dequeue(src.self, &f[0], fake.now_ns + SV_NS_PER_S), SV_OK);
  assert_true(f[0].sequence > 8); // the gap shows
  close_all();
}

TEST(frames_are_counted_where_the_driver_does_not) {
  sv_frame f;
  fake.device[0].has_frozen_sequence = true;
  must_open("/dev/video0,settle=0");
  assert_int_equal(src.start(src.self), SV_OK);
  for (uint32_t i = 0; i < 5; i++) {
    assert_int_equal(src.dequeue(src.self, &f, fake.now_ns + SV_NS_PER_S), SV_OK);
    assert_int_equal(f.sequence, i);
    assert_int_equal(src.requeue(src.self, &f), SV_OK);
  }
  // It starts to count after all: with its next number ours goes on.
  fake.device[0].has_frozen_sequence = false;
  fake.device[0].sequence = 1;
  assert_int_equal(src.dequeue(src.self, &f, fake.now_ns + SV_NS_PER_S), SV_OK);
  assert_int_equal(f.sequence, 5);
  close_all();
}

int main(void) {
#define T(f) cmocka_unit_test_setup(f, clean)
  const struct CMUnitTest tests[] = {
      T(every_format_is_described),
      T(stamps_and_rates_are_told),
      T(the_part_of_the_sensor_is_told),
      T(sync_is_of_each_camera),
      T(a_fast_enough_format_is_chosen),
      T(what_cannot_be_opened_is_refused_with_a_sentence),
      T(cameras_are_listed),
      T(buffers_are_exported),
      T(pulses_come_while_all_cameras_stream),
      T(controls_hold_still_and_are_given_back),
      T(unlocked_controls_are_left_alone),
      T(an_unplugged_camera_comes_back),
      T(a_broken_queue_is_opened_again),
      T(a_camera_that_does_not_start_is_tried_again),
      T(what_is_wrong_is_said_of_each_camera),
      T(a_stalled_camera_is_started_again),
      T(a_host_held_up_is_no_stall),
      T(damaged_frames_are_named),
      T(another_size_is_not_taken),
      T(another_camera_is_not_taken),
      T(a_hungry_reader_is_no_fault),
      T(frames_are_counted_where_the_driver_does_not),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
