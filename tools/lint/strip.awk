# SPDX-License-Identifier: Apache-2.0
# C and C++ without comments, and without the inside of strings and characters: "file:line:code" for
# each line. The names after #include stay. What is left is code, so the lints do not stumble over
# words in prose.
FNR == 1 { is_comment = 0 }
{
  line = $0
  if (!is_comment && line ~ /^[ \t]*#[ \t]*include/) {
    sub(/\/\/.*/, "", line)
    print FILENAME ":" FNR ":" line
    next
  }
  out = ""
  while (line != "") {
    if (is_comment) {
      at = index(line, "*/")
      if (at == 0) break
      line = substr(line, at + 2)
      is_comment = 0
      out = out " "
      continue
    }
    if (!match(line, /["'\/]/)) { out = out line; break }
    out = out substr(line, 1, RSTART - 1)
    c = substr(line, RSTART, 1)
    line = substr(line, RSTART)
    if (c == "/") {
      two = substr(line, 1, 2)
      if (two == "//") break
      if (two == "/*") is_comment = 1
      else out = out "/"
      line = substr(line, two == "/*" ? 3 : 2)
    } else { # a string or a character: leave its quotes only
      q = c
      n = length(line)
      for (i = 2; i <= n; i++) {
        c = substr(line, i, 1)
        if (c == "\\") i++
        else if (c == q) break
      }
      out = out q q
      line = substr(line, i + 1)
    }
  }
  if (out ~ /[^ \t]/) print FILENAME ":" FNR ":" out
}
