// SPDX-License-Identifier: Apache-2.0
// `train --refine-poses`: bundle adjustment on matches of the training images before training,
// and poses that training moves: which views share one, and what became of it. Sub-views of one
// exposure move together; other views each for itself. Never touches held-out views.
#ifndef SV_TOOLS_TRAIN_POSES_H
#define SV_TOOLS_TRAIN_POSES_H

#include "src/train/train.h"
#include "tools/lab/lab.h"

#ifdef __cplusplus
extern "C" {
#endif

// The views' poses by bundle adjustment (tools/import/refine.h). *is_right: they explain the
// matches as they are. E_UNSUPPORTED without OpenCV, E_NOT_FOUND with too few matches.
sv_status lab_poses_adjust(lab_views *v, lab_session *se, bool *is_right, sv_err *err) SV_MUST_USE;

// Settings of the trainer for these views. is_adjusted: bundle adjustment has placed them.
void lab_poses_plan(const lab_views *v, bool is_adjusted, sv_train_cfg *cfg);
// All of the trainer's views, which are the frames in their order.
void lab_poses_set(const lab_views *v, sv_trainer *t);
// Mean motion of the poses so far; degrees and units of the scene.
typedef struct {
  int n;
  double deg, shift;
} lab_poses_moved;
lab_poses_moved lab_poses_measure(const sv_trainer *t);

// FOLDER/transforms_refined.json up to the commit: the training file of the dataset `data` with the
// poses that training ended with. All else stays as it is, so pictures are still those of `data`.
#define LAB_POSES_NAME "transforms_refined.json"
sv_status lab_poses_begin(sv_file *f, const lab_views *v, const sv_trainer *t, const char *data,
                          const char *folder, sv_err *err) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
