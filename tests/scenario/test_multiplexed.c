// SPDX-License-Identifier: Apache-2.0
// The whole runtime on sensors where lens images overlap: quality, threads, resumes, captures that
// replay, coverage, and what is refused.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "platform/replay/capture_writer.h"
#include "src/format/cameramodel.h"
#include "src/format/rig_file.h"
#include "tests/common/test.h"
#include "tests/common/world.h"

#define SPEC "textured,rig=multiplexed,grid=3x3,size=160x120"

static world w;

static void open_world(const char *spec, int n_exposures, int n_threads) {
  world_open_well(&w, spec, n_exposures, ~0u, n_threads);
  w.cfg.train.n_gaussians = 1000;
  w.cfg.train.region_px = 64;
}

// --- quality -------------------------------------------------------------------------------------

TEST(test_quality) {
  uint64_t digest[2];
  for (int n = 1; n <= 2; n++) {
    open_world(SPEC, 6, n);
    w.cfg.steps = 600;
    world_run_well(&w);
    assert_int_equal(world_stats(&w).n_views, 0);
    assert_int_equal(world_stats(&w).n_measurements, 6);
    assert_int_equal(world_stats(&w).n_regions, 6 * 3 * 2);
    assert_int_equal(sv_driver_n_views(&w.app.trainer), 6 * 9);
    digest[n - 1] = world_digest(&w);
    double held_out = world_heldout_psnr(&w, 8), trained = world_training_psnr(&w);
    print_message("%d threads: held-out %.2f dB, measurements %.2f dB\n", n, held_out, trained);
    assert_true(held_out > 35.5); // measured: 36.4; 30.6 from random points
    assert_true(trained > 39.4);  // 40.2
    world_close(&w);
  }
  assert_true(digest[0] == digest[1]);
}

static void test_unknown_bounds(void **state) { // starting points come from the measurements
  (void)state;
  open_world(SPEC, 6, 2);
  w.cfg.has_bounds = false;
  w.cfg.steps = 500;
  world_run_well(&w);
  double psnr = world_training_psnr(&w);
  print_message("bounds from the lenses: measurements %.2f dB\n", psnr);
  assert_true(psnr > 38.8); // measured: 39.7; 29.0 from random points
  world_close(&w);
}

// --- the pool ------------------------------------------------------------------------------------

TEST(test_pool) {
  open_world(SPEC, 3, 2);
  w.cfg.steps = 1;
  world_run_well(&w);
  const sv_measurements *c = &w.app.exposures.measurements;
  assert_int_equal(c->n_sensors, 1);
  for (int e = 0; e < 3; e++) {
    sv_multiplexed model;
    const uint16_t *px;
    sv_measurements_get(c, e, 0, &model, &px);
    assert_true(px == w.app.trainer.measurements[e].px);
    assert_true(model.is_linear && model.n_lenses == 9 && model.width_px == 160 && model.height_px == 120);
    assert_true(model.max_overlap == 4.0f);
    int brightest = 0;
    for (int i = 0; i < 3 * 160 * 120; i++) brightest = px[i] > brightest ? px[i] : brightest;
    assert_true(brightest > 20000 && brightest % 257 != 0);
    for (int m = 0; m < 9; m++) {
      const sv_sub_view *v = &w.cfg.rig->sub_views[m];
      sv_pose cam = sv_pose_mul(&v->cam_from_rig, &w.app.exposures.exposure[e].rig_from_world);
      for (int k = 0; k < 9; k++) assert_true(model.lenses[m].view.r[k] == (float)cam.r[k]);
      for (int k = 0; k < 3; k++) assert_true(model.lenses[m].view.t[k] == (float)cam.t[k]);
      assert_int_equal(model.lenses[m].footprint.x0_px, v->footprint.x0_px);
      assert_int_equal(model.lenses[m].view.i_exposure, (int)w.app.exposures.exposure[e].id);
    }
  }
  // The preview: what was measured, what is predicted, and one lens.
  assert_int_equal(w.image_width_px, 3 * 160);
  assert_int_equal(w.image_height_px, 120);
  assert_int_equal(sv_app_save_report(&w.app, NULL, &w.err), SV_OK);
  world_close(&w);
}

