// SPDX-License-Identifier: Apache-2.0
// The whole runtime on V4L2 cameras (behind their table of system calls): what they deliver is
// converted, trained on and accounted for; faults cost exposures, never the run.
#include <math.h>
#include <string.h>

#include "platform/camera/tiled.h"
#include "platform/codec/codec.h"
#include "tests/common/fake_v4l2.h"
#include "tests/common/test.h"
#include "tests/common/world.h"

static world w;
static fake_v4l2 fake;
static sv_v4l2 v4l2;
static sv_tiled tiled;
static sv_codec codec;
static uint8_t tiled_block[1 << 16], codec_block[1 << 20];

static sv_status decode(void *self, const uint8_t *data, size_t bytes, const sv_decoded *to, sv_err *err) {
  sv_picture out = {to->width_px, to->height_px, to->stride_bytes, SV_PIX_RGB8, to->rgb};
  return sv_codec_decode(self, data, bytes, &out, err);
}

// The simulator gives the rig, the cameras are ours. is_tiled: one camera, two sub-views side by
// side.
static void open_cameras(const char *options, bool is_tiled) {
  char spec[128];
  sv_camera_options o;
  sv_codec_cfg cc = {FAKE_V4L2_WIDTH_PX, FAKE_V4L2_HEIGHT_PX, false};
  sv_arena arena = sv_arena_make(fake.block, sizeof fake.block);
  sv_arena tiles = sv_arena_make(tiled_block, sizeof tiled_block),
           decoder = sv_arena_make(codec_block, sizeof codec_block);
  sv_v4l2_sys sys = fake_v4l2_sys(&fake);
  sv_clock clock = fake_v4l2_clock(&fake);
  fake_v4l2_init(&fake, 2);
  world_open_well(&w, is_tiled ? "textured,rig=stereo,size=32x48" : "textured,rig=stereo,size=64x48", 6, ~0u,
                  2);
  sv_fmt(spec, sizeof spec, "%s%s", is_tiled ? "/dev/video0" : "/dev/video0,/dev/video1", options);
  if (sv_camera_parse("v4l2", spec, &o, &w.err) < 0 ||
      sv_v4l2_init(&v4l2, &o, &sys, &clock, &arena, &w.err) < 0)
    fail_msg("%s", w.err.text);
  sv_source src = sv_v4l2_source(&v4l2);
  if (is_tiled) {
    if (sv_tiled_init(&tiled, &src, 2, 1, &tiles, &w.err) < 0) fail_msg("%s", w.err.text);
    src = sv_tiled_source(&tiled);
  }
  assert_int_equal(sv_codec_init(&codec, &cc, &decoder), SV_OK);
  w.inner.source = w.port.source = src;
  w.inner.clock = w.port.clock = clock;
  w.port.decoder = (sv_decoder){&codec, decode};
  for (int i = 0; i < 2; i++) assert_int_equal(src.caps(src.self, i, &w.caps[i]), SV_OK);
  w.cfg.train.n_gaussians = 100;
  w.cfg.steps = 5;
}

static void close_cameras(void) {
  sv_v4l2_close(&v4l2);
  assert_int_equal(fake_v4l2_n_open(&fake), 0);
  assert_int_equal(fake_v4l2_n_mapped(&fake), 0);
  sv_codec_close(&codec);
  world_close(&w);
}

static void must_run(void) {
  if (world_init(&w) < 0 || sv_app_run(&w.app, &w.err) < 0) fail_msg("%s", w.err.text);
  assert_int_equal(w.app.exposures.n, 6);
  assert_int_equal(world_stats(&w).step, 5);
  for (int i = 0; i < 2; i++) assert_true(sv_ledger_is_exact(sv_sync_ledger(&w.app.queue.sync, i)));
}

TEST(each_kind_of_frame_is_trained_on) {
  static const struct {
    const char *options;
    bool is_tiled;
  } cases[] = {{"", false}, // NV12
               {",format=YUYV", false},
               {",format=pRAA", false},
               {",format=Y16", false},
               {",format=MJPG", false},
               {",format=YUYV", true},
               {",format=MJPG", true}};
  for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
    open_cameras(cases[i].options, cases[i].is_tiled);
    must_run();
    assert_int_equal(w.app.capture.n_bad_exposures, 0);
    assert_true(world_has_line(&w, "25.0 fps")); // the statistics of a camera
    close_cameras();
  }
}

TEST(a_grey_frame_arrives_as_it_was) {
  sv_image_u8 image;
  sv_view view;
  open_cameras(",format=GREY", false);
  must_run();
  sv_exposures_get(&w.app.exposures, 3, 1, &image, &view);
  int v = image.px[0];
  for (int i = 0; i < FAKE_V4L2_WIDTH_PX * FAKE_V4L2_HEIGHT_PX * 3; i++) assert_int_equal(image.px[i], v);
  assert_true(v > 0);
  close_cameras();
}

