#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# A line that holds a comment is at most 100 columns wide, so that prose reads well beside code.
# Code alone may be wider: its limit is clang-format's.
cd "${1:-.}" || exit 2
lint=$(dirname "$(readlink -f "$0")")
hits=$("$lint/sources.sh" text | grep -E '\.(c|h|inc|cc|cpp|hpp|sh|awk|py|mk|js|css)$|(^|/)Makefile$' |
  LC_ALL=C.UTF-8 xargs grep -nHE '^.{101,}' /dev/null | LC_ALL=C.UTF-8 awk '
  {
    file = $0
    sub(/:.*/, "", file)
    text = substr($0, length(file) + 2)
    sub(/^[0-9]*:/, "", text)
    # Strings hold marks of comments, too, and addresses hold two slashes.
    gsub(/\\./, "", text)
    gsub(/"[^"]*"/, "", text)
    gsub(/\047[^\047]*\047/, "", text)
    mark = file ~ /\.(c|h|inc|cc|cpp|hpp|js|css)$/ ? "(^|[^:])//|/[*]|^ *[*] " : "(^|[ \t])#( |$)"
    if (text ~ mark) print substr($0, 1, 110) "..."
  }')
[ -z "$hits" ] && exit 0
printf '%s\n' "$hits" | sed 's/$/    <- a comment beyond column 100/'
exit 1
