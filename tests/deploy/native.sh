#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# The installed service on this machine's architecture: a minimal Debian root whose systemd runs in
# namespaces of its own, with the simulator for cameras. See service.sh for what is checked. Cuts of
# a disk's power and camera drivers are for the virtual board (deploy.sh). Ends with "N passed, N
# failed, N skipped".
#
#   native.sh BUILD SUITE FIRST SECOND        packages of subview, the second for the upgrade
#
# BUILD/service keeps the root's archive for a week, and the console's output.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
build=$1 suite=$2 first=$3 second=$4

skip() {
  echo "skip  service/$suite: $*"
  echo "0 passed, 0 failed, 1 skipped"
  exit 0
}
if [ "$(id -u)" -ne 0 ]; then
  sudo -n true 2>/dev/null || skip "needs root (sudo make service-test)"
  exec sudo -n "$0" "$@"
fi
for tool in mmdebstrap unshare; do
  command -v $tool >/dev/null || skip "$tool is not installed (tools/deps/install.sh test)"
done
unshare --mount --pid --fork --cgroup --net --uts --ipc true 2>/dev/null || skip "this machine gives no namespaces"
started=$SECONDS
mkdir -p "$build/service"
folder=$(cd "$build/service" && pwd)
root=$folder/root archive=$folder/$suite.tar console=$folder/$suite.console

t64=
[ "$suite" = bookworm ] || t64=t64
packages=systemd-sysv,dbus,udev,adduser,init-system-helpers,procps,busybox,libjpeg62-turbo,libpng16-16$t64
packages=$packages,libmicrohttpd12$t64,libseccomp2,zlib1g
if [ -z "$(find "$archive" -type f -mtime -7 2>/dev/null)" ]; then
  # shellcheck disable=SC2016 # the dollars are apt's
  mirror=$(apt-get indextargets --format '$(ORIGIN)|$(LABEL)|$(REPO_URI)' 'Created-By: Packages' 2>/dev/null |
    sed -n 's/^Debian|Debian|//p' | head -n 1)
  for pause in 5 20 0; do # mirrors that are being updated fail for a moment
    # shellcheck disable=SC2086 # no argument when there is no mirror
    mmdebstrap --quiet --variant=minbase --include="$packages" "$suite" "$folder/part.tar" $mirror >"$folder/log" 2>&1 && break
    [ $pause -gt 0 ] || skip "no root with $suite: $(tail -n 1 "$folder/log")"
    sleep $pause
  done
  mv "$folder/part.tar" "$archive"
fi
rm -rf --one-file-system "$root"
mkdir -p "$root"
tar -C "$root" -xf "$archive"
mkdir -p "$root/test/first" "$root/test/second" "$root/etc/systemd/system/multi-user.target.wants"
cp "$here/service.sh" "$root/test/"
cp "$first" "$root/test/first/"
cp "$second" "$root/test/second/"
cat >"$root/etc/systemd/system/deploy-test.service" <<'END'
[Service]
ExecStart=/bin/bash /test/service.sh
StandardOutput=append:/test/console
StandardError=inherit
END
ln -s ../deploy-test.service "$root/etc/systemd/system/multi-user.target.wants/"
touch "$root/test/console"
for _ in 1 2 3 4; do "$here/container.sh" "$root" 200 >>"$folder/log" 2>&1; done
cp "$root/test/console" "$console"
rm -rf --one-file-system "$root"
"$here/report.sh" "service/$suite" "$console" $((SECONDS - started))
