#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# A disk for the virtual ARM board with a Debian release and systemd, as on a board's card, made
# once a week:
#
#   root.sh IMAGE SUITE DISK        IMAGE: the folder of tests/board/image.sh
#
# debootstrap unpacks the packages here and installs them on the emulated board itself, so that no
# foreign code runs on this machine. The packages that subview depends on are on the disk; libcamera
# is not. Needs root. The last line of a failure is the reason.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
image=$1 suite=$2 disk=$3
made_from=$(sha256sum <"$here/root.sh")
[ -z "$(find "$disk" -type f -mtime -7 2>/dev/null)" ] || [ "$(cat "$disk.from" 2>/dev/null)" != "$made_from" ] || exit 0

fail() {
  echo "no disk with $suite: $*" >&2
  exit 1
}
[ "$(id -u)" -eq 0 ] || fail "debootstrap needs root"
PATH=$PATH:/usr/sbin:/sbin
for tool in debootstrap mke2fs qemu-system-aarch64; do
  command -v $tool >/dev/null || fail "$tool is not installed (tools/deps/install.sh deploy)"
done
t64=
[ "$suite" = bookworm ] || t64=t64
packages=systemd-sysv,udev,dbus,busybox,adduser,init-system-helpers,procps,libjpeg62-turbo,libpng16-16$t64
packages=$packages,libmicrohttpd12$t64,libseccomp2,zlib1g

# From where this machine's apt gets Debian, if it does; else from where debootstrap does.
# shellcheck disable=SC2016 # the dollars are apt's
mirror=$(apt-get indextargets --format '$(ORIGIN)|$(LABEL)|$(REPO_URI)' 'Created-By: Packages' 2>/dev/null |
  sed -n 's/^Debian|Debian|//p' | head -n 1)
root=$disk.root
for pause in 5 20 0; do
  rm -rf "$root"
  # shellcheck disable=SC2086 # no argument when there is no mirror
  debootstrap --foreign --arch=arm64 --variant=minbase --include="$packages" "$suite" "$root" $mirror >"$disk.log" 2>&1 && break
  [ $pause -gt 0 ] || fail "$(grep -m 1 '^E:' "$disk.log" || tail -n 1 "$disk.log") (log: $disk.log)"
  sleep $pause
done
mkdir -p "$root/etc/dpkg/dpkg.cfg.d"
# the disk is thrown away when this fails
echo force-unsafe-io >"$root/etc/dpkg/dpkg.cfg.d/installation"
echo subview >"$root/etc/hostname"
echo '/dev/vda / ext4 defaults 0 1' >"$root/etc/fstab"
mkdir -p "$root/test" "$root/etc/systemd/system/multi-user.target.wants"
cat >"$root/etc/systemd/system/deploy-test.service" <<'END'
[Service]
ExecStart=/bin/bash /test/service.sh
StandardOutput=tty
StandardError=inherit
TTYPath=/dev/ttyAMA0
END
ln -s ../deploy-test.service "$root/etc/systemd/system/multi-user.target.wants/"
ln -s /dev/null "$root/etc/systemd/system/serial-getty@ttyAMA0.service"
rm -f "$disk.part"
mke2fs -q -t ext4 -d "$root" "$disk.part" 1200M >>"$disk.log" 2>&1 || fail "mke2fs: $(tail -n 1 "$disk.log")"
rm -rf --one-file-system "$root"
"$here/boot.sh" "$image" "$disk.part" - second-stage >>"$disk.log" 2>&1 || true
grep -q '^@ installed' "$disk.log" || fail "debootstrap did not end on the board (log: $disk.log)"
mv "$disk.part" "$disk"
echo "$made_from" >"$disk.from"
