// SPDX-License-Identifier: Apache-2.0
// A folder of a test program's own, under TMPDIR or /tmp.
#ifndef SV_TESTS_COMMON_TEMP_FOLDER_H
#define SV_TESTS_COMMON_TEMP_FOLDER_H

#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

// Makes sv_NAME_ and six characters and writes its path. 0; -1: it cannot be made, or cap is too small.
int temp_folder_make(char *path, size_t cap, const char *name);
int temp_folder_remove(const char *path); // with all that is in it; 0 when it is gone
// A file below it, ended by a zero; the caller frees it. Fails the test when it cannot be read.
char *temp_folder_read(const char *path, const char *name);

#ifdef __cplusplus
}
#endif
#endif
