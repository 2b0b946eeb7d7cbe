#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Takes what fuzz_long.sh has found into tests/fuzz/corpus: of each target the inputs that reach all
# edges (libFuzzer's merge), the smallest ones first, at most 60 and 100 kB. Inputs with a name of
# words are regressions and stay.
set -u
cd "$(dirname "$(readlink -f "$0")")/../.." || exit 2
build=${BUILD:-build}/fuzz
bin=$(dirname "$(find "$build" -path '*/tests/fuzz/fuzz_json' | head -n 1)")
for target in "$bin"/fuzz_*; do
  name=$(basename "$target")
  name=${name#fuzz_}
  to=tests/fuzz/corpus/$name all=$build/merged/$name
  [ -d "$build/corpus/$name" ] || continue
  mkdir -p "$to"
  rm -rf "$all"
  mkdir -p "$all"
  "$target" -merge=1 -max_len=8192 -timeout=10 -rss_limit_mb=2500 "$all" "$to" "$build/corpus/$name" >"$build/$name.merge.log" 2>&1
  find "$to" -type f -regextype posix-extended -regex '.*/[0-9a-f]{40}' -delete
  find "$all" -type f -printf '%s %f\n' | sort -n | awk '{ sum += $1 } NR <= 60 && sum <= 100000 { print $2 }' |
    while read -r f; do cp "$all/$f" "$to/$f"; done
  printf '%s: %d of %d inputs\n' "$name" "$(find "$to" -type f | wc -l)" "$(find "$build/corpus/$name" -type f | wc -l)"
  rmdir "$to" 2>/dev/null
done
du -sb tests/fuzz/corpus
