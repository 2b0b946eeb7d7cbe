#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Each header compiles alone, as C11 and as C++17: it includes what it needs, and C++ code can use
# it. A header that C++ cannot take has a line `// C only` (a reason may follow). Headers of one
# instruction set are compiled for it, with a cross compiler if necessary. A header that is a part
# of another has a line `// Not alone` and is left to the one that includes it.
cd "${ROOT:-.}" || exit 2
lint=$(dirname "$(readlink -f "$0")")
CC=${CC:-gcc}
CXX=${CXX:-$(echo "$CC" | sed 's/gcc/g++/; s/clang/clang++/')}
export CC CXX

if [ "${1:-}" = --one ]; then
  file=$2 isa=
  grep -q '^// Not alone' "$file" && exit 0
  case $file in
  *_sse41* | *_x86*) isa='x86_64 -msse4.1' ;;
  *_avx2*) isa='x86_64 -mavx2 -mfma' ;;
  *_avx512*) isa='x86_64 -mavx512f -mavx512dq -mavx512vl -mavx512bw -mfma' ;;
  *_neon*) isa='aarch64' ;;
  esac
  case $file in
  src/* | kernels/* | calib/* | include/*) flags='' ;;
  *) flags=-D_GNU_SOURCE ;;
  esac
  if [ -n "$isa" ]; then
    arch=${isa%% *}
    flags="$flags ${isa#"$arch"}"
    case $($CC -dumpmachine) in
    "$arch"*) ;;
    *)
      if ! command -v "$arch-linux-gnu-gcc" >/dev/null; then
        echo "skipped: $file: no compiler for $arch"
        exit 0
      fi
      CC=$arch-linux-gnu-gcc
      CXX=$arch-linux-gnu-g++
      ;;
    esac
  fi
  flags="$flags -I. -fsyntax-only -Wall -Wextra -Wno-unused-function -Werror"
  # Twice, so that a missing guard is found, too.
  alone() { printf '#include "%s"\n#include "%s"\ntypedef int sv_not_empty;\n' "$file" "$file"; }
  # shellcheck disable=SC2086 # lists of words
  alone | $CC -std=c11 -Wpedantic $flags -x c - || { echo "$file: does not compile alone as C11"; exit 1; }
  grep -q '^// C only' "$file" && exit 0
  command -v "${CXX%% *}" >/dev/null || { echo "skipped: $file as C++: no ${CXX%% *}"; exit 0; }
  # shellcheck disable=SC2086 # lists of words
  alone | $CXX -std=c++17 $flags -x c++ - || { echo "$file: does not compile alone as C++17"; exit 1; }
  exit 0
fi

headers=$("$lint/sources.sh" c | grep '\.h$')
[ -n "$headers" ] || { echo "no headers"; exit 1; }
log=$(mktemp)
printf '%s\n' "$headers" | xargs -n 1 -P "$(nproc)" "$lint/headers.sh" --one >"$log" 2>&1
code=$?
cat "$log"
# Each header is one case.
n=$(printf '%s\n' "$headers" | wc -l)
failed=$(grep -cE ': does not compile alone as C' "$log")
skipped=$(grep -c '^skipped: [^ ]*: no compiler' "$log")
rm -f "$log"
[ $code -ne 0 ] && [ "$failed" -eq 0 ] && failed=1
echo "$((n - failed - skipped)) passed, $failed failed, $skipped skipped"
[ "$failed" -eq 0 ]
