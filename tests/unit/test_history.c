// SPDX-License-Identifier: Apache-2.0
// The history of a live model: every frame reads as it was added, within half a step; the ring
// never grows, and old groups go; bytes add up.
#include <math.h>
#include <string.h>

#include "src/format/history.h"
#include "tests/common/test.h"
#include "tests/fuzz/blob.h"

#define N      150 // not a multiple of a block
#define PERIOD (100 * SV_NS_PER_MS)

static sv_err err;
static sv_history h;
static sv_arena arena;
static _Alignas(SV_ARENA_ALIGN) uint8_t block[1u << 20];
static uint8_t file[1u << 20];
static _Alignas(8) uint8_t workspace[1u << 18];

// A Gaussian's values at a frame; every seventh is another one in each frame, as one that was
// replaced.
static float value_of(uint32_t i, int row, int frame) {
  const float x = sinf(0.7f * (float)i + 1.3f * (float)row), t = 0.01f * (float)frame;
  if (i % 7 == 0) return sinf(0.7f * (float)i + 1.3f * (float)(row * (frame + 1)));
  return row < 3 ? x + t * t : row == 3 ? 1 : row < 7 ? 0.2f * x + t : x - t;
}
static float get(const void *self, uint32_t i, int row) { return value_of(i, row, *(const int *)self); }

static void begin(int cap_frames, sv_ns span_ns) {
  const sv_history_cfg cfg = {.n = N, .cap_frames = cap_frames, .span_ns = span_ns, .radius = 1};
  arena = sv_arena_make(block, sizeof block);
  sv_history_carve(&h, &cfg, &arena);
  assert_int_equal(arena.status, SV_OK);
}

static void add(int frame) {
  const size_t used = arena.used_bytes;
  assert_int_equal(sv_history_add(&h, frame * PERIOD, get, &frame), SV_OK);
  assert_int_equal(arena.used_bytes, used);
  assert_true(sv_history_used_bytes(&h) <= h.cap_bytes && h.n_frames <= h.cfg.cap_frames);
}

static size_t write_file(void) {
  const sv_sequence_head head = {.unit = {.is_metric = true}, .dilation_px2 = 0.3f, .up = "z"};
  blob b = {file, 0, sizeof file};
  assert_true(sv_history_state_bytes(&h.cfg) <= sizeof workspace);
  assert_ok(sv_history_write(&h, &head, workspace, (sv_sink){&b, blob_write}, &err), &err);
  assert_true(b.n <= sv_history_cap_file_bytes(&h.cfg));
  return b.n;
}

// Frame k of the file, which was added as `frame`.
static void check_frame(sv_sequence_reader *r, int k, int frame) {
  assert_ok(sv_sequence_read_frame(r, (uint32_t)k, &err), &err);
  for (uint32_t i = 0; i < N; i++) {
    sv_gaussian g;
    float q2 = 0, value[SV_SEQUENCE_N_MOVED];
    sv_sequence_get(r, i, &g);
    memcpy(value, &g, sizeof value);
    for (int row = 3; row < 7; row++) q2 += value_of(i, row, frame) * value_of(i, row, frame);
    for (int row = 0; row < SV_SEQUENCE_N_MOVED; row++) {
      const float was = value_of(i, row, frame) / (row >= 3 && row < 7 ? sqrtf(q2) : 1);
      assert_near((double)value[row], (double)was, 0.51 * (double)sv_sequence_step(&r->head, row));
    }
  }
}

static void open_file(sv_sequence_reader *r, size_t bytes) {
  assert_ok(sv_sequence_open(r, &(sv_file_data){"history", file, bytes}, &err), &err);
  assert_true(sv_sequence_reader_bytes(&r->head) <= sizeof workspace);
  assert_ok(sv_sequence_read_base(r, workspace, &err), &err);
  assert_int_equal(r->head.n_frames, h.n_frames);
  assert_int_equal(r->head.n_moving, N);
}

