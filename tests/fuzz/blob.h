// SPDX-License-Identifier: Apache-2.0
// A file in memory for seeds, and checksums that hold again after a mutation.
#ifndef SV_TESTS_FUZZ_BLOB_H
#define SV_TESTS_FUZZ_BLOB_H

#include <string.h>

#include "src/format/bytes.h"
#include "src/format/crc32c.h"
#include "src/format/sections.h"

typedef struct {
  uint8_t *buf;
  size_t n, cap;
} blob;

static inline sv_status blob_write(void *self, const void *data, size_t bytes, sv_err *err) {
  blob *m = (blob *)self;
  if (bytes > m->cap - m->n) return sv_fail(err, SV_E_NOMEM, "full");
  if (bytes) memcpy(m->buf + m->n, data, bytes);
  m->n += bytes;
  return SV_OK;
}

// Computes the checksums of a sectioned file again, as far as the sections can be parsed, so that
// mutations get past them.
static inline void blob_seal(uint8_t *f, size_t bytes) {
  enum { HEAD = 24, TAIL = 8 };
  if (bytes < HEAD) return;
  sv_put_le32(f + 20, sv_crc32c(0, f, 20));
  for (size_t at = HEAD; bytes - at >= HEAD + TAIL;) {
    const uint64_t n = sv_le64(f + at + 8), padded = (n + 7) & ~7ull;
    if (n > bytes || padded > bytes - at - HEAD - TAIL) return;
    sv_put_le32(f + at + 20, sv_crc32c(0, f + at, 20));
    const uint32_t crc = sv_crc32c(0, f + at + HEAD, (size_t)padded);
    sv_put_le32(f + at + HEAD + padded, crc);
    sv_put_le32(f + at + HEAD + padded + 4, ~crc);
    at += HEAD + (size_t)padded + TAIL;
  }
}

#endif
