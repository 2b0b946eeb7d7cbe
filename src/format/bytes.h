// SPDX-License-Identifier: Apache-2.0
// Little-endian numbers in byte buffers, for any byte order and alignment of the machine.
#ifndef SV_FORMAT_BYTES_H
#define SV_FORMAT_BYTES_H

#include <stdint.h>
#include <string.h>

#ifdef __cplusplus
extern "C" {
#endif

static inline uint16_t sv_le16(const uint8_t *p) { return (uint16_t)(p[0] | p[1] << 8); }
static inline uint32_t sv_le32(const uint8_t *p) {
  return (uint32_t)p[0] | (uint32_t)p[1] << 8 | (uint32_t)p[2] << 16 | (uint32_t)p[3] << 24;
}
static inline uint64_t sv_le64(const uint8_t *p) {
  return (uint64_t)sv_le32(p) | (uint64_t)sv_le32(p + 4) << 32;
}
static inline float sv_lef32(const uint8_t *p) {
  uint32_t u = sv_le32(p);
  float f;
  memcpy(&f, &u, sizeof f);
  return f;
}
static inline double sv_lef64(const uint8_t *p) {
  uint64_t u = sv_le64(p);
  double d;
  memcpy(&d, &u, sizeof d);
  return d;
}
static inline void sv_put_le16(uint8_t *p, uint16_t v) {
  p[0] = (uint8_t)v;
  p[1] = (uint8_t)(v >> 8);
}
static inline void sv_put_le32(uint8_t *p, uint32_t v) {
  for (int i = 0; i < 4; i++) p[i] = (uint8_t)(v >> (8 * i));
}
static inline void sv_put_le64(uint8_t *p, uint64_t v) {
  for (int i = 0; i < 8; i++) p[i] = (uint8_t)(v >> (8 * i));
}
static inline void sv_put_lef32(uint8_t *p, float f) {
  uint32_t u;
  memcpy(&u, &f, sizeof u);
  sv_put_le32(p, u);
}

#ifdef __cplusplus
}
#endif
#endif
