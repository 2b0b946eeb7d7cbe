// SPDX-License-Identifier: Apache-2.0
#include "src/format/sections.h"

#include <string.h>

#include "src/format/bytes.h"
#include "src/format/crc32c.h"

#define HEAD_BYTES 24
#define TAIL_BYTES 8

static const char magic[8] = {'S', 'V', 'S', 'E', 'C', 'T', '\r', '\n'};
static const uint8_t zeros[8];

static sv_status emit(sv_sections_writer *w, const void *data, size_t bytes, sv_err *err) {
  return bytes ? w->sink.write(w->sink.self, data, bytes, err) : SV_OK;
}

static void seal_head(uint8_t h[HEAD_BYTES]) { sv_put_le32(h + 20, sv_crc32c(0, h, 20)); }

sv_status sv_sections_begin(sv_sections_writer *w, sv_sink sink, const char *kind, uint32_t version,
                            sv_err *err) {
  uint8_t h[HEAD_BYTES] = {0};
  *w = (sv_sections_writer){.sink = sink};
  if (strlen(kind) != 4)
    return sv_fail(err, SV_E_ARG, "a container's kind has 4 characters, not \"%s\"", kind);
  memcpy(h, magic, 8);
  memcpy(h + 8, kind, 4);
  sv_put_le32(h + 12, version);
  seal_head(h);
  return emit(w, h, sizeof h, err);
}

sv_status sv_sections_section_begin(sv_sections_writer *w, const char *tag, uint64_t bytes, sv_err *err) {
  uint8_t h[HEAD_BYTES] = {0};
  if (w->is_open) return sv_fail(err, SV_E_ARG, "section \"%s\" was begun inside another", tag);
  if (strlen(tag) != 4) return sv_fail(err, SV_E_ARG, "a section's tag has 4 characters, not \"%s\"", tag);
  memcpy(h, tag, 4);
  sv_put_le32(h + 4, w->n_sections++);
  sv_put_le64(h + 8, bytes);
  seal_head(h);
  w->is_open = 1;
  w->crc = 0;
  w->bytes = w->left_bytes = bytes;
  return emit(w, h, sizeof h, err);
}

sv_status sv_sections_write(sv_sections_writer *w, const void *data, size_t bytes, sv_err *err) {
  if (!w->is_open || bytes > w->left_bytes)
    return sv_fail(err, SV_E_ARG, "more bytes than the section was announced with");
  w->left_bytes -= bytes;
  w->crc = sv_crc32c(w->crc, data, bytes);
  return emit(w, data, bytes, err);
}

sv_status sv_sections_section_end(sv_sections_writer *w, sv_err *err) {
  if (!w->is_open || w->left_bytes)
    return sv_fail(err, SV_E_ARG, "a section ends %llu bytes short", (unsigned long long)w->left_bytes);
  size_t n_pad = (size_t)(-w->bytes & 7);
  uint8_t tail[TAIL_BYTES];
  w->crc = sv_crc32c(w->crc, zeros, n_pad);
  sv_put_le32(tail, w->crc);
  sv_put_le32(tail + 4, ~w->crc);
  w->is_open = 0;
  sv_status s = emit(w, zeros, n_pad, err);
  return s == SV_OK ? emit(w, tail, sizeof tail, err) : s;
}

sv_status sv_sections_put(sv_sections_writer *w, const char *tag, const void *data, size_t bytes,
                          sv_err *err) {
  sv_status s = sv_sections_section_begin(w, tag, bytes, err);
  if (s == SV_OK) s = sv_sections_write(w, data, bytes, err);
  return s == SV_OK ? sv_sections_section_end(w, err) : s;
}

sv_status sv_sections_end(sv_sections_writer *w, sv_err *err) {
  return sv_sections_put(w, "END ", zeros, 0, err);
}

// --- reading -------------------------------------------------------------------------------------
static int is_head_good(const uint8_t *h) {
  return sv_le32(h + 16) == 0 && sv_le32(h + 20) == sv_crc32c(0, h, 20);
}

