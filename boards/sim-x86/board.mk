# SPDX-License-Identifier: Apache-2.0
# The simulator board: this machine (x86-64), every x86 kernel built, chosen at run time.
BOARD_ARCH      := x86_64
BOARD_DEBIAN_ARCH := amd64
BOARD_CROSS     :=
BOARD_CFLAGS    :=
BOARD_ISAS      := sse41 avx2 avx512
BOARD_RUN       :=
BOARD_PLATFORMS := linux sim replay codec camera v4l2 drm libcamera
