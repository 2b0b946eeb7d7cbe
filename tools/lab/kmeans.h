// SPDX-License-Identifier: Apache-2.0
// k-means (Lloyd's rounds) for exports: a codebook of numbers, a palette of vectors. The same
// result each time.
#ifndef SV_TOOLS_LAB_KMEANS_H
#define SV_TOOLS_LAB_KMEANS_H

#include <stdbool.h>
#include <stddef.h>

#include "src/port/port.h"

// code [n_codes], rising, for the numbers v [n]. False: no memory.
bool lab_codebook(const float *v, size_t n, float *code, int n_codes, int n_rounds);
// The place of the code nearest to x; code rises.
int lab_nearest_code(const float *code, int n_codes, float x);

typedef struct {
  const float *v;      // [n][dims]
  const float *weight; // [n]
  int n, dims;
  const sv_pool *pool;
} lab_points;

// set [n_sets][dims] and label [n], the nearest set of each point. n_sets <= n. False: no memory.
bool lab_palette(const lab_points *p, float *set, int n_sets, int *label, int n_rounds);

#endif
