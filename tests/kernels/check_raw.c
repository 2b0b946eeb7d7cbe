// SPDX-License-Identifier: Apache-2.0
#include <string.h>

#include "tests/kernels/check.h"

// Packs samples as a sensor sends them; the bytes of a row.
static size_t pack(int container, const unsigned *v, int n, uint8_t *out) {
  memset(out, 0, (size_t)(2 * n + 8));
  for (int x = 0; x < n; x++) switch (container) {
    case SV_RAW_16LE:
      out[2 * x] = (uint8_t)v[x];
      out[2 * x + 1] = (uint8_t)(v[x] >> 8);
      break;
    case SV_RAW_10P:
      out[x / 4 * 5 + x % 4] = (uint8_t)(v[x] >> 2);
      out[x / 4 * 5 + 4] |= (uint8_t)((v[x] & 3) << x % 4 * 2);
      break;
    case SV_RAW_12P:
      out[x / 2 * 3 + x % 2] = (uint8_t)(v[x] >> 4);
      out[x / 2 * 3 + 2] |= (uint8_t)((v[x] & 15) << x % 2 * 4);
      break;
    default: out[x] = (uint8_t)v[x];
    }
  switch (container) {
  case SV_RAW_16LE: return (size_t)(2 * n);
  case SV_RAW_10P: return (size_t)((n + 3) / 4 * 5);
  case SV_RAW_12P: return (size_t)((n + 1) / 2 * 3);
  default: return (size_t)n;
  }
}

static void one_case(ck *c, int container, int bits, int w) {
  unsigned v[2][80];
  uint8_t bytes[2][200];
  size_t row = 0;
  ck_begin(c, "container %d, %d bits, %d px", container, bits, w);
  uint8_t *table = ck_bytes(c, 4 * SV_RAW_TABLE);
  ck_fill_bytes(c, table, 4 * SV_RAW_TABLE);
  for (int y = 0; y < 2; y++) {
    for (int x = 0; x < w; x++) v[y][x] = sv_rng_u32(&c->rng) >> (32 - bits);
    v[y][0] = (1u << bits) - 1;
    row = pack(container, v[y], w, bytes[y]);
  }
  uint8_t *src = ck_bytes_at_end(c, 2 * row), *dst = ck_bytes(c, (size_t)(2 * w));
  memcpy(src, bytes[0], row);
  memcpy(src + row, bytes[1], row);
  int shift = bits > 12 ? bits - 12 : 0;
  sv_raw_args a = {.container = (sv_raw_container)container,
                   .shift = shift,
                   .src = src,
                   .src_stride_bytes = row,
                   .width_px = w,
                   .dst = dst,
                   .dst_stride_bytes = (size_t)w,
                   .row1 = 2};
  for (int k = 0; k < 4; k++) a.table[k] = table + k * SV_RAW_TABLE;
  c->var.raw(&a);
  for (int y = 0; y < 2; y++)
    for (int x = 0; x < w; x++) {
      int must = table[((x & 1) + 2 * y) * SV_RAW_TABLE + (v[y][x] >> shift)];
      ck_true(c, dst[y * w + x] == must, "(%d,%d) is %d, must be %d", x, y, dst[y * w + x], must);
    }
}

static void check_raw(ck *c) {
  for (int w = 1; w < 34; w++) {
    one_case(c, SV_RAW_8, 8, w);
    one_case(c, SV_RAW_16LE, 10, w);
    one_case(c, SV_RAW_16LE, 12, w);
    one_case(c, SV_RAW_16LE, 16, w);
    one_case(c, SV_RAW_10P, 10, w);
    one_case(c, SV_RAW_12P, 12, w);
  }
  // A word that is larger than its bits allow stays within the table.
  ck_begin(c, "too large");
  uint8_t *table = ck_bytes(c, SV_RAW_TABLE), dst = 0, src[2] = {0xff, 0xff};
  memset(table, 7, SV_RAW_TABLE);
  sv_raw_args a = {.container = SV_RAW_16LE, .src = src, .width_px = 1, .dst = &dst, .row1 = 1};
  for (int k = 0; k < 4; k++) a.table[k] = table;
  c->var.raw(&a);
  ck_true(c, dst == 7, "the table's end is not held");
}

static void run(void *arg, const sv_kernels *k) { k->raw(arg); }
static void bench_raw(ck *c) {
  ck_begin(c, "bench");
  uint8_t *src = ck_bytes(c, 800 * 480), *table = ck_bytes(c, SV_RAW_TABLE);
  ck_fill_bytes(c, src, 800 * 480);
  ck_fill_bytes(c, table, SV_RAW_TABLE);
  sv_raw_args a = {.container = SV_RAW_10P,
                   .src = src,
                   .src_stride_bytes = 800,
                   .width_px = 640,
                   .dst = ck_bytes(c, 640 * 480),
                   .dst_stride_bytes = 640,
                   .row1 = 480};
  for (int k = 0; k < 4; k++) a.table[k] = table;
  ck_time(c, "640x480 10P", 640 * 480, run, &a);
}
CK_REGISTER(raw, check_raw, bench_raw)
