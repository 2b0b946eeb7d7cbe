// SPDX-License-Identifier: Apache-2.0
// What odometry costs a frame of 640x480 before any geometry: pyramid, corners, and following what
// it knows. Processor time of one core, the least of several runs.
#include <string.h>
#include <time.h>

#include "platform/sim/sim.h"
#include "src/track/tracker.h"
#include "tests/common/test.h"

#define BUDGET_MS 16.0 // quiet machines take 2.5 (Intel) and 6 (AMD)
#define N_BYTES   (640 * 480 * 3)

static uint8_t block[64 << 20], picture[2][2][N_BYTES];
static sv_sim sim;
static sv_tracker tracker;

static double cpu_ms(void) {
  struct timespec t;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return (double)t.tv_sec * 1e3 + (double)t.tv_nsec * 1e-6;
}

TEST(test_frame) {
  sv_err err;
  sv_sim_config c;
  sv_kernels k;
  sv_image_u8 image[2][2];
  sv_arena a = sv_arena_make(block, sizeof block);
  sv_kernels_init(&k, ~0u);
  if (k.isa == SV_ISA_REF) skip(); // a budget is for vector units
  assert_int_equal(sv_sim_parse(&c, "room,rig=stereo,path=handheld,size=640x480,exposures=60", &err), SV_OK);
  assert_int_equal(sv_sim_init(&sim, &c, &a, &err), SV_OK);
  sv_track_cfg t = sv_track_defaults();
  t.rig = sv_sim_rig(&sim);
  t.cap_exposures = 4;
  assert_int_equal(sv_tracker_init(&tracker, &t, &k, &a, &err), SV_OK);
  sv_source src = sv_sim_source(&sim);
  assert_int_equal(src.start(src.self), SV_OK);
  for (int i = 0; i < 4; i++) {
    sv_frame f;
    assert_int_equal(src.dequeue(src.self, &f, INT64_MAX), SV_OK);
    memcpy(picture[i / 2][f.i_camera], f.data, N_BYTES);
    image[i / 2][f.i_camera] = (sv_image_u8){picture[i / 2][f.i_camera], 640, 480, 3, 1920};
    assert_int_equal(src.requeue(src.self, &f), SV_OK);
  }
  assert_int_equal(sv_tracker_add(&tracker, image[0]), SV_OK);
  double best = 1e9;
  for (int run = 0; run < 15; run++) {
    double from = cpu_ms();
    sv_track_build(&tracker, image[1]);
    for (int v = 0; v < 2; v++) (void)sv_track_detect(&tracker, v);
    sv_track_follow(&tracker, &tracker.pose[0]);
    double ms = (cpu_ms() - from) / 2;
    if (ms < best) best = ms;
    tracker.i_now = 1 - tracker.i_now;
  }
  print_message("%.2f ms a frame of 640x480, %d places followed in two\n", best, tracker.n_found);
  assert_true(tracker.n_found > 200);
  assert_true(best < BUDGET_MS);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_frame)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
