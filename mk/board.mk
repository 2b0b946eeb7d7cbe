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

# A machine of the board's own architecture needs no cross compiler and no emulator, and, if it runs
# SUITE, no sysroot. A board without BOARD_DEBIAN_ARCH has a toolchain that brings its own headers.
HOST_SUITE := $(shell . /etc/os-release 2>/dev/null; echo $${VERSION_CODENAME:-unknown})
SUITE      ?= $(HOST_SUITE)
ifneq ($(BOARD_DEBIAN_ARCH),)
ifneq ($(BOARD_ARCH)-$(SUITE),$(HOST_ARCH)-$(HOST_SUITE))
SYSROOT       := $(BUILD)/sysroot-$(SUITE)-$(BOARD_DEBIAN_ARCH)
SYSROOT_STAMP := $(SYSROOT)/.complete
SYSROOT_FLAG  := --sysroot=$(SYSROOT)
endif
endif
ifeq ($(BOARD_ARCH),$(HOST_ARCH))
override BOARD_CROSS :=
# Programs of another release run with their own C library.
override BOARD_RUN   :=
SYSROOT_LIBS := $(SYSROOT)/usr/lib/$(BOARD_ARCH)-linux-gnu
EMULATE := $(if $(SYSROOT),$(SYSROOT)/lib64/ld-linux-x86-64.so.2 --library-path $(SYSROOT_LIBS))
else
EMULATE := $(if $(BOARD_RUN),$(BOARD_RUN) -L $(SYSROOT))
endif
INC_DIR := $(SYSROOT)/usr/include

# What a build contains is decided by what the sysroot has: make reads this file, which it makes
# first and then starts again.
ifneq ($(SYSROOT),)
$(SYSROOT_STAMP): tools/deps/sysroot.sh
	@tools/deps/sysroot.sh $(SUITE) $(BOARD_DEBIAN_ARCH) $(SYSROOT)
ifneq ($(filter-out help clean deps format format-check tidy bare-test,$(or $(MAKECMDGOALS),all)),)
include $(SYSROOT_STAMP)
endif
endif

comma := ,
OTHER_SUITE := $(if $(filter-out $(HOST_SUITE),$(SUITE)),-$(SUITE))
O := $(BUILD)/$(BOARD)$(OTHER_SUITE)$(if $(SAN),-$(if $(findstring address,$(SAN)),asan,$(subst $(comma),-,$(SAN))))

CC       := $(BOARD_CROSS)gcc
CXX      := $(if $(findstring clang,$(CC)),$(subst clang,clang++,$(CC)),$(subst gcc,g++,$(CC)))
AR       := $(BOARD_CROSS)gcc-ar
OBJDUMP  := $(BOARD_CROSS)objdump
IS_CLANG := $(findstring clang,$(CC))
HAVE_CXX := $(shell command -v $(CXX))
