// SPDX-License-Identifier: Apache-2.0
// SPZ, Niantic's compressed splats (github.com/nianticlabs/spz, README "File Format"): fixed-point
// attributes one after another, compressed by gzip as one stream (versions 2 and 3) or by zstd as
// six (version 4). The caller does the compression itself; this room lays out and reads the bytes.
//
// Quantisation, and with it the largest error of a value in range:
//   position   24-bit fixed point with 12 fractional bits, +-2048: 2^-13 = 0.00012
//   log-scale  (ln s + 10) 16 in 8 bits, -10..5.94: 1/32
//   opacity    sigmoid in 8 bits: 1/510
//   colour     DC 0.15 + 0.5 in 8 bits, |DC| <= 3.33: 0.0131
//   rotation   version 2: x y z in 8 bits, w >= 0 follows (0.01 rad, but up to 0.2 near w = 0);
//              from 3: the three smallest, 10 bits each (0.004 rad)
//   SH         5 bits (degree 1) or 4 bits of [-1, 1), after 8: 4.5/128, 8.5/128
// The file's axes are right-up-back (RUB). Models are assumed right-down-forward (-y is up), as in
// 3DGS PLY files of COLMAP scenes, and turned by 180 degrees about x. Readers that keep the file's
// numbers show y and z negated.
// The unit of lengths, where it is known: in version 4 an extension record (type 0x53560001) before
// the table, in versions 2 and 3 a subfield "SV" of gzip's header. Other readers skip both.
#ifndef SV_FORMAT_SPZ_H
#define SV_FORMAT_SPZ_H

#include <stdbool.h>
#include <stdint.h>

#include "src/base/file_data.h"
#include "src/base/unit.h"
#include "src/format/gaussian.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_SPZ_N_STREAMS    6
#define SV_SPZ_HEADER_BYTES 16 // versions 2, 3: the first bytes of the gzip stream
#define SV_SPZ_UNIT_BYTES   12 // of the subfield
#define SV_SPZ_HEAD4_BYTES  (48 + 16 * SV_SPZ_N_STREAMS)

typedef struct {
  int version; // 2, 3, 4
  uint32_t n;
  int sh_degree;
  bool is_mip;
  int fractional_bits; // of positions; writing: 0 for 12
  sv_unit unit;
} sv_spz;

// Bytes of the attributes, header not included; 0 when the settings are out of range.
size_t sv_spz_bytes(const sv_spz *z);
// Attribute stream i (positions, opacities, colours, scales, rotations, SH) inside them.
void sv_spz_stream(const sv_spz *z, int i, size_t *at, size_t *bytes);
// Gaussian i of z->n into the attributes. Values out of range are clamped.
void sv_spz_put(const sv_spz *z, uint8_t *attributes, uint32_t i, const sv_gaussian *g);
void sv_spz_get(const sv_spz *z, const uint8_t *attributes, uint32_t i, sv_gaussian *out);

// Versions 2 and 3: gzip's extra field with the unit, 0 bytes when it is not known; and back.
size_t sv_spz_put_extra(const sv_spz *z, uint8_t out[SV_SPZ_UNIT_BYTES]);
void sv_spz_get_extra(sv_spz *z, const uint8_t *extra, size_t bytes);

void sv_spz_header(const sv_spz *z, uint8_t out[SV_SPZ_HEADER_BYTES]);
// Version 4: header and table, from the compressed sizes of the streams (an empty stream is left
// out); returns its length. The compressed streams follow.
size_t sv_spz_head4(const sv_spz *z, const uint64_t compressed[SV_SPZ_N_STREAMS],
                    uint8_t out[SV_SPZ_HEAD4_BYTES]);

// Versions 2 and 3: reads the header of the decompressed stream.
sv_status sv_spz_open(sv_spz *z, const sv_file_data *stream, sv_err *err) SV_MUST_USE;
// Version 4: reads header and table; at[i] and compressed[i] say where stream i lies in the file (0
// bytes: empty).
sv_status sv_spz_open4(sv_spz *z, const sv_file_data *file, size_t at[SV_SPZ_N_STREAMS],
                       size_t compressed[SV_SPZ_N_STREAMS], sv_err *err) SV_MUST_USE;
bool sv_spz_is_4(const uint8_t *data, size_t bytes); // "NGSP" in plain

#ifdef __cplusplus
}
#endif
#endif
