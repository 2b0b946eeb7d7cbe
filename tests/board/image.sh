#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# The virtual ARM board's own parts, made once and kept: Debian's arm64 kernel, the drivers of
# cameras and display (vivid from the kernel's package; vimc, vkms and v4l2loopback built from
# Debian's sources) and a small root file system.
#
#   image.sh FOLDER        leaves FOLDER/{vmlinuz,base.cpio.gz,.complete}; does nothing when they
#                          are there
#
# Packages come from where this machine's apt gets its own; nothing is installed and no foreign code
# runs. The last line of a failure is the reason.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
mkdir -p "$1"
folder=$(cd "$1" && pwd)

fail() {
  echo "no virtual board: $*" >&2
  exit 1
}
tries() { # mirrors that are being updated fail for a moment
  local pause
  for pause in 5 15 0; do
    "$@" && return 0
    sleep $pause
  done
  return 1
}

made_from=$(cat "$here/image.sh" "$here/vimc_more.c" | sha256sum)
[ "$(cat "$folder/.complete" 2>/dev/null)" = "$made_from" ] && exit 0
for tool in apt-get dpkg-deb depmod modprobe cpio aarch64-linux-gnu-gcc make bc xz; do
  command -v $tool >/dev/null || PATH=$PATH:/usr/sbin:/sbin command -v $tool >/dev/null ||
    fail "$tool is not installed (tools/deps/install.sh board)"
done
PATH=$PATH:/usr/sbin:/sbin
cd "$folder"

# An apt of its own, for arm64; the machine's package state stays as it is.
keyring=/usr/share/keyrings/debian-archive-keyring.gpg
[ -r $keyring ] || fail "Debian's archive keyring is missing (package debian-archive-keyring)"
mkdir -p apt/lists/partial apt/cache/archives/partial debs
# shellcheck disable=SC2016 # the dollars are apt's
apt-get indextargets --format '$(ORIGIN)|deb [signed-by='$keyring'] $(REPO_URI) $(RELEASE) $(COMPONENT)' \
  'Created-By: Packages' 2>/dev/null | grep '^Debian|' | cut -d '|' -f 2- | sort -u >apt/sources.list || true
[ -s apt/sources.list ] || fail "apt knows no Debian repository (run apt-get update first)"
cat >apt/apt.conf <<END
APT::Architecture "arm64"; APT::Architectures {"arm64";}; APT::Sandbox::User "root"; Acquire::Languages "none";
Acquire::Retries "5";
Dir::Etc::sourcelist "$folder/apt/sources.list"; Dir::Etc::sourceparts "-"; Dir::State::lists "$folder/apt/lists";
Dir::Cache "$folder/apt/cache"; Dir::State::status "/dev/null";
END
arm() { APT_CONFIG=$folder/apt/apt.conf "$@"; }
update() { arm apt-get update -qq; }
tries update >apt.log 2>&1 || fail "apt-get update: $(tail -n 1 apt.log)"

