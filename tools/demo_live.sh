#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# The live page on the simulator, on this machine alone, until Ctrl-C.
# usage: tools/demo_live.sh [BIN_FOLDER [PORT [OUT]]]
set -u
bin=${1:-build/sim-x86/bin}
port=${2:-8080}
out=${3:-out/demo-live}

if ! [ -x "$bin/subview-preview" ]; then
  echo "demo-live: this build has no live page; 'make demo-live' without WITH=minimal builds it" >&2
  exit 1
fi
is_stopped=''
trap 'is_stopped=yes' INT TERM
echo "demo-live: a stereo rig on the simulator. Open the link in a browser and press Start; Ctrl-C ends it."
"$bin/subview" run --source sim:textured,rig=stereo --preview "127.0.0.1:$port" --session --out "$out"
code=$?
[ -z "$is_stopped" ] || exit 0
[ "$code" -eq 0 ] || echo "demo-live: ended with an error; another port: make demo-live PORT=8081" >&2
exit "$code"
