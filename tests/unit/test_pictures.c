// SPDX-License-Identifier: Apache-2.0
// Up in the world, as pictures and the page take it.
#include "src/base/vec.h"
#include "src/preview/pictures.h"
#include "tests/common/test.h"

static sv_trainer trainer;
static sv_train_view views[2];

// Cameras in a world whose up is z, beside the origin, that look down by 30 degrees.
TEST(test_up_of_cameras_that_look_down) {
  const double eyes[2][3] = {{-1.732, 0, 1}, {-1.5, 0.866, 1}}, target[3] = {0}, z[3] = {0, 0, 1};
  float up[3];
  trainer.views = views;
  trainer.n_views = 2;
  for (int i = 0; i < 2; i++) {
    sv_pose p;
    assert_true(sv_pose_look_at(&p, eyes[i], target, z));
    views[i].view = sv_view_make(64, 48, (const double[]){50, 50, 32, 24}, &p);
  }
  sv_pictures_up(&trainer, up);
  assert_true(up[0] == 0 && up[1] == 0 && up[2] == 1);
}

TEST(test_up_without_cameras) {
  float up[3];
  trainer.n_views = 0;
  sv_pictures_up(&trainer, up);
  assert_true(up[0] == 0 && up[1] == -1 && up[2] == 0);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_up_of_cameras_that_look_down),
                                     cmocka_unit_test(test_up_without_cameras)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
