// SPDX-License-Identifier: Apache-2.0
#include "tools/pictures/opaque.h"

#include <math.h>

void lab_make_opaque(sv_gaussians *to, const sv_gaussians *from, int n_layers) {
  for (int i = 0; i < from->n; i++) {
    sv_gaussian v;
    sv_gaussians_get(from, i, &v);
    const double through = pow(1 / (1 + exp((double)v.opacity_logit)), n_layers);
    v.opacity_logit = (float)log(fmax(1 - through, 1e-12) / fmax(through, 1e-12));
    sv_gaussians_put(to, i, &v);
  }
}
