// SPDX-License-Identifier: Apache-2.0
#include <string.h>

#include "src/format/sections.h"
#include "tests/fuzz/blob.h"
#include "tests/fuzz/fuzz.h"

size_t fuzz_seed(int i, uint8_t *buf, size_t cap) {
  sv_sections_writer w;
  blob m = {buf, 0, cap};
  if (i > 2) return 0;
  sv_status s = sv_sections_begin(&w, (sv_sink){&m, blob_write}, "CKPT", 1, NULL);
  if (s == SV_OK && i > 0) s = sv_sections_put(&w, "conf", "hello", 5, NULL);
  if (s == SV_OK && i > 1)
    s = sv_sections_put(&w, "data", "0123456789012345678901234567890123456789", 40, NULL);
  if (s == SV_OK) s = sv_sections_end(&w, NULL);
  return s == SV_OK ? m.n : 0;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t bytes) {
  static const char *const tags[] = {"conf", "data", "END ", "none"};
  sv_sections r;
  sv_err err;
  if (sv_sections_open(&r, &(sv_file_data){"f", data, bytes}, "CKPT", 1, &err) != SV_OK) return 0;
  for (int i = 0; i < 4; i++) {
    const void *p;
    size_t n;
    if (sv_sections_find(&r, tags[i], &p, &n, &err) != SV_OK) continue;
    FUZZ_CHECK((const uint8_t *)p >= data && n <= bytes && (const uint8_t *)p + n <= data + bytes);
  }
  FUZZ_CHECK(r.version <= 1 && r.n_sections < bytes / 32 + 1);
  return 0;
}
