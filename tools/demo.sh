#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# The main job end to end on the simulator: two synchronized cameras circle a scene, the runtime trains Gaussians
# on all sub-views, then on one camera alone, and says what each is worth on views that neither has seen.
# usage: tools/demo.sh [BIN_FOLDER [OUT]]
set -eu
bin=${1:-build/sim-x86/bin}
out=${2:-out/demo}
source=sim:textured,rig=stereo
exposures=4
steps=1500

run() { # NAME, further options
  name=$1
  shift
  "$bin/subview" run --source "$source" --exposures "$exposures" --steps "$steps" --gaussians 10000 \
    --out "$out/$name" "$@" > "$out/$name.txt"
}
psnr() { sed -n 's/^held-out PSNR \([0-9.-]*\) dB.*/\1/p' "$out/$1.txt"; }

mkdir -p "$out"
echo "demo: stereo rig on the simulator, $exposures exposures (8 pictures), 10000 Gaussians, $steps steps"
run stereo
echo "demo: the same with the left camera alone"
run left --sub-views left
echo
echo "held-out views, stereo rig:   $(psnr stereo) dB"
echo "held-out views, left camera:  $(psnr left) dB"
echo
echo "pictures beside renders:  $out/stereo/preview.jpg"
echo "model (any 3DGS viewer):  $out/stereo/model.ply"
echo "figures of the run:       $out/stereo/run.json"