// Frames of 8 bits, a full pool, and other sizes and formats, straight into the pool.
TEST(test_frames) {
  static _Alignas(64) uint8_t block[1 << 20];
  static uint8_t px[6 * 160 * 120 + 40 * 120];
  open_world(SPEC, 2, 2);
  sv_arena a = sv_arena_make(block, sizeof block);
  sv_measurements c;
  sv_measurements_cfg cfg = {w.cfg.rig, w.caps, 1, 2};
  if (sv_measurements_init(&c, &cfg, &a, &w.err) < 0) fail_msg("%s", w.err.text);
  for (size_t i = 0; i < sizeof px; i++) px[i] = (uint8_t)(i * 7 + i / 300);
  sv_exposure ex = {.id = 5, .rig_from_world = sv_pose_identity()};
  sv_frame f = {
      .width_px = 160, .height_px = 120, .stride_bytes = 3 * 160 + 20, .format = SV_PIX_RGB8, .data = px};
  sv_multiplexed model;
  const uint16_t *kept;
  assert_int_equal(sv_measurements_put(&c, 1, &ex, &f, &w.inner.pool, &w.err), SV_OK);
  sv_measurements_get(&c, 1, 0, &model, &kept);
  for (int y = 0; y < 120; y++)
    for (int x = 0; x < 480; x++) assert_int_equal(kept[480 * y + x], 257 * px[y * f.stride_bytes + x]);
  f.format = SV_PIX_RGB16;
  f.stride_bytes = 6 * 160 + 1; // at odd addresses, too
  assert_int_equal(sv_measurements_put(&c, 1, &ex, &f, &w.inner.pool, &w.err), SV_OK);
  for (int y = 0; y < 120; y++)
    for (int x = 0; x < 480; x++) {
      const uint8_t *p = px + y * f.stride_bytes + 2 * x;
      assert_int_equal(kept[480 * y + x], p[0] | p[1] << 8);
    }
  f.format = SV_PIX_GREY8;
  assert_int_equal(sv_measurements_put(&c, 0, &ex, &f, &w.inner.pool, &w.err), SV_E_UNSUPPORTED);
  assert_one_sentence(w.err.text);
  f.format = SV_PIX_RGB8;
  f.width_px = 159;
  assert_int_equal(sv_measurements_put(&c, 0, &ex, &f, &w.inner.pool, &w.err), SV_E_RANGE);
  assert_one_sentence(w.err.text);
  world_close(&w);
}

// --- resume and memory ---------------------------------------------------------------------------

static void open_resume(void) {
  open_world("textured,rig=multiplexed,grid=2x2,size=100x76,noise=read:1e-4:shot:1e-3", 3, 2);
  w.cfg.train.n_gaussians = 300;
  w.cfg.train.region_px = 40;
  w.cfg.train.relocate_every = 25;
  w.cfg.train.lr.logit = 0.3f;
  w.cfg.steps = 60;
  w.cfg.is_resume = true; // without a checkpoint: from the start
}

TEST(test_resume_is_bit_exact) {
  world_forget_files(&w);
  open_resume();
  world_run_well(&w);
  uint64_t whole = world_digest(&w);
  assert_true(world_stats(&w).n_relocated > 0);
  float floor[300]; // of the last relocation, not of where a resumed run begins
  memcpy(floor, w.app.trainer.floor, sizeof floor);
  world_close(&w);
  static const uint32_t stops[][3] = {{1, 0}, {59, 0}, {13, 14, 40}};
  for (size_t i = 0; i < sizeof stops / sizeof *stops; i++) {
    world_forget_files(&w);
    for (int k = 0; k < 3 && stops[i][k]; k++) {
      open_resume();
      w.stop_at_step = stops[i][k];
      assert_int_equal(world_run(&w), SV_E_INTERRUPTED);
      assert_int_equal(world_stats(&w).step, stops[i][k]);
      world_close(&w);
    }
    open_resume();
    world_run_well(&w);
    assert_true(world_digest(&w) == whole);
    assert_memory_equal(w.app.trainer.floor, floor, sizeof floor);
    world_close(&w);
  }
}

