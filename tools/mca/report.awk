# SPDX-License-Identifier: Apache-2.0
# First file: rows "core op region times instructions spills cycles"; second: steps and boards.
# Prints the tables of tools/mca/mca.sh.
#
# A step: pixel-splat pairs blended forward and backward, three channels of loss, Gaussians
# projected forward and backward and optimised (23 rows of SH degree 1), a fifth of the backward
# pass once more for the curvature (GRADIENTS), and the scalar part: sort, lists and target, by
# instructions that callgrind counted on x86, at SCALAR_IPC. DERATE: measured over predicted cycles
# of the same loops on x86 (1.2), and some for what the small cores hide worse: caches, branches,
# the end of each stage.
function of(core, op) { return cyc[core, op] / 16 }
FNR == 1 { file++ }
/^#/ { next }
file == 1 {
  if (!($1 in seen)) { seen[$1]; core[++n] = $1 }
  if (!($2 in ops)) { ops[$2]; op[++m] = $2 }
  code[$1, $2] += $4 * $5; spill[$1, $2] += $4 * $6; cyc[$1, $2] += $4 * $7
  if (verbose == "-v")
    printf "%-8s %-12s %-24s x%-3s %5d instructions %4d spills %8.1f cycles\n", $1, $2, $3, $4, $5, $6, $7
  next
}
$1 == "step" { n_steps++; step[n_steps] = $2 " Gaussians, " $3; n_g[n_steps] = $2; split($3, px, "x")
  n_px[n_steps] = px[1] * px[2]; pairs[n_steps] = $4; visible[n_steps] = $5; intersections[n_steps] = $6 }
$1 == "board" { boards++; board[boards] = $2; for (i = 3; i <= NF; i++) word[boards, i] = $i; words[boards] = NF }
function step_cycles(c, s) {
  scalar = (SORT * visible[s] + BIN * intersections[s] + TARGET * n_px[s]) / (c == "A76" ? 1.5 : 1)
  return pairs[s] * (of(c, "raster") + GRADIENTS * of(c, "raster_bwd")) + 3 * n_px[s] * (of(c, "ssim") / 2 + of(c, "ssim_bwd")) \
    + n_g[s] * (of(c, "project") + GRADIENTS * of(c, "project_bwd") + 23 * of(c, "newton")) + scalar
}
END {
  SORT = 86; BIN = 250; TARGET = 8; DERATE = 1.5; GRADIENTS = 1.2
  printf "%-12s", ""
  for (c = 1; c <= n; c++) printf " %22s", core[c]
  print ""
  for (o = 1; o <= m; o++) {
    printf "%-12s", op[o]
    for (c = 1; c <= n; c++) {
      if ((core[c], op[o]) in cyc)
        printf " %10s %11.1f", code[core[c], op[o]] "/" spill[core[c], op[o]], cyc[core[c], op[o]]
      else printf " %22s", "-"
    }
    print ""
  }
  print "\npredicted milliseconds of a step, all cores, no other load: from the cycles above, and times " DERATE
  printf "%-28s", ""
  for (b = 1; b <= boards; b++) printf " %18s", board[b]
  print ""
  for (s = 1; s <= n_steps; s++) {
    printf "%-28s", step[s]
    for (b = 1; b <= boards; b++) {
      rate = 0 # steps a millisecond; tasks go to whatever core is free
      for (i = 3; i < words[b]; i += 3) rate += word[b, i + 1] * word[b, i + 2] * 1e6 / step_cycles(word[b, i], s)
      printf " %8.1f %9.1f", 1 / rate, DERATE / rate
    }
    print ""
  }
}
