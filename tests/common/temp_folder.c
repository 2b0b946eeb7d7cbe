// SPDX-License-Identifier: Apache-2.0
#include "tests/common/temp_folder.h"

// clang-format off
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <cmocka.h>
// clang-format on
#include <stdio.h>
#include <stdlib.h>

#include "tools/common/fileio.h"

int temp_folder_make(char *path, size_t cap, const char *name) {
  const char *tmp = getenv("TMPDIR");
  int n = snprintf(path, cap, "%s/sv_%s_XXXXXX", tmp ? tmp : "/tmp", name);
  return n > 0 && (size_t)n < cap && mkdtemp(path) ? 0 : -1;
}

int temp_folder_remove(const char *path) {
  char command[600];
  int n = snprintf(command, sizeof command, "rm -rf '%s'", path);
  return n > 0 && (size_t)n < sizeof command ? system(command) : -1;
}

char *temp_folder_read(const char *path, const char *name) {
  char file[1200];
  void *data;
  size_t bytes;
  sv_err err;
  snprintf(file, sizeof file, "%.600s/%.500s", path, name);
  if (sv_file_read(file, &data, &bytes, &err) != SV_OK) fail_msg("%s", err.text);
  return data;
}
