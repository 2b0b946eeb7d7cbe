// SPDX-License-Identifier: Apache-2.0
#include "tools/import/mcap.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "platform/linux/linux.h"
#include "src/base/str.h"
#include "src/format/bytes.h"

#if defined(__has_include) && __has_include(<zstd.h>)
#include <zstd.h>
#define HAS_ZSTD 1
#else
#define HAS_ZSTD 0
#endif

#define CAP_CHUNK_BYTES ((uint64_t)1 << 30)
#define CAP_IDS         256 // schemas, and channels

enum { SCHEMA = 3, CHANNEL = 4, MESSAGE = 5, CHUNK = 6, DATA_END = 15 }; // opcodes

static const uint8_t magic[8] = {0x89, 'M', 'C', 'A', 'P', '0', '\r', '\n'};

// A part of the file, read from its beginning on; is_bad: it ended too early.
typedef struct {
  const uint8_t *p;
  size_t left;
  bool is_bad;
} reader;

static const uint8_t *take(reader *r, uint64_t n) {
  static const uint8_t zeros[8];
  if (n > r->left) {
    r->is_bad = true;
    r->left = 0;
    return zeros; // for numbers; what is longer is not looked at
  }
  const uint8_t *p = r->p;
  r->p += n;
  r->left -= (size_t)n;
  return p;
}
static uint16_t u16(reader *r) {
  const uint8_t *p = take(r, 2);
  return sv_le16(p);
}
static uint32_t u32(reader *r) { return sv_le32(take(r, 4)); }
static uint64_t u64(reader *r) { return sv_le64(take(r, 8)); }

// A text; longer ones are cut.
static void text(reader *r, char *out, size_t cap) {
  const uint32_t n = u32(r);
  const uint8_t *p = take(r, n);
  const size_t kept = r->is_bad ? 0 : n < cap - 1 ? n : cap - 1;
  memcpy(out, p, kept);
  out[kept] = 0;
}

// --- the container -------------------------------------------------------------------------------

typedef struct {
  bool is_there, is_compressed;
  char topic[LAB_MCAP_CAP_TOPIC];
} channel;

typedef struct {
  const sv_file_data *file;
  const lab_mcap_sink *sink;
  enum { NO_PICTURE, RAW, COMPRESSED } schema[CAP_IDS]; // by number
  channel channels[CAP_IDS];                            // by number
} job;

static sv_status cut_off(const job *j, sv_err *err) {
  return sv_fail(err, SV_E_FORMAT,
                 "%.150s: ends within a record or is damaged; 'mcap recover' makes it whole", j->file->name);
}

static void add_schema(job *j, reader r) {
  char name[60];
  const uint16_t id = u16(&r);
  text(&r, name, sizeof name);
  if (r.is_bad || id >= CAP_IDS) return;
  j->schema[id] = sv_str_eq(name, "sensor_msgs/msg/Image")             ? RAW
                  : sv_str_eq(name, "sensor_msgs/msg/CompressedImage") ? COMPRESSED
                                                                       : NO_PICTURE;
}

static sv_status add_channel(job *j, reader r, sv_err *err) {
  char encoding[20];
  channel c = {.is_there = true};
  const uint16_t id = u16(&r), schema = u16(&r);
  text(&r, c.topic, sizeof c.topic);
  text(&r, encoding, sizeof encoding);
  if (r.is_bad) return cut_off(j, err);
  if (schema >= CAP_IDS || j->schema[schema] == NO_PICTURE || !sv_str_eq(encoding, "cdr")) return SV_OK;
  if (id >= CAP_IDS)
    return sv_fail(err, SV_E_UNSUPPORTED, "%.150s: more than %d topics", j->file->name, CAP_IDS);
  c.is_compressed = j->schema[schema] == COMPRESSED;
  j->channels[id] = c;
  return SV_OK;
}

static sv_status add_message(job *j, reader r, sv_err *err) {
  const uint16_t id = u16(&r);
  (void)u32(&r); // its number
  const uint64_t log_ns = u64(&r);
  (void)u64(&r); // when it was published
  if (r.is_bad) return cut_off(j, err);
  if (id >= CAP_IDS || !j->channels[id].is_there) return SV_OK;
  const channel *c = &j->channels[id];
  const lab_mcap_message m = {c->topic, c->is_compressed, log_ns, r.p, r.left};
  return j->sink->take(j->sink->self, &m, err);
}

static sv_status read_records(job *j, reader r, bool is_in_chunk, sv_err *err);

static sv_status unpack(job *j, reader packed, uint64_t bytes, sv_err *err) {
#if HAS_ZSTD
  uint8_t *all = malloc((size_t)bytes + 1);
  if (!all)
    return sv_fail(err, SV_E_NOMEM, "%.150s: no memory for a chunk of %llu bytes", j->file->name,
                   (unsigned long long)bytes);
  const size_t n = ZSTD_decompress(all, (size_t)bytes, packed.p, packed.left);
  sv_status s = n == bytes ? read_records(j, (reader){all, n, false}, true, err)
                           : sv_fail(err, SV_E_FORMAT, "%.150s: a chunk is damaged", j->file->name);
  free(all);
  return s;
#else
  (void)packed;
  (void)bytes;
  return sv_fail(err, SV_E_UNSUPPORTED, "%.150s: this build reads no zstd (libzstd-dev was missing)",
                 j->file->name);
#endif
}