// The plan counts all of it, to the byte.
TEST(test_short_arena) {
  open_resume();
  w.cfg.steps = 2;
  world_forget_files(&w);
  size_t need = world_app_bytes(&w), step = need / 61 / 16 * 16 + 16;
  assert_true(need > 3 * 100 * 76 * 6);
  for (size_t bytes = 0; bytes < need; bytes += step) {
    sv_status s = world_init_in(&w, bytes);
    if (s != SV_E_NOMEM || !is_one_sentence(w.err.text))
      fail_msg("%zu of %zu bytes: %d, \"%s\"", bytes, need, s, w.err.text);
  }
  assert_int_equal(world_init_in(&w, need - 16), SV_E_NOMEM);
  if (world_init_in(&w, need) < 0) fail_msg("%s", w.err.text);
  assert_int_equal(w.arena.used_bytes, need);
  assert_int_equal(sv_app_run(&w.app, &w.err), SV_OK);
  assert_int_equal(w.arena.used_bytes, need);
  world_close(&w);
}

// --- coverage, and what is refused ---------------------------------------------------------------

static sv_sub_view changed[16];
static sv_rig changed_rig(void) {
  sv_rig rig = *w.cfg.rig;
  memcpy(changed, rig.sub_views, (size_t)rig.n_sub_views * sizeof *changed);
  rig.sub_views = changed;
  return rig;
}

TEST(test_coverage_counts) {
  static uint8_t half[160 * 120];
  float max_overlap[2];
  memset(half, 51, sizeof half); // a fifth
  for (int i = 0; i < 2; i++) {
    open_world(SPEC, 2, 2);
    sv_rig rig = changed_rig();
    if (i)
      for (int v = 0; v < rig.n_sub_views; v++) rig.sub_views[v].footprint.coverage = half;
    w.cfg.rig = &rig;
    w.cfg.steps = 3;
    world_run_well(&w);
    max_overlap[i] = w.app.exposures.measurements.sensor[0].max_overlap;
    world_close(&w);
  }
  assert_true(fabsf(max_overlap[1] - 0.2f * max_overlap[0]) < 1e-5f);
}

TEST(test_refused) {
  static const char *const says[] = {"together", "undistorted", "not on the sensor", "no lens image falls",
                                     "camera 3"};
  static uint8_t dark[160 * 120];
  for (int i = 0; i < 5; i++) {
    open_world(SPEC, 2, 2);
    sv_rig rig = changed_rig();
    w.cfg.rig = &rig;
    w.cfg.steps = 2;
    if (i == 0) w.cfg.sub_view_mask[0] = 5;
    if (i == 1) {
      rig.sub_views[3].model.kind = SV_MODEL_OPENCV8;
      rig.sub_views[3].model.p[4] = 0.01;
    }
    if (i == 2) rig.sub_views[8].footprint.x0_px += 30;
    for (int v = 0; v < 9 && i == 3; v++) rig.sub_views[v].footprint.coverage = dark;
    if (i == 4) rig.sub_views[2].i_camera = 3;
    sv_status s = world_init(&w);
    if (s != (i < 2 ? SV_E_UNSUPPORTED : SV_E_RANGE) || !strstr(w.err.text, says[i]))
      fail_msg("%d: %d, \"%s\"", i, s, w.err.text);
    assert_one_sentence(w.err.text);
    world_close(&w);
  }
}

// --- captures ------------------------------------------------------------------------------------

static void write_text(const char *dir, const char *name, const char *text) {
  char path[600];
  snprintf(path, sizeof path, "%s/%s", dir, name);
  FILE *f = fopen(path, "wb");
  assert_non_null(f);
  assert_true(fputs(text, f) >= 0);
  fclose(f);
}

static void write_rig(const char *dir, const sv_rig *rig) {
  static char text[16 << 10];
  char folder[300], name[64];
  snprintf(folder, sizeof folder, "mkdir -p '%s/rig'", dir);
  assert_int_equal(system(folder), 0);
  snprintf(folder, sizeof folder, "%s/rig", dir);
  for (int i = -1; i < rig->n_sub_views; i++) {
    sv_str s = sv_str_make(text, sizeof text);
    const sv_sub_view *v = &rig->sub_views[i < 0 ? 0 : i];
    if (i < 0) assert_int_equal(sv_rig_json_write(&s, rig), SV_OK);
    else assert_int_equal(sv_cameramodel_write(&s, &v->model, &v->cam_from_rig), SV_OK);
    snprintf(name, sizeof name, "%s.cameramodel", v->name);
    write_text(folder, i < 0 ? "rig.json" : name, text);
  }
}

