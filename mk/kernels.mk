# SPDX-License-Identifier: Apache-2.0
# Kernels: one object per operation and instruction set (BOARD_ISAS).
ISA_sse41  := -msse4.1
ISA_avx2   := -mavx2 -mfma -mbmi -mbmi2 -mlzcnt -mpopcnt
ISA_avx512 := -mavx512f -mavx512dq -mavx512vl -mavx512bw -mfma -mbmi -mbmi2 -mlzcnt -mpopcnt -mprefer-vector-width=512
# GCC for AArch64 schedules before register allocation, which spills vectors of four registers.
ISA_neon   := $(if $(IS_CLANG),,-fno-schedule-insns)
upper = $(shell echo $(1) | tr a-z A-Z)
HAVE := $(foreach i,$(BOARD_ISAS),-DSV_HAVE_$(call upper,$(i))=1)
# Projection is long, has no loops and more live vectors than registers: scheduling before register allocation runs more
# of its chains side by side.
PROJECT_CFLAGS := $(if $(IS_CLANG),,-fschedule-insns -fsched-pressure)

KERNEL_SRC := $(filter-out %_sse41.c %_avx2.c %_avx512.c %_neon.c,$(wildcard kernels/*.c kernels/*/*.c)) \
  $(foreach i,$(BOARD_ISAS),$(wildcard kernels/*/*_$(i).c))

define isa_rule
$(O)/obj/kernels/%_$(1).o: kernels/%_$(1).c
	$$(call compile,$$(ISA_$(1)) $$(KERNEL_CFLAGS))
$(O)/obj/tests/kernels/v16_probe_$(1).o: HOST_CFLAGS += $$(ISA_$(1))
endef
$(foreach i,$(BOARD_ISAS),$(eval $(call isa_rule,$(i))))
$(O)/obj/kernels/%.o: kernels/%.c
	$(call compile,$(KERNEL_CFLAGS))
$(O)/obj/kernels/project/%.o: KERNEL_CFLAGS += $(PROJECT_CFLAGS)
# GCC 12 for AArch64 at -O3 moves a copy of one struct over another's (tests/kernels/check_v16.c found it); the
# vocabulary's reference is compiled without that freedom.
$(O)/obj/tests/kernels/v16_probe_ref.o: HOST_CFLAGS += -fno-strict-aliasing
