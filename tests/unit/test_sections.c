// SPDX-License-Identifier: Apache-2.0
// CRC-32C against known values, and the container: every truncation and every flipped bit is
// refused.
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "src/format/crc32c.h"
#include "src/format/sections.h"
#include "tests/common/test.h"

static sv_err err;
static uint8_t mem[4096];
static size_t n_mem;
static int n_calls, fail_at;

static sv_status to_memory(void *self, const void *data, size_t bytes, sv_err *e) {
  (void)self;
  if (++n_calls == fail_at) return sv_fail(e, SV_E_IO, "disk full");
  assert_true(n_mem + bytes <= sizeof mem);
  memcpy(mem + n_mem, data, bytes);
  n_mem += bytes;
  return SV_OK;
}

TEST(test_crc) {
  uint8_t b[32];
  assert_int_equal(sv_crc32c(0, "123456789", 9), 0xE3069283u);
  memset(b, 0, sizeof b); // RFC 3720, B.4
  assert_int_equal(sv_crc32c(0, b, 32), 0x8A9136AAu);
  memset(b, 0xFF, sizeof b);
  assert_int_equal(sv_crc32c(0, b, 32), 0x62A8AB43u);
  for (int i = 0; i < 32; i++) b[i] = (uint8_t)i;
  assert_int_equal(sv_crc32c(0, b, 32), 0x46DD794Eu);
  for (size_t i = 0; i <= 32; i++)
    assert_int_equal(sv_crc32c(sv_crc32c(0, b, i), b + i, 32 - i), 0x46DD794Eu);
  assert_int_equal(sv_crc32c(0, NULL, 0), 0);
}

static sv_status write_sample(void) {
  sv_sections_writer w;
  n_mem = 0;
  n_calls = 0;
  sv_status s = sv_sections_begin(&w, (sv_sink){NULL, to_memory}, "CKPT", 3, &err);
  if (s == SV_OK) s = sv_sections_put(&w, "conf", "hello", 5, &err);
  if (s == SV_OK) s = sv_sections_put(&w, "none", NULL, 0, &err);
  if (s == SV_OK) s = sv_sections_section_begin(&w, "data", 16, &err);
  for (int i = 0; i < 4 && s == SV_OK; i++) s = sv_sections_write(&w, "abcd", 4, &err);
  if (s == SV_OK) s = sv_sections_section_end(&w, &err);
  return s == SV_OK ? sv_sections_end(&w, &err) : s;
}

TEST(test_round_trip) {
  sv_sections r;
  const void *p;
  size_t n;
  char five[5];
  assert_int_equal(write_sample(), SV_OK);
  assert_int_equal(n_mem, SV_SECTIONS_OVERHEAD_BYTES + 3 * 32 + 8 + 0 + 16);
  assert_int_equal(sv_sections_open(&r, &(sv_file_data){"c", mem, n_mem}, "CKPT", 3, &err), SV_OK);
  assert_true(r.n_sections == 3 && r.version == 3);
  assert_int_equal(sv_sections_find(&r, "data", &p, &n, &err), SV_OK);
  assert_int_equal(n, 16);
  assert_memory_equal(p, "abcdabcdabcdabcd", 16);
  assert_int_equal((size_t)((const uint8_t *)p - mem) % 8, 0);
  assert_int_equal(sv_sections_get(&r, "conf", five, 5, &err), SV_OK);
  assert_memory_equal(five, "hello", 5);
  assert_int_equal(sv_sections_get(&r, "conf", five, 4, &err), SV_E_FORMAT);
  assert_int_equal(sv_sections_get(&r, "none", five, 0, &err), SV_OK);
  assert_int_equal(sv_sections_find(&r, "what", &p, &n, &err), SV_E_NOT_FOUND);
  assert_int_equal(sv_sections_find(&r, "END ", &p, &n, &err), SV_E_NOT_FOUND);
  assert_int_equal(sv_sections_open(&r, &(sv_file_data){"c", mem, n_mem}, "CKPT", 2, &err), SV_E_UNSUPPORTED);
  assert_int_equal(sv_sections_open(&r, &(sv_file_data){"c", mem, n_mem}, "RIGS", 3, &err), SV_E_FORMAT);
  assert_int_equal(sv_sections_open(&r, &(sv_file_data){"c", "something else entirely", 24}, "CKPT", 3, &err),
                   SV_E_FORMAT);
}

TEST(test_damage) {
  sv_sections r;
  assert_int_equal(write_sample(), SV_OK);
  for (size_t n = 0; n < n_mem; n++) {
    uint8_t *copy = malloc(n ? n : 1); // its own block, so that reading behind it is seen
    memcpy(copy, mem, n);
    assert_int_equal(sv_sections_open(&r, &(sv_file_data){"c", copy, n}, "CKPT", 3, &err), SV_E_CORRUPT);
    free(copy);
  }
  assert_int_equal(sv_sections_open(&r, &(sv_file_data){"c", mem, n_mem + 1}, "CKPT", 3, &err), SV_E_CORRUPT);
  for (size_t bit = 0; bit < 8 * n_mem; bit++) {
    mem[bit / 8] ^= (uint8_t)(1u << bit % 8);
    assert_true(sv_sections_open(&r, &(sv_file_data){"c", mem, n_mem}, "CKPT", 3, &err) < 0);
    mem[bit / 8] ^= (uint8_t)(1u << bit % 8);
  }
  assert_int_equal(sv_sections_open(&r, &(sv_file_data){"c", mem, n_mem}, "CKPT", 3, &err), SV_OK);
  // whole sections taken out or swapped: numbered, so seen
  memmove(mem + 24, mem + 24 + 40, n_mem - 64);
  assert_int_equal(sv_sections_open(&r, &(sv_file_data){"c", mem, n_mem - 40}, "CKPT", 3, &err),
                   SV_E_CORRUPT);
}

TEST(test_writer_failures) {
  sv_sections_writer w;
  for (fail_at = 1; write_sample() != SV_OK; fail_at++) {
    assert_int_equal(err.status, SV_E_IO);
    assert_true(fail_at < 100);
  }
  assert_true(fail_at > 10);
  fail_at = 0;
  assert_int_equal(sv_sections_begin(&w, (sv_sink){NULL, to_memory}, "toolong", 1, &err), SV_E_ARG);
  assert_int_equal(sv_sections_begin(&w, (sv_sink){NULL, to_memory}, "KIND", 1, &err), SV_OK);
  assert_int_equal(sv_sections_write(&w, "a", 1, &err), SV_E_ARG);
  assert_int_equal(sv_sections_section_begin(&w, "data", 4, &err), SV_OK);
  assert_int_equal(sv_sections_section_begin(&w, "data", 4, &err), SV_E_ARG);
  assert_int_equal(sv_sections_section_end(&w, &err), SV_E_ARG);
  assert_int_equal(sv_sections_write(&w, "abcde", 5, &err), SV_E_ARG);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_crc), cmocka_unit_test(test_round_trip),
                                     cmocka_unit_test(test_damage), cmocka_unit_test(test_writer_failures)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
