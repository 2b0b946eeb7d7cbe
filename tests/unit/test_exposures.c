// SPDX-License-Identifier: Apache-2.0
// The pool of exposures: one whose pictures cannot all be decoded leaves no trace.
#include <math.h>
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

// The mask of a camera comes with each of its images: as it is of a straight lens; of others a
// pixel counts where all pixels that it is interpolated from do. It takes memory of its own.
TEST(test_mask) {
  static uint8_t mask[SIDE * SIDE];
  static sv_sub_view sub[2];
  static sv_camera_caps caps[2];
  const sv_rig rig = {.sub_views = sub, .n_sub_views = 2, .cap_sub_views = 2};
  size_t bytes[2];
  for (int i = 0; i < 2; i++) {
    sub[i] = (sv_sub_view){.i_camera = i,
                           .model = {.kind = i ? SV_MODEL_OPENCV4 : SV_MODEL_PINHOLE,
                                     .width_px = SIDE,
                                     .height_px = SIDE,
                                     .p = {30, 30, SIDE / 2, SIDE / 2, -0.2}},
                           .cam_from_rig = sv_pose_identity()};
    caps[i] = (sv_camera_caps){.width_px = SIDE, .height_px = SIDE, .format = SV_PIX_RGB8};
  }
  memset(mask, 255, sizeof mask);
  memset(mask, 0, 5 * SIDE); // the upper five rows
  const sv_exposures_cfg cfg = {
      .rig = &rig, .cap_exposures = 2, .caps = caps, .n_cameras = 2, .n_threads = 1};
  for (int has_mask = 0; has_mask < 2; has_mask++) {
    sv_arena arena = sv_arena_make(block, sizeof block);
    sv_err err;
    for (int i = 0; i < 2; i++) sub[i].mask = has_mask ? mask : NULL;
    assert_ok(sv_exposures_init(&pool, &cfg, &arena, &err), &err);
    bytes[has_mask] = arena.used_bytes;
    for (int i = 0; i < 2; i++) {
      sv_image_u8 image;
      sv_view view;
      sv_exposures_get(&pool, 0, i, &image, &view);
      assert_true((image.mask != NULL) == has_mask);
      for (int y = 0; y < SIDE && has_mask; y++) {
        // in the middle column, x = 0
        const double up = (y + 0.5 - (double)view.cy) / (double)view.fy;
        const double y_px = i ? 30 * up * (1 - 0.2 * up * up) + SIDE / 2 : y + 0.5;
        const bool is_masked = !sv_image_counts(&image, 1, SIDE / 2, y);
        if (y_px < 5) assert_true(is_masked);
        if (y_px > (i ? 6.6 : 5)) assert_true(!is_masked);
      }
    }
  }
  assert_true(bytes[1] >= bytes[0] + 2 * SIDE * SIDE);
}

// --- blur ----------------------------------------------------------------------------------------

static uint8_t sharp[SIDE * SIDE * 3], soft[SIDE * SIDE * 3];

// A texture, and what a motion of n_px pixels along x makes of it.
static void make_textures(int seed, int n_px) {
  for (int y = 0; y < SIDE; y++)
    for (int x = 0; x < SIDE; x++)
      for (int c = 0; c < 3; c++)
        sharp[3 * (y * SIDE + x) + c] =
            (uint8_t)((x / 3 * 37 + y / 4 * 91 + x / 3 * (y / 4) * 53 + 7 * seed) % 200);
  for (int y = 0; y < SIDE; y++)
    for (int x = 0; x < SIDE; x++)
      for (int c = 0; c < 3; c++) {
        int sum = 0;
        for (int i = 0; i < n_px; i++) sum += sharp[3 * (y * SIDE + (x + i) % SIDE) + c];
        soft[3 * (y * SIDE + x) + c] = (uint8_t)(sum / n_px);
      }
}

// gain: of the light, so many percent.
static sv_status add_textured(bool is_soft, int gain) {
  static uint8_t px[SIDE * SIDE * 3];
  const sv_compute c = compute_serial();
  const sv_exposure exposure = {.rig_from_world = sv_pose_identity()};
  sv_err err;
  for (int i = 0; i < SIDE * SIDE * 3; i++) px[i] = (uint8_t)((is_soft ? soft : sharp)[i] * gain / 100);
  const sv_frame f = {.width_px = SIDE,
                      .height_px = SIDE,
                      .format = SV_PIX_RGB8,
                      .stride_bytes = 3 * SIDE,
                      .data = px,
                      .data_bytes = sizeof px};
  return sv_exposures_add(&pool, &exposure, &f, c.k, c.pool, &err);
}

