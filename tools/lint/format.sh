#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# clang-format settles the layout (.clang-format). Prints the files it would change; `--fix` changes
# them. Lists of X(...) lines stay as they are. Only one version counts, as others differ in places.
cd "${ROOT:-.}" || exit 2
lint=$(dirname "$(readlink -f "$0")")
version=14
tool=$(command -v clang-format-$version || command -v clang-format) || {
  echo "skipped: clang-format is not installed"
  exit 77
}
case $($tool --version) in
*"version $version."*) ;;
*)
  echo "skipped: clang-format $version is wanted, here is $($tool --version | grep -oE 'version [0-9.]+')"
  exit 77
  ;;
esac
files=$("$lint/sources.sh" c | grep -E '\.(c|h|cc|cpp|hpp)$|_vec\.inc$')
[ -n "$files" ] || { echo "no sources"; exit 1; }
if [ "${1:-}" = --fix ]; then
  printf '%s\n' "$files" | xargs -n 20 -P "$(nproc)" "$tool" --style=file -i
  exit
fi
changes=$(printf '%s\n' "$files" | xargs -n 20 -P "$(nproc)" "$tool" --style=file --dry-run \
  --ferror-limit=1 2>&1 | grep -E '^[^ ]+:[0-9]+:[0-9]+: ' | cut -d : -f 1 | sort -u)
[ -z "$changes" ] && exit 0
printf '%s\n' "$changes" | sed 's/$/: clang-format would change it (make format)/'
exit 1
