// SPDX-License-Identifier: Apache-2.0
#include "platform/preview/range.h"

#if defined(__has_include) && __has_include(<microhttpd.h>)
#include <microhttpd.h>
#include <string.h>

#include "src/base/str.h"

pv_range pv_range_of(const char *text) {
  const pv_range all = {0, UINT64_MAX, false};
  long long first = 0, last = 0;
  if (!text || strncmp(text, "bytes=", 6) != 0) return all;
  text += 6;
  const char *dash = strchr(text, '-');
  if (!dash) return all;
  const size_t n_first = (size_t)(dash - text), n_last = strlen(dash + 1);
  if (n_first && (!sv_parse_int(text, n_first, &first) || first < 0)) return all;
  if (n_last && (!sv_parse_int(dash + 1, n_last, &last) || last < 0)) return all;
  if (!n_first) return n_last && last > 0 ? (pv_range){-last, (uint64_t)last, true} : all;
  if (n_last && last < first) return all;
  return (pv_range){first, n_last ? (uint64_t)(last - first) + 1 : UINT64_MAX, true};
}

uint64_t pv_range_begin(const pv_range *r, uint64_t file_bytes) {
  if (r->from >= 0) return (uint64_t)r->from;
  return (uint64_t)-r->from < file_bytes ? file_bytes - (uint64_t)-r->from : 0;
}

uint64_t pv_range_bytes(const pv_range *r, uint64_t file_bytes) {
  const uint64_t at = pv_range_begin(r, file_bytes), left = at < file_bytes ? file_bytes - at : 0;
  return r->n < left ? r->n : left;
}

void pv_range_headers(const pv_range *r, uint64_t file_bytes, struct MHD_Response *response) {
  char text[96];
  const uint64_t at = pv_range_begin(r, file_bytes), bytes = pv_range_bytes(r, file_bytes);
  sv_fmt(text, sizeof text, "bytes %llu-%llu/%llu", (unsigned long long)at,
         (unsigned long long)(at + bytes - 1), (unsigned long long)file_bytes);
  if (r->is_part) MHD_add_response_header(response, "Content-Range", text);
  MHD_add_response_header(response, "Accept-Ranges", "bytes");
}
#endif
