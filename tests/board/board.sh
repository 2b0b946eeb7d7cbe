#!/bin/busybox sh
# SPDX-License-Identifier: Apache-2.0
# Runs on the virtual board (run.sh starts it). One line a check: "@ ok NAME", "@ FAIL NAME
# REASON", "@ skip NAME REASON"; "@ note" lines are figures. The whole output is in the log of the
# serial line.
only=$(cat only)
out=/tmp/out
mkdir -p $out
n_failed=0

ok() { echo "@ ok    board/$1"; }
bad() {
  echo "@ FAIL  board/$1  $2"
  n_failed=$((n_failed + 1))
  for log in "$out/log" "$out/json"; do tail -n 8 "$log" 2>/dev/null | sed 's/^/    | /'; done
}
note() { echo "@ note  $*"; }
check() { # NAME, then a test's words; the rest of the reason is in the log
  check_name=$1
  shift
  if [ "$@" ]; then ok "$check_name"; else bad "$check_name" "expected: $*"; fi
}
wanted() { # and when it began, since the board's start
  [ -z "$only" ] || [ "$only" = "$1" ] || return 1
  note "$1 at $(cut -d . -f 1 /proc/uptime) s"
}
# A number or word of the JSON object on one line: value KEY FILE.
value() { sed -n "s/.*\"$1\": *\"\{0,1\}\([^,\"}]*\).*/\1/p" "$2" | head -n 1; }
# Sum of a drop reason, or of all, of camera line $1 in the text of a capture.
line_of() { grep -F "  $1 " "$2" | tail -n 1; }

vivid=$(board_tool list vivid | cut -d ' ' -f 1 | head -n 3)
hdmi=$(board_tool list vivid | cut -d ' ' -f 1 | tail -n 1)
vivid_list=$(echo $vivid | tr ' ' ,)
set -- $vivid
vivid0=$1 vivid1=$2 vivid2=$3
loop=$(board_tool list 'v4l2 loopback' | cut -d ' ' -f 1 | head -n 3)
set -- $loop
loop0=$1 loop1=$2 loop2=$3
board_tool list
for device in $vivid; do
  # stamps at the start of the frame: the default's lie in the future
  board_tool control $device timestamp_source 1
done

# A rig of three cameras: side by side (0), or each turned by so many degrees against the next.
make_rig() { # FOLDER WIDTH HEIGHT DEG
  mkdir -p "$1"
  for i in 0 1 2; do
    printf "{\n 'lensmodel': 'LENSMODEL_PINHOLE',\n 'extrinsics': [0, -%de-4, 0, -0.%d2, 0, 0],\n 'intrinsics': [%d, %d, %d.5, %d.5],\n 'imagersize': [%d, %d]\n}\n" \
      $(($i * $4 * 31416 / 180)) $i "$2" "$2" $(($2 / 2 - 1)) $(($3 / 2 - 1)) "$2" "$3" >"$1/cam$i.cameramodel"
  done
  {
    echo '{"version": 1, "name": "three", "forward": "direct", "sub_views": ['
    echo '  {"name": "cam0", "model": "cam0.cameramodel", "camera": 0},'
    echo '  {"name": "cam1", "model": "cam1.cameramodel", "camera": 1},'
    echo '  {"name": "cam2", "model": "cam2.cameramodel", "camera": 2}'
    echo ']}'
  } >"$1/rig.json"
}

