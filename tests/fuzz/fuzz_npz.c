// SPDX-License-Identifier: Apache-2.0
#include <string.h>

#include "tests/common/npz_write.h"
#include "tests/fuzz/fuzz.h"
#include "tools/common/npz.h"

size_t fuzz_seed(int i, uint8_t *buf, size_t cap) {
  static const float items[6] = {1, 2, 3, 4, 5, 6};
  if (i > 1) return 0;
  npz_archive z = {.is_deflated = i == 1};
  npz_add(&z, &(npz_array){"cam_c2w", "<f4", "(2, 3)", items, sizeof items});
  npz_add(&z, &(npz_array){"names", "<U3", "(2,)", items, sizeof items});
  npz_finish(&z);
  size_t n = z.bytes <= cap ? z.bytes : 0;
  memcpy(buf, z.data, n);
  npz_free(&z);
  return n;
}

static void read_all(const sv_npy *a) {
  char text[40];
  size_t n = 1;
  for (int k = 0; k < a->n_dims; k++) n *= a->dim[k];
  FUZZ_CHECK(n == a->n_items && a->item_bytes > 0);
  for (size_t i = 0; i < a->n_items && i < 1000; i++) {
    (void)sv_npy_real(a, i);
    if (sv_npy_text(a, i, text, sizeof text)) FUZZ_CHECK(strlen(text) < sizeof text);
  }
  if (a->n_items) (void)sv_npy_real(a, a->n_items - 1);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t bytes) {
  static sv_npz z;
  sv_npy a;
  sv_err err;
  const sv_file_data file = {"f", data, bytes};
  if (sv_npy_parse(&a, &file, &err) == SV_OK) read_all(&a);
  if (sv_npz_parse(&z, &file, &err) != SV_OK) return 0;
  for (int i = 0; i < z.n_items; i++) {
    if (sv_npz_get(&z, z.item[i].name, &a, &err) != SV_OK) continue;
    read_all(&a);
    sv_npy_free(&a);
  }
  return 0;
}
