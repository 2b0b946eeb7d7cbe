#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# Runs at each boot of the virtual board (deploy.sh starts it) or of a root in namespaces
# (native.sh): installs the package, and checks the service through reboots, kills, hangs, power
# cuts, an upgrade and a purge. Without camera devices the simulator stands in, and the power is cut
# for the processes only. One line a check: "@ ok NAME", "@ FAIL NAME REASON"; "@ note" lines are
# figures. The stage is kept on the disk.
memory=/var/lib/deploy-test
conf=/etc/subview/subview.conf
mkdir -p $memory
cd /root || exit 1
stage=$(cat $memory/stage 2>/dev/null || echo 0)
has_cameras=$([ ! -e /dev/video0 ] || echo yes)

ok() { echo "@ ok    deploy/$1"; }
bad() {
  echo "@ FAIL  deploy/$1  $2"
  systemctl status --no-pager -l subview.service 2>&1 | tail -n 15 | sed 's/^/    | /'
  journalctl -b -u subview.service --no-pager -o cat 2>/dev/null | tail -n 15 | sed 's/^/    | /'
}
note() { echo "@ note  $*"; }
check() { # NAME, then a test's words
  check_name=$1
  shift
  if [ "$@" ]; then ok "$check_name"; else bad "$check_name" "expected: $*"; fi
}
next_stage() {
  echo "$1" >$memory/stage
  sync
}
uptime_s() { cut -d ' ' -f 1 /proc/uptime; }
since() { awk -v a="$1" -v b="$(uptime_s)" 'BEGIN { printf "%.1f", b - a }'; }
# Outside of loopback all that the page shows needs the token.
get() { busybox wget -q -O - --header "X-Subview-Token: $(cat /var/lib/subview/token 2>/dev/null)" "$@" 2>/dev/null; }
base=http://127.0.0.1:8080
state_is() { get $base/state | grep -q "\"state\":\"$1\""; }
post() { get --post-data= "$base/$1" >/dev/null; }
until_so() { # SECONDS, then what has to become true
  local end=$(($(cut -d . -f 1 /proc/uptime) + $1))
  shift
  until "$@"; do
    [ "$(cut -d . -f 1 /proc/uptime)" -lt $end ] || return 1
    sleep 0.2
  done
}
holds() { # NAME, then a command that has to succeed
  local name=$1
  shift
  if "$@"; then ok "$name"; else bad "$name" "not so: $*"; fi
}
of_unit() { systemctl show subview.service -p "$1" --value; }
journal() { journalctl -b -u subview.service --no-pager -o cat; }
set_option() { # NAME VALUE
  sed -i "s|^$1=.*|$1=$2|" $conf
}
cut_power() { # in namespaces all processes end at once
  if [ $has_cameras ]; then echo "@ cut me"; else systemctl reboot --force --force; fi
}
newest() { find /var/lib/subview/scans -mindepth 1 -maxdepth 1 -type d 2>/dev/null | sort | tail -n 1; }
has_checkpoint() { [ -e "$(newest)/checkpoint.bin" ]; }
resumed_since() { journal | tail -n +$(($1 + 1)) | grep -q 'resumed at step'; }

case $stage in
0)
  started=$(uptime_s)
  apt-get install -y --no-install-recommends /test/first/subview_*.deb >/tmp/log 2>&1
  code=$?
  [ $code -eq 0 ] || sed 's/^/    | /' /tmp/log
  check installed_without_libcamera $code -eq 0
  note "installed in $(since "$started") s"
  check enabled "$(systemctl is-enabled subview.service)" = enabled
  if [ $has_cameras ]; then
    subview cameras >/tmp/text 2>/tmp/log
    check cameras $? -eq 0 -a "$(grep -c '^v4l2:' /tmp/text)" -ge 3 -a "$(grep -c 'v4l2: works without it' /tmp/log)" = 1
    holds page_after_installation until_so 60 state_is waiting
    set_option source v4l2:/dev/video0,size=320x180
  else
    holds page_tells_no_camera until_so 60 state_is failed
    set_option source sim:textured,rig=stereo
  fi
  set_option exposures 2
  set_option gaussians 100
  set_option steps 20
  echo save-every=0.5 >>$conf
  mkdir -p /var/lib/subview/rig
  echo kept >/var/lib/subview/rig/note
  next_stage 1
  systemctl reboot
  ;;
