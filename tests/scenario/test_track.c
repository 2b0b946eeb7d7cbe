// SPDX-License-Identifier: Apache-2.0
// Odometry on handheld captures of the simulator: how far off, how sure of its scale, what it does
// when it cannot know; and a run whose source does not tell its poses against one whose source
// does.
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/mathx.h"
#include "src/track/tracker.h"
#include "tests/common/test.h"
#include "tests/common/world.h"

#define CAP_EXPOSURES 100
#define N_HANDHELD    60
#define NOISE         ",noise=read:1e-5:shot:1e-3" // about ISO 1600 of a small sensor

static world w;
static uint8_t block[64 << 20];
static sv_sim sim;
static sv_tracker tracker;
static sv_pose truth[CAP_EXPOSURES];
static bool is_shutter_known; // else rolling shutters are taken for global ones
static uint8_t picture[SV_SIM_CAP_CAMERAS][640 * 480 * 3];

// The pictures of all exposures, for a test that lets the tracker look at them again.
#define CAP_KEPT 2
static uint8_t kept[CAP_EXPOSURES][CAP_KEPT][320 * 240 * 3];
static bool is_looking_again;

typedef struct {
  sv_track_summary s;
  double ate_percent, scale_error; // after alignment by a similarity, of the path; scale - 1
  double drift_percent;            // of the last place seen from the first, of the path
} outcome;

static const sv_image_u8 *look_at(void *self, int e) {
  static sv_image_u8 image[CAP_KEPT];
  (void)self;
  for (int v = 0; v < CAP_KEPT; v++) image[v] = (sv_image_u8){kept[e][v], 320, 240, 3, 960};
  return image;
}

// Distance between where two trajectories end when they begin alike.
static double end_apart(const sv_pose *a, const sv_pose *b, int n) {
  const sv_pose a0 = sv_pose_inv(&a[0]), b0 = sv_pose_inv(&b[0]);
  const sv_pose pa = sv_pose_mul(&a[n - 1], &a0), pb = sv_pose_mul(&b[n - 1], &b0);
  double ca[3], cb[3], d[3];
  sv_pose_centre(ca, &pa);
  sv_pose_centre(cb, &pb);
  sv_sub3(d, ca, cb);
  return sv_norm3(d);
}

static sv_image_u8 take(sv_source *src, int i_camera) {
  sv_frame f;
  do {
    assert_int_equal(src->dequeue(src->self, &f, INT64_MAX), SV_OK);
    memcpy(picture[f.i_camera], f.data, f.data_bytes);
    assert_int_equal(src->requeue(src->self, &f), SV_OK);
  } while (f.i_camera != i_camera);
  return (sv_image_u8){picture[0], f.width_px, f.height_px, 3, f.stride_bytes};
}

static outcome compare(int n) {
  outcome o;
  double path = 0, sum = 0, was[3] = {0}, c[3], d[3];
  static sv_pose a[CAP_EXPOSURES], b[CAP_EXPOSURES];
  int m = 0;
  const sv_track_pictures again = {NULL, look_at};
  sv_tracker_finish(&tracker, is_looking_again ? &again : NULL, &o.s);
  for (int i = 0; i < n; i++)
    if (tracker.is_placed[i]) {
      a[m] = tracker.pose[i];
      b[m++] = truth[i];
    }
  sv_similarity q = sv_align_trajectories(a, b, m, true);
  for (int i = 0; i < m; i++) {
    sv_pose p = sv_similarity_apply(&q, &a[i]);
    double x[3];
    sv_pose_centre(x, &p);
    sv_pose_centre(c, &b[i]);
    sv_sub3(d, x, c);
    sum += sv_dot3(d, d) / m;
    sv_sub3(d, c, was);
    if (i) path += sv_norm3(d);
    memcpy(was, c, sizeof was);
  }
  o.ate_percent = path > 0 ? 100 * sqrt(sum) / path : 0;
  o.drift_percent = path > 0 ? 100 * end_apart(a, b, m) / path : 0;
  o.scale_error = 1 / q.s - 1;
  return o;
}

