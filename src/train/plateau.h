// SPDX-License-Identifier: Apache-2.0
// When training is done: PSNR on pixels that are kept from training no longer rises by a given rate
// in two windows of time. Then the schedules are run to their end within a quarter of the steps
// made so far, which settles the model. Owns this state alone: it never renders, and reads no
// clock.
#ifndef SV_TRAIN_PLATEAU_H
#define SV_TRAIN_PLATEAU_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  double least_db_per_s; // training that wins less is done; 0: it runs to its limits
  double at_s, db;       // last measurement, in seconds of training; 0 dB: none yet
  int n_low;             // windows in a row that won less
  uint32_t from_step;    // where settling began
  uint32_t n_steps;      // of settling; 0: not yet
  float from;            // progress there, 0 to 1
} sv_plateau;

// Whether PSNR is to be measured now, at this progress and time of training.
bool sv_plateau_is_due(const sv_plateau *p, float progress, double trained_s);
// PSNR in dB as measured at a step; true: settling begins.
bool sv_plateau_measured(sv_plateau *p, double db, uint32_t step, float progress, double trained_s);
// The progress that the schedules see at a step, where it would be `progress` without settling.
float sv_plateau_progress(const sv_plateau *p, uint32_t step, float progress);

#ifdef __cplusplus
}
#endif
#endif
