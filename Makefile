# SPDX-License-Identifier: Apache-2.0
# One file, not recursive. `make help` lists the targets from their ## lines.
BOARD ?= sim-x86
include boards/$(BOARD)/board.mk
O := build/$(BOARD)
CC := $(BOARD_CROSS)gcc
CXX := $(BOARD_CROSS)g++
AR := $(BOARD_CROSS)gcc-ar
OPT ?= -O2
SAN ?=
WARN := -Wall -Wextra -Wpedantic -Wshadow -Wstrict-prototypes -Wvla -Wundef -Wpointer-arith -Wno-unused-function
BASE := $(OPT) -g -I. -ffp-contract=off -fno-math-errno -fno-trapping-math -MMD -MP $(SAN) $(BOARD_CFLAGS)
CORE_CFLAGS := -std=c11 $(BASE) $(WARN)
HOST_CFLAGS := -std=c11 -D_GNU_SOURCE $(BASE) $(WARN) -I/usr/include -include boards/$(BOARD)/board.h
.DEFAULT_GOAL := all
ISA_sse41 := -msse4.1
ISA_avx2 := -mavx2 -mfma
ISA_avx512 := -mavx512f -mavx512dq -mavx512vl -mavx512bw -mavx2 -mfma -mprefer-vector-width=512
ISA_neon :=
KERNEL_SRC := $(filter-out %_sse41.c %_avx2.c %_avx512.c %_neon.c,$(wildcard kernels/*.c kernels/*/*.c)) \
  $(foreach i,$(BOARD_ISAS),$(wildcard kernels/*/*_$(i).c))
CORE_SRC := $(wildcard src/*/*.c calib/*.c) $(KERNEL_SRC)
PLAT_SRC := $(foreach p,$(BOARD_PLATFORMS),$(wildcard platform/$(p)/*.c))
CORE_OBJ := $(CORE_SRC:%.c=$(O)/obj/%.o)
PLAT_OBJ := $(PLAT_SRC:%.c=$(O)/obj/%.o)
all: $(O)/libcore.a ## build the runtime, the tools and the tests for BOARD
$(O)/libcore.a: $(CORE_OBJ)
	@rm -f $@; $(AR) rcs $@ $^
define isa_rule
$(O)/obj/kernels/%_$(1).o: kernels/%_$(1).c
	@mkdir -p $$(@D); $(CC) $(CORE_CFLAGS) $(ISA_$(1)) -c $$< -o $$@
endef
$(foreach i,$(BOARD_ISAS),$(eval $(call isa_rule,$(i))))
$(O)/obj/platform/%.o: platform/%.c
	@mkdir -p $(@D); $(CC) $(HOST_CFLAGS) -c $< -o $@
$(O)/obj/%.o: %.c
	@mkdir -p $(@D); $(CC) $(CORE_CFLAGS) -c $< -o $@
-include $(CORE_OBJ:.o=.d) $(PLAT_OBJ:.o=.d)
