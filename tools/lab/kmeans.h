// SPDX-License-Identifier: Apache-2.0
// k-means (Lloyd's rounds) for exports: a palette of vectors. The same result each time.
#ifndef SV_TOOLS_LAB_KMEANS_H
#define SV_TOOLS_LAB_KMEANS_H

#include <stdbool.h>
#include <stddef.h>

#include "src/port/port.h"

typedef struct {
  const float *v;      // [n][dims]
  const float *weight; // [n]
  int n, dims;
  const sv_pool *pool;
} lab_points;

// set [n_sets][dims] and label [n], the nearest set of each point. n_sets <= n. False: no memory.
bool lab_palette(const lab_points *p, float *set, int n_sets, int *label, int n_rounds);

#endif