// Three exposures of the simulator as a capture folder.
static void record(const char *dir, const char *spec) {
  static sv_capture_writer writer;
  open_world(spec, 3, 1);
  write_rig(dir, w.cfg.rig);
  double r = (double)w.cfg.bounds.radius / sqrt(3.0), scene[6] = {-r, -r, -r, r, r, r};
  sv_capture_writer_cfg wc = {
      .dir = dir, .name = "", .rig = "rig", .n_cameras = 1, .caps = w.caps, .scene_m = scene};
  if (sv_capture_writer_open(&writer, &wc, &w.arena, &w.err) < 0) fail_msg("%s", w.err.text);
  sv_source *src = &w.inner.source;
  assert_int_equal(src->start(src->self), SV_OK);
  for (int i = 0; i < 3; i++) {
    sv_frame f;
    sv_pose pose;
    assert_int_equal(src->dequeue(src->self, &f, INT64_MAX), SV_OK);
    assert_int_equal(f.format, SV_PIX_RGB16);
    if (sv_capture_writer_add(&writer, &f, &w.err) < 0) fail_msg("%s", w.err.text);
    assert_int_equal(src->rig_pose(src->self, sv_sim_slot_ns(&w.sim, i), &pose), SV_OK);
    assert_int_equal(sv_capture_writer_add_pose(&writer, f.arrival_ns, &pose, &w.err), SV_OK);
    assert_int_equal(src->requeue(src->self, &f), SV_OK);
  }
  assert_int_equal(sv_capture_writer_close(&writer, &w.err), SV_OK);
  world_close(&w);
}

TEST(test_replay) {
  static uint16_t direct[3][3 * 100 * 76];
  static const char spec[] = "textured,rig=multiplexed,grid=2x2,size=100x76,noise=read:1e-4:shot:1e-3";
  char dir[200], command[300];
  const char *tmp = getenv("TMPDIR");
  snprintf(dir, sizeof dir, "%s/sv_multiplexed_XXXXXX", tmp ? tmp : "/tmp");
  assert_non_null(mkdtemp(dir));
  record(dir, spec);
  open_world(spec, 3, 2);
  w.cfg.steps = 5;
  world_run_well(&w);
  for (int e = 0; e < 3; e++) memcpy(direct[e], w.app.trainer.measurements[e].px, sizeof direct[e]);
  world_close(&w);
  if (!world_open_replay(&w, dir, 3, ~0u, 2)) fail_msg("%s", w.err.text);
  assert_int_equal(w.caps[0].format, SV_PIX_RGB16);
  assert_int_equal(w.cfg.rig->forward, SV_FORWARD_MULTIPLEXED);
  w.cfg.train.n_gaussians = 300;
  w.cfg.steps = 300;
  world_run_well(&w);
  assert_int_equal(w.app.exposures.n, 3);
  for (int e = 0; e < 3; e++) // all 16 bits came back
    assert_memory_equal(w.app.trainer.measurements[e].px, direct[e], sizeof direct[e]);
  double psnr = world_training_psnr(&w);
  print_message("replayed: measurements %.2f dB\n", psnr);
  assert_true(psnr > 24.7); // measured: 25.6
  world_close(&w);
  snprintf(command, sizeof command, "rm -rf '%s'", dir);
  assert_int_equal(system(command), 0);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_quality),
      cmocka_unit_test(test_unknown_bounds),
      cmocka_unit_test(test_pool),
      cmocka_unit_test(test_frames),
      cmocka_unit_test(test_resume_is_bit_exact),
      cmocka_unit_test(test_short_arena),
      cmocka_unit_test(test_coverage_counts),
      cmocka_unit_test(test_refused),
      cmocka_unit_test(test_replay),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
