// SPDX-License-Identifier: Apache-2.0
#include "tools/lab/progress.h"

#include <stdio.h>

#define PERIOD_S 0.25

void lab_progress_start(lab_progress *p, lab_session *s) {
  double t = lab_seconds(s);
  *p = (lab_progress){.session = s, .t0_s = t, .last_s = t};
}

void lab_progress_step(lab_progress *p, long steps, long n_steps, double limit_s, double loss) {
  double keep = steps < 50 ? 1.0 - 1.0 / (double)steps : 0.98;
  p->loss = keep * p->loss + (1.0 - keep) * loss;
  double t = lab_seconds(p->session), dt = t - p->last_s;
  if (dt < PERIOD_S) return;
  p->steps_per_s = (double)(steps - p->last_steps) / dt;
  p->last_s = t, p->last_steps = steps;
  double left = n_steps > 0 ? (double)(n_steps - steps) / p->steps_per_s : limit_s - (t - p->t0_s);
  long eta = left > 0 ? (long)(left + 0.5) : 0;
  char line[160];
  if (n_steps > 0)
    snprintf(line, sizeof line, "step %ld of %ld, %.1f steps/s, loss %.4f, ETA %ld:%02ld", steps, n_steps,
             p->steps_per_s, p->loss, eta / 60, eta % 60);
  else
    snprintf(line, sizeof line, "step %ld, %.1f steps/s, loss %.4f, ETA %ld:%02ld", steps, p->steps_per_s,
             p->loss, eta / 60, eta % 60);
  p->session->console.log(p->session->console.self, SV_LOG_LIVE, line);
}
