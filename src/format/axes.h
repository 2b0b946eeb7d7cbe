// SPDX-License-Identifier: Apache-2.0
// Half turns of a Gaussian about one axis, for files whose axes differ from ours in two signs. Positions and the
// vector part of the quaternion change the same two signs; an SH coefficient changes its sign when its polynomial is
// odd in the two axes together. The three half turns are proper rotations: nothing is mirrored.
#ifndef SV_FORMAT_AXES_H
#define SV_FORMAT_AXES_H

#include "src/format/gaussian.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef enum {
  SV_TURN_NONE,
  SV_TURN_X, // y and z change sign: right-down-forward <-> right-up-back (SPZ)
  SV_TURN_Z  // x and y change sign: right-down-forward <-> left-up-forward (glTF)
} sv_half_turn;

// Its own inverse.
void sv_gaussian_turn(sv_gaussian *g, sv_half_turn turn);

#ifdef __cplusplus
}
#endif
#endif
