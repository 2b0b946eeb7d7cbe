// SPDX-License-Identifier: Apache-2.0
#include "src/train/train_stats.h"

#include <string.h>

void sv_train_get_stats(const sv_trainer *t, sv_train_stats *out) {
  *out = (sv_train_stats){
      .step = t->step,
      .trained_s = t->trained_s,
      .n_gaussians = t->g.n,
      .n_relocated = t->n_relocated,
      .n_views = t->n_views,
      .n_measurements = t->n_measurements,
      .n_regions = t->n_regions,
      .radius = t->radius,
      .optimizer = t->cfg.optimizer,
      .is_antialiased = t->cfg.is_antialiased,
  };
  if (SV_TRAIN_HAS(t, count)) t->hooks->count(t->hooked, &out->n_moving, &out->n_renewed);
  memcpy(out->centre, t->centre, sizeof out->centre);
}
