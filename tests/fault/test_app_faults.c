// SPDX-License-Identifier: Apache-2.0
// Every call that the runtime makes to the machine fails once: the first, the second, ... until a
// run no longer reaches it; once only, or from then on. Never a crash; one sentence; the files that
// were there are whole; and the runtime can go on saving when the machine works again. What it
// comes to is one of two states, each with every buffer accounted for: RUN, the run went on to its
// end; SAFE, it has ended with a sentence, its cameras stand still, and what was captured and
// trained is there to be saved.
#include <math.h>
#include <string.h>

#include "platform/codec/codec.h"
#include "src/format/sections.h"
#include "src/train/checkpoint.h"
#include "tests/common/fake_v4l2.h"
#include "tests/common/test.h"
#include "tests/common/world.h"

#define N_STEPS   6
#define CAP_CALLS 2000 // a run reaches fewer of any kind
#define OLD_CAP   (1u << 16)

static world w;
#define N_FILES 4
enum { MODEL, CHECKPOINT, REPORT, CHECKPOINT_1 };
static uint8_t old_file[N_FILES][OLD_CAP];
static size_t old_bytes[N_FILES];
static const char *const FILES[N_FILES] = {"model.ply", "checkpoint.bin", "run.json", "checkpoint.1.bin"};
static uint64_t whole_digest;

// Cameras that are brought together by the length of their frames, by a trigger line, that have a
// thread, whose pictures are compressed.
static world_call kind_of_run = WORLD_N_CALLS;

static sv_codec codec;
static sv_status decode(void *self, const uint8_t *data, size_t bytes, const sv_decoded *to, sv_err *err) {
  sv_picture out = {to->width_px, to->height_px, to->stride_bytes, SV_PIX_RGB8, to->rgb};
  return sv_codec_decode(self, data, bytes, &out, err);
}

// V4L2 cameras that deliver motion JPEG; the rig is the simulator's.
static fake_v4l2 fake;
static sv_v4l2 v4l2;
static void open_cameras(void) {
  static _Alignas(64) uint8_t block[1 << 20];
  sv_arena a = sv_arena_make(block, sizeof block), va = sv_arena_make(fake.block, sizeof fake.block);
  sv_codec_cfg cfg = {FAKE_V4L2_WIDTH_PX, FAKE_V4L2_HEIGHT_PX, false};
  sv_decoder decoder = {&codec, decode};
  sv_camera_options o;
  sv_v4l2_close(&v4l2);
  sv_codec_close(&codec);
  fake_v4l2_init(&fake, 2);
  sv_v4l2_sys sys = fake_v4l2_sys(&fake);
  sv_clock clock = fake_v4l2_clock(&fake);
  if (!world_open(&w, "textured,rig=stereo,size=64x48", 3, ~0u, 1) ||
      sv_camera_parse("v4l2", "/dev/video0,/dev/video1,settle=0,format=MJPG", &o, &w.err) < 0 ||
      sv_v4l2_init(&v4l2, &o, &sys, &clock, &va, &w.err) < 0 || sv_codec_init(&codec, &cfg, &a) < 0)
    fail_msg("%s", w.err.text);
  w.inner.source = sv_v4l2_source(&v4l2);
  w.inner.clock = w.port.clock = clock;
  for (int i = 0; i < 2; i++)
    assert_int_equal(w.inner.source.caps(w.inner.source.self, i, &w.caps[i]), SV_OK);
  w.port.source.rig_pose = NULL;
  w.port.source.trigger = NULL;
  w.cfg.has_bounds = false; // the simulator's are not those of cameras without poses
  w.port.decoder = world_decoder(&w, &decoder);
}

