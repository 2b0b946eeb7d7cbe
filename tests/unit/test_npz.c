// SPDX-License-Identifier: Apache-2.0
// NumPy's archives: every kind of item, both orders, stored and deflated, a file that NumPy wrote,
// and damaged ones, which get one sentence each.
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "src/format/bytes.h"
#include "tests/common/npz_write.h"
#include "tests/common/test.h"
#include "tools/common/npz.h"

static sv_err err;

static void fill(npz_archive *z) {
  static const double k[9] = {500, 0, 320, 0, 501, 240, 0, 0, 1};
  static const uint32_t names[2][3] = {{'a', 0xE9, 0}, {'b', 0x1F600, 'c'}};
  static const int64_t size[2] = {4000, -3};
  npz_add(z, &(npz_array){"K", "<f8", "(1, 3, 3)", k, sizeof k});
  npz_add(z, &(npz_array){"names", "<U3", "(2,)", names, sizeof names});
  npz_add(z, &(npz_array){"sensor_size", "<i8", "(2,)", size, sizeof size});
  npz_add(z, &(npz_array){"metadata", "<U3", "()", names[0], sizeof names[0]});
}

static void check(const npz_archive *w) {
  sv_npz z;
  sv_npy a;
  char text[16];
  const size_t k_shape[3] = {0, 3, 3}, other[3] = {0, 4, 4};
  const sv_file_data file = {"a.npz", w->data, w->bytes};
  assert_ok(sv_npz_parse(&z, &file, &err), &err);
  assert_int_equal(z.n_items, 4);
  assert_true(sv_npz_has(&z, "K") && !sv_npz_has(&z, "k"));
  assert_ok(sv_npz_get(&z, "K", &a, &err), &err);
  assert_true(sv_npy_is_shape(&a, 3, k_shape) && !sv_npy_is_shape(&a, 3, other));
  assert_near(sv_npy_real(&a, 4), 501, 0);
  assert_true(isnan(sv_npy_real(&a, 9)) && !sv_npy_text(&a, 0, text, sizeof text));
  sv_npy_free(&a);
  assert_ok(sv_npz_get(&z, "names", &a, &err), &err);
  assert_true(sv_npy_text(&a, 0, text, sizeof text));
  assert_string_equal(text, "a\xC3\xA9");
  assert_true(sv_npy_text(&a, 1, text, sizeof text));
  assert_string_equal(text, "b\xF0\x9F\x98\x80"
                            "c");
  assert_false(sv_npy_text(&a, 1, text, 6));
  sv_npy_free(&a);
  assert_ok(sv_npz_get(&z, "sensor_size", &a, &err), &err);
  assert_near(sv_npy_real(&a, 0), 4000, 0);
  assert_near(sv_npy_real(&a, 1), -3, 0);
  sv_npy_free(&a);
  assert_ok(sv_npz_get(&z, "metadata", &a, &err), &err);
  assert_int_equal(a.n_dims, 0);
  assert_int_equal(a.n_items, 1);
  sv_npy_free(&a);
  assert_error(sv_npz_get(&z, "depths", &a, &err), SV_E_NOT_FOUND, &err, "it has: K, names");
  sv_npz_close(&z);
}

TEST(test_archives) {
  for (int i = 0; i < 2; i++) {
    npz_archive w = {.is_deflated = i};
    fill(&w);
    npz_finish(&w);
    check(&w);
    npz_free(&w);
  }
}

static double first_of(const char *descr, const void *items, size_t bytes) {
  size_t n;
  sv_npy a;
  uint8_t *p = npy_make(&(npz_array){"x", descr, "(1,)", items, bytes}, false, &n);
  const sv_file_data file = {"x.npy", p, n};
  assert_ok(sv_npy_parse(&a, &file, &err), &err);
  double x = sv_npy_real(&a, 0);
  sv_npy_free(&a);
  free(p);
  return x;
}

TEST(test_numbers) {
  assert_near(first_of("<f2", (uint8_t[]){0x00, 0x3C}, 2), 1, 0);
  assert_near(first_of("<f2", (uint8_t[]){0x01, 0x80}, 2), -0x1p-24, 0);
  assert_true(isinf(first_of("<f2", (uint8_t[]){0x00, 0xFC}, 2)));
  assert_near(first_of("<f4", (uint8_t[]){0, 0, 0xC0, 0xBF}, 4), -1.5, 0);
  assert_near(first_of("|i1", (uint8_t[]){0x80}, 1), -128, 0);
  assert_near(first_of("<i2", (uint8_t[]){0xFF, 0xFF}, 2), -1, 0);
  assert_near(first_of("<u4", (uint8_t[]){0xFF, 0xFF, 0xFF, 0xFF}, 4), 4294967295.0, 0);
  assert_near(first_of("|b1", (uint8_t[]){1}, 1), 1, 0);
}

