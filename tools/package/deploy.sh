#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# Installs a package on boards over ssh, and goes back to the one before:
#
#   deploy.sh install PACKAGE SUITE HOST...
#   deploy.sh rollback HOST...
#
# A board keeps the two newest packages in /var/cache/subview. After the installation it checks its
# kernels, times training steps for some seconds, and prints what the service does. SSH replaces
# ssh; the user there must be root or may use sudo.
set -euo pipefail
what=$1
shift
ssh=${SSH:-ssh}
cache=/var/cache/subview
# Without questions; configuration that was changed on the board stays.
apt="DEBIAN_FRONTEND=noninteractive apt-get -y -o Dpkg::Options::=--force-confold --allow-downgrades"

fail() {
  echo "$host: $*" >&2
  exit 1
}
on_board() { # a script for the board's shell, as root
  # shellcheck disable=SC2086,SC2029 # a command and its arguments; expanded here
  $ssh "$host" "if [ \$(id -u) -eq 0 ]; then sh -c '$1'; else sudo sh -c '$1'; fi"
}
report() {
  echo "$host: kernels"
  on_board "subview selftest | tail -n 1" || fail "selftest found a difference"
  echo "$host: training steps"
  on_board "timeout 60 subview bench | tail -n 6" || fail "bench failed"
  echo "$host: the service"
  on_board "for i in 1 2 3 4 5 6 7 8; do systemctl is-active --quiet subview && break; sleep 1; done; subview status || true"
}

if [ "$what" = install ]; then
  package=$1 suite=$2
  shift 2
  [ -e "$package" ] || { echo "no package $package: make package first" >&2; exit 1; }
  name=$(basename "$package") arch=$(dpkg-deb -f "$package" Architecture)
fi
[ $# -gt 0 ] || { echo "no board: HOST=NAME, or several: HOST=\"NAME NAME\"" >&2; exit 2; }
for host in "$@"; do
  if [ "$what" = rollback ]; then
    on_board "test -e $cache/previous/*.deb" || fail "keeps no package before the present one"
    on_board "$apt install $cache/previous/*.deb && rm -rf $cache/next && mv $cache/current $cache/next && \
      mv $cache/previous $cache/current && mv $cache/next $cache/previous" || fail "the package before does not install"
    echo "$host: back to $(on_board "dpkg-query -W -f \"\\\${Version}\" subview")"
    report
    continue
  fi
  there=$(on_board '. /etc/os-release; echo $VERSION_CODENAME $(dpkg --print-architecture)') || fail "ssh does not get there"
  [ "$there" = "$suite $arch" ] || fail "runs $there, and the package is for $suite $arch (SUITE=${there% *})"
  on_board "mkdir -p $cache/next && rm -f $cache/next/* && cat >$cache/next/$name" <"$package"
  # The board's lists of packages may be old, or missing.
  on_board "$apt install --reinstall $cache/next/$name || { apt-get update && $apt install --reinstall $cache/next/$name; }" || fail "the package does not install"
  on_board "if ls $cache/current/*.deb >/dev/null 2>&1; then rm -rf $cache/previous && mv $cache/current $cache/previous; fi && \
    rm -rf $cache/current && mv $cache/next $cache/current"
  echo "$host: $name is installed"
  report
done
