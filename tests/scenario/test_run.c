// SPDX-License-Identifier: Apache-2.0
// The whole runtime on the simulator and its virtual clock: quality, rigs, clocks that lie, cameras
// that vanish, captures that replay, stops and resumes, and sizes at their limits.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/format/json.h"
#include "tests/common/test.h"
#include "tests/common/world.h"

static world w;

static void open_world(const char *spec, int n_exposures) {
  world_open_well(&w, spec, n_exposures, ~0u, 2);
  w.cfg.train.n_gaussians = 400;
}

// captured = delivered + dropped for every camera, and nothing is left waiting.
static void assert_ledger(void) {
  for (int i = 0; i < w.cfg.n_cameras; i++) {
    const sv_ledger *l = sv_sync_ledger(&w.app.queue.sync, i);
    if (!sv_ledger_is_exact(l) || l->pending != 0 || l->captured != l->delivered + sv_ledger_dropped(l))
      fail_msg("camera %d: %llu captured, %llu delivered, %llu dropped, %llu pending", i,
               (unsigned long long)l->captured, (unsigned long long)l->delivered,
               (unsigned long long)sv_ledger_dropped(l), (unsigned long long)l->pending);
  }
}

// --- quality -------------------------------------------------------------------------------------

typedef struct {
  const char *spec;
  int n_exposures;
  double floor_db, margin_db; // of both sub-views; over one of them alone
  int optimizer;              // as in sv_app_cfg
  uint32_t steps;
} quality;

static double train_quality(const quality *q, uint64_t mask) {
  open_world(q->spec, q->n_exposures);
  w.cfg.train.n_gaussians = 3000;
  w.cfg.steps = q->steps ? q->steps : 800;
  w.cfg.optimizer = q->optimizer;
  w.cfg.sub_view_mask[0] = mask;
  world_run_well(&w);
  assert_ledger();
  double psnr = world_heldout_psnr(&w, 8);
  assert_int_equal(world_stats(&w).n_views, (mask ? 1 : 2) * q->n_exposures);
  world_close(&w);
  return psnr;
}

TEST(test_stereo_beats_one_sub_view) {
  static const quality runs[] = {
      // measured: 37.5 dB, 4.7 dB over the left one alone
      {"textured,rig=stereo,size=160x120", 8, 36.6, 3.8},
      {"occlusion,rig=stereo,size=160x120", 8, 33.4, 4.3}, // 34.3 dB, 5.2 dB
      // 37.4 dB, 7.5 dB: the fewer exposures, the more it helps
      {"textured,rig=stereo,size=160x120", 4, 36.5, 6.6},
  };
  for (size_t i = 0; i < sizeof runs / sizeof *runs; i++) {
    double both = train_quality(&runs[i], 0), left = train_quality(&runs[i], 1);
    print_message("%s, %d exposures: held-out %.2f dB, left alone %.2f dB\n", runs[i].spec,
                  runs[i].n_exposures, both, left);
    assert_true(both > runs[i].floor_db);
    assert_true(both > left + runs[i].margin_db);
  }
}

TEST(test_gauss_newton_beats_adam) {
  quality q = {.spec = "textured,rig=stereo,size=160x120", .n_exposures = 8, .steps = 300};
  double psnr[2];
  for (int i = 0; i < 2; i++) {
    q.optimizer = 1 + i;
    psnr[i] = train_quality(&q, 0);
    assert_int_equal(world_stats(&w).optimizer, i);
  }
  print_message("held-out after 300 steps: %s %.2f dB, %s %.2f dB\n", sv_optimizer_name(SV_OPTIMIZER_ADAM),
                psnr[0], sv_optimizer_name(SV_OPTIMIZER_GAUSS_NEWTON), psnr[1]);
  assert_true(psnr[1] > psnr[0] + 1.5);
}

// --- cameras in time -----------------------------------------------------------------------------

