#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Installs what is missing from the distribution's packages (Debian and its kin), and nothing else:
#
#   install.sh build    compiler and libraries of the programs
#   install.sh test     the same, and what the tests use
#   install.sh tidy     the same, and the static analysers
#   install.sh board    for the build, and what the virtual ARM board needs
#
# Looks for files, not for packages, so it is done in an instant when everything is there, whoever installed
# it. sudo is asked only when something is missing. What only makes some checks run (the others are then
# counted as skipped) may fail to install; the rest may not. `--list` prints the packages that are missing and
# changes nothing.
set -u
what=${1:-build} list=${2:-}
needed='' wanted=''

has_header() {
  for folder in /usr/include /usr/include/"$(uname -m)"-linux-gnu /usr/local/include; do
    [ -e "$folder/$1" ] && return 0
  done
  return 1
}
header() { has_header "$1" || needed="$needed $2"; }
command_() { command -v "$1" >/dev/null 2>&1 || needed="$needed $2"; }
wanted_header() { has_header "$1" || wanted="$wanted $2"; }
optional() { command -v "$1" >/dev/null 2>&1 || wanted="$wanted $2"; }

command_ gcc build-essential
command_ make build-essential
command_ g++ build-essential
header stdlib.h libc6-dev
header jsmn.h libjsmn-dev
header jpeglib.h libjpeg62-turbo-dev
header png.h libpng-dev
header zlib.h zlib1g-dev
# The live view's server, and SPZ version 4; without them they say so
wanted_header microhttpd.h libmicrohttpd-dev
wanted_header seccomp.h libseccomp-dev
wanted_header zstd.h libzstd-dev
# cameras behind libcamera; without it V4L2 remains
wanted_header libcamera/libcamera/libcamera.h "libcamera-dev libcamera-ipa"
# subview-calibrate; without one of these it says what it cannot do
wanted_header mrcal/mrcal.h libmrcal-dev
wanted_header suitesparse/cholmod.h libsuitesparse-dev
wanted_header mrgingham/mrgingham.hh libmrgingham-dev
wanted_header opencv4/opencv2/calib3d.hpp libopencv-dev
wanted_header opengv/types.hpp libopengv-dev
wanted_header eigen3/Eigen/Core libeigen3-dev
case $what in
build) ;;
board)
  optional aarch64-linux-gnu-gcc "gcc-aarch64-linux-gnu libc6-dev-arm64-cross"
  optional aarch64-linux-gnu-g++ g++-aarch64-linux-gnu
  optional qemu-system-aarch64 qemu-system-arm
  optional mmdebstrap mmdebstrap
  optional cpio cpio
  optional bc bc
  optional xz xz-utils
  PATH=$PATH:/usr/sbin:/sbin
  optional depmod kmod
  [ -r /usr/share/keyrings/debian-archive-keyring.gpg ] || wanted="$wanted debian-archive-keyring"
  ;;
test | tidy)
  header cmocka.h libcmocka-dev
  optional clang-format clang-format
  optional chromium chromium   # opens the live view's page
  optional valgrind valgrind   # counts instructions against their record
  optional gnuplot gnuplot-nox # draws the plots of subview-lab tables
  if [ "$(uname -m)" = x86_64 ]; then # the ARM build, under emulation
    optional aarch64-linux-gnu-gcc "gcc-aarch64-linux-gnu libc6-dev-arm64-cross"
    optional aarch64-linux-gnu-g++ g++-aarch64-linux-gnu # libcamera's shim
    optional qemu-aarch64-static qemu-user-static
    optional mmdebstrap mmdebstrap
    [ -r /usr/share/keyrings/debian-archive-keyring.gpg ] || wanted="$wanted debian-archive-keyring"
  fi
  if [ "$what" = tidy ]; then
    optional clang-tidy clang-tidy
    optional cppcheck cppcheck
  fi
  ;;
*)
  echo "install.sh: the first word is build, test, tidy or board, not $what" >&2
  exit 2
  ;;
esac
if [ "$list" = --list ]; then
  for package in $needed $wanted; do echo "$package"; done | sort -u
  exit 0
fi
[ -z "$needed$wanted" ] && exit 0

if ! command -v apt-get >/dev/null 2>&1; then
  echo "install.sh: not a Debian kind of system; these are missing (Debian's names):$needed$wanted"
  [ -z "$needed" ] && exit 0
  exit 1
fi

as_root=''
if [ "$(id -u)" -ne 0 ]; then
  as_root=sudo
  if ! command -v sudo >/dev/null 2>&1 || { ! [ -t 0 ] && ! sudo -n true 2>/dev/null; }; then
    echo "install.sh: not root, and sudo cannot be asked; please run: apt-get install$needed$wanted"
    [ -z "$needed" ] && exit 0
    exit 1
  fi
fi

is_updated=''
update() { # mirrors that are being synchronized fail for a moment: try again
  [ -n "$is_updated" ] && return 0
  for pause in 5 15 30 0; do
    echo "install.sh: apt-get update"
    if $as_root apt-get -q -o DPkg::Lock::Timeout=300 update >/dev/null; then
      is_updated=yes
      return 0
    fi
    sleep $pause
  done
  return 1
}
install_() {
  for pause in 5 20 0; do
    echo "install.sh: apt-get install $*"
    # shellcheck disable=SC2086 # as_root may be nothing
    $as_root env DEBIAN_FRONTEND=noninteractive apt-get -q -y -o DPkg::Lock::Timeout=300 \
      -o Acquire::Retries=3 -o Dpkg::Use-Pty=0 install --no-install-recommends "$@" >/dev/null && return 0
    sleep $pause
    is_updated=''
    update || true
  done
  return 1
}

update || echo "install.sh: apt-get update failed; trying with what apt knows"
# shellcheck disable=SC2086 # lists of words
if [ -n "$needed" ] && ! install_ $needed; then
  echo "install.sh: could not install$needed"
  exit 1
fi
for package in $wanted; do
  install_ "$package" || echo "install.sh: could not install $package; what uses it is left out"
done
exit 0