// Checks the section at offset *at and moves behind it. The payload is at *at + HEAD_BYTES on
// entry.
static sv_status check_section(const sv_sections *r, size_t *at, uint32_t index, sv_err *err) {
  const uint8_t *h = r->buf + *at;
  size_t room = r->bytes - *at;
  if (room < HEAD_BYTES + TAIL_BYTES)
    return sv_fail(err, SV_E_CORRUPT, "%s: cut off before section %u", r->name, index);
  if (!is_head_good(h) || sv_le32(h + 4) != index)
    return sv_fail(err, SV_E_CORRUPT, "%s: the head of section %u at byte %zu is damaged", r->name, index,
                   *at);
  uint64_t bytes = sv_le64(h + 8);
  room -= HEAD_BYTES + TAIL_BYTES;
  if (bytes > room || ((bytes + 7) & ~7ull) > room)
    return sv_fail(err, SV_E_CORRUPT, "%s: cut off inside section \"%.4s\"", r->name, (const char *)h);
  size_t padded = (size_t)((bytes + 7) & ~7ull);
  const uint8_t *tail = h + HEAD_BYTES + padded;
  uint32_t crc = sv_crc32c(0, h + HEAD_BYTES, padded);
  if (sv_le32(tail) != crc || sv_le32(tail + 4) != ~crc)
    return sv_fail(err, SV_E_CORRUPT, "%s: section \"%.4s\" is damaged", r->name, (const char *)h);
  *at += HEAD_BYTES + padded + TAIL_BYTES;
  return SV_OK;
}

sv_status sv_sections_open(sv_sections *r, const sv_file_data *file, const char *kind, uint32_t max_version,
                           sv_err *err) {
  const char *name = file->name;
  const size_t bytes = file->bytes;
  *r = (sv_sections){.name = name, .buf = file->data, .bytes = bytes};
  if (bytes < HEAD_BYTES)
    return sv_fail(err, SV_E_CORRUPT, "%s: %zu bytes are too short for a header", name, bytes);
  if (memcmp(r->buf, magic, 8) != 0) return sv_fail(err, SV_E_FORMAT, "%s: not a subview container", name);
  if (!is_head_good(r->buf)) return sv_fail(err, SV_E_CORRUPT, "%s: the header is damaged", name);
  if (memcmp(r->buf + 8, kind, 4) != 0)
    return sv_fail(err, SV_E_FORMAT, "%s: holds \"%.4s\", \"%s\" was expected", name,
                   (const char *)r->buf + 8, kind);
  r->version = sv_le32(r->buf + 12);
  if (r->version > max_version)
    return sv_fail(err, SV_E_UNSUPPORTED, "%s: version %u, at most %u is known", name, r->version,
                   max_version);
  for (size_t at = HEAD_BYTES;;) {
    const uint8_t *h = r->buf + at;
    sv_status s = check_section(r, &at, r->n_sections, err);
    if (s != SV_OK) return s;
    if (memcmp(h, "END ", 4) == 0) {
      if (at != bytes) return sv_fail(err, SV_E_CORRUPT, "%s: %zu bytes after the end", name, bytes - at);
      return SV_OK;
    }
    r->n_sections++;
  }
}

sv_status sv_sections_find(const sv_sections *r, const char *tag, const void **data, size_t *bytes,
                           sv_err *err) {
  size_t at = HEAD_BYTES;
  for (uint32_t i = 0; i < r->n_sections; i++) {
    const uint8_t *h = r->buf + at;
    uint64_t n = sv_le64(h + 8);
    if (memcmp(h, tag, 4) == 0) {
      *data = h + HEAD_BYTES;
      *bytes = (size_t)n;
      return SV_OK;
    }
    at += HEAD_BYTES + (size_t)((n + 7) & ~7ull) + TAIL_BYTES;
  }
  return sv_fail(err, SV_E_NOT_FOUND, "%s: section \"%s\" is missing", r->name, tag);
}

sv_status sv_sections_get(const sv_sections *r, const char *tag, void *out, size_t bytes, sv_err *err) {
  const void *data;
  size_t n;
  sv_status s = sv_sections_find(r, tag, &data, &n, err);
  if (s != SV_OK) return s;
  if (n != bytes)
    return sv_fail(err, SV_E_FORMAT, "%s: section \"%s\" has %zu bytes, %zu were expected", r->name, tag, n,
                   bytes);
  if (bytes) memcpy(out, data, bytes);
  return SV_OK;
}
