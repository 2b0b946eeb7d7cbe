#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# A check that cannot fail proves nothing. Each lint, the runner and the installer get a small tree
# with one seeded fault that must turn them red, beside a clean tree that must leave them green.
set -u
root=$(readlink -f "$(dirname "$0")/../..")
lint=$root/tools/lint
tree=$(readlink -f "$(mktemp -d)")
trap 'rm -rf "$tree"' EXIT
cd "$tree" || exit 2
unset SAN
CC=gcc
export CC
passed=0 failed=0 skipped=0
licence='// SPDX-License-Identifier: Apache-2.0'

# A clean tree: one file of every room.
clean() {
  cd "$tree" && rm -rf ./* && mkdir -p src/base src/app src/rig kernels/dot calib/solve platform/sim boards tools/lab tests
  guard() { printf '%s\n#ifndef %s\n#define %s\n%s\n#endif\n' "$licence" "$2" "$2" "$3" >"$1"; }
  guard src/base/floor.h SV_FLOOR_H 'int sv_floor(int x);'
  guard kernels/kernels.h SV_KERNELS_H 'int sv_dot(int a, int b);'
  guard kernels/dot/dot.h SV_DOT_H '#include <stdint.h>'
  guard src/rig/rig.h SV_RIG_H '#include "src/base/floor.h"'
  guard calib/model.h SV_MODEL_H '#include "src/base/floor.h"'
  guard calib/solve/solve.h SV_SOLVE_H '#include <stdlib.h>'
  guard tests/helper.h SV_HELPER_H 'int helper(void);'
  printf '%s\n#include "kernels/dot/dot.h"\n' "$licence" >kernels/dot/dot_ref.c
  printf '%s\n#include "kernels/kernels.h"\n#include "calib/model.h"\n' "$licence" >src/app/app.c
  printf '%s\n#include <stdio.h>\n#include "src/rig/rig.h"\n#include "calib/model.h"\n' "$licence" >platform/sim/sim.c
  printf '%s\n#include "src/rig/rig.h"\n#include "calib/solve/solve.h"\n' "$licence" >tools/lab/lab.c
  # Words in prose and in strings are not code.
  printf '%s\n// malloc(3) is not for us; /* free(x) */\nconst char *sv_text = "malloc(3)";\n' "$licence" >src/app/prose.c
}

# red|green NAME COMMAND...: the command must fail, and say WANT when WANT is set, or must pass.
judge() {
  colour=$1 name=$2
  shift 2
  out=$("$@" 2>&1)
  code=$?
  if [ $code -eq 77 ]; then
    echo "skipped: $name: $out"
    skipped=$((skipped + 1))
  elif [ "$colour" = green ] && [ $code -eq 0 ]; then
    passed=$((passed + 1))
  elif [ "$colour" = red ] && [ $code -ne 0 ] && printf '%s' "$out" | grep -q -- "${WANT:-.}"; then
    passed=$((passed + 1))
  else
    echo "not $colour: $name (exit $code): $out"
    failed=$((failed + 1))
  fi
}
red() { judge red "$@"; }
green() { judge green "$@"; }
add() { printf '%b\n' "$2" >>"$1"; }

# --- includes
clean
green "includes: clean" "$lint/includes.sh"
breach() { # file, include line
  clean
  add "$1" "#include $2"
  red "includes: $1 takes $2" "$lint/includes.sh"
}
breach src/base/floor.h '"src/rig/rig.h"'
breach src/base/floor.h '"kernels/kernels.h"'
breach kernels/dot/dot_ref.c '"src/base/floor.h"'
breach calib/model.h '"src/rig/rig.h"'
breach src/app/app.c '"kernels/dot/dot.h"'
breach src/app/app.c '"calib/solve/solve.h"'
breach src/app/app.c '<stdio.h>'
breach src/app/app.c '<unistd.h>'
breach src/app/app.c '"app.h"'
breach src/app/app.c '<src/rig/rig.h>'
breach platform/sim/sim.c '"kernels/kernels.h"'
breach platform/sim/sim.c '"calib/solve/solve.h"'
breach src/rig/rig.h '"platform/sim/sim.c"'
WANT='must not include' breach tools/lab/lab.c '"tests/helper.h"'
WANT='lists for the build' breach tools/lab/lab.c '<cmocka.h>'
WANT='lists for the build' breach platform/sim/sim.c '<unheard/of.h>'
clean
mkdir -p src/run
printf '%s\n' "$licence" >src/run/run.h
add src/rig/rig.h '#include "src/run/run.h"'
WANT='must not include' red "includes: a room takes a header of the run" "$lint/includes.sh"
clean
add tools/lab/lab.c '#include <png.h>\n#include <sys/stat.h>'
green "includes: a tool takes a library of the build" "$lint/includes.sh"