static const sv_row_time *row_times(void) {
  static sv_row_time time[SV_SIM_CAP_CAMERAS];
  for (int i = 0; i < sim.rig.n_sub_views; i++) {
    const sv_sub_view *v = &sim.rig.sub_views[i];
    assert_int_equal(sv_row_time_make(&time[i], &(sv_row_time_cfg){.shutter = v->shutter,
                                                                   .lens = &v->model,
                                                                   .sensor_width_px = sim.cfg.width_px,
                                                                   .sensor_height_px = sim.cfg.height_px,
                                                                   .half_x = 0.5,
                                                                   .half_y = 0.5}),
                     SV_OK);
  }
  return time;
}

// From i_dark on the lens is covered for n_dark exposures.
static outcome track_covered(const char *spec, int n, uint32_t isa_mask, int i_dark, int n_dark) {
  sv_err err;
  sv_sim_config c;
  sv_kernels k;
  sv_arena a = sv_arena_make(block, sizeof block);
  sv_image_u8 image[SV_SIM_CAP_CAMERAS];
  assert_ok(sv_sim_parse(&c, spec, &err), &err);
  if (!strstr(spec, "exposures=")) c.n_exposures = n;
  assert_ok(sv_sim_init(&sim, &c, &a, &err), &err);
  sv_track_cfg t = sv_track_defaults();
  t.rig = sv_sim_rig(&sim);
  t.cap_exposures = n;
  t.row_time = is_shutter_known ? row_times() : NULL;
  sv_kernels_init(&k, isa_mask);
  size_t before = a.used_bytes;
  assert_ok(sv_tracker_init(&tracker, &t, &k, &a, &err), &err);
  assert_int_equal(a.used_bytes - before, sv_tracker_bytes(&t));
  sv_source src = sv_sim_source(&sim);
  assert_int_equal(src.start(src.self), SV_OK);
  for (int i = 0; i < n; i++) {
    sv_image_u8 last = take(&src, src.n_cameras - 1);
    for (int v = 0; v < src.n_cameras; v++) {
      image[v] = last;
      image[v].px = picture[v];
      if (is_looking_again) memcpy(kept[i][v], picture[v], sizeof kept[i][v]);
      if (i >= i_dark && i < i_dark + n_dark) memset(picture[v], 0, sizeof picture[v]);
    }
    sv_sim_rig_pose(&sim, sv_sim_slot_ns(&sim, i), &truth[i]);
    sv_tracker_set_time(&tracker, sv_sim_slot_time_s(&sim, i));
    assert_true(sv_tracker_add(&tracker, image) >= 0);
  }
  assert_int_equal(sv_tracker_add(&tracker, image), SV_E_FULL);
  return compare(n);
}

static outcome track(const char *spec, int n, uint32_t isa_mask) {
  return track_covered(spec, n, isa_mask, 0, 0);
}

TEST(test_handheld) {
  static const struct {
    const char *spec;
    double ate_percent, scale;
  } runs[] = {
      // measured: 0.05 %, 0.0012; 0.01 %, 0.0008. At 640x480 0.02 %, 0.0005
      {"textured,rig=stereo,angle=15,path=handheld,size=320x240" NOISE, 0.25, 0.01},
      {"room,rig=phone,path=handheld,size=320x240" NOISE, 0.25, 0.02},
  };
  for (size_t i = 0; i < sizeof runs / sizeof *runs; i++) {
    outcome o = track(runs[i].spec, N_HANDHELD, ~0u);
    print_message("%s: %d placed, %.3f %% of %.1f m, scale off by %.3f %%, told %.3f %%, %.2f px\n",
                  runs[i].spec, o.s.n_placed, o.ate_percent, o.s.path_m, 100 * o.scale_error,
                  100 * o.s.scale_sigma, o.s.rms_px);
    assert_int_equal(o.s.n_placed, N_HANDHELD);
    assert_false(o.s.is_still);
    assert_true(o.ate_percent < runs[i].ate_percent);
    assert_true(fabs(o.scale_error) < runs[i].scale);
    assert_true(o.s.scale_sigma > 0 && o.s.scale_sigma < 0.02);
    assert_true(o.s.n_points > 500);
  }
}