# captured = delivered + dropped in the summary of a capture.
is_exact() {
  set -- $(value captured "$1") $(value delivered "$1") $(value dropped "$1")
  [ $# -eq 3 ] && [ "$1" -eq $(($2 + $3)) ]
}

n_frames() { find $out/fault -name '0*.*' 2>/dev/null | wc -l; } # of a capture with a fault
has_frames() { [ "$(n_frames)" -ge "$1" ]; }
# SECONDS, then what has to become true.
until_so() {
  tries=$(($1 * 4))
  shift
  until "$@"; do
    [ $tries -gt 0 ] || return 1
    tries=$((tries - 1))
    sleep 0.25
  done
}

# --- what is there -------------------------------------------------------------------------------
subview cameras --source-kind v4l2 >$out/log 2>&1
cat $out/log
check cameras_v4l2 "$(grep -c '^v4l2:' $out/log)" -ge 3
has_libcamera=no
if subview cameras --source-kind libcamera >$out/log 2>&1; then has_libcamera=yes; fi
cat $out/log
check cameras_libcamera "$(grep -c '^libcamera:' $out/log)" -ge 3
# On a system with another release of libcamera the module does not load: said, and V4L2 goes on.
library=$(ls /test/lib/libcamera.so.*)
mv "$library" "$library.away"
subview cameras >$out/text 2>$out/log
cat $out/log
check cameras_without_libcamera $? -eq 0 -a "$(grep -c '^v4l2:' $out/text)" -ge 3 \
  -a "$(grep -c 'the module does not load (libcamera.so' $out/log)" = 1
mv "$library.away" "$library"

# --- capture and run -----------------------------------------------------------------------------
# Heap calls between the cameras' start and stop: none of ours.
heap_of() { # NAME LOG
  note "$1: $(grep '^heap:' "$2" | tail -n 1)"
  check "$1_heap" "$(sed -n 's/^heap: started 1, ours \([0-9]*\),.*/\1/p' "$2" | tail -n 1)" = 0
}

# Depth maps of six overlapping views, from which training starts, take an emulated core 20 s: one
# run makes them, and the other rigs look apart.
job() { # NAME SOURCE WIDTH HEIGHT DEG
  make_rig $out/rig "$3" "$4" "$5"
  make_rig $out/apart "$3" "$4" 60
  rm -rf $out/cap $out/run
  LD_PRELOAD=/test/lib/heap_watch.so subview capture --source "$2" --rig $out/rig --exposures 5 --skew-limit 100 \
    --out $out/cap --json --quiet >$out/json 2>$out/log
  code=$?
  cat $out/json $out/log
  check "$1_capture" $code -eq 0 -a "$(value exposures $out/json)" = 5
  if is_exact $out/json; then ok "$1_ledger"; else bad "$1_ledger" "captured = delivered + dropped"; fi
  heap_of "$1_capture" $out/log
  LD_PRELOAD=/test/lib/heap_watch.so subview run --source "$2" --rig $out/rig --exposures 2 --steps 3 --gaussians 100 \
    --threads 2 --skew-limit 100 --out $out/run --json --quiet >$out/json 2>$out/log
  code=$?
  cat $out/json $out/log
  check "$1_run" $code -eq 0 -a "$(value steps $out/json)" = 3 -a -s $out/run/model.ply
  heap_of "$1_run" $out/log
  LD_PRELOAD=/test/lib/heap_watch.so subview run --source "$2" --rig $out/apart --exposures 2 --steps 5 --gaussians 100 \
    --threads 1 --skew-limit 100 --live --overwrite --out $out/run --json --quiet >$out/json 2>$out/log
  code=$?
  cat $out/json $out/log
  note "$1 live: $(grep '"live"' $out/run/run.json)"
  heap_of "$1_live" $out/log
  # Training leaves a CPU, so the cameras have it.
  check "$1_live" $code -eq 0 -a "$(grep -c '"is_exact": true' $out/run/run.json)" = 3 -a "$(grep -c '"capture_cpu": 0' $out/run/run.json)" = 1
}

if wanted v4l2; then job v4l2 "v4l2:$vivid_list,size=320x180" 320 180 0; fi
if wanted v4l2; then
  subview capture --source "v4l2:$hdmi,format=NM12,buffers=4" --exposures 8 --out $out/hdmi --json --quiet >$out/json 2>$out/log
  code=$?
  cat $out/json $out/log
  check v4l2_two_planes $code -eq 0 -a "$(value exposures $out/json)" = 8
  rm -rf $out/hdmi
fi
# vimc's scaler makes widths of a multiple of six.
if wanted libcamera && [ $has_libcamera = yes ]; then
  export LIBCAMERA_LOG_LEVELS='*:ERROR'
  job libcamera libcamera:0,1,2,size=162x120 162 120 60
  # What these cameras cannot do is refused, and said.
  subview capture --source libcamera:0,size=162x120,sync=client --exposures 1 --quiet --out $out/cap 2>$out/log
  check libcamera_sync_refused $? -eq 1 -a "$(grep -c 'no rpi.sync with libcamera' $out/log)" = 1
  subview capture --source libcamera:0,size=162x120 --sync frame-length --exposures 1 --quiet --out $out/cap 2>$out/log
  check libcamera_length_refused $? -eq 1 -a "$(grep -c 'report no frame rate' $out/log)" = 1
fi

# A camera whose driver loses it and finds it again (tests/board/refuse.c): libcamera's own virtual
# cameras cannot be unplugged, its handler takes no note of it.
if wanted lost && [ $has_libcamera = yes ]; then
  export LIBCAMERA_LOG_LEVELS='*:ERROR'
  node=$(grep -l 'RGB/YUV Capture' /sys/devices/platform/vimc.1/video4linux/video*/name)
  rm -rf $out/fault
  REFUSE_DEVICE=/dev/$(basename "$(dirname "$node")") REFUSE_WHILE=$out/refuse LD_PRELOAD=/test/lib/refuse.so \
    subview capture --source libcamera:0,1,2,size=162x120,stall=4000 --duration 60 --skew-limit 300 --out $out/fault \
    >$out/text 2>$out/log &
  capture=$!
  until_so 10 has_frames 9
  touch $out/refuse
  until_so 15 grep -q 'camera1: lost: ' $out/log
  rm $out/refuse
  until_so 15 grep -q 'camera1: returned: ' $out/log
  before=$(n_frames)
  until_so 10 has_frames $((before + 9)) # whole exposures again
  kill -INT $capture
  wait $capture
  code=$?
  cat $out/text $out/log
  check libcamera_lost $code -eq 0 -a "$(grep -c 'camera1: lost: ' $out/log)" = 1
  check libcamera_returned "$(grep -c 'camera1: returned: ' $out/log)" = 1 -a "$(n_frames)" -ge $((before + 9))
  note "libcamera lost: $(grep 'camera1: returned: ' $out/log)"
  check libcamera_lost_others "$(grep '^warning' $out/log | grep -v 'camera1' | grep -c ': lost: \|: damaged: ')" = 0
  set -- $(sed -n 's/.*frames: \([0-9]*\) captured = \([0-9]*\) delivered + \([0-9]*\) dropped.*/\1 \2 \3/p' $out/text)
  check libcamera_lost_ledger "${1:-0}" -eq $((${2:-1} + ${3:-1})) -a "${1:-0}" -gt 0
  rm -rf $out/fault
fi

# --- skew through the kernel ---------------------------------------------------------------------
# The median counts: the loopback stamps frames with a time of its own when the reader asks for
# buffers, so the first exposure has that skew. Its buffers are the writer's and the reader's at
# once: on a slow host the capture may come too late for a frame and sees other stamps, so it is
# measured again, four times at most.
play_skew() { # DEVICE DEVICE
  board_tool feed 30 20 $loop0:0 $loop1:7 $loop2:14 >$out/feed 2>&1 &
  feeder=$!
  for second in 1 2 3 4 5 6 7 8 9 10; do
    grep -q feeding $out/feed && break
    sleep 1
  done
  subview capture --source "v4l2:$1,$2,lock=off,buffers=8,clock=monotonic" --exposures 40 --skew-limit 1 --out $out/skew --json --quiet \
    >$out/json 2>$out/log
  code=$?
  kill $feeder 2>/dev/null
  wait $feeder 2>/dev/null
  cat $out/json $out/log $out/feed
  rm -rf $out/skew
}
skew() { # NAME DEVICE DEVICE US
  for attempt in 1 2 3 4 5; do
    play_skew "$2" "$3"
    measured=$(value skew_us_p50 $out/json)
    note "skew of $4 us through the kernel: measured ${measured:-nothing} us"
    [ $code -eq 0 ] && [ "${measured%.*}" = "$4" ] && break
  done
  check "$1" $code -eq 0 -a "${measured%.*}" = "$4"
}
if wanted skew; then
  skew skew_7_us $loop0 $loop1 7
  skew skew_14_us $loop0 $loop2 14
fi

# --- the source suite ----------------------------------------------------------------------------
# Requests by count and kind; every camera starts and stops some hundred times. Most of it is
# waiting for frames, and the cameras of the two are others: both at once.
suite_start() { # NAME SPEC
  (
    source-check "$2" >"$out/$1.log" 2>&1
    echo $? >"$out/$1.code"
  ) &
}
suite_end() { # NAME
  mv "$out/$1.log" $out/log
  cat $out/log
  note "$1: $(tail -n 1 $out/log)"
  check "$1" "$(cat "$out/$1.code")" -eq 0 -a "$(grep -c '^ok ' $out/log)" = 31
}
if wanted suite; then
  suite_start suite_v4l2 "v4l2:$vivid_list,size=320x180,fps=30,buffers=4,dmabuf=on"
  [ $has_libcamera = yes ] && suite_start suite_libcamera libcamera:0,1,2,size=162x120,buffers=4
  wait
  suite_end suite_v4l2
  [ $has_libcamera = yes ] && suite_end suite_libcamera
fi

# --- faults --------------------------------------------------------------------------------------
# A line for each fault: named, the other cameras untouched, back within three frames, the ledger
# exact.
faults() { # NAME SPEC
  source-faults "$2" >$out/log 2>&1
  cat $out/log
  while read -r word name rest; do
    case $word in
    ok) ok "$1_${name%:}" && note "$name $rest" ;;
    FAIL) bad "$1_${name%:}" "$rest" ;;
    skip) echo "@ skip  board/$1_${name%:}  $rest" ;;
    note) note "$name $rest" ;;
    esac
  done <$out/log
  check "$1" "$(grep -c '^ok \|^skip ' $out/log)" = "$3"
}
# What a user sees of it.
if wanted faults; then
  subview capture --source "v4l2:$vivid_list,size=320x180" --duration 4 --skew-limit 200 --out $out/fault \
    >$out/text 2>$out/log &
  capture=$!
  sleep 2
  board_tool control $vivid0 disconnect 1 || echo "control failed"
  wait $capture
  code=$?
  cat $out/text $out/log
  check capture_of_a_fault $code -eq 0 -a "$(grep -c 'video0: lost: \|video0: returned: ' $out/log)" -ge 2
  faults fault "v4l2:$vivid_list,size=320x180,fps=10" 13
  faults hdmi "hdmi:$hdmi,$vivid1" 5
  faults loop "loop:$loop0,$loop1,$loop2,lock=off,clock=monotonic" 3
