// SPDX-License-Identifier: Apache-2.0
// CRC-32C (Castagnoli, reflected 0x82F63B78, as in iSCSI RFC 3720): every error burst up to 32 bits
// is seen.
#ifndef SV_FORMAT_CRC32C_H
#define SV_FORMAT_CRC32C_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

// The CRC of data that follow earlier data with CRC `crc` (0 at the start). "123456789" gives
// E3069283.
uint32_t sv_crc32c(uint32_t crc, const void *data, size_t bytes);

#ifdef __cplusplus
}
#endif
#endif
