# SPDX-License-Identifier: Apache-2.0
# Compiler and linker flags.

# The same bits on every machine: no contraction, no fast-math (kernels/kernels.h has the rules of
# the arithmetic).
ARITH  := -ffp-contract=off -fno-math-errno -fno-trapping-math
ERRORS := $(if $(filter-out 0,$(WERROR)),-Werror)
WARN   := -Wall -Wextra -Wpedantic -Wshadow -Wvla -Walloca -Wstrict-prototypes \
          -Wpointer-arith -Wno-missing-field-initializers $(ERRORS)
SANF   := $(if $(SAN),-fsanitize=$(SAN) -fno-sanitize-recover=all -fno-omit-frame-pointer)
OPT         ?= $(if $(SAN),-O1,-O2)
OPT_KERNELS ?= $(if $(SAN),-O1,-O3)

INCLUDES := -I. $(addprefix -I,$(wildcard include))
COMMON   := -std=c11 $(DEBUG) $(INCLUDES) $(ARITH) $(WARN) $(HAVE) $(SANF) $(SYSROOT_FLAG) $(BOARD_CFLAGS)
CORE_CFLAGS   := $(COMMON) $(OPT) -fstack-usage
KERNEL_CFLAGS := $(COMMON) $(OPT_KERNELS) -fstack-usage
HOST_CFLAGS   := $(COMMON) $(OPT) -D_GNU_SOURCE
SOLVE_CFLAGS  := -std=c11 $(DEBUG) $(INCLUDES) $(filter-out -Wpedantic,$(WARN)) $(SANF) $(SYSROOT_FLAG) $(OPT) -D_GNU_SOURCE
CXXFLAGS_ALL  := -std=c++17 $(DEBUG) $(INCLUDES) -Wall -Wextra $(ERRORS) $(SANF) $(SYSROOT_FLAG) $(OPT)
# Of a shared object: what is not marked is not seen outside of it.
SHARED_CFLAGS := -fPIC -fvisibility=hidden
# Board sizes are visible only where board, platform and runtime meet: programs and tests.
BOARD_HDR     := -include boards/$(BOARD)/board.h $(if $(HAVE_BENCH),-DBOARD_HAS_BENCH)
# The cross compiler's own C and C++ libraries may be older than those that the sysroot's libraries
# need: the sysroot's come first.
SYSROOT_L     := $(if $(SYSROOT),$(addprefix -L,$(wildcard $(SYSROOT)/usr/lib/*-linux-gnu $(SYSROOT)/usr/lib/gcc/*/*)))
# No build ID: it would be a sum over the names of the build's folders, too.
LDFLAGS_ALL   := $(SANF) $(SYSROOT_FLAG) $(SYSROOT_L) -Wl,--as-needed,--build-id=none,-z,relro,-z,now $(LDFLAGS)
