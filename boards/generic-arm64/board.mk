# SPDX-License-Identifier: Apache-2.0
# Any 64-bit ARM machine with Linux (ARMv8-A, NEON). Also the board that is tested under emulation.
BOARD_ARCH        := aarch64
BOARD_DEBIAN_ARCH := arm64
BOARD_CROSS       := aarch64-linux-gnu-
BOARD_CFLAGS      := -march=armv8-a
BOARD_ISAS        := neon
BOARD_RUN         := qemu-aarch64-static
BOARD_PLATFORMS   := linux sim replay codec camera v4l2 drm libcamera