// Left out: half as sharp as those before. Kept: the first ones, other exposure times, other
// textures, dark images, and who goes on being blurred.
TEST(test_blur) {
  sv_sub_view sub = {
      .model = {.kind = SV_MODEL_PINHOLE, .width_px = SIDE, .height_px = SIDE, .p = {30, 30, 16, 16}},
      .cam_from_rig = sv_pose_identity()};
  const sv_camera_caps caps = {.width_px = SIDE, .height_px = SIDE, .format = SV_PIX_RGB8};
  const sv_rig rig = {.sub_views = &sub, .n_sub_views = 1, .cap_sub_views = 1};
  for (int is_on = 0; is_on < 2; is_on++) {
    const sv_exposures_cfg cfg = {.rig = &rig,
                                  .cap_exposures = 32,
                                  .caps = &caps,
                                  .n_cameras = 1,
                                  .n_threads = 1,
                                  .is_blur_dropped = is_on};
    sv_arena arena = sv_arena_make(block, sizeof block);
    sv_err err;
    assert_ok(sv_exposures_init(&pool, &cfg, &arena, &err), &err);
    const sv_status dropped = is_on ? SV_DROPPED : SV_OK;
    make_textures(0, 8);
    assert_int_equal(add_textured(true, 100), SV_OK); // nothing to compare with
    for (int i = 0; i < 4; i++) assert_int_equal(add_textured(false, 100), SV_OK);
    const int n = pool.n;
    assert_int_equal(add_textured(true, 100), dropped);
    assert_int_equal(pool.n, is_on ? n : n + 1);
    for (int i = 0; i < 3; i++) {
      make_textures(i, 8);
      assert_int_equal(add_textured(false, 60 + 20 * i), SV_OK);
    }
    assert_int_equal(add_textured(false, 1), SV_OK); // dark
    assert_int_equal(add_textured(true, 70), dropped);
    int n_lost = 0;
    for (int i = 0; i < 8; i++) n_lost += add_textured(true, 100) == SV_DROPPED;
    assert_in_range(n_lost, is_on, is_on ? 4 : 0); // they are usual by now
  }
}

// Around the image circle of a fisheye no pixel counts; one that fills its picture has no mask. One
// of a rolling shutter stays a fisheye: its rows are read as those of its picture.
TEST(test_image_circle) {
  static sv_sub_view sub[1];
  static sv_camera_caps caps[1];
  const sv_rig rig = {.sub_views = sub, .n_sub_views = 1, .cap_sub_views = 1};
  const sv_exposures_cfg cfg = {
      .rig = &rig, .cap_exposures = 1, .caps = caps, .n_cameras = 1, .n_threads = 1};
  caps[0] = (sv_camera_caps){.width_px = SIDE, .height_px = SIDE, .format = SV_PIX_RGB8};
  for (int i = 0; i < 3; i++) { // d(t) = t - 0.1 t^3 has its fold at 105 degrees, d = 1.22
    const double focal = i == 0 ? 13 : 30;
    sub[0] = (sv_sub_view){.model = {SV_MODEL_KB4, SIDE, SIDE, {focal, focal, SIDE / 2, SIDE / 2, -0.1}},
                           .cam_from_rig = sv_pose_identity(),
                           .shutter.readout_s = i == 2 ? 0.02 : 0};
    sv_arena arena = sv_arena_make(block, sizeof block);
    sv_err err;
    sv_image_u8 im;
    sv_view v;
    assert_ok(sv_exposures_init(&pool, &cfg, &arena, &err), &err);
    pool.exposure[0] = (sv_exposure){.rig_from_world = sv_pose_identity()};
    sv_exposures_get(&pool, 0, 0, &im, &v);
    assert_true(v.fisheye && (im.mask != NULL) == (i == 0));
    for (int row = 0; i == 2 && row < SIDE; row++)
      assert_near(sv_row_time_at(&pool.sub[0].row_time, 0.1, (row + 0.5 - SIDE / 2) / focal),
                  0.02 * ((row + 0.5) / SIDE - 0.5), 1e-6);
    for (int p = 0; im.mask && p < SIDE * SIDE; p++) {
      const double x = p % SIDE + 0.5 - SIDE / 2, y = p / SIDE + 0.5 - SIDE / 2,
                   rho = sqrt(x * x + y * y) / focal;
      if (rho < 1.0) assert_int_equal(im.mask[p], 1);
      if (rho > 1.22) assert_int_equal(im.mask[p], 0);
    }
  }
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_damaged_picture), cmocka_unit_test(test_mask),
                                     cmocka_unit_test(test_image_circle), cmocka_unit_test(test_blur)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