// Degrees between -y of the world that was found, turned upright, and up of the simulator.
static double tilt_deg(void) {
  double up[3], sum[3] = {0};
  const double found[3] = {0, -1, 0}, true_up[3] = {0, 0, 1};
  assert_true(sv_track_up(&tracker, up));
  sv_track_turn_upright(&tracker, up);
  for (int i = 0; i < tracker.n_exposures; i++) {
    double of_rig[3], back[9], x[3];
    sv_apply33(of_rig, truth[i].r, true_up);
    for (int k = 0; k < 9; k++) back[k] = tracker.pose[i].r[3 * (k % 3) + k / 3];
    sv_apply33(x, back, of_rig);
    for (int k = 0; k < 3; k++) sum[k] += x[k];
  }
  return 180 / SV_PI * sv_angle_between(sum, found);
}

// Rigs that look down: the cameras' own up is far off. A rig that neither goes far around nor sees
// the floor tells up worse.
TEST(test_upright) {
  static const struct {
    const char *spec;
    double off_deg;                                                            // at most
  } runs[] = {{"textured,rig=stereo,path=handheld,arc=360,size=320x240", 1.5}, // measured: 0.6
              {"room,rig=phone,path=handheld,size=320x240" NOISE, 0.5},        // 0.05, by the floor
              {"room,rig=stereo,path=smooth,arc=20,size=320x240" NOISE, 25}};  // 20
  for (size_t i = 0; i < sizeof runs / sizeof *runs; i++) {
    track(runs[i].spec, 24, ~0u);
    double mean[3] = {0};
    const double up[3] = {0, 0, 1};
    for (int e = 0; e < 24; e++)
      for (int k = 0; k < 3; k++) mean[k] -= truth[e].r[3 + k];
    const double before = 180 / SV_PI * sv_angle_between(mean, up), after = tilt_deg();
    print_message("%s: the cameras' mean up is off by %.2f degrees, up by %.2f\n", runs[i].spec, before,
                  after);
    assert_true(after < runs[i].off_deg && after < 0.7 * before);
  }
}

// An inertial sensor goes before what the cameras see, here 20 degrees off.
TEST(test_imu) {
  static sv_imu_sample sample[24];
  static const char spec[] = "room,rig=stereo,path=smooth,arc=20,poses=unknown,size=320x240" NOISE;
  world_open_well(&w, spec, 12, ~0u, 2);
  w.cfg.train.n_gaussians = 500;
  w.cfg.steps = 5;
  w.cfg.is_tracking = true;
  w.cfg.imu = &(sv_imu){sample, 24};
  for (int i = 0; i < 24; i++) {
    sv_pose p;
    const sv_ns ns = sv_sim_slot_ns(&w.sim, i);
    sv_sim_rig_pose(&w.sim, ns, &p);
    sample[i].time_s = sv_ns_to_s(ns);
    for (int k = 0; k < 3; k++) sample[i].a[k] = 9.81 * p.r[3 * k + 2];
  }
  world_run_well(&w);
  double worst = 0;
  for (int e = 0; e < w.app.exposures.n; e++) {
    const sv_exposure *x = &w.app.exposures.exposure[e];
    const double up[3] = {0, -1, 0}, z[3] = {0, 0, 1};
    double seen[3], true_up[3];
    sv_pose p;
    sv_sim_rig_pose(&w.sim, x->time_ns, &p);
    assert_true(x->has_pose);
    sv_apply33(seen, x->rig_from_world.r, up);
    sv_apply33(true_up, p.r, z);
    worst = sv_maxd(worst, 180 / SV_PI * sv_angle_between(seen, true_up));
  }
  print_message("up by accelerations is off by %.2f degrees\n", worst);
  assert_true(worst < 0.5);
  world_close(&w);
}

