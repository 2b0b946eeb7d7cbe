// SPDX-License-Identifier: Apache-2.0
#include <string.h>

#include "tests/fuzz/fuzz.h"
#include "tools/import/spatial.h"

static void wrap(uint8_t *buf, size_t *n, const char *type, size_t before) {
  memmove(buf + 8 + before, buf, *n);
  memset(buf, 0, 8 + before);
  *n += 8 + before;
  buf[2] = (uint8_t)(*n >> 8);
  buf[3] = (uint8_t)*n;
  memcpy(buf + 4, type, 4);
}

// A track with all boxes that are read.
size_t fuzz_seed(int i, uint8_t *buf, size_t cap) {
  static const uint8_t eyes[] = {0,   0,   0,   13, 's', 't', 'r', 'i', 0, 0,   0,  0,  3,
                                 0,   0,   0,   24, 'c', 'a', 'm', 's', 0, 0,   0,  16, 'b',
                                 'l', 'i', 'n', 0,  0,   0,   0,   0,   0, 249, 132};
  static const uint8_t rest[] = {0, 0, 0, 12, 'h', 'f', 'o', 'v', 0,   0, 248,
                                 0, 0, 0, 0,  9,   'l', 'h', 'v', 'C', 1};
  static const uint8_t handler[] = {0, 0, 0, 20, 'h', 'd', 'l', 'r', 0,   0,
                                    0, 0, 0, 0,  0,   0,   'v', 'i', 'd', 'e'};
  if (i > 0 || cap < 2000) return 0;
  size_t n = sizeof eyes;
  memcpy(buf, eyes, n);
  wrap(buf, &n, "eyes", 0);
  wrap(buf, &n, "vexu", 0);
  memcpy(buf + n, rest, sizeof rest);
  n += sizeof rest;
  wrap(buf, &n, "hvc1", 78);
  wrap(buf, &n, "stsd", 8);
  wrap(buf, &n, "stbl", 0);
  wrap(buf, &n, "minf", 0);
  memmove(buf + sizeof handler, buf, n);
  memcpy(buf, handler, sizeof handler);
  n += sizeof handler;
  wrap(buf, &n, "mdia", 0);
  wrap(buf, &n, "trak", 0);
  return n;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t bytes) {
  lab_spatial s;
  sv_err err = {.text = ""};
  const sv_file_data moov = {"f", data, bytes};
  if (lab_spatial_parse(&s, &moov, &err) != SV_OK) {
    FUZZ_CHECK(*err.text);
    return 0;
  }
  FUZZ_CHECK(s.n >= 0 && s.n <= LAB_SPATIAL_CAP_TRACKS);
  for (int i = 0; i < s.n; i++) FUZZ_CHECK(s.tracks[i].fov_rad >= 0 && s.tracks[i].fov_rad < 3.15);
  return 0;
}
