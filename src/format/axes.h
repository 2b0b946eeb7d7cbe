// SPDX-License-Identifier: Apache-2.0
// Axes of worlds: half turns and rotations of Gaussians, for files whose axes differ from ours. A
// half turn about one axis flips two signs of positions and of the quaternion's vector part. An SH
// coefficient flips when its polynomial is odd in these two axes together. Half turns are proper
// rotations: nothing is mirrored.
#ifndef SV_FORMAT_AXES_H
#define SV_FORMAT_AXES_H

#include <stdbool.h>

#include "src/format/gaussian.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef enum {
  SV_TURN_NONE,
  SV_TURN_X, // y and z change sign: right-down-forward <-> right-up-back (SPZ)
  SV_TURN_Z  // x and y change sign: right-down-forward <-> left-up-forward (glTF)
} sv_half_turn;

// Half turns are their own inverse.
void sv_gaussian_turn(sv_gaussian *g, sv_half_turn turn);

// The up axis of a model's world, one of six. A model whose file does not name one has COLMAP's
// axes.
#define SV_UP_DEFAULT "-y"
// "x", "-x", "y", ... False for other words.
bool sv_up_axis(const char *name, double up[3]);
// The axis nearest to a direction.
const char *sv_up_name(const float up[3]);

// The functions of degrees 1 to 3 in a direction of length 1, in the order, with the signs and
// norms of 3DGS (Kerbl et al. 2023).
void sv_sh_basis(double y[15], const double d[3]);

// A rotation of a whole model: positions, rotations, SH.
typedef struct {
  bool is_none;
  double r[9], q_wxyz[4];
  double sh[3][49]; // of degrees 1, 2, 3: [2 l + 1][2 l + 1]
} sv_turn;
// Any rotation matrix.
void sv_turn_make(sv_turn *t, const double r[9]);
// The smallest rotation from one up axis to another. An unknown word: no rotation.
void sv_turn_between(sv_turn *t, const char *up, const char *to);
// To SV_UP_DEFAULT, which the writers of SPZ, GLB and SOG expect. NULL: no rotation.
void sv_turn_upright(sv_turn *t, const char *up);
void sv_gaussian_turn_by(sv_gaussian *g, const sv_turn *t);

#ifdef __cplusplus
}
#endif
#endif