TEST(frames_read_as_they_were_added) {
  sv_sequence_reader r;
  begin(40, 0);
  for (int i = 0; i < 30; i++) add(i);
  assert_int_equal(h.n_frames, 30);
  open_file(&r, write_file());
  assert_near((double)r.head.seconds, 2.9, 1e-6);
  for (int k = 29; k >= 0; k -= 3) check_frame(&r, k, k); // in any order
  check_frame(&r, 1, 1);
}

// Hundreds of frames through a ring for a few: the newest ones are left, from a keyframe on.
TEST(old_groups_go) {
  sv_sequence_reader r;
  begin(40, 0);
  for (int i = 0; i < 500; i++) {
    add(i);
    assert_int_equal(sv_history_time_ns(&h, h.n_frames - 1), i * PERIOD);
  }
  assert_true(h.n_added == 500 && h.n_lost == 0 && h.n_frames >= 40 - 2 * SV_SEQUENCE_GROUP);
  open_file(&r, write_file());
  for (int k = 0; k < h.n_frames; k++) check_frame(&r, k, 500 - h.n_frames + k);
}

// Seconds are the limit where bytes are not.
TEST(no_older_than_asked) {
  begin(200, 3 * SV_NS_PER_S);
  for (int i = 0; i < 150; i++) add(i);
  const sv_ns kept = sv_history_time_ns(&h, h.n_frames - 1) - sv_history_time_ns(&h, 0);
  assert_true(kept >= 3 * SV_NS_PER_S && kept <= 3 * SV_NS_PER_S + 2 * SV_SEQUENCE_GROUP * PERIOD);
}

TEST(a_frame_again_costs_little) {
  sv_sequence_reader r;
  begin(40, 0);
  add(0);
  const size_t first = sv_history_used_bytes(&h);
  for (int i = 1; i < 15; i++) assert_int_equal(sv_history_repeat(&h, i * PERIOD), SV_OK);
  assert_true(sv_history_used_bytes(&h) < 3 * first); // another keyframe among them
  open_file(&r, write_file());
  for (int k = 0; k < 15; k++) check_frame(&r, k, 0);
}

TEST(too_small_for_a_frame) {
  sv_sequence_reader r;
  const int frame = 3;
  const sv_sequence_head head = {0};
  begin(40, 0);
  blob b = {file, 0, sizeof file};
  assert_int_equal(sv_history_repeat(&h, 0), SV_E_NOT_FOUND);
  assert_int_equal(sv_history_write(&h, &head, workspace, (sv_sink){&b, blob_write}, &err), SV_E_NOT_FOUND);
  h.cap_bytes = 100;
  assert_int_equal(sv_history_add(&h, 0, get, &frame), SV_E_FULL);
  assert_true(h.n_lost == 1 && h.n_frames == 0);
  h.cap_bytes = N * SV_HISTORY_GAUSSIAN_BYTES * 3; // room for less than a group
  for (int i = 0; i < 50; i++) add(i);
  assert_true(h.n_frames >= 2 && h.n_frames < SV_SEQUENCE_GROUP);
  open_file(&r, write_file());
  for (int k = 0; k < h.n_frames; k++) check_frame(&r, k, 50 - h.n_frames + k);
  sv_history_clear(&h);
  add(7);
  assert_int_equal(h.n_frames, 1);
}

TEST(none_takes_nothing) {
  arena = sv_arena_make(block, sizeof block);
  sv_history_carve(&h, &(sv_history_cfg){0}, &arena);
  assert_int_equal(arena.used_bytes, 0);
  assert_int_equal(sv_history_add(&h, 0, get, NULL), SV_E_NOT_FOUND);
  assert_int_equal(sv_history_cap_file_bytes(&h.cfg), 0);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(frames_read_as_they_were_added),
      cmocka_unit_test(old_groups_go),
      cmocka_unit_test(no_older_than_asked),
      cmocka_unit_test(a_frame_again_costs_little),
      cmocka_unit_test(too_small_for_a_frame),
      cmocka_unit_test(none_takes_nothing),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
