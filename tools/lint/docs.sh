#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# What the documents say about the tree is true, and the README stays short:
#   - README.md has at most 150 lines
#   - relative links lead to files, and their #anchors to headings
#   - `src/room/file.c` in backticks exists; of `src/room/file.c: name` the file also contains that
#     name
#   - targets of `make TARGET` are in the Makefile, and tests named like unit/test_base exist
#   - every sv_ name outside code blocks, and in those of ARCHITECTURE.md, stands somewhere in the
#     sources
# A path with a word in capitals (boards/NAME) is a placeholder.
# shellcheck disable=SC2016 # backticks are those of Markdown
cd "${1:-.}" || exit 2
lint=$(dirname "$(readlink -f "$0")")
limit=150
bad=0

if [ -e README.md ]; then
  n=$(wc -l <README.md)
  [ "$n" -le $limit ] || { echo "README.md: $n lines, the limit is $limit"; bad=1; }
fi

documents=$("$lint/sources.sh" text | grep '\.md$')
[ -n "$documents" ] || exit $bad

# GitHub's anchor of each heading, a line each.
anchors() {
  sed -nE '/^```/,/^```/d; s/^#+ +//p' "$1" | tr '[:upper:]' '[:lower:]' | sed -E 's/[^a-z0-9 _-]//g; s/ /-/g'
}

# file TAB line TAB kind TAB text, kind being link, name, target or word
# shellcheck disable=SC2086 # names of ours have no spaces
LC_ALL=C awk -v sources="$lint/sources.sh c" '
  BEGIN {
    names = sources " | xargs grep -ohE \"sv_[a-z0-9_]+\" /dev/null"
    while ((names | getline line) > 0) is_known[line] = 1
    while ((getline line < "Makefile") > 0)
      if (match(line, /^[a-z-]+:/)) is_target[substr(line, 1, RLENGTH - 1)] = 1
    rooms = "^([.]ci|boards|calib|docs|examples|include|kernels|mk|platform|src|tests|tools)/[A-Za-z0-9_./-]+(: [A-Za-z0-9_, ]+)?$"
  }
  function say(kind, text) { print FILENAME "\t" FNR "\t" kind "\t" text }
  function look_at_command(text) {
    sub(/ *#.*/, "", text)
    if (text !~ /^make /) return
    n_words = split(text, w, " ")
    for (k = 2; k <= n_words; k++)
      if (w[k] ~ /^[a-z][a-z-]*$/ && !(w[k] in is_target)) say("target", w[k])
  }
  FNR == 1 { fenced = 0 }
  /^ *```/ { fenced = !fenced }
  !fenced || FILENAME == "ARCHITECTURE.md" {
    rest = $0
    while (match(rest, /sv_[a-z0-9_]+/)) {
      name = substr(rest, RSTART, RLENGTH)
      if (name !~ /_$/ && !(name in is_known)) say("word", name)
      rest = substr(rest, RSTART + RLENGTH)
    }
  }
  {
    rest = $0
    while (match(rest, /(unit|grad|golden|fault|scenario|budget)\/test_[a-z0-9_]+/)) {
      say("name", "tests/" substr(rest, RSTART, RLENGTH) ".c")
      rest = substr(rest, RSTART + RLENGTH)
    }
  }
  fenced { look_at_command($0); next }
  {
    rest = $0
    while (match(rest, /\]\([^) ]+\)/)) {
      text = substr(rest, RSTART + 2, RLENGTH - 3)
      if (text !~ /^[a-z]+:/) say("link", text)
      rest = substr(rest, RSTART + RLENGTH)
    }
    n = split($0, part, "`")
    for (i = 2; i <= n; i += 2) {
      look_at_command(part[i])
      if (part[i] ~ rooms && (part[i] !~ /[\/_][A-Z]+([\/_.:]|$)/ || part[i] ~ /[.]md$/))
        say("name", part[i])
    }
  }' $documents | {
  tab=$(printf '\t')
  is_bad=0
  while IFS="$tab" read -r file line kind text; do
    if [ "$kind" = word ]; then
      echo "$file:$line: $text is not in the sources"
      is_bad=1
      continue
    fi
    if [ "$kind" = target ]; then
      echo "$file:$line: make $text: there is no such target"
      is_bad=1
      continue
    fi
    if [ "$kind" = link ]; then
      to=${text%%#*} anchor=
      case $text in *'#'*) anchor=${text#*#} ;; esac
      target=$file
      [ -z "$to" ] || target=$(dirname "$file")/$to
      if [ ! -e "$target" ]; then
        echo "$file:$line: the link $text leads nowhere"
        is_bad=1
      elif [ -n "$anchor" ] && ! anchors "$target" | grep -qxF -- "$anchor"; then
        echo "$file:$line: $text: there is no such heading"
        is_bad=1
      fi
      continue
    fi
    path=${text%%:*} names=
    case $text in *': '*) names=${text#*: } ;; esac
    if [ ! -e "$path" ]; then
      echo "$file:$line: $path does not exist"
      is_bad=1
      continue
    fi
    IFS=', '
    for name in $names; do
      grep -qwF -- "$name" "$path" || { echo "$file:$line: $path has no $name"; is_bad=1; }
    done
  done
  exit $is_bad
}
code=$?
[ $bad -eq 0 ] || exit 1
exit $code
