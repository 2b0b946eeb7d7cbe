#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# Debian packages of one build, from its files as `make install` lays them out:
#
#   package.sh STAGE OUT ARCH SUITE REVISION [SYSROOT]      make package calls it
#
# OUT receives the packages of tools/package/control. What they depend on is found by dpkg-shlibdeps
# in the packages of the sysroot, or of this machine without one. The packages are the same bytes
# however often and wherever they are built: times are those of the last commit, and nothing of the
# build's folder stays in them.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
root=$here/../..
stage=$(readlink -f "$1") out=$2 arch=$3 suite=$4 revision=$5 sysroot=${6:+$(readlink -f "$6")}
export LC_ALL=C TZ=UTC
umask 022

fail() {
  echo "no packages: $*" >&2
  exit 1
}
for tool in dpkg-deb dpkg-shlibdeps dpkg-gencontrol dpkg-architecture; do
  command -v $tool >/dev/null || fail "$tool is not installed (tools/deps/install.sh test)"
done
case $suite in
bookworm) release=deb12 ;;
trixie) release=deb13 ;;
*) release=$suite ;;
esac
version=$(sed -n 's/^#define SUBVIEW_VERSION  *"\(.*\)"/\1/p' "$root/include/subview/version.h")-$revision~$release
SOURCE_DATE_EPOCH=${SOURCE_DATE_EPOCH:-$(git -C "$root" log -1 --format=%ct 2>/dev/null || stat -c %Y "$root/CHANGELOG.md")}
export SOURCE_DATE_EPOCH
# dpkg's tools take the tools of the architecture (objdump, strip) by these.
eval "$(dpkg-architecture -a"$arch" -s 2>/dev/null)"
strip=$DEB_HOST_GNU_TYPE-strip

