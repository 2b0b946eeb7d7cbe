#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# Boots the virtual ARM board from a disk, with three vivid cameras; its console is on stdout:
#
#   boot.sh IMAGE DISK FILES STAGE [PIDFILE]
#
# FILES: a folder that the board sees as /test, or "-". STAGE is passed to tests/deploy/init.
# Environment: DATA, a disk for /var/lib/subview, and LOG, where its writes and flushes are recorded
# (disk_cuts.c). Ends when the board powers off.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
image=$1 disk=$2 files=$3 stage=$4 pidfile=${5:-}
PATH=$PATH:/usr/sbin:/sbin
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
mkdir "$work/root"
install -m 755 "$here/init" "$work/root/init"
(cd "$work/root" && find . | cpio -o -H newc --quiet) | gzip -1 | cat "$image/base.cpio.gz" - >"$work/initrd"
drives=(-drive "file=$disk,format=raw,if=virtio,cache=writeback")
if [ "$files" != - ]; then
  mke2fs -q -t ext4 -d "$files" "$work/files.img" 64M
  drives+=(-drive "file=$work/files.img,format=raw,if=virtio,readonly=on")
fi
if [ -n "${DATA:-}" ]; then
  disk="driver=raw,file.driver=file,file.filename=$DATA"
  if [ -n "${LOG:-}" ]; then
    rm -f "$LOG"
    truncate -s 4G "$LOG" # sparse
    disk="driver=blklogwrites,file.driver=raw,file.file.driver=file,file.file.filename=$DATA"
    disk="$disk,log.driver=raw,log.file.driver=file,log.file.filename=$LOG"
  fi
  drives+=(-drive "if=virtio,cache=writeback,$disk"
    -global virtio-blk-device.discard=off -global virtio-blk-device.write-zeroes=off)
fi
qemu-system-aarch64 -M virt -cpu "${BOARD_CPU:-cortex-a72}" -smp 2 -m 1536 -nographic -nic none ${pidfile:+-pidfile "$pidfile"} \
  "${drives[@]}" -kernel "$image/vmlinuz" -initrd "$work/initrd" -append \
  "console=ttyAMA0 quiet panic=-1 nokaslr kpti=off mitigations=off deploy=$stage systemd.show_status=0" </dev/null |
  sed -u 's|\r||g; s|^\x1b.*@ |@ |' # as lines come; without what resets a terminal
