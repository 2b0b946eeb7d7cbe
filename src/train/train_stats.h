// SPDX-License-Identifier: Apache-2.0
// A snapshot of a trainer for reports and tests: what it has done and what it works on.
// It owns nothing: all values are copies.
// It never changes the trainer, and nothing in training reads it.
#ifndef SV_TRAIN_TRAIN_STATS_H
#define SV_TRAIN_TRAIN_STATS_H

#include "src/train/train.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  uint32_t step;        // steps done, those before a resume included
  double trained_s;     // seconds of training, likewise
  int n_gaussians;      // alive and dead
  int n_moving;         // of these, in a dynamic scene
  uint32_t n_relocated; // relocations so far
  uint32_t n_renewed;   // Gaussians renewed by new exposures so far
  int n_views;          // images that are trained on
  int n_measurements;   // multiplexed measurements that are trained on
  int n_regions;        // regions of these
  float centre[3];      // of the scene, world
  float radius;         // of the scene, world units
  sv_optimizer optimizer;
  bool is_antialiased;
} sv_train_stats;

void sv_train_get_stats(const sv_trainer *t, sv_train_stats *out);

#ifdef __cplusplus
}
#endif
#endif
