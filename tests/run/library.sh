#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# The installed library, as a stranger uses it: installs into a temporary folder, builds the
# examples there through pkg-config, looks at the library's symbols, and runs minimal.c without a
# system under qemu: the digest is the same.
#   library.sh [native|aarch64|arm]    by default all; arm where a compiler for it is installed
# Environment: BUILD, BOARD, CC. Ends with "N passed, N failed, N skipped".
set -u
build=${BUILD:-build}
what=${1:-native aarch64 $(command -v arm-none-eabi-gcc >/dev/null && echo arm)}
cd "$(dirname "$(readlink -f "$0")")/../.." || exit 2
tmp=$(mktemp -d)
trap 'rm -rf "$tmp"' EXIT
trap 'exit 130' INT TERM HUP
# A make of its own: what the outer one was told is not for this one.
unset MAKEFLAGS MAKELEVEL MFLAGS CROSS
passed=0 failed=0 skipped=0
ok() { passed=$((passed + 1)); echo "ok: $1"; }
bad() { failed=$((failed + 1)); echo "FAILED: $1"; }
skip() { skipped=$((skipped + 1)); echo "skipped: $1"; }
verdict() { if [ "$1" -eq 0 ]; then ok "$2"; else bad "$2"; fi; }
has() { command -v "$1" >/dev/null 2>&1; }
run_make() { make --no-print-directory -j"$(nproc)" BUILD="$build" SAN= "$@"; }
prefix=/opt/subview
root=$tmp$prefix