fi

# --- trigger pulses ------------------------------------------------------------------------------
# On a line of gpio-sim, whose other side tells what the kernel put on it: the tracing system stamps
# each change, and the chip's `value` is what the line has now. The chip is made in configfs.
trace=/sys/kernel/tracing
trigger() { # OPTIONS SECONDS: a capture by pulses
  subview capture --source "v4l2:$vivid0,$vivid1,size=320x180,$1" --sync trigger --duration "$2" --skew-limit 200 \
    --out $out/pulses --json --quiet >$out/json 2>$out/log
  code=$?
  cat $out/json $out/log
  rm -rf $out/pulses
}
refused() { # NAME OPTIONS SENTENCE
  trigger "$2" 1
  check "trigger_$1" $code -eq 1 -a "$(grep -c "$3" $out/log)" = 1
}
if wanted trigger; then
  mount -t configfs config /sys/kernel/config
  mount -t tracefs trace $trace
  chip_config=/sys/kernel/config/gpio-sim/board
  mkdir -p $chip_config/bank/line1/hog
  echo 4 >$chip_config/bank/num_lines
  echo lamp >$chip_config/bank/line1/hog/name
  echo output-low >$chip_config/bank/line1/hog/direction
  echo 1 >$chip_config/live
  chip=$(cat $chip_config/bank/chip_name)
  line=/sys/devices/platform/$(cat $chip_config/dev_name)/$chip/sim_gpio3/value
  mdev -s
  echo mono >$trace/trace_clock
  echo 4096 >$trace/buffer_size_kb
  echo 1 >$trace/events/gpio/gpio_value/enable
  trigger "trigger=gpio:$chip:3,trigger-period=33333,trigger-width=5000" 36
  echo 0 >$trace/events/gpio/gpio_value/enable
  # "... 12.345678: gpio_value: 511 set 1": rising edges, and how far each is from the line through
  # their times.
  awk -v skipped="$(value skipped $out/json)" -v late_max="$(value max $out/json)" '/gpio_value: [0-9]+ set 1/ { for (i = 1; i <= NF; i++) if ($i == "gpio_value:") { t[n++] = $(i - 1) + 0 } }
    / set 0/ { down++ }
    END {
      for (i = 1; i < n; i++) {
        d = (t[i] - t[i - 1]) * 1e6
        if (d - 33333 > late || 33333 - d > late) late = d > 33333 ? d - 33333 : 33333 - d
        near += (d > 32333 && d < 34333)
      }
      mean = 1e6 * (t[n - 1] - t[0]) / (n - 1 + skipped)
      off = (mean - 33333) * (n - 1 + skipped) # of the last, beside the first
      printf "pulses %d down %d near %d grid %d\n", n, down, near, off < late_max + 100 && -off < late_max + 100
      printf "%d pulses on the line in %.3f s, %d left out, mean period %.1f us; %.2f %% of the periods within 1 ms, the worst off by %.0f us\n", \
        n, t[n - 1] - t[0], skipped, mean, 100 * near / (n - 1), late
    }' $trace/trace >$out/pulses
  cat $out/pulses
  note "$(tail -n 1 $out/pulses)"
  note "as subview tells it: $(sed -n 's/.*"trigger": {\(.*\)}}.*/\1/p' $out/json)"
  set -- $(head -n 1 $out/pulses)
  check trigger_pulses $code -eq 0 -a "${2:-0}" -ge 1000 -a "${2:-0}" = "$(value pulses $out/json)"
  check trigger_ends_low "$(cat "$line")" = 0 -a "${4:-1}" -ge "${2:-0}"
  # An emulated processor that waits for its host is late with single pulses, or leaves some out;
  # the grid stays, so the last one is off by no more than the lateness that subview tells.
  check trigger_periods "${8:-0}" = 1 -a "$((${6:-0} * 3))" -ge "${2:-1}"
  check trigger_exposures "$(value exposures $out/json)" -gt 10
  # A run, whose rig names the line.
  make_rig $out/rig 320 180 0
  sed -i "s/\"forward\"/\"trigger\": {\"line\": \"gpio:$chip:3\", \"period_us\": 100000, \"polarity\": \"low\"}, \"forward\"/" $out/rig/rig.json
  subview run --source "v4l2:$vivid_list,size=320x180" --sync trigger --rig $out/rig --exposures 2 --steps 3 --gaussians 100 \
    --skew-limit 200 --overwrite --out $out/run --json --quiet >$out/json 2>$out/log
  code=$?
  cat $out/json $out/log
  grep '"trigger"' $out/run/run.json
  check trigger_run $code -eq 0 -a "$(grep -c "\"trigger\": {\"line\": \"gpio:$chip:3\", \"period_us\": 100000.000, .*\"pulses\": [1-9]" $out/run/run.json)" = 1
  refused no_line "trigger=gpio:gpiochip99:0,fps=25" 'gpiochip99 cannot be opened'
  refused beyond "trigger=gpio:$chip:4,fps=25" 'has the lines 0 to 3'
  refused busy "trigger=gpio:$chip:1,fps=25" 'is used by "lamp"'
  refused unnamed "fps=25" 'no trigger line is named'
  refused no_pwm "trigger=pwm:pwmchip0:0,fps=25" 'there is no'
  refused no_mode "trigger=gpio:$chip:3,fps=25,trigger-mode=frame_sync:1" 'would not wait for the trigger line'
  refused no_driver "trigger=gpio:$chip:3,fps=25,trigger-mode=imx296.trigger_mode:1" "sensor's driver loaded"
