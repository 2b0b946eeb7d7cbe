// SPDX-License-Identifier: Apache-2.0
// The file tools/weights/lpips_squeeze.bin, linked into the program.
#ifndef SV_TOOLS_METRIC_LPIPS_WEIGHTS_H
#define SV_TOOLS_METRIC_LPIPS_WEIGHTS_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

extern const uint8_t sv_lpips_weights[], sv_lpips_weights_end[];
size_t sv_lpips_weights_bytes(void);

#ifdef __cplusplus
}
#endif
#endif