// A hand that turns the rig at 30 degrees/s and moves it at 0.3 m/s, with 20 ms of readout: as
// exact as with a global shutter, which it is not when it is taken for one.
TEST(test_rolling_shutter) {
  static const char *const spec[3] = {
      "room,rig=stereo,path=sway,arc=0,fps=15,size=320x240,readout_ms=0" NOISE,
      "room,rig=stereo,path=sway,arc=0,fps=15,size=320x240,readout_ms=20" NOISE,
      "room,rig=stereo,path=sway,arc=0,fps=15,size=320x240,readout_ms=20" NOISE};
  outcome o[3];
  for (int i = 0; i < 3; i++) {
    is_shutter_known = i == 2;
    o[i] = track(spec[i], 24, ~0u);
    print_message("%s shutter: %d placed, %.2f %% of %.2f m, scale off by %.2f %%, %.2f px\n",
                  i == 0   ? "global"
                  : i == 1 ? "unknown rolling"
                           : "known rolling",
                  o[i].s.n_placed, o[i].ate_percent, o[i].s.path_m, 100 * o[i].scale_error, o[i].s.rms_px);
    assert_int_equal(o[i].s.n_placed, 24);
  }
  is_shutter_known = false;
  assert_true(o[1].ate_percent > 5 * o[0].ate_percent);
  assert_true(o[2].ate_percent < 2 * o[0].ate_percent);
  assert_true(fabs(o[2].scale_error) < 0.02);
}

// Once around an object. Without a look back the drift adds up; with it, where the rig ends is
// known from where it began, also with more exposures than are adjusted together.
TEST(test_full_circle) {
  static const char spec[] = "textured,rig=stereo,path=handheld,arc=360,size=320x240";
  static const struct {
    int n;
    bool is_looking_again;
  } runs[] = {{40, false}, {40, true}, {100, true}};
  outcome o[3];
  for (int i = 0; i < 3; i++) {
    is_looking_again = runs[i].is_looking_again;
    o[i] = track(spec, runs[i].n, ~0u);
    print_message("full circle, %d exposures, %d seen again: %.3f %% of %.1f m, end off by %.3f %%\n",
                  runs[i].n, o[i].s.n_seen_again, o[i].ate_percent, o[i].s.path_m, o[i].drift_percent);
    assert_int_equal(o[i].s.n_placed, runs[i].n);
  }
  is_looking_again = false;
  assert_true(o[0].s.n_seen_again == 0 && o[1].s.n_seen_again > 30);
  assert_true(o[0].drift_percent > 0.1); // measured: 0.19, 0.03, 0.04 %
  assert_true(o[1].drift_percent < 0.1 && o[2].drift_percent < 0.1);
}

// More exposures than are adjusted together, and the last part of them sees nothing: the scale is
// as well known as without those.
TEST(test_long) {
  outcome o[2];
  for (int i = 0; i < 2; i++) {
    o[i] = track_covered("room,rig=stereo,angle=2,path=smooth,arc=40,exposures=30,size=320x240" NOISE,
                         i ? CAP_EXPOSURES : 12, ~0u, 12, CAP_EXPOSURES - 12);
    print_message("%d exposures, 12 of them seen: scale told +- %.3f %%, %.3f px\n", i ? CAP_EXPOSURES : 12,
                  100 * o[i].s.scale_sigma, o[i].s.rms_px);
    assert_true(o[i].s.n_placed == 12 && o[i].s.scale_sigma > 0 && o[i].s.rms_px > 0.05);
  }
  assert_true(fabs(o[1].s.scale_sigma / o[0].s.scale_sigma - 1) < 0.2);
}

// Past the side of an object that shows too few corners nothing is located any more: matches that
// agree by chance must not place the rest somewhere else (before: 2 m off).
TEST(test_lost) {
  outcome o = track_covered("occlusion,rig=phone,path=handheld,size=320x240", 40, ~0u, 18, 4);
  print_message("lost: %d of 40 placed, %.3f %% of %.1f m, scale off by %.3f %%\n", o.s.n_placed,
                o.ate_percent, o.s.path_m, 100 * o.scale_error);
  assert_true(o.s.n_placed >= 18 && o.s.n_placed <= 36);
  assert_true(o.ate_percent < 0.5);
}

