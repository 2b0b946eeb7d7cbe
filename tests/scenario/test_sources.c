// SPDX-License-Identifier: Apache-2.0
// What every source of frames must do (tests/common/source_suite.h), on all that exist here. A new
// source is one line in SOURCES; cameras that are really there: tests/conform/source_check.c.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "platform/camera/tiled.h"
#include "platform/replay/capture_writer.h"
#include "platform/v4l2/v4l2.h"
#include "src/format/cameramodel.h"
#include "src/format/rig_file.h"
#include "tests/common/fake_v4l2.h"
#include "tests/common/source_suite.h"
#include "tests/common/test.h"
#include "tests/common/world.h"

#define SPEC       "textured,rig=stereo,size=64x48,skew_us=300,drift_ppm=30,offset_ms=200"
#define N_RECORDED 48 // frames of a camera in the capture

static world w;
static char dir[256];

static bool open_sim(void) { return world_open(&w, SPEC, 8, ~0u, 1); }
static bool open_replay(void) { return world_open_replay(&w, dir, 8, ~0u, 1); }
static void close_world(void) { world_close(&w); }
static sv_source world_source(void) { return w.inner.source; }
static sv_clock world_clock(void) { return w.inner.clock; }

// V4L2 against a device of our own behind its system calls; by camera sets and formats.
static fake_v4l2 fake;
static sv_v4l2 v4l2;
static bool open_v4l2_as(const char *spec) {
  sv_camera_options o;
  sv_arena arena = sv_arena_make(fake.block, sizeof fake.block);
  sv_v4l2_sys sys = fake_v4l2_sys(&fake);
  sv_clock clock = fake_v4l2_clock(&fake);
  fake_v4l2_init(&fake, 3);
  return sv_camera_parse("v4l2", spec, &o, &w.err) == SV_OK &&
         sv_v4l2_init(&v4l2, &o, &sys, &clock, &arena, &w.err) == SV_OK;
}
static bool open_one(void) { return open_v4l2_as("/dev/video0"); }
static bool open_three(void) { return open_v4l2_as("/dev/video0,/dev/video1,/dev/video2,buffers=4"); }
static bool open_jpeg(void) { return open_v4l2_as("/dev/video0,/dev/video2,format=MJPG"); }
static void close_v4l2(void) {
  sv_v4l2_close(&v4l2);
  assert_int_equal(fake_v4l2_n_open(&fake), 0);
  assert_int_equal(fake_v4l2_n_mapped(&fake), 0);
}
static sv_source v4l2_source(void) { return sv_v4l2_source(&v4l2); }
static sv_clock v4l2_clock(void) { return fake_v4l2_clock(&fake); }

// Tiles of a simulator's picture and of a V4L2 camera's.
static sv_tiled tiled;
static uint8_t tiled_block[1 << 16];
static bool tile(sv_source inner, int cols, int rows) {
  sv_arena arena = sv_arena_make(tiled_block, sizeof tiled_block);
  return sv_tiled_init(&tiled, &inner, cols, rows, &arena, &w.err) == SV_OK;
}
static bool open_tiled_sim(void) { return open_sim() && tile(w.inner.source, 2, 2); }
static bool open_tiled_v4l2(void) { return open_one() && tile(sv_v4l2_source(&v4l2), 2, 1); }
static bool open_tiled_jpeg(void) { return open_jpeg() && tile(sv_v4l2_source(&v4l2), 2, 2); }
static sv_source tiled_source(void) { return sv_tiled_source(&tiled); }

static const struct {
  const char *name;
  bool (*open)(void);
  void (*close)(void);
  sv_source (*source)(void);
  sv_clock (*clock)(void);
  int n_frames; // after which it ends; 0: never
} SOURCES[] = {{"sim", open_sim, close_world, world_source, world_clock, 0},
               {"replay", open_replay, close_world, world_source, world_clock, 2 * N_RECORDED},
               {"v4l2", open_one, close_v4l2, v4l2_source, v4l2_clock, 0},
               {"v4l2, three cameras", open_three, close_v4l2, v4l2_source, v4l2_clock, 0},
               {"v4l2, MJPEG", open_jpeg, close_v4l2, v4l2_source, v4l2_clock, 0},
               {"tiles of sim", open_tiled_sim, close_world, tiled_source, world_clock, 0},
               {"tiles of v4l2", open_tiled_v4l2, close_v4l2, tiled_source, v4l2_clock, 0},
               {"tiles of MJPEG", open_tiled_jpeg, close_v4l2, tiled_source, v4l2_clock, 0}};
