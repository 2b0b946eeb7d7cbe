#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Seconds to a held-out PSNR, loading included: for each case of tools/bench/quality.txt the fewest
# steps (within a tenth) whose model reaches the target, then the time of that whole command, the
# median of RUNS, and the energy that the processor counted meanwhile. Prints CSV.
# usage: quality.sh SUBVIEW_LAB [NAME]
# SV_DATA: a folder with the datasets that are not in this repository.
set -u
cd "$(dirname "$(readlink -f "$0")")/../.." || exit 2
lab=${1:?the program subview-lab}
only=${2:-}
runs=${RUNS:-3}
out=$(mktemp -d) || exit 2
trap 'rm -rf "$out"' EXIT
trap 'exit 130' INT TERM

# Held-out PSNR after $1 steps; 0 when the command fails. $args is split on purpose.
psnr() {
  # shellcheck disable=SC2086
  "$lab" train --data "$data" $args --steps "$1" --eval --quiet --out "$out/scored" >/dev/null 2>&1 || { echo 0; return; }
  sed -n 's/.*"psnr": *\([0-9.]*\).*/\1/p' "$out/scored/train.json" | head -n 1
}
reaches() { awk "BEGIN { exit !($(psnr "$1") >= $target) }"; }

# Microjoules since some moment, of all packages; empty where it cannot be read.
joules() { cat /sys/class/powercap/intel-rapl:?/energy_uj 2>/dev/null | awk '{ s += $1 } END { if (NR) print s }'; }

fewest_steps() {
  low=0 high=25
  until reaches $high; do
    low=$high high=$((2 * high))
    [ $high -le 60000 ] || return 1
  done
  while [ $((10 * (high - low))) -gt "$high" ]; do
    middle=$(((low + high) / 2))
    if reaches $middle; then high=$middle; else low=$middle; fi
  done
  echo $high
}

time_run() { # seconds, joules
  before=$(joules) begin=$(date +%s%N)
  # shellcheck disable=SC2086
  "$lab" train --data "$data" $args --steps "$steps" --quiet --out "$out/timed" >/dev/null 2>&1 || exit 1
  end=$(date +%s%N) after=$(joules)
  awk "BEGIN { printf \"%.3f %s\\n\", ($end - $begin) / 1e9, \"$before\" == \"\" ? \"-\" : (${after:-0} - ${before:-0}) / 1e6 }"
}

echo "case,target_db,steps,seconds,joules"
while read -r name target data args; do
  case $name in '#'* | '') continue ;; esac
  [ -z "$only" ] || [ "$only" = "$name" ] || continue
  [ -d "$data" ] || data=${SV_DATA:-.}/$data
  if [ ! -d "$data" ]; then
    echo "quality: $name: no dataset $data" >&2
    continue
  fi
  if ! steps=$(fewest_steps); then
    echo "quality: $name: $target dB is not reached" >&2
    continue
  fi
  for _ in $(seq "$runs"); do time_run; done | sort -n |
    awk -v n="$name,$target,$steps" '{ s[NR] = $1; j[NR] = $2 } END { m = int((NR + 1) / 2); print n "," s[m] "," j[m] }'
done <tools/bench/quality.txt
