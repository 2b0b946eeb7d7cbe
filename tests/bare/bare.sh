#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# The README's commands as a newcomer gives them, on minimal Debian systems: a fresh root with make,
# git and ca-certificates, a fresh clone of this repository's HEAD inside, `make demo`, then the
# fast tests and one scenario, then the programs with clang. Ends with "N passed, N failed, N
# skipped".
#
#   bare.sh BUILD [RUN...]        default: bookworm trixie trixie-minimal trixie-board
#
# A RUN is a SUITE; SUITE-minimal, which is `make demo WITH=minimal` alone; or SUITE-board, which is
# `make board-test`: the virtual ARM board with the suite's cross compiler, kernel and libcamera.
# Needs root: each system is a chroot in a mount namespace of its own, removed at the end.
# BUILD/bare keeps the roots' archives for a week, the downloaded packages and the logs.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
source=$(cd "$here/../.." && pwd)
stereo_db=40.20 left_db=29.13 # of the demo; the same digits on every machine with AVX2, AVX-512 or
                              # NEON

skip() {
  echo "skipped: $*"
  echo "0 passed, 0 failed, 1 skipped"
  exit 0
}
fail() { # the last line of a run inside of the namespace
  echo "FAIL  $*"
  exit 1
}
first_error() {
  grep -m 1 -E 'error:|^E: |could not install|cannot find -l|\*\*\* ' "$1" || tail -n 1 "$1"
}

