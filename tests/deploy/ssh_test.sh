#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# make deploy and deploy-rollback to two boards that are roots of this machine's own release, with a
# stand-in for ssh. Needs root. Ends with "N passed, N failed, N skipped".
#
#   ssh_test.sh WORK FIRST SECOND        packages of subview
set -uo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
work=$1 first=$2 second=$3
suite=$(. /etc/os-release && echo "$VERSION_CODENAME")
[ "$(id -u)" -eq 0 ] || { echo "skip  deploy/ssh: needs root"; echo "0 passed, 0 failed, 1 skipped"; exit 0; }
mkdir -p "$work"
work=$(cd "$work" && pwd)
passed=0 failed=0
verdict() { # exit code, name
  if [ "$1" -eq 0 ]; then
    passed=$((passed + 1))
    echo "ok    deploy/ssh: $2"
  else
    failed=$((failed + 1))
    echo "FAIL  deploy/ssh: $2"
    tail -n 15 "$work/log" | sed 's/^/      | /'
  fi
}

# shellcheck disable=SC2016 # the dollars are apt's
mirror=$(apt-get indextargets --format '$(ORIGIN)|$(LABEL)|$(REPO_URI)' 'Created-By: Packages' 2>/dev/null |
  sed -n 's/^Debian|Debian|//p' | head -n 1)
for board in one two; do
  rm -rf "${work:?}/$board"
done
# shellcheck disable=SC2086 # no argument when there is no mirror
mmdebstrap --quiet --variant=minbase "$suite" "$work/one" $mirror >"$work/log" 2>&1
cp -a "$work/one" "$work/two"
cp -L /etc/resolv.conf "$work/one/etc/" && cp -L /etc/resolv.conf "$work/two/etc/"
cat >"$work/ssh" <<END
#!/bin/sh
board=\$1
shift
exec chroot "$work/\$board" env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin DEBIAN_FRONTEND=noninteractive sh -c "\$*"
END
chmod +x "$work/ssh"
export SSH="$work/ssh"
version() { chroot "$work/$1" dpkg-query -W -f '${Version}' subview; }
of() { dpkg-deb -f "$1" Version; }

status=0
"$here/../../tools/package/deploy.sh" install "$first" sid one >"$work/log" 2>&1 || status=$?
[ $status -eq 1 ] && grep -q "one: runs $suite .*, and the package is for sid" "$work/log"
verdict $? "a package of another release is refused"
"$here/../../tools/package/deploy.sh" install "$first" "$suite" one two >"$work/log" 2>&1 &&
  [ "$(version one)" = "$(of "$first")" ] && [ "$(version two)" = "$(of "$first")" ]
verdict $? "installed on two boards"
grep -q '^one: kernels' "$work/log" && grep -q 'same bits as the reference\|ok' "$work/log"
verdict $? "checked there"
status=0
"$here/../../tools/package/deploy.sh" rollback one >"$work/log" 2>&1 || status=$?
[ $status -eq 1 ] && grep -q 'one: keeps no package before' "$work/log"
verdict $? "no package before the first one"
"$here/../../tools/package/deploy.sh" install "$second" "$suite" one >"$work/log" 2>&1 && [ "$(version one)" = "$(of "$second")" ]
verdict $? "the next package"
"$here/../../tools/package/deploy.sh" rollback one >"$work/log" 2>&1 && [ "$(version one)" = "$(of "$first")" ]
verdict $? "rolled back"
rm -rf --one-file-system "$work/one" "$work/two"
echo "$passed passed, $failed failed, 0 skipped"
[ $failed -eq 0 ]
