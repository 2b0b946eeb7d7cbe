// SPDX-License-Identifier: Apache-2.0
// What every source of frames must do, on all that exist here: the simulator and a capture on disk. The request
// counts are those of libcamera's compliance suite. A new source is one line in SOURCES.
// clang-format off
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <cmocka.h>
// clang-format on
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "platform/replay/capture_writer.h"
#include "src/format/cameramodel.h"
#include "src/format/rig_file.h"
#include "tests/common/world.h"

#define SPEC       "textured,rig=stereo,size=64x48,skew_us=300,drift_ppm=30,offset_ms=200"
#define N_RECORDED 48 // frames of a camera in the capture
#define N_COUNTS   10
static const int COUNTS[N_COUNTS] = {1, 2, 3, 5, 8, 13, 21, 34, 55, 89};

static world w;
static char dir[256];

static bool open_sim(void) { return world_open(&w, SPEC, 8, ~0u, 1); }
static bool open_replay(void) { return world_open_replay(&w, dir, 8, ~0u, 1); }
static const struct {
  const char *name;
  bool (*open)(void);
  int n_frames; // after which it ends; 0: never
} SOURCES[] = {{"sim", open_sim, 0}, {"replay", open_replay, 2 * N_RECORDED}};
#define N_SOURCES ((int)(sizeof SOURCES / sizeof *SOURCES))

// --- a capture of the simulator ------------------------------------------------------------------

static void write_rig(const sv_rig *rig) {
  static char text[16384];
  char path[300];
  sv_err err;
  sv_linux_store folder;
  snprintf(path, sizeof path, "%s/rig", dir);
  if (sv_linux_store_open(&folder, path, &err) < 0) fail_msg("%s", err.text);
  sv_store st = sv_linux_store_port(&folder);
  for (int i = -1; i < rig->n_sub_views; i++) {
    sv_str s = sv_str_make(text, sizeof text);
    char name[64] = "rig.json";
    if (i >= 0) snprintf(name, sizeof name, "%s.cameramodel", rig->sub_views[i].name);
    sv_status r = i < 0 ? sv_rig_json_write(&s, rig)
                        : sv_cameramodel_write(&s, &rig->sub_views[i].model, &rig->sub_views[i].cam_from_rig);
    if (r < 0 || st.begin(st.self, name, &err) < 0 || st.write(st.self, s.buf, s.len, &err) < 0 ||
        st.commit(st.self, &err) < 0)
      fail_msg("%s: %s", name, err.text);
  }
  sv_linux_store_close(&folder);
}

static void record(void) {
  static sv_capture_writer writer;
  sv_frame f;
  sv_source *src = &w.inner.source;
  double scene[6] = {-1, -1, -1, 1, 1, 1};
  sv_capture_writer_cfg wc = {.dir = dir,
                              .name = "",
                              .rig = "rig",
                              .n_cameras = src->n_cameras,
                              .caps = w.caps,
                              .scene_m = scene,
                              .quality = 98};
  if (sv_capture_writer_open(&writer, &wc, &w.arena, &w.err) < 0) fail_msg("%s", w.err.text);
  assert_int_equal(src->start(src->self), SV_OK);
  for (int i = 0; i < N_RECORDED * src->n_cameras; i++) {
    assert_int_equal(src->dequeue(src->self, &f, INT64_MAX), SV_OK);
    if (sv_capture_writer_add(&writer, &f, &w.err) != SV_OK) fail_msg("%s", w.err.text);
    assert_int_equal(src->requeue(src->self, &f), SV_OK);
  }
  assert_int_equal(src->stop(src->self), SV_OK);
  for (int k = 0; k < 2 * N_RECORDED; k++) { // the rig stands still from 40 ms before to 40 ms after mid-slot
    sv_pose pose;
    sv_ns t = sv_sim_slot_ns(&w.sim, k / 2) + (k & 1 ? 40 : -40) * SV_NS_PER_MS;
    sv_sim_rig_pose(&w.sim, t, &pose);
    if (sv_capture_writer_add_pose(&writer, t, &pose, &w.err) < 0) fail_msg("%s", w.err.text);
  }
  if (sv_capture_writer_close(&writer, &w.err) < 0) fail_msg("%s", w.err.text);
}