# --- files
clean
green "files: clean" "$lint/files.sh"
yes '// line' | head -n 600 >>src/app/app.c
WANT='the limit is 599' red "files: too long" "$lint/files.sh"
clean
sed -i 1d src/app/app.c
WANT=SPDX red "files: no licence line" "$lint/files.sh"

# --- words (the seeds are put together here, so that this file has none of them)
clean
green "words: clean" "$lint/words.sh"
word() { # file, text
  clean
  add "$1" "$2"
  red "words: $2 in $1" "$lint/words.sh"
}
word src/app/app.c 'void *p(void) { return malloc(3); }'
word src/app/app.c 'free(p);'
word kernels/dot/dot_ref.c 'void f(void) { printf("x"); }'
word calib/model.h 'static inline void *f(void) { return alloca (8); }'
word tools/lab/lab.c "// TO""DO: later"
word platform/sim/sim.c 'const char *p = "/ho''me/me/data";'
clean
add tools/lab/lab.c 'void *p(void) { return malloc(3); }'
add calib/solve/solve.h 'void *p(void) { return malloc(3); }'
add src/app/app.c 'void f(struct pool *p) { p->free(3); sv_free(3); }'
green "words: tools and solvers may, members and longer names are not the heap" "$lint/words.sh"

# --- width and statements
clean
green "width: clean" "$lint/width.sh"
long=$(yes word | head -n 25 | tr '\n' ' ')
wide() { # file, line
  clean
  add "$1" "$2"
  WANT='beyond column 100' red "width: $1" "$lint/width.sh"
}
wide src/app/app.c "// $long"
wide src/app/app.c "int sv_count(void); // $long"
wide tools/lab/run.sh "# $long"
clean
add src/app/app.c "static const char *sv_line = \"// $long\";"
green "width: a long string is not a comment" "$lint/width.sh"
clean
green "statements: clean" "$lint/statements.sh"
chain() { # line
  clean
  add src/app/app.c "void sv_f(int a, int b) {\n$1\n}"
  WANT='chained by commas' red "statements: $1" "$lint/statements.sh"
}
chain '  a = 1, b = 2;'
chain '  if (a) a++, b--;'
chain '  for (int i = 0; i < 3; i++) a += i, b -= i;'
chain '  sv_f(1, 2), sv_f(3, 4);'
clean
add src/app/app.c 'void sv_f(int a) {\n  int x = a, *p = &x;\n  int v[2] = {1, 2};\n  for (int i = 0, j = 1; i < j; i++, j--) sv_f(i);\n}'
green "statements: declarations, initialisers and heads of for" "$lint/statements.sh"

# --- terms
clean
green "terms: clean" "$lint/terms.sh"
word_of_old() { # text, wanted term
  clean
  add src/app/app.c "$1"
  WANT=$2 red "terms: $1" "$lint/terms.sh"
}
word_of_old "// the wa""y back of blending" 'backward pass'
word_of_old "int has""te;" 'learning-rate boost'
word_of_old "// an ow""n rasterizer" 'its own'

# --- headers
clean
green "headers: clean" "$lint/headers.sh"
printf '%s\n#ifndef A\n#define A\nstatic inline size_t f(void) { return 0; }\n#endif\n' "$licence" >src/app/bad.h
WANT='alone as C11' red "headers: not self-contained" "$lint/headers.sh"
printf '%s\nstruct twice { int a; };\n' "$licence" >src/app/bad.h
WANT='alone as C11' red "headers: no guard" "$lint/headers.sh"
printf '%s\n#ifndef A\n#define A\nstruct s { int class; };\n#endif\n' "$licence" >src/app/bad.h
WANT='alone as C++17' red "headers: not C++" "$lint/headers.sh"
printf '%s\n// C only\n#ifndef A\n#define A\nstruct s { int class; };\n#endif\n' "$licence" >src/app/bad.h
green "headers: C only" "$lint/headers.sh"
printf '%s\n#ifndef A\n#define A\n#include <unistd.h>\nstatic inline int f(void) { return (int)gettid(); }\n#endif\n' \
  "$licence" >src/app/bad.h
