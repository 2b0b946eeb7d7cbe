// SPDX-License-Identifier: Apache-2.0
// The gradient of a whole training step against central differences of its loss: the Gaussians to
// do it with, the optimiser's place taken by something that keeps gradients, and the comparison.
#ifndef SV_TESTS_COMMON_STEP_GRADIENT_H
#define SV_TESTS_COMMON_STEP_GRADIENT_H

#include "src/train/train.h"

#define STEP_GRADIENT_GAUSSIANS 20

// Of many quotients. Colours cannot move splats' ends, and fit best.
typedef struct {
  double diff2, size2;
  int n, n_jumps; // quotients that are not 0; that straddle a jump, dropped
} step_gradient_deviation;

typedef struct {
  step_gradient_deviation colour, shape;
} step_gradient;

// Kernels for a trainer whose steps leave the parameters as they are. Before the trainer is opened
// with them.
void step_gradient_kernels(sv_kernels *k);
// Settings without what would change parameters or the loss beside a step's gradient.
void step_gradient_settings(sv_train_cfg *cfg);
// Starts with STEP_GRADIENT_GAUSSIANS faint Gaussians within half a unit of the origin. Of
// log_scale 0.9 they are so large that none ends, is clamped or stops the others within a picture:
// without these jumps the loss is smooth.
void step_gradient_start(sv_trainer *t, float log_scale, sv_arena *arena);
// Compares all parameters in the next view or region of the order, and goes on to the one after.
void step_gradient_check(sv_trainer *t, step_gradient *sum);
// Prints what was found and asserts that the two agree: at least so many quotients, at most one
// shape in `shapes_a_jump` at a jump.
void step_gradient_agrees(const step_gradient *g, const char *what, int least_colours, int least_shapes,
                          int shapes_a_jump);

#endif
