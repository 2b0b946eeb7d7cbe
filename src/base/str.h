// SPDX-License-Identifier: Apache-2.0
// Fixed-capacity text: a small printf without stdio, locale or heap, and a growing line over a
// buffer.
#ifndef SV_BASE_STR_H
#define SV_BASE_STR_H

#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>

#include "src/base/status.h"

#ifdef __cplusplus
extern "C" {
#endif

// Formats into buf[cap], always terminated when cap > 0. Knows %% %c %s %.*s %d %i %u %x with l, ll
// and z, the flags 0 and -, and a width; %f with a precision (6 by default); not %e. %g prints up
// to 9 significant digits (17 with %.17g), enough for a float (double) to come back unchanged.
// NaN and infinities print as nan, inf, -inf. Returns the length the whole text would have had.
size_t sv_vfmt(char *buf, size_t cap, const char *fmt, va_list ap);
size_t sv_fmt(char *buf, size_t cap, const char *fmt, ...) SV_PRINTF(3, 4);

// A line that grows in a caller's buffer. When the buffer is full, further text is cut and is_cut
// is set.
typedef struct {
  char *buf;
  size_t cap, len;
  bool is_cut;
} sv_str;

sv_str sv_str_make(char *buf, size_t cap);
void sv_str_add(sv_str *s, const char *fmt, ...) SV_PRINTF(2, 3);
// Adds text as the inside of a JSON string: quotes, backslashes and control bytes are escaped; each
// byte that is not valid UTF-8 becomes U+FFFD. Takes at most six bytes for each byte of text.
void sv_str_add_json(sv_str *s, const char *text);
bool sv_is_utf8(const char *text);
// Replaces each byte that is not valid UTF-8 by '_': for file names that also appear in JSON.
void sv_make_utf8(char *text);

// Copies text into dst[cap], terminated; returns false when the text had to be cut.
bool sv_copy(char *dst, size_t cap, const char *src);
bool sv_str_eq(const char *a, const char *b);

// The name that a misspelt word may have meant: of those that were tried, the one with the fewest
// wrong letters, and not more than two of them (one in words of up to four letters).
typedef struct {
  const char *word;
  size_t n;
  const char *name; // NULL: none is near
  size_t n_wrong;   // letters of it
} sv_near_name;
sv_near_name sv_near_make(const char *word, size_t n);
void sv_near_try(sv_near_name *near, const char *name);

// Parses a whole decimal number from text[0..len). False when text remains or the number is not
// finite.
bool sv_parse_double(const char *text, size_t len, double *out);
bool sv_parse_int(const char *text, size_t len, long long *out);

#ifdef __cplusplus
}
#endif
#endif
