#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Makes a folder with the headers and libraries of a Debian release for an architecture, to build
# and link for it:
#
#   sysroot.sh SUITE ARCH FOLDER        e.g. sysroot.sh trixie arm64 build/sysroot-trixie-arm64
#
# Packages are only unpacked, so no foreign code runs and this machine's own packages stay as they
# are. Where they come from is what apt is configured to use here. FOLDER/.complete marks a finished
# one (a makefile that names its packages); a second call does nothing. The last line of a failure
# is the reason.
#
# FOLDER/DEBIAN tells dpkg-shlibdeps -S which package and version each library needs; `sysroot.sh
# --names FOLDER`, called while FOLDER is made, takes it from the downloaded packages.
set -eu
if [ "$1" = --names ]; then
  mkdir -p "$2/DEBIAN"
  for package in "$2"/var/cache/apt/archives/*.deb; do
    for name in symbols shlibs; do
      dpkg-deb --ctrl-tarfile "$package" | tar -xO "./$name" 2>/dev/null >>"$2/DEBIAN/$name" || :
    done
  done
  exit
fi
suite=$1 arch=$2 folder=$3
packages=libc6-dev,linux-libc-dev,libjpeg-dev,libpng-dev,zlib1g-dev,libcmocka-dev,libjsmn-dev
packages=$packages,libmicrohttpd-dev,libgnutls28-dev,libseccomp-dev,libstb-dev,libwebp-dev,libzstd-dev,libopenexr-dev,libsqlite3-dev,libdrm-dev,libcamera-dev,libcamera-ipa
packages=$packages,libmrcal-dev,libsuitesparse-dev,libmrgingham-dev,libopencv-calib3d-dev,libopencv-video-dev,libopencv-dnn-dev,libopencv-imgproc-dev
packages=$packages,libopengv-dev,libeigen3-dev
# The C++ headers of this machine's compilers, cross compilers included; the library itself is the
# suite's. A suite that is older than the compilers does not have them.
packages=$packages,libstdc++-$(gcc -dumpversion | cut -d . -f 1)-dev

fail() {
  echo "no sysroot for $suite $arch: $*" >&2
  exit 1
}

made_of="SYSROOT_MADE_OF := $(cksum <"$0" | cut -d ' ' -f 1) $packages"
# Complete, of these packages and by this script.
is_done() {
  [ "$(cat "$folder/.complete" 2>/dev/null)" = "$made_of" ] || return 1
  touch "$folder/.complete"
}
is_done && exit 0
command -v mmdebstrap >/dev/null || fail "mmdebstrap is not installed"
command -v apt-get >/dev/null || fail "apt is not on this machine"
mkdir -p "$(dirname "$folder")"
exec 9>"$folder.lock"
if command -v flock >/dev/null; then flock 9; fi # two builds may want it at the same time
is_done && exit 0

keyring=/usr/share/keyrings/debian-archive-keyring.gpg
[ -r $keyring ] || fail "Debian's archive keyring is missing (package debian-archive-keyring)"
# The repositories of this machine's release, with the suite's name in its place.
# shellcheck disable=SC2016 # the dollars are apt's
sources=$(apt-get indextargets \
  --format '$(ORIGIN)|$(CODENAME)|deb [signed-by='$keyring'] $(REPO_URI) $(RELEASE) $(COMPONENT)' 'Created-By: Packages' \
  2>/dev/null | grep '^Debian|' | sed "s/^Debian|\([a-z]*\)[^|]*|\(.* \)\1\([^ ]* \)/\2$suite\3/" | sort -u || true)
[ -n "$sources" ] || fail "apt knows no Debian repository (run apt-get update first)"

# Nothing is run inside the folder, so this needs neither root nor a user namespace.
mode=chrootless
[ "$(id -u)" -eq 0 ] && mode=root
try=1
while :; do
  echo "sysroot: unpacking $suite $arch packages into $folder (try $try)"
  rm -rf "$folder.part"
  if printf '%s\n' "$sources" | mmdebstrap --quiet --mode=$mode --arch="$arch" --variant=extract \
    --format=directory --include="$packages" --skip=check/qemu \
    --extract-hook="'$(readlink -f "$0")' --names \"\$1\"" --aptopt='Acquire::Retries "5"' '' "$folder.part" - \
    >"$folder.log" 2>&1; then
    break
  fi
  [ $try -lt 4 ] || fail "$(grep -E '^E:' "$folder.log" | head -n 1) (log: $folder.log)"
  sleep $((try * 5)) # a mirror that is being updated gives wrong sums for a moment
  try=$((try + 1))
done

# Links to absolute names point out of the folder: make them point into it.
find "$folder.part" -type l -lname '/*' ! -path '*/etc/*' | while read -r link; do
  target=$(readlink "$link")
  if [ -e "$folder.part$target" ]; then
    ln -sfn "$(realpath --relative-to="$(dirname "$link")" "$folder.part$target")" "$link"
  fi
done
# Links and alternatives that only an installation sets up.
for name in lib lib64; do
  [ -e "$folder.part/$name" ] || [ ! -e "$folder.part/usr/$name" ] || ln -s "usr/$name" "$folder.part/$name"
done
for libs in "$folder.part"/usr/lib/*-linux-gnu; do
  for name in blas lapack; do
    [ ! -e "$libs/$name/lib$name.so.3" ] || ln -sf "$name/lib$name.so.3" "$libs/lib$name.so.3"
  done
done
rm -rf "$folder"
mv "$folder.part" "$folder"
echo "$made_of" >"$folder/.complete"
rm -f "$folder.log"
