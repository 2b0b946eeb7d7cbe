// SPDX-License-Identifier: Apache-2.0
// Depth of surfaces: the expected depth of a model lies behind its surface, as light passes
// Gaussians that are not opaque and is absorbed by those behind. Rendered with the opacity of
// several layers of each Gaussian it does not. Mean error of a mesh in the simulator's scenes with
// 1, 4 and 8 layers: 1.2, 0.31 and 0.45 % of the distance.
#ifndef SV_TOOLS_PICTURES_OPAQUE_H
#define SV_TOOLS_PICTURES_OPAQUE_H

#include "src/splat/gaussians.h"

#define LAB_LAYERS 4

// to: as large as from. 1 - (1 - opacity)^n_layers.
void lab_make_opaque(sv_gaussians *to, const sv_gaussians *from, int n_layers);

#endif
