// SPDX-License-Identifier: Apache-2.0
#include "platform/codec/gzip.h"

#include <stdlib.h>
#include <string.h>
#include <zlib.h>

#define WITH_GZIP_HEADER (16 + MAX_WBITS)

sv_status sv_gzip(const sv_piece *piece, int n_pieces, const sv_piece *extra, uint8_t **out, size_t *bytes,
                  sv_err *err) {
  z_stream z = {0};
  gz_header header = {.os = 255}; // not told
  uLong total = 0;
  *out = NULL;
  for (int i = 0; i < n_pieces; i++) total += (uLong)piece[i].bytes;
  if (total > 0x7fffffff ||
      deflateInit2(&z, Z_DEFAULT_COMPRESSION, Z_DEFLATED, WITH_GZIP_HEADER, 8, Z_DEFAULT_STRATEGY))
    return sv_fail(err, SV_E_NOMEM, "gzip: %lu bytes cannot be compressed", total);
  if (extra && extra->bytes) {
    header.extra = (Bytef *)(uintptr_t)extra->data;
    header.extra_len = (uInt)extra->bytes;
    deflateSetHeader(&z, &header);
  }
  uLong cap = deflateBound(&z, total);
  uint8_t *o = malloc(cap);
  int r = o ? Z_OK : Z_MEM_ERROR;
  z.next_out = o;
  z.avail_out = (uInt)cap;
  for (int i = 0; r == Z_OK && i < n_pieces; i++) {
    z.next_in = (Bytef *)(uintptr_t)piece[i].data;
    z.avail_in = (uInt)piece[i].bytes;
    r = deflate(&z, i + 1 < n_pieces ? Z_NO_FLUSH : Z_FINISH);
  }
  size_t n = z.total_out;
  deflateEnd(&z);
  if (r != Z_STREAM_END) {
    free(o);
    return sv_fail(err, SV_E_NOMEM, "gzip: no memory for %lu bytes", total);
  }
  *out = o;
  *bytes = n;
  return SV_OK;
}

sv_status sv_gunzip(const sv_file_data *file, size_t cap, uint8_t **out, size_t *bytes, sv_err *err) {
  const char *name = file->name;
  const size_t n = file->bytes;
  z_stream z = {.next_in = (Bytef *)(uintptr_t)file->data, .avail_in = (uInt)n};
  size_t room = 4 * n + 4096;
  *out = NULL;
  if (n > 0x7fffffff || inflateInit2(&z, WITH_GZIP_HEADER))
    return sv_fail(err, SV_E_NOMEM, "%s: cannot be read", name);
  uint8_t *o = malloc(room);
  int r = o ? Z_OK : Z_MEM_ERROR;
  while (r == Z_OK) {
    if (z.total_out == room) {
      if (room >= cap) break;
      room = room > cap / 2 ? cap : 2 * room;
      uint8_t *larger = realloc(o, room);
      if (!larger) break;
      o = larger;
    }
    z.next_out = o + z.total_out;
    z.avail_out = room - z.total_out > 1u << 30 ? 1u << 30 : (uInt)(room - z.total_out);
    r = inflate(&z, Z_NO_FLUSH);
    if (r == Z_BUF_ERROR && z.avail_out == 0) r = Z_OK;
  }
  size_t got = z.total_out;
  inflateEnd(&z);
  if (r == Z_STREAM_END && got <= cap) {
    *out = o;
    *bytes = got;
    return SV_OK;
  }
  free(o);
  if (r == Z_OK) return sv_fail(err, SV_E_RANGE, "%s: holds more than the %zu bytes expected", name, cap);
  return sv_fail(err, SV_E_FORMAT, "%s: its gzip stream is damaged or cut", name);
}

// ID 1f 8b, method, flags (4: extra field), time, 2 bytes; then the field's length and itself.
size_t sv_gzip_extra(const sv_file_data *file, uint8_t out[SV_GZIP_CAP_EXTRA]) {
  const uint8_t *d = file->data;
  if (file->bytes < 12 || d[0] != 0x1f || d[1] != 0x8b || !(d[3] & 4)) return 0;
  size_t n = d[10] | (size_t)d[11] << 8;
  if (n > file->bytes - 12) return 0;
  if (n > SV_GZIP_CAP_EXTRA) n = SV_GZIP_CAP_EXTRA;
  memcpy(out, d + 12, n);
  return n;
}
