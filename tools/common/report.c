// SPDX-License-Identifier: Apache-2.0
#include "tools/common/report.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/str.h"
#include "tools/common/fileio.h"

static char *room(lab_report *r, size_t n) {
  if (r->is_failed) return NULL;
  if (r->bytes + n + 1 > r->cap) {
    size_t cap = 2 * (r->bytes + n) + 1024;
    char *p = realloc(r->text, cap);
    if (!p) {
      r->is_failed = true;
      return NULL;
    }
    r->text = p;
    r->cap = cap;
  }
  return r->text + r->bytes;
}

static void add(lab_report *r, const char *fmt, ...) SV_PRINTF(2, 3);
static void add(lab_report *r, const char *fmt, ...) {
  va_list ap;
  va_start(ap, fmt);
  char *p = room(r, 256);
  if (p) {
    size_t n = sv_vfmt(p, 256, fmt, ap);
    r->bytes += n < 256 ? n : 255;
  }
  va_end(ap);
}

static void comma(lab_report *r) {
  add(r, "%s", r->is_first ? "" : ", ");
  r->is_first = false;
}
static void key(lab_report *r, const char *k) {
  comma(r);
  add(r, "\"%s\": ", k);
}
static void number(lab_report *r, double v) {
  if (isfinite(v)) add(r, "%.9g", v);
  else add(r, "null");
}

void lab_report_begin(lab_report *r) {
  memset(r, 0, sizeof *r);
  r->is_first = true;
  add(r, "{");
}
void lab_report_int(lab_report *r, const char *k, long long v) {
  key(r, k);
  add(r, "%lld", v);
}
void lab_report_num(lab_report *r, const char *k, double v) {
  key(r, k);
  number(r, v);
}
void lab_report_text(lab_report *r, const char *k, const char *v) {
  key(r, k);
  size_t n = 6 * strlen(v) + 3;
  char *p = room(r, n);
  if (!p) return;
  sv_str s = sv_str_make(p, n);
  sv_str_add(&s, "\"");
  sv_str_add_json(&s, v);
  sv_str_add(&s, "\"");
  r->bytes += s.len;
}
void lab_report_members(lab_report *r, const char *members) {
  const size_t n = strlen(members);
  comma(r);
  char *p = room(r, n);
  if (!p) return;
  memcpy(p, members, n + 1);
  r->bytes += n;
}
void lab_report_bool(lab_report *r, const char *k, bool v) {
  key(r, k);
  add(r, v ? "true" : "false");
}
void lab_report_hex(lab_report *r, const char *k, uint64_t v) {
  key(r, k);
  add(r, "\"%016llx\"", (unsigned long long)v);
}
void lab_report_nums(lab_report *r, const char *k, const float *v, int n) {
  key(r, k);
  add(r, "[");
  for (int i = 0; i < n; i++) {
    if (i) add(r, ", ");
    number(r, (double)v[i]);
  }
  add(r, "]");
}
void lab_report_array(lab_report *r, const char *k) {
  key(r, k);
  add(r, "[");
  r->is_first = true;
}
void lab_report_item_begin(lab_report *r) {
  comma(r);
  add(r, "{");
  r->is_first = true;
}
void lab_report_item_end(lab_report *r) {
  add(r, "}");
  r->is_first = false;
}
void lab_report_array_end(lab_report *r) {
  add(r, "]");
  r->is_first = false;
}
void lab_report_end(lab_report *r) { add(r, "}\n"); }

sv_status lab_report_print(lab_report *r, sv_err *err) {
  sv_status s = r->is_failed ? sv_fail(err, SV_E_NOMEM, "no memory for the text of --json") : SV_OK;
  // Whether it arrives is told at the program's end (sv_linux_end_program).
  if (s == SV_OK) fwrite(r->text, 1, r->bytes, stdout);
  lab_report_free(r);
  return s;
}

sv_status lab_report_save(lab_report *r, const char *path, sv_err *err) {
  sv_status s = r->is_failed ? sv_fail(err, SV_E_NOMEM, "%s: no memory for its text", path)
                             : sv_file_write(path, r->text, r->bytes, err);
  lab_report_free(r);
  return s;
}

void lab_report_free(lab_report *r) {
  free(r->text);
  memset(r, 0, sizeof *r);
}
