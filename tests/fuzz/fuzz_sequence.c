// SPDX-License-Identifier: Apache-2.0
// Sequences of a moving model: opened, the base read, then frames in some order.
#include <string.h>

#include "src/format/sequence.h"
#include "tests/fuzz/blob.h"
#include "tests/fuzz/fuzz.h"

#define N 70

static _Alignas(8) uint8_t state[1u << 20];

static float value(const void *self, uint32_t i, int row) {
  (void)self;
  return 0.01f * (float)((i * 37 + (unsigned)row * 11) % 101) - 0.5f;
}

size_t fuzz_seed(int i, uint8_t *buf, size_t cap) {
  const sv_sequence_head h = {.n = N,
                              .n_moving = i == 1 ? 0 : 66,
                              .n_frames = 5,
                              .group = i == 2 ? 1 : 3,
                              .sh_degree = i,
                              .radius = 1};
  const sv_sequence_source source = {NULL, value, value};
  sv_sequence_writer w;
  blob m = {buf, 0, cap};
  if (i > 2 || sv_sequence_writer_bytes(&h) > sizeof state) return 0;
  sv_status s = sv_sequence_begin(&w, &h, &source, state, (sv_sink){&m, blob_write}, NULL);
  for (int k = 0; k < 5 && s == SV_OK; k++) s = sv_sequence_frame(&w, NULL);
  return s == SV_OK && sv_sequence_end(&w, NULL) == SV_OK ? m.n : 0;
}

static void read_one(const uint8_t *data, size_t bytes) {
  static const uint32_t order[] = {4, 0, 3, 1, 2};
  sv_sequence_reader r;
  sv_gaussian g;
  sv_err err;
  if (sv_sequence_open(&r, &(sv_file_data){"f", data, bytes}, &err) != SV_OK) return;
  if (sv_sequence_reader_bytes(&r.head) > sizeof state) return;
  if (sv_sequence_read_base(&r, state, &err) != SV_OK) return;
  for (int k = 0; k < 5; k++) {
    if (order[k] >= r.head.n_frames || sv_sequence_read_frame(&r, order[k], &err) != SV_OK) continue;
    for (uint32_t i = 0; i < r.head.n; i++) {
      sv_sequence_get(&r, i, &g);
      FUZZ_CHECK(g.mean[0] == g.mean[0]);
    }
  }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t bytes) {
  static uint8_t sealed[1u << 16];
  read_one(data, bytes);
  if (bytes > sizeof sealed) return 0;
  if (bytes) memcpy(sealed, data, bytes);
  blob_seal(sealed, bytes);
  read_one(sealed, bytes);
  return 0;
}
