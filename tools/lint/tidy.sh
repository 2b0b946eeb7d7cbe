#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# clang-tidy (checks: .clang-tidy) and cppcheck over the sources that are compiled on this machine.
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
  *_vec.c) isas='sse41 avx2 avx512 neon' ;; # compiled for each
  *_sse41.c | *_avx2.c | *_avx512.c | *_neon.c) isas=${file##*_} ;;
  *) isas=none ;;
  esac
  bad=0
  for isa in $isas; do
    case ${isa%.c} in
    none) own='' ;;
    sse41) own='-DSV_ISA=sse41 -msse4.1' ;;
    avx2) own='-DSV_ISA=avx2 -mavx2 -mfma' ;;
    avx512) own='-DSV_ISA=avx512 -mavx512f -mavx512dq -mavx512vl -mavx512bw -mfma' ;;
    neon) own='-DSV_ISA=neon --target=aarch64-linux-gnu' ;;
    esac
    # shellcheck disable=SC2086 # lists of words
    out=$(clang-tidy --quiet --warnings-as-errors='*' "$file" -- -std=c11 -I. $flags $own $HAVE \
      2>/dev/null) && continue
    printf '%s\n' "$out"
    bad=1
  done
  exit $bad
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