WANT='alone as C11' red "headers: the core has no POSIX" "$lint/headers.sh"

# --- symbols and stack, on a library of one file
library() {
  clean
  rm -rf build && mkdir -p build/obj/src/app
  printf '%b\n' "$1" >src/app/app.c
  gcc -std=c11 -O2 -w -fno-builtin -fstack-usage -c src/app/app.c -o build/obj/src/app/app.o &&
    ar rcs build/libcore.a build/obj/src/app/app.o
}
symbol() {
  library "$3"
  $1 "symbols: $2" "$lint/symbols.sh" build
}
symbol green clean 'float sqrtf(float);\nconst int sv_table[3] = {1};\nfloat sv_f(float x) { return sqrtf(x); }'
WANT=malloc symbol red malloc 'void *malloc(unsigned long);\nvoid *sv_f(void) { return malloc(3); }'
WANT=expf symbol red expf 'float expf(float);\nfloat sv_f(float x) { return expf(x); }'
WANT='can be written' symbol red 'a global' 'int sv_count;\nint sv_f(void) { return ++sv_count; }'
WANT='can be written' symbol red 'a static' 'int sv_f(void) { static int n = 3; return ++n; }'
WANT='weak or common' symbol red 'a weak function' '__attribute__((weak)) int sv_f(void) { return 1; }'
stack() {
  library "$3"
  $1 "stack: $2" "$lint/stack.sh" build
}
use='void sv_use(char *p);\n'
stack green clean "${use}void sv_f(void) { char a[3000]; sv_use(a); }"
WANT='bytes of stack' stack red 'a large frame' "${use}void sv_f(void) { char a[5000]; sv_use(a); }"
WANT='not known before' stack red 'a VLA' "${use}void sv_f(int n) { char a[n]; sv_use(a); }"
rm -rf build
red "stack: nothing built" "$lint/stack.sh" build

# --- links
program() { # colour, name, a file below tests/ or nothing
  clean
  mkdir -p build/bin
  echo 'int main(void) { return 0; }' >tools/lab/main.c
  echo 'int helper(void) { return 1; }' >tests/helper.c
  # shellcheck disable=SC2086 # none or one
  gcc -g tools/lab/main.c $3 -o build/bin/program && $1 "links: $2" "$lint/links.sh" build
}
program green clean ''
WANT='tests/helper.c is linked in' program red "a test's helper" tests/helper.c
# What `subview` may need of the system, and a library more than that.
runtime() { # colour, name, libraries
  # shellcheck disable=SC2086 # a list of words
  gcc -g tools/lab/main.c -Wl,--no-as-needed $3 -o build/bin/subview && $1 "links: $2" "$lint/links.sh" build
}
clean
mkdir -p build/bin
echo 'int main(void) { return 0; }' >tools/lab/main.c
runtime green "libraries of subview" '-lm'
WANT='needs libz.so.1, expected' runtime red "subview needs a library more" '-lm -lz'
rm -rf build
WANT='were they built' red "links: nothing built" "$lint/links.sh" build

# --- calibration: a release of mrcal with other calls is named, not guessed
mrcal() { # colour, name, an argument list for the call that tells the releases apart; "real" is the
          # library's own
  mkdir -p fake/mrcal
  printf '#define mrcal_unpack_solver_state_vector sv_real\n#include_next <mrcal/mrcal.h>\n#undef %s\nvoid %s(%s);\n' \
    mrcal_unpack_solver_state_vector mrcal_unpack_solver_state_vector "$3" >fake/mrcal/mrcal.h
  [ "$3" != real ] || rm fake/mrcal/mrcal.h
  if [ -e /usr/include/mrcal/mrcal.h ]; then
    $1 "mrcal: $2" gcc -std=c11 -D_GNU_SOURCE -fsyntax-only -Ifake "-I$root" "$root/calib/solve/boards_sd_mrcal.c"
  else
    $1 "mrcal: $2" sh -c 'echo libmrcal-dev is not installed; exit 77'
  fi
}
clean
mrcal green "the release that is installed" real
WANT='this release of mrcal is unknown' mrcal red "an unknown release" 'double *state, long n_cameras'

