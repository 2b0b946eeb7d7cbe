// SPDX-License-Identifier: Apache-2.0
// Optional datasets for tests: SV_SHARED names a folder that holds data/<dataset>/... . Tests skip without.
#ifndef SV_TESTS_UNIT_SHARED_DATA_H
#define SV_TESTS_UNIT_SHARED_DATA_H

#include <dirent.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

// Calls fn for each file of each dataset folder whose name starts with `prefix` and ends with `suffix`.
static inline void shared_for_each(const char *prefix, const char *suffix,
                                   void (*fn)(const char *path, const char *data, size_t bytes, void *arg),
                                   void *arg) {
  const char *root = getenv("SV_SHARED");
  char folder[512], path[1024];
  if (!root) return;
  snprintf(folder, sizeof folder, "%s/data", root);
  DIR *sets = opendir(folder);
  for (struct dirent *e; sets && (e = readdir(sets));) {
    if (e->d_name[0] == '.') continue;
    snprintf(path, sizeof path, "%s/%s", folder, e->d_name);
    DIR *files = opendir(path);
    for (struct dirent *f; files && (f = readdir(files));) {
      size_t n = strlen(f->d_name), m = strlen(suffix);
      if (strncmp(f->d_name, prefix, strlen(prefix)) != 0 || n < m || strcmp(f->d_name + n - m, suffix) != 0)
        continue;
      snprintf(path, sizeof path, "%s/%s/%s", folder, e->d_name, f->d_name);
      FILE *in = fopen(path, "rb");
      if (!in) continue;
      fseek(in, 0, SEEK_END);
      long bytes = ftell(in);
      rewind(in);
      char *data = (char *)malloc((size_t)bytes + 1);
      if (data && fread(data, 1, (size_t)bytes, in) == (size_t)bytes) fn(path, data, (size_t)bytes, arg);
      free(data);
      fclose(in);
    }
    if (files) closedir(files);
  }
  if (sets) closedir(sets);
}

#endif