fi

# --- the page ------------------------------------------------------------------------------------
# Its server in its sandbox, on the kernel that boards have.
get() { wget -q -O - "$@"; }
base=http://127.0.0.1:8080
state_is() { get $base/state | grep -q "\"state\":\"$1\""; }
is_another() { [ "$(pidof subview-preview || echo $1)" != "$1" ]; }
# NAME, then a command that has to succeed (or with "not" to fail).
holds() {
  holds_name=$1
  shift
  if [ "$1" = not ]; then
    shift
    "$@" >/dev/null && bad "$holds_name" "it was answered" || ok "$holds_name"
  else
    "$@" >/dev/null && ok "$holds_name" || bad "$holds_name" "not so: $*"
  fi
}
if wanted page; then
  ifconfig lo 127.0.0.1 up
  subview run --source sim:textured,rig=stereo,size=64x48 --exposures 2 --steps 20 --gaussians 500 --threads 1 \
    --preview 8080 --session --out $out/page >$out/text 2>$out/log &
  run=$!
  holds page_waiting until_so 60 state_is waiting
  note "page: $(get $base/state | sed -n 's/.*"sandbox":"\([^"]*\)".*/\1/p')"
  get $base/state >$out/state
  holds page_sandbox grep -q 'seccomp, no_new_privs' $out/state
  holds page_token not get --post-data= $base/start
  holds page_traversal not get $base/%2e%2e/%2e%2e/etc/passwd
  token=$(sed -n 's/.*#//p' $out/log | head -n 1)
  holds page_start get --header "X-Subview-Token: $token" --post-data= $base/start
  holds page_done until_so 120 state_is "done"
  get $base/model.ply | head -c 3 >$out/ply
  check page_download "$(cat $out/ply)" = ply
  server=$(pidof subview-preview)
  kill -9 $server
  holds page_restarted until_so 30 is_another "$server"
  holds page_again until_so 30 state_is "done"
  kill -INT $run
  wait $run
  check page_end $? -eq 0
fi

# --- the screen ----------------------------------------------------------------------------------
# On the kernel's virtual display. What display-check reads back comes through a second descriptor.
if wanted display; then
  display-check auto >$out/log 2>&1
  code=$?
  cat $out/log
  check display_equals_render $code -eq 0 -a "$(grep -c ' 0 differ$' $out/log)" = 1
  note "$(tail -n 1 $out/log)"
  subview run --source sim:textured,rig=stereo,size=64x48 --exposures 2 --time-limit 60 --gaussians 500 --threads 1 \
    --display auto --out $out/screen >$out/text 2>$out/log &
  run=$!
  sleep 2 # it opens the screen first
  looks() { display-check --look auto >$out/look 2>&1 && grep -q "$1" $out/look; }
  holds display_shows until_so 30 looks 'colors: [0-9][0-9][0-9]'
  note "subview run --display: $(cat $out/look)"
  subview run --source sim:textured,rig=stereo,size=64x48 --exposures 1 --steps 1 --display auto --out $out/second 2>$out/log
  check display_taken $? -eq 1 -a "$(grep -c 'another program has the screen' $out/log)" = 1
  kill -INT $run
  wait $run
  check display_end $? -eq 0
  subview run --source sim:textured,rig=stereo --check --display card0:DP-7 --out $out/none >$out/text 2>$out/log
  check display_missing $? -eq 1 -a "$(grep -c 'has no connector DP-7' $out/log)" = 1
fi
[ $n_failed -eq 0 ]
