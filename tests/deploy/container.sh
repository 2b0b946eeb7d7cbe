#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# Starts the systemd of a root folder as the first process of namespaces of its own, and returns
# when it powers off or reboots:
#
#   container.sh ROOT SECONDS        needs root; after SECONDS everything inside is killed
#
# The machine's own services, network and control groups are out of its sight.
set -euo pipefail
if [ "$1" != --inside ]; then
  # A reboot ends the first process by a signal.
  timeout -s KILL "$2" unshare --mount --pid --fork --cgroup --net --uts --ipc --kill-child=KILL "$0" --inside "$1" || true
  exit 0
fi
root=$2
mount --make-rprivate /
mount --bind "$root" "$root"
mount -t proc proc "$root/proc"
mount -t sysfs -o ro sysfs "$root/sys"
mount -t cgroup2 cgroup2 "$root/sys/fs/cgroup"
mount -t tmpfs -o mode=755 tmpfs "$root/dev"
for name in null zero full random urandom tty; do
  touch "$root/dev/$name"
  mount --bind "/dev/$name" "$root/dev/$name"
done
mkdir "$root/dev/pts" "$root/dev/shm"
mount -t devpts -o newinstance,ptmxmode=666,mode=620 devpts "$root/dev/pts"
ln -s pts/ptmx "$root/dev/ptmx"
ln -s /proc/self/fd "$root/dev/fd"
cd "$root"
pivot_root . mnt
umount -l /mnt
# systemd asks for this variable to know that the kernel is not its own.
exec env -i container=subview PATH=/usr/sbin:/usr/bin:/sbin:/bin /sbin/init systemd.unit=multi-user.target </dev/null