static int make_capture(void **state) {
  (void)state;
  const char *tmp = getenv("TMPDIR");
  snprintf(dir, sizeof dir, "%s/sv_sources_XXXXXX", tmp ? tmp : "/tmp");
  if (!mkdtemp(dir) || !world_open(&w, SPEC, 8, ~0u, 1)) return -1;
  write_rig(&w.sim.rig);
  record();
  world_close(&w);
  return 0;
}

static int remove_capture(void **state) {
  char command[300];
  (void)state;
  snprintf(command, sizeof command, "rm -rf '%s'", dir);
  return system(command);
}

// --- what a frame must be ------------------------------------------------------------------------

typedef struct {
  sv_ns last_arrival_ns;
  bool has_last[4];
  uint32_t last_sequence[4];
  sv_ns last_camera_ns[4];
} stream;

static void check_frame(stream *st, const sv_frame *f) {
  const sv_camera_caps *c;
  assert_true(f->i_camera >= 0 && f->i_camera < w.inner.source.n_cameras);
  c = &w.caps[f->i_camera];
  assert_int_equal(f->width_px, c->width_px);
  assert_int_equal(f->height_px, c->height_px);
  assert_int_equal(f->format, c->format);
  assert_true(f->stride_bytes >= f->width_px * 3);
  assert_true(f->data && f->data_bytes <= c->frame_bytes);
  assert_true(f->data_bytes >=
              (size_t)f->stride_bytes * (size_t)(f->height_px - 1) + (size_t)f->width_px * 3);
  assert_false(f->is_error);
  assert_true(f->arrival_ns >= st->last_arrival_ns);
  assert_true(f->arrival_ns <= w.inner.clock.now_ns(w.inner.clock.self));
  if (st->has_last[f->i_camera]) {
    assert_true(f->sequence > st->last_sequence[f->i_camera]);
    assert_true(f->camera_ns > st->last_camera_ns[f->i_camera]);
  }
  uint32_t sum = 0; // every byte may be read, and it is a picture
  for (size_t i = 0; i < f->data_bytes; i++) sum += f->data[i];
  assert_true(sum > 0);
  st->last_arrival_ns = f->arrival_ns;
  st->has_last[f->i_camera] = true;
  st->last_sequence[f->i_camera] = f->sequence;
  st->last_camera_ns[f->i_camera] = f->camera_ns;
}

// start, n frames, stop. Frames are handed back at once, or not at all.
static void capture(int i_source, int n, bool is_balanced) {
  sv_source *src = &w.inner.source;
  stream st = {.last_arrival_ns = INT64_MIN};
  sv_frame f, on_loan[200];
  int end = SOURCES[i_source].n_frames, n_loan = 0;
  assert_int_equal(src->start(src->self), SV_OK);
  for (int i = 0; i < n; i++) {
    sv_ns until = w.inner.clock.now_ns(w.inner.clock.self) + 10 * SV_NS_PER_S;
    sv_status s = src->dequeue(src->self, &f, until);
    if (end && i >= end) {
      assert_int_equal(s, SV_END);
      continue;
    }
    if (!is_balanced && (s == SV_AGAIN || s == SV_END)) break; // no buffer is free: nothing can come
    assert_int_equal(s, SV_OK);
    check_frame(&st, &f);
    if (!is_balanced) on_loan[n_loan++] = f;
    else {
      assert_int_equal(src->requeue(src->self, &f), SV_OK);
      assert_true(src->requeue(src->self, &f) < 0); // twice is refused
    }
  }
  for (int i = 0; i < n_loan; i++) // what is on loan keeps its pictures until the stop
    for (int k = 0; k < i; k++) assert_true(on_loan[i].data != on_loan[k].data);
  assert_int_equal(src->stop(src->self), SV_OK);
  assert_int_equal(src->dequeue(src->self, &f, INT64_MAX), SV_END); // not running
}

static void for_all(void (*body)(int i_source, int n)) {
  for (int s = 0; s < N_SOURCES; s++)
    for (int i = 0; i < N_COUNTS; i++) {
      if (!SOURCES[s].open()) fail_msg("%s: %s", SOURCES[s].name, w.err.text);
      body(s, COUNTS[i]);
      world_close(&w);
    }
}

static void once(int s, int n) { capture(s, n, true); }
static void thrice(int s, int n) {
  for (int k = 0; k < 3; k++) capture(s, n, true);
}
static void unbalanced(int s, int n) {
  sv_source *src = &w.inner.source;
  assert_int_equal(src->stop(src->self), SV_OK); // before any start
  capture(s, n, false);
  assert_int_equal(src->stop(src->self), SV_OK); // a second time
  capture(s, n, true);                           // the buffers are all there again
}

