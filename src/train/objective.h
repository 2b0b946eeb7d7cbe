// SPDX-License-Identifier: Apache-2.0
// What the objective needs is decided by how the exposures sample the light field: the paper's
// weights per device (section 3.2 and the supplement), tuned for budgets of thousands of Gaussians
// and steps on the simulator's scenes.
#ifndef SV_TRAIN_OBJECTIVE_H
#define SV_TRAIN_OBJECTIVE_H

#include "src/train/train.h"

#ifdef __cplusplus
extern "C" {
#endif

// Up to so many exposures are few: beyond, camera motion pins geometry down by itself.
#define SV_FEW_EXPOSURES 3

typedef struct {
  int n_exposures;
  int n_sub_views;     // of an exposure
  int largest_px;      // pixels of the largest picture
  bool is_multiplexed; // their images overlap on the sensor
  bool is_moving;      // the scene moves; n_exposures then counts the places that the rig was at
  bool is_far;         // starts far from the surface though views may overlap that could have
                       // measured it
} sv_sampling;

// Sets optimizer, weights, dropout, novel views, least sizes, low-pass and supersampling in cfg,
// whose is_antialiased and n_gaussians are known by now. Captures of many exposures keep the other
// defaults.
void sv_train_set_objective(sv_train_cfg *cfg, const sv_sampling *s);

#ifdef __cplusplus
}
#endif
#endif
