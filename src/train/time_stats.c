// SPDX-License-Identifier: Apache-2.0
#include "src/train/time_stats.h"

#include "src/base/mathx.h"

#define LN2 0.6931471805599453

static int bin_of(double us) {
  if (!(us > 1)) return 0;
  int b = (int)(8.0 * sv_log(us) / LN2);
  return b < SV_TIME_STATS_BINS ? b : SV_TIME_STATS_BINS - 1;
}

void sv_time_stats_add(sv_time_stats *t, double seconds) {
  t->bins[bin_of(seconds * 1e6)]++;
  t->n++;
  t->sum_s += seconds;
  if (seconds > t->max_s) t->max_s = seconds;
}

double sv_time_stats_percentile_s(const sv_time_stats *t, double percent) {
  uint64_t sum = 0, want = (uint64_t)((double)t->n * percent / 100.0);
  for (int b = 0; b < SV_TIME_STATS_BINS; b++) {
    sum += t->bins[b];
    if (sum > want) {
      double edge = sv_exp((b + 1) * LN2 / 8.0) * 1e-6;
      return edge < t->max_s ? edge : t->max_s;
    }
  }
  return t->max_s;
}
