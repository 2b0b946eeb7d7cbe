// SPDX-License-Identifier: Apache-2.0
// Files as one ZIP archive without compression (APPNOTE.TXT of PKWARE, version 6.3.10): for what is
// compressed already.
#ifndef SV_TOOLS_LAB_ZIP_H
#define SV_TOOLS_LAB_ZIP_H

#include "tools/common/fileio.h"

typedef struct {
  const char *name;
  const uint8_t *data;
  size_t bytes;
} lab_zip_entry;

// E_RANGE above 4 GiB in all. The date of the files is 1980-01-01, so that the same files make the
// same archive.
sv_status lab_zip_write(const char *path, const lab_zip_entry *entry, int n, sv_err *err) SV_MUST_USE;

#endif
