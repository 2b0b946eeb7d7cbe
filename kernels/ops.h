// SPDX-License-Identifier: Apache-2.0
// All contracts at once.
#ifndef SV_KERNELS_OPS_H
#define SV_KERNELS_OPS_H

#endif
