// SPDX-License-Identifier: Apache-2.0
#include "src/run/isa.h"

#include "src/base/str.h"

// "ref, sse41, avx2": those of the mask.
static void add_names(sv_str *s, uint32_t mask) {
  for (int i = 0; i < SV_N_ISAS; i++)
    if (mask & SV_ISA_BIT(i)) sv_str_add(s, "%s%s", s->len ? ", " : "", sv_isa_name((sv_isa)i));
}

sv_status sv_isa_choose(const char *name, uint32_t *mask, sv_err *err) {
  char list[80];
  sv_str s = sv_str_make(list, sizeof list);
  *mask = sv_cpu_isas();
  if (!name || !*name) return SV_OK;
  int isa = sv_isa_by_name(name);
  bool is_here = isa >= 0 && (*mask & SV_ISA_BIT(isa));
  add_names(&s, isa < 0 ? SV_ISA_BIT(SV_N_ISAS) - 1 : *mask);
  if (isa < 0) return sv_fail(err, SV_E_ARG, "SV_ISA is '%.40s'; expected one of %s", name, list);
  if (!is_here)
    return sv_fail(err, SV_E_UNSUPPORTED,
                   "SV_ISA is %s, which this CPU or this build does not have; it has %s", name, list);
  *mask = sv_isa_only((sv_isa)isa);
  return SV_OK;
}