// Every exposure's pose is the simulator's at the exposure's own time, and lies within the limit of
// the truth.
static void assert_exposures(sv_ns skew_limit_ns) {
  const sv_exposures *e = &w.app.exposures;
  for (int i = 0; i < e->n; i++) {
    const sv_exposure *x = &e->exposure[i];
    sv_pose truth;
    sv_sim_rig_pose(&w.sim, x->time_ns, &truth);
    assert_true(x->skew_ns >= 0 && x->skew_ns <= skew_limit_ns);
    assert_memory_equal(&x->rig_from_world, &truth, sizeof truth);
    if (i) assert_true(x->time_ns > e->exposure[i - 1].time_ns);
    for (int s = 0; s < w.cfg.rig->n_sub_views; s++) {
      sv_image_u8 image;
      sv_view view;
      sv_exposures_get(e, i, s, &image, &view);
      sv_pose cam = sv_pose_mul(&w.cfg.rig->sub_views[s].cam_from_rig, &truth);
      for (int k = 0; k < 9; k++) assert_true(view.r[k] == (float)cam.r[k]);
      for (int k = 0; k < 3; k++) assert_true(view.t[k] == (float)cam.t[k]);
    }
  }
}

// A picture belongs to its pose: rendered again at the view's true place, it is the same but for
// noise.
static void assert_pictures(double max_rms) {
  static uint8_t rgb[640 * 480 * 3];
  for (int i = 0; i < w.app.exposures.n; i++)
    for (int s = 0; s < w.cfg.rig->n_sub_views; s++) {
      sv_image_u8 im;
      sv_view v;
      double sum = 0, t_s = sv_ns_to_s(w.app.exposures.exposure[i].time_ns - SV_SIM_EPOCH_NS);
      sv_exposures_get(&w.app.exposures, i, s, &im, &v);
      sv_sim_render(&w.sim, &v, t_s, rgb, NULL);
      size_t n = (size_t)v.width_px * (size_t)v.height_px * 3;
      for (size_t k = 0; k < n; k++) sum += (double)(rgb[k] - im.px[k]) * (rgb[k] - im.px[k]);
      double rms = sqrt(sum / (double)n);
      if (!(rms <= max_rms)) fail_msg("exposure %d, sub-view %d: %.2f grey levels off its place", i, s, rms);
    }
}

TEST(test_bad_timing) {
  static const struct {
    const char *spec;
    sv_ns limit_ns;
    uint64_t min_dropped;
  } runs[] = {
      {"textured,rig=stereo,size=64x48", SV_NS_PER_MS, 0},
      {"textured,rig=stereo,size=64x48,skew_us=900,jitter_us=20,drop=0.1", SV_NS_PER_MS, 2},
      {"textured,rig=stereo,size=64x48,skew_us=300,jitter_us=100,drift_ppm=50,offset_ms=700,drop=0.05",
       2 * SV_NS_PER_MS, 1},
      {"textured,rig=phone,size=64x48,skew_us=500,drift_ppm=-80,offset_ms=-300,delay_jitter_us=400,drop=0.1",
       3 * SV_NS_PER_MS, 1},
      {"textured,rig=stereo,size=64x48,drop=0.1,fault=error:0:3:2+dup:1:6:2+reorder:0:9", SV_NS_PER_MS, 4},
      {"textured,rig=stereo,size=64x48,fault=seqreset:1:7+clockstep:0:11:500+stall:1:15:4", 5 * SV_NS_PER_MS,
       1},
  };
  for (size_t i = 0; i < sizeof runs / sizeof *runs; i++) {
    open_world(runs[i].spec, 24);
    w.cfg.skew_limit_ns = runs[i].limit_ns;
    w.cfg.steps = 4;
    world_run_well(&w);
    assert_ledger();
    assert_int_equal(w.app.exposures.n, 24);
    assert_exposures(runs[i].limit_ns);
    assert_pictures(1e-9);
    sv_ledger l = sv_sync_ledger_sum(&w.app.queue.sync);
    assert_true(sv_ledger_dropped(&l) >= runs[i].min_dropped);
    // What the simulator says it exposed is what the ledger says was captured: each frame that
    // came, and the lost ones that a later frame has told of.
    for (int c = 0; c < w.cfg.n_cameras; c++) {
      const sv_sim_counts *n = sv_sim_camera_counts(&w.sim, c);
      uint64_t captured = sv_sync_ledger(&w.app.queue.sync, c)->captured;
      assert_int_equal(n->n_starved, 0);
      assert_true(captured <= n->n_exposed + n->n_duplicates && captured >= n->n_delivered);
    }
    world_close(&w);
  }
}

