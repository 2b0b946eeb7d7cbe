# SPDX-License-Identifier: Apache-2.0
# A text of --help as man page source. -v part=page: name, synopsis, description and commands of a
# program; -v part=command -v command=NAME: a subsection for one of its commands. -v program=NAME.
function plain(s) {
  gsub(/\\/, "\\e", s)
  gsub(/-/, "\\-", s)
  if (s ~ /^[.']/) s = "\\&" s
  return s
}
function close_example() {
  if (is_example) print ".fi\n.RE"
  is_example = 0
}
function open_example() {
  if (!is_example) print ".RS\n.nf"
  is_example = 1
}
function heading(s) {
  close_example()
  print (part == "page" ? ".SH " toupper(s) : ".PP\n.B " s)
}
function option(line,    at, left) { # "  --name ARG   what it does"
  sub(/^  /, "", line)
  at = match(line, /  +/)
  left = at ? substr(line, 1, at - 1) : line
  sub(/ +$/, "", left)
  left = plain(left)
  gsub(/\|/, "|\\:", left) # long lists of words may break there
  print ".TP\n.B " left
  if (at) print plain(substr(line, at + RLENGTH))
}
BEGIN { where = "top" }
/^usage: / {
  line = substr($0, 8)
  if (part == "page") {
    usage = line
    if (name) begin_page()
  } else print ".SS " plain(command) "\n.PP\n.B " plain(line) "\n.PP"
  where = "text"
  next
}
where == "top" && NF { # "PROGRAM: what it is"
  name = $0
  sub(/^[^:]*: /, "", name)
  sub(/ \(board [^)]*\)/, "", name)
  next
}
function begin_page() {
  sub(/(\.$|: .*)/, "", name)
  print ".TH " toupper(program) " 1 \"\" \"subview\" \"User Commands\""
  print ".ad l" # a line of one long word cannot be stretched
  print ".SH NAME\n" plain(program) " \\- " plain(name) "\n.SH SYNOPSIS\n.B " plain(usage) "\n.SH DESCRIPTION"
  is_begun = 1
}
part == "page" && !is_begun && NF {
  name = $0
  begin_page()
  print plain($0)
  next
}
/^[Oo]ptions/ { heading("Options"); where = "options"; next }
/^[Ee]xample/ { heading("Example"); where = "example"; next }
where == "example" && NF { open_example(); sub(/^  /, ""); print plain($0); next }
where == "options" && /^[A-Z][^:]*:$/ { sub(/:$/, ""); print ".PP\n.I " plain($0); next }
where == "options" && /^  --/ { option($0); next }
where == "options" && /^   / { sub(/^ +/, ""); print plain($0); next }
where != "example" && /^  [^ ]/ { open_example(); sub(/^  /, ""); print plain($0); next }
part == "page" && !is_begun { next }
!NF { if (where == "text") { close_example(); print ".PP" } next }
{ if (where != "text") { close_example(); print ".PP"; where = "text" } else close_example(); print plain($0) }
END { close_example() }
