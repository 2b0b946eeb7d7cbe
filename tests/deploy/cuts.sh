#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# The power is cut at each write of a recorded disk: all that was written before is there, or of
# what was not flushed a part is lost. Each time the file system is mounted, as a boot does, and no
# saved file may be torn; a capture must replay, which each tenth time is tried.
#
#   cuts.sh BIN DISK_CUTS LOG BEFORE OUT        BEFORE: the disk when the recording began
#
# OUT receives a disk NAME.img for each kind of file that was being saved when the power was cut,
# for the board to start from. Needs root. Lines as those of service.sh.
set -euo pipefail
bin=$1 disk_cuts=$2 log=$3 before=$4 out=$5
mkdir -p "$out"
# In memory: each mount waits for the disk below it.
work=$(mktemp -d -p /dev/shm 2>/dev/null || mktemp -d)
mkdir "$work/mnt"
mapfile -t records < <("$disk_cuts" list "$log")
n_points=${#records[@]} n_flushed=0
n_cuts=0 n_replayed=0 n_damaged=0 bad=
declare -A n_saving=()
trap 'umount "$work/mnt" 2>/dev/null || true; rm -rf --one-file-system "$work"' EXIT

fail() {
  bad=yes
  echo "@ FAIL  deploy/cuts  $*"
}
replays() { # a capture, of which exposures whose pictures were not synced may be damaged
  local code=0
  "$bin/subview" run --source "replay:$work/mnt/capture,speed=max" --exposures 1 --gaussians 100 --threads 1 --steps 1 --quiet \
    --out "$work/trained" >"$work/said" 2>&1 || code=$?
  rm -rf "$work/trained"
  [ $code -ne 0 ] || n_replayed=$((n_replayed + 1))
  [ $code -eq 0 ] || grep -q 'no frames\|without one\|rig' "$work/said"
}
keep() { # IMAGE RECORDS
  cp --sparse=always "$work/flushed" "$1"
  "$disk_cuts" apply "$log" $n_flushed "$2" 0 "$1"
}
cut_at() { # RECORDS SEED
  local name
  cp --sparse=always "$work/flushed" "$work/disk"
  "$disk_cuts" apply "$log" $n_flushed "$1" "$2" "$work/disk" || fail "record $1: not applied"
  n_cuts=$((n_cuts + 1))
  if ! mount -o loop "$work/disk" "$work/mnt"; then
    fail "record $1, seed $2: the disk cannot be mounted"
    return
  fi
  "$disk_cuts" check "$work/mnt" >"$work/found" || true
  # Pictures of a capture are synced at its end; replay finds those that a power cut took.
  n_damaged=$((n_damaged + $(grep -c "^torn .*/capture/.*\.jpg" "$work/found" || true)))
  if grep '^torn' "$work/found" | grep -qv '/capture/.*\.jpg'; then
    fail "record $1, seed $2: $(grep '^torn' "$work/found" | grep -v '/capture/.*\.jpg' | head -n 1 | sed "s|$work/mnt|disk|")"
  fi
  for name in $(sed -n 's/^saving //p' "$work/found"); do
    n_saving[$name]=$((${n_saving[$name]:-0} + 1))
    # A later one, if there is: the first checkpoint has none before it.
    [ "$2" -gt 0 ] || { [ ${n_saving[$name]} -gt 20 ] && [ -e "$out/$name.img" ]; } || keep "$out/$name.img" "$1"
  done
  if [ $((n_cuts % 10)) -eq 0 ] && [ -e "$work/mnt/capture/capture.json" ]; then
    replays || fail "record $1, seed $2: the capture does not replay: $(tail -n 1 "$work/said")"
  fi
  umount "$work/mnt"
}
cp --sparse=always "$before" "$work/flushed"
for ((i = 1; i <= n_points; i++)); do
  if [ "${records[i - 1]}" = flush ]; then # from here on all before it is there
    "$disk_cuts" apply "$log" $n_flushed "$i" 0 "$work/flushed"
    n_flushed=$i
  else
    cut_at "$i" "$i"
  fi
  cut_at "$i" 0
done
for name in token checkpoint preview model run capture; do
  [ -n "${n_saving[$name]:-}" ] || fail "no power cut in the middle of saving: $name"
done
saving=$(for name in "${!n_saving[@]}"; do echo "$name ${n_saving[$name]},"; done | sort | tr '\n' ' ')
echo "@ note  power cut at each of $n_points writes and flushes, with and without what was not flushed: $n_cuts disks"
echo "@ note  in the middle of saving: ${saving%, }; captures that replay: $n_replayed; their damaged pictures: $n_damaged"
[ -n "$bad" ] || echo "@ ok    deploy/cuts"
