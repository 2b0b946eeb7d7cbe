#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# No function of the core takes more than 4 KiB of stack, and none a size that is only known at run
# time. Reads what -fstack-usage wrote beside the objects. Arguments: the build folder.
folder=${1:?folder}
[ -n "${SAN:-}" ] && { echo "skipped: sanitizers make frames larger"; exit 77; }
find "$folder/obj/src" "$folder/obj/kernels" "$folder/obj/calib" -name '*.su' 2>/dev/null |
  while read -r su; do
  source=${su#"$folder/obj/"} # what was left behind by a source that is gone does not count
  source=${source%.su}
  # x_vec.c makes an object for each instruction set
  case $source in *_vec_*) source=${source%_*} ;; esac
  [ -e "${su%.su}.o" ] && [ -e "$source.c" ] && cat "$su"
done | LC_ALL=C awk -F '\t' -v limit=4096 '
  { n++ }
  $2 + 0 > limit { print $1 ": " $2 " bytes of stack, the limit is " limit; bad = 1 }
  $3 == "dynamic" { print $1 ": takes stack of a size not known before"; bad = 1 }
  END { if (n == 0) { print "no stack figures: was the core built?"; bad = 1 } exit bad }'
