#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# The project's own files, one a line, without ./ in front: `sources.sh c` those in C and C++,
# `sources.sh text` all that people write. Everything below the current folder but what was built;
# git is not asked, so new files count at once.
case ${1:-text} in
c) names='\.(c|h|inc|cc|cpp|hpp)$' ;;
*) names='\.(c|h|inc|cc|cpp|hpp|sh|awk|py|mk|md|html|js|css|txt|json|yml)$|/Makefile$|^\./\.ci/|/\.clang-' ;;
esac
find . -name .git -prune -o -path ./build -prune -o -path ./out -prune -o -type f -print | grep -E "$names" |
  sed 's|^\./||' | LC_ALL=C sort
