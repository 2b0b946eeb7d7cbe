// SPDX-License-Identifier: Apache-2.0
// A whole file in memory, as parsers get it. Name and data are the caller's.
#ifndef SV_BASE_FILE_DATA_H
#define SV_BASE_FILE_DATA_H

#include <stddef.h>

typedef struct {
  const char *name; // for messages
  const void *data;
  size_t bytes;
} sv_file_data;

#endif