// A skew beyond the limit gives no exposure at all, and says so.
TEST(test_skew_beyond_the_limit) {
  open_world("textured,rig=stereo,size=64x48,skew_us=20000", 4);
  w.cfg.skew_limit_ns = 5 * SV_NS_PER_MS;
  w.cfg.capture_timeout_ns = 3 * SV_NS_PER_S;
  w.cfg.steps = 4;
  assert_int_equal(world_run(&w), SV_E_TIMEOUT);
  assert_one_sentence(w.err.text);
  assert_contains(w.err.text, "skew-limit");
  assert_int_equal(w.app.exposures.n, 0);
  assert_int_equal(w.app.state, SV_APP_FAILED);
  assert_ledger();
  world_close(&w);
}

TEST(test_unplugged_camera) {
  open_world("textured,rig=stereo,size=64x48,fault=unplug:1:5", 8);
  w.cfg.capture_timeout_ns = 2 * SV_NS_PER_S;
  w.cfg.steps = 4;
  assert_int_equal(world_run(&w), SV_E_TIMEOUT);
  assert_one_sentence(w.err.text);
  assert_contains(w.err.text, "5 of 8");
  assert_true(world_has_line(&w, "camera 1")); // which one it was
  assert_int_equal(w.app.capture.n_device_errors, 1);
  assert_int_equal(w.app.exposures.n, 5);
  assert_ledger();
  // The other camera went on: about 20 frames of 2 s at 10 fps came after, none got lost.
  const sv_sim_counts *n = sv_sim_camera_counts(&w.sim, 0);
  assert_true(n->n_delivered >= 20);
  assert_int_equal(n->n_starved, 0);
  world_close(&w);
  // Pulled for a while: the capture completes.
  open_world("textured,rig=stereo,size=64x48,fault=unplug:1:5:10", 8);
  w.cfg.steps = 4;
  world_run_well(&w);
  assert_int_equal(w.app.exposures.n, 8);
  assert_exposures(w.cfg.skew_limit_ns);
  assert_pictures(1e-9);
  assert_ledger();
  world_close(&w);
}

// A source that ends early: what came is trained on; one that never delivers is an error.
TEST(test_source_ends) {
  open_world("textured,rig=stereo,size=64x48,frames=3", 8);
  w.cfg.steps = 4;
  world_run_well(&w);
  assert_int_equal(w.app.exposures.n, 3);
  assert_ledger();
  world_close(&w);
  open_world("textured,rig=stereo,size=64x48,frames=3,drop=1", 8);
  w.cfg.steps = 4;
  assert_int_equal(world_run(&w), SV_E_NOT_FOUND);
  assert_one_sentence(w.err.text);
  world_close(&w);
}

// --- rigs ----------------------------------------------------------------------------------------

TEST(test_light_field) {
  open_world("textured,rig=lightfield,size=256x192", 4);
  w.cfg.train.n_gaussians = 1500;
  w.cfg.steps = 600;
  world_run_well(&w);
  assert_int_equal(world_stats(&w).n_views, 64);
  assert_false(world_stats(&w).is_antialiased);
  assert_exposures(w.cfg.skew_limit_ns);
  assert_pictures(1e-9);
  double psnr = world_heldout_psnr(&w, 8);
  print_message("light field: held-out %.2f dB\n", psnr);
  assert_true(psnr > 37.3); // measured: 38.1
  world_close(&w);
}

