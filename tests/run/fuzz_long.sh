#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# fuzz_long.sh MINUTES [TARGET...]: libFuzzer with address and undefined-behaviour sanitizers on
# each fuzz target in turn. Prints executions, edges and new inputs of each; a finding stops its
# target, and its input is named. What was found stays in BUILD/fuzz/corpus, where the next call
# begins.
set -u
minutes=${1:?minutes}
shift
cd "$(dirname "$(readlink -f "$0")")/../.." || exit 2
build=${BUILD:-build}/fuzz
clang=${CLANG:-clang}
command -v "$clang" >/dev/null || { echo "fuzz-long: clang is not installed" >&2; exit 2; }
unset MAKEFLAGS MAKELEVEL MFLAGS
make --no-print-directory -j"$(nproc)" BUILD="$build" CC="$clang" SAN=fuzzer-no-link,address,undefined BOARD_ISAS= fuzz-programs || exit 2
bin=$(dirname "$(find "$build" -path '*/tests/fuzz/fuzz_json' | head -n 1)")
[ $# -gt 0 ] || set -- "$bin"/fuzz_*
seconds=$((minutes * 60 / $#))
[ "$seconds" -gt 0 ] || seconds=1
bad=0
printf '%-18s %12s %8s %8s %8s\n' target executions edges inputs findings
for target; do
  name=$(basename "$target")
  name=${name#fuzz_}
  work=$build/corpus/$name
  mkdir -p "$work" "$build/found" "tests/fuzz/corpus/$name"
  FUZZ_SEEDS_TO="$work" "$bin/fuzz_$name" >/dev/null 2>&1
  log=$build/$name.log
  "$bin/fuzz_$name" -max_total_time=$seconds -max_len=16384 -timeout=10 -rss_limit_mb=2500 -print_final_stats=1 \
    -artifact_prefix="$build/found/$name-" "$work" "tests/fuzz/corpus/$name" >"$log" 2>&1
  code=$?
  n=$(sed -n 's/^stat::number_of_executed_units: *//p' "$log")
  edges=$(sed -n 's/.* cov: \([0-9]*\) .*/\1/p' "$log" | tail -n 1)
  inputs=$(find "$work" -type f | wc -l)
  printf '%-18s %12s %8s %8s %8s\n' "$name" "${n:-?}" "${edges:-?}" "$inputs" "$([ $code -eq 0 ] && echo 0 || echo 1)"
  if [ $code -ne 0 ]; then
    bad=1
    grep -m 3 -E 'SUMMARY|Test unit written|FUZZ_CHECK|ERROR' "$log" | sed 's/^/  /'
  fi
  rmdir "tests/fuzz/corpus/$name" 2>/dev/null
done
exit $bad
