// SPDX-License-Identifier: Apache-2.0
// gzip through zlib, for exported files. These calls use the heap: not for the runtime.
#ifndef SV_PLATFORM_CODEC_GZIP_H
#define SV_PLATFORM_CODEC_GZIP_H

#include <stddef.h>
#include <stdint.h>

#include "src/base/file_data.h"
#include "src/base/status.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_GZIP_CAP_EXTRA 256

// Several pieces as one gzip stream in a block of malloc (*out, *bytes); the caller frees it.
// extra: the header's extra field (RFC 1952), NULL or without bytes: none.
typedef struct {
  const void *data;
  size_t bytes;
} sv_piece;
sv_status sv_gzip(const sv_piece *piece, int n_pieces, const sv_piece *extra, uint8_t **out, size_t *bytes,
                  sv_err *err) SV_MUST_USE;
// Decompresses at most cap bytes; E_RANGE beyond, so that a small file cannot fill the memory.
sv_status sv_gunzip(const sv_file_data *file, size_t cap, uint8_t **out, size_t *bytes,
                    sv_err *err) SV_MUST_USE;
// The header's extra field, at most SV_GZIP_CAP_EXTRA bytes of it; returns its bytes (0: none).
size_t sv_gzip_extra(const sv_file_data *file, uint8_t out[SV_GZIP_CAP_EXTRA]);

#ifdef __cplusplus
}
#endif
#endif
