#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Long runs. Needs the tests' programs.
#
#   soak.sh sim BUILD [EXPOSURES]   live runs on virtual clocks: 24 h of simulated time in minutes,
#                                   and so many exposures at three rates and numbers of Gaussians
#   soak.sh real BUILD HOURS        the programs as users run them (process_soak.c)
#
# Tables, and plots where gnuplot is there, are in BUILD/soak.
set -eu
what=$1 build=$2 more=${3:-}
out=$build/soak
mkdir -p "$out"

plot() { # TABLE FIRST_COLUMN LAST_COLUMN
  command -v gnuplot >/dev/null || return 0
  gnuplot -c tests/soak/plot.gp "$1" "${1%.csv}.png" "$2" "$3"
}

failed=0
live() { # NAME ARGUMENTS
  name=$1
  shift
  nice "$build/tests/live-soak" "$@" >"$out/$name.csv" || failed=$((failed + 1))
  echo "$name ($*): $(tail -n 1 "$out/$name.csv")"
  grep -v '^#' "$out/$name.csv" >"$out/table.csv"
  mv "$out/table.csv" "$out/$name.csv"
  plot "$out/$name.csv" 2 15
}

case $what in
sim)
  exposures=${more:-10000}
  live day "$((8640 * exposures / 10000))" 1000 20 10 # an exposure each 10 s, for a day
  for period_s in 0.02 0.05 0.2; do
    live "2000-$period_s" "$exposures" 2000 40 "$period_s"
    live "5000-$period_s" "$exposures" 5000 20 "$period_s"
    live "20000-$period_s" "$exposures" 20000 10 "$period_s"
  done
  ;;
real)
  "$build/tests/process-soak" "$more" "$out" || failed=1
  plot "$out/soak.csv" 3 7
  ;;
*)
  echo "soak.sh: the first word is sim or real, not $what" >&2
  exit 2
  ;;
esac
[ "$failed" = 0 ]
