// SPDX-License-Identifier: Apache-2.0
// Which image a step of a moving scene takes, how large it is, and how much it counts
// (curriculum.c).
#ifndef SV_DYNAMIC_CURRICULUM_H
#define SV_DYNAMIC_CURRICULUM_H

#include "src/dynamic/dynamic.h"

#ifdef __cplusplus
extern "C" {
#endif

// Hook of a step: what it takes.
void sv_dynamic_choose_view(sv_dynamic *dyn, sv_train_choice *c);
// Whether a time is trained on already.
bool sv_dynamic_has_time(const sv_dynamic *dyn, float time, float progress);
// Reduction at which the images of a time that was just added are taken; 1: as progress says.
int sv_dynamic_min_scale(const sv_dynamic *dyn, float time, float progress);
// An image whose lens sees less of the scene than is usual, or sees it smaller, gets fewer turns:
// the ratio of its focal length to the usual one, or the reverse, at least cfg.share_min of a turn.
// A phone's long lens would take a third of the steps for a ninth of what is to be seen, and what
// its short one sees another sees larger.
float sv_dynamic_turn_share(const sv_dynamic *dyn, const sv_view *view);
// In a turn an image counts by the same ratio where its lens is narrower than is usual, else in
// full. A loss is the mean of an image's pixels, so a long lens says as much of a ninth of what is
// seen as others say of all: Adam's steps and relocation would follow it, and shorten the steps for
// the others.
float sv_dynamic_weight(const sv_dynamic *dyn, const sv_view *view);
// The median solid angle of the views, and its focal length.
void sv_dynamic_set_usual_view(sv_dynamic *dyn);
// Functions of position that take part: no more than the times trained on so far can tell.
int sv_dynamic_n_functions(const sv_dynamic *dyn, float progress);

#ifdef __cplusplus
}
#endif
#endif