TEST(test_phone) {
  open_world("textured,rig=phone,size=96x72", 4);
  w.cfg.train.n_gaussians = 1500;
  w.cfg.steps = 400;
  world_run_well(&w);
  assert_true(world_stats(&w).is_antialiased); // focal lengths differ sixfold
  assert_int_equal(world_stats(&w).n_views, 12);
  double psnr = world_heldout_psnr(&w, 8);
  print_message("phone: held-out %.2f dB\n", psnr);
  assert_true(psnr > 30.4); // measured: 31.2
  world_close(&w);
  open_world("textured,rig=stereo,size=64x48", 2);
  w.cfg.steps = 2;
  world_run_well(&w);
  assert_false(world_stats(&w).is_antialiased);
  world_close(&w);
}

TEST(test_unknown_bounds) {
  open_world("textured,rig=stereo,size=96x72", 6);
  w.cfg.has_bounds = false;
  w.cfg.train.n_gaussians = 1500;
  w.cfg.steps = 500;
  world_run_well(&w);
  double psnr = world_training_psnr(&w);
  print_message("bounds from the cameras: training views %.2f dB, centre %.2f %.2f %.2f, radius %.2f\n", psnr,
                (double)world_stats(&w).centre[0], (double)world_stats(&w).centre[1],
                (double)world_stats(&w).centre[2], (double)world_stats(&w).radius);
  assert_true(psnr > 34.8); // measured: 35.6
  world_close(&w);
}

// --- time, stops, resumes ------------------------------------------------------------------------

TEST(test_time_limit) {
  open_world("textured,rig=stereo,size=64x48", 2);
  w.cfg.time_limit_s = 0.4; // 1 ms passes with each look at the clock
  world_run_well(&w);
  assert_true(w.app.driver.train_s >= 0.4 && w.app.driver.train_s < 0.405);
  assert_true(world_stats(&w).step > 100 && world_stats(&w).step <= 400);
  world_close(&w);
  // Both limits: whichever comes first.
  open_world("textured,rig=stereo,size=64x48", 2);
  w.cfg.time_limit_s = 1000;
  w.cfg.steps = 7;
  world_run_well(&w);
  assert_int_equal(world_stats(&w).step, 7);
  world_close(&w);
}

// A budget of time goes on where it was.
TEST(test_time_limit_resumed) {
  uint32_t step = 0;
  world_forget_files(&w);
  for (int i = 0; i < 3; i++) {
    open_world("textured,rig=stereo,size=64x48", 2);
    w.cfg.time_limit_s = 0.4;
    w.cfg.is_resume = true;
    w.stop_at_step = i == 0 ? 60 : 0;
    assert_int_equal(world_run(&w), i == 0 ? SV_E_INTERRUPTED : SV_OK);
    const double trained_s = world_stats(&w).trained_s;
    if (i == 0) assert_true(trained_s > 0.05 && trained_s < 0.3);
    else assert_true(trained_s >= 0.4 && trained_s < 0.41);
    if (i == 1) assert_true(w.app.driver.train_s < 0.35 && world_stats(&w).step > step);
    if (i == 2) assert_int_equal(world_stats(&w).step, step); // it had ended
    step = world_stats(&w).step;
    world_close(&w);
  }
}

#define RESUME_SPEC  "textured,rig=stereo,size=100x76,noise=read:1e-4:shot:1e-3"
#define RESUME_STEPS 60

static void open_resume(void) {
  open_world(RESUME_SPEC, 3);
  w.cfg.train.n_gaussians = 600;
  w.cfg.train.relocate_every = 5;
  w.cfg.train.lr.logit = 0.3f;
  w.cfg.steps = RESUME_STEPS;
}

