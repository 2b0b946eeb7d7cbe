#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Installs what is missing from the distribution's packages (Debian and its kin), and nothing else:
#
#   install.sh build    compiler and libraries of the programs
#   install.sh test     the same, and what the tests use
#   install.sh tidy     the same, and the static analysers
#   install.sh board    for the build, and what the virtual ARM board needs
#   install.sh deploy   for the virtual ARM board that boots from a disk
#   install.sh slurm    for the batch system that runs jobs of subview-lab tables
#   install.sh bare     for the tests on minimal systems: what makes those systems
#
# packages.txt lists the packages. WITH=minimal leaves out those that only some features need. It
# looks for files, not for packages, so it is done in an instant when everything is there, whoever
# installed it. sudo is asked only when something is missing. A package that only a feature needs
# may fail to install: the build leaves that feature out. `--list` prints the missing packages and
# changes nothing.
set -u
what=${1:-build} list=${2:-} with=${WITH:-all}
table=$(dirname "$(readlink -f "$0")")/packages.txt

case $what in
build) stages='build' ;;
test) stages='build test' ;;
tidy) stages='build test tidy' ;;
board) stages='build board' ;;
deploy) stages='build test board deploy' ;;
slurm) stages='build slurm' ;;
bare) stages='bare' ;;
*)
  echo "install.sh: the first word is build, test, tidy, board, deploy, slurm or bare, not $what" >&2
  exit 2
  ;;
esac
case $with in
all | minimal) ;;
*)
  echo "install.sh: WITH is all or minimal, not $with" >&2
  exit 2
  ;;
esac

is_there() { # a command, a header, or a whole path
  case $1 in
  /*) [ -e "$1" ] ;;
  *.h | *.hh | *.hpp | */*)
    [ -e "/usr/include/$1" ] || [ -e "/usr/include/$(uname -m)-linux-gnu/$1" ] || [ -e "/usr/local/include/$1" ]
    ;;
  *) PATH=$PATH:/usr/sbin:/sbin command -v "$1" >/dev/null 2>&1 ;;
  esac
}

# Lines "package|feature" of what is missing. No file in the table has a space in its name.
missing() {
  awk -F ' *[|] *' -v stages=" $stages " -v with="$with" -v arch="$(uname -m)" '
    /^#/ || !index(stages, " " $1 " ") || (with == "minimal" && $4 != "-") { next }
    sub(/^x86:/, "", $2) && arch != "x86_64" { next }
    { print $2, $3 "|" $4 }' "$table" |
    while read -r file package; do is_there "$file" || echo "$package"; done
}
found=$(missing | sort -u)
packages_of() { # of a feature, or all
  printf '%s\n' "$found" | awk -F '|' -v f="$1" 'f == "" || $2 == f { print $1 }' | sort -u | tr '\n' ' '
}
feature_of() { printf '%s\n' "$found" | sed -n "s/^$1|//p" | head -n 1; }
if [ "$list" = --list ]; then
  [ -z "$found" ] || packages_of '' | tr ' ' '\n' | grep .
  exit 0
fi

# Leaves out what a feature needs and the distribution does not have, where apt has lists to know it
# from.
drop_unknown() {
  apt-cache show libc6-dev >/dev/null 2>&1 || return 0
  for package in $(packages_of ''); do
    [ "$(feature_of "$package")" = - ] || apt-cache show "$package" >/dev/null 2>&1 && continue
    echo "install.sh: this distribution has no $package; left out: $(feature_of "$package")"
    found=$(printf '%s\n' "$found" | grep -v "^$package|")
  done
}
command -v apt-cache >/dev/null 2>&1 && drop_unknown
[ -n "$found" ] || exit 0

echo "These packages are missing and will be installed:"
printf '%s\n' "$found" | cut -d '|' -f 2 | sort -u | while read -r feature; do
  [ "$feature" = - ] && name=needed || name=$feature
  printf '  %-30s %s\n' "$name:" "$(packages_of "$feature")"
done
needed=$(packages_of -)
[ "$(packages_of '')" != "$needed" ] && [ "$what" = build ] &&
  echo "WITH=minimal leaves out the features that need packages of their own."

if ! command -v apt-get >/dev/null 2>&1; then
  echo "install.sh: not a Debian kind of system; please install the packages above (Debian's names) by hand"
  [ -z "$needed" ]
  exit
fi
as_root=''
if [ "$(id -u)" -ne 0 ]; then
  as_root=sudo
  if ! command -v sudo >/dev/null 2>&1 || { ! [ -t 0 ] && ! sudo -n true 2>/dev/null; }; then
    echo "install.sh: not root, and sudo cannot be asked; please run: apt-get install $(packages_of '')"
    [ -z "$needed" ]
    exit
  fi
fi

update() { # mirrors that are being synchronized fail for a moment: try again
  for pause in 5 15 30 0; do
    $as_root apt-get -q -o DPkg::Lock::Timeout=300 update >/dev/null && return 0
    sleep $pause
  done
  return 1
}
apt_get() {
  $as_root env DEBIAN_FRONTEND=noninteractive apt-get -q -y -o DPkg::Lock::Timeout=300 -o Acquire::Retries=3 \
    -o Dpkg::Use-Pty=0 --no-install-recommends "$@"
}
# What apt says of a failure, beside its progress.
log=$(mktemp)
trap 'rm -f "$log"' EXIT
trap 'exit 130' INT TERM HUP
try_install() { # twice, as a mirror that changes meanwhile has other files than its list says
  apt_get install "$@" >"$log" 2>&1 && return 0
  update || true
  apt_get install "$@" >"$log" 2>&1
}

update || echo "install.sh: apt-get update failed; trying with the lists that apt has"
drop_unknown
all=$(packages_of '')
# shellcheck disable=SC2086 # lists of words
LC_ALL=C apt-get -s install --no-install-recommends $all 2>/dev/null | sed -n \
  's/^\([0-9]*\) upgraded, \([0-9]*\) newly installed.*/\2 packages with what they depend on/p'
# shellcheck disable=SC2086
LC_ALL=C apt-get --assume-no install --no-install-recommends $all 2>/dev/null |
  sed -n 's/^Need to get \(.*\) of archives\.$/download: \1/p; s/^After this operation, \(.*\) of additional disk.*/on disk: \1/p'
started=$(date +%s)
# shellcheck disable=SC2086
apt_get --download-only install $all >"$log" 2>&1 && echo "downloaded in $(($(date +%s) - started)) s"
started=$(date +%s)
# shellcheck disable=SC2086
if try_install $all; then
  echo "installed in $(($(date +%s) - started)) s"
  exit 0
fi
echo "install.sh: not all at once ($(grep -m 1 '^E:' "$log")); trying one by one"
for package in $all; do
  try_install "$package" && continue
  case " $needed " in
  *" $package "*)
    echo "install.sh: could not install $package, which the build needs: $(grep -m 1 '^E:' "$log")"
    exit 1
    ;;
  esac
  echo "install.sh: could not install $package; left out: $(feature_of "$package")"
done
exit 0
