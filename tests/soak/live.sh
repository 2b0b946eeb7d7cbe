#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Live training of a moving scene in real time, at 5,000, 10,000 and 20,000 Gaussians, with one and
# two threads: a line each.
#
#   live.sh BUILD MINUTES [GAUSSIANS...]
#
# psnr_newest: held-out cameras at the last exposure; psnr_25: own images of the last 25 exposures,
# each at the end of its turn; steps: of an exposure; reduced: exposures trained on at half size;
# misses: frames dequeued after their deadline; captured = delivered + dropped; block: bytes in use
# at the end, high: at most. Exit code 1 when a ledger does not close or the block has grown.
set -eu
build=$1 minutes=$2
shift 2
[ $# -gt 0 ] || set -- 5000 10000 20000
out=$build/soak/live
mkdir -p "$out"

value() { # KEY: its first number in run.json
  sed -n "s/.*\"$1\": *\(-\{0,1\}[0-9.][0-9.]*\).*/\1/p" "$run/run.json" | head -n 1
}
of_camera() { # KEY: of the first camera's ledger
  sed -n "/\"camera\"/{s/.*\"$1\": *\([0-9]*\).*/\1/p;q;}" "$run/run.json"
}

failed=0
echo "gaussians,threads,exposures_per_s,steps,reduced,psnr_newest,psnr_25,misses,captured,delivered,dropped,block,high"
for gaussians; do
  for threads in 1 2; do
    run=$out/$gaussians-$threads
    "$build/bin/subview" run --source sim:moving,rig=stereo,size=320x240,arc=0,path=sway,turn_deg_s=0,move_m_s=0 \
      --scene dynamic --live --gaussians "$gaussians" --threads "$threads" \
      --time-limit "$(awk "BEGIN { print 60 * $minutes }")" --save-every 0 --picture-every 0 --quiet --overwrite \
      --out "$run" >"$run.log" 2>&1 || failed=1
    captured=$(of_camera captured) delivered=$(of_camera delivered)
    rate=$(awk "BEGIN { printf \"%.2f\", $(value live_exposures) / $(value seconds) }")
    block=$(value used_bytes) high=$(value high_bytes)
    echo "$gaussians,$threads,$rate,$(value live_steps),$(value live_reduced),$(value psnr),$(value live_psnr_25),$(value deadline_misses),$captured,$delivered,$((captured - delivered)),$block,$high"
    [ "$(grep -c '"is_exact": true' "$run/run.json")" = 2 ] && [ "$block" = "$high" ] || failed=1
  done
done
exit $failed
