#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# The installed service on the virtual ARM board with Debian and systemd, booted from a disk: see
# service.sh for what is checked. Ends with "N passed, N failed, N skipped".
#
#   deploy.sh BUILD SUITE FIRST SECOND BIN TESTS
#
# FIRST and SECOND: packages of subview, the second for the upgrade. BIN, TESTS: this machine's own
# programs and tests. BUILD/deploy keeps the disks, and the console's output. Environment: CUTS, how
# often the power is cut at random (3).
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
build=$1 suite=$2 first=$3 second=$4 bin=$5 tests=$6
work=$build/deploy
mkdir -p "$work"

skip() {
  echo "skip  deploy/$suite                           $*"
  echo "0 passed, 0 failed, 1 skipped"
  exit 0
}
"$here/../board/image.sh" "$build/board/image" 2>"$work/err" || skip "$(tail -n 1 "$work/err")"
"$here/root.sh" "$build/board/image" "$suite" "$work/$suite.disk" 2>"$work/err" || skip "$(tail -n 1 "$work/err")"
started=$SECONDS
cp --sparse=always "$work/$suite.disk" "$work/$suite.run"
rm -rf "$work/files"
mkdir -p "$work/files/first" "$work/files/second"
cp "$here/service.sh" "$work/files/"
cp "$first" "$work/files/first/"
cp "$second" "$work/files/second/"

console=$work/$suite.console
: >"$console"
# One start of the machine; ended by a power cut when the board asks for it, or by itself.
run() { # SECONDS
  local log=$work/$suite.now end=$((SECONDS + $1)) status=0
  rm -f "$work/pid"
  : >"$log" # what the board said before is not for this start
  timeout -k 5 "$1" "$here/boot.sh" "$build/board/image" "$work/$suite.run" "$work/files" run "$work/pid" >"$log" 2>&1 &
  local job=$!
  while kill -0 $job 2>/dev/null && [ $SECONDS -lt $end ]; do
    if grep -q '^@ cut me' "$log"; then
      sleep "$(awk -v seed="$SECONDS$RANDOM" 'BEGIN { srand(seed); printf "%.2f", 0.5 + 2 * rand() }')"
      kill -9 "$(cat "$work/pid")"
      break
    fi
    sleep 0.3
  done
  wait $job || status=$?
  cat "$log" >>"$console"
  return $status
}
set_stage() { # the disk of a board that is off
  debugfs -w -R "rm /var/lib/deploy-test/stage" "$work/$suite.run" >/dev/null 2>&1
  echo "$1" >"$work/stage"
  debugfs -w -R "write $work/stage /var/lib/deploy-test/stage" "$work/$suite.run" >/dev/null 2>&1
}
run 1500 || true
for ((i = 1; i < ${CUTS:-3}; i++)); do run 600 || true; done
PATH=$PATH:/usr/sbin:/sbin
# Every save, with what it writes recorded; then the power is cut at each write.
recover() { # the journal of a board's disk, as a boot would
  e2fsck -p "$work/$suite.run" >/dev/null 2>&1 || true
}
next() { # STAGE SECONDS
  recover
  set_stage "$1"
  run "$2" || true
}
data=$work/$suite.data
rm -f "$data"
mke2fs -q -t ext4 "$data" 64M
cp --sparse=always "$data" "$data.before"
DATA=$data LOG=$data.log next saves 900
rm -rf "$work/cuts"
"$here/cuts.sh" "$bin" "$tests/disk-cuts" "$data.log" "$data.before" "$work/cuts" >>"$console" 2>&1 || true
for image in "$work"/cuts/*.img; do
  [ -e "$image" ] || continue
  name=${image##*/}
  DATA=$image next "back ${name%.img}" 400
done
rm -rf "$work/cuts" "$data" "$data.log" "$data.before"
next upgrade 900
rm -f "$work/$suite.run"

"$here/report.sh" "deploy/$suite" "$console" $((SECONDS - started))
