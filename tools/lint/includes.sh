#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Who may include whom. The folders are the architecture, and this keeps it so:
#   src/base         src/base
#   kernels          kernels
#   calib            calib, kernels, src/base
#   src              src, calib, kernels/kernels.h; src/run, which is on top, only src/run
#   platform         platform, src/port, src/base, src/rig, calib/model.h, calib/fisheye.h,
#                    src/image/noise.h (what a sensor does to light); platform/preview src/format,
#                    too: it hands files out
#   boards           boards, platform, src, tools/bench (where a board wants it), the version
#   tools/bench      tools/bench, kernels, src
#   include/subview  its own folder, by the file's name alone: it is installed without the tree.
#                    Only src/library, which implements it, and tests include it.
#   examples         <subview/...>, as installed
# calib/solve is for tools and tests only; tools may include all of these, and tests anything.
# Our own headers are included with quotes and named from the root of the tree; quotes are for
# nothing else. tests is for tests only.
# The core (src, kernels, calib) includes the headers of freestanding C, a few of libc that need no
# system, and the processor's intrinsics. Programs include headers of libc, of C++, of Linux and of
# the packages that tools/deps/packages.txt lists for the build.
cd "${1:-.}" || exit 2
lint=$(dirname "$(readlink -f "$0")")
# shellcheck disable=SC2046 # names of ours have no spaces
LC_ALL=C awk -f "$lint/strip.awk" $("$lint/sources.sh" c) /dev/null |
  grep -E '^[^:]*:[0-9]*:[ 	]*#[ 	]*include' | LC_ALL=C awk -F : -v packages="$lint/../deps/packages.txt" '
  function says(text) { print file ":" $2 ": " text; bad = 1 }
  function starts(s, p) { return substr(s, 1, length(p)) == p }
  BEGIN { # parts of the paths of the headers that each stage of tools/deps/install.sh brings
    while ((getline line < packages) > 0) {
      if (line ~ /^#/ || split(line, field, / *[|] */) < 4) continue
      n = split(field[2], part, "/")
      for (i = 1; i <= n; i++) stage[part[i]] = stage[part[i]] " " field[1]
    }
  }
  function is_system(to) {
    return to !~ /[.]/ || to ~ /^(sys|linux|asm|arpa|net|netinet)\// ||
           to ~ /^(assert|complex|ctype|errno|fenv|float|inttypes|iso646|limits|locale|math|setjmp|signal)\.h$/ ||
           to ~ /^(std(align|arg|atomic|bool|def|int|io|lib|noreturn)|string|tgmath|threads|time|uchar|wchar|wctype)\.h$/ ||
           to ~ /^(dirent|dlfcn|execinfo|fcntl|fnmatch|getopt|glob|grp|ifaddrs|langinfo|link|malloc|netdb|poll|pty)\.h$/ ||
           to ~ /^(pthread|pwd|regex|sched|semaphore|spawn|strings|sysexits|syslog|termios|ucontext|unistd|utime)\.h$/ ||
           to ~ /^(immintrin|smmintrin|cpuid|arm_neon)\.h$/
  }
  function may(to) {
    if (starts(file, "include/")) return to !~ /\//
    if (starts(file, "examples/")) return 0
    if (starts(to, "tests/")) return starts(file, "tests/")
    if (to == "include/subview/version.h") return file ~ /^(boards|tools|platform\/preview)\//
    if (starts(to, "include/")) return file ~ /^(src\/library|tests)\//
    if (starts(file, "src/base/")) return starts(to, "src/base/")
    if (starts(file, "kernels/")) return starts(to, "kernels/")
    if (starts(to, "calib/solve/")) return file ~ /^(calib\/solve|tools|tests)\//
    if (starts(file, "calib/solve/")) return to ~ /^(calib|kernels|src)\//
    if (starts(file, "calib/")) return to ~ /^(calib|kernels|src\/base)\//
    if (starts(file, "src/") && starts(to, "src/run/")) return starts(file, "src/run/")
    if (starts(file, "src/")) return starts(to, "src/") || starts(to, "calib/") || to == "kernels/kernels.h"
    if (starts(file, "platform/"))
      return to ~ /^(platform|src\/port|src\/base|src\/rig)\// || to == "calib/model.h" || to == "calib/fisheye.h" ||
             to == "src/image/noise.h" || (starts(file, "platform/preview/") && starts(to, "src/format/"))
    if (starts(file, "boards/")) return to ~ /^(boards|platform|src|tools\/bench)\//
    if (starts(file, "tools/bench/")) return to ~ /^(tools\/bench|kernels|src)\//
    return 1
  }
  {
    file = $1
    text = $0
    if (match(text, /"[^"]*"/)) {
      to = substr(text, RSTART + 1, RLENGTH - 2)
      path = starts(file, "include/subview/") ? "include/subview/" to : to
      if ((getline ignored < path) < 0) says("\"" to "\" is not a file named from the root of the tree")
      else if (!may(to)) says("must not include \"" to "\"")
      close(path)
    } else if (match(text, /<[^>]*>/)) {
      to = substr(text, RSTART + 1, RLENGTH - 2)
      if (to ~ /^(src|kernels|calib|platform|boards|tools|tests)\//)
        says("<" to "> is ours: include it with quotes")
      is_core = file ~ /^(src|kernels|calib|include)\// && !starts(file, "calib/solve/")
      is_free = to ~ /^(assert|float|limits|math|std(align|arg|atomic|bool|def|int)|string)\.h$/ ||
                to ~ /^(immintrin|smmintrin|cpuid|arm_neon|sys\/auxv|asm\/hwcap|jsmn)\.h$/
      if (is_core && !is_free) says("<" to "> is outside what the core may use")
      first = to
      sub(/\/.*/, "", first)
      if (starts(file, "examples/") && starts(to, "subview/")) next
      if (!is_core && !starts(file, "tests/") && !is_system(to) && stage[first] !~ /build/)
        says("<" to "> comes with no package that tools/deps/packages.txt lists for the build")
    } else if (text !~ /include[ \t]+[A-Za-z_]/) says("an include that cannot be read")
  }
  END { exit bad }'