// A rig with hardly any baseline says so; one camera alone is not placed.
TEST(test_small_baseline) {
  outcome o = track("room,rig=stereo,angle=0.2,arc=20,path=smooth,size=320x240" NOISE, 12, ~0u);
  print_message("0.2 degrees: %d placed, scale told +- %.1f %%, off by %.1f %%\n", o.s.n_placed,
                100 * o.s.scale_sigma, 100 * o.scale_error);
  assert_true(o.s.n_placed < 12 || o.s.scale_sigma > 0.02);
  o = track("room,rig=mono,arc=20,path=smooth,size=320x240" NOISE, 6, ~0u);
  assert_false(o.s.is_still);
  assert_true(o.s.n_placed < 2 && o.s.scale_sigma < 0);
}

// Nothing moves: exactly the same pose everywhere. A dark room has nothing to see.
TEST(test_still) {
  outcome o = track("room,rig=stereo,path=step,arc=0,exposures=100000,size=320x240" NOISE, 6, ~0u);
  sv_pose id = sv_pose_identity();
  print_message("still: %.2f px\n", o.s.still_px);
  assert_true(o.s.is_still && o.s.n_placed == 6 && o.s.path_m == 0);
  for (int i = 0; i < 6; i++) assert_memory_equal(&tracker.pose[i], &id, sizeof id);
  sv_kernels k;
  sv_err err;
  sv_arena a = sv_arena_make(block + (32 << 20), 32 << 20);
  sv_track_cfg t = tracker.cfg;
  static uint8_t black[320 * 240 * 3];
  sv_image_u8 image[2] = {{black, 320, 240, 3, 960}, {black, 320, 240, 3, 960}};
  sv_kernels_init(&k, ~0u);
  assert_int_equal(sv_tracker_init(&tracker, &t, &k, &a, &err), SV_OK);
  for (int i = 0; i < 4; i++) assert_int_equal(sv_tracker_add(&tracker, image), SV_AGAIN);
  sv_tracker_finish(&tracker, NULL, &o.s);
  assert_true(o.s.n_placed == 0 && !o.s.is_still && o.s.n_points == 0 && o.s.still_px == -1);
  image[1].width_px = 160;
  assert_int_equal(sv_tracker_add(&tracker, image), SV_E_RANGE);
}

// Exposures that see nothing of what the first one saw do not tell whether the rig stands: they are
// left out, and when there are no others nothing is known.
TEST(test_still_covered) {
  static const char spec[] = "room,rig=stereo,path=step,arc=0,exposures=100000,size=320x240" NOISE;
  outcome o = track_covered(spec, 6, ~0u, 2, 1);
  assert_true(o.s.is_still && o.s.n_placed == 5 && !tracker.is_placed[2] && tracker.is_placed[5]);
  assert_true(o.s.still_px >= 0 && o.s.still_px < 0.6);
  o = track_covered(spec, 3, ~0u, 1, 2);
  assert_true(!o.s.is_still && o.s.n_placed == 1 && o.s.still_px == -1);
  o = track_covered("room,rig=stereo,path=handheld,size=320x240" NOISE, 12, ~0u, 5, 1);
  assert_true(!o.s.is_still && o.s.still_px > 0.6 && o.s.still_px < 1e3);
}

// The reference kernels and the fastest exact ones place the rig at the same bits.
TEST(test_same_bits) {
  static const char spec[] = "textured,rig=stereo,path=handheld,exposures=60,size=320x240" NOISE;
  static sv_pose ref[5];
  (void)track(spec, 5, sv_isa_only(SV_ISA_REF));
  memcpy(ref, tracker.pose, sizeof ref);
  (void)track(spec, 5, ~sv_isa_only(SV_ISA_SSE41));
  assert_memory_equal(ref, tracker.pose, sizeof ref);
}

// --- whole runs ----------------------------------------------------------------------------------

static void true_pose(void *self, sv_ns time_ns, sv_pose *rig_from_world) {
  sv_sim_rig_pose(self, time_ns, rig_from_world);
}

