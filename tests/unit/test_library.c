// SPDX-License-Identifier: Apache-2.0
// The public API of include/subview: sizes, errors, exposures that come after the start, threads,
// files.
#include <stdlib.h>
#include <string.h>

#include "include/subview/subview.h"
#include "tests/common/test.h"

enum { W = 64, H = 48, CAP_CAMERAS = 5 };

static subview_camera rig[CAP_CAMERAS];
static uint8_t pixels[CAP_CAMERAS][H][W][3];
static subview_error err;

static subview_config config_of(int n_cameras, int n_exposures) {
  subview_config c = subview_defaults();
  for (int i = 0; i < n_cameras; i++) {
    rig[i] = subview_camera_defaults(W, H);
    rig[i].cam_from_rig.t[0] = -0.1 * i;
  }
  c.cameras = rig;
  c.n_cameras = n_cameras;
  c.n_exposures = n_exposures;
  c.n_gaussians = 300;
  c.n_steps = 20;
  return c;
}

static int wave(int x, int period) { return abs(x % period * 2 - period) * 64 / period; } // 0..64

// A wall of crossed waves; a camera 0.1 m to the right sees it 3 px to the left.
static void draw(int i_camera, int position) {
  for (int y = 0; y < H; y++)
    for (int x = 0; x < W; x++)
      for (int k = 0; k < 3; k++) {
        const int u = x + 3 * position;
        pixels[i_camera][y][x][k] =
            (uint8_t)(20 + wave(u, 17) + wave(u + y, 23 + 4 * k) + wave(y, 13) + wave(u, 90));
      }
}

static void push(subview *s, int n_cameras, int place) {
  subview_frame frames[CAP_CAMERAS];
  subview_pose pose = subview_pose_identity();
  pose.t[0] = -0.1 * place;
  memset(frames, 0, sizeof frames);
  for (int i = 0; i < n_cameras; i++) {
    draw(i, place + i);
    frames[i].data = &pixels[i][0][0][0];
  }
  if (subview_push_exposure(s, frames, &pose, &err) != SUBVIEW_OK) fail_msg("%s", err.text);
}

// Tasks backwards, as if by several threads.
static void run_backwards(void *self, subview_task task, void *arg, int n_tasks) {
  const int n_threads = *(const int *)self;
  for (int i = n_tasks; i-- > 0;) task(arg, i, i % n_threads);
}

static uint64_t run(subview_config c, unsigned char *block, size_t bytes, int n_pushed) {
  subview *s;
  if (subview_init(&s, &c, block, bytes, &err) != SUBVIEW_OK) fail_msg("%s", err.text);
  for (int e = 0; e < n_pushed; e++) push(s, c.n_cameras, e);
  assert_int_equal(subview_start(s, &err), SUBVIEW_OK);
  while (subview_step(s, NULL, &err) == SUBVIEW_OK) {
  }
  return subview_digest(s);
}

// subview_bytes is enough, wherever the block begins; a little less than half of it is not.
TEST(test_bytes) {
  static const subview_lens lenses[] = {SUBVIEW_LENS_PINHOLE, SUBVIEW_LENS_OPENCV8, SUBVIEW_LENS_FISHEYE};
  for (int n = 1; n <= CAP_CAMERAS; n++)
    for (int kind = 0; kind < 3; kind++) {
      subview *s;
      size_t bytes, used = 0;
      subview_part part;
      subview_config c = config_of(n, 2);
      for (int i = 0; i < n; i++) {
        rig[i].lens = lenses[kind];
        rig[i].p[4] = kind ? 0.01 : 0.0;
        rig[i].pixels = (subview_pixels)((kind * 3 + i) % (SUBVIEW_PIXELS_NV12 + 1));
      }
      assert_int_equal(subview_bytes(&c, &bytes, &err), SUBVIEW_OK);
      unsigned char *block = malloc(bytes + 13);
      assert_non_null(block);
      if (subview_init(&s, &c, block + 13, bytes, &err) != SUBVIEW_OK) fail_msg("%s", err.text);
      for (int i = 0; subview_memory_part(s, i, &part) == SUBVIEW_OK; i++) used += part.bytes;
      assert_true(used <= bytes);
      assert_true(used > bytes - bytes / 10);
      assert_int_equal(subview_init(&s, &c, block, bytes / 2, &err), SUBVIEW_E_NOMEM);
      assert_null(s);
      assert_non_null(strstr(err.text, "expected at least"));
      free(block);
    }
}

