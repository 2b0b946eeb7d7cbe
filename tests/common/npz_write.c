// SPDX-License-Identifier: Apache-2.0
#include "tests/common/npz_write.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <zlib.h>

#include "src/format/bytes.h"

static void append(npz_archive *z, const void *data, size_t bytes) {
  uint8_t *p = realloc(z->data, z->bytes + bytes + 1);
  if (!p) abort();
  memcpy(p + z->bytes, data, bytes);
  z->data = p;
  z->bytes += bytes;
}

uint8_t *npy_make(const npz_array *a, bool is_fortran, size_t *bytes) {
  char head[300];
  int n = snprintf(head, sizeof head, "{'descr': '%s', 'fortran_order': %s, 'shape': %s, }", a->descr,
                   is_fortran ? "True" : "False", a->shape);
  while ((10 + n + 1) % 64) head[n++] = ' ';
  head[n++] = '\n';
  uint8_t *p = malloc(10 + (size_t)n + a->bytes);
  if (!p) abort();
  memcpy(p, "\x93NUMPY\x01\x00", 8);
  sv_put_le16(p + 8, (uint16_t)n);
  memcpy(p + 10, head, (size_t)n);
  memcpy(p + 10 + n, a->items, a->bytes);
  *bytes = 10 + (size_t)n + a->bytes;
  return p;
}

static void put_common(uint8_t *p, const npz_archive *z, int i) {
  sv_put_le16(p, 20);
  sv_put_le16(p + 4, z->is_deflated ? 8 : 0);
  sv_put_le16(p + 8, 33);
  sv_put_le32(p + 10, z->item[i].crc);
  sv_put_le32(p + 14, (uint32_t)z->item[i].packed_bytes);
  sv_put_le32(p + 18, (uint32_t)z->item[i].bytes);
  sv_put_le16(p + 22, (uint16_t)strlen(z->item[i].name));
}

static uint8_t *pack(const npz_archive *z, uint8_t *file, size_t bytes, size_t *packed_bytes) {
  *packed_bytes = bytes;
  if (!z->is_deflated) return file;
  z_stream s = {.next_in = file, .avail_in = (uInt)bytes};
  uint8_t *out = malloc(bytes + 1000);
  if (!out || deflateInit2(&s, 6, Z_DEFLATED, -MAX_WBITS, 8, Z_DEFAULT_STRATEGY) != Z_OK) abort();
  s.next_out = out;
  s.avail_out = (uInt)bytes + 1000;
  if (deflate(&s, Z_FINISH) != Z_STREAM_END) abort();
  *packed_bytes = s.total_out;
  deflateEnd(&s);
  free(file);
  return out;
}

void npz_add(npz_archive *z, const npz_array *a) {
  const int i = z->n_items++;
  size_t bytes;
  uint8_t *file = npy_make(a, false, &bytes), local[30] = {0};
  snprintf(z->item[i].name, sizeof z->item[i].name, "%.30s.npy", a->name);
  z->item[i].local = z->bytes;
  z->item[i].bytes = bytes;
  z->item[i].crc = (uint32_t)crc32(0, file, (uInt)bytes);
  file = pack(z, file, bytes, &z->item[i].packed_bytes);
  sv_put_le32(local, 0x04034b50);
  put_common(local + 4, z, i);
  append(z, local, sizeof local);
  append(z, z->item[i].name, strlen(z->item[i].name));
  append(z, file, z->item[i].packed_bytes);
  free(file);
}

void npz_finish(npz_archive *z) {
  const size_t start = z->bytes;
  for (int i = 0; i < z->n_items; i++) {
    uint8_t central[46] = {0};
    sv_put_le32(central, 0x02014b50);
    put_common(central + 6, z, i);
    sv_put_le32(central + 42, (uint32_t)z->item[i].local);
    append(z, central, sizeof central);
    append(z, z->item[i].name, strlen(z->item[i].name));
  }
  uint8_t end[22] = {0};
  sv_put_le32(end, 0x06054b50);
  sv_put_le16(end + 8, (uint16_t)z->n_items);
  sv_put_le16(end + 10, (uint16_t)z->n_items);
  sv_put_le32(end + 12, (uint32_t)(z->bytes - start));
  sv_put_le32(end + 16, (uint32_t)start);
  append(z, end, sizeof end);
}

void npz_save(npz_archive *z, const char *path) {
  npz_finish(z);
  FILE *f = fopen(path, "wb");
  if (!f || fwrite(z->data, 1, z->bytes, f) != z->bytes || fclose(f) != 0) abort();
}

void npz_free(npz_archive *z) {
  free(z->data);
  memset(z, 0, sizeof *z);
}
