// SPDX-License-Identifier: Apache-2.0
// A strict JSON reader over a buffer: tokens in the caller's array, no heap, no recursion. Strict
// means RFC 8259, with an object or array at the top level, at most SV_JSON_CAP_DEPTH deep. jsmn
// makes the tokens; it accepts `[1 2]`, `{"a"}` and `1x2`, so the grammar is checked here first.
// Every failure names the file, the line and the key path ("scene.json:12: frames[3].fl_x: ...").
#ifndef SV_FORMAT_JSON_H
#define SV_FORMAT_JSON_H

#include <stdbool.h>
#include <stddef.h>

#include "src/base/file_data.h"
#include "src/base/status.h"

#ifndef JSMN_PARENT_LINKS
#define JSMN_PARENT_LINKS // a token knows its parent: the key path of an error needs it
#endif
#ifndef JSMN_H
#define JSMN_HEADER // types only; the code is in json.c
#include <jsmn.h>
#endif

#ifdef __cplusplus
extern "C" {
#endif

#define SV_JSON_CAP_DEPTH 32

typedef struct {
  const char *name; // of the file, for errors
  const char *text;
  size_t bytes;
  jsmntok_t *tok; // [n_tok], the caller's; token 0 is the top level
  int n_tok;
} sv_json;

// Checks the grammar and counts the tokens that sv_json_parse needs.
sv_status sv_json_count(const char *name, const char *text, size_t bytes, int *n_tok,
                        sv_err *err) SV_MUST_USE;
// The file and tok must outlive j. E_FORMAT for anything that is not JSON, E_NOMEM when cap_tok
// is too small.
sv_status sv_json_parse(sv_json *j, const sv_file_data *file, jsmntok_t *tok, int cap_tok,
                        sv_err *err) SV_MUST_USE;

// Token indices: -1 means "absent" and may be passed to any of these.
// the value of a key, -1 when absent
int sv_json_get(const sv_json *j, int i_object, const char *key);
int sv_json_first(const sv_json *j, int i_array);  // first element, -1 when empty
int sv_json_next(const sv_json *j, int i_element); // next element, -1 at the end
bool sv_json_is_object(const sv_json *j, int i);
bool sv_json_is_array(const sv_json *j, int i);
bool sv_json_is_string(const sv_json *j, int i);
bool sv_json_is_number(const sv_json *j, int i);
int sv_json_size(const sv_json *j, int i); // elements of an array, keys of an object, else 0

// Fails with `s`; the text begins with the location of token i. i may be -1 (only the file is
// named).
sv_status sv_json_fail(const sv_json *j, int i, sv_err *err, sv_status s, const char *fmt, ...)
    SV_PRINTF(5, 6);

// Typed values of token i; out does not change on failure. A number that overflows is E_RANGE.
sv_status sv_json_double(const sv_json *j, int i, double *out, sv_err *err) SV_MUST_USE;
sv_status sv_json_int(const sv_json *j, int i, long long lo, long long hi, long long *out,
                      sv_err *err) SV_MUST_USE;
sv_status sv_json_bool(const sv_json *j, int i, bool *out, sv_err *err) SV_MUST_USE;
// Escapes decoded to UTF-8, terminated. Too long for cap, or with a NUL inside: E_RANGE.
sv_status sv_json_string(const sv_json *j, int i, char *out, size_t cap, sv_err *err) SV_MUST_USE;
// An array of exactly n numbers.
sv_status sv_json_doubles(const sv_json *j, int i, double *out, int n, sv_err *err) SV_MUST_USE;

// The same by key. SV_OK with the value, SV_END when the key is absent or null (out does not
// change; a caller that requires the key then calls sv_json_missing), or a failure.
sv_status sv_json_get_double(const sv_json *j, int i_object, const char *key, double *out,
                             sv_err *err) SV_MUST_USE;
typedef struct {
  long long lo, hi; // both included
} sv_json_range;
sv_status sv_json_get_int(const sv_json *j, int i_object, const char *key, sv_json_range range,
                          long long *out, sv_err *err) SV_MUST_USE;
sv_status sv_json_get_string(const sv_json *j, int i_object, const char *key, char *out, size_t cap,
                             sv_err *err) SV_MUST_USE;
sv_status sv_json_missing(const sv_json *j, int i_object, const char *key, sv_err *err) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
