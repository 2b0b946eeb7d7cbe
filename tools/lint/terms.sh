#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Words of the old dialect (terms.txt) stand nowhere; the message names the standard term.
# The changelog may name what a change replaces.
cd "${1:-.}" || exit 2
lint=$(dirname "$(readlink -f "$0")")
list=$lint/terms.txt
files=$("$lint/sources.sh" text | grep -vE '^(tools/lint/terms\.txt|CHANGELOG\.md)$')
hits=$(grep -v '^#' "$list" | while IFS='	' read -r old new; do
  case $old in
  =*) case=-H old=${old#=} ;;
  *) case=-i ;;
  esac
  printf '%s\n' "$files" | LC_ALL=C xargs grep -nHE $case -- "$old" /dev/null | cut -c 1-160 | sed "s|\$|    <- say: $new|"
done)
[ -z "$hits" ] && exit 0
printf '%s\n' "$hits"
exit 1
