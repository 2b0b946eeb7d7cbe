// SPDX-License-Identifier: Apache-2.0
// Durations as a histogram: adds in constant time and memory, answers mean, percentiles and
// maximum. Owns nothing beyond its own struct. All zero is empty. Never reads a clock.
#ifndef SV_TRAIN_TIME_STATS_H
#define SV_TRAIN_TIME_STATS_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define SV_TIME_STATS_BINS 256

// Bins of an eighth of an octave, from 1 microsecond.
typedef struct {
  uint32_t bins[SV_TIME_STATS_BINS];
  uint64_t n;
  double sum_s, max_s;
} sv_time_stats;

void sv_time_stats_add(sv_time_stats *t, double seconds);
// The upper edge of the bin, never above the maximum; 0 when nothing was added.
double sv_time_stats_percentile_s(const sv_time_stats *t, double percent);

#ifdef __cplusplus
}
#endif
#endif
