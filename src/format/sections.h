// SPDX-License-Identifier: Apache-2.0
// A container of tagged sections with checksums, for checkpoints. Little endian:
//   file header, 24 B:   "SVSECT\r\n", kind[4], u32 version, u32 0, u32 crc of the 20 bytes before
//   each section:        tag[4], u32 index, u64 bytes, u32 0, u32 crc of the 20 bytes before;
//                        payload; zeros up to a multiple of 8; u32 crc of both, u32 ~crc
//   last: a section "END " without payload. Nothing may follow it.
// Every byte is under a checksum, sections are numbered and the end is marked: a truncated file or
// a flipped bit is detected. Payloads start at multiples of 8 from the start of the file.
#ifndef SV_FORMAT_SECTIONS_H
#define SV_FORMAT_SECTIONS_H

#include <stdint.h>

#include "src/base/file_data.h"
#include "src/format/gaussian.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_SECTIONS_OVERHEAD_BYTES 56 // header and end mark of a file
#define SV_SECTIONS_HEADER_BYTES   24 // of the file, and of a section before its payload
// What a section of so many bytes takes in the file.
#define SV_SECTIONS_BYTES(bytes) (32 + (((uint64_t)(bytes) + 7) & ~(uint64_t)7))

typedef struct {
  sv_sink sink;
  uint32_t n_sections, crc;
  uint64_t left_bytes, bytes; // of the open section
  int is_open;
} sv_sections_writer;

// Call begin; for each section section_begin with its size, writes that add up to it, section_end;
// then end. kind and tag: 4 characters.
sv_status sv_sections_begin(sv_sections_writer *w, sv_sink sink, const char *kind, uint32_t version,
                            sv_err *err) SV_MUST_USE;
sv_status sv_sections_section_begin(sv_sections_writer *w, const char *tag, uint64_t bytes,
                                    sv_err *err) SV_MUST_USE;
sv_status sv_sections_write(sv_sections_writer *w, const void *data, size_t bytes, sv_err *err) SV_MUST_USE;
sv_status sv_sections_section_end(sv_sections_writer *w, sv_err *err) SV_MUST_USE;
sv_status sv_sections_end(sv_sections_writer *w, sv_err *err) SV_MUST_USE;
// One section from one block.
sv_status sv_sections_put(sv_sections_writer *w, const char *tag, const void *data, size_t bytes,
                          sv_err *err) SV_MUST_USE;

typedef struct {
  const char *name;
  const uint8_t *buf; // whole and verified
  size_t bytes;
  uint32_t n_sections, version;
} sv_sections;

// Verifies the whole buffer: E_FORMAT (not this kind of file), E_UNSUPPORTED (version above
// max_version), E_CORRUPT (cut or damaged). The file must outlive r.
sv_status sv_sections_open(sv_sections *r, const sv_file_data *file, const char *kind, uint32_t max_version,
                           sv_err *err) SV_MUST_USE;
// The first section with a tag: its payload inside buf. E_NOT_FOUND when absent.
sv_status sv_sections_find(const sv_sections *r, const char *tag, const void **data, size_t *bytes,
                           sv_err *err) SV_MUST_USE;
// The same with an expected size, copied to out; another size is E_FORMAT.
sv_status sv_sections_get(const sv_sections *r, const char *tag, void *out, size_t bytes,
                          sv_err *err) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
