// SPDX-License-Identifier: Apache-2.0
#include "kernels/kernels.h"

#include <stddef.h>
#include <string.h>
#if defined(__x86_64__) || defined(__i386__)
#include <cpuid.h>
#endif

#ifndef SV_HAVE_SSE41
#define SV_HAVE_SSE41 0
#endif
#ifndef SV_HAVE_AVX2
#define SV_HAVE_AVX2 0
#endif
#ifndef SV_HAVE_AVX512
#define SV_HAVE_AVX512 0
#endif
#ifndef SV_HAVE_NEON
#define SV_HAVE_NEON 0
#endif

static const char *const isa_names[SV_N_ISAS] = {"ref", "sse41", "avx2", "avx512", "neon"};

uint32_t sv_cpu_isas(void) {
  uint32_t mask = SV_ISA_BIT(SV_ISA_REF);
#if SV_HAVE_SSE41 || SV_HAVE_AVX2 || SV_HAVE_AVX512
  __builtin_cpu_init();
  if (SV_HAVE_SSE41 && __builtin_cpu_supports("sse4.1")) mask |= SV_ISA_BIT(SV_ISA_SSE41);
  // Not every compiler's __builtin_cpu_supports knows LZCNT: bit 5 of ECX of CPUID leaf 0x80000001.
  unsigned eax, ebx, ecx = 0, edx;
  const bool has_lzcnt = __get_cpuid(0x80000001, &eax, &ebx, &ecx, &edx) && (ecx & 1u << 5);
  const bool has_bits = has_lzcnt && __builtin_cpu_supports("bmi") && __builtin_cpu_supports("bmi2") &&
                        __builtin_cpu_supports("popcnt");
  if (SV_HAVE_AVX2 && has_bits && __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma"))
    mask |= SV_ISA_BIT(SV_ISA_AVX2);
  if (SV_HAVE_AVX512 && has_bits && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
      __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512bw"))
    mask |= SV_ISA_BIT(SV_ISA_AVX512);
#endif
  if (SV_HAVE_NEON) mask |= SV_ISA_BIT(SV_ISA_NEON); // every AArch64 core has it
  return mask;
}

const char *sv_isa_name(sv_isa isa) { return (unsigned)isa < SV_N_ISAS ? isa_names[isa] : "?"; }

int sv_isa_by_name(const char *name) {
  for (int i = 0; i < SV_N_ISAS; i++)
    if (!strcmp(name, isa_names[i])) return i;
  return -1;
}

bool sv_kernel_exists(const char *op, sv_isa isa) {
  static const struct {
    const char *op;
    sv_isa isa;
  } all[] = {
#define OP(name)                            {#name, SV_ISA_REF},
#define VARIANT(name, isa_lower, isa_upper) {#name, SV_ISA_##isa_upper},
#include "kernels/variants.inc"
  };
  for (size_t i = 0; i < sizeof all / sizeof *all; i++)
    if (all[i].isa == isa && !strcmp(all[i].op, op)) return true;
  return false;
}

// A variant that this build does not contain is not named.
#define SET_0(name, isa_lower, isa_upper)
#define SET_1(name, isa_lower, isa_upper)                                                                    \
  if (mask & SV_ISA_BIT(SV_ISA_##isa_upper)) k->name = sv_##name##_##isa_lower;
#define SET_(have) SET_##have
#define SET(have)  SET_(have)

void sv_kernels_init(sv_kernels *k, uint32_t isa_mask) {
  uint32_t mask = isa_mask & sv_cpu_isas();
#define OP(name) k->name = sv_##name##_ref;
#define VARIANT(name, isa_lower, isa_upper)
#include "kernels/variants.inc"
#define OP(name)
#define VARIANT(name, isa_lower, isa_upper) SET(SV_HAVE_##isa_upper)(name, isa_lower, isa_upper)
#include "kernels/variants.inc"
  k->isa = SV_ISA_REF;
  for (int i = 0; i < SV_N_ISAS; i++)
    if (mask & SV_ISA_BIT(i)) k->isa = (sv_isa)i;
}
