#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Words that must not stand in the sources: the heap and the process in the core, unfinished work
# anywhere, folders and servers of one person's machine anywhere.
cd "${1:-.}" || exit 2
lint=$(dirname "$(readlink -f "$0")")
bad=0

# A struct member may carry such a name (an entry that is free); only calls are meant.
heap='malloc|calloc|realloc|reallocarray|free|alloca|aligned_alloc|posix_memalign|strdup'
process='exit|abort|printf|fprintf|sprintf|snprintf|puts|fopen|getenv|rand|srand|time|setjmp|longjmp'
call="(^|[^A-Za-z0-9_.>])($heap|$process)[ ]*\\("
core=$("$lint/sources.sh" c | grep -E '^(src|kernels|calib)/' | grep -v '^calib/solve/')
# shellcheck disable=SC2086 # names of ours have no spaces
hits=$(LC_ALL=C awk -f "$lint/strip.awk" $core /dev/null | grep -E "^[^:]*:[0-9]*.*$call")
if [ -n "$hits" ]; then
  printf '%s\n' "$hits" | sed 's/$/    <- the core has no heap and no process/'
  bad=1
fi

# Spelled so that this file does not find itself.
marks='(^|[^A-Za-z_])(TO''DO|FIX''ME|X''XX|HA''CK)([^A-Za-z_]|$)'
hits=$("$lint/sources.sh" text | xargs grep -nHE "$marks" /dev/null)
if [ -n "$hits" ]; then
  printf '%s\n' "$hits" | sed 's/$/    <- unfinished work/'
  bad=1
fi
folders='(^|[^A-Za-z0-9_./~$})])/(wo''rk|ho''me|ro''ot|Us''ers|m''nt)/'
servers='(de''b|arch''ive|mir''ror|po''rts)[a-z0-9.-]*\.(debian|ubuntu|raspbian)\.'
hits=$("$lint/sources.sh" text | xargs grep -nHE "$folders|$servers" /dev/null)
if [ -n "$hits" ]; then
  printf '%s\n' "$hits" | sed 's/$/    <- a folder or a server of one machine/'
  bad=1
fi
exit $bad
