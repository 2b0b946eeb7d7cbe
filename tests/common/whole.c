// SPDX-License-Identifier: Apache-2.0
#include "tests/common/whole.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/format/sections.h"
#include "src/train/checkpoint.h"

uint8_t *whole_read(const char *path, size_t *bytes) {
  FILE *f = fopen(path, "rb");
  if (!f) return NULL;
  fseek(f, 0, SEEK_END);
  const long n = ftell(f);
  rewind(f);
  uint8_t *data = n >= 0 ? malloc((size_t)n + 1) : NULL;
  *bytes = data ? fread(data, 1, (size_t)n, f) : 0;
  fclose(f);
  if (data && *bytes != (size_t)n) {
    free(data);
    return NULL;
  }
  if (data) data[*bytes] = 0;
  return data;
}

static bool is_ply(const uint8_t *data, size_t n) {
  const char *body = strstr((const char *)data, "end_header\n"),
             *count = strstr((const char *)data, "vertex ");
  int n_floats = 0;
  for (const char *p = (const char *)data; body && (p = strstr(p, "property float")) && p < body; p++)
    n_floats++;
  const size_t head = body ? (size_t)(body + 11 - (const char *)data) : 0;
  return body && count && n == head + (size_t)strtol(count + 7, NULL, 10) * (size_t)n_floats * sizeof(float);
}

bool whole_is(const char *name, const uint8_t *data, size_t n) {
  sv_sections r;
  sv_err err;
  const char *ext = strrchr(name, '.');
  if (!ext || n < 4) return false;
  if (!strcmp(ext, ".bin")) {
    const sv_file_data file = {name, data, n};
    return sv_sections_open(&r, &file, SV_CHECKPOINT_KIND, SV_CHECKPOINT_VERSION, &err) >= 0;
  }
  if (!strcmp(ext, ".json")) return data[n - 2] == '}' && data[n - 1] == '\n';
  if (!strcmp(ext, ".jpg")) return data[n - 2] == 0xff && data[n - 1] == 0xd9;
  return !strcmp(ext, ".ply") && is_ply(data, n);
}
