#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Man pages of the programs from what their own --help says, so that no page knows less or more than
# the program:
#
#   man.sh BIN OUT          BIN/PROGRAM -> OUT/PROGRAM.1; EMULATE goes before the programs when they
#                           are foreign
set -eu
bin=$1 out=$2
here=$(dirname "$(readlink -f "$0")")
mkdir -p "$out"

# Blank lines and paragraphs that follow each other are one.
squeeze() {
  awk '!NF { next }
    $0 == ".PP" { is_due = 1; next }
    {
      if (is_due && $0 !~ /^\.(SH|SS|TP)/ && !is_head) print ".PP"
      is_due = 0
      is_head = /^\.(SH|SS)/
      print
    }'
}

for program in subview subview-preview subview-lab subview-calibrate subview-depth; do
  [ -x "$bin/$program" ] || continue
  # shellcheck disable=SC2086 # a command and its arguments
  text=$(${EMULATE:-} "$bin/$program" --help)
  {
    printf '%s\n' "$text" | awk -v part=page -v program="$program" -f "$here/man.awk"
    commands=$(printf '%s\n' "$text" | awk '/^usage: / && !/ COMMAND/ { exit } /^[Ee]xample|^options/ { exit } /^  [a-z]/ { print $1 }')
    [ -z "$commands" ] || printf '.SH COMMANDS\n'
    for command in $commands; do
      # shellcheck disable=SC2086
      ${EMULATE:-} "$bin/$program" "$command" --help | awk -v part=command -v command="$command" -f "$here/man.awk"
    done
    printf '.SH SEE ALSO\n.BR subview (1),\n.BR subview\\-preview (1),\n.BR subview\\-calibrate (1),\n.BR subview\\-lab (1),\n.BR subview\\-depth (1)\n'
  } | squeeze >"$out/$program.1.part"
  mv "$out/$program.1.part" "$out/$program.1"
done