static void open_run(void) {
  bool is_aligned = kind_of_run == WORLD_SET_CONTROL;
  const char *spec = is_aligned ? "textured,rig=stereo,size=32x24,skew_us=900,rate_ppm=200"
                                : "textured,rig=stereo,size=32x24,skew_us=900";
  if (kind_of_run == WORLD_DECODE) open_cameras();
  else world_open_well(&w, spec, is_aligned ? 60 : 3, ~0u, 1);
  if (is_aligned) w.cfg.sync_method = SV_SYNC_METHOD_FRAME_LENGTH;
  if (kind_of_run == WORLD_TRIGGER) w.cfg.sync_method = SV_SYNC_METHOD_TRIGGER;
  if (kind_of_run == WORLD_WORKER) {
    w.cfg.is_continuous = true;
    w.port.worker = world_worker(&w);
  }
  w.cfg.train.n_gaussians = 24;
  w.cfg.steps = N_STEPS;
  w.cfg.is_resume = true;
  w.cfg.save_every_s = 0.002; // after each second step or so
  w.cfg.capture_timeout_ns = SV_NS_PER_S;
}

// Files of an earlier run, stopped after four steps, with both generations of the checkpoint.
static void make_old_files(void) {
  world_forget_files(&w);
  open_run();
  w.stop_at_step = 4;
  assert_int_equal(world_run(&w), SV_E_INTERRUPTED);
  assert_int_equal(sv_app_save_report(&w.app, NULL, &w.err), SV_OK);
  for (int i = 0; i < N_FILES; i++) {
    const world_file *f = world_find(&w, FILES[i]);
    if (!f) fail_msg("%s is not there", FILES[i]);
    assert_true(f->bytes <= OLD_CAP);
    memcpy(old_file[i], f->data, f->bytes);
    old_bytes[i] = f->bytes;
  }
  world_close(&w);
}

static void put_old_files(void) {
  for (int i = 0; i < N_FILES; i++) {
    world_file *f = w.store.file;
    while (strcmp(f->name, FILES[i]) != 0 && f->name[0]) f++;
    sv_copy(f->name, sizeof f->name, FILES[i]);
    memcpy(f->data, old_file[i], old_bytes[i]);
    f->bytes = old_bytes[i];
  }
}

// The old file, or a whole new one.
static void check_files(void) {
  assert_false(w.store.is_open); // nothing is left half written
  assert_int_equal(w.store.n_files, N_FILES);
  for (int i = 0; i < N_FILES; i++) {
    const world_file *f = world_find(&w, FILES[i]);
    sv_sections sections;
    sv_err err;
    if (!f && i == CHECKPOINT_1) continue; // it was older than a run that began anew
    assert_non_null(f);
    if (f->bytes == old_bytes[i] && !memcmp(f->data, old_file[i], f->bytes)) continue;
    if (i == MODEL) assert_int_equal(f->bytes, old_bytes[MODEL]); // as many Gaussians
    if ((i == CHECKPOINT || i == CHECKPOINT_1) &&
        sv_sections_open(&sections, &(sv_file_data){f->name, f->data, f->bytes}, SV_CHECKPOINT_KIND,
                         SV_CHECKPOINT_VERSION, &err) < 0)
      fail_msg("%s", err.text);
    if (i == REPORT) assert_int_equal(f->data[f->bytes - 2], '}');
  }
}

// A store that fails once costs a warning; one that fails for good costs the end of a run without a
// second place. A checkpoint that cannot be read once is one of two.
static bool must_fail(world_call c, bool is_lasting) {
  if (c == WORLD_BEGIN || c == WORLD_WRITE || c == WORLD_COMMIT || c == WORLD_READ) return is_lasting;
  return c != WORLD_DEQUEUE && c != WORLD_REQUEUE && c != WORLD_RIG_POSE && c != WORLD_EVENT &&
         c != WORLD_SET_CONTROL && c != WORLD_DECODE;
}

typedef enum { RUN, SAFE } end_state;
static long n_ended[2];

// Every frame that came was handed back, once; the cameras stand still; and the state says how it
// ended.
static void check_state(sv_status s) {
  end_state state = s < 0 && s != SV_E_INTERRUPTED ? SAFE : RUN;
  assert_int_equal(w.n_out, w.n_back);
  assert_false(w.app.queue.is_running || w.app.capture.is_running || w.app.capture.has_worker);
  assert_int_equal(w.app.state, state == SAFE ? SV_APP_FAILED : SV_APP_DONE);
  if (state == RUN) assert_int_equal(world_stats(&w).step, w.cfg.steps);
  n_ended[state]++;
  for (int i = 0; i < w.cfg.n_cameras; i++) {
    const sv_ledger *l = sv_sync_ledger(&w.app.queue.sync, i);
    assert_true(sv_ledger_is_exact(l) && l->pending == 0);
  }
}

