#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# The packages of this build: packed twice, their bytes are the same; lintian finds no error; they
# depend on what they should, hold what they should, and nothing of a build's folder.
#   packages.sh        environment: BUILD, O (the board's folder)
# Ends with "N passed, N failed, N skipped".
set -u
build=${BUILD:-build} o=${O:?}
cd "$(dirname "$(readlink -f "$0")")/../.." || exit 2
tmp=$(mktemp -d)
trap 'rm -rf "$tmp"' EXIT
trap 'exit 130' INT TERM HUP
# A make of its own: what the outer one was told is not for this one.
unset MAKEFLAGS MAKELEVEL MFLAGS CROSS
passed=0 failed=0 skipped=0
verdict() { # exit code, name
  if [ "$1" -eq 0 ]; then
    passed=$((passed + 1))
    echo "ok: $2"
  else
    failed=$((failed + 1))
    echo "FAILED: $2"
  fi
}
skip() {
  skipped=$((skipped + 1))
  echo "skipped: $1"
}
for tool in dpkg-deb dpkg-shlibdeps; do
  command -v $tool >/dev/null || { echo "skipped: $tool is not installed"; exit 77; }
done

pack() { make --no-print-directory -j"$(nproc)" BUILD="$build" SAN= package >"$tmp/log" 2>&1 || cat "$tmp/log"; }
sums() { (cd "$o/packages" && sha256sum ./*.deb); }
pack
sums >"$tmp/first"
cat "$tmp/first"
[ "$(wc -l <"$tmp/first")" -eq 4 ]
verdict $? "four packages"
pack
sums | diff "$tmp/first" -
verdict $? "packed twice, the same bytes"

field() { dpkg-deb -f "$o"/packages/"$1"_*.deb "$2"; }
# Names alone, without versions and the suffix of Debian 13's 64-bit times.
names() { field subview "$1" | sed 's/([^)]*)//g; s/t64//g; s/[ ,]\{1,\}/ /g; s/ $//'; }
[ "$(names Depends)" = "adduser init-system-helpers libc6 libgnutls30 libjpeg62-turbo libmicrohttpd12 \
libpng16-16 libseccomp2 zlib1g" ]
verdict $? "subview depends on: $(names Depends)"
names Recommends | grep -q 'libcamera[0-9]'
verdict $? "subview recommends: $(names Recommends)"
field subview-calibrate Depends | grep -q 'libmrcal.*libopencv'
verdict $? "subview-calibrate depends on mrcal and OpenCV"
field subview-lab Recommends | grep -q 'libopencv-dnn' && ! field subview-lab Depends | grep -q opencv
verdict $? "subview-lab recommends OpenCV for depth networks and matching"

holds() { # package, paths
  package=$1
  shift
  dpkg-deb --fsys-tarfile "$o"/packages/"$package"_*.deb | tar -t >"$tmp/list"
  for path in "$@"; do
    grep -qx "\./$path" "$tmp/list" || { echo "no $path"; return 1; }
  done
}
holds subview usr/bin/subview usr/bin/subview-preview usr/lib/subview/subview-libcamera.so usr/share/man/man1/subview.1.gz \
  usr/share/bash-completion/completions/subview usr/share/doc/subview/copyright usr/lib/systemd/system/subview.service \
  etc/subview/subview.conf usr/lib/udev/rules.d/60-subview.rules usr/lib/subview/status usr/lib/subview/mdns usr/lib/systemd/system/subview-mdns.service
verdict $? "files of subview"
holds libsubview-dev usr/include/subview/subview.h "usr/lib/$(uname -m)-linux-gnu/libsubview.a" \
  "usr/lib/$(uname -m)-linux-gnu/pkgconfig/subview.pc"
verdict $? "files of libsubview-dev"
mkdir "$tmp/root"
for package in "$o"/packages/*.deb; do dpkg-deb -x "$package" "$tmp/root"; done
! grep -rlF "$PWD" "$tmp/root"
verdict $? "nothing names the folder of the build"
"$tmp/root/usr/bin/subview" --version
verdict $? "subview starts from the package's files"

dpkg-deb -I "$o"/packages/subview_*.deb conffiles | grep -qx /etc/subview/subview.conf
verdict $? "the configuration is kept by upgrades"
(cd "$tmp" && sed "s|^token-file=.*|token-file=$tmp/token|; s|^preview=.*|preview=18081|; \
  s|^source=.*|source=sim:textured|" root/etc/subview/subview.conf >conf && root/usr/bin/subview run --config conf --out scans --check)
verdict $? "subview takes the service's configuration"
if systemd-analyze security --help 2>/dev/null | grep -q offline; then
  systemd-analyze security --offline=true --threshold=25 "$tmp/root/usr/lib/systemd/system/subview.service" >"$tmp/security" 2>&1
  code=$?
  tail -n 1 "$tmp/security"
  verdict $code "the service's exposure is 2.5 or lower"
else
  skip "no systemd-analyze security here"
fi

if command -v lintian >/dev/null; then
  lintian --allow-root "$o"/packages/*.deb >"$tmp/lintian" 2>&1
  cat "$tmp/lintian"
  ! grep -q '^E:' "$tmp/lintian"
  verdict $? "lintian finds no error"
else
  skip "lintian is not installed"
fi
echo "$passed passed, $failed failed, $skipped skipped"
[ $failed -eq 0 ]
