// SPDX-License-Identifier: Apache-2.0
#include "tools/lab/kmeans.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define LANES    8
#define PER_TASK 256 // points

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

// Points evenly spread over the sum of the square roots of weight times length^2: those that count.
static void seed(const lab_points *p, float *set, int n_sets) {
  const size_t dims = (size_t)p->dims;
  double total = 0, sum = 0;
  for (int pass = 0, j = 0; pass < 2; pass++)
    for (int i = 0; i < p->n && j < n_sets; i++) {
      const float *v = p->v + (size_t)i * dims;
      double length2 = 0;
      for (size_t k = 0; k < dims; k++) length2 += (double)(v[k] * v[k]);
      const double size = sqrt((double)p->weight[i] * length2);
      if (pass == 0) total += size;
      else sum += size;
      // Each point at most once; the last ones are taken when no more are left than sets.
      if (pass == 1 && (sum >= (j + 0.5) / n_sets * total || p->n - i <= n_sets - j))
        memcpy(set + (size_t)j++ * dims, v, dims * sizeof *set);
    }
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
  seed(p, set, n_sets);
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
