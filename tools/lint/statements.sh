#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# One statement a line: no assignments or calls chained by commas. Heads of `for` and initialisers
# may use them.
cd "${1:-.}" || exit 2
lint=$(dirname "$(readlink -f "$0")")
# shellcheck disable=SC2046 # names of ours have no spaces
hits=$(LC_ALL=C awk -f "$lint/strip.awk" $("$lint/sources.sh" c) /dev/null | LC_ALL=C awk '
  # strip.awk prints file:line:text without comments, with empty strings.
  {
    split($0, part, ":")
    file = part[1]
    line = part[2]
    text = substr($0, length(file) + length(line) + 3)
    if (file != last) { depth = 0; statement = ""; is_open = 0 }
    last = file
    if (text ~ /^[ \t]*#/ || in_macro) { in_macro = text ~ /\\[ \t]*$/; next }
    n = length(text)
    for (i = 1; i <= n; i++) {
      c = substr(text, i, 1)
      if (c == "(" || c == "[") depth++
      else if (c == ")" || c == "]") depth--
      if (depth == 0 && (c == ";" || c == "{" || c == "}")) {
        # A brace after =, in a list or after `return (type)` opens an initialiser, which has no
        # statements; so does the brace of an enum.
        if (c == "{" && opens_list(body_of(statement))) braces++
        else if (c == "}" && braces > 0) { braces--; statement = statement c; continue }
        else if (!braces) { check(); statement = ""; continue }
      }
      if (statement == "") start = line
      if (statement != "" || c !~ /[ \t]/) statement = statement c
    }
    if (statement != "") statement = statement " "
  }
  function opens_list(s) {
    if (s ~ /^[ \t]*(return[ \t]*\(.*\)|(typedef[ \t]+)?enum[ \t]*[a-z_0-9]*)[ \t]*$/) return 1
    return s ~ /(=|\)|,|\{)[ \t]*$/ && s ~ /=|^[ \t]*\{/
  }
  # The statement behind labels, conditions and heads of loops.
  function body_of(s,  before) {
    do {
      before = s
      sub(/^[ \t]*((else|do)[ \t]+)?/, "", s)
      if (match(s, /^(if|while|switch|for)[ \t]*\(/)) s = after_bracket(s)
      sub(/^[ \t]*(case[^:]*|default)[ \t]*:[ \t]*/, "", s)
    } while (s != before)
    return s
  }
  # A chain has an assignment before a comma outside of brackets and no type in front.
  function check(  s) {
    s = body_of(statement)
    # Outside of brackets only.
    s = flat(s)
    if (s !~ /,/ || s ~ /^(std::|double\()/) return
    if (s ~ /^(return|goto|typedef|enum|struct|union|static|const|extern|unsigned|signed|register)[ \t]/ && s !~ /^return/) return
    # `type name` or `type *name` in front: a declaration
    if (s ~ /^[A-Za-z_][A-Za-z0-9_]*([ \t]+[A-Za-z_][A-Za-z0-9_]*)*[ \t]*[ *&]+((const|restrict)[ \t]+)?[A-Za-z_][A-Za-z0-9_]*[ \t]*(=|,|\(|\[|;|$)/ &&
        s !~ /^[A-Za-z_][A-Za-z0-9_]*[ \t]*([-+*\/%&|^]|<<|>>)?=/) return
    if (s ~ /[-+*\/%&|^<>!=]?=[^=].*,|(\+\+|--)[ \t]*,|,[^,]*=[^=]|\)[ \t]*,/) print file ":" start ": " substr(statement, 1, 90)
  }
  function after_bracket(s,  i, d, c) {
    d = 0
    for (i = index(s, "("); i <= length(s); i++) {
      c = substr(s, i, 1)
      if (c == "(") d++
      else if (c == ")" && --d == 0) return substr(s, i + 1)
    }
    return ""
  }
  function flat(s,  i, d, c, out) {
    d = 0
    out = ""
    for (i = 1; i <= length(s); i++) {
      c = substr(s, i, 1)
      if (c ~ /[(\[{]/) { d++; if (d == 1) out = out c }
      else if (c ~ /[)\]}]/) { d--; if (d == 0) out = out c }
      else if (d == 0) out = out c
    }
    return out
  }')
[ -z "$hits" ] && exit 0
printf '%s\n' "$hits" | sed 's/$/    <- several statements chained by commas/'
exit 1
