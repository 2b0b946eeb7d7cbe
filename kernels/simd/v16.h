// SPDX-License-Identifier: Apache-2.0
// What a vector kernel is written in: the 16-lane vocabulary of the instruction set that this
// compilation is for, V(name) for the kernel's name with that instruction set's suffix, and all
// prototypes. mk/kernels.mk compiles each <op>_vec.c once per instruction set, with -DSV_ISA=avx2
// and so on; without SV_ISA (an editor, a lint) it is the reference vocabulary.
#ifndef SV_KERNELS_V16_H
#define SV_KERNELS_V16_H

#ifndef SV_ISA
#define SV_ISA ref
#endif
#define SV_PASTE_(a, b)  a##_##b
#define SV_PASTE(a, b)   SV_PASTE_(a, b)
#define SV_STRING_(text) #text
#define SV_STRING(text)  SV_STRING_(text)
#define V(name)          SV_PASTE(name, SV_ISA)

#include "kernels/ops.h"
// Spaces would become part of the path.
// clang-format off
#include SV_STRING(kernels/simd/SV_PASTE(v16, SV_ISA).h)
// clang-format on

#endif