// Mean squared error of a held-out view, turned by up to half a pixel to where it fits best: a
// world that was found fits the true one by its trajectory only as well as that is known. So are
// views of unknown poses scored elsewhere (Lin et al., BARF, 2021: the poses of test views are
// optimised).
static double registered_mse(const sv_view *v, const uint8_t *rgb) {
  static const float toward[4][2] = {{1, 0}, {-1, 0}, {0, 1}, {0, -1}};
  sv_view at = *v;
  double best, mse;
  assert_int_equal(sv_driver_mse(&w.app.trainer, v, rgb, &best), SV_OK);
  for (float step = 0.2f; step > 0.04f; step *= 0.5f)
    for (bool is_better = true; is_better;) {
      const sv_view from = at;
      is_better = false;
      for (int k = 0; k < 4; k++) {
        sv_view u = from;
        u.cx += step * toward[k][0];
        u.cy += step * toward[k][1];
        if (fabsf(u.cx - v->cx) > 0.51f || fabsf(u.cy - v->cy) > 0.51f) continue;
        assert_int_equal(sv_driver_mse(&w.app.trainer, &u, rgb, &mse), SV_OK);
        if (mse < best) {
          best = mse;
          at = u;
          is_better = true;
        }
      }
    }
  return best;
}

static double run(const char *spec, bool is_tracking) {
  static uint8_t rgb[320 * 240 * 3];
  double psnr = 0;
  world_open_well(&w, spec, 24, ~0u, 2);
  w.cfg.train.n_gaussians = 3000;
  w.cfg.steps = 400;
  w.cfg.is_tracking = is_tracking;
  world_run_well(&w);
  assert_int_equal(w.app.odometry.is_tracked, is_tracking);
  sv_similarity q = {.s = 1};
  if (is_tracking) q = sv_odometry_from(&w.app.odometry, &w.app.exposures, true_pose, &w.sim);
  for (int i = 0; i < 8; i++) {
    sv_view v;
    double t;
    sv_sim_heldout_view(&w.sim, i, 8, &v, &t);
    sv_sim_render(&w.sim, &v, t, rgb, NULL);
    if (is_tracking) v = sv_odometry_view(&q, &v);
    psnr -= 10 * log10(registered_mse(&v, rgb)) / 8;
  }
  if (is_tracking) assert_int_equal(w.app.odometry.summary.n_placed, 24);
  world_close(&w);
  return psnr;
}

TEST(test_run) {
  static const char known[] = "textured,rig=stereo,path=handheld,arc=120,size=320x240" NOISE,
                    unknown[] = "textured,rig=stereo,path=handheld,arc=120,poses=unknown,size=320x240" NOISE;
  double a = run(known, false), b = run(unknown, true);
  print_message("held-out PSNR: %.2f dB with the true poses, %.2f dB with those that were tracked\n", a, b);
  assert_true(b > a - 1.0);
}

// Half of what moves here has more texture than what does not: its points do not fit the rig's
// motion, and are given up.
TEST(test_moving) {
  outcome o = track("moving,rig=stereo,path=handheld,arc=60,size=320x240", 25, ~0u);
  print_message("a moving scene: %d placed, %.3f %% of %.1f m, scale off by %.3f %%, %.2f px\n", o.s.n_placed,
                o.ate_percent, o.s.path_m, 100 * o.scale_error, o.s.rms_px);
  assert_int_equal(o.s.n_placed, 25);
  assert_true(o.ate_percent < 0.1); // measured: 0.042 %, 0.0006
  assert_true(fabs(o.scale_error) < 0.003);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_moving),         cmocka_unit_test(test_handheld),
      cmocka_unit_test(test_upright),        cmocka_unit_test(test_imu),
      cmocka_unit_test(test_full_circle),    cmocka_unit_test(test_rolling_shutter),
      cmocka_unit_test(test_small_baseline), cmocka_unit_test(test_still),
      cmocka_unit_test(test_still_covered),  cmocka_unit_test(test_same_bits),
      cmocka_unit_test(test_long),           cmocka_unit_test(test_run),
      cmocka_unit_test(test_lost),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
