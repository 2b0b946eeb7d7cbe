#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Runs a list of checks, counts their cases and ends with the line `N passed, N failed, N skipped`.
#
#   run.sh [-j JOBS] [-t SECONDS] [-o FOLDER] LIST
#
# LIST holds one check a line: label <TAB> command [<TAB> seconds]. A label that starts with "!"
# runs after the others, with nothing beside it. Cases are counted from cmocka's output, or from a
# line of the form above that the command prints itself (the last one holds). A command that says
# neither is one case: exit 0 passed, 77 skipped (its last line is the reason), anything else
# failed. A command that ends badly, or not in time, adds a failure even when all its cases look
# well. Skipped cases are summed up at the end, a line a reason. Logs stay in FOLDER. Exit 1 when
# something failed or nothing passed.
set -u

# Why cases of a check were skipped, a line each: cases, label, reason, separated by tabs. A name in
# brackets at a reason's end is the case's own; "skip  3 x REASON (LABELS)" is the summary of a run
# inside of this one.
skips() {
  reasons=$(if [ "$1" -eq 77 ]; then tail -n 1 "$3"; else grep -iE '^ *skip(ped)?[: ]' "$3"; fi)
  printf '%s\n' "${reasons:-no reason was given}" | sed -E 's/^ *skip(ped)?:? *//' | awk -v label="$2" '{
    n = 1
    if (match($0, /^[0-9]+ x /)) { n = $1; sub(/^[0-9]+ x /, "") }
    sub(/ \([^()]*\)$/, "")
    print n "\t" label "\t" $0
  }'
}

# One check: prints its line, leaves label.count ("passed failed skipped") and label.log.
one() {
  out=$1 seconds=$2 line=$3
  tab=$(printf '\t')
  label=${line%%"$tab"*} rest=${line#*"$tab"}
  label=${label#!}
  command=${rest%%"$tab"*}
  case $rest in *"$tab"*) seconds=${rest#*"$tab"} ;; esac
  file=$out/$(printf '%s' "$label" | tr '/ ' '__')
  TMPDIR=$file.tmp
  export TMPDIR
  rm -rf "$TMPDIR" && mkdir -p "$TMPDIR"
  begin=$(date +%s)
  # timeout leads a group of its own, which a Ctrl-C at the terminal does not reach.
  timeout -k 10 "$seconds" sh -c "$command" >"$file.log" 2>&1 </dev/null &
  pid=$!
  trap 'kill $pid 2>/dev/null; wait $pid; rm -rf "$TMPDIR"; exit 130' INT TERM HUP
  wait $pid
  code=$?
  trap - INT TERM HUP
  took="$(($(date +%s) - begin)) s"
  # Processor time hardly depends on what runs beside the check. The last line of `times` is that of
  # the children: user, system.
  times >"$file.times"
  took="$took, processor $(tail -n 1 "$file.times" | LC_ALL=C awk -F '[ms ]+' '{ printf "%.0f", 60 * ($1 + $3) + $2 + $4 }') s"
  rm -rf "$TMPDIR"
  # shellcheck disable=SC2046 # three words are wanted
  set -- $(LC_ALL=C awk -v code=$code '
    function close_case() { if (open) { if (code == 0) p++; else f++; open = 0 } }
    /\[ RUN      \]/ { close_case(); open = 1; next }
    open && /\[       OK \]/ { p++; open = 0; next }
    open && /\[  SKIPPED \]/ { s++; open = 0; next }
    open && /\[  (FAILED|ERROR )  ?\]/ { f++; open = 0; next }
    /^[0-9]+ passed, [0-9]+ failed, [0-9]+ skipped\r?$/ { said = 1; sp = $1; sf = $3; ss = $5 }
    END {
      close_case()
      if (said) { p = sp; f = sf; s = ss }
      if (code == 77 && p + f + s == 0) s = 1
      else if (code != 0 && f == 0) f = 1
      else if (code == 0 && !said && p + f + s == 0) p = 1
      print p + 0, f + 0, s + 0
    }' "$file.log")
  echo "$1 $2 $3" >"$file.count"
  [ "$3" -eq 0 ] || skips "$code" "$label" "$file.log" >"$file.skips"
  if [ "$2" -gt 0 ]; then
    why="exit $code"
    if [ $code -eq 124 ] || [ $code -eq 137 ]; then why="not done after $seconds s"; fi
    if [ $code -gt 128 ] && [ $code -ne 137 ]; then why="signal $((code - 128))"; fi
    echo "$label ($why; log: ${file#"$PWD/"}.log)" >"$file.failed"
    printf 'FAIL  %-36s %s failed, %s passed, %s skipped (%s)\n%s\n' "$label" "$2" "$1" "$3" "$why" \
      "$(grep -vE '\[( RUN  |      OK|  OK)' "$file.log" | tail -n 40 | sed 's/^/      | /')"
  else
    rm -f "$file.failed"
    printf 'ok    %-36s %4s passed%s  %s\n' "$label" "$1" "$([ "$3" -gt 0 ] && echo ", $3 skipped")" "$took"
  fi
}

if [ "${1:-}" = --one ]; then
  one "$2" "$3" "$4"
  exit 0
fi

jobs=1 seconds=300 out=
while getopts j:t:o: option; do
  case $option in
  j) jobs=$OPTARG ;;
  t) seconds=$OPTARG ;;
  o) out=$OPTARG ;;
  *) exit 2 ;;
  esac
done
shift $((OPTIND - 1))
if [ $# -ne 1 ]; then
  echo "usage: run.sh [-j jobs] [-t seconds] [-o folder] list" >&2
  exit 2
fi
own=
if [ -z "$out" ]; then
  own=$(mktemp -d)
  out=$own
fi
rm -rf "$out" && mkdir -p "$out" || exit 2
out=$(readlink -f "$out") # checks may change folders, and get one of their own below it
list=$(sed 's/^[[:space:]]*//' "$1" | grep -v '^$')
printf '%s\n' "$list" | grep '^[^!]' | xargs -r -d '\n' -n 1 -P "$jobs" "$0" --one "$out" "$seconds"
printf '%s\n' "$list" | grep '^!' | xargs -r -d '\n' -n 1 "$0" --one "$out" "$seconds"

cat "$out"/*.skips 2>/dev/null | sort -t "$(printf '\t')" -k 3,3 -k 2,2 | awk -F '\t' '
  function close_reason() { if (n) printf "skip  %d x %s (%s%s)\n", n, reason, labels, (n_labels > 3 ? ", ..." : "") }
  $3 != reason { close_reason(); reason = $3; n = n_labels = 0; labels = last = "" }
  { n += $1 }
  $2 != last { last = $2; if (++n_labels <= 3) labels = labels (labels == "" ? "" : ", ") $2 }
  END { close_reason() }'
cat "$out"/*.failed 2>/dev/null | sed 's/^/failed: /'
set -- "$out"/*.count
if [ ! -e "$1" ]; then
  echo "nothing was run: no such test has been built"
  set -- /dev/null
fi
awk '{ p += $1; f += $2; s += $3 } END {
  printf "%d passed, %d failed, %d skipped\n", p, f, s; exit (f > 0 || p == 0) }' "$@"
code=$?
[ -n "$own" ] && rm -rf "$own"
exit $code
