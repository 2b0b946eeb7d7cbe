// SPDX-License-Identifier: Apache-2.0
#include <string.h>

#include "tests/common/mcap_write.h"
#include "tests/fuzz/fuzz.h"
#include "tools/import/mcap.h"

// One raw and one compressed picture, in a chunk.
size_t fuzz_seed(int i, uint8_t *buf, size_t cap) {
  static const uint8_t px[12] = {0xff, 0xd8, 0xff};
  mcap_file m = {.is_packed = i == 1 && mcap_can_pack()};
  if (i > 1) return 0;
  mcap_begin(&m);
  mcap_topic(&m, 0, "/a/image", false);
  mcap_topic(&m, 1, "/b/image/compressed", true);
  mcap_put(&m, 0, &(mcap_picture){7, "rgb8", 2, 2, 6, px, 12});
  mcap_put(&m, 1, &(mcap_picture){8, "", 0, 0, 0, px, 12});
  mcap_chunk(&m);
  mcap_end(&m);
  const size_t n = m.file.bytes < cap ? m.file.bytes : 0;
  memcpy(buf, m.file.data, n);
  mcap_free(&m);
  return n;
}

static sv_status look(void *self, const lab_mcap_message *m, sv_err *err) {
  lab_mcap_picture p;
  unsigned *sum = self;
  FUZZ_CHECK(strlen(m->topic) < LAB_MCAP_CAP_TOPIC);
  sv_status s = lab_mcap_picture_of(m, &p, err);
  if (s != SV_OK) return s;
  FUZZ_CHECK(p.px >= m->data && p.px + p.bytes <= m->data + m->bytes);
  FUZZ_CHECK(m->is_compressed || (size_t)p.stride_bytes * (size_t)p.height_px <= p.bytes);
  for (size_t i = 0; i < p.bytes; i++) *sum += p.px[i];
  return SV_OK;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t bytes) {
  unsigned sum = 0;
  sv_err err = {.text = ""};
  const sv_file_data file = {"f", data, bytes};
  const lab_mcap_sink sink = {&sum, look};
  if (lab_mcap_read(&file, &sink, &err) != SV_OK) FUZZ_CHECK(*err.text);
  return 0;
}
