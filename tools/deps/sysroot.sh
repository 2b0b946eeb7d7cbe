#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Makes a folder with another architecture's headers and libraries, to build and link for it:
#
#   sysroot.sh ARCH FOLDER        e.g. sysroot.sh arm64 build/sysroot-arm64
#
# Packages are only unpacked, so no foreign code runs and this machine's own packages stay as they
# are. Where they come from is what apt is configured to use here. FOLDER/.complete marks a finished
# one; a second call does nothing. The last line of a failure is the reason.
set -eu
arch=$1 folder=$2
packages=libc6-dev,linux-libc-dev,libjpeg-dev,libpng-dev,zlib1g-dev,libcmocka-dev,libjsmn-dev
packages=$packages,libmicrohttpd-dev,libseccomp-dev,libstb-dev,libwebp-dev,libzstd-dev,libcamera-dev,libcamera-ipa
# The C++ library of this distribution's compilers, cross compilers included.
packages=$packages,libstdc++-$(gcc -dumpversion | cut -d . -f 1)-dev

fail() {
  echo "no sysroot for $arch: $*" >&2
  exit 1
}

# Complete, and of these packages.
is_done() {
  [ "$(cat "$folder/.complete" 2>/dev/null)" = "$packages" ] || return 1
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
# shellcheck disable=SC2016 # the dollars are apt's
sources=$(apt-get indextargets \
  --format '$(ORIGIN)|deb [signed-by='$keyring'] $(REPO_URI) $(RELEASE) $(COMPONENT)' 'Created-By: Packages' \
  2>/dev/null | grep '^Debian|' | cut -d '|' -f 2- | sort -u || true)
[ -n "$sources" ] || fail "apt knows no Debian repository (run apt-get update first)"

# Nothing is run inside the folder, so this needs neither root nor a user namespace.
mode=chrootless
[ "$(id -u)" -eq 0 ] && mode=root
try=1
while :; do
  echo "sysroot: unpacking $arch packages into $folder (try $try)"
  rm -rf "$folder.part"
  if printf '%s\n' "$sources" | mmdebstrap --quiet --mode=$mode --arch="$arch" --variant=extract \
    --format=directory --include="$packages" --skip=check/qemu --aptopt='Acquire::Retries "5"' '' "$folder.part" - \
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
rm -rf "$folder"
mv "$folder.part" "$folder"
echo "$packages" >"$folder/.complete"
rm -f "$folder.log"
