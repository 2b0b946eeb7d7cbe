// SPDX-License-Identifier: Apache-2.0
#include "tests/common/mcap_write.h"

#include <stdlib.h>
#include <string.h>

#include "src/format/bytes.h"

#if defined(__has_include) && __has_include(<zstd.h>)
#include <zstd.h>
#define HAS_ZSTD 1
#else
#define HAS_ZSTD 0
#endif

static const uint8_t magic[8] = {0x89, 'M', 'C', 'A', 'P', '0', '\r', '\n'};

bool mcap_can_pack(void) { return HAS_ZSTD; }

static void put(mcap_bytes *b, const void *data, size_t n) {
  if (b->bytes + n > b->cap) {
    b->cap = 2 * b->cap + n + 1024;
    b->data = realloc(b->data, b->cap);
    if (!b->data) abort();
  }
  if (n) memcpy(b->data + b->bytes, data, n);
  b->bytes += n;
}
static void put_u8(mcap_bytes *b, int v) { put(b, &(uint8_t){(uint8_t)v}, 1); }
static void put_u16(mcap_bytes *b, int v) {
  uint8_t p[2];
  sv_put_le16(p, (uint16_t)v);
  put(b, p, 2);
}
static void put_u32(mcap_bytes *b, uint32_t v) {
  uint8_t p[4];
  sv_put_le32(p, v);
  put(b, p, 4);
}
static void put_u64(mcap_bytes *b, uint64_t v) {
  uint8_t p[8];
  sv_put_le64(p, v);
  put(b, p, 8);
}
static void put_text(mcap_bytes *b, const char *s) {
  put_u32(b, (uint32_t)strlen(s));
  put(b, s, strlen(s));
}

// Takes the content.
static void put_record(mcap_bytes *to, int opcode, mcap_bytes *content) {
  put_u8(to, opcode);
  put_u64(to, content->bytes);
  put(to, content->data, content->bytes);
  free(content->data);
}

void mcap_begin(mcap_file *m) {
  mcap_bytes head = {0};
  put(&m->file, magic, sizeof magic);
  put_text(&head, "ros2");
  put_text(&head, "made for a test");
  put_record(&m->file, 1, &head);
}

void mcap_topic(mcap_file *m, int channel, const char *name, bool is_compressed) {
  mcap_bytes schema = {0}, c = {0};
  put_u16(&schema, 1 + is_compressed);
  put_text(&schema, is_compressed ? "sensor_msgs/msg/CompressedImage" : "sensor_msgs/msg/Image");
  put_text(&schema, "ros2msg");
  put_text(&schema, "std_msgs/Header header");
  put_record(&m->chunk, 3, &schema);
  put_u16(&c, channel);
  put_u16(&c, 1 + is_compressed);
  put_text(&c, name);
  put_text(&c, "cdr");
  put_u32(&c, 0); // no metadata
  put_record(&m->chunk, 4, &c);
}

// CDR, from the head's end at `from` on.
static void align(mcap_bytes *b, size_t from) {
  while ((b->bytes - from) % 4) put_u8(b, 0);
}
static void put_string(mcap_bytes *b, size_t from, const char *s) {
  align(b, from);
  put_u32(b, (uint32_t)strlen(s) + 1);
  put(b, s, strlen(s) + 1);
}

void mcap_message(mcap_bytes *b, const mcap_picture *p) {
  static const uint8_t head[4] = {0, 1, 0, 0};
  put(b, head, 4);
  const size_t from = b->bytes;
  put_u32(b, (uint32_t)(p->stamp_ns / 1000000000));
  put_u32(b, (uint32_t)(p->stamp_ns % 1000000000));
  put_string(b, from, "optical");
  if (*p->encoding) {
    align(b, from);
    put_u32(b, (uint32_t)p->height_px);
    put_u32(b, (uint32_t)p->width_px);
    put_string(b, from, p->encoding);
    put_u8(b, 0);
    align(b, from);
    put_u32(b, (uint32_t)p->stride_bytes);
  } else {
    put_string(b, from, "jpeg");
    align(b, from);
  }
  put_u32(b, (uint32_t)p->bytes);
  put(b, p->px, p->bytes);
}

void mcap_put(mcap_file *m, int channel, const mcap_picture *p) {
  mcap_bytes b = {0};
  put_u16(&b, channel);
  put_u32(&b, 0);
  put_u64(&b, (uint64_t)p->stamp_ns + 5000000);
  put_u64(&b, (uint64_t)p->stamp_ns + 5000000);
  mcap_message(&b, p);
  put_record(&m->chunk, 5, &b);
}

void mcap_chunk(mcap_file *m) {
  mcap_bytes b = {0}, *c = &m->chunk;
  put_u64(&b, 0);
  put_u64(&b, 0);
  put_u64(&b, c->bytes);
  put_u32(&b, 0);
#if HAS_ZSTD
  if (m->is_packed) {
    const size_t room = ZSTD_compressBound(c->bytes);
    uint8_t *packed = malloc(room);
    if (!packed) abort();
    const size_t n = ZSTD_compress(packed, room, c->data, c->bytes, 3);
    put_text(&b, "zstd");
    put_u64(&b, n);
    put(&b, packed, n);
    free(packed);
  }
#endif
  if (!m->is_packed) {
    put_text(&b, "");
    put_u64(&b, c->bytes);
    put(&b, c->data, c->bytes);
  }
  put_record(&m->file, 6, &b);
  c->bytes = 0;
}

void mcap_end(mcap_file *m) {
  mcap_bytes end = {0}, footer = {0};
  put_u32(&end, 0);
  put_record(&m->file, 15, &end);
  put_u64(&footer, 0);
  put_u64(&footer, 0);
  put_u32(&footer, 0);
  put_record(&m->file, 2, &footer);
  put(&m->file, magic, sizeof magic);
}

void mcap_free(mcap_file *m) {
  free(m->file.data);
  free(m->chunk.data);
}
