// SPDX-License-Identifier: Apache-2.0
// What numeric code computes with: the kernels of one instruction set, and the thread pool that
// runs its tasks. Renderer, losses and trainer copy it at init; the two objects it points to are
// the caller's and must outlive them. It never decides anything: results do not depend on the
// pool's thread count.
#ifndef SV_PORT_COMPUTE_H
#define SV_PORT_COMPUTE_H

#include "kernels/kernels.h"
#include "src/port/port.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  const sv_kernels *k;
  const sv_pool *pool;
} sv_compute;

#ifdef __cplusplus
}
#endif
#endif
