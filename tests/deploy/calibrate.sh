#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# subview-calibrate of another architecture or release, against this machine's, on the real stereo
# pairs: RMS to 1e-3 px, focal lengths to 0.01 %, time and peak memory noted.
#
#   calibrate.sh BIN EMULATOR WORK        the programs of this machine are those of `make programs`
set -euo pipefail
cd "$(dirname "$(readlink -f "$0")")/../.."
bin=$1 emulator=$2 work=$3
unset MAKEFLAGS MAKELEVEL MFLAGS SUITE BOARD
make --no-print-directory -j"$(nproc)" programs >/dev/null
here=build/$([ "$(uname -m)" = aarch64 ] && echo generic-arm64 || echo sim-x86)/bin

calibrate() { # NAME, then a command
  local name=$1 began=$SECONDS
  shift
  rm -rf "${work:?}/$name"
  "$@" board --images 'tests/data/stereo_chessboard/left??.jpg' 'tests/data/stereo_chessboard/right??.jpg' \
    --board 9x6 --spacing 0.025 --out "$work/$name" >"$work/$name.log" 2>&1 &
  local pid=$! peak_kib=0 now
  while now=$(sed -n 's/^VmHWM:[^0-9]*\([0-9]*\).*/\1/p' /proc/$pid/status 2>/dev/null) && [ -n "$now" ]; do
    peak_kib=$now # the largest so far
    sleep 0.2
  done
  wait $pid || { cat "$work/$name.log"; exit 1; }
  echo "note  calibration, $name: $(sed -n 's/^\([0-9.]* px RMS\).*/\1/p' "$work/$name.log"), $((SECONDS - began)) s," \
    "$((peak_kib / 1024)) MiB at most"
}
figures() { # RMS and the four focal lengths
  grep -oE '"(rms_px|fx_px|fy_px)": [0-9.e-]+' "$work/$1/calibration.json" | awk '{ print $2 }' | head -n 7
}
calibrate rig-here "$here/subview-calibrate"
# shellcheck disable=SC2086 # a command and its arguments
calibrate rig-there $emulator "$bin/subview-calibrate"
if paste <(figures rig-here) <(figures rig-there) | awk '
  function far(a, b) { d = a - b; return (a > 10 ? d / a : d / 10) }
  { d = far($1, $2); if (d < 0) d = -d; if (d > 1e-4 || $2 == "") bad = 1; n++; if (d > most) most = d }
  END { printf "note  largest difference: %.1e of a focal length, or 10 px of RMS\n", most; exit bad || n != 7 }'; then
  echo "1 passed, 0 failed, 0 skipped"
else
  echo "FAIL  deploy/calibration"
  paste <(figures rig-here) <(figures rig-there)
  echo "0 passed, 1 failed, 0 skipped"
  exit 1
fi
