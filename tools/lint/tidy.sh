#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# clang-tidy (.clang-tidy says which checks) and cppcheck over the sources that are compiled on this machine.
# HAVE: the -DSV_HAVE_... of the board. Arguments: files, or none for all.
cd "${ROOT:-.}" || exit 2
lint=$(dirname "$(readlink -f "$0")")
export HAVE="${HAVE:-}"

if [ "${1:-}" = --one ]; then
  file=$2
  case $file in
  src/* | kernels/* | calib/*) flags='' ;;
  platform/*) flags=-D_GNU_SOURCE ;;
  *) flags='-D_GNU_SOURCE -include boards/sim-x86/board.h' ;;
  esac
  case $file in
  *_sse41.c) flags="$flags -msse4.1" ;;
  *_avx2.c) flags="$flags -mavx2 -mfma" ;;
  *_avx512.c) flags="$flags -mavx512f -mavx512dq -mavx512vl -mavx512bw -mfma" ;;
  *_neon.c) flags="$flags --target=aarch64-linux-gnu" ;;
  esac
  # shellcheck disable=SC2086 # lists of words
  out=$(clang-tidy --quiet --warnings-as-errors='*' "$file" -- -std=c11 -I. $flags $HAVE \
    2>/dev/null) && exit 0
  printf '%s\n' "$out"
  exit 1
fi

for tool in clang-tidy cppcheck; do
  command -v $tool >/dev/null || "$lint/../deps/install.sh" tidy || exit 1
done
if [ $# -eq 0 ]; then
  # shellcheck disable=SC2046 # names of ours have no spaces
  set -- $("$lint/sources.sh" c | grep '\.c$' | grep -v '^calib/solve/')
fi
bad=0
printf '%s\n' "$@" | xargs -n 1 -P "$(nproc)" "$lint/tidy.sh" --one || bad=1
# shellcheck disable=SC2086 # lists of words
cppcheck --quiet --std=c11 --language=c -I. $HAVE -D__x86_64__ -D__GNUC__ -j "$(nproc)" --inline-suppr \
  --error-exitcode=1 --enable=warning,portability --suppress=missingInclude --suppress=missingIncludeSystem \
  --suppress=unknownMacro --suppress=internalAstError "$@" || bad=1
exit $bad
