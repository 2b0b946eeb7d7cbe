// SPDX-License-Identifier: Apache-2.0
// Photometric calibration: what rig.json says, and pictures that are corrected by it.
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "kernels/ops.h"
#include "src/capture/exposures.h"
#include "src/format/rig_file.h"
#include "src/rig/sizes.h"
#include "tests/common/test.h"

#define W 64
#define H 48

static const double color[9] = {0.9, 0.05, 0, 0.02, 1.2, 0.1, 0, 0.1, 1.5};

static double linear_of(double v) { return v <= 0.04045 ? v / 12.92 : pow((v + 0.055) / 1.055, 2.4); }
static double display_of(double x) {
  x = x < 0 ? 0 : x > 1 ? 1 : x;
  return x <= 0.0031308 ? 12.92 * x : 1.055 * pow(x, 1 / 2.4) - 0.055;
}

static sv_sub_view lens(int w, int h) {
  sv_sub_view v = {.name = "camera"};
  v.model.kind = SV_MODEL_PINHOLE;
  v.model.width_px = w;
  v.model.height_px = h;
  v.cam_from_rig = sv_pose_identity();
  const double p[4] = {60, 60, 30, 25};
  memcpy(v.model.p, p, sizeof p);
  v.photometric = sv_photometry_none(&v.model);
  memcpy(v.photometric.color, color, sizeof color);
  v.photometric.falloff[0] = -0.3;
  v.photometric.falloff[1] = -0.1;
  return v;
}

// A smooth picture as the reference shows it.
static void reference(int x, int y, double out[3]) {
  out[0] = 0.2 + 0.3 * x / W;
  out[1] = 0.5 - 0.3 * y / H;
  out[2] = 0.3 + 0.1 * (x + y) / (W + H);
}

static uint8_t frame_px[W * H * 3], block[1 << 20];

static void shoot(const sv_sub_view *v) {
  for (int y = 0; y < H; y++)
    for (int x = 0; x < W; x++) {
      double in[3];
      reference(x, y, in);
      const double f = sv_photometry_falloff(&v->photometric,
                                             sv_photometry_r2(&v->photometric, &v->model, x + 0.5, y + 0.5));
      for (int k = 0; k < 3; k++) {
        const double *m = v->photometric.color + 3 * k;
        frame_px[3 * (y * W + x) + k] =
            (uint8_t)(255 * display_of(f * (m[0] * in[0] + m[1] * in[1] + m[2] * in[2])) + 0.5);
      }
    }
}

// Largest difference of the picture in the pool to the reference's.
static int off_of(const sv_sub_view *v, int step) {
  static sv_exposures pool;
  sv_sub_view views[1] = {*v};
  const sv_rig rig = {.sub_views = views, .n_sub_views = 1, .cap_sub_views = 1};
  const sv_camera_caps caps = {
      .width_px = W, .height_px = H, .format = SV_PIX_RGB8, .frame_bytes = sizeof frame_px};
  const sv_exposures_cfg cfg = {
      .rig = &rig, .cap_exposures = 1, .caps = &caps, .n_cameras = 1, .n_threads = 1};
  sv_kernels kernels;
  sv_arena a = sv_arena_make(block, sizeof block);
  sv_err err;
  assert_ok(sv_exposures_init(&pool, &cfg, &a, &err), &err);
  const sv_frame frame = {.width_px = W,
                          .height_px = H,
                          .stride_bytes = 3 * W,
                          .format = SV_PIX_RGB8,
                          .data = frame_px,
                          .data_bytes = sizeof frame_px};
  const sv_exposure exposure = {.rig_from_world = sv_pose_identity()};
  const sv_pool serial = sv_pool_serial();
  memset(&kernels, 0, sizeof kernels);
  kernels.correct = sv_correct_ref;
  kernels.area = sv_area_ref;
  assert_ok(sv_exposures_add(&pool, &exposure, &frame, &kernels, &serial, &err), &err);
  sv_image_u8 image;
  sv_view view;
  sv_exposures_get(&pool, 0, 0, &image, &view);
  int off = 0;
  for (int y = 0; y < image.height_px; y++)
    for (int x = 0; x < image.width_px; x++) {
      double in[3];
      reference(step * x, step * y, in);
      for (int k = 0; k < 3; k++) {
        const int must = (int)(255 * display_of(in[k]) + 0.5),
                  is = image.px[y * image.stride_bytes + 3 * x + k];
        off = abs(is - must) > off ? abs(is - must) : off;
      }
    }
  return off;
}

