// SPDX-License-Identifier: Apache-2.0
#include "src/format/crc32c.h"

// A CRC is linear: the table entry of a byte is the XOR of the entries of its bits. So the eight
// entries of the single bits make a table of 256 at compile time, one for each of the eight bytes
// of a step.
#define BIT(n, i, k) ((n) >> (i)&1u ? (k) : 0u)
#define ENTRY(n, a, b, c, d, e, f, g, h)                                                                     \
  (BIT(n, 0, a) ^ BIT(n, 1, b) ^ BIT(n, 2, c) ^ BIT(n, 3, d) ^ BIT(n, 4, e) ^ BIT(n, 5, f) ^ BIT(n, 6, g) ^  \
   BIT(n, 7, h))
#define R4(n, ...)                                                                                           \
  ENTRY((n) + 0u, __VA_ARGS__), ENTRY((n) + 1u, __VA_ARGS__), ENTRY((n) + 2u, __VA_ARGS__),                  \
      ENTRY((n) + 3u, __VA_ARGS__)
#define R16(n, ...)                                                                                          \
  R4(n, __VA_ARGS__), R4((n) + 4u, __VA_ARGS__), R4((n) + 8u, __VA_ARGS__), R4((n) + 12u, __VA_ARGS__)
#define R64(n, ...)                                                                                          \
  R16(n, __VA_ARGS__), R16((n) + 16u, __VA_ARGS__), R16((n) + 32u, __VA_ARGS__), R16((n) + 48u, __VA_ARGS__)
#define TABLE(...)                                                                                           \
  { R64(0u, __VA_ARGS__), R64(64u, __VA_ARGS__), R64(128u, __VA_ARGS__), R64(192u, __VA_ARGS__) }

// Row t: the CRC register after the byte 1 << i and t zero bytes.
static const uint32_t tables[8][256] = {
    TABLE(0xF26B8303u, 0xE13B70F7u, 0xC79A971Fu, 0x8AD958CFu, 0x105EC76Fu, 0x20BD8EDEu, 0x417B1DBCu,
          0x82F63B78u),
    TABLE(0x13A29877u, 0x274530EEu, 0x4E8A61DCu, 0x9D14C3B8u, 0x3FC5F181u, 0x7F8BE302u, 0xFF17C604u,
          0xFBC3FAF9u),
    TABLE(0xA541927Eu, 0x4F6F520Du, 0x9EDEA41Au, 0x38513EC5u, 0x70A27D8Au, 0xE144FB14u, 0xC76580D9u,
          0x8B277743u),
    TABLE(0xDD45AAB8u, 0xBF672381u, 0x7B2231F3u, 0xF64463E6u, 0xE964B13Du, 0xD725148Bu, 0xABA65FE7u,
          0x52A0C93Fu),
    TABLE(0x38116FACu, 0x7022DF58u, 0xE045BEB0u, 0xC5670B91u, 0x8F2261D3u, 0x1BA8B557u, 0x37516AAEu,
          0x6EA2D55Cu),
    TABLE(0xEF306B19u, 0xDB8CA0C3u, 0xB2F53777u, 0x6006181Fu, 0xC00C303Eu, 0x85F4168Du, 0x0E045BEBu,
          0x1C08B7D6u),
    TABLE(0x68032CC8u, 0xD0065990u, 0xA5E0C5D1u, 0x4E2DFD53u, 0x9C5BFAA6u, 0x3D5B83BDu, 0x7AB7077Au,
          0xF56E0EF4u),
    TABLE(0x493C7D27u, 0x9278FA4Eu, 0x211D826Du, 0x423B04DAu, 0x847609B4u, 0x0D006599u, 0x1A00CB32u,
          0x34019664u),
};

static uint32_t word(const uint8_t *p) {
  return (uint32_t)p[0] | (uint32_t)p[1] << 8 | (uint32_t)p[2] << 16 | (uint32_t)p[3] << 24;
}

uint32_t sv_crc32c(uint32_t crc, const void *data, size_t bytes) {
  const uint8_t *p = data;
  crc = ~crc;
  for (; bytes >= 8; bytes -= 8, p += 8) {
    uint32_t a = crc ^ word(p), b = word(p + 4);
    crc = tables[7][a & 255] ^ tables[6][a >> 8 & 255] ^ tables[5][a >> 16 & 255] ^ tables[4][a >> 24] ^
          tables[3][b & 255] ^ tables[2][b >> 8 & 255] ^ tables[1][b >> 16 & 255] ^ tables[0][b >> 24];
  }
  for (; bytes; bytes--) crc = crc >> 8 ^ tables[0][(crc ^ *p++) & 255];
  return ~crc;
}
