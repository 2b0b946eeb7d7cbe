# SPDX-License-Identifier: Apache-2.0
# The board: its data file, the compilers, the sysroot, the output folder O.
ifneq ($(CROSS),)
include mk/foreign.mk
else
BOARDS := $(notdir $(patsubst %/board.mk,%,$(wildcard boards/[a-z]*/board.mk)))
ifeq ($(wildcard boards/$(BOARD)/board.mk),)
$(error no boards/$(BOARD)/board.mk; the boards are: $(BOARDS))
endif
include boards/$(BOARD)/board.mk
endif
# The benchmark (tools/bench) is linked into `subview` unless the board says no.
BOARD_BENCH ?= yes
HAVE_BENCH  := $(filter-out no,$(BOARD_BENCH))

# A machine of the board's own architecture needs no cross compiler, sysroot or emulator. A board
# without BOARD_DEBIAN_ARCH has a toolchain that brings its own headers.
ifeq ($(BOARD_ARCH),$(HOST_ARCH))
override BOARD_CROSS :=
override BOARD_RUN   :=
else ifneq ($(BOARD_DEBIAN_ARCH),)
SYSROOT       := $(BUILD)/sysroot-$(BOARD_DEBIAN_ARCH)
SYSROOT_STAMP := $(SYSROOT)/.complete
SYSROOT_FLAG  := --sysroot=$(SYSROOT)
endif
EMULATE := $(if $(BOARD_RUN),$(BOARD_RUN) -L $(SYSROOT))
INC_DIR := $(SYSROOT)/usr/include

comma := ,
O := $(BUILD)/$(BOARD)$(if $(SAN),-$(if $(findstring address,$(SAN)),asan,$(subst $(comma),-,$(SAN))))

CC       := $(BOARD_CROSS)gcc
CXX      := $(if $(findstring clang,$(CC)),$(subst clang,clang++,$(CC)),$(subst gcc,g++,$(CC)))
AR       := $(BOARD_CROSS)gcc-ar
OBJDUMP  := $(BOARD_CROSS)objdump
IS_CLANG := $(findstring clang,$(CC))
HAVE_CXX := $(shell command -v $(CXX))

$(BUILD)/sysroot-%/.complete: tools/deps/sysroot.sh
	@tools/deps/sysroot.sh $* $(BUILD)/sysroot-$*
