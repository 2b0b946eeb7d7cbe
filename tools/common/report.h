// SPDX-License-Identifier: Apache-2.0
// One JSON object, written key by key into a growing text.
#ifndef SV_TOOLS_COMMON_REPORT_H
#define SV_TOOLS_COMMON_REPORT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "src/base/status.h"

typedef struct {
  char *text; // terminated
  size_t bytes, cap;
  bool is_first, is_failed; // failed: no memory
} lab_report;

// begin opens the object, end closes it. Keys are plain words.
void lab_report_begin(lab_report *r);
void lab_report_int(lab_report *r, const char *key, long long v);
void lab_report_num(lab_report *r, const char *key, double v); // 9 digits; null when not finite
void lab_report_text(lab_report *r, const char *key, const char *v);
void lab_report_bool(lab_report *r, const char *key, bool v);
void lab_report_hex(lab_report *r, const char *key, uint64_t v); // a string of 16 digits
// "\"key\": value, ..." that is JSON already.
void lab_report_members(lab_report *r, const char *members);
void lab_report_nums(lab_report *r, const char *key, const float *v, int n);
// An array of objects: open, then item_begin ... item_end for each, close.
void lab_report_array(lab_report *r, const char *key);
void lab_report_item_begin(lab_report *r);
void lab_report_item_end(lab_report *r);
void lab_report_array_end(lab_report *r);
void lab_report_end(lab_report *r);

// Prints it with a newline on stdout, or saves it. Both free it.
sv_status lab_report_print(lab_report *r, sv_err *err) SV_MUST_USE;
sv_status lab_report_save(lab_report *r, const char *path, sv_err *err) SV_MUST_USE;
void lab_report_free(lab_report *r);

#endif
