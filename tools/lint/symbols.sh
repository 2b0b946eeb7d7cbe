#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# What the core library asks of the world, looked up in the compiled code, where no macro can hide
# it:
#   - undefined symbols only from tests/run/allowed_symbols.txt: no heap, no files, no libm whose
#     bits differ
#   - no variables that can be written: all state lives in structs the caller owns
#   - no weak or common symbols: an inline function compiled with AVX2 flags must not replace the
#     plain one
# Arguments: the folder with libcore.a.
lib=${1:?folder}/libcore.a
allowed=$(dirname "$(readlink -f "$0")")/../../tests/run/allowed_symbols.txt
OBJDUMP=${OBJDUMP:-objdump}
NM=${OBJDUMP%objdump}nm
[ -n "${SAN:-}" ] && { echo "skipped: sanitizers add symbols of their own"; exit 77; }
[ -r "$lib" ] || { echo "$lib is not there"; exit 1; }
bad=0

hits=$($NM -A -P "$lib" 2>/dev/null | LC_ALL=C awk -v list="$allowed" '
  BEGIN {
    while ((getline line < list) > 0) {
      sub(/#.*/, "", line)
      n = split(line, w, " ")
      for (i = 1; i <= n; i++) ok[w[i]] = 1
    }
  }
  { name = $2; type = $3 }
  type == "U" || type == "w" || type == "v" { wants[name] = wants[name] " " $1; next }
  type ~ /[WVCu]/ { print $1 " " name ": weak or common symbol"; next }
  type ~ /[A-Z]/ { has[name] = 1 }
  END {
    for (s in wants)
      if (!(s in has) && !(s in ok)) print wants[s] " wants " s ", which the core may not use"
  }' | sort)
[ -n "$hits" ] && { printf '%s\n' "$hits"; bad=1; }

hits=$($OBJDUMP -t "$lib" | LC_ALL=C awk '
  /:[ \t]+file format/ { member = $1; next }
  {
    section = ""
    for (i = 2; i <= NF; i++)
      if ($i ~ /^\.(data|bss|tdata|tbss)/) { section = $i; name = $NF; size = $(i + 1) }
  }
  section != "" && section !~ /^\.data\.rel\.ro/ && name != section && size !~ /^0+$/ {
    print member " " name " (" section "): a variable that can be written" }')
[ -n "$hits" ] && { printf '%s\n' "$hits"; bad=1; }
exit $bad