#define N_SOURCES ((int)(sizeof SOURCES / sizeof *SOURCES))

// --- a capture of the simulator ------------------------------------------------------------------

static void write_rig(const sv_rig *rig) {
  static char text[16384];
  char path[300];
  sv_err err;
  sv_linux_store folder;
  snprintf(path, sizeof path, "%s/rig", dir);
  assert_ok(sv_linux_store_open(&folder, path, &err), &err);
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
  // the rig stands still from 40 ms before to 40 ms after mid-slot
  for (int k = 0; k < 2 * N_RECORDED; k++) {
    sv_pose pose;
    sv_ns t = sv_sim_slot_ns(&w.sim, k / 2) + (k & 1 ? 40 : -40) * SV_NS_PER_MS;
    sv_sim_rig_pose(&w.sim, t, &pose);
    if (sv_capture_writer_add_pose(&writer, t, &pose, &w.err) < 0) fail_msg("%s", w.err.text);
  }
  if (sv_capture_writer_close(&writer, &w.err) < 0) fail_msg("%s", w.err.text);
}

FIXTURE(make_capture) {
  const char *tmp = getenv("TMPDIR");
  snprintf(dir, sizeof dir, "%s/sv_sources_XXXXXX", tmp ? tmp : "/tmp");
  if (!mkdtemp(dir) || !world_open(&w, SPEC, 8, ~0u, 1)) return -1;
  write_rig(&w.sim.rig);
  record();
  world_close(&w);
  return 0;
}

FIXTURE(remove_capture) {
  char command[300];
  snprintf(command, sizeof command, "rm -rf '%s'", dir);
  return system(command);
}

// --- the suite -----------------------------------------------------------------------------------

static source_suite suite_of(int i) {
  return (source_suite){
      .source = SOURCES[i].source(), .clock = SOURCES[i].clock(), .n_frames = SOURCES[i].n_frames};
}

static void for_all(bool (*body)(source_suite *s, int n)) {
  for (int i = 0; i < N_SOURCES; i++)
    for (int k = 0; k < SOURCE_SUITE_N_COUNTS; k++) {
      if (!SOURCES[i].open()) fail_msg("%s: %s", SOURCES[i].name, w.err.text);
      source_suite s = suite_of(i);
      if (!body(&s, source_suite_counts[k]))
        fail_msg("%s, %d frames: %s", SOURCES[i].name, source_suite_counts[k], s.why);
      SOURCES[i].close();
    }
}

TEST(test_capture) { for_all(source_suite_capture); }
TEST(test_start_stop) { for_all(source_suite_start_stop); }
TEST(test_unbalanced_stop) { for_all(source_suite_unbalanced); }
TEST(test_bad_calls) {
  for (int i = 0; i < N_SOURCES; i++) {
    if (!SOURCES[i].open()) fail_msg("%s: %s", SOURCES[i].name, w.err.text);
    source_suite s = suite_of(i);
    if (!source_suite_bad_calls(&s)) fail_msg("%s: %s", SOURCES[i].name, s.why);
    SOURCES[i].close();
  }
}

// --- capture, then replay: the same exposures ----------------------------------------------------

TEST(test_replay_gives_the_same_exposures) {
  static sv_exposure want[8];
  static uint8_t px[8][2][64 * 48 * 3];
  if (!open_sim()) fail_msg("%s", w.err.text);
  w.cfg.train.n_gaussians = 50;
  w.cfg.steps = 2;
  world_run_well(&w);
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
  w.cfg.train.n_gaussians = 50;
  w.cfg.steps = 2;
  world_run_well(&w);
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