TEST(test_fortran_order) {
  const uint8_t columns[6] = {1, 4, 2, 5, 3, 6}; // of [[1, 2, 3], [4, 5, 6]]
  size_t n;
  sv_npy a;
  uint8_t *p = npy_make(&(npz_array){"x", "|u1", "(2, 3)", columns, 6}, true, &n);
  const sv_file_data file = {"x.npy", p, n};
  assert_ok(sv_npy_parse(&a, &file, &err), &err);
  for (size_t i = 0; i < 6; i++) assert_near(sv_npy_real(&a, i), (double)i + 1, 0);
  sv_npy_free(&a);
  free(p);
}

// numpy.savez_compressed(f, a=numpy.array([[1.5, -2]], numpy.float32)) of NumPy 1.24: its local
// header has ZIP64's extra field, though the file is small.
TEST(test_from_numpy) {
  static const uint8_t from_numpy[] = {
#include "tests/unit/test_npz_numpy.inc"
  };
  sv_npz z;
  sv_npy a;
  const sv_file_data file = {"n.npz", from_numpy, sizeof from_numpy};
  assert_ok(sv_npz_parse(&z, &file, &err), &err);
  assert_ok(sv_npz_get(&z, "a", &a, &err), &err);
  assert_near(sv_npy_real(&a, 0), 1.5, 0);
  assert_near(sv_npy_real(&a, 1), -2, 0);
  sv_npy_free(&a);
  sv_npz_close(&z);
}

static void refuse_array(const char *descr, const char *shape, const char *part) {
  size_t n;
  sv_npy a;
  uint8_t *p = npy_make(&(npz_array){"x", descr, shape, "12345678", 8}, false, &n);
  const sv_file_data file = {"x.npy", p, n};
  sv_status s = sv_npy_parse(&a, &file, &err);
  assert_true(s < 0);
  assert_contains(err.text, part);
  assert_one_sentence(err.text);
  free(p);
}

TEST(test_refused) {
  refuse_array("|O", "(1,)", "no plain array");
  refuse_array(">f8", "(1,)", "big-endian");
  refuse_array("<f3", "(1,)", "type f3");
  refuse_array("<c8", "(1,)", "type c8");
  refuse_array("<f8", "(2,)", "its shape needs 16");
  refuse_array("<f8", "(4294967295, 4294967295)", "no shape");
  refuse_array("<f8", "(1, 1, 1, 1, 1, 1, 1, 1, 1)", "no shape");
  refuse_array("<f8", "(-1,)", "no shape");
}

// Cut at each length and with each byte changed: read or refused, and refused by a sentence.
TEST(test_damaged) {
  npz_archive w = {.is_deflated = true};
  fill(&w);
  npz_finish(&w);
  for (size_t i = 0; i < 2 * w.bytes; i++) {
    uint8_t *copy = malloc(w.bytes);
    assert_non_null(copy);
    memcpy(copy, w.data, w.bytes);
    if (i >= w.bytes) copy[i - w.bytes] ^= 0x41;
    const sv_file_data file = {"a.npz", copy, i < w.bytes ? i : w.bytes};
    sv_npz z;
    sv_npy a;
    sv_status s = sv_npz_parse(&z, &file, &err);
    assert_true(i >= w.bytes || s < 0);
    for (int k = 0; s == SV_OK && k < z.n_items; k++) {
      char name[SV_NPZ_CAP_NAME];
      memcpy(name, z.item[k].name, sizeof name);
      s = sv_npz_get(&z, name, &a, &err);
      if (s == SV_OK) sv_npy_free(&a);
    }
    if (s < 0) assert_one_sentence(err.text);
    free(copy);
  }
  npz_free(&w);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_archives),   cmocka_unit_test(test_numbers), cmocka_unit_test(test_fortran_order),
      cmocka_unit_test(test_from_numpy), cmocka_unit_test(test_refused), cmocka_unit_test(test_damaged),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
