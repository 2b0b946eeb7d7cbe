// SPDX-License-Identifier: Apache-2.0
// A small moving scene with known truth: a still wall of Gaussians and a cluster before it that
// swings sideways, seen by a rig of two cameras that stands still, at N_TIMES times.
#ifndef SV_TESTS_COMMON_MOVING_SCENE_H
#define SV_TESTS_COMMON_MOVING_SCENE_H

#include "src/dynamic/dynamic.h"

#define MS_WIDTH   64
#define MS_HEIGHT  64
#define MS_TIMES   7
#define MS_CAMERAS 2

typedef struct {
  uint8_t px[MS_TIMES][MS_CAMERAS][MS_HEIGHT * MS_WIDTH * 3];
  sv_view view[MS_TIMES][MS_CAMERAS];
} moving_scene;

typedef struct {
  sv_train_cfg train;
  sv_dynamic_cfg dynamic;
  int held_out; // time whose images are not trained on; -1: none
} moving_scene_settings;

// Renders the truth; mem is workspace.
void moving_scene_make(moving_scene *s, void *mem, size_t bytes);
// A configuration for training on it, n Gaussians.
moving_scene_settings moving_scene_cfg(sv_deform_kind kind, int n, int n_steps);
// Trainer and motion in the arena, started. False with a failure.
bool moving_scene_start(const moving_scene *s, sv_trainer *t, sv_dynamic *dyn,
                        const moving_scene_settings *cfg, sv_compute compute, sv_arena a);
// Has every other one of the Gaussians that move go with a body, whose poses at all times are made
// up. To be called between two steps of a run that has bodies.
void moving_scene_plant_body(sv_dynamic *dyn);
// PSNR of the trained model at one time, mean over the cameras; is_still: without its motion.
double moving_scene_psnr(const moving_scene *s, sv_trainer *t, int i_time, bool is_still);

#endif
