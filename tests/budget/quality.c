// SPDX-License-Identifier: Apache-2.0
#include "tests/budget/quality.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define RUN                                                                                                  \
  "train --data tests/data/mic_200 --scale 2 --exposures 8 --threads 1 --gaussians 1000 --steps 100 --quiet"

static const char *programs(void) { return getenv("SV_BIN") ? getenv("SV_BIN") : "build/sim-x86/bin"; }

// What stands behind `key` in a file.
static bool number_behind(const char *path, const char *key, double *out) {
  static char text[1 << 16];
  FILE *f = fopen(path, "r");
  const size_t n = f ? fread(text, 1, sizeof text - 1, f) : 0;
  if (f) fclose(f);
  text[n] = 0;
  const char *at = strstr(text, key);
  if (at) *out = strtod(at + strlen(key), NULL);
  return at != NULL;
}

bool quality_count(counts_table *t, const char *folder, char *err, size_t cap) {
  char command[3000], path[1200];
  double n = 0;
  snprintf(path, sizeof path, "%s/command", folder);
  snprintf(command, sizeof command,
           "SV_ISA=avx2 valgrind -q --tool=callgrind --callgrind-out-file='%s' '%s/subview-lab' " RUN
           " --out '%s/counted' >/dev/null 2>&1",
           path, programs(), folder);
  if (t->n_rows < COUNTS_CAP_ROWS && system(command) == 0 && number_behind(path, "\nsummary: ", &n)) {
    counts_row *r = &t->row[t->n_rows++];
    *r = (counts_row){.isa = "avx2", .function = QUALITY_ROW, .instructions = (uint64_t)n};
    return true;
  }
  snprintf(err, cap, "callgrind did not count the command: %.1000s", command);
  return false;
}

double quality_psnr(const char *folder) {
  char command[3000], path[1200];
  double psnr = 0;
  snprintf(path, sizeof path, "%s/scored/train.json", folder);
  snprintf(command, sizeof command,
           "SV_ISA=avx2 '%s/subview-lab' " RUN " --eval --out '%s/scored' >/dev/null 2>&1", programs(),
           folder);
  return system(command) == 0 && number_behind(path, "\"psnr\":", &psnr) ? psnr : 0;
}
