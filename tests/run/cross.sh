#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# What may differ on another board, on this machine under emulation: `cross.sh generic-arm64`.
# That is the kernels, the golden digests, and units that depend on the processor or its ABI (a
# char without sign, atomics, layouts of files). All else is the same C that the tests of this
# machine run. Emulation tells whether results are right (and the same bits), nothing about speed.
# Where the tools or the foreign libraries cannot be had, says why and exits 77.
set -u
units=$(printf 'unit/test_%s ' base cameramodel capture_json codec colmap convert feed json kalibr npz ply \
  sections sequence transforms)
board=${1:?board} build=${BUILD:-build} suite=${SUITE:?}
cd "$(dirname "$(readlink -f "$0")")/../.." || exit 2

value() { sed -n "s/^$1[ ]*:=[ ]*//p" "boards/$board/board.mk"; }
arch=$(value BOARD_ARCH) run=$(value BOARD_RUN)
if [ "$(uname -m)" != "$arch" ]; then
  for tool in "$(value BOARD_CROSS)gcc" "${run%% *}"; do
    if ! command -v "$tool" >/dev/null; then
      echo "skipped: $board: $tool is not installed"
      exit 77
    fi
  done
  debian=$(value BOARD_DEBIAN_ARCH)
  if ! reason=$(tools/deps/sysroot.sh "$suite" "$debian" "$build/sysroot-$suite-$debian" 2>&1); then
    echo "skipped: $board: $(printf '%s\n' "$reason" | tail -n 1)"
    exit 77
  fi
fi
# A make of its own: what the outer one was told (targets, jobs, sanitizers) is not for this one.
unset MAKEFLAGS MAKELEVEL MFLAGS
make --no-print-directory -j"$(nproc)" BUILD="$build" SUITE="$suite" BOARD="$board" SAN= GROUPS='kernels golden named' \
  TESTS="$units" only
