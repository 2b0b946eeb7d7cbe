// SPDX-License-Identifier: Apache-2.0
#include "src/train/plateau.h"

#include "src/base/mathx.h"

#define WINDOW_S     0.5  // between two measurements, at least,
#define WINDOW_SHARE 0.15 // and of the time so far
#define FROM         0.3f // progress: before, images are trained on at reduced size
#define UNTIL        0.8f // what is left is as short as settling
#define N_LOW        2
#define SETTLE_SHARE 4 // of the steps so far: 1 / 4
#define SETTLE_LEAST 50

static double window_s(double trained_s) { return sv_maxd(WINDOW_S, WINDOW_SHARE * trained_s); }

bool sv_plateau_is_due(const sv_plateau *p, float progress, double trained_s) {
  if (!(p->least_db_per_s > 0) || p->n_steps || progress < FROM || progress > UNTIL) return false;
  return p->db == 0 || trained_s - p->at_s >= window_s(p->at_s);
}

bool sv_plateau_measured(sv_plateau *p, double db, uint32_t step, float progress, double trained_s) {
  const double gain = db - p->db, s = trained_s - p->at_s;
  const bool is_first = p->db == 0;
  p->db = db;
  p->at_s = trained_s;
  p->n_low = !is_first && gain < p->least_db_per_s * s ? p->n_low + 1 : 0;
  if (p->n_low < N_LOW) return false;
  p->from_step = step;
  p->from = progress;
  p->n_steps = step / SETTLE_SHARE > SETTLE_LEAST ? step / SETTLE_SHARE : SETTLE_LEAST;
  return true;
}

float sv_plateau_progress(const sv_plateau *p, uint32_t step, float progress) {
  if (!p->n_steps) return progress;
  const float settled = p->from + (1 - p->from) * (float)(step - p->from_step) / (float)p->n_steps;
  return settled > progress ? settled : progress;
}
