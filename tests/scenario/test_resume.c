// SPDX-License-Identifier: Apache-2.0
// What a run that goes on asks of its checkpoint: made by this run, not by one of another scene or
// another seed.
#include <string.h>

#include "tests/common/test.h"
#include "tests/common/world.h"

#define SPEC "textured,rig=stereo,size=64x48"

static world w;

// The scene is that of SPEC whatever the run is told that its source is called.
static sv_status run_as(const char *source, uint64_t seed, bool is_resume) {
  world_open_well(&w, SPEC, 2, ~0u, 2);
  w.cfg.train.n_gaussians = 100;
  w.cfg.train.seed = seed;
  w.cfg.steps = 3;
  w.cfg.source_name = source;
  w.cfg.is_resume = is_resume;
  sv_status s = world_run(&w);
  world_close(&w);
  return s;
}

// Of the same sizes, and still another run: nothing of it may come into what is there.
TEST(test_resume_refuses_another_run) {
  static const struct {
    const char *source, *says; // says: NULL: goes on
    uint64_t seed;
  } runs[] = {{SPEC, NULL, 1},
              {SPEC ",speed=max", NULL, 1},
              {"thin,rig=stereo,size=64x48", "another source", 1},
              {SPEC, "--seed 1", 2}};
  for (size_t i = 0; i < sizeof runs / sizeof *runs; i++) {
    world_forget_files(&w);
    assert_int_equal(run_as(SPEC, 1, false), SV_OK);
    sv_status s = run_as(runs[i].source, runs[i].seed, true);
    if (s != (runs[i].says ? SV_E_RANGE : SV_OK)) fail_msg("%s: %d: %s", runs[i].source, s, w.err.text);
    assert_true(world_has_line(&w, "resumed at step 3") == !runs[i].says);
    if (!runs[i].says) continue;
    assert_one_sentence(w.err.text);
    assert_contains(w.err.text, runs[i].says);
  }
}

TEST(test_origin) {
  uint64_t a = sv_app_origin("replay:out/capture");
  assert_true(a == sv_app_origin("replay:out/capture/"));
  assert_true(a == sv_app_origin("replay:out/capture,speed=max"));
  assert_true(a != sv_app_origin("replay:out/capture,from=1") && a != sv_app_origin("replay:out/capture2"));
  assert_true(sv_app_origin("v4l2:a,b") != sv_app_origin("v4l2:ab") && a != sv_app_origin(NULL));
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_resume_refuses_another_run),
                                     cmocka_unit_test(test_origin)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
