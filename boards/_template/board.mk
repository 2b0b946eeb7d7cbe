# SPDX-License-Identifier: Apache-2.0
# Copy this folder to boards/<name>, change the values, then: make BOARD=<name> plan check
# This file is data: only these variables, no rules.

# What `uname -m` prints on the board. When it is the building machine's own, nothing is crossed or
# emulated, and BOARD_CROSS and BOARD_RUN are not used: the same board also builds on itself.
BOARD_ARCH        := aarch64
# Debian's name of it, for the folder of headers and libraries (tools/deps/sysroot.sh).
BOARD_DEBIAN_ARCH := arm64
# Prefix of the cross compiler.
BOARD_CROSS       := aarch64-linux-gnu-
# The processor. Nothing here may change results: no -ffast-math, no -ffp-contract=fast.
BOARD_CFLAGS      := -mcpu=cortex-a76
# Kernel variants to build: sse41 avx2 avx512 (x86-64), neon (arm64). Which one runs is chosen at
# start.
BOARD_ISAS        := neon
# What runs the board's programs on the building machine; -L and the sysroot are added.
BOARD_RUN         := qemu-aarch64-static -cpu cortex-a76
# Folders of platform/ to link.
BOARD_PLATFORMS   := linux sim replay codec camera v4l2 drm libcamera
# More libraries for the linker, when a platform of the list wants one.
BOARD_LIBS        :=
# no: `subview` goes without its command `bench` (tools/bench), which `subview-lab` has, too.
BOARD_BENCH       := yes
