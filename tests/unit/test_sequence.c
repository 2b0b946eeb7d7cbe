// SPDX-License-Identifier: Apache-2.0
// Sequences of a moving model: every value within half a step after reading, in any order of
// frames; rest costs almost nothing; damage is refused.
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "src/format/sequence.h"
#include "src/format/sequence_block.h"
#include "tests/common/test.h"
#include "tests/fuzz/blob.h"

#define N        150 // not a multiple of a block
#define N_MOVING 90
#define N_FRAMES 30

static sv_err err;
static uint8_t file[1u << 20];
static _Alignas(8) uint8_t state_w[1u << 18], state_r[1u << 18];

static float base_of(const void *self, uint32_t i, int row) {
  (void)self;
  if (row >= 3 && row < 7) return row == 3 ? 2.0f : 0.3f * sinf((float)i + (float)row);
  return sinf(0.7f * (float)i + 1.3f * (float)row) * (row < 3 ? 2 : row < 11 ? 4 : 0.5f);
}

static float moved_of(const void *self, uint32_t i, int row) {
  const float t = (float)*(const uint32_t *)self / (N_FRAMES - 1);
  const float x = base_of(NULL, i, row);
  if (row < 3) return x + 0.5f * t * t + (i % 7 == 0 ? 0.2f * sinf(9 * t) : 0);
  return row == 10 ? x - 3 * t : row >= 11 ? x + 0.3f * t : row < 7 ? x + 0.4f * t * (float)(row == 5) : x;
}

static const sv_sequence_head usual = {.n = N,
                                       .n_moving = N_MOVING,
                                       .n_frames = N_FRAMES,
                                       .group = SV_SEQUENCE_GROUP,
                                       .sh_degree = 1,
                                       .unit = {.is_metric = true, .scale_sigma = 0.002f},
                                       .seconds = 2,
                                       .radius = 2,
                                       .up = "z"};

static size_t write_file(const sv_sequence_head *h) {
  uint32_t frame = 0;
  const sv_sequence_source source = {&frame, base_of, moved_of};
  blob b = {file, 0, sizeof file};
  sv_sequence_writer w;
  assert_true(sv_sequence_writer_bytes(h) <= sizeof state_w);
  assert_ok(sv_sequence_begin(&w, h, &source, state_w, (sv_sink){&b, blob_write}, &err), &err);
  for (; frame < h->n_frames; frame++) assert_ok(sv_sequence_frame(&w, &err), &err);
  assert_ok(sv_sequence_end(&w, &err), &err);
  return b.n;
}

static void open_file(sv_sequence_reader *r, size_t bytes) {
  assert_ok(sv_sequence_open(r, &(sv_file_data){"f", file, bytes}, &err), &err);
  assert_true(sv_sequence_reader_bytes(&r->head) <= sizeof state_r);
  assert_ok(sv_sequence_read_base(r, state_r, &err), &err);
}

// The value of a row as the writer takes it: quaternions have length 1.
static float expected(uint32_t i, int row, const uint32_t *frame) {
  float q[4], n2 = 0;
  if (row < 3 || row >= 7) return frame ? moved_of(frame, i, row) : base_of(NULL, i, row);
  for (int k = 0; k < 4; k++) {
    q[k] = frame ? moved_of(frame, i, 3 + k) : base_of(NULL, i, 3 + k);
    n2 += q[k] * q[k];
  }
  return q[row - 3] / sqrtf(n2);
}

static void check_frame(const sv_sequence_reader *r, const uint32_t *frame) {
  for (uint32_t i = 0; i < N; i++) {
    sv_gaussian g;
    sv_sequence_get(r, i, &g);
    const float *v = &g.mean[0];
    for (int row = 0; row < sv_sequence_n_rows(&r->head); row++) {
      float got;
      memcpy(&got, (const char *)v + 4 * (size_t)row, 4);
      assert_near(got, expected(i, row, i < N_MOVING && row < SV_SEQUENCE_N_MOVED ? frame : NULL),
                  0.5f * sv_sequence_step(&r->head, row) + 1e-6f);
    }
  }
}

