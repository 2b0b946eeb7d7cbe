// SPDX-License-Identifier: Apache-2.0
// The file of --imu.
#include <errno.h>
#include <stdio.h>
#include <string.h>

#include "boards/board_main.h"

#define CAP_LINE 256

// One pass over the lines: counts samples, and keeps them where there is room (sample not NULL).
static sv_status pass(FILE *f, const char *path, sv_imu_sample *sample, int *n, sv_err *err) {
  char line[CAP_LINE];
  double last_s = 0;
  *n = 0;
  rewind(f);
  for (int i_line = 1; fgets(line, sizeof line, f); i_line++) {
    const size_t bytes = strlen(line);
    sv_imu_sample one;
    const sv_status s = sv_imu_parse(&one, line, bytes);
    if (s == SV_AGAIN) continue;
    if (s < 0 || (bytes == sizeof line - 1 && line[bytes - 1] != '\n'))
      return sv_fail(err, SV_E_FORMAT,
                     "--imu %s: line %d: expected a time in seconds and three accelerations in m/s^2", path,
                     i_line);
    if (*n && one.time_s < last_s)
      return sv_fail(err, SV_E_FORMAT, "--imu %s: line %d: its time is before that of the line above", path,
                     i_line);
    last_s = one.time_s;
    if (sample) sample[*n] = one;
    ++*n;
  }
  return *n ? SV_OK : sv_fail(err, SV_E_FORMAT, "--imu %s: holds no accelerations", path);
}

sv_status imu_read(sv_imu *imu, const char *path, sv_arena *arena, sv_err *err) {
  FILE *f = fopen(path, "r");
  int n = 0, again = 0;
  if (!f) return sv_fail(err, SV_E_NOT_FOUND, "--imu %s: cannot open: %s", path, strerror(errno));
  sv_status s = pass(f, path, NULL, &n, err);
  if (s >= 0) {
    sv_arena_part_begin(arena, "imu");
    sv_imu_sample *sample = SV_TAKE(arena, sv_imu_sample, n);
    s = sample ? pass(f, path, sample, &again, err)
               : sv_fail(err, SV_E_NOMEM, "--imu %s: no memory for %d accelerations", path, n);
    if (s >= 0 && again != n) s = sv_fail(err, SV_E_IO, "--imu %s: changes while it is read", path);
    *imu = (sv_imu){sample, n};
  }
  (void)fclose(f);
  return s;
}
