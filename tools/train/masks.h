// SPDX-License-Identifier: Apache-2.0
// Co-visibility masks of a split (tools/metric/covisible.h): which pixels of its views the training
// views have seen.
#ifndef SV_TOOLS_TRAIN_MASKS_H
#define SV_TOOLS_TRAIN_MASKS_H

#include "tools/lab/lab.h"

typedef struct lab_masks lab_masks;

// v: the views to be masked, kept. train: source of the training views (its split is "train"). bg:
// what transparent images are laid over. By depth when each view of v has true depth and nothing
// moves (all frames have one time); what stands in front of the training cameras is then known from
// all depth images of the splits train, test, test_near and v. Otherwise by flow between the
// pictures.
sv_status lab_masks_open(lab_masks **out, lab_session *se, const lab_views *v, const lab_source *train,
                         const float bg[3], sv_err *err) SV_MUST_USE;
void lab_masks_close(lab_masks *m);               // also NULL
const char *lab_masks_method(const lab_masks *m); // "depth" or "flow"

// One view of v: what was loaded for it.
typedef struct {
  const lab_frame *frame;
  const uint8_t *picture; // [height][width][n_channels]
  const float *depth;     // [height][width], NULL when v has none
} lab_masked_view;

// mask [height][width] = 1: seen by enough training views. Uses all threads.
sv_status lab_masks_make(lab_masks *m, const lab_masked_view *view, uint8_t *mask, sv_err *err) SV_MUST_USE;

#endif
