// SPDX-License-Identifier: Apache-2.0
// Hostile JPEGs on the way that a camera's frames take: cut at every byte, every bit of their
// headers flipped, tens of thousands of mutations, and headers that ask for what no picture is.
// None crashes, none writes beyond the picture, and not one heap call is made for any of them: a
// whole picture decodes after each as it did before.
#include <stdio.h>
#include <string.h>

#include "platform/camera/options.h"
#include "platform/codec/codec.h"
#include "tests/common/mutate.h"
#include "tests/common/test.h"
#include "tests/fault/heap_count.h"

#define WIDTH       64
#define HEIGHT      48
#define N_PX        (WIDTH * HEIGHT * 3)
#define GUARD       256
#define N_MUTATIONS 30000
#define CAP_SEED    8192

static uint8_t block[2 << 20], px[N_PX + GUARD], good_px[N_PX], input[MUTATE_CAP_BYTES];
static uint8_t seed[4][CAP_SEED];
static size_t seed_bytes[4];
static sv_codec codec, encoder;
static mutate_pool pool;
static unsigned long n_tried, n_refused;

// What the source and then the converter do with it.
static void decode(const uint8_t *data, size_t bytes) {
  int w = 0, h = 0;
  bool has_end = false;
  sv_err err = {0};
  sv_picture out = {WIDTH, HEIGHT, (size_t)WIDTH * 3, SV_PIX_RGB8, px};
  bool is_jpeg = sv_camera_jpeg_look(data, bytes, &w, &h, &has_end);
  assert_true(!is_jpeg || (w > 0 && h > 0));
  memset(px + N_PX, 0xa5, GUARD);
  sv_status s = sv_codec_decode_jpeg(&codec, data, bytes, &out, &err);
  assert_true(s <= SV_OK && (s == SV_OK || (err.text[0] && !strchr(err.text, '\n'))));
  for (int i = 0; i < GUARD; i++) assert_int_equal(px[N_PX + i], 0xa5);
  n_tried++;
  n_refused += s < 0;
}

static void must_decode(void) {
  sv_picture out = {WIDTH, HEIGHT, (size_t)WIDTH * 3, SV_PIX_RGB8, px};
  assert_int_equal(sv_codec_decode_jpeg(&codec, seed[0], seed_bytes[0], &out, NULL), SV_OK);
  assert_memory_equal(px, good_px, N_PX);
}

static size_t end_of_header(const uint8_t *data, size_t bytes) {
  for (size_t i = 0; i + 1 < bytes; i++)
    if (data[i] == 0xff && data[i + 1] == 0xda) return i + 14;
  return bytes;
}

// --- the corpora ---------------------------------------------------------------------------------
TEST(cut_anywhere) {
  for (int k = 0; k < 4; k++)
    for (size_t n = 0; n <= seed_bytes[k]; n += n < 800 || k == 0 ? 1 : 7) decode(seed[k], n);
  must_decode();
}

TEST(every_bit_of_a_header) {
  for (int k = 0; k < 4; k++) {
    size_t n = end_of_header(seed[k], seed_bytes[k]);
    memcpy(input, seed[k], seed_bytes[k]);
    for (size_t bit = 0; bit < 8 * n; bit++) {
      input[bit / 8] ^= (uint8_t)(1u << bit % 8);
      decode(input, seed_bytes[k]);
      input[bit / 8] ^= (uint8_t)(1u << bit % 8);
    }
  }
  must_decode();
}

TEST(mutations) {
  for (int i = 0; i < N_MUTATIONS; i++) {
    size_t n = mutate_next(&pool, input);
    decode(input, n);
    if (i % 1000 == 0) must_decode();
  }
}

// Headers that are well formed and ask for too much.
static const uint8_t *marker(uint8_t *data, size_t bytes, uint8_t m) {
  for (size_t i = 0; i + 1 < bytes; i++)
    if (data[i] == 0xff && data[i + 1] == m) return data + i;
  return NULL;
}

