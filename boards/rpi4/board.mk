# SPDX-License-Identifier: Apache-2.0
# Raspberry Pi 4 Model B (BCM2711, four Cortex-A72 cores).
BOARD_ARCH        := aarch64
BOARD_DEBIAN_ARCH := arm64
BOARD_CROSS       := aarch64-linux-gnu-
BOARD_CFLAGS      := -mcpu=cortex-a72
BOARD_ISAS        := neon
BOARD_RUN         := qemu-aarch64-static -cpu cortex-a72
BOARD_PLATFORMS   := linux sim replay codec camera v4l2 drm libcamera