# --- inside of the namespace: one run -------------------------------------------------------------
inside() { # FOLDER SUITE RUN
  local folder=$1 suite=$2 run=$3 log=$1/$3.log root=$1/$3.root with=all
  [ "$run" != "$suite-minimal" ] || with=minimal
  rm -rf "$root"
  mkdir -p "$root" "$folder/$suite.debs/partial"
  tar -C "$root" -xf "$folder/$suite.tar"
  mkdir "$root/mnt/source"
  mount --bind -o ro "$source" "$root/mnt/source"
  mount --bind "$folder/$suite.debs" "$root/var/cache/apt/archives"
  mount -t proc proc "$root/proc"
  mount --rbind /dev "$root/dev"
  cp -L /etc/resolv.conf "$root/etc/resolv.conf"
  in_root() { # a command in the clone; its log has seconds since the start before each line
    local began=$SECONDS status=0
    { chroot "$root" env -i PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin HOME=/root \
      TERM=dumb sh -c "cd /srv/subview 2>/dev/null || cd /srv; $1" 2>&1 </dev/null || echo "STATUS $?"; } |
      while IFS= read -r line; do printf '%4d %s\n' $((SECONDS - began)) "$line"; done >"$log.new"
    cat "$log.new" >>"$log"
    cut -c 6- "$log.new" >"$log.now"
    grep -q '^STATUS' "$log.now" && status=1
    seconds=$((SECONDS - began))
    return $status
  }
  no_warnings() { ! grep -q 'warning:' "$log.now" || fail "$run: $(grep -m 1 'warning:' "$log.now")"; }
  second_of() { awk -v what="$1" 'index($0, what) { print $1; exit }' "$log.new"; }
  : >"$log"
  in_root "git config --global --add safe.directory '*' && git clone -q --depth 1 file:///mnt/source subview" ||
    fail "$run: clone: $(first_error "$log.now")"

  if [ "$run" = "$suite-board" ]; then
    in_root "make board-test WERROR=1" || fail "$run: $(grep -m 1 '^FAIL' "$log.now" || first_error "$log.now")"
    grep -q '^[1-9][0-9]* passed, 0 failed, 0 skipped$' "$log.now" || fail "$run: $(tail -n 1 "$log.now")"
    echo "ok    $run: make board-test: $(tail -n 1 "$log.now"), $seconds s"
    return 0
  fi
  in_root "make demo$([ $with = all ] || echo " WITH=$with")" || fail "$run: make demo: $(first_error "$log.now")"
  grep -qx "held-out views, stereo rig:   $stereo_db dB" "$log.now" ||
    fail "$run: the demo's stereo rig: $(grep -m 1 'stereo rig: ' "$log.now" || echo no figure), expected $stereo_db dB"
  grep -qx "held-out views, left camera:  $left_db dB" "$log.now" ||
    fail "$run: the demo's left camera: $(grep -m 1 'left camera: ' "$log.now" || echo no figure), expected $left_db dB"
  no_warnings
  local fetched installed begun
  fetched=$(sed -n 's/^downloaded in \([0-9]*\) s$/\1/p' "$log.now")
  installed=$(sed -n 's/^installed in \([0-9]*\) s$/\1/p' "$log.now")
  begun=$(second_of 'demo: ')
  echo "ok    $run: make demo: ${stereo_db} and ${left_db} dB after $((seconds - fetched)) s, downloads apart:" \
    "install $installed, build $((begun - installed - fetched)), demo $((seconds - begun))" \
    "($(sed -n 's/^download: //p' "$log.now") in $fetched s)"
  [ $with = all ] || return 0

  in_root "WITH=minimal tools/deps/install.sh test && make -j$(nproc) check" ||
    fail "$run: make check: $(grep -m 1 '^FAIL' "$log.now" || first_error "$log.now")"
  no_warnings
  echo "ok    $run: make check: $(tail -n 1 "$log.now"), $seconds s"
  in_root "make -j$(nproc) only TESTS=scenario/test_run" || fail "$run: test_run: $(first_error "$log.now")"
  echo "ok    $run: scenario/test_run: $(tail -n 1 "$log.now"), $seconds s"
  in_root "DEBIAN_FRONTEND=noninteractive apt-get -q -y install --no-install-recommends clang >/dev/null 2>&1 && clang --version | head -n 1 &&
    make -j$(nproc) programs CC=clang WERROR=1 BUILD=build-clang && tools/demo.sh build-clang/*/bin out/clang" ||
    fail "$run: make CC=clang: $(first_error "$log.now")"
  grep -qx "held-out views, stereo rig:   $stereo_db dB" "$log.now" ||
    fail "$run: clang: $(grep -m 1 'stereo rig: ' "$log.now"), expected $stereo_db dB"
  echo "ok    $run: $(head -n 1 "$log.now"): no warning, the same figures, $seconds s"
}
if [ "${1:-}" = --inside ]; then
  inside "$2" "$3" "$4"
  exit
fi

# --- outside --------------------------------------------------------------------------------------
build=$1
shift
[ $# -gt 0 ] || set -- bookworm trixie trixie-minimal trixie-board
if [ "$(id -u)" -ne 0 ]; then
  sudo -n true 2>/dev/null || skip "tests on minimal systems need root (sudo make bare-test)"
  exec sudo -n "$0" "$build" "$@"
fi
for tool in mmdebstrap unshare git; do
  command -v $tool >/dev/null || skip "$tool is not installed (tools/deps/install.sh bare)"
done
mkdir -p "$build/bare"
folder=$(cd "$build/bare" && pwd)

make_root() { # SUITE
  # mmdebstrap makes an archive of a name in .tar
  local archive=$folder/$1.tar part=$folder/$1.part.tar mirror try
  [ -z "$(find "$archive" -type f -mtime -7 2>/dev/null)" ] || return 0
  rm -rf "$archive" "$part"
  # From where this machine's apt gets Debian, if it does; else from where mmdebstrap does.
  # shellcheck disable=SC2016 # the dollars are apt's
  mirror=$(apt-get indextargets --format '$(ORIGIN)|$(LABEL)|$(REPO_URI)' 'Created-By: Packages' 2>/dev/null |
    sed -n 's/^Debian|Debian|//p' | head -n 1)
  for try in 1 2 3; do
    # shellcheck disable=SC2086 # no argument when there is no mirror
    mmdebstrap --quiet --variant=minbase --include=make,git,ca-certificates "$1" "$part" $mirror \
      >"$folder/$1.log" 2>&1 && mv "$part" "$archive" && return 0
    sleep $((try * 5))
  done
  return 1
}

passed=0 failed=0
for run in "$@"; do
  suite=${run%-*} began=$SECONDS
  if ! make_root "$suite"; then
    echo "FAIL  $run: no root: $(grep -m 1 '^E:' "$folder/$suite.log" || tail -n 1 "$folder/$suite.log")"
    failed=$((failed + 1))
    continue
  fi
  [ $((SECONDS - began)) -lt 2 ] || echo "note  $run: root made in $((SECONDS - began)) s"
  status=0
  unshare --mount --pid --fork --kill-child "$0" --inside "$folder" "$suite" "$run" | tee "$folder/results" || status=1
  rm -rf --one-file-system "${folder:?}/$run.root"
  passed=$((passed + $(grep -c '^ok' "$folder/results" || true)))
  if [ $status -ne 0 ]; then
    failed=$((failed + 1))
    grep -q '^FAIL' "$folder/results" || echo "FAIL  $run: ended before its time"
    sed 's/^/      | /' "$folder/$run.log" | tail -n 15
    echo "      log: $folder/$run.log"
  fi
done
echo "$passed passed, $failed failed, 0 skipped"
[ $failed -eq 0 ]
