# SPDX-License-Identifier: Apache-2.0
# Raspberry Pi 5 (BCM2712, four Cortex-A76 cores).
BOARD_ARCH        := aarch64
BOARD_DEBIAN_ARCH := arm64
BOARD_CROSS       := aarch64-linux-gnu-
BOARD_CFLAGS      := -mcpu=cortex-a76
BOARD_ISAS        := neon
BOARD_RUN         := qemu-aarch64-static -cpu cortex-a76
BOARD_PLATFORMS   := linux sim replay codec camera v4l2 drm libcamera
