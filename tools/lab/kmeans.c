// SPDX-License-Identifier: Apache-2.0
#include "tools/lab/kmeans.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define LANES    8
#define PER_TASK 256 // points

static int by_value(const void *a, const void *b) {
  const float x = *(const float *)a, y = *(const float *)b;
  return (x > y) - (x < y);
}

int lab_nearest_code(const float *code, int n_codes, float x) {
  int lo = 0, hi = n_codes - 1; // the last code not above x
  while (lo < hi) {
    const int mid = (lo + hi + 1) / 2;
    if (code[mid] <= x) lo = mid;
    else hi = mid - 1;
  }
  return lo + 1 < n_codes && code[lo + 1] - x < x - code[lo] ? lo + 1 : lo;
}

// From quantiles, where many are, and evenly, for outliers. Sorted numbers fall into ranges
// between the middles of codes.
bool lab_codebook(const float *v, size_t n, float *code, int n_codes, int n_rounds) {
  float *sorted = malloc(n * sizeof *sorted);
  if (!sorted) return false;
  memcpy(sorted, v, n * sizeof *sorted);
  qsort(sorted, n, sizeof *sorted, by_value);
  const double lo = (double)sorted[0], hi = (double)sorted[n - 1];
  for (int j = 0; j < n_codes; j++) {
    const double u = (double)j / (n_codes - 1); // both ends are kept
    code[j] = j % 2 ? (float)(lo + u * (hi - lo)) : sorted[(size_t)(u * (double)(n - 1))];
  }
  code[n_codes - 1] = sorted[n - 1];
  qsort(code, (size_t)n_codes, sizeof *code, by_value);
  for (int round = 0; round < n_rounds; round++) {
    size_t at = 0;
    for (int j = 0; j < n_codes; j++) {
      const float end = j + 1 < n_codes ? 0.5f * (code[j] + code[j + 1]) : INFINITY;
      double sum = 0;
      size_t count = 0;
      for (; at < n && sorted[at] <= end; at++, count++) sum += (double)sorted[at];
      if (count && j > 0 && j + 1 < n_codes) code[j] = (float)(sum / (double)count);
    }
  }
  free(sorted);
  return true;
}

// Sets side by side, so that one instruction takes several.
typedef struct {
  const lab_points *p;
  const float *set; // [blocks][dims][LANES]
  int n_sets, *label;
} labelling;

static void label_task(void *arg, int i_task, int i_thread) {
  const labelling *l = arg;
  const int dims = l->p->dims, end = (i_task + 1) * PER_TASK < l->p->n ? (i_task + 1) * PER_TASK : l->p->n;
  (void)i_thread;
  for (int i = i_task * PER_TASK; i < end; i++) {
    const float *x = l->p->v + (size_t)i * (size_t)dims;
    float best = INFINITY;
    for (int j = 0; j < l->n_sets; j += LANES) {
      const float *set = l->set + (size_t)j * (size_t)dims;
      float d2[LANES] = {0};
      for (int k = 0; k < dims; k++)
        for (int m = 0; m < LANES; m++) d2[m] += (x[k] - set[k * LANES + m]) * (x[k] - set[k * LANES + m]);
      for (int m = 0; m < LANES && j + m < l->n_sets; m++) {
        if (d2[m] >= best) continue;
        best = d2[m];
        l->label[i] = j + m;
      }
    }
  }
}

static void label_all(const lab_points *p, const float *set, int n_sets, int *label, float *by_lanes) {
  for (int j = 0; j < n_sets; j++)
    for (int k = 0; k < p->dims; k++)
      by_lanes[((size_t)(j / LANES) * (size_t)p->dims + (size_t)k) * LANES + (size_t)(j % LANES)] =
          set[(size_t)j * (size_t)p->dims + (size_t)k];
  labelling l = {p, by_lanes, n_sets, label};
  sv_pool_run(p->pool, label_task, &l, (p->n + PER_TASK - 1) / PER_TASK);
}

bool lab_palette(const lab_points *p, float *set, int n_sets, int *label, int n_rounds) {
  const size_t dims = (size_t)p->dims;
  double *sum = malloc((size_t)n_sets * dims * sizeof *sum);
  double *mass = malloc((size_t)n_sets * sizeof *mass);
  float *by_lanes = calloc(((size_t)n_sets + LANES) * dims, sizeof *by_lanes);
  if (!sum || !mass || !by_lanes) {
    free(by_lanes);
    free(sum);
    free(mass);
    return false;
  }
  memset(label, 0, (size_t)p->n * sizeof *label);
  for (int j = 0; j < n_sets; j++) // spread over the points
    memcpy(set + (size_t)j * dims, p->v + (size_t)((double)j * p->n / n_sets) * dims, dims * sizeof *set);
  for (int round = 0; round < n_rounds; round++) {
    label_all(p, set, n_sets, label, by_lanes);
    memset(sum, 0, (size_t)n_sets * dims * sizeof *sum);
    memset(mass, 0, (size_t)n_sets * sizeof *mass);
    for (int i = 0; i < p->n; i++) {
      const double w = (double)p->weight[i];
      mass[label[i]] += w;
      for (size_t k = 0; k < dims; k++)
        sum[(size_t)label[i] * dims + k] += w * (double)p->v[(size_t)i * dims + k];
    }
    for (int j = 0; j < n_sets; j++)
      for (size_t k = 0; mass[j] > 0 && k < dims; k++)
        set[(size_t)j * dims + k] = (float)(sum[(size_t)j * dims + k] / mass[j]);
  }
  label_all(p, set, n_sets, label, by_lanes);
  free(by_lanes);
  free(sum);
  free(mass);
  return true;
}
