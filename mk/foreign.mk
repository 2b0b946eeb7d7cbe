# SPDX-License-Identifier: Apache-2.0
# CROSS=PREFIX-: the library for a board without a system. Any compiler, no sysroot, no packages but
# the compiler's.
#   ARCH_FLAGS   flags of the processor, and of the C library if it needs any
#   ISAS         kernels beside the reference: neon, or sse41 avx2 avx512; none by default
ifneq ($(filter-out libsubview install-library clean help,$(or $(MAKECMDGOALS),all)),)
$(error CROSS builds the library alone: make libsubview CROSS=$(CROSS) or make install-library CROSS=$(CROSS))
endif
override BOARD  := lib-$(CROSS:%-=%)
BOARD_ARCH      := foreign
BOARD_CROSS     := $(CROSS)
# newlib's uint32_t is a long, which the core's formats do not say.
BOARD_CFLAGS    := -isystem $(BUILD)/foreign $(ARCH_FLAGS) -Wno-format
BOARD_ISAS      := $(ISAS)
BOARD_PLATFORMS :=
BOARD_BENCH     := no
# jsmn is one header without dependencies, from the host's libjsmn-dev.
SYSROOT_STAMP   := $(BUILD)/foreign/jsmn.h
$(SYSROOT_STAMP): /usr/include/jsmn.h
	@mkdir -p $(@D)
	@cp $< $@