TEST(test_errors) {
  static _Alignas(SUBVIEW_ALIGN) unsigned char block[8 << 20];
  subview *s;
  size_t bytes;
  uint8_t rgb[3];
  double psnr;
  subview_view view;
  subview_config c = config_of(2, 1);
  c.n_gaussians = 0;
  assert_int_equal(subview_bytes(&c, &bytes, &err), SUBVIEW_E_ARG);
  assert_int_equal(err.status, SUBVIEW_E_ARG);
  c = config_of(2, 1);
  rig[1].cam_from_rig.r[0] = 2;
  assert_int_equal(subview_bytes(&c, &bytes, NULL), SUBVIEW_E_ARG);
  c = config_of(2, 1);
  c.n_cameras = 0;
  assert_int_equal(subview_init(&s, &c, block, sizeof block, &err), SUBVIEW_E_ARG);
  c = config_of(2, 1);
  assert_int_equal(subview_init(&s, &c, block, sizeof block, &err), SUBVIEW_OK);
  assert_int_equal(subview_start(s, &err), SUBVIEW_E_NOT_FOUND);
  assert_int_equal(subview_step(s, NULL, &err), SUBVIEW_E_ARG);
  assert_int_equal(subview_psnr(s, &psnr, &err), SUBVIEW_E_ARG);
  assert_int_equal(subview_view_of(s, 0, 0, &view), SUBVIEW_E_RANGE);
  const subview_frame none[2] = {{0}};
  assert_int_equal(subview_push_exposure(s, none, NULL, &err), SUBVIEW_E_ARG);
  push(s, 2, 0);
  assert_int_equal(subview_start(s, &err), SUBVIEW_OK);
  assert_int_equal(subview_start(s, &err), SUBVIEW_E_ARG);
  assert_int_equal(subview_view_of(s, 0, 1, &view), SUBVIEW_OK);
  view.width_px = 4 * W;
  assert_int_equal(subview_render(s, &view, rgb, 0, &err), SUBVIEW_E_RANGE);
  assert_string_equal(subview_version(), SUBVIEW_VERSION);
}

// Any number of threads gives the same bits, and so does a block that was used before.
TEST(test_same_bits) {
  static _Alignas(SUBVIEW_ALIGN) unsigned char block[16 << 20];
  int n_threads = 3;
  subview_config c = config_of(2, 2);
  const uint64_t digest = run(c, block, sizeof block, 2);
  memset(block, 0xa5, sizeof block);
  assert_true(run(c, block, sizeof block, 2) == digest);
  c.pool = (subview_pool){&n_threads, n_threads, run_backwards};
  assert_true(run(c, block, sizeof block, 2) == digest);
}

// Exposures may come while training goes on; a full instance forgets its oldest one.
TEST(test_exposures_after_start) {
  static _Alignas(SUBVIEW_ALIGN) unsigned char block[8 << 20];
  static uint8_t rgb[H][W][3];
  subview *s;
  double first, last;
  subview_view view;
  subview_step_stats stats;
  subview_config c = config_of(2, 3);
  c.n_steps = 200;
  assert_int_equal(subview_init(&s, &c, block, sizeof block, &err), SUBVIEW_OK);
  push(s, 2, 0);
  assert_int_equal(subview_start(s, &err), SUBVIEW_OK);
  assert_int_equal(subview_psnr(s, &first, &err), SUBVIEW_OK);
  for (int i = 0; i < 200; i++) {
    if (i % 10 == 0 && i < 60) push(s, 2, i / 10 + 1);
    assert_int_equal(subview_step_at(s, (float)i / 200.0f, &stats, &err), SUBVIEW_OK);
    assert_true(stats.step == (uint32_t)i + 1);
    assert_true(stats.i_exposure >= 0 && stats.i_exposure < subview_n_exposures(s));
  }
  assert_int_equal(subview_n_exposures(s), 3);
  assert_int_equal(subview_view_of(s, 0, 0, &view), SUBVIEW_OK);
  assert_true(view.cam_from_world.t[0] < -0.35); // the first place was 0
  assert_int_equal(subview_psnr(s, &last, &err), SUBVIEW_OK);
  print_message("psnr %.2f, then %.2f dB\n", first, last);
  assert_true(last > first);
  assert_int_equal(subview_render(s, &view, &rgb[0][0][0], 0, &err), SUBVIEW_OK);
}

typedef struct {
  size_t n_bytes, fails_at;
  char head[4];
} sink_state;

static subview_status sink_write(void *self, const void *data, size_t bytes) {
  sink_state *k = self;
  assert_true(bytes > 0 && bytes <= 4096);
  if (k->n_bytes == 0) memcpy(k->head, data, 3);
  k->n_bytes += bytes;
  return k->fails_at && k->n_bytes >= k->fails_at ? SUBVIEW_E_IO : SUBVIEW_OK;
}

TEST(test_files) {
  static _Alignas(SUBVIEW_ALIGN) unsigned char block[8 << 20];
  subview *s;
  subview_gaussian g;
  subview_config c = config_of(2, 1);
  assert_int_equal(subview_init(&s, &c, block, sizeof block, &err), SUBVIEW_OK);
  push(s, 2, 0);
  assert_int_equal(subview_start(s, &err), SUBVIEW_OK);
  sink_state k = {0};
  assert_int_equal(subview_save(s, SUBVIEW_FILE_PLY, (subview_sink){&k, sink_write}, &err), SUBVIEW_OK);
  assert_string_equal(k.head, "ply");
  k = (sink_state){0};
  assert_int_equal(subview_save(s, SUBVIEW_FILE_SPLAT, (subview_sink){&k, sink_write}, &err), SUBVIEW_OK);
  assert_int_equal(k.n_bytes, 32 * 300);
  k = (sink_state){.fails_at = 5000};
  assert_int_equal(subview_save(s, SUBVIEW_FILE_PLY, (subview_sink){&k, sink_write}, &err), SUBVIEW_E_IO);
  assert_int_equal(subview_n_gaussians(s), 300);
  assert_int_equal(subview_get_gaussian(s, 299, &g), SUBVIEW_OK);
  assert_int_equal(subview_get_gaussian(s, 300, &g), SUBVIEW_E_RANGE);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_bytes),     cmocka_unit_test(test_errors),
      cmocka_unit_test(test_same_bits), cmocka_unit_test(test_exposures_after_start),
      cmocka_unit_test(test_files),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
