#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Every source begins with the licence line (after #! if there is one) and is shorter than 600
# lines: what is longer is two things.
cd "${1:-.}" || exit 2
lint=$(dirname "$(readlink -f "$0")")
"$lint/sources.sh" text | grep -E '\.(c|h|inc|cc|cpp|hpp|sh|awk|py|mk|html|js|css)$|(^|/)Makefile$|^\.ci/' | {
  bad=0
  while read -r file; do
    [ -s "$file" ] || { echo "$file: empty file"; bad=1; continue; }
    awk -v limit=600 -v file="$file" '
      FNR <= 3 && /SPDX-License-Identifier: Apache-2\.0/ { has_licence = 1 }
      END {
        if (!has_licence) { print file ": no line SPDX-License-Identifier: Apache-2.0 at the top"; bad = 1 }
        if (FNR >= limit) { print file ": " FNR " lines, the limit is " limit - 1; bad = 1 }
        exit bad
      }' "$file" || bad=1
  done
  exit $bad
}
