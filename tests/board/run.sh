#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# Runs subview on the virtual ARM board: boots Debian's arm64 kernel under QEMU with three vivid and
# three vimc cameras, three loopback devices and a simulated GPIO chip, and runs board.sh there.
# Ends with "N passed, N failed, N skipped".
#
#   run.sh BUILD PROGRAMS SYSROOT
#
# What does not change is kept in BUILD/board. BOARD_CPU=cortex-a76 is the Pi 5's core (cortex-a72:
# the Pi 4's). BOARD_ONLY=NAME runs one part of board.sh (v4l2, libcamera, lost, skew, suite,
# faults, page, trigger, display). BOARD_TIMEOUT=SEC ends a board that hangs.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
build=$1 programs=$2 sysroot=$3
work=$build/board

skip() {
  echo "skip  board                                   $*"
  echo "0 passed, 0 failed, 1 skipped"
  exit 0
}
command -v qemu-system-aarch64 >/dev/null || skip "qemu-system-aarch64 is not installed (tools/deps/install.sh board)"
command -v aarch64-linux-gnu-gcc >/dev/null || skip "aarch64-linux-gnu-gcc is not installed"
"$here/image.sh" "$work/image" 2>"$work.err" || { mkdir -p "$work"; skip "$(tail -n 1 "$work.err")"; }

# Programs, the libraries they need from the sysroot, and the tests, as a second archive: the kernel
# unpacks both.
libs=$sysroot/usr/lib/aarch64-linux-gnu
test=$work/files/test
rm -rf "$work/files"
mkdir -p "$test/bin" "$test/lib" "$work/files/lib" "$work/files/usr/lib/aarch64-linux-gnu"
cc() { aarch64-linux-gnu-gcc --sysroot="$sysroot" -std=gnu11 -O2 -Wall -Wextra "$@"; }
cc -o "$test/bin/board_tool" "$here/board_tool.c"
cc -fPIC -shared -o "$test/lib/heap_watch.so" "$here/heap_watch.c"
cc -fPIC -shared -o "$test/lib/refuse.so" "$here/refuse.c"
cp "$programs/bin/subview" "$programs/bin/subview-preview" "$programs/tests/source-check" "$programs/tests/source-faults" \
  "$programs/tests/display-check" "$test/bin/"
mkdir -p "$test/lib/subview"
cp "$programs"/lib/subview/*.so "$test/lib/subview/"
aarch64-linux-gnu-strip "$test"/bin/* "$test"/lib/subview/*
cp "$here/board.sh" "$test/"
cp "$here/init" "$work/files/init"
chmod +x "$work/files/init"
for ipa in "$libs"/libcamera/*.so "$libs"/libcamera/*.so.sign; do
  [ -e "$ipa" ] || continue
  mkdir -p "$work/files/usr/lib/aarch64-linux-gnu/libcamera"
  cp "$ipa" "$work/files/usr/lib/aarch64-linux-gnu/libcamera/"
done
[ ! -d "$sysroot/usr/share/libcamera" ] || { mkdir -p "$work/files/usr/share"; cp -r "$sysroot/usr/share/libcamera" "$work/files/usr/share/"; }
declare -A seen=()
need() { # recursively, what a file is linked to
  local name path
  for name in $(readelf -d "$1" | sed -n 's/.*NEEDED.*\[\(.*\)\]/\1/p'); do
    [ -z "${seen[$name]:-}" ] || continue
    seen[$name]=1
    path=$(find "$libs" "$sysroot/lib/aarch64-linux-gnu" "$sysroot/usr/lib" -name "$name" -print -quit 2>/dev/null)
    [ -n "$path" ] || { echo "board: $name, which $(basename "$1") needs, is not in the sysroot" >&2; exit 1; }
    cp -L "$path" "$test/lib/"
    need "$path"
  done
}
for program in "$test"/bin/* "$test"/lib/subview/*; do need "$program"; done
for ipa in "$work"/files/usr/lib/aarch64-linux-gnu/libcamera/*.so; do [ ! -e "$ipa" ] || need "$ipa"; done
loader=$(find "$sysroot" -name ld-linux-aarch64.so.1 -print -quit)
cp -L "$loader" "$work/files/lib/"
echo "${BOARD_ONLY:-}" >"$test/only"
(cd "$work/files" && find . | cpio -o -H newc --quiet) | gzip -1 >"$work/tests.cpio.gz"
cat "$work/image/base.cpio.gz" "$work/tests.cpio.gz" >"$work/initrd"

# No image of a disk, no network, no share: results come back on the serial line. Page tables of the
# kernel's own, which it takes whenever it lies at a random place, would cost an emulated core a
# quarter of its time.
boot="console=ttyAMA0 quiet panic=-1 print-fatal-signals=1 nokaslr kpti=off mitigations=off"
started=$(date +%s)
timeout -k 5 "${BOARD_TIMEOUT:-480}" qemu-system-aarch64 -M virt -cpu "${BOARD_CPU:-cortex-a72}" -smp 2 -m 1536 -nographic -no-reboot \
  -nic none -kernel "$work/image/vmlinuz" -initrd "$work/initrd" -append "$boot" \
  </dev/null >"$work/console.log" 2>&1 || echo "board: QEMU ended with $?" >>"$work/console.log"
tr -d '\r' <"$work/console.log" | sed -n 's/^.*@ //p' >"$work/results"
echo "board: $(($(date +%s) - started)) s on the virtual board (log: $work/console.log)"
grep -E '^(ok|FAIL|skip|note)' "$work/results" || true
passed=$(grep -c '^ok' "$work/results" || true)
failed=$(grep -c '^FAIL' "$work/results" || true)
skipped=$(grep -c '^skip' "$work/results" || true)
if ! grep -q '^exit 0$' "$work/results"; then
  echo "FAIL  the board did not get to the end of its tests; its last lines:"
  tail -n 5 "$work/console.log" | sed 's/^/      | /'
  failed=$((failed + 1))
fi
echo "$passed passed, $failed failed, $skipped skipped"
[ "$failed" -eq 0 ]