# Global names of a library that are not declared in its headers, and names it needs that are not in
# the list.
symbols() { # nm, library
  "$1" -P -g "$2" 2>/dev/null | LC_ALL=C awk -v allowed=tests/run/allowed_symbols.txt -v public="$tmp/public" '
    BEGIN {
      while ((getline line < allowed) > 0) { sub(/#.*/, "", line); n = split(line, w, " "); for (i = 1; i <= n; i++) ok[w[i]] = 1 }
      while ((getline line < public) > 0) { has[line] = 1; left++ }
    }
    $2 == "U" { if (!($1 in ok) && $1 !~ /^__aeabi_/) { print "needs " $1; wrong = 1 } next }
    $2 ~ /^[A-Z]$/ { if ($1 in has) left--; else { print "shows " $1; wrong = 1 } }
    END { if (left) print left " declared functions are not in the library"; exit wrong || left }'
}
public_names() { sed 's|//.*||' "$1"/include/subview/*.h | grep -oE 'subview_[a-z_]+\(' | tr -d '(' | sort -u; }

native() {
  run_make install-library DESTDIR="$tmp" PREFIX=$prefix || { bad "make install-library"; return; }
  public_names "$root" >"$tmp/public"
  symbols nm "$root/lib/libsubview.a"
  verdict $? "the library shows the functions of its headers, and nothing else"
  if ! has pkg-config; then skip "pkg-config is not installed"; return; fi
  export PKG_CONFIG_PATH="$root/lib/pkgconfig" PKG_CONFIG_SYSROOT_DIR="$tmp"
  [ "$(pkg-config --modversion subview)" = "$(sed -n 's/^#define SUBVIEW_VERSION  *"\(.*\)"/\1/p' include/subview/version.h)" ]
  verdict $? "pkg-config knows the version"
  make --no-print-directory -C "$root/share/doc/subview/examples" OUT="$tmp/bin" CFLAGS='-O2 -Wall -Wextra -Wpedantic -Werror'
  verdict $? "the installed examples build"
  (cd "$tmp" && bin/minimal) >"$tmp/native.txt"
  verdict $? "minimal runs"
  cat "$tmp/native.txt"
  psnr=$(awk '$1 == "psnr" { print $2 }' "$tmp/native.txt")
  [ "${psnr:-0}" -gt 3000 ]
  verdict $? "minimal reaches 30 dB"
  head -c 3 "$tmp/model.ply" | grep -q ply
  verdict $? "minimal writes a PLY file"
  "$tmp/bin/own_source" >"$tmp/source.txt" && cat "$tmp/source.txt" &&
    grep -qx 'frames: 16 captured = 14 delivered + 2 dropped; 0 not returned' "$tmp/source.txt"
  verdict $? "own_source: every frame is accounted for"
  if ! has g++; then skip "no C++ compiler"; return; fi
  cat >"$tmp/use.cc" <<'CC'
#include <subview/subview.h>
#include <cstdio>
#include <vector>
int main() {
  subview_camera camera = subview_camera_defaults(32, 24);
  subview_config config = subview_defaults();
  config.cameras = &camera;
  config.n_cameras = 1;
  std::size_t bytes = 0;
  subview_error error;
  if (subview_bytes(&config, &bytes, &error) < 0) return 1;
  std::vector<unsigned char> block(bytes);
  subview *s = nullptr;
  if (subview_init(&s, &config, block.data(), bytes, &error) < 0) return 2;
  if (subview_init(&s, &config, block.data(), bytes / 2, &error) != SUBVIEW_E_NOMEM) return 3;
  std::puts(error.text);
  config.n_gaussians = 0;
  return subview_bytes(&config, &bytes, &error) == SUBVIEW_E_ARG ? 0 : 4;
}
CC
  # shellcheck disable=SC2046 # a list of flags
  g++ -std=c++17 -Wall -Wextra -Wpedantic -Werror "$tmp/use.cc" $(pkg-config --cflags --libs subview) -o "$tmp/use" && "$tmp/use"
  verdict $? "C++ takes the header and links the library"
}

# A machine without a system: compiler prefix, instruction sets, flags, emulator, its processor.
bare() { # name, prefix, isas, flags, qemu, cpu
  for tool in "$2gcc" "$5"; do
    has "$tool" || { skip "$1 without a system: no $tool"; return; }
  done
  case $4 in
  *picolibc.specs*) [ -e "$("$2gcc" -print-file-name=picolibc.specs)" ] || { skip "$1 without a system: no picolibc"; return; } ;;
  esac
  run_make install-library CROSS="$2" ISAS="$3" ARCH_FLAGS="$4" PREFIX="$tmp/$1" DESTDIR= || { bad "$1: the library"; return; }
  public_names "$tmp/$1" >"$tmp/public"
  symbols "$2nm" "$tmp/$1/lib/libsubview.a"
  verdict $? "$1: the library needs nothing of a system"
  make --no-print-directory -C "$tmp/$1/share/doc/subview/examples" OUT="$tmp/bin" PREFIX="$tmp/$1" "bare-$1" ||
    { bad "$1: minimal.c"; return; }
  size "$tmp/bin/bare-$1.elf" 2>/dev/null
  timeout 300 "$5" -M virt -cpu "$6" -m 64 -nic none -display none -monitor none -serial stdio \
    -kernel "$tmp/bin/bare-$1.elf" </dev/null | tr -d '\r' >"$tmp/$1.txt"
  cat "$tmp/$1.txt"
  grep -qx 'done' "$tmp/$1.txt"
  verdict $? "$1: minimal.c runs without a system"
  [ -e "$tmp/native.txt" ] || return
  # x86 without a fused multiply-add rounds differently.
  if [ "$(uname -m)" = x86_64 ] && ! grep -qw fma /proc/cpuinfo; then skip "this processor has no FMA"; return; fi
  [ "$(grep -E '^(digest|psnr)' "$tmp/native.txt")" = "$(grep -E '^(digest|psnr)' "$tmp/$1.txt")" ]
  verdict $? "$1: the same digest and PSNR as here"
}

for each in $what; do
  case $each in
  native) native ;;
  aarch64)
    bare aarch64 aarch64-linux-gnu- neon '-mcpu=cortex-a53 -ffreestanding -fbuiltin --specs=picolibc.specs' \
      qemu-system-aarch64 cortex-a53
    ;;
  arm)
    bare arm arm-none-eabi- '' '-mcpu=cortex-a15 -mfpu=neon-vfpv4 -mfloat-abi=hard' qemu-system-arm cortex-a15
    ;;
  esac
done
echo "$passed passed, $failed failed, $skipped skipped"
[ $failed -eq 0 ] && [ $((passed + skipped)) -gt 0 ]