static void test_capture(void **state) {
  (void)state;
  for_all(once);
}
static void test_start_stop(void **state) {
  (void)state;
  for_all(thrice);
}
static void test_unbalanced_stop(void **state) {
  (void)state;
  for_all(unbalanced);
}

static void test_bad_calls(void **state) {
  (void)state;
  for (int s = 0; s < N_SOURCES; s++) {
    if (!SOURCES[s].open()) fail_msg("%s: %s", SOURCES[s].name, w.err.text);
    sv_source *src = &w.inner.source;
    sv_camera_caps caps;
    sv_frame f = {.i_camera = 0, .i_buffer = 0};
    assert_true(src->caps(src->self, -1, &caps) < 0);
    assert_true(src->caps(src->self, src->n_cameras, &caps) < 0);
    assert_int_equal(src->start(src->self), SV_OK);
    assert_true(src->requeue(src->self, &f) < 0); // not on loan
    f.i_camera = 99;
    assert_true(src->requeue(src->self, &f) < 0);
    f.i_camera = 0, f.i_buffer = 1000;
    assert_true(src->requeue(src->self, &f) < 0);
    // Nothing comes before a time that has passed.
    assert_int_equal(src->dequeue(src->self, &f, w.inner.clock.now_ns(w.inner.clock.self) - 1) == SV_E_DEVICE,
                     0);
    assert_int_equal(src->stop(src->self), SV_OK);
    world_close(&w);
  }
}

// --- capture, then replay: the same exposures ----------------------------------------------------

static void test_replay_gives_the_same_exposures(void **state) {
  (void)state;
  static sv_exposure want[8];
  static uint8_t px[8][2][64 * 48 * 3];
  if (!open_sim()) fail_msg("%s", w.err.text);
  w.cfg.train.n_gaussians = 50, w.cfg.steps = 2;
  if (world_run(&w) < 0) fail_msg("%s", w.err.text);
  assert_int_equal(w.app.exposures.n, 8);
  sv_image_u8 im;
  sv_view v[2], u;
  for (int i = 0; i < 8; i++) {
    want[i] = w.app.exposures.exposure[i];
    for (int s = 0; s < 2; s++) {
      sv_exposures_get(&w.app.exposures, i, s, &im, &v[s]);
      memcpy(px[i][s], im.px, sizeof px[i][s]);
    }
  }
  world_close(&w);
  if (!open_replay()) fail_msg("%s", w.err.text);
  w.cfg.train.n_gaussians = 50, w.cfg.steps = 2;
  if (world_run(&w) < 0) fail_msg("%s", w.err.text);
  assert_int_equal(w.app.exposures.n, 8);
  for (int i = 0; i < 8; i++) {
    const sv_exposure *x = &w.app.exposures.exposure[i];
    assert_true(x->time_ns == want[i].time_ns && x->skew_ns == want[i].skew_ns);
    for (int k = 0; k < 9; k++)
      assert_true(fabs(x->rig_from_world.r[k] - want[i].rig_from_world.r[k]) < 1e-12);
    for (int k = 0; k < 3; k++)
      assert_true(fabs(x->rig_from_world.t[k] - want[i].rig_from_world.t[k]) < 1e-12);
    for (int s = 0; s < 2; s++) {
      double sum = 0;
      sv_exposures_get(&w.app.exposures, i, s, &im, &u);
      for (size_t k = 0; k < sizeof px[i][s]; k++) sum += pow((double)im.px[k] - px[i][s][k], 2);
      double rms = sqrt(sum / sizeof px[i][s]);
      if (!(rms < 2.0)) fail_msg("exposure %d, sub-view %d: JPEG cost %.2f grey levels", i, s, rms);
    }
    assert_true(fabsf(u.fx - v[1].fx) < 1e-4f && fabsf(u.cx - v[1].cx) < 1e-4f);
  }
  world_close(&w);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_capture),
      cmocka_unit_test(test_start_stop),
      cmocka_unit_test(test_unbalanced_stop),
      cmocka_unit_test(test_bad_calls),
      cmocka_unit_test(test_replay_gives_the_same_exposures),
  };
  return cmocka_run_group_tests(tests, make_capture, remove_capture);
}
