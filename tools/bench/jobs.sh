#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# How well jobs of `subview-lab tables` share a machine: the same plan with 1 and 2 workers. Prints
# the number of jobs, core-hours, wall times and their ratio, and fails when results differ. For a
# machine that does nothing else. usage: jobs.sh LAB DATASET [more options of tables]
set -eu
[ $# -ge 2 ] || { sed -n 's/^# //; s/.*usage: /usage: /p' "$0" | tail -1; exit 2; }
lab=$(realpath "$1")
data=$(realpath "$2")
shift 2
command -v parallel >/dev/null || { echo "jobs.sh: GNU parallel is not installed"; exit 77; }
out=$(mktemp -d "${TMPDIR:-/tmp}/sv_jobs_XXXXXX")
trap 'rm -rf "$out"' EXIT
TIMEFORMAT='%R %U %S'
"$lab" tables --data "$data" "$@" --plan "$out/plan.txt" --out "$out/planned" --quiet
n=$(grep -c . "$out/plan.txt")
for workers in 1 2; do
  { time "$lab" tables --data "$data" "$@" --jobs $workers --threads 1 --quiet --out "$out/$workers" >"$out/log" 2>&1 ||
    { cat "$out/log" >&2; exit 1; }; } 2>"$out/time.$workers" || { cat "$out/time.$workers"; exit 1; }
done
# All but times and memory, which differ from run to run.
scores() { sort "$1" | cut -d, -f1-15,22; }
cmp -s <(scores "$out/1/runs.csv") <(scores "$out/2/runs.csv") ||
  { echo "jobs.sh: results differ between 1 and 2 workers"; exit 1; }
cat "$out/time.1" "$out/time.2" | awk -v n="$n" '
  { wall[NR] = $1; cpu[NR] = $2 + $3 }
  END {
    printf "%d jobs, %.4f core-hours; %.1f s with 1 worker, %.1f s with 2: ratio %.2f; the same tables\n",
      n, cpu[1] / 3600, wall[1], wall[2], wall[1] / wall[2]
  }'