static sv_status read_chunk(job *j, reader r, sv_err *err) {
  char compression[16];
  (void)u64(&r); // first time
  (void)u64(&r); // last time
  const uint64_t bytes = u64(&r);
  (void)u32(&r); // sum
  text(&r, compression, sizeof compression);
  const uint64_t n = u64(&r);
  const reader records = {take(&r, n), (size_t)n, false};
  if (r.is_bad || bytes > CAP_CHUNK_BYTES) return cut_off(j, err);
  if (!*compression) return read_records(j, records, true, err);
  if (sv_str_eq(compression, "zstd")) return unpack(j, records, bytes, err);
  return sv_fail(
      err, SV_E_UNSUPPORTED,
      "%.150s: its chunks are compressed by %s; 'mcap compress --compression zstd' makes them readable",
      j->file->name, compression);
}

static sv_status read_records(job *j, reader r, bool is_in_chunk, sv_err *err) {
  sv_status s = SV_OK;
  while (s == SV_OK && (r.left > 0 || !is_in_chunk)) {
    const uint8_t opcode = *take(&r, 1);
    const uint64_t n = u64(&r);
    const reader content = {take(&r, n), (size_t)n, false};
    if (r.is_bad) return cut_off(j, err);
    if (opcode == DATA_END) break;
    if (opcode == SCHEMA) add_schema(j, content);
    if (opcode == CHANNEL) s = add_channel(j, content, err);
    if (opcode == MESSAGE) s = add_message(j, content, err);
    if (opcode == CHUNK && !is_in_chunk) s = read_chunk(j, content, err);
  }
  return s;
}

sv_status lab_mcap_read(const sv_file_data *file, const lab_mcap_sink *sink, sv_err *err) {
  if (file->bytes < sizeof magic || memcmp(file->data, magic, sizeof magic) != 0)
    return sv_fail(err, SV_E_FORMAT, "%.150s: is not an MCAP file; 'mcap convert' makes one of .bag",
                   file->name);
  job *j = calloc(1, sizeof *j);
  if (!j) return sv_fail(err, SV_E_NOMEM, "%.150s: no memory", file->name);
  j->file = file;
  j->sink = sink;
  const reader r = {(const uint8_t *)file->data + sizeof magic, file->bytes - sizeof magic, false};
  sv_status s = read_records(j, r, false, err);
  free(j);
  return s;
}

sv_status lab_mcap_read_file(const char *path, const lab_mcap_sink *sink, sv_err *err) {
  const int fd = open(path, O_RDONLY | O_CLOEXEC);
  const off_t bytes = fd < 0 ? -1 : lseek(fd, 0, SEEK_END);
  void *data = bytes > 0 ? mmap(NULL, (size_t)bytes, PROT_READ, MAP_PRIVATE, fd, 0) : MAP_FAILED;
  const bool is_mapped = data != MAP_FAILED;
  sv_status s =
      fd < 0 || (bytes > 0 && !is_mapped)
          ? sv_fail(err, SV_E_NOT_FOUND, "%.150s: cannot be read: %s", path, sv_linux_reason(errno))
          : lab_mcap_read(&(sv_file_data){path, is_mapped ? data : "", is_mapped ? (size_t)bytes : 0}, sink,
                          err);
  if (is_mapped) munmap(data, (size_t)bytes);
  if (fd >= 0) close(fd);
  return s;
}

// --- messages ------------------------------------------------------------------------------------

// CDR aligns numbers of four bytes, from behind its own head of four.
static uint32_t cdr_u32(reader *r, const uint8_t *from) {
  (void)take(r, (uint64_t)(-(r->p - from) & 3));
  return u32(r);
}

static void cdr_text(reader *r, const uint8_t *from, char *out, size_t cap) {
  const uint32_t n = cdr_u32(r, from); // with its end
  const uint8_t *p = take(r, n);
  const size_t kept = r->is_bad || n == 0 ? 0 : n < cap ? n - 1 : cap - 1;
  memcpy(out, p, kept);
  out[kept] = 0;
}

sv_status lab_mcap_picture_of(const lab_mcap_message *m, lab_mcap_picture *p, sv_err *err) {
  reader r = {m->data, m->bytes, false};
  char frame[8];
  *p = (lab_mcap_picture){0};
  const uint8_t *head = take(&r, 4);
  if (!r.is_bad && (head[0] != 0 || head[1] != 1))
    return sv_fail(err, SV_E_UNSUPPORTED, "%.100s: messages are not little-endian CDR", m->topic);
  const uint8_t *from = r.p;
  const int64_t seconds = (int32_t)cdr_u32(&r, from);
  p->stamp_ns = seconds * 1000000000 + cdr_u32(&r, from);
  cdr_text(&r, from, frame, sizeof frame);
  uint32_t height = 0, width = 0, step = 0;
  if (!m->is_compressed) {
    height = cdr_u32(&r, from);
    width = cdr_u32(&r, from);
  }
  cdr_text(&r, from, p->encoding, sizeof p->encoding);
  if (!m->is_compressed) {
    (void)take(&r, 1); // order of the bytes of a sample
    step = cdr_u32(&r, from);
  }
  p->bytes = cdr_u32(&r, from);
  p->px = take(&r, p->bytes);
  if (!r.is_bad && (height > 32767 || width > 32767 || step > 1u << 20 ||
                    (!m->is_compressed && (height < 1 || width < 1 || (uint64_t)step * height > p->bytes))))
    r.is_bad = true;
  if (r.is_bad) return sv_fail(err, SV_E_FORMAT, "%.100s: a picture's message is damaged", m->topic);
  p->width_px = (int)width;
  p->height_px = (int)height;
  p->stride_bytes = (int)step;
  return SV_OK;
}