TEST(test_values_are_within_half_a_step) {
  static const uint32_t order[] = {0, 1, 2, 3, 11, 12, 29, 13, 14, 5, 24, 25, 0};
  sv_sequence_reader r;
  open_file(&r, write_file(&usual));
  assert_int_equal(r.head.n_frames, N_FRAMES);
  assert_string_equal(r.head.up, "z");
  assert_true(r.head.unit.is_metric && r.head.unit.scale_sigma == 0.002f && !r.head.is_mip);
  check_frame(&r, NULL);
  for (size_t k = 0; k < sizeof order / sizeof *order; k++) {
    assert_ok(sv_sequence_read_frame(&r, order[k], &err), &err);
    check_frame(&r, &order[k]);
  }
  assert_error(sv_sequence_read_frame(&r, N_FRAMES, &err), SV_E_ARG, &err, "frames 0 to 29");
}

TEST(test_rest_costs_a_byte_a_block) {
  sv_sequence_head h = usual;
  const size_t many = write_file(&h);
  h.n_moving = 0;
  const size_t none = write_file(&h);
  h.n_moving = 1; // 14 rows of one block
  const size_t one = write_file(&h);
  assert_true(none < many);
  assert_true(one < none + N_FRAMES * (24 + SV_SEQUENCE_N_MOVED * (1 + 8 * 12)));
}

TEST(test_heads_out_of_range_are_refused) {
  sv_sequence_writer w;
  blob b = {file, 0, sizeof file};
  sv_sequence_head h = usual;
  h.n_frames = 1;
  assert_int_equal(sv_sequence_writer_bytes(&h), 0);
  const sv_sequence_source source = {NULL, base_of, moved_of};
  assert_error(sv_sequence_begin(&w, &h, &source, state_w, (sv_sink){&b, blob_write}, &err), SV_E_ARG, &err,
               "cannot be written");
}

TEST(test_damage_is_refused) {
  sv_sequence_reader r;
  const size_t bytes = write_file(&usual);
  for (size_t cut = 0; cut < bytes; cut += 97)
    assert_true(sv_sequence_open(&r, &(sv_file_data){"f", file, cut}, &err) < 0);
  for (size_t at = 24; at < bytes; at += 31) { // with right checksums
    file[at] ^= 0x15;
    blob_seal(file, bytes);
    if (sv_sequence_open(&r, &(sv_file_data){"f", file, bytes}, &err) == SV_OK &&
        sv_sequence_reader_bytes(&r.head) <= sizeof state_r &&
        sv_sequence_read_base(&r, state_r, &err) == SV_OK)
      for (uint32_t k = 0; k < r.head.n_frames; k++)
        assert_true(sv_sequence_read_frame(&r, k, &err) <= SV_OK);
    file[at] ^= 0x15;
  }
}

TEST(test_blocks_keep_their_extremes) {
  sv_sequence_block b, c;
  uint8_t packed[SV_SEQUENCE_BLOCK_MAX_BYTES];
  int32_t before[64], earlier[64];
  for (int k = 0; k < 64; k++) {
    b.value[k] = sv_sequence_round(k % 2 ? 1e30f : -1e30f);
    before[k] = -b.value[k];
    earlier[k] = b.value[k];
  }
  sv_sequence_choose(&b, before, earlier);
  assert_int_equal(sv_sequence_unpack(&c, packed, sv_sequence_pack(&b, packed)), 1 + 8 * b.n_bits);
  for (uint32_t k = 0; k < 64; k++)
    assert_int_equal(sv_sequence_value(&c, k, before[k], earlier[k]), b.value[k]);
  assert_int_equal(sv_sequence_round(NAN), -67108864);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_values_are_within_half_a_step),  cmocka_unit_test(test_rest_costs_a_byte_a_block),
      cmocka_unit_test(test_heads_out_of_range_are_refused), cmocka_unit_test(test_damage_is_refused),
      cmocka_unit_test(test_blocks_keep_their_extremes),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
