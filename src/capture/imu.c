// SPDX-License-Identifier: Apache-2.0
#include "src/capture/imu.h"

#include <string.h>

#include "src/base/str.h"

static bool is_between(char c) {
  return c == ',' || c == ';' || c == ' ' || c == '\t' || c == '\r' || c == '\n';
}

sv_status sv_imu_parse(sv_imu_sample *out, const char *line, size_t bytes) {
  double v[4];
  size_t at = 0;
  while (at < bytes && is_between(line[at])) at++;
  const bool is_number = at < bytes && strchr("+-.0123456789", line[at]) && line[at];
  if (!is_number) return SV_AGAIN;
  for (int i = 0; i < 4; i++) {
    size_t end = at;
    while (end < bytes && !is_between(line[end])) end++;
    if (!sv_parse_double(line + at, end - at, &v[i])) return SV_E_FORMAT;
    for (at = end; at < bytes && is_between(line[at]);) at++;
  }
  *out = (sv_imu_sample){v[0], {v[1], v[2], v[3]}};
  return SV_OK;
}

bool sv_imu_at(const sv_imu *imu, sv_ns time_ns, double a[3]) {
  const double time_s = sv_ns_to_s(time_ns);
  int lo = 0, hi = imu->n, n = 0;
  while (lo < hi) { // the first that is near enough
    const int mid = lo + (hi - lo) / 2;
    if (imu->sample[mid].time_s < time_s - SV_IMU_REACH_S) lo = mid + 1;
    else hi = mid;
  }
  memset(a, 0, 3 * sizeof *a);
  for (int i = lo; i < imu->n && imu->sample[i].time_s <= time_s + SV_IMU_REACH_S; i++, n++)
    for (int k = 0; k < 3; k++) a[k] += imu->sample[i].a[k];
  for (int k = 0; n && k < 3; k++) a[k] /= n;
  return n > 0;
}