TEST(unreasonable_demands) {
  // Where a frame header has what: precision 4, height 5, width 7, components 9, sampling of each
  // 11 + 3 i.
  static const struct {
    int at, n;
    uint8_t bytes[4];
  } frames[] = {{5, 4, {0xff, 0xff, 0xff, 0xff}},
                {5, 4, {0, 0, 0, 0}},
                {4, 1, {12}},
                {4, 1, {16}},
                {9, 1, {255}},
                {9, 1, {0}},
                {9, 1, {4}},
                {11, 1, {0x44}},
                {11, 1, {0}},
                {11, 1, {0xff}},
                {12, 1, {3}},
                {12, 1, {255}},
                {1, 1, {0xc2}},
                {1, 1, {0xc9}},
                {1, 1, {0xca}},
                {1, 1, {0xc3}},
                {2, 2, {0xff, 0xff}},
                {2, 2, {0, 0}},
                {10, 1, {7}},
                {14, 1, {0x41}}};
  for (int k = 0; k < 4; k++)
    for (size_t i = 0; i < sizeof frames / sizeof *frames; i++) {
      memcpy(input, seed[k], seed_bytes[k]);
      uint8_t *sof = (uint8_t *)marker(input, seed_bytes[k], 0xc0);
      assert_non_null(sof);
      memcpy(sof + frames[i].at, frames[i].bytes, (size_t)frames[i].n);
      decode(input, seed_bytes[k]);
    }
  // Without one of its tables; a table many times; nothing but restart markers; nothing but fill
  // bytes.
  static const uint8_t tables[] = {0xdb, 0xc4, 0xda};
  for (size_t i = 0; i < sizeof tables; i++) {
    memcpy(input, seed[0], seed_bytes[0]);
    uint8_t *t = (uint8_t *)marker(input, seed_bytes[0], tables[i]);
    assert_non_null(t);
    t[1] = 0xfe; // a comment now
    decode(input, seed_bytes[0]);
  }
  size_t at = end_of_header(seed[0], seed_bytes[0]);
  for (int fill = 0; fill < 4; fill++) {
    memcpy(input, seed[0], at);
    for (size_t i = at; i < MUTATE_CAP_BYTES; i++)
      input[i] = fill == 0 ? 0xff : fill == 1 ? 0 : fill == 2 ? (i & 1 ? 0xd0 + i / 2 % 8 : 0xff) : 0x55;
    decode(input, MUTATE_CAP_BYTES);
  }
  const uint8_t *dht = marker(seed[0], seed_bytes[0], 0xc4);
  size_t n = 2 + (size_t)(dht[2] << 8 | dht[3]), used = 2;
  memcpy(input, seed[0], 2);
  for (; used + n < MUTATE_CAP_BYTES - CAP_SEED; used += n) memcpy(input + used, dht, n);
  memcpy(input + used, seed[0] + 2, seed_bytes[0] - 2);
  decode(input, used + seed_bytes[0] - 2);
  must_decode();
}

// --- the whole -----------------------------------------------------------------------------------
FIXTURE(open_all) {
  sv_arena a = sv_arena_make(block, sizeof block);
  sv_codec_cfg cfg = {WIDTH, HEIGHT, false};
  static uint8_t from[N_PX];
  for (int k = 0; k < N_PX; k++) from[k] = (uint8_t)(k * 7 + k / 100);
  if (sv_codec_init(&codec, &cfg, &a) < 0 || sv_codec_init(&encoder, &cfg, &a) < 0) return -1;
  mutate_open(&pool);
  for (int i = 0; i < 4; i++) {
    sv_picture in = {WIDTH, HEIGHT, (size_t)WIDTH * (i == 2 ? 1 : 3), i == 2 ? SV_PIX_GREY8 : SV_PIX_RGB8,
                     from};
    if (sv_codec_encode_jpeg(&encoder, &in, (sv_jpeg_options){i == 3 ? 5 : 60, i == 1},
                             (sv_codec_buffer){seed[i], CAP_SEED}, &seed_bytes[i], NULL) < 0)
      return -1;
    mutate_add(&pool, seed[i], seed_bytes[i]);
  }
  sv_picture out = {WIDTH, HEIGHT, (size_t)WIDTH * 3, SV_PIX_RGB8, good_px};
  if (sv_codec_decode_jpeg(&codec, seed[0], seed_bytes[0], &out, NULL) < 0) return -1;
  return 0;
}

FIXTURE(close_all) {
  mutate_close(&pool);
  sv_codec_close(&codec);
  sv_codec_close(&encoder);
  return 0;
}

// cmocka itself uses the heap between two tests, so each is counted by itself.
#define COUNTED(name)                                                                                        \
  static void name##_without_heap(void **state) {                                                            \
    unsigned long before = n_tried, refused = n_refused;                                                     \
    sv_heap_arm();                                                                                           \
    name(state);                                                                                             \
    sv_heap_disarm();                                                                                        \
    sv_heap_report();                                                                                        \
    printf("%lu pictures, %lu refused, %lu heap calls\n", n_tried - before, n_refused - refused,             \
           sv_heap_count());                                                                                 \
    assert_int_equal(sv_heap_count(), 0);                                                                    \
    assert_true(n_refused > refused);                                                                        \
  }
COUNTED(cut_anywhere)
COUNTED(every_bit_of_a_header)
COUNTED(mutations)
COUNTED(unreasonable_demands)

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(cut_anywhere_without_heap),
      cmocka_unit_test(every_bit_of_a_header_without_heap),
      cmocka_unit_test(mutations_without_heap),
      cmocka_unit_test(unreasonable_demands_without_heap),
  };
  return cmocka_run_group_tests(tests, open_all, close_all);
}
