// SPDX-License-Identifier: Apache-2.0
// C only: the server is.
// Ranges of bytes in requests (RFC 9110, section 14), one range each. Owns nothing. Never refuses:
// any other form of the header is all of the file.
#ifndef SV_PLATFORM_PREVIEW_RANGE_H
#define SV_PLATFORM_PREVIEW_RANGE_H

#include <stdbool.h>
#include <stdint.h>

// Bytes [from, from + n) of a file. from below 0: the last -from bytes.
typedef struct {
  int64_t from;
  uint64_t n;
  bool is_part;
} pv_range;

struct MHD_Response;

pv_range pv_range_of(const char *text); // of the header Range, or NULL
// In a file of so many bytes; a range that begins at its end or later has none.
uint64_t pv_range_begin(const pv_range *r, uint64_t file_bytes);
uint64_t pv_range_bytes(const pv_range *r, uint64_t file_bytes);
void pv_range_headers(const pv_range *r, uint64_t file_bytes, struct MHD_Response *response);

#endif