1)
  holds page_after_reboot until_so 120 state_is waiting
  waiting=$(uptime_s)
  # Times since the kernel's start, which in namespaces is that of the machine around them.
  usec=$(of_unit ActiveEnterTimestampMonotonic) began=$(of_unit ExecMainStartTimestampMonotonic)
  systemd=$(systemctl show -p UserspaceTimestampMonotonic --value)
  note "ready $(((usec - systemd) / 1000)) ms after systemd's start; $(((usec - began) / 1000)) ms of it are subview's"
  [ ! $has_cameras ] ||
    note "kernel and drivers took $((systemd / 1000)) ms before that; seen waiting for Start $waiting s after the kernel's start"
  systemd-analyze --no-pager critical-chain subview.service 2>&1 | grep -v '^$' | tail -n +3 | sed 's/^/    | /'
  [ ! $has_cameras ] || journalctl -b -u subview.service -o short-monotonic --no-pager | cut -c 1-110 | head -n 6 | sed 's/^/    | /'
  subview status >/tmp/log
  sed 's/^/    | /' /tmp/log
  check status "$(grep -c . /tmp/log)" = 10 -a "$(grep -c '^doing *waiting' /tmp/log)" = 1 -a "$(grep -c "#$(cat /var/lib/subview/token)" /tmp/log)" = 1
  if [ $has_cameras ]; then
    # Namespaces may not allow it.
    check realtime "$(sed -n 's/^Max realtime priority *\([0-9]*\).*/\1/p' "/proc/$(of_unit MainPID)/limits")" = 1
  fi
  sandbox=$(get $base/state | sed -n 's/.*"sandbox":"\([^"]*\)".*/\1/p')
  note "page: $sandbox"
  holds start post start
  holds scan until_so 240 state_is "done"
  check model -s "$(newest)/model.ply" -a -s "$(newest)/run.json"

  # A long scan, for what interrupts it.
  set_option steps 10000000
  systemctl restart subview.service
  until_so 60 state_is waiting
  post start
  until_so 240 has_checkpoint
  lines=$(journal | wc -l)
  started=$(uptime_s)
  kill -9 "$(of_unit MainPID)"
  holds killed_resumes until_so 240 resumed_since "$lines"
  note "killed: training goes on after $(since "$started") s"
  holds killed_trains until_so 60 state_is training
  lines=$(journal | wc -l)
  started=$(uptime_s)
  kill -STOP "$(of_unit MainPID)"
  holds hang_resumes until_so 240 resumed_since "$lines"
  note "hung: training goes on after $(since "$started") s, of which the watchdog waits 5 s at most"
  check restarts "$(of_unit NRestarts)" = 2
  next_stage cut
  cut_power
  ;;
cut)
  # The power was cut while checkpoints were being saved.
  holds cut_resumes until_so 240 resumed_since 0
  check cut_whole "$(journal | grep -c 'damaged\|no checkpoint')" = 0
  [ $has_cameras ] || next_stage upgrade
  cut_power
  ;;
saves)
  # All kinds of saves, on a disk of their own that is recorded (deploy.sh).
  until_so 240 state_is waiting
  cp $conf $memory/conf
  set_option steps 30
  set_option keep 2
  rm -f /var/lib/subview/token
  systemctl restart subview.service
  for _ in 1 2; do
    until_so 60 state_is waiting
    post start
    until_so 240 state_is "done"
    post new
  done
  check saves "$(find /var/lib/subview/scans -name model.ply | wc -l)" -ge 1
  systemctl stop subview.service
  runuser -u subview -- subview capture --source v4l2:/dev/video0,size=320x180 --exposures 6 --out /var/lib/subview/capture \
    >/tmp/log 2>&1
  check capture $? -eq 0
  cp $memory/conf $conf
  sync
  echo "@ cut me"
  ;;
back*)
  # The disk is as a power cut left it.
  holds "back_${stage#back }" until_so 240 state_is 'waiting\|capturing\|training\|done'
  if journal | grep -q 'going on with the interrupted scan'; then
    holds "back_${stage#back }_resumes" until_so 120 resumed_since 0
  fi
  resumed=$(journal | grep -o 'resumed at step [0-9]*' | head -n 1)
  note "power cut, ${stage#back }: the service is back, ${resumed:-no scan to resume}"
  echo "@ cut me"
  ;;
upgrade)
  until_so 240 state_is training
  before=$(cat $conf /var/lib/subview/rig/note /var/lib/subview/token | sha256sum)
  scans=$(find /var/lib/subview/scans -mindepth 1 -maxdepth 1 | wc -l)
  apt-get install -y --no-install-recommends /test/second/subview_*.deb >/tmp/log 2>&1
  check upgraded $? -eq 0 -a "$(dpkg-query -W -f '${Version}' subview)" = "$(dpkg-deb -f /test/second/subview_*.deb Version)"
  check upgrade_keeps "$(cat $conf /var/lib/subview/rig/note /var/lib/subview/token | sha256sum)" = "$before" \
    -a "$(find /var/lib/subview/scans -mindepth 1 -maxdepth 1 | wc -l)" -ge "$scans"
  # The scan that was stopped for it is saved, and the next one waits for Start.
  holds upgraded_waits until_so 240 state_is waiting
  apt-get purge -y subview >/tmp/log 2>&1
  check purged $? -eq 0 -a "$(find / -xdev -name '*subview*' ! -path '/proc/*' ! -path '/var/lib/subview*' ! -path '/var/cache/*' \
    ! -path '/var/log/*' ! -path '/var/lib/deploy-test*' ! -path '/test/*' | wc -l)" = 0
  find / -xdev -name '*subview*' ! -path '/proc/*' ! -path '/test/*' | sed 's/^/    | /'
  check purge_keeps -e /var/lib/subview/rig/note -a "$(find /var/lib/subview/scans -name model.ply | wc -l)" -ge 1
  echo "@ end"
  systemctl poweroff
  ;;
esac