static sv_status run_and_report(void) {
  sv_status s = world_run(&w);
  check_state(s);
  return s < 0 ? s : sv_app_save_report(&w.app, NULL, &w.err);
}

// One run with one failure. False when the run did not reach it.
static bool run_with(world_call c, long at, bool is_lasting) {
  open_run();
  if (kind_of_run == WORLD_N_CALLS) put_old_files();
  w.fault = (world_fault){.call = c, .at = at, .is_lasting = is_lasting};
  sv_status s = run_and_report();
  bool was_hit = w.fault.was_hit;
  if (!was_hit) {
    assert_int_equal(s, SV_OK);
    if (kind_of_run == WORLD_N_CALLS) assert_true(world_digest(&w) == whole_digest);
  } else if (s < 0) {
    if (!is_one_sentence(w.err.text)) fail_msg("%s, call %ld: \"%s\"", world_call_name(c), at, w.err.text);
    assert_int_equal(w.err.status, s);
  } else {
    if (must_fail(c, is_lasting))
      fail_msg("%s, call %ld failed and the run did not tell", world_call_name(c), at);
    // Seen and counted. Without a pose the rig stands still; a camera that takes no frame length is
    // left alone.
    if (c == WORLD_DEQUEUE || c == WORLD_REQUEUE) assert_true(w.app.capture.n_device_errors > 0);
    if (c == WORLD_SET_CONTROL) assert_true(world_has_line(&w, "free_running"));
    if (c >= WORLD_BEGIN && c <= WORLD_READ && !world_has_line(&w, "made to fail"))
      fail_msg("%s, call %ld failed without a word", world_call_name(c), at);
    if (c >= WORLD_BEGIN && c <= WORLD_READ) assert_true(world_digest(&w) == whole_digest);
    // and costs its exposure only
    if (c == WORLD_DECODE) assert_true(w.app.capture.n_bad_exposures > 0);
  }
  bool has_old_files = kind_of_run == WORLD_N_CALLS;
  if (has_old_files) check_files();
  // The machine works again: what there is can be saved, reported and shown.
  w.fault.at = 0;
  assert_int_equal(sv_app_save_model(&w.app, &w.err), SV_OK);
  assert_int_equal(sv_app_save_report(&w.app, NULL, &w.err), SV_OK);
  if (sv_driver_n_views(&w.app.trainer)) assert_int_equal(sv_app_publish_preview(&w.app), SV_OK);
  if (has_old_files) check_files();
  world_close(&w);
  return was_hit;
}

static void fail_each(world_call c) {
  for (int is_lasting = 0; is_lasting < 2; is_lasting++) {
    long at = 1;
    n_ended[RUN] = n_ended[SAFE] = 0;
    while (run_with(c, at, is_lasting != 0)) {
      // And a new run of the same folder completes, with the result of an undisturbed one.
      if (at % 7 == 1) {
        open_run();
        if (run_and_report() < 0) fail_msg("after %s %ld: %s", world_call_name(c), at, w.err.text);
        if (c >= WORLD_BEGIN && kind_of_run == WORLD_N_CALLS) assert_true(world_digest(&w) == whole_digest);
        world_close(&w);
      }
      at++;
      assert_true(at < CAP_CALLS);
    }
    print_message("%s: %ld calls failed %s: RUN %ld, SAFE %ld\n", world_call_name(c), at - 1,
                  is_lasting ? "for good" : "once", n_ended[RUN], n_ended[SAFE]);
    assert_true(at > 1); // a kind of call that no run makes would test nothing
  }
}

