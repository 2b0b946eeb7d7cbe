// SPDX-License-Identifier: Apache-2.0
// `train --refine-poses`: which views share a pose, and what training made of it. Sub-views of one
// exposure move together; other views each for itself. Never touches held-out views.
#ifndef SV_TOOLS_TRAIN_POSES_H
#define SV_TOOLS_TRAIN_POSES_H

#include "src/train/train.h"
#include "tools/dataset/dataset.h"

#ifdef __cplusplus
extern "C" {
#endif

// Settings of the trainer for these views.
void lab_poses_plan(const lab_views *v, sv_train_cfg *cfg);
// All of the trainer's views, which are the frames in their order.
void lab_poses_set(const lab_views *v, sv_trainer *t);
// Mean motion of the poses so far; degrees and units of the scene.
typedef struct {
  int n;
  double deg, shift;
} lab_poses_moved;
lab_poses_moved lab_poses_measure(const sv_trainer *t);

#ifdef __cplusplus
}
#endif
#endif
