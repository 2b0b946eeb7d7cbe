// SPDX-License-Identifier: Apache-2.0
// The lab's choice of frames, the views near them, and the noise on what was loaded.
#include <string.h>

#include "src/base/mathx.h"
#include "tests/common/test.h"
#include "tools/train/noise.h"

#define N 60
static sv_transforms_frame frames[N];

// Cameras at azimuth 6 i degrees, alternating between two elevations, that look at (1, 2, 3); z is
// up.
static void place(double low_deg, double high_deg) {
  static const double at[3] = {1, 2, 3}, up[3] = {0, 0, 1};
  memset(frames, 0, sizeof frames);
  for (int i = 0; i < N; i++) {
    double az = 6 * i * SV_PI / 180, el = (i & 1 ? high_deg : low_deg) * SV_PI / 180;
    double eye[3] = {1 + 4 * sv_cos(el) * sv_cos(az), 2 + 4 * sv_cos(el) * sv_sin(az), 3 + 4 * sv_sin(el)};
    assert_true(sv_pose_look_at(&frames[i].cam_from_world, eye, at, up));
    frames[i].exposure = frames[i].sub_view = -1;
  }
}

static int members(const bool *is_in, int out[N]) {
  int n = 0;
  for (int i = 0; i < N; i++)
    if (is_in[i]) out[n++] = i;
  return n;
}

static void choose(int n, int out[N]) {
  bool is_in[N];
  sv_err err = {0};
  for (int i = 0; i < N; i++) is_in[i] = i != 0; // frame 0 is held out
  assert_ok(lab_disperse_frames(frames, N, n, is_in, &err), &err);
  assert_int_equal(members(is_in, out), n < N - 1 ? n : N - 1);
  assert_false(is_in[0]);
}

TEST(test_choice) {
  int c[N];
  place(5, 35);
  choose(3, c); // three low ones, a third of a turn apart
  assert_int_equal(c[0] % 2, 0);
  assert_int_equal(c[1] - c[0], 20);
  assert_int_equal(c[2] - c[1], 20);
  int one[N];
  choose(1, one);
  assert_true(one[0] == c[0] || one[0] == c[1] || one[0] == c[2]);
  choose(2, c);
  assert_int_equal(c[1] - c[0], 30);
  choose(N - 1, c);
  choose(N + 5, c); // more than there are: all
}

TEST(test_near) {
  bool is_in[N] = {false};
  int c[N];
  double centre[3];
  place(5, 5);
  is_in[10] = is_in[12] = true;
  lab_mean_centre(frames, N, is_in, centre); // a little inside of camera 11
  for (int i = 0; i < N; i++) is_in[i] = i != 12;
  lab_keep_nearest(frames, N, centre, LAB_N_NEAR, is_in);
  assert_int_equal(members(is_in, c), 6);
  static const int want[6] = {8, 9, 10, 11, 13, 14};
  assert_memory_equal(c, want, sizeof want);
  lab_keep_nearest(frames, N, centre, 10, is_in); // fewer than asked for: all
  assert_int_equal(members(is_in, c), 6);
}

static void run_tasks(void *self, sv_task_fn fn, void *arg, int n_tasks) { // last task first
  (void)self;
  for (int i = n_tasks; i-- > 0;) fn(arg, i, 0);
}

TEST(test_noise) {
  static lab_frame f[3];
  static uint8_t px[3][4 * 64], clean[4 * 64];
  static uint16_t measured[3 * 64];
  static lab_measurement m = {.width_px = 8, .height_px = 8, .n_lenses = 1};
  uint8_t *pictures[3] = {px[0], px[1], px[2]};
  uint16_t *measurements[1] = {measured};
  lab_plan p = {.pictures = pictures, .measurements = measurements};
  lab_views v = {.frames = f, .n = 3, .measurements = &m, .n_measurements = 1};
  sv_pool pool = {.run = run_tasks, .n_threads = 1};
  sv_noise_model model = {1e-3f, 1e-2f};
  sv_err err = {0};
  memset(clean, 128, sizeof clean);
  memset(px, 128, sizeof px);
  for (int i = 0; i < 3 * 64; i++) measured[i] = 40000;
  for (int i = 0; i < 3; i++) {
    f[i].n_channels = 3;
    f[i].view.width_px = f[i].view.height_px = 8;
    f[i].i_measurement = i == 2 ? 0 : -1;
    f[i].f.exposure = 0;
    f[i].f.sub_view = i;
  }
  assert_int_equal(
      lab_noise_add(&v, &p, &model, &(sv_train_cfg){.seed = 1, .background = SV_BG_WHITE}, &pool, &err),
      SV_OK);
  assert_memory_not_equal(px[0], clean, 3 * 64);
  assert_memory_not_equal(px[0], px[1], 3 * 64); // each sub-view has its own
  assert_memory_equal(px[2], clean, 3 * 64);     // a lens has no picture: its measurement is noisy
  assert_true(measured[0] != 40000 || measured[1] != 40000);
  uint8_t first[3 * 64];
  memcpy(first, px[0], sizeof first);
  memset(px, 128, sizeof px);
  f[1].n_channels = 4;
  assert_int_equal(
      lab_noise_add(&v, &p, &model, &(sv_train_cfg){.seed = 1, .background = SV_BG_WHITE}, &pool, &err),
      SV_E_ARG);
  assert_int_equal(
      lab_noise_add(&v, &p, &model, &(sv_train_cfg){.seed = 1, .background = SV_BG_BLACK}, &pool, &err),
      SV_OK);
  assert_memory_equal(px[0], first, sizeof first); // the same again
  assert_int_equal(px[1][3], 255);
  memset(px, 128, sizeof px);
  assert_int_equal(
      lab_noise_add(&v, &p, &model, &(sv_train_cfg){.seed = 2, .background = SV_BG_BLACK}, &pool, &err),
      SV_OK);
  assert_memory_not_equal(px[0], first, sizeof first);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_choice), cmocka_unit_test(test_near),
                                     cmocka_unit_test(test_noise)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
