// SPDX-License-Identifier: Apache-2.0
// The live line of a training: steps, speed, smoothed loss, time left.
#ifndef SV_TOOLS_LAB_PROGRESS_H
#define SV_TOOLS_LAB_PROGRESS_H

#include "tools/lab/lab.h"

typedef struct {
  lab_session *session;
  double t0_s, last_s, loss; // loss: mean over about the last 50 steps
  long last_steps;
  double steps_per_s; // of the last interval
} lab_progress;

void lab_progress_start(lab_progress *p, lab_session *s);
// After each step; prints at most a few times a second. n_steps 0: limit_s holds.
void lab_progress_step(lab_progress *p, long steps, long n_steps, double limit_s, double loss);

#endif
