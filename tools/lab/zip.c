// SPDX-License-Identifier: Apache-2.0
#include "tools/lab/zip.h"

#include <stdlib.h>
#include <string.h>
#include <zlib.h>

#include "src/format/bytes.h"

#define LOCAL_BYTES   30
#define CENTRAL_BYTES 46
#define END_BYTES     22
#define VERSION       20 // 2.0, of the format
#define DATE          33 // 1980-01-01

// From "version needed" on, what local and central headers have in common.
static void put_common(uint8_t *p, const lab_zip_entry *e) {
  sv_put_le16(p, VERSION);
  sv_put_le16(p + 8, DATE); // flags, method (stored) and time are zero
  sv_put_le32(p + 10, (uint32_t)crc32(0, e->data, (uInt)e->bytes));
  sv_put_le32(p + 14, (uint32_t)e->bytes);
  sv_put_le32(p + 18, (uint32_t)e->bytes);
  sv_put_le16(p + 22, (uint16_t)strlen(e->name));
}

sv_status lab_zip_write(const char *path, const lab_zip_entry *entry, int n, sv_err *err) {
  size_t bytes = END_BYTES, at = 0;
  for (int i = 0; i < n; i++)
    bytes += LOCAL_BYTES + CENTRAL_BYTES + 2 * strlen(entry[i].name) + entry[i].bytes;
  if (bytes > UINT32_MAX) return sv_fail(err, SV_E_RANGE, "%s: larger than 4 GiB", path);
  uint8_t *out = calloc(1, bytes);
  size_t *local = malloc((size_t)n * sizeof *local);
  sv_status s = out && local ? SV_OK : sv_fail(err, SV_E_NOMEM, "%s: no memory for %zu bytes", path, bytes);
  for (int i = 0; s == SV_OK && i < n; i++) {
    const size_t n_name = strlen(entry[i].name);
    local[i] = at;
    sv_put_le32(out + at, 0x04034b50);
    put_common(out + at + 4, &entry[i]);
    memcpy(out + at + LOCAL_BYTES, entry[i].name, n_name);
    memcpy(out + at + LOCAL_BYTES + n_name, entry[i].data, entry[i].bytes);
    at += LOCAL_BYTES + n_name + entry[i].bytes;
  }
  const size_t central = at;
  for (int i = 0; s == SV_OK && i < n; i++) {
    sv_put_le32(out + at, 0x02014b50);
    sv_put_le16(out + at + 4, VERSION);
    put_common(out + at + 6, &entry[i]);
    sv_put_le32(out + at + 42, (uint32_t)local[i]);
    memcpy(out + at + CENTRAL_BYTES, entry[i].name, strlen(entry[i].name));
    at += CENTRAL_BYTES + strlen(entry[i].name);
  }
  if (s == SV_OK) {
    sv_put_le32(out + at, 0x06054b50);
    sv_put_le16(out + at + 8, (uint16_t)n);
    sv_put_le16(out + at + 10, (uint16_t)n);
    sv_put_le32(out + at + 12, (uint32_t)(at - central));
    sv_put_le32(out + at + 16, (uint32_t)central);
    s = sv_file_write(path, out, bytes, err);
  }
  free(local);
  free(out);
  return s;
}