TEST(test_resume_is_bit_exact) {
  world_forget_files(&w);
  open_resume();
  world_run_well(&w);
  uint64_t whole = world_digest(&w);
  static uint8_t ply[1 << 20];
  const world_file *f = world_find(&w, "model.ply");
  assert_non_null(f);
  size_t ply_bytes = f->bytes;
  assert_true(ply_bytes <= sizeof ply);
  memcpy(ply, f->data, ply_bytes);
  assert_true(world_stats(&w).n_relocated > 0);
  world_close(&w);
  static const uint32_t stops[][3] = {{1, 0}, {7, 0}, {RESUME_STEPS - 1, 0}, {13, 14, 40}};
  for (size_t i = 0; i < sizeof stops / sizeof *stops; i++) {
    world_forget_files(&w);
    for (int k = 0; k < 3 && stops[i][k]; k++) {
      open_resume();
      w.cfg.is_resume = true; // without a checkpoint: from the start
      w.stop_at_step = stops[i][k];
      assert_int_equal(world_run(&w), SV_E_INTERRUPTED);
      assert_int_equal(world_stats(&w).step, stops[i][k]);
      assert_true(world_has_line(&w, "no checkpoint.bin") == (k == 0));
      assert_one_sentence(w.err.text);
      assert_non_null(world_find(&w, "model.ply"));
      assert_non_null(world_find(&w, "checkpoint.bin"));
      world_close(&w);
    }
    open_resume();
    w.cfg.is_resume = true;
    world_run_well(&w);
    assert_int_equal(world_stats(&w).step, RESUME_STEPS);
    assert_true(world_digest(&w) == whole);
    f = world_find(&w, "model.ply");
    assert_int_equal(f->bytes, ply_bytes);
    assert_memory_equal(f->data, ply, ply_bytes);
    world_close(&w);
  }
  // Already there: nothing is done again.
  open_resume();
  w.cfg.is_resume = true;
  world_run_well(&w);
  assert_true(world_digest(&w) == whole);
  world_close(&w);
}

TEST(test_resume_refuses_other_settings) {
  for (int i = 0; i < 4; i++) {
    open_resume(); // the checkpoint of the test before, or a new one
    w.cfg.steps = 3;
    world_run_well(&w);
    world_close(&w);
    open_resume();
    w.cfg.is_resume = true;
    if (i == 0) w.cfg.train.n_gaussians = 500;
    if (i == 1) w.cfg.train.sh_degree = 2;
    if (i == 2) w.cfg.n_exposures = 2;
    if (i == 3) w.cfg.optimizer = 1 + SV_OPTIMIZER_ADAM;
    sv_status s = world_run(&w);
    if (s != SV_E_RANGE) fail_msg("%d: %s", s, w.err.text);
    assert_one_sentence(w.err.text);
    world_close(&w);
  }
}

// What is there stays as it is.
TEST(test_stop_before_first_step) {
  world_forget_files(&w);
  for (int i = 0; i < 2; i++) {
    open_resume();
    w.cfg.is_resume = true;
    w.stop_at_step = 7;
    assert_int_equal(world_run(&w), SV_E_INTERRUPTED);
    assert_int_equal(w.app.driver.step_time.n, i == 0 ? 7 : 0);
    world_file *f = w.store.file;
    while (strcmp(f->name, "model.ply") != 0) f++;
    if (i == 0) f->data[0] = '?';
    assert_int_equal(f->data[0], '?');
    assert_int_equal(w.app.state, i == 0 ? SV_APP_DONE : SV_APP_FAILED);
    if (i == 1)
      assert_string_equal(w.err.text, "stopped by request before the first step: nothing was saved");
    world_close(&w);
  }
}

TEST(test_stop_before_training) {
  world_forget_files(&w);
  open_resume();
  w.is_stop_at_once = true;
  assert_int_equal(world_run(&w), SV_E_INTERRUPTED);
  assert_one_sentence(w.err.text);
  assert_not_contains(w.err.text, "is saved"); // it would not be true
  assert_null(world_find(&w, "model.ply"));
  assert_ledger();
  world_close(&w);
}

