// SPDX-License-Identifier: Apache-2.0
// A handheld run in which the hand jerks now and then: exposures that are clearly less sharp than
// those before them are left out and counted; steady ones, moving at any speed, are all kept.
#include <string.h>

#include "src/metric/metric.h"
#include "tests/common/test.h"
#include "tests/common/world.h"

#define N_EXPOSURES 24
#define HANDHELD    "textured,rig=stereo,path=handheld,arc=120,poses=unknown,size=320x240,exposures=30"
#define JERK_PX     24

static world w;
static sv_status (*plain_dequeue)(void *self, sv_frame *f, sv_ns until_ns);

// Every sixth frame of both cameras: the mean over a motion along x.
static sv_status jerked(void *self, sv_frame *f, sv_ns until_ns) {
  static uint8_t row[320 * 3];
  const sv_status s = plain_dequeue(self, f, until_ns);
  for (int y = 0; s == SV_OK && f->sequence % 6 == 5 && y < f->height_px; y++) {
    uint8_t *px = (uint8_t *)(uintptr_t)f->data + (size_t)y * (size_t)f->stride_bytes;
    memcpy(row, px, sizeof row);
    for (int i = 0; i < 3 * f->width_px; i++) {
      int sum = 0, n = 0;
      for (int k = 0; k < JERK_PX && i + 3 * k < 3 * f->width_px; k++, n++) sum += row[i + 3 * k];
      px[i] = (uint8_t)(sum / n);
    }
  }
  return s;
}

static void true_pose(void *self, sv_ns time_ns, sv_pose *rig_from_world) {
  sv_sim_rig_pose(self, time_ns, rig_from_world);
}

// Of held-out views, through the frame that odometry found.
static double heldout_psnr(void) {
  static uint8_t rgb[320 * 240 * 3];
  const sv_similarity q = sv_odometry_from(&w.app.odometry, &w.app.exposures, true_pose, &w.sim);
  double psnr = 0;
  for (int i = 0; i < 6; i++) {
    sv_view v;
    double t, mse;
    sv_sim_heldout_view(&w.sim, i, 6, &v, &t);
    sv_sim_render(&w.sim, &v, t, rgb, NULL);
    v = sv_odometry_view(&q, &v);
    assert_int_equal(sv_driver_mse(&w.app.trainer, &v, rgb, &mse), SV_OK);
    psnr += sv_psnr_of_mse(mse) / 6;
  }
  return psnr;
}

typedef struct {
  uint64_t n_blurred;
  int n_exposures, n_placed;
  double psnr;
  size_t bytes;
} outcome;

static outcome run(const char *spec, bool is_jerked, bool is_tracking, bool is_blur_kept) {
  outcome o;
  world_open_well(&w, spec, N_EXPOSURES, ~0u, 2);
  w.cfg.is_tracking = is_tracking;
  w.cfg.is_blur_kept = is_blur_kept;
  w.cfg.train.n_gaussians = 2000;
  w.cfg.steps = 300;
  if (is_jerked) {
    plain_dequeue = w.inner.source.dequeue;
    w.inner.source.dequeue = jerked;
  }
  o.bytes = world_app_bytes(&w);
  world_run_well(&w);
  const sv_ledger l = sv_sync_ledger_sum(&w.app.queue.sync);
  assert_true(sv_ledger_is_exact(&l));
  o.n_blurred = l.dropped[SV_DROP_BLURRED];
  o.n_exposures = w.app.exposures.n;
  o.n_placed = w.app.odometry.summary.n_placed;
  o.psnr = is_tracking ? heldout_psnr() : 0;
  assert_int_equal(o.n_blurred, 2 * w.app.capture.n_blurred);
  assert_true(world_has_line(&w, "clearly less sharp") == (o.n_blurred > 0));
  world_close(&w);
  world_forget_files(&w);
  return o;
}

TEST(test_jerks) {
  const outcome steady = run(HANDHELD, false, true, false), kept = run(HANDHELD, true, true, true),
                sharp_only = run(HANDHELD, true, true, false);
  print_message("held-out views: steady %.2f dB, blurred kept %.2f dB, left out %.2f dB\n", steady.psnr,
                kept.psnr, sharp_only.psnr);
  assert_int_equal(steady.n_blurred, 0);
  assert_int_equal(kept.n_blurred, 0);
  assert_int_equal(sharp_only.n_blurred, 2 * 4); // of the first 28 exposures
  assert_int_equal(sharp_only.n_exposures, N_EXPOSURES);
  assert_int_equal(sharp_only.n_placed, N_EXPOSURES);
  assert_true(sharp_only.psnr > kept.psnr + 1);
  assert_true(sharp_only.bytes > kept.bytes); // its scratch is counted
}

// Motion blur of a steady hand is the same in all exposures. Around an object whose sides differ in
// texture, sharpness halves and doubles from exposure to exposure.
TEST(test_steady) {
  const outcome slow = run(HANDHELD ",blur=on,shutter_us=20000", false, true, false),
                rolling = run(HANDHELD ",readout_ms=20", false, true, false),
                around = run("occlusion,rig=phone,path=handheld,poses=unknown,size=320x240,exposures=24",
                             false, true, false);
  assert_int_equal(slow.n_blurred, 0);
  assert_int_equal(rolling.n_blurred, 0);
  assert_int_equal(around.n_blurred, 0);
}

// Rigs whose poses are known are not judged.
TEST(test_known_poses) {
  const outcome o = run("textured,rig=stereo,size=320x240,exposures=30", true, false, false);
  assert_int_equal(o.n_blurred, 0);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_jerks), cmocka_unit_test(test_steady),
                                     cmocka_unit_test(test_known_poses)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
