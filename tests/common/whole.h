// SPDX-License-Identifier: Apache-2.0
// Whether a saved file is whole by its own account: checksums, a JSON object's end, a JPEG's end, a
// PLY's length. For tests that kill programs, or cut the power, while they save.
#ifndef SV_TESTS_COMMON_WHOLE_H
#define SV_TESTS_COMMON_WHOLE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

// The file's bytes and a zero byte; the caller frees them. NULL: it cannot be read.
uint8_t *whole_read(const char *path, size_t *bytes);
// False also for names of no known kind.
bool whole_is(const char *name, const uint8_t *data, size_t bytes);

#ifdef __cplusplus
}
#endif
#endif