TEST(test_save_every) {
  world_forget_files(&w);
  open_resume();
  w.cfg.save_every_s = 0.01;
  world_run_well(&w);
  assert_true(w.n_images > 3);
  assert_int_equal(w.image_width_px, 200);
  assert_int_equal(w.image_height_px, 76);
  assert_true(w.fault.n[WORLD_COMMIT] > 4);
  uint64_t saved_often = world_digest(&w);
  world_close(&w);
  open_resume();
  world_run_well(&w);
  assert_true(world_digest(&w) == saved_often); // saving changes nothing
  world_close(&w);
}

// --- limits --------------------------------------------------------------------------------------

TEST(test_smallest_run) {
  // One pixel: a light field of 16 x 16 px lenses is the simulator's smallest, so the rig is cut by
  // hand.
  open_world("textured,rig=lightfield,size=16x16", 1);
  sv_rig rig = w.sim.rig;
  for (int i = 0; i < rig.n_sub_views; i++) {
    sv_sub_view *v = &rig.sub_views[i];
    v->model.width_px = v->model.height_px = 1;
    v->model.p[0] = v->model.p[1] = 1.3;
    v->model.p[2] = v->model.p[3] = 0.5;
    v->footprint.width_px = v->footprint.height_px = 1;
  }
  w.cfg.rig = &rig;
  w.cfg.train.n_gaussians = 1;
  w.cfg.steps = 40;
  world_run_well(&w);
  assert_true(isfinite(w.app.driver.last.loss));
  assert_true(isfinite(world_training_psnr(&w)));
  assert_int_equal(sv_app_save_report(&w.app, NULL, &w.err), SV_OK);
  world_close(&w);
  open_world("textured,rig=mono,size=33x17", 1); // no baseline, no unit
  w.cfg.steps = 2;
  world_run_well(&w);
  assert_false(sv_app_unit(&w.app).is_metric);
  world_close(&w);
  for (int n = 1; n <= 17; n += 8) { // 1, 9, 17 Gaussians
    open_world("textured,rig=mono,size=33x17", 1);
    w.cfg.train.n_gaussians = n;
    w.cfg.train.sh_degree = n % 4;
    w.cfg.steps = 30;
    w.cfg.has_bounds = n > 1;
    world_run_well(&w);
    assert_true(isfinite(w.app.driver.last.loss));
    world_close(&w);
  }
}

TEST(test_bad_settings) {
  for (int i = 0; i < 6; i++) {
    open_world("textured,rig=stereo,size=64x48", 2);
    w.cfg.steps = 2;
    if (i == 0) w.cfg.n_exposures = 0;
    if (i == 1) w.cfg.train.n_gaussians = 0;
    if (i == 2) w.cfg.train.sh_degree = 4;
    if (i == 3) w.cfg.sub_view_mask[1] = 2; // sub-view 65
    if (i == 4) w.cfg.train.weight_ssim = -1;
    if (i == 5) w.cfg.skew_limit_ns = -1;
    sv_status s = world_init(&w);
    if (s != SV_E_ARG || !is_one_sentence(w.err.text)) fail_msg("%d: %d, \"%s\"", i, s, w.err.text);
    world_close(&w);
  }
}

