#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Measures the figures of docs/results.md that figures.txt lists and the data at hand allow,
# compares them within their tolerances, and writes the table anew with machine, build and date.
# Fails when a figure differs; one whose dataset is missing is skipped and says where it comes from.
# usage: reproduce.sh BIN_FOLDER OUT [PATTERN]
# PATTERN: only lines that grep -E finds it in. SV_DATA: a folder with the datasets of datasets.txt
# that are not in this repository. FIGURES: another list in the place of figures.txt.
set -u
root=$(cd "$(dirname "$(readlink -f "$0")")/../.." && pwd) || exit 2
bin=$(cd "${1:?the folder of the programs}" && pwd) || exit 2
out=${2:?the folder for results.md}
pattern=${3:-.}
figures=${FIGURES:-$root/tools/reproduce/figures.txt}
datasets=$root/tools/reproduce/datasets.txt
mkdir -p "$out" || exit 2
out=$(cd "$out" && pwd)
work=$(mktemp -d) || exit 2
trap 'rm -rf "$work"' EXIT
trap 'exit 130' INT TERM

field() { printf %s "$1" | awk -F ' [|] ' -v k="$2" '{ print $k }'; }

# The folder of a dataset, empty when it is not there.
folder_of() {
  line=$(grep "^$1 | " "$datasets") || { echo "reproduce: $1 is not in $datasets" >&2; exit 2; }
  for place in "$root/$(field "$line" 2)" "${SV_DATA:-/nonexistent}/$1" "${SV_DATA:-/nonexistent}/$(field "$line" 2)"; do
    [ -d "$place" ] && { echo "$place"; return; }
  done
  return 0
}

# What all files of a folder hold together.
checksum_of() { (cd "$1" && find . -type f | LC_ALL=C sort | xargs -d '\n' sha256sum | sha256sum | cut -c1-16); }

# The value that a command printed.
read_value() { # WHAT FILE
  case $1 in
    '~'*) sed -n "s/${1#\~}/\\1/p" "$2" | head -n 1 ;;
    *) grep -o "\"$1\": *-\{0,1\}[0-9.][0-9.e+-]*" "$2" | head -n 1 | sed 's/.*: *//' ;;
  esac
}

build=$(git -C "$root" describe --always --dirty 2>/dev/null || "$bin/subview-lab" --version | head -n 1)
processor=$(sed -n 's/^model name[^:]*: *//p' /proc/cpuinfo | head -n 1)
table=$work/results.md
{
  echo "# Results, measured again"
  echo
  echo "Written by \`make reproduce\` on $(date -u +%Y-%m-%d): build $build, ${processor:-unknown processor}, $(nproc) threads, $(uname -m)."
  echo "Recorded figures are those of docs/results.md; a figure agrees when it is within the tolerance."
} >"$table"

section='' n=0 n_same=0 n_differ=0 n_skipped=0
used=$work/used
: >"$used"
grep -v '^#' "$figures" | grep -E -- "$pattern" >"$work/lines"
while IFS= read -r line; do
  [ -n "$line" ] || continue
  what=$(field "$line" 2) needs=$(field "$line" 3) command=$(field "$line" 4) key=$(field "$line" 5)
  recorded=$(field "$line" 6) tolerance=$(field "$line" 7)
  if [ "$section" != "$(field "$line" 1)" ]; then
    section=$(field "$line" 1)
    printf '\n## %s\n\n| figure | recorded | measured | tolerance | |\n|---|--:|--:|--:|---|\n' "$section" >>"$table"
  fi
  n=$((n + 1))
  if [ "$needs" != - ]; then
    folder=$(folder_of "$needs") || exit 2
    if [ -z "$folder" ]; then
      n_skipped=$((n_skipped + 1))
      echo "| $what | $recorded | - | $tolerance | skipped: no dataset $needs |" >>"$table"
      echo "$needs" >>"$used"
      continue
    fi
    command=$(printf %s "$command" | sed "s#{$needs}#$folder#g")
    echo "$needs" >>"$used"
  fi
  command=$(printf %s "$command" | sed "s#@run#$bin/subview#g; s#@lab#$bin/subview-lab#g; s#@cal#$bin/subview-calibrate#g")
  rm -rf "$work/run"
  mkdir "$work/run"
  if (cd "$work/run" && sh -c "$command" </dev/null >"$work/said" 2>"$work/log"); then
    measured=$(read_value "$key" "$work/said")
  else
    measured=''
  fi
  if [ -z "$measured" ]; then
    verdict="**failed**: $(tail -n 1 "$work/log" | tr '|' ' ' | cut -c1-120)"
    measured=-
    n_differ=$((n_differ + 1))
  elif awk "BEGIN { d = $measured - $recorded; exit !(d <= $tolerance && -d <= $tolerance) }"; then
    verdict=agrees
    n_same=$((n_same + 1))
  else
    verdict='**differs**'
    n_differ=$((n_differ + 1))
  fi
  echo "| $what | $recorded | $measured | $tolerance | $verdict |" >>"$table"
  echo "reproduce: $section, $what: $measured (recorded $recorded): $verdict" >&2
done <"$work/lines"

printf '\n## Datasets\n\n| dataset | checksum | of the recorded figures | where it comes from |\n|---|---|---|---|\n' >>"$table"
LC_ALL=C sort -u "$used" | while IFS= read -r name; do
  line=$(grep "^$name | " "$datasets")
  folder=$(folder_of "$name")
  [ -n "$folder" ] && sum=$(checksum_of "$folder") || sum=-
  [ "$sum" = "$(field "$line" 3)" ] && same='the same' || same=$(field "$line" 3)
  echo "| $name | $sum | $same | $(field "$line" 4) |" >>"$table"
done
printf '\n%d figures: %d agree, %d differ or failed, %d skipped.\n' "$n" "$n_same" "$n_differ" "$n_skipped" >>"$table"
mv "$table" "$out/results.md"
echo "$out/results.md: $n figures: $n_same agree, $n_differ differ or failed, $n_skipped skipped"
[ "$n" -gt 0 ] || { echo "reproduce: no figure matches '$pattern'" >&2; exit 2; }
[ "$n_differ" -eq 0 ]
