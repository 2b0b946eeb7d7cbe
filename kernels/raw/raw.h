// SPDX-License-Identifier: Apache-2.0
// Samples of a sensor (8 bits, 10..16 in 16-bit words, MIPI CSI-2 RAW10 and RAW12: MIPI Alliance
// specification for CSI-2, "RAW10", "RAW12") -> bytes, through a table for each place of the 2 x 2
// pattern. Table look-ups: there is only the reference.
#ifndef SV_KERNELS_RAW_H
#define SV_KERNELS_RAW_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

// A table is indexed by the sample's 12 highest bits, 8 and 10 bits as they are.
#define SV_RAW_TABLE 4096

typedef enum { SV_RAW_8, SV_RAW_16LE, SV_RAW_10P, SV_RAW_12P } sv_raw_container;

typedef struct {
  sv_raw_container container;
  int shift;          // sample >> shift is the index: 4 for 16-bit samples, else 0
  const uint8_t *src; // [rows][src_stride_bytes]
  size_t src_stride_bytes;
  int width_px;
  // [SV_RAW_TABLE] of place x & 1 + 2 (y & 1); indices beyond it count as its last
  const uint8_t *table[4];
  uint8_t *dst; // [rows][dst_stride_bytes]
  size_t dst_stride_bytes;
  int row0, row1;
} sv_raw_args;

typedef void sv_raw_fn(const sv_raw_args *a);

#ifdef __cplusplus
}
#endif
#endif