TEST(test_pictures_are_corrected) {
  sv_sub_view v = lens(W, H);
  shoot(&v);
  const int corrected = off_of(&v, 1);
  v.photometric.is_known = false;
  const int as_it_is = off_of(&v, 1);
  print_message("off by %d of 255, without calibration by %d\n", corrected, as_it_is);
  assert_true(corrected <= 2 && as_it_is > 30);
}

// The falloff's radius is in focal lengths: it holds for images that were made smaller.
TEST(test_reduced_pictures) {
  sv_sub_view v = lens(W, H);
  sv_image_map map;
  sv_err err;
  shoot(&v);
  assert_ok(sv_sub_view_reduce(&v, &(sv_reduction){.k = 2}, &map, &err), &err);
  assert_true(off_of(&v, 2) <= 4);
}

// Two cameras with lock=shared: the second one has another exposure time, as it is more sensitive.
TEST(test_exposure_times_that_differ) {
  static sv_exposures pool;
  sv_sub_view views[2] = {lens(W, H), lens(W, H)};
  const sv_rig rig = {.sub_views = views, .n_sub_views = 2, .cap_sub_views = 2};
  sv_camera_caps caps[2];
  sv_image_u8 image[2];
  sv_view view;
  sv_err err;
  views[0].photometric = sv_photometry_none(&views[0].model);
  views[1].i_camera = 1;
  assert_true(fabs(sv_photometry_response(&views[1].photometric) - 1.32) < 1e-9);
  for (int is_shared = 0; is_shared < 2; is_shared++) {
    for (int i = 0; i < 2; i++)
      caps[i] = (sv_camera_caps){.width_px = W,
                                 .height_px = H,
                                 .format = SV_PIX_RGB8,
                                 .frame_bytes = sizeof frame_px,
                                 .is_light_shared = is_shared};
    const sv_exposures_cfg cfg = {
        .rig = &rig, .cap_exposures = 2, .caps = caps, .n_cameras = 2, .n_threads = 1};
    sv_kernels kernels;
    sv_arena a = sv_arena_make(block, sizeof block);
    assert_ok(sv_exposures_init(&pool, &cfg, &a, &err), &err);
    shoot(&views[1]);
    sv_frame frame[2];
    for (int i = 0; i < 2; i++)
      frame[i] = (sv_frame){.i_camera = i,
                            .width_px = W,
                            .height_px = H,
                            .stride_bytes = 3 * W,
                            .format = SV_PIX_RGB8,
                            .data = frame_px,
                            .data_bytes = sizeof frame_px,
                            .exposure_ns = 10000000};
    const sv_exposure exposure = {.rig_from_world = sv_pose_identity()};
    const sv_pool serial = sv_pool_serial();
    memset(&kernels, 0, sizeof kernels);
    kernels.correct = sv_correct_ref;
    // The same values at half of the time are of twice the light.
    for (int i = 0; i < 2; i++) {
      frame[1].exposure_ns = i ? 5000000 : 10000000;
      assert_ok(sv_exposures_add(&pool, &exposure, frame, &kernels, &serial, &err), &err);
    }
    for (int i = 0; i < 2; i++) sv_exposures_get(&pool, i, 1, &image[i], &view);
    double off = 0;
    for (int i = 0; i < 3 * W * H; i++) {
      const double light = linear_of(image[0].px[i] / 255.0) * (is_shared ? 2 : 1);
      off = fmax(off, fabs(image[1].px[i] - 255 * display_of(light)));
    }
    print_message("off by %.1f of 255\n", off);
    assert_true(off < (is_shared ? 4 : 0.6));
  }
}

TEST(test_identity_changes_nothing) {
  sv_sub_view v = lens(W, H);
  v.photometric = sv_photometry_none(&v.model);
  assert_false(sv_correction_is_needed(&v.photometric));
}

