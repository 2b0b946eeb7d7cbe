// SPDX-License-Identifier: Apache-2.0
// Co-visibility by flow between pictures, all that real recordings have, against co-visibility by
// true depth, on the pixels of a rendered scene that show a surface.
#include <stdlib.h>

#include "tests/common/test.h"
#include "tools/train/masks.h"

typedef struct {
  double right, found; // shares: of what flow calls seen, of what is seen
} agreement;

static lab_session se;

FIXTURE(setup) {
  sv_err err = {0};
  return lab_session_start(&se, 2, true, &err) < 0 ? -1 : 0;
}

FIXTURE(teardown) {
  lab_session_stop(&se);
  return 0;
}

typedef struct {
  uint8_t *picture, *mask[2]; // [height][width] of the largest view; by flow, by depth
  float *depth;
} buffers;

static void make_masks(lab_views *v, const lab_source *train, int i, const buffers *b) {
  const float white[3] = {1, 1, 1};
  const lab_frame *f = &v->frames[i];
  lab_loader loader = {.map = {0}};
  sv_err err = {0};
  assert_ok(lab_picture_load(&loader, f, v->scale, b->picture, &err), &err);
  assert_ok(lab_depth_load(&loader, f, v->scale, b->depth, &err), &err);
  lab_loader_free(&loader);
  for (int by_depth = 0; by_depth < 2; by_depth++) {
    const lab_masked_view view = {f, b->picture, by_depth ? b->depth : NULL};
    lab_masks *m = NULL;
    v->has_depth = by_depth;
    assert_ok(lab_masks_open(&m, &se, v, train, white, &err), &err);
    assert_string_equal(lab_masks_method(m), by_depth ? "depth" : "flow");
    assert_ok(lab_masks_make(m, &view, b->mask[by_depth], &err), &err);
    lab_masks_close(m);
  }
}

static agreement compare(const char *transforms) {
  const lab_source train = {
      .folder = "tests/data/kitchen", .transforms = transforms, .n_exposures = 1, .scale = 1};
  lab_source test = train;
  double seen = 0, told = 0, both = 0;
  lab_views v;
  sv_err err = {0};
  test.split = "test_near";
  assert_ok(lab_views_open(&v, &test, &se.pool, &err), &err);
  const size_t cap = (size_t)v.cap_width_px * (size_t)v.cap_height_px;
  const buffers b = {malloc(4 * cap), {malloc(cap), malloc(cap)}, malloc(cap * sizeof(float))};
  assert_true(b.picture && b.mask[0] && b.mask[1] && b.depth);
  for (int i = 0; i < v.n; i++) {
    const sv_view *view = &v.frames[i].view;
    make_masks(&v, &train, i, &b);
    for (size_t k = 0; k < (size_t)view->width_px * (size_t)view->height_px; k++) {
      if (!(b.depth[k] > 0)) continue;
      told += b.mask[0][k];
      seen += b.mask[1][k];
      both += b.mask[0][k] & b.mask[1][k];
    }
  }
  free(b.picture);
  free(b.mask[0]);
  free(b.mask[1]);
  free(b.depth);
  lab_views_free(&v);
  print_message("%s: flow finds %.3f of what is seen, and %.3f of what it finds is seen\n", transforms,
                both / seen, both / told);
  return (agreement){both / told, both / seen};
}

TEST(test_one_image) { // measured: 0.965, 0.733
  const agreement a = compare("transforms_train_mono_theta0.json");
  assert_true(a.right > 0.94 && a.found > 0.70);
}

TEST(test_two_images) { // that both have to see; measured: 0.957, 0.575
  const agreement a = compare("transforms_train_stereo_theta10.json");
  assert_true(a.right > 0.93 && a.found > 0.54);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_one_image), cmocka_unit_test(test_two_images)};
  return cmocka_run_group_tests(tests, setup, teardown);
}
