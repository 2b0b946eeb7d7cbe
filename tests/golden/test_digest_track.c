// SPDX-License-Identifier: Apache-2.0
// A digest of tracked poses and points that must be equal on every machine and for every exact ISA.
#include <string.h>

#include "platform/sim/sim.h"
#include "src/track/tracker.h"
#include "tests/common/test.h"

#define N           5
#define GOLDEN      0xad8c75f31738c70full
#define SPEC        "textured,rig=stereo,path=handheld,arc=40,size=224x168,noise=read:1e-5:shot:1e-3,exposures=20"
#define CAMERA_SIZE (224 * 168 * 3)

static uint8_t block[32 << 20], picture[2][CAMERA_SIZE];
static sv_sim sim;
static sv_tracker tracker;

static uint64_t fold(uint64_t h, const void *data, size_t bytes) {
  const uint8_t *p = data;
  for (size_t i = 0; i < bytes; i++) h = (h ^ p[i]) * 1099511628211ull;
  return h;
}

static uint64_t digest(uint32_t isa_mask) {
  sv_err err;
  sv_sim_config c;
  sv_kernels k;
  sv_track_summary sum;
  sv_arena a = sv_arena_make(block, sizeof block);
  sv_kernels_init(&k, isa_mask);
  assert_int_equal(sv_sim_parse(&c, SPEC, &err), SV_OK);
  assert_int_equal(sv_sim_init(&sim, &c, &a, &err), SV_OK);
  sv_track_cfg t = sv_track_defaults();
  t.rig = sv_sim_rig(&sim);
  t.cap_exposures = N;
  t.n_features = 200;
  assert_int_equal(sv_tracker_init(&tracker, &t, &k, &a, &err), SV_OK);
  sv_source src = sv_sim_source(&sim);
  assert_int_equal(src.start(src.self), SV_OK);
  for (int i = 0; i < N; i++) {
    sv_image_u8 image[2];
    for (int v = 0; v < 2; v++) {
      sv_frame f;
      assert_int_equal(src.dequeue(src.self, &f, INT64_MAX), SV_OK);
      memcpy(picture[f.i_camera], f.data, CAMERA_SIZE);
      image[f.i_camera] = (sv_image_u8){picture[f.i_camera], 224, 168, 3, 672};
      assert_int_equal(src.requeue(src.self, &f), SV_OK);
    }
    assert_int_equal(sv_tracker_add(&tracker, image), SV_OK);
  }
  sv_tracker_finish(&tracker, NULL, &sum);
  assert_int_equal(sum.n_placed, N);
  uint64_t h = fold(14695981039346656037ull, tracker.pose, N * sizeof *tracker.pose);
  for (int i = 0; i < tracker.n_points; i++)
    if (tracker.point[i].has_depth) h = fold(h, tracker.point[i].x, sizeof tracker.point[i].x);
  return h;
}

TEST(test_digest) {
  for (int isa = 0; isa < SV_N_ISAS; isa++) {
    // SSE4.1 has no fused operations
    if (!(sv_cpu_isas() & SV_ISA_BIT(isa)) || isa == SV_ISA_SSE41) continue;
    uint64_t h = digest(sv_isa_only((sv_isa)isa));
    if (h != GOLDEN)
      fail_msg("%s: digest 0x%llx, expected 0x%llx", sv_isa_name((sv_isa)isa), (unsigned long long)h, GOLDEN);
  }
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_digest)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