// Exposure times in turn: raw frames become deep pictures, each with its own time, and what came
// between two is counted.
TEST(brackets_of_raw_frames_are_trained_on) {
  int n_short = 0;
  open_cameras(",format=pRAA,brackets=1:0.1", false);
  for (int i = 0; i < 2; i++) fake.device[i].n_delay = 3;
  w.cfg.is_deep = true;
  w.cfg.spacing = (sv_spacing_cfg){.every_ns = SV_NS_PER_S, .n_brackets = w.caps[0].n_brackets};
  must_run();
  for (int i = 0; i < 6; i++) {
    sv_image_deep deep;
    sv_exposures_deep(&w.app.exposures, i, 1, &deep);
    const bool is_short = fabsf(deep.exposure - 0.1f) < 0.01f;
    assert_true(is_short || deep.exposure == 1);
    n_short += is_short;
  }
  assert_int_equal(n_short, 3);
  assert_true(sv_sync_ledger(&w.app.queue.sync, 1)->dropped[SV_DROP_UNSETTLED] > 10);
  close_cameras();
}

// The header and the end are there, what lies between is not a picture: only the decoder sees it.
TEST(a_damaged_picture_costs_its_exposure) {
  open_cameras(",format=MJPG", false);
  size_t n = fake.jpeg_bytes[0], at = n / 2;
  for (size_t i = at; i + 2 < n && i < at + 64; i++) fake.jpeg[0][i] = 0xff;
  w.cfg.capture_timeout_ns = 2 * SV_NS_PER_S;
  assert_int_equal(world_init(&w), SV_OK);
  // none was whole: said, not trained on
  assert_int_equal(sv_app_run(&w.app, &w.err), SV_E_TIMEOUT);
  assert_true(w.app.capture.n_bad_exposures > 10);
  assert_int_equal(w.app.exposures.n, 0);
  assert_true(world_has_line(&w, "JPEG"));
  for (int i = 0; i < 2; i++) assert_true(sv_ledger_is_exact(sv_sync_ledger(&w.app.queue.sync, i)));
  close_cameras();
}

TEST(short_frames_are_dropped_by_name) {
  open_cameras("", false);
  fake.device[0].is_short = true;
  w.cfg.capture_timeout_ns = SV_NS_PER_S;
  assert_int_equal(world_init(&w), SV_OK);
  assert_int_equal(sv_app_run(&w.app, &w.err), SV_E_TIMEOUT);
  const sv_ledger *l = sv_sync_ledger(&w.app.queue.sync, 0);
  assert_true(sv_ledger_is_exact(l));
  assert_true(l->dropped[SV_DROP_ERROR_FLAG] > 10);
  assert_int_equal(l->delivered, 0);
  close_cameras();
}

// A host that is held up for seconds while the streams start, or at any of the first frames: no
// clock has stepped.
static sv_source held_inner;
static int n_dequeues, i_held;
static sv_ns held_ns;
static sv_status held_dequeue(void *self, sv_frame *f, sv_ns until_ns) {
  (void)self;
  if (n_dequeues++ == i_held) fake.now_ns += held_ns;
  return held_inner.dequeue(held_inner.self, f, until_ns > fake.now_ns ? until_ns : fake.now_ns);
}
static sv_status held_requeue(void *self, const sv_frame *f) {
  (void)self;
  return held_inner.requeue(held_inner.self, f);
}
static sv_status held_start(void *self) {
  (void)self;
  return held_inner.start(held_inner.self);
}
static sv_status held_stop(void *self) {
  (void)self;
  return held_inner.stop(held_inner.self);
}

TEST(a_host_held_up_at_the_start_costs_no_exposure) {
  static const char *const clocks[] = {",settle=0", ",settle=0,clock=boottime"};
  for (int k = 0; k < 2 * 7 * 2; k++) {
    i_held = k % 7;
    held_ns = (k / 7 % 2 ? 5000 : 1400) * SV_NS_PER_MS;
    open_cameras(clocks[k / 14], false);
    held_inner = w.port.source;
    w.port.source = (sv_source){.n_cameras = 2,
                                .caps = w.port.source.caps,
                                .start = held_start,
                                .dequeue = held_dequeue,
                                .requeue = held_requeue,
                                .stop = held_stop};
    n_dequeues = 0;
    w.cfg.skew_limit_ns = 10 * SV_NS_PER_MS;
    must_run();
    for (int i = 0; i < 2; i++) {
      const sv_ledger *l = sv_sync_ledger(&w.app.queue.sync, i);
      if (l->dropped[SV_DROP_CLOCK_STEP]) fail_msg("held up at frame %d: a false clock_step", i_held);
      assert_int_equal(w.app.queue.sync.streams[i].events[SV_SYNC_EVENT_CLOCK_STEP], 0);
    }
    close_cameras();
  }
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(each_kind_of_frame_is_trained_on),
      cmocka_unit_test(a_grey_frame_arrives_as_it_was),
      cmocka_unit_test(brackets_of_raw_frames_are_trained_on),
      cmocka_unit_test(a_damaged_picture_costs_its_exposure),
      cmocka_unit_test(short_frames_are_dropped_by_name),
      cmocka_unit_test(a_host_held_up_at_the_start_costs_no_exposure),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
