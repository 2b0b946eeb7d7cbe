// SPDX-License-Identifier: Apache-2.0
// The kernel table. A caller owns one sv_kernels, fills it once, and calls through it; nothing here
// has state. Each op's contract is in kernels/<op>/<op>.h.
#ifndef SV_KERNELS_KERNELS_H
#define SV_KERNELS_KERNELS_H

#include <stdbool.h>
#include <stdint.h>

#include "kernels/ops.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef enum { SV_ISA_REF = 0, SV_ISA_SSE41, SV_ISA_AVX2, SV_ISA_AVX512, SV_ISA_NEON, SV_N_ISAS } sv_isa;
#define SV_ISA_BIT(isa) (1u << (isa))

typedef struct {
#define OP(name) sv_##name##_fn *name;
#define VARIANT(name, isa_lower, isa_upper)
#include "kernels/variants.inc"
  sv_isa isa; // the highest one in use
} sv_kernels;

// ISAs that this CPU can run and this build contains; bit SV_ISA_REF is always set.
uint32_t sv_cpu_isas(void);
const char *sv_isa_name(sv_isa isa);  // "ref", "sse41", ...
int sv_isa_by_name(const char *name); // -1 when unknown
// Whether op ("raster", see kernels/variants.inc) has a variant of its own for the ISA, on any CPU.
bool sv_kernel_exists(const char *op, sv_isa isa);
// Fills the table: reference first, then upwards whatever isa_mask & sv_cpu_isas() allows.
void sv_kernels_init(sv_kernels *k, uint32_t isa_mask);
// isa_mask that pins one ISA (and falls back to the reference where it has no variant).
static inline uint32_t sv_isa_only(sv_isa isa) { return SV_ISA_BIT(SV_ISA_REF) | SV_ISA_BIT(isa); }

#ifdef __cplusplus
}
#endif
#endif
