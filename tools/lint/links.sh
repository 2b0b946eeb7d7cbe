#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# No program holds code from tests/, nor needs a library that only tests need. Looked up in the
# debugging information, which names each file that was compiled in. `subview` needs the libraries
# below alone, so that it starts on any release of the distribution; libcamera belongs to a module.
# Arguments: the folder with bin/.
few='libc|libm|libjpeg|libpng16|ld-linux-[a-z0-9-]*' # and the loader, which stack protection names
bin=${1:?folder}/bin
bad=0 n=0
for program in "$bin"/*; do
  [ -f "$program" ] || continue
  n=$((n + 1))
  files=$(readelf -p .debug_line_str -p .debug_str "$program" 2>/dev/null | grep -oE '\] +tests/[^ ]*\.(c|cc)$' |
    sed 's/^[] ]*//' | sort -u)
  for file in $files; do
    echo "$program: $file is linked in; what programs need belongs into tools/ or platform/"
    bad=1
  done
  if readelf -d "$program" | grep -q 'NEEDED.*cmocka'; then
    echo "$program: is linked to cmocka, which only tests may need"
    bad=1
  fi
done
if [ -f "$bin/subview" ]; then
  more=$(readelf -d "$bin/subview" | sed -n 's/.*NEEDED.*\[\(.*\)\]/\1/p' | grep -vE "^($few)\.so\.[0-9]+$")
  [ -z "$more" ] || { echo "$bin/subview: needs $(echo $more), expected libc, libm, libjpeg and libpng alone"; bad=1; }
fi
[ $n -gt 0 ] || { echo "no programs in $bin: were they built?"; exit 1; }
exit $bad