# --- documents
# shellcheck disable=SC2016 # backticks are those of Markdown
documents() { # colour, name, file, text added to it
  clean
  mkdir docs
  printf '# Title\n\n[map](docs/map.md#the-map)\n' >README.md
  printf '# The map\n\n`src/app/prose.c: sv_text` [back](../README.md) sv_text\n' >docs/map.md
  add "$3" "$4"
  $1 "docs: $2" "$lint/docs.sh"
}
documents green clean docs/map.md ''
# shellcheck disable=SC2016
{
  documents green 'placeholders and code blocks' docs/map.md '`boards/NAME/board.h` `src/app/FOO.c`\n```\n[x](y.md) sv_none\n```'
  WANT='the limit is 150' documents red 'a long README' README.md "$(yes line | head -n 150)"
  WANT='leads nowhere' documents red 'a link to nothing' docs/map.md '[x](gone.md)'
  WANT='no such heading' documents red 'an anchor to nothing' docs/map.md '[x](../README.md#gone)'
  WANT='does not exist' documents red 'a path to nothing' docs/map.md '`src/app/gone.c`'
  WANT='has no sv_gone' documents red 'a function that is gone' docs/map.md '`src/app/prose.c: sv_gone`'
  WANT='no such target' documents red 'a target that is gone' docs/map.md '```\nmake -j2 gone BOARD=x # it\n```'
  WANT='does not exist' documents red 'a test that is gone' docs/map.md 'see unit/test_gone'
  WANT='not in the sources' documents red 'a name that is gone' docs/map.md 'calls sv_gone(3)'
}

# --- format
clean
cp "$root/.clang-format" .
green "format: clean" "$lint/format.sh"
add src/app/app.c 'int   sv_f( void ){return 1 ;}'
WANT=src/app/app.c red "format: seeded" "$lint/format.sh"

# --- runner
clean
tab=$(printf '\t')
run() { # colour, name, list
  printf '%b\n' "$3" >list
  $1 "runner: $2" "$root/tests/run/run.sh" -o "$tree/run" list
}
run green 'passes' "a${tab}true"
run red 'a failure' "a${tab}true\nb${tab}false"
run red 'nothing' ''
run red 'only skips' "a${tab}exit 77"
WANT='not done after 1 s' run red 'a hang' "a${tab}sleep 9${tab}1"
WANT='^7 passed, 2 failed, 1 skipped$' run red 'a failure that the program counted' \
  "a${tab}echo 6 passed, 2 failed, 1 skipped\nb${tab}true"
WANT='^1 passed, 1 failed, 0 skipped$' run red 'a crash after good cases' \
  "a${tab}printf '[ RUN      ] x\\\\n[       OK ] x\\\\n'; kill -SEGV \$\$"
WANT='^skip  5 x no such instructions (a, b)$' run red 'skips, summed up by reason' \
  "a${tab}echo 'skip no such instructions (add)'; echo 'skipped: no such instructions (mul)'; echo 1 passed, 1 failed, 2 skipped
b${tab}echo 'skip  3 x no such instructions (c)'; echo 0 passed, 0 failed, 3 skipped"
ended() { # with the run ends what it has started
  rm -f started
  printf 'a\techo $$ >%s/started; exec sleep 20\n' "$tree" >list
  setsid "$root/tests/run/run.sh" -o "$tree/run" list &
  runner=$!
  for _ in 1 2 3 4 5 6 7 8 9 10; do
    [ -s started ] && break
    sleep 0.5
  done
  kill -TERM "-$runner"
  wait $runner
  for _ in 1 2 3 4 5 6 7 8 9 10; do
    kill -0 "$(cat started)" 2>/dev/null || return 0
    sleep 0.5
  done
  kill "$(cat started)"
  return 1
}
green 'runner: ended before its time' ended

# --- installer: on a machine that has everything it does nothing, without it asks for what is missi
mkdir -p bin
for tool in sh uname id dirname readlink sort awk sed grep tr cut; do ln -sf "$(command -v $tool)" bin/; done
needs() {
  env PATH="$tree/bin" "$root/tools/deps/install.sh" build --list | grep -qx gcc
}
green "installer: notices a missing compiler" needs
minimal() {
  env PATH="$tree/bin" WITH=minimal "$root/tools/deps/install.sh" build --list | grep -qx 'g++' && return 1
  env PATH="$tree/bin" "$root/tools/deps/install.sh" build --list | grep -qx 'g++'
}
green "installer: WITH=minimal asks for no C++ compiler" minimal
WANT='not a Debian kind' red "installer: without apt" env PATH="$tree/bin" "$root/tools/deps/install.sh" build

echo "$passed passed, $failed failed, $skipped skipped"
[ $failed -eq 0 ]
