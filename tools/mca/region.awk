# SPDX-License-Identifier: Apache-2.0
# Cuts one region out of a compiler's assembler output:
#   -v fn=REGEX     of the function's name
#   -v kind=KIND    its shortest or longest innermost loop with at least min_fma fused
#   multiply-adds, or body: all of it
# A loop reaches from a label to the first branch back to it: what the compiler moved behind is what
# seldom runs. -v what=count prints "instructions spills" instead of the text; a spill is a vector
# on the stack.
function is_branch(s) { return s ~ /^\t(b|b\.?[a-z][a-z]|cbn?z|tbn?z|j[a-z]+)\t/ }
function is_code(s) { return s ~ /^\t[a-z]/ }
function target(s) { return match(s, /\.L[A-Za-z0-9_]+/) ? substr(s, RSTART, RLENGTH) : "" }
/^[A-Za-z_][A-Za-z0-9_.]*:/ {
  name = $0
  sub(/:.*/, "", name)
  on = !done && name ~ "^(" fn ")$"
  next
}
on && /^\t\.size\t/ { on = 0; done = 1 }
on {
  line[++n] = $0
  if ($0 ~ /^\.L[A-Za-z0-9_]+:/) { l = $0; sub(/:.*/, "", l); at[l] = n }
}
END {
  from = 1; to = n
  if (kind != "body") {
    from = 0
    for (i = 1; i <= n; i++) {
      t = is_branch(line[i]) ? target(line[i]) : ""
      if (t != "" && (t in at) && at[t] < i && !(t in last)) { last[t] = i; label[++m] = t }
    }
    for (a = 1; a <= m; a++) {
      lo = at[label[a]]; hi = last[label[a]]; inner = 1; fma = 0; size = 0
      for (b = 1; b <= m; b++)
        if (b != a && at[label[b]] >= lo && last[label[b]] <= hi) inner = 0
      for (i = lo; i <= hi; i++) {
        if (line[i] ~ /^\t(fmla|fmls|vfn?m(add|sub)[0-9]*ps)\t/) fma++
        if (is_code(line[i])) size++
      }
      if (!inner || fma < min_fma || (from && (kind == "longest" ? size <= best : size >= best))) continue
      from = lo; to = hi; best = size
    }
  }
  if (n == 0 || !from) exit 3
  for (i = from; i <= to; i++) {
    if (!is_code(line[i])) continue
    n_code++
    if (line[i] ~ /\[(sp|x29)[],]/ && line[i] ~ /[^a-z]q[0-9]/) n_spills++
    if (line[i] ~ /\(%r(sp|bp)\)/ && line[i] ~ /%[xyz]mm/) n_spills++
    # A called function is a region of its own.
    if (what != "count" && line[i] !~ /^\t(bl|call|ret)(\t|$)/) print line[i]
  }
  if (what == "count") print n_code + 0, n_spills + 0
}