kernel=$(arm apt-cache depends linux-image-arm64 | awk '/Depends: linux-image/ { print $2; exit }')
version=${kernel#linux-image-}
[ -n "$version" ] || fail "the distribution has no kernel linux-image-arm64"
series=$(echo "$version" | cut -d . -f 1,2)
headers="linux-headers-$version linux-headers-${version%-arm64}-common"
kbuild=$(arm apt-cache depends "linux-headers-$version" | awk '/Depends: linux-kbuild/ { print $2; exit }')
[ -n "$kbuild" ] || fail "linux-headers-$version names no linux-kbuild"
echo "board: kernel $version"
download() { (cd debs && arm apt-get download -qq "$@"); }
# shellcheck disable=SC2086 # a list of words
tries download "$kernel" $headers "linux-source-$series" v4l2loopback-dkms busybox-static >apt.log 2>&1 ||
  fail "download: $(grep -m 1 '^E:' apt.log || tail -n 1 apt.log)"
# The kernel's build scripts run here, so they are this machine's.
download_here() { (cd debs && apt-get download -qq "$kbuild"); }
tries download_here >apt.log 2>&1 || fail "download of $kbuild: $(tail -n 1 apt.log)"

rm -rf k h b drivers
dpkg-deb -x debs/"${kernel}"_*.deb k
dpkg-deb -x debs/busybox-static_*.deb b
for package in $headers "$kbuild"; do dpkg-deb -x debs/"$package"_*.deb h; done
[ -e k/lib ] || ln -s usr/lib k/lib # Debian 13 has the modules, and busybox, below /usr
[ -e b/bin ] || ln -s usr/bin b/bin
depmod -b k "$version"
tree=$folder/h/usr/src/linux-headers-$version
sed -i "s#include /usr/src#include $folder/h/usr/src#" "$tree/Makefile"
for link in "$tree"/scripts "$tree"/tools "$folder/h/usr/src/linux-headers-${version%-arm64}-common"/{scripts,tools}; do
  [ -L "$link" ] && ln -sfn "$folder/h/usr/lib/$kbuild/$(basename "$link")" "$link"
done

# The drivers that the kernel's package leaves out, and two more vimc devices (the module makes
# one).
mkdir -p drivers/loop drivers/more drivers/gpio
(cd drivers && dpkg-deb --fsys-tarfile ../debs/linux-source-"$series"_*.deb |
  tar -xO "./usr/src/linux-source-$series.tar.xz" |
  tar -xJ "linux-source-$series/drivers/media/test-drivers/vimc" "linux-source-$series/drivers/gpio/gpio-sim.c" \
    "linux-source-$series/drivers/gpio/gpiolib.h" "linux-source-$series/kernel/irq/irq_sim.c" \
    "linux-source-$series/drivers/gpu/drm/vkms")
linux=drivers/linux-source-$series
mv "$linux/drivers/media/test-drivers/vimc" drivers/vimc
# libcamera 0.4 takes 1920x1080 from the sensor, whatever size it delivers: that takes an emulated
# core a second a frame.
sed -i -E 's/(VIMC_FRAME_MAX_WIDTH[ \t]+)4096/\1168/; s/(VIMC_FRAME_MAX_HEIGHT[ \t]+)4096/\1128/' drivers/vimc/vimc-common.h
grep -q 'VIMC_FRAME_MAX_WIDTH[ \t]*168' drivers/vimc/vimc-common.h || fail "vimc's largest frame is not where it was"
printf 'vimc-y := %s\nobj-m := vimc.o\n' "$(cd drivers/vimc && ls ./*.c | sed 's#^\./##; s/\.c$/.o/' | tr '\n' ' ')" \
  >drivers/vimc/Makefile
# A simulated GPIO chip, and the simulated interrupts that it needs; one call of these is the
# kernel's own, and generic_handle_irq does the same.
mv "$linux/drivers/gpio/gpio-sim.c" drivers/gpio/chip.c
mv "$linux/drivers/gpio/gpiolib.h" drivers/gpio/
sed 's/handle_simple_irq(irq_to_desc(irqnum))/generic_handle_irq(irqnum)/' "$linux/kernel/irq/irq_sim.c" >drivers/gpio/irq.c
printf 'gpio-sim-y := chip.o irq.o\nobj-m := gpio-sim.o\n' >drivers/gpio/Kbuild
# A virtual display.
mv "$linux/drivers/gpu/drm/vkms" drivers/vkms
printf 'vkms-y := %s\nobj-m := vkms.o\n' "$(cd drivers/vkms && ls ./*.c | sed 's#^\./##; s/\.c$/.o/' | tr '\n' ' ')" \
  >drivers/vkms/Kbuild
dpkg-deb -x debs/v4l2loopback-dkms_*.deb drivers/deb
cp drivers/deb/usr/src/v4l2loopback-*/*.[ch] drivers/loop/
echo 'obj-m := v4l2loopback.o' >drivers/loop/Kbuild
cp "$here/vimc_more.c" drivers/more/
echo 'obj-m := vimc_more.o' >drivers/more/Kbuild
for driver in vimc loop more gpio vkms; do
  # Type information (BTF) would need pahole, and nothing here reads it.
  make -s -j2 -C "$tree" M="$folder/drivers/$driver" ARCH=arm64 CROSS_COMPILE=aarch64-linux-gnu- \
    CONFIG_DEBUG_INFO_BTF_MODULES= modules \
    >"drivers/$driver.log" 2>&1 || fail "driver $driver: $(grep -m 1 -i error "drivers/$driver.log")"
done

# The root file system: busybox and the modules, in the order of their loading. run.sh adds init and
# the tests.
rm -rf root
mkdir -p root/{bin,dev,proc,sys,tmp,run,etc,modules}
cp b/bin/busybox root/bin/
modprobe -d k -S "$version" --show-depends vivid | awk '/^insmod/ { print $2 }' >modules.txt
for module in videobuf2-dma-contig configfs drm_kms_helper drm_shmem_helper; do
  modprobe -d k -S "$version" --show-depends $module | awk '/^insmod/ { print $2 }' >>modules.txt
done
take() { # the modules of a list, once each; prints their names
  awk '!seen[$0]++' "$1" | while read -r module; do
    name=$(basename "$module" .xz) # busybox loads them unpacked
    case $module in *.xz) xz -dc "$module" >"root/modules/$name" ;; *) cp "$module" root/modules/ ;; esac
    echo "$name"
  done
}
take modules.txt | grep -v '^vivid\.ko' >root/modules/order
# A board that boots from a disk (tests/deploy) needs these first.
for module in virtio_pci virtio_mmio virtio_blk ext4 crc32c_generic; do
  modprobe -d k -S "$version" --show-depends $module | awk '/^insmod/ { print $2 }'
done >disk.txt
take disk.txt >root/modules/disk
cp drivers/vimc/vimc.ko drivers/loop/v4l2loopback.ko drivers/more/vimc_more.ko \
  drivers/gpio/gpio-sim.ko drivers/vkms/vkms.ko root/modules/
cp "k/boot/vmlinuz-$version" vmlinuz
(cd root && find . | cpio -o -H newc --quiet) | gzip -1 >base.cpio.gz
rm -rf k b h drivers root apt
rm -f debs/linux-source-*
echo "$made_from" >.complete
echo "board: ready, $(du -h base.cpio.gz | cut -f 1) for the root file system"
