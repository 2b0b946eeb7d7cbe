// SPDX-License-Identifier: Apache-2.0
// A synthetic training scene of any size, for timing.
#ifndef SV_TOOLS_LAB_BENCH_H
#define SV_TOOLS_LAB_BENCH_H

#include "tools/lab/lab.h"

typedef struct {
  sv_trainer t;
  void *block;
  uint8_t *picture;
  const sv_pool *pool;
} lab_bench_scene;

// n Gaussians that together cover the picture about ten deep, as trained models do: half on a surface, with
// log-normal sizes, flat, opacities of 0.05 to 0.95. One training view with a smooth, noisy picture.
sv_status lab_bench_scene_make(lab_bench_scene *b, const sv_kernels *k, const sv_pool *pool, int n,
                               int width_px, int height_px, uint64_t seed, sv_err *err) SV_MUST_USE;
void lab_bench_scene_free(lab_bench_scene *b);

typedef struct {
  const char *op, *isa;
  double ns_per_item;
  const char *item; // what an item is
} lab_kernel_time;
#define LAB_CAP_KERNEL_TIMES 64
// Times the kernels of a training step, one thread, each variant of this CPU that `mask` allows.
sv_status lab_bench_kernels(uint32_t mask, const sv_clock *clock, uint64_t seed, lab_kernel_time *out, int *n,
                            sv_err *err) SV_MUST_USE;

double lab_median(double *v, int n); // sorts v

#endif
