#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Replays tests/fuzz/corpus, and a few mutations of it, with the address and undefined-behaviour
# sanitizers.
set -u
cd "$(dirname "$(readlink -f "$0")")/../.." || exit 2
build=${BUILD:-build}
unset MAKEFLAGS MAKELEVEL MFLAGS
make --no-print-directory -j"$(nproc)" BUILD="$build/corpus" SAN=address,undefined BOARD_ISAS= fuzz-programs || exit 1
bin=$(dirname "$(find "$build"/corpus/*-asan/tests/fuzz -name fuzz_json | head -n 1)")
bad=0
for target in "$bin"/fuzz_*; do
  name=$(basename "$target")
  name=${name#fuzz_}
  [ -x "$target" ] && [ -f "tests/fuzz/fuzz_$name.c" ] || continue
  set --
  [ ! -d "tests/fuzz/corpus/$name" ] || set -- "tests/fuzz/corpus/$name"/*
  if ! said=$("$target" -n 300 "$@" 2>&1); then
    bad=1
    printf '%s: %s\n' "$name" "$(printf '%s\n' "$said" | grep -m 1 -E 'SUMMARY|runtime error|cannot|ERROR')"
  else printf '%s: %d inputs; %s\n' "$name" $# "$said"; fi
done
exit $bad
