#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# What service.sh wrote on a board's console, as lines of checks and their sums:
#
#   report.sh NAME CONSOLE SECONDS        ends with "N passed, N failed, N skipped"
set -euo pipefail
name=$1 console=$2 seconds=$3
grep -E '^@ (ok|FAIL|skip|note)|^    \|' "$console" | sed 's/^@ //' || true
passed=$(grep -c '^@ ok' "$console" || true) failed=$(grep -c '^@ FAIL' "$console" || true)
if ! grep -q '^@ end' "$console"; then
  echo "FAIL  the board did not get to the end of its tests; its last lines:"
  tail -n 5 "$console" | sed 's/^/      | /'
  failed=$((failed + 1))
fi
echo "$name: $seconds s (log: $console)"
echo "$passed passed, $failed failed, 0 skipped"
[ "$failed" -eq 0 ]
