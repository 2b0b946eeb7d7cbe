// SPDX-License-Identifier: Apache-2.0
// A model of one instant meets the pictures of another: Gaussians come back where the newest
// pictures have surfaces, what is right stays, and nothing happens where depth cannot be told.
#include <math.h>
#include <string.h>

#include "src/metric/metric.h"
#include "src/dynamic/renew.h"
#include "tests/common/test.h"
#include "tests/common/world.h"

#define JUMP_S 0.5

static world w;
static uint8_t picture[2][160 * 120 * 3];

// A model trained on one exposure, from its depth maps.
static void open_trained(const char *spec, int n_threads) {
  world_open_well(&w, spec, 1, ~0u, n_threads);
  w.cfg.is_dynamic = w.cfg.is_continuous = true;
  w.cfg.exposure_s = 3600; // no other exposure comes in
  w.cfg.train.n_gaussians = 2000;
  w.cfg.train.sh_degree = 0;
  w.cfg.steps = 100;
  world_run_well(&w);
}

// The same cameras, so many seconds later.
static void let_pass(double seconds) {
  for (int i = 0; i < world_stats(&w).n_views; i++) {
    sv_train_view *v = &w.app.trainer.views[i];
    sv_view now = v->view;
    now.time += (float)seconds;
    double at = sv_ns_to_s(w.app.exposures.exposure[0].time_ns - SV_SIM_EPOCH_NS) + seconds;
    sv_sim_render(&w.sim, &v->view, at, picture[i], NULL);
    sv_image_u8 image = v->image;
    image.px = picture[i];
    sv_train_replace_view(&w.app.trainer, i, &now, &image);
  }
}

static double psnr_of_newest(void) {
  double sum = 0;
  for (int i = 0; i < world_stats(&w).n_views; i++) {
    const sv_train_view *v = &w.app.trainer.views[i];
    double mse;
    assert_int_equal(sv_driver_mse(&w.app.trainer, &v->view, v->image.px, &mse), SV_OK);
    sum += sv_psnr_of_mse(mse) / world_stats(&w).n_views;
  }
  return sum;
}

static uint32_t renew(void) {
  const uint32_t before = world_stats(&w).n_renewed;
  const size_t used = w.app.scratch.used_bytes;
  assert_int_equal(sv_dynamic_renew(&w.app.dynamic, 0.5f, &w.app.scratch), SV_OK);
  assert_int_equal(w.app.scratch.used_bytes, used);
  return world_stats(&w).n_renewed - before;
}

TEST(what_has_moved_is_there_at_once) {
  uint64_t digest[2];
  for (int i = 0; i < 2; i++) {
    open_trained("moving,rig=stereo,arc=0,size=160x120", 1 + i);
    const double trained = psnr_of_newest();
    assert_true(renew() < 100); // of 2000: the model shows what there is
    const double kept = psnr_of_newest();
    let_pass(JUMP_S);
    const double old = psnr_of_newest();
    const uint32_t n = renew();
    const double renewed = psnr_of_newest();
    print_message("trained %.2f dB, kept %.2f dB, %.1f s later %.2f dB, with %u Gaussians anew %.2f dB\n",
                  trained, kept, JUMP_S, old, n, renewed);
    assert_true(trained > 25 && kept > trained - 1.5);
    assert_in_range(n, 50, 1000);
    assert_true(renewed > old + 2);
    assert_int_equal(world_stats(&w).n_gaussians, 2000);
    digest[i] = world_digest(&w);
    world_close(&w);
  }
  assert_true(digest[0] == digest[1]);
}

// One camera alone: no depth maps, and everything stays as it was to the bit.
TEST(one_camera_tells_no_depth) {
  open_trained("moving,rig=mono,arc=0,size=160x120", 1);
  let_pass(JUMP_S);
  const uint64_t before = world_digest(&w);
  assert_int_equal(renew(), 0);
  assert_true(world_digest(&w) == before);
  world_close(&w);
}

// A black picture has nothing that could be measured.
TEST(nothing_to_be_seen) {
  open_trained("moving,rig=stereo,arc=0,size=160x120", 1);
  let_pass(JUMP_S);
  memset(picture, 0, sizeof picture);
  const uint64_t before = world_digest(&w);
  assert_int_equal(renew(), 0);
  assert_true(world_digest(&w) == before);
  world_close(&w);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(what_has_moved_is_there_at_once),
      cmocka_unit_test(one_camera_tells_no_depth),
      cmocka_unit_test(nothing_to_be_seen),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
