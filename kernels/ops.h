// SPDX-License-Identifier: Apache-2.0
// All contracts at once.
#ifndef SV_KERNELS_OPS_H
#define SV_KERNELS_OPS_H

#include "kernels/adam/adam.h"
#include "kernels/bin/bin.h"
#include "kernels/project/project.h"
#include "kernels/raster/raster.h"
#include "kernels/sort/sort.h"
#include "kernels/unpack/unpack.h"
#include "kernels/ssim/ssim.h"

#endif