// The plan is exact: a block of that size runs, one that is a take's alignment or more shorter is
// refused with a sentence, whatever the size.
TEST(test_short_arena) {
  open_world("textured,rig=phone,size=64x48", 3);
  w.cfg.steps = 2;
  w.cfg.is_resume = true;
  world_forget_files(&w);
  size_t need = world_app_bytes(&w), step = need / 211 / 16 * 16 + 16;
  assert_true(need > 0);
  int n = 0;
  for (size_t bytes = 0; bytes < need; bytes += step, n++) {
    sv_status s = world_init_in(&w, bytes);
    if (s != SV_E_NOMEM || !is_one_sentence(w.err.text))
      fail_msg("%zu of %zu bytes: %d, \"%s\"", bytes, need, s, w.err.text);
  }
  assert_int_equal(world_init_in(&w, need - 16), SV_E_NOMEM);
  assert_one_sentence(w.err.text);
  print_message("%d sizes below %zu bytes: \"%s\"\n", n, need, w.err.text);
  if (world_init_in(&w, need) < 0) fail_msg("%s", w.err.text);
  assert_int_equal(w.arena.used_bytes, need);
  assert_true(w.arena.is_sealed);
  assert_int_equal(sv_app_run(&w.app, &w.err), SV_OK);
  assert_int_equal(w.arena.used_bytes, need);
  world_close(&w);
}

static void test_report(void **state) {
  (void)state;
  open_world("textured,rig=stereo,size=64x48,drop=0.1", 6);
  w.cfg.steps = 5;
  world_run_well(&w);
  assert_int_equal(sv_app_save_report(&w.app, "\"psnr\": 12.5", &w.err), SV_OK);
  const world_file *f = world_find(&w, "run.json");
  assert_non_null(f);
  static jsmntok_t tokens[2048];
  sv_json j;
  if (sv_json_parse(&j, &(sv_file_data){"run.json", (const char *)f->data, f->bytes}, tokens, 2048, &w.err) <
      0)
    fail_msg("%s", w.err.text);
  static const char *const keys[] = {"\"digest\"",          "\"ledger\"",     "\"memory\"",
                                     "\"step_ms\"",         "\"psnr\": 12.5", "\"is_exact\": true",
                                     "\"state\": \"done\"", "\"unit\": \"m\""};
  static char text[SV_APP_REPORT_BYTES + 1];
  memcpy(text, f->data, f->bytes);
  text[f->bytes] = 0;
  for (size_t i = 0; i < sizeof keys / sizeof *keys; i++)
    if (!strstr(text, keys[i])) fail_msg("run.json has no %s", keys[i]);
  // Each exposure has its place in the histogram of skews.
  double edge_n[2], sum = 0, n_exposures = 0;
  const int i_skew = sv_json_get(&j, 0, "skew_us"), i_bins = sv_json_get(&j, i_skew, "histogram");
  assert_int_equal(sv_json_get_double(&j, i_skew, "exposures", &n_exposures, &w.err), SV_OK);
  for (int i = sv_json_first(&j, i_bins); i >= 0; i = sv_json_next(&j, i)) {
    assert_int_equal(sv_json_doubles(&j, i, edge_n, 2, &w.err), SV_OK);
    assert_true(edge_n[1] >= 1);
    sum += edge_n[1];
  }
  assert_true(n_exposures > 0 && sum == n_exposures);
  assert_not_contains(text, "\"is_exact\": false");
  world_close(&w);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_stereo_beats_one_sub_view),
      cmocka_unit_test(test_gauss_newton_beats_adam),
      cmocka_unit_test(test_bad_timing),
      cmocka_unit_test(test_skew_beyond_the_limit),
      cmocka_unit_test(test_unplugged_camera),
      cmocka_unit_test(test_source_ends),
      cmocka_unit_test(test_light_field),
      cmocka_unit_test(test_phone),
      cmocka_unit_test(test_unknown_bounds),
      cmocka_unit_test(test_time_limit),
      cmocka_unit_test(test_resume_is_bit_exact),
      cmocka_unit_test(test_resume_refuses_other_settings),
      cmocka_unit_test(test_stop_before_training),
      cmocka_unit_test(test_stop_before_first_step),
      cmocka_unit_test(test_time_limit_resumed),
      cmocka_unit_test(test_save_every),
      cmocka_unit_test(test_smallest_run),
      cmocka_unit_test(test_bad_settings),
      cmocka_unit_test(test_short_arena),
      cmocka_unit_test(test_report),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
