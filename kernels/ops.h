// SPDX-License-Identifier: Apache-2.0
// All contracts and prototypes: a header declares sv_<name>_fn, the type of an operation; the
// functions of that type follow from variants.inc.
#ifndef SV_KERNELS_OPS_H
#define SV_KERNELS_OPS_H

#include "kernels/adam/adam.h"
#include "kernels/appearance/appearance.h"
#include "kernels/area/area.h"
#include "kernels/bin/bin.h"
#include "kernels/color/color.h"
#include "kernels/corner/corner.h"
#include "kernels/correct/correct.h"
#include "kernels/demosaic/demosaic.h"
#include "kernels/field/field.h"
#include "kernels/fma_peak/fma_peak.h"
#include "kernels/luma/luma.h"
#include "kernels/motion/motion.h"
#include "kernels/newton/newton.h"
#include "kernels/patch/patch.h"
#include "kernels/position_noise/position_noise.h"
#include "kernels/project/project.h"
#include "kernels/raster/raster.h"
#include "kernels/raw/raw.h"
#include "kernels/remap/remap.h"
#include "kernels/resize/resize.h"
#include "kernels/rgb8/rgb8.h"
#include "kernels/sort/sort.h"
#include "kernels/ssim/ssim.h"
#include "kernels/surface/surface.h"
#include "kernels/sweep/sweep.h"
#include "kernels/tv/tv.h"
#include "kernels/unpack/unpack.h"

#ifdef __cplusplus
extern "C" {
#endif

#define OP(name)                            sv_##name##_fn sv_##name##_ref;
#define VARIANT(name, isa_lower, isa_upper) sv_##name##_fn sv_##name##_##isa_lower;
#include "kernels/variants.inc"

#ifdef __cplusplus
}
#endif

#endif
