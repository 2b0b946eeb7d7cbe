# SPDX-License-Identifier: Apache-2.0
# Kernels. Every kernels/<op>/<op>_vec.c is compiled once for each instruction set of the board
# (BOARD_ISAS), with the vector vocabulary kernels/simd/v16_<isa>.h; files named *_<isa>.c are for
# that one only; all others are plain C.
#
# An instruction set: its flags, its name in SV_HAVE_... and SV_ISA_...
ALL_ISAS := sse41 avx2 avx512 neon
ISA_sse41  := -msse4.1
ISA_avx2   := -mavx2 -mfma -mbmi -mbmi2 -mlzcnt -mpopcnt
ISA_avx512 := -mavx512f -mavx512dq -mavx512vl -mavx512bw -mfma -mbmi -mbmi2 -mlzcnt -mpopcnt -mprefer-vector-width=512
# GCC for AArch64 schedules before register allocation, which spills vectors of four registers.
ISA_neon   := $(if $(IS_CLANG),,-fno-schedule-insns)
NAME_sse41  := SSE41
NAME_avx2   := AVX2
NAME_avx512 := AVX512
NAME_neon   := NEON
HAVE := $(foreach i,$(BOARD_ISAS),-DSV_HAVE_$(NAME_$(i))=1)
# Projection is long, has no loops and more live vectors than registers: scheduling before register
# allocation runs more of its chains side by side.
PROJECT_CFLAGS := $(if $(IS_CLANG),,-fschedule-insns -fsched-pressure)

KERNEL_VEC := $(wildcard kernels/*/*_vec.c)
KERNEL_SRC := $(filter-out $(KERNEL_VEC) $(addprefix %_,$(addsuffix .c,$(ALL_ISAS))),$(wildcard kernels/*.c kernels/*/*.c)) \
  $(foreach i,$(BOARD_ISAS),$(wildcard kernels/*/*_$(i).c))
KERNEL_OBJ := $(KERNEL_SRC:%.c=$(O)/obj/%.o) $(foreach i,$(BOARD_ISAS),$(KERNEL_VEC:%.c=$(O)/obj/%_$(i).o))
# The vocabulary's test is a vector file, too.
PROBE_OBJ  := $(foreach i,ref $(BOARD_ISAS),$(O)/obj/tests/kernels/v16_probe_vec_$(i).o)

define isa_rules
$(O)/obj/kernels/%_vec_$(1).o: kernels/%_vec.c
	$$(call compile,-DSV_ISA=$(1) $$(ISA_$(1)) $$(KERNEL_CFLAGS))
$(O)/obj/kernels/%_$(1).o: kernels/%_$(1).c
	$$(call compile,-DSV_ISA=$(1) $$(ISA_$(1)) $$(KERNEL_CFLAGS))
endef
$(foreach i,$(BOARD_ISAS),$(eval $(call isa_rules,$(i))))
define probe_rule
$(O)/obj/tests/kernels/%_vec_$(1).o: tests/kernels/%_vec.c
	$$(call compile,-DSV_ISA=$(1) $$(ISA_$(1)) $$(HOST_CFLAGS))
endef
$(foreach i,ref $(BOARD_ISAS),$(eval $(call probe_rule,$(i))))
$(O)/obj/kernels/%.o: kernels/%.c
	$(call compile,$(KERNEL_CFLAGS))
$(O)/obj/kernels/project/%.o: KERNEL_CFLAGS += $(PROJECT_CFLAGS)
# GCC 12 for AArch64 at -O3 moves a copy of one struct over another's (tests/kernels/check_v16.c
# found it); the vocabulary's reference is compiled without that freedom.
$(O)/obj/tests/kernels/v16_probe_vec_ref.o: HOST_CFLAGS += -fno-strict-aliasing
