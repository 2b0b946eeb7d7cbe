// SPDX-License-Identifier: Apache-2.0
#include <stdio.h>
#include <string.h>

#include "tests/fuzz/fuzz.h"
#include "tools/import/lytro.h"

static size_t put_section(uint8_t *p, char kind, const void *data, size_t bytes) {
  memset(p, 0, 96);
  memcpy(p, "\x89LF?\r\n\x1a\n", 8);
  p[3] = (uint8_t)kind;
  p[14] = (uint8_t)(bytes >> 8);
  p[15] = (uint8_t)bytes;
  if (bytes) memcpy(p + 96, data, bytes);
  return bytes ? 96 + bytes : 16;
}

size_t fuzz_seed(int i, uint8_t *buf, size_t cap) {
  static const uint8_t raw[400] = {1, 2, 3, 4, 5};
  static const char *const json[2] = {
      ("{\"image\": {\"width\": 16, \"height\": 16, \"pixelPacking\": {\"endianness\": \"little\", "
       "\"bitsPerPixel\": 10}, \"mosaic\": {\"tile\": \"r,gr:gb,b\", \"upperLeftPixel\": \"gr\"}}, "
       "\"devices\": {\"lens\": {\"zoomStep\": 3}}}"),
      ("{\"image\": {\"width\": 16, \"height\": 16, \"rawDetails\": {\"pixelPacking\": {\"endianness\": "
       "\"big\", \"bitsPerPixel\": 12}, \"pixelFormat\": {\"black\": {\"r\": 1}}}}, \"devices\": {}}")};
  if (i > 1 || cap < 2000) return 0;
  size_t n = put_section(buf, 'P', NULL, 0);
  n += put_section(buf + n, 'C', raw, sizeof raw);
  return n + put_section(buf + n, 'C', json[i], strlen(json[i]));
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t bytes) {
  lab_lytro l;
  sv_bitmap b;
  sv_err err;
  const sv_file_data file = {"f", data, bytes};
  if (lab_lytro_parse(&l, &file, &err) != SV_OK) return 0;
  FUZZ_CHECK(l.raw >= data && l.raw + l.raw_bytes <= data + bytes);
  for (int k = 0; k < 2; k++)
    if (lab_lytro_develop(&l, k, &b, &err) == SV_OK) sv_bitmap_free(&b);
  return 0;
}