#define EACH(name, call)                                                                                     \
  TEST(test_##name) { fail_each(call); }
// The same in a run that makes this call.
#define EACH_OF_KIND(name, call)                                                                             \
  TEST(test_##name) {                                                                                        \
    world_store kept = w.store;                                                                              \
    kind_of_run = call;                                                                                      \
    world_forget_files(&w);                                                                                  \
    fail_each(call);                                                                                         \
    kind_of_run = WORLD_N_CALLS;                                                                             \
    w.store = kept;                                                                                          \
  }
EACH_OF_KIND(set_control, WORLD_SET_CONTROL)
EACH_OF_KIND(trigger, WORLD_TRIGGER)
EACH_OF_KIND(worker, WORLD_WORKER)
EACH_OF_KIND(decode, WORLD_DECODE)
EACH(rig_pose, WORLD_RIG_POSE)
EACH(event, WORLD_EVENT)
EACH(start, WORLD_START)
EACH(dequeue, WORLD_DEQUEUE)
EACH(requeue, WORLD_REQUEUE)
EACH(stop, WORLD_STOP)
EACH(begin, WORLD_BEGIN)
EACH(write, WORLD_WRITE)
EACH(commit, WORLD_COMMIT)
EACH(read, WORLD_READ)

// A store that is gone for good: few tries while training, and at the end everything is in the
// second place, with the model of an undisturbed run.
TEST(test_backs_off_and_rescues) {
  world_store kept = w.store;
  uint64_t digest[2];
  for (int is_bad = 0; is_bad < 2; is_bad++) {
    world_forget_files(&w);
    open_run();
    w.cfg.is_resume = false;
    w.cfg.steps = 3000; // 6 s or so of the machine's clock, a save due every 2 ms
    w.port.rescue = world_rescue(&w);
    if (is_bad) w.fault = (world_fault){.call = WORLD_COMMIT, .at = 1, .is_lasting = true};
    sv_status s = world_run(&w);
    if (s < 0) fail_msg("%s", w.err.text);
    digest[is_bad] = world_digest(&w);
    if (is_bad && w.fault.n[WORLD_COMMIT] > 20) fail_msg("%ld tries", w.fault.n[WORLD_COMMIT]);
    assert_true((w.app.files.rescued != 0) == (is_bad != 0));
    assert_true(world_has_line(&w, "is saved in the second place instead") == (is_bad != 0));
    assert_int_equal(w.second.n_files, is_bad ? 2 : 0);
    assert_int_equal(w.store.n_files, is_bad ? 0 : 3);
    world_close(&w);
  }
  assert_true(digest[0] == digest[1]);
  world_forget_files(&w);
  w.store = kept;
}

TEST(test_never_saves_what_is_not_finite) {
  world_store kept = w.store;
  world_forget_files(&w);
  open_run();
  world_run_well(&w);
  const size_t bytes = world_find(&w, "model.ply")->bytes;
  w.app.trainer.g.param[5] = (float)NAN;
  assert_error(sv_app_save_model(&w.app, &w.err), SV_E_RANGE, &w.err, "not finite");
  assert_one_sentence(w.err.text);
  assert_error(sv_app_save_checkpoint(&w.app, &w.err), SV_E_RANGE, &w.err, "not finite");
  assert_int_equal(world_find(&w, "model.ply")->bytes, bytes);
  const long n_tries = w.fault.n[WORLD_BEGIN];
  assert_error(sv_app_save_final(&w.app, &w.err), SV_E_RANGE, &w.err, "not finite");
  assert_int_equal(w.fault.n[WORLD_BEGIN] - n_tries, 2); // trying again would not help
  world_close(&w);
  w.store = kept;
}

FIXTURE(setup) {
  make_old_files();
  open_run();
  if (run_and_report() < 0) return -1;
  whole_digest = world_digest(&w);
  world_close(&w);
  return 0;
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_start),
      cmocka_unit_test(test_dequeue),
      cmocka_unit_test(test_requeue),
      cmocka_unit_test(test_stop),
      cmocka_unit_test(test_begin),
      cmocka_unit_test(test_write),
      cmocka_unit_test(test_commit),
      cmocka_unit_test(test_read),
      cmocka_unit_test(test_rig_pose),
      cmocka_unit_test(test_set_control),
      cmocka_unit_test(test_trigger),
      cmocka_unit_test(test_worker),
      cmocka_unit_test(test_event),
      cmocka_unit_test(test_decode),
      cmocka_unit_test(test_backs_off_and_rescues),
      cmocka_unit_test(test_never_saves_what_is_not_finite),
  };
  return cmocka_run_group_tests(tests, setup, NULL);
}
