// SPDX-License-Identifier: Apache-2.0
// The pool of exposures: one whose pictures cannot all be decoded leaves no trace.
#include <string.h>

#include "src/capture/exposures.h"
#include "tests/common/test.h"
#include "tests/common/world.h"

#define SIDE 32

// A "picture" is a byte: all pixels have it; 0 is damaged.
static sv_status decode(void *self, const uint8_t *data, size_t bytes, const sv_decoded *out, sv_err *err) {
  (void)self, (void)bytes;
  if (!data[0]) return sv_fail(err, SV_E_CORRUPT, "the picture is damaged");
  for (int y = 0; y < out->height_px; y++)
    memset(out->rgb + (size_t)y * out->stride_bytes, data[0], 3 * (size_t)out->width_px);
  return SV_OK;
}

static sv_exposures pool;
static _Alignas(64) uint8_t block[1 << 20];

static sv_status add(sv_ns time_ns, uint8_t left, uint8_t right) {
  const uint8_t picture[2] = {left, right};
  const sv_exposure exposure = {.time_ns = time_ns, .rig_from_world = sv_pose_identity()};
  const sv_kernels *k = NULL; // compressed pictures of straight lenses need none
  const sv_pool serial = sv_pool_serial();
  sv_frame frame[2];
  sv_err err;
  memset(frame, 0, sizeof frame);
  for (int i = 0; i < 2; i++)
    frame[i] = (sv_frame){.i_camera = i,
                          .width_px = SIDE,
                          .height_px = SIDE,
                          .format = SV_PIX_JPEG,
                          .data = picture + i,
                          .data_bytes = 1};
  return sv_exposures_add(&pool, &exposure, frame, k, &serial, &err);
}

static void assert_slot(int slot, sv_ns time_ns, int left, int right) {
  assert_int_equal(pool.exposure[slot].time_ns, time_ns);
  for (int i = 0; i < 2; i++) {
    sv_image_u8 image;
    sv_view view;
    sv_exposures_get(&pool, slot, i, &image, &view);
    for (int k = 0; k < SIDE * SIDE * 3; k++) assert_int_equal(image.px[k], i == 0 ? left : right);
  }
}

TEST(test_damaged_picture) {
  static sv_sub_view sub[2];
  static sv_camera_caps caps[2];
  const sv_rig rig = {.sub_views = sub, .n_sub_views = 2, .cap_sub_views = 2};
  const sv_decoder decoder = {NULL, decode};
  for (int i = 0; i < 2; i++) {
    sub[i] = (sv_sub_view){.i_camera = i,
                           .model = {.kind = SV_MODEL_PINHOLE,
                                     .width_px = SIDE,
                                     .height_px = SIDE,
                                     .p = {30, 30, SIDE / 2, SIDE / 2}},
                           .cam_from_rig = sv_pose_identity()};
    caps[i] = (sv_camera_caps){.width_px = SIDE, .height_px = SIDE, .format = SV_PIX_JPEG};
  }
  const sv_exposures_cfg cfg = {
      .rig = &rig, .cap_exposures = 2, .caps = caps, .n_cameras = 2, .n_threads = 1, .decoder = &decoder};
  sv_arena arena = sv_arena_make(block, sizeof block);
  sv_err err;
  assert_ok(sv_exposures_init(&pool, &cfg, &arena, &err), &err);
  assert_int_equal(add(100, 10, 11), SV_OK);
  assert_int_equal(add(200, 20, 21), SV_OK);
  assert_int_equal(add(300, 30, 0), SV_E_CORRUPT);
  assert_slot(0, 100, 10, 11); // would have been replaced
  assert_slot(1, 200, 20, 21);
  assert_int_equal(add(400, 40, 41), SV_OK);
  assert_int_equal(add(500, 0, 51), SV_E_CORRUPT);
  assert_int_equal(add(600, 60, 61), SV_OK);
  assert_slot(0, 400, 40, 41);
  assert_slot(1, 600, 60, 61);
  assert_int_equal(pool.n_replaced, 2);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_damaged_picture)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
