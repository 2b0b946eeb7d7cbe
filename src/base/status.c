// SPDX-License-Identifier: Apache-2.0
#include "src/base/status.h"

#include <stdarg.h>

#include "src/base/str.h"

const char *sv_status_name(sv_status s) {
  switch (s) {
#define X(name, code, sentence)                                                                              \
  case code:                                                                                                 \
    return #name;
#include "src/base/status.inc"
#undef X
  default: return "?";
  }
}

const char *sv_status_text(sv_status s) {
  switch (s) {
#define X(name, code, sentence)                                                                              \
  case code:                                                                                                 \
    return sentence;
#include "src/base/status.inc"
#undef X
  default: return "?";
  }
}

sv_status sv_fail(sv_err *e, sv_status s, const char *fmt, ...) {
  if (e) {
    va_list ap;
    va_start(ap, fmt);
    sv_vfmt(e->text, sizeof e->text, fmt, ap);
    va_end(ap);
    e->status = s;
  }
  return s;
}
