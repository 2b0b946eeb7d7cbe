#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# The main job end to end on the simulator. Two synchronized cameras circle a scene; the runtime
# trains Gaussians on all sub-views, then on the left camera alone. The demo prints the PSNR of both
# on held-out views and leaves one sheet of these views, one turntable and the model.
# usage: tools/demo.sh [BIN_FOLDER [OUT]]
set -eu
bin=${1:-build/sim-x86/bin}
out=${2:-out/demo}
source=textured,rig=stereo
exposures=4
steps=1500

fail() {
  echo "demo: $1" >&2
  exit 1
}

# A step of the demo: NAME of its log, what it does, the command.
step() {
  name=$1 text=$2
  shift 2
  echo "demo: $text"
  "$@" >"$out/$name.txt" 2>&1 && return
  last=$(grep . "$out/$name.txt" | tail -n 1)
  fail "this step failed: ${last:-it printed nothing} (log: $out/$name.txt)"
}
run() { # NAME, what it does, further options
  name=$1 text=$2
  shift 2
  step "$name" "$text" "$bin/subview" run --source "sim:$source" --exposures "$exposures" --steps "$steps" \
    --gaussians 10000 --overwrite --out "$out/$name" "$@"
}
psnr() { sed -n 's/^held-out PSNR \([0-9.-]*\) dB.*/\1/p' "$out/$1.txt"; }

[ -x "$bin/subview" ] || fail "$bin has no subview; 'make programs' builds it"
bin=$(cd "$bin" && pwd)
mkdir -p "$out" 2>/dev/null || fail "the folder $out cannot be made"
out=$(cd "$out" && pwd)
rm -f "$out/turntable.webp" "$out/sheet.png"

run stereo "stereo rig on the simulator, $exposures exposures (8 pictures), 10000 Gaussians, $steps steps"
run left "the same with the left camera alone" --sub-views left
step data "the held-out views as a dataset" \
  "$bin/subview-lab" import --from sim "$source,exposures=$exposures" --out "$out/data"
step sheet "held-out views: truth, stereo rig, left camera" \
  "$bin/subview-lab" compare --data "$out/data" --model "$out/stereo/model.ply" "$out/left/model.ply" \
  --labels "stereo rig,left camera alone" --out "$out/sheet.png"
step turntable "a turntable of the stereo rig's model" \
  "$bin/subview-lab" render --data "$out/data" --model "$out/stereo/model.ply" --orbit 72 --width 480 \
  --out "$out/turntable"
turntable=$out/turntable
if [ -f "$turntable/orbit.webp" ]; then
  mv "$turntable/orbit.webp" "$out/turntable.webp"
  turntable=$out/turntable.webp
fi

if [ -x "$bin/subview-preview" ]; then
  live="the live page on the simulator (make demo-live, or this; open the link that it prints):
  subview run --source sim:$source --preview 127.0.0.1:8080 --session --out out/demo-live"
else
  live="the live page on the simulator (not in this build, which is minimal; this builds the rest):
  make demo-live"
fi

cat <<END

held-out views, stereo rig:   $(psnr stereo) dB
held-out views, left camera:  $(psnr left) dB

sheet (truth, stereo, one camera):  $out/sheet.png
turntable (opens in a browser):     $turntable
model (opens in any 3DGS viewer):   $out/stereo/model.ply
figures of the run:                 $out/stereo/run.json

the programs are here:
  export PATH="$bin:\$PATH"
next, $live
next, your own COLMAP or nerfstudio folder, or a capture, in place of DIR:
  subview-lab train --data DIR --eval --out out/mine
END
