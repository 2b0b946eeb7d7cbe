// SPDX-License-Identifier: Apache-2.0
// The memory of a training run: sized from dataset and options, taken from the system once, sealed.
#ifndef SV_TOOLS_TRAIN_PLAN_H
#define SV_TOOLS_TRAIN_PLAN_H

#include "src/dynamic/dynamic.h"
#include "src/prior/prior.h"
#include "src/train/driver.h"
#include "tools/lab/lab.h"

// What is attached to the trainer, and what it starts from.
typedef struct {
  sv_dynamic_cfg dynamic;
  sv_prior_cfg prior;
  int n_points; // that the first model may start from
} lab_plan_extras;

typedef struct {
  sv_arena arena;
  void *block;
  size_t bytes;
  sv_trainer trainer;
  sv_dynamic dynamic;
  sv_prior prior;
  uint8_t **pictures;      // [n views], into the arena; NULL for lenses of a measurement
  uint8_t **masks;         // [n views] of views that have one, else NULL
  uint16_t **measurements; // [n measurements], the same
  uint16_t **clear;        // [n measurements] what the lenses see through; NULL: not known
  sv_lens *lenses;         // [n views] those of all measurements, one after the other
  sv_arena scratch;        // for the start
} lab_plan;

// Carves pictures and trainer, then seals. cfg: caps are filled in here.
sv_status lab_plan_make(lab_plan *p, lab_session *s, const lab_views *v, sv_train_cfg cfg,
                        const lab_plan_extras *x, sv_err *err) SV_MUST_USE;
void lab_plan_free(lab_plan *p);

// How often the file's frames share an exposure; frames without a number are exposures of their
// own.
sv_sampling lab_sampling_of(const lab_views *v);

#endif
