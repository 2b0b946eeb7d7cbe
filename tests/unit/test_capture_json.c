// SPDX-License-Identifier: Apache-2.0
// capture.json that is wrong in every way. Run from the repository's root.
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "platform/replay/capture.h"
#include "src/base/rng.h"
#include "tests/common/test.h"

#define TINY "tests/data/capture_tiny"
static _Alignas(64) uint8_t g_block[4 << 20];

static sv_status parse(const char *text, sv_capture *c, sv_err *err) {
  static char copy[65536];
  size_t n = strlen(text);
  memcpy(copy, text, n + 1);
  sv_arena a = sv_arena_make(g_block, sizeof g_block);
  return sv_capture_parse(c, copy, n, "x.json", &a, err);
}

#define CAM(frames)                                                                                          \
  "{\"version\":1,\"cameras\":[{\"name\":\"a\",\"folder\":\"a\",\"width\":4,\"height\":3,\"frames\":"        \
  "[" frames "]}]}"

TEST(wrong_json_gets_a_sentence) {
  sv_capture c;
  sv_err err;
  assert_int_equal(
      parse(CAM("{\"file\":\"a.jpg\",\"camera_ns\":5,\"more\":{\"x\":[1,{\"y\":2}]}}"), &c, &err), SV_OK);
  assert_true(c.n_frames == 1 && c.cameras[0].frames[0].arrival_ns == 5 &&
              c.cameras[0].caps.clock == SV_CLOCK_MONOTONIC);
  assert_int_equal(parse(CAM(""), &c, &err), SV_OK);
  static const char *const bad[] = {
      "",
      "[]",
      "{",
      "{}",
      "null",
      "{\"version\":2,\"cameras\":[]}",
      "{\"version\":1,\"cameras\":[]}",
      "{\"version\":1,\"cameras\":[1,2,3,4,5]}",
      "{\"version\":1,\"cameras\":[{}]}",
      "{\"version\":1,\"cameras\":[",
      CAM("1"),
      CAM("{}"),
      CAM("{\"file\":\"a\"}"),
      CAM("{\"file\":\"../a\",\"camera_ns\":1}"),
      CAM("{\"file\":\"/a\",\"camera_ns\":1}"),
      CAM("{\"file\":\"a\",\"camera_ns\":1.5}"),
      CAM("{\"file\":\"a\",\"camera_ns\":99999999999999999999}"),
      CAM("{\"file\":\"a\",\"camera_ns\":\"1\"}"),
      CAM("{\"file\":\"a\",\"camera_ns\":2},{\"file\":\"b\",\"camera_ns\":1}"),
      CAM("{\"file\":\"a\\u0041\",\"camera_ns\":2}"),
      CAM("{\"file\":\"a\",\"camera_ns\":1,\"sequence\":-1}"),
      "{\"version\":1,\"rig\":\"/"
      "etc\",\"cameras\":[{\"name\":\"a\",\"folder\":\"a\",\"width\":4,\"height\":3,\"frames\":[]}]}",
      "{\"version\":1,\"poses\":[{\"time_ns\":1,\"rig_from_world\":[0,0,0,0,0,0,0]}],"
      "\"cameras\":[{\"name\":\"a\",\"folder\":\"a\",\"width\":4,\"height\":3,\"frames\":[]}]}",
      "{\"version\":1,\"cameras\":[{\"name\":\"a\",\"folder\":\"a\",\"width\":4,\"height\":3,\"bits\":12,"
      "\"frames\":[]}]}",
      "{\"version\":1,\"cameras\":[{\"name\":\"a\",\"folder\":\"a\",\"width\":4,\"height\":3,\"sensor\":[4,3]"
      ","
      "\"frames\":[]}]}",
      "{\"version\":1,\"cameras\":[{\"name\":\"a\",\"folder\":\"a\",\"width\":4,\"height\":3,\"sensor\":[4,3]"
      ","
      "\"area\":[1,0,4,3],\"frames\":[]}]}",
      "{\"version\":1,\"cameras\":[{\"name\":\"a\",\"folder\":\"a\",\"width\":0,\"height\":3,\"frames\":[]}]"
      "}",
      "[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]]"};
  for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
    err.text[0] = 0;
    assert_int_equal(parse(bad[i], &c, &err), SV_E_FORMAT);
    assert_contains(err.text, "x.json");
  }
}

// Within the bounds of src/rig/limits.inc.
TEST(garbage_gets_its_reason) {
#define SCENE(min, max)                                                                                      \
  "{\"version\":1,\"scene\":{\"min_m\":" min ",\"max_m\":" max "},\"cameras\":[" ONE "]}"
#define POSES(x)                                                                                             \
  "{\"version\":1,\"poses\":[{\"time_ns\":1,\"rig_from_world\":[1,0,0,0," x ",0,0]}],\"cameras\":[" ONE "]}"
#define ONE "{\"name\":\"a\",\"folder\":\"a\",\"width\":4,\"height\":3,\"frames\":[]}"
  static const struct {
    const char *text, *word;
  } bad[] = {
      {SCENE("[-1e300,-1e300,-1e300]", "[1e300,1e300,1e300]"), "the scene's radius"},
      {SCENE("[0,0,0]", "[0,0,0]"), "the scene's radius is 0 m; expected 0.0001 to 100000"},
      {SCENE("[7000000,0,0]", "[7000001,1,1]"), "subtract an origin near the scene"},
      {POSES("1e300"), "a camera's position"},
  };
  sv_capture c;
  sv_err err;
  assert_ok(parse(SCENE("[-1,-1,-1]", "[1,1,1]"), &c, &err), &err);
  assert_ok(parse(POSES("900000"), &c, &err), &err);
  for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
    sv_status s = parse(bad[i].text, &c, &err);
    assert_error(s, SV_E_RANGE, &err, bad[i].word);
  }
}

TEST(mutated_json_never_harms) {
  static char good[8192], text[8192];
  FILE *f = fopen(TINY "/capture.json", "rb");
  assert_non_null(f);
  size_t n = fread(good, 1, sizeof good - 1, f);
  fclose(f);
  sv_rng r = sv_rng_make(3, 3);
  static const char chars[] = "{}[],:\"0-9e.\\x \n";
  int n_ok = 0;
  for (int i = 0; i < 30000; i++) {
    memcpy(text, good, n);
    size_t m = sv_rng_below(&r, 4) ? n : sv_rng_below(&r, (uint32_t)n);
    for (int k = 0; k <= i % 5; k++)
      text[sv_rng_below(&r, (uint32_t)n)] = chars[sv_rng_below(&r, sizeof chars - 1)];
    char *exact = malloc(m + 1); // as long as the loader makes it, so that ASan sees the end
    memcpy(exact, text, m);
    exact[m] = 0;
    sv_capture c;
    sv_err err;
    sv_arena a = sv_arena_make(g_block, sizeof g_block);
    sv_status s = sv_capture_parse(&c, exact, m, "x", &a, &err);
    assert_true(s == SV_OK || s == SV_E_FORMAT || s == SV_E_RANGE);
    n_ok += s == SV_OK;
    free(exact);
  }
  assert_true(n_ok > 100); // most digits may change
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(wrong_json_gets_a_sentence),
      cmocka_unit_test(garbage_gets_its_reason),
      cmocka_unit_test(mutated_json_never_harms),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
