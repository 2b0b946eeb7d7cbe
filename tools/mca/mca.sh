#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Predicted cycles of the kernels' inner loops (llvm-mca on the compiler's assembler output), for 16
# lanes:
#
#   make mca [V=1]  a table: operation, instructions, vectors kept on the stack, cycles on each
#   core, and the steps that
#                   follow from it on boards. V=1: each region, too
#
# A model of the core alone: every load hits the first cache, no branch is mispredicted, nothing
# else runs. LLVM has no model of the Cortex-A76; that of the Neoverse N1, the same core for
# servers, stands in (LLVM 17 and later). Exit 77 with the reason when a tool is missing.
set -u
root=$(readlink -f "$(dirname "$0")/../..")
cd "$root" || exit 2
: "${neon?by make mca, which knows the flags}" "${avx2?}" "${avx512?}" "${project?}"
here=tools/mca verbose=${1:-}
mca=$(ls -d /usr/lib/llvm-*/bin/llvm-mca 2>/dev/null | sort -t- -k2 -n | tail -n 1)
[ -n "$mca" ] || mca=$(command -v llvm-mca) || { echo "llvm-mca is not installed (package llvm, better llvm-19)"; exit 77; }
cross=aarch64-linux-gnu-gcc
[ "$(uname -m)" = aarch64 ] && cross=gcc
command -v "$cross" >/dev/null || { echo "$cross is not installed (package gcc-aarch64-linux-gnu)"; exit 77; }
"$mca" -mtriple=aarch64 -mcpu=help </dev/null 2>&1 | grep -q neoverse-n1 || { echo "$mca knows no neoverse-n1"; exit 77; }
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# Columns: name, compiler, instruction set, its flags, triple, model.
flags_of() { sed -n 's/^BOARD_CFLAGS *:= *//p' "boards/$1/board.mk"; }
cat >"$work/cores" <<END
A72|$cross|neon|$(flags_of rpi4) $neon|aarch64|cortex-a72
A76|$cross|neon|$(flags_of rpi5) $neon|aarch64|neoverse-n1
A55|$cross|neon|$(flags_of rock5b) $neon|aarch64|cortex-a55
END
if [ "$(uname -m)" = x86_64 ]; then
  cat >>"$work/cores" <<END
AVX2|gcc|avx2|$avx2|x86_64|sapphirerapids
AVX512|gcc|avx512|$avx512|x86_64|sapphirerapids
END
fi

compile() { # core, compiler, isa, flags: the kernels' own flags, as in mk/kernels.mk
  for op in raster ssim newton project; do
    own=
    [ $op = project ] && own=$project
    # shellcheck disable=SC2086 # flags are words
    "$2" -std=c11 -O3 -I. -ffp-contract=off -fno-math-errno -fno-trapping-math "-DSV_ISA=$3" $4 $own \
      -S "kernels/$op/${op}_vec.c" -o "$work/$1.$op.s" || exit 1
  done
}
cycles() { # triple, model, file: cycles of one pass, of many
  "$mca" -mtriple="$1" -mcpu="$2" -iterations=50 "$3" 2>/dev/null |
    awk '/^Iterations:/ { n = $2 } /^Total Cycles:/ { printf "%.1f\n", $3 / n }'
}

while IFS='|' read -r core compiler isa flags triple model; do
  compile "$core" "$compiler" "$isa" "$flags"
  grep -v '^#' "$here/regions.txt" | while read -r op only function kind min times; do
    [ "$only" = '*' ] || [ "$only" = "$isa" ] || continue
    case $isa in neon) min=$((4 * min)) ;; avx2) min=$((2 * min)) ;; esac # vectors of 16 lanes
    function=$(echo "$function" | sed "s/@/$isa/")
    file=$work/$core.$(echo "$op" | sed 's/_bwd//').s
    cut() { awk -v fn="$function" -v kind="$kind" -v min_fma="$min" -v what="$1" -f "$here/region.awk" "$file"; }
    cut text >"$work/region.s" || continue
    [ -s "$work/region.s" ] || continue
    echo "$core $op $function $times $(cut count) $(cycles "$triple" "$model" "$work/region.s")"
  done
done <"$work/cores" >"$work/rows"

echo "$("$mca" --version | sed -n 's/^ *\(.*version.*\)/\1/p'), $($cross --version | head -n 1)"
echo "16 lanes of            instructions/spills, cycles on each core"
awk -v verbose="$verbose" -f "$here/report.awk" "$work/rows" "$here/steps.txt"