static sv_status read(void *self, const char *name, void *buf, size_t cap, size_t *bytes, sv_err *err) {
  static const char model[] =
      "{'lensmodel': 'LENSMODEL_PINHOLE', 'intrinsics': [60, 60, 30, 25], 'imagersize': [64, 48], "
      "'extrinsics': [0, 0, 0, 0, 0, 0]}";
  const char *text = strcmp(name, "rig.json") == 0 ? self : model;
  (void)err;
  *bytes = strlen(text);
  assert_true(*bytes <= cap);
  memcpy(buf, text, *bytes);
  return SV_OK;
}

static sv_status read_rig(const char *text, sv_rig *rig, sv_err *err) {
  static sv_sub_view views[1];
  static _Alignas(64) uint8_t scratch_block[1 << 16];
  sv_arena scratch = sv_arena_make(scratch_block, sizeof scratch_block);
  const sv_file_reader files = {(void *)(uintptr_t)text, read};
  *rig = (sv_rig){.sub_views = views, .cap_sub_views = 1};
  return sv_rig_read(rig, &files, 1, &scratch, err);
}

#define RIG(forward, photometric)                                                                            \
  "{\"version\":1,\"name\":\"r\",\"forward\":\"" forward                                                     \
  "\",\"sub_views\":[{\"name\":\"a\",\"model\":\"a\","                                                       \
  "\"camera\":0" photometric "}]}"
#define GOOD "\"color\":[0.9,0.05,0,0.02,1.2,0.1,0,0.1,1.5],\"corner\":0.6"

TEST(test_rig_file) {
  sv_rig rig, back;
  sv_err err;
  char buf[1024];
  assert_ok(read_rig(RIG("direct", ",\"photometric\":{" GOOD ",\"falloff\":[-0.3,-0.1,0.02],\"color_sigma\":"
                                   "[0.001,0.002,0.003],\"falloff_sigma\":0.004}"),
                     &rig, &err),
            &err);
  const sv_photometry p = rig.sub_views[0].photometric;
  assert_true(p.is_known && p.falloff[2] == 0.02 && p.color_sigma[1] == 0.002 && p.falloff_sigma == 0.004);
  assert_memory_equal(p.color, color, sizeof color);
  sv_str s = sv_str_make(buf, sizeof buf);
  assert_int_equal(sv_rig_json_write(&s, &rig), SV_OK);
  assert_ok(read_rig(buf, &back, &err), &err);
  assert_memory_equal(&p, &back.sub_views[0].photometric, sizeof p);
  assert_ok(read_rig(RIG("direct", ""), &rig, &err), &err);
  assert_false(rig.sub_views[0].photometric.is_known);
  static const struct {
    const char *text, *word;
  } bad[] = {{RIG("direct", ",\"photometric\":7"), "is an object"},
             {RIG("direct", ",\"photometric\":{\"corner\":1}"), "\"color\" is missing"},
             {RIG("direct", ",\"photometric\":{\"color\":[1,0,0,0,1,0,0,0,1]}"), "\"corner\" is missing"},
             {RIG("direct", ",\"photometric\":{\"color\":[1,0],\"corner\":1}"), "color"},
             {RIG("direct", ",\"photometric\":{\"color\":[1,0,0,1,0,0,0,0,1],\"corner\":1}"), "inverse"},
             {RIG("direct", ",\"photometric\":{\"color\":[1,0,0,0,1,0,0,0,0.01],\"corner\":1}"), "inverse"},
             {RIG("direct", ",\"photometric\":{" GOOD ",\"falloff\":[-1,0,0]}"), "falloff"},
             {RIG("direct", ",\"photometric\":{\"color\":[1,0,0,0,1,0,0,0,1],\"corner\":0}"), "corner"},
             {RIG("multiplexed", ",\"photometric\":{" GOOD "}"), "shares its pixels"}};
  for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
    if (read_rig(bad[i].text, &rig, &err) >= 0) fail_msg("%s is taken", bad[i].text);
    assert_contains(err.text, bad[i].word);
  }
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_pictures_are_corrected), cmocka_unit_test(test_reduced_pictures),
      cmocka_unit_test(test_exposure_times_that_differ), cmocka_unit_test(test_identity_changes_nothing),
      cmocka_unit_test(test_rig_file)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
