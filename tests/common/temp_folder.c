// SPDX-License-Identifier: Apache-2.0
#include "tests/common/temp_folder.h"

#include <stdio.h>
#include <stdlib.h>

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
