// SPDX-License-Identifier: Apache-2.0
// The .splat format of web viewers: 32 bytes a Gaussian, no header: float x y z, float scale
// (linear) x y z, uint8 R G B A, uint8 quaternion w x y z as q * 128 + 128. No view-dependent
// colour.
#ifndef SV_FORMAT_SPLAT_FILE_H
#define SV_FORMAT_SPLAT_FILE_H

#include <stdint.h>

#include "src/format/gaussian.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_SPLAT_BYTES 32

void sv_splat_encode(const sv_gaussian *g, uint8_t out[SV_SPLAT_BYTES]);
void sv_splat_decode(const uint8_t in[SV_SPLAT_BYTES], sv_gaussian *out);
// Sort key: volume of the ellipsoid times opacity. Viewers show the file while it loads, so write
// the largest first.
float sv_splat_order(const sv_gaussian *g);

#ifdef __cplusplus
}
#endif
#endif