mkdir -p "$out"
out=$(readlink -f "$out")
rm -f "$out"/*.deb "$out"/work.log
work=$out/work
rm -rf "$work"
mkdir -p "$work/debian"
cd "$work" # dpkg's tools look for debian/control from here
# The usual variables of Debian's tools say who builds.
maintainer="${DEBFULLNAME:-The subview authors} <${DEBEMAIL:-subview@example.org}>"
sed "s|^Maintainer:.*|Maintainer: $maintainer|" "$here/control" >debian/control
cat >debian/changelog <<END
subview ($version) $suite; urgency=medium

  * Version $version. Changes are in CHANGELOG.md.

 -- $maintainer  $(date -R -d "@$SOURCE_DATE_EPOCH")
END

# --- files ---------------------------------------------------------------------------------------
put() { # MODE FILE FOLDER-OF-THE-PACKAGE [NAME]
  install -D -m "$1" "$2" "$work/$package/$3/${4:-$(basename "$2")}"
}
program() { # NAME: with its manual and completion
  put 755 "$stage/usr/bin/$1" usr/bin
  "$strip" --strip-all --remove-section=.comment "$work/$package/usr/bin/$1"
  put 644 "$stage/usr/share/man/man1/$1.1" usr/share/man/man1
  gzip -9n "$work/$package/usr/share/man/man1/$1.1"
  [ ! -e "$stage/usr/share/bash-completion/completions/$1" ] ||
    put 644 "$stage/usr/share/bash-completion/completions/$1" usr/share/bash-completion/completions
}
license_of() { # FILE: as the text of a License field
  sed 's/^$/./; s/^/ /' "$1"
}
documents() {
  local doc=$work/$package/usr/share/doc/$package
  mkdir -p "$doc"
  {
    cat "$here/copyright"
    if [ "$package" = subview-lab ]; then # the weights of LPIPS are in this program alone
      printf '\nFiles: tools/weights/*\nCopyright: 2018 Richard Zhang, Phillip Isola, Alexei A. Efros, Eli Shechtman, Oliver Wang\n'
      printf ' 2016 Soumith Chintala\nLicense: BSD-2-clause and BSD-3-clause\n'
      license_of "$root/tools/weights/LICENSE.lpips"
      echo ' .'
      license_of "$root/tools/weights/LICENSE.torchvision"
    fi
  } >"$doc/copyright"
  gzip -9nc debian/changelog >"$doc/changelog.Debian.gz"
  gzip -9nc "$root/CHANGELOG.md" >"$doc/changelog.gz"
}

package=subview
program subview
program subview-preview
if [ -e "$stage/usr/lib/subview/subview-libcamera.so" ]; then
  put 644 "$stage/usr/lib/subview/subview-libcamera.so" usr/lib/subview
  "$strip" --strip-unneeded --remove-section=.comment \
    "$work/subview/usr/lib/subview/subview-libcamera.so"
fi
files=$here/files
put 644 "$files/subview.service" usr/lib/systemd/system
put 644 "$files/subview.conf" etc/subview
put 644 "$files/60-subview.rules" usr/lib/udev/rules.d
put 644 "$files/subview-avahi.service" etc/avahi/services subview.service
put 755 "$files/status" usr/lib/subview
put 644 "$files/subview-mdns.service" usr/lib/systemd/system
put 755 "$files/mdns" usr/lib/subview
for script in postinst prerm postrm; do put 755 "$files/subview.$script" DEBIAN $script; done
printf '%s\n' /etc/avahi/services/subview.service /etc/subview/subview.conf >"$work/subview/DEBIAN/conffiles"
package=subview-calibrate
program subview-calibrate
package=subview-lab
program subview-lab
[ ! -e "$stage/usr/bin/subview-depth" ] || program subview-depth
if [ -e "$stage/usr/lib/subview/subview-matches.so" ]; then
  put 644 "$stage/usr/lib/subview/subview-matches.so" usr/lib/subview
  "$strip" --strip-unneeded --remove-section=.comment "$work/subview-lab/usr/lib/subview/subview-matches.so"
fi
package=libsubview-dev
put 644 "$stage/usr/lib/libsubview.a" "usr/lib/$DEB_HOST_MULTIARCH"
put 644 "$stage/usr/lib/pkgconfig/subview.pc" "usr/lib/$DEB_HOST_MULTIARCH/pkgconfig"
sed -i "s|^libdir=.*|libdir=\${prefix}/lib/$DEB_HOST_MULTIARCH|" "$work/$package/usr/lib/$DEB_HOST_MULTIARCH/pkgconfig/subview.pc"
for file in "$stage"/usr/include/subview/*.h; do put 644 "$file" usr/include/subview; done
mkdir -p "$work/$package/usr/share/doc/$package"
cp -r "$stage/usr/share/doc/subview/examples" "$work/$package/usr/share/doc/$package/"

# --- dependencies and archives -------------------------------------------------------------------
shlibs() { # FIELD FILE...
  local field=$1 file
  shift
  dpkg-shlibdeps ${sysroot:+"-S$sysroot" "-l$sysroot/usr/lib/$DEB_HOST_MULTIARCH"} -T"debian/$package.substvars" \
    "-d$field" "$@" >>"$out/work.log" 2>&1 || fail "$package: $(grep -m 1 error "$out/work.log" || tail -n 1 "$out/work.log")"
}
for package in subview subview-calibrate subview-lab libsubview-dev; do
  documents
  mkdir -p "$work/$package/DEBIAN"
  echo 'misc:Depends=' >"debian/$package.substvars"
  case $package in
  subview)
    # libcamera is a recommendation: without it V4L2 works.
    modules=$(find subview/usr/lib -name '*.so')
    shlibs Depends subview/usr/bin/* ${modules:+-dRecommends $modules}
    ;;
  subview-lab) # only depth networks and matching need OpenCV
    extras=$(find subview-lab/usr/bin/subview-depth subview-lab/usr/lib -type f 2>/dev/null)
    shlibs Depends subview-lab/usr/bin/subview-lab ${extras:+-dRecommends $extras}
    ;;
  subview-*) shlibs Depends "$package"/usr/bin/* ;;
  esac
  (cd "$package" && find . -type f ! -path './DEBIAN/*' -printf '%P\0' | sort -z | xargs -0 md5sum) >"$package/DEBIAN/md5sums"
  chmod -R u+rwX,go+rX,go-w "$package"
  dpkg-gencontrol -p"$package" "-P$package" -T"debian/$package.substvars" -n"${package}_${version}_$arch.deb" >>"$out/work.log" 2>&1 ||
    fail "$package: $(tail -n 1 "$out/work.log")"
  dpkg-deb --root-owner-group --build "$package" "$out/${package}_${version}_$arch.deb" >/dev/null
  echo "$out/${package}_${version}_$arch.deb" | sed "s|^$PWD/||"
done
rm -rf "$work"
