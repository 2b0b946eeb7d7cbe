// SPDX-License-Identifier: Apache-2.0
// Which kernels a program uses: all that this CPU runs, or the ones that the user pinned.
// Owns nothing.
// Never reads the environment: the caller does.
#ifndef SV_RUN_ISA_H
#define SV_RUN_ISA_H

#include "kernels/kernels.h"
#include "src/base/status.h"

#ifdef __cplusplus
extern "C" {
#endif

// `name` is the value of the environment variable SV_ISA: NULL and "" are all of them. *mask: for
// sv_kernels_init. E_ARG for an unknown name, E_UNSUPPORTED when this build or CPU has no such
// kernels.
sv_status sv_isa_choose(const char *name, uint32_t *mask, sv_err *err) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
