// SPDX-License-Identifier: Apache-2.0
#define JSMN_STRICT
#define JSMN_STATIC
#define JSMN_PARENT_LINKS
#include <jsmn.h>

#include "src/format/json.h"

#include <limits.h>
#include <stdint.h>
#include <string.h>

#include "src/base/str.h"

// --- grammar -------------------------------------------------------------------------------------
typedef struct {
  const unsigned char *t;
  size_t n, i;
  int n_tok;
  const char *what; // the first fault
} scan;

static bool wrong(scan *s, const char *what) {
  s->what = what;
  return false;
}

static void skip_space(scan *s) {
  while (s->i < s->n && (s->t[s->i] == ' ' || s->t[s->i] == '\t' || s->t[s->i] == '\n' || s->t[s->i] == '\r'))
    s->i++;
}

static int hex4(const unsigned char *t, size_t n) { // -1 when not four hex digits
  int v = 0;
  if (n < 4) return -1;
  for (int k = 0; k < 4; k++) {
    int c = t[k], d = c >= '0' && c <= '9'                 ? c - '0'
                      : (c | 32) >= 'a' && (c | 32) <= 'f' ? (c | 32) - 'a' + 10
                                                           : -1;
    if (d < 0) return -1;
    v = v * 16 + d;
  }
  return v;
}

static bool scan_string(scan *s) { // at the opening quote
  for (s->i++; s->i < s->n; s->i++) {
    unsigned char c = s->t[s->i];
    if (c == '"') {
      s->i++;
      s->n_tok++;
      return true;
    }
    if (c < 0x20) return wrong(s, "a control byte inside a string");
    if (c != '\\') continue;
    if (++s->i == s->n) break;
    c = s->t[s->i];
    if (c == 'u') {
      if (hex4(s->t + s->i + 1, s->n - s->i - 1) < 0) return wrong(s, "\\u without four hex digits");
      s->i += 4;
    } else if (!c || !strchr("\"\\/bfnrt", c)) return wrong(s, "an unknown escape in a string");
  }
  return wrong(s, "a string without an end");
}

static size_t scan_digits(scan *s) {
  size_t from = s->i;
  while (s->i < s->n && s->t[s->i] >= '0' && s->t[s->i] <= '9') s->i++;
  return s->i - from;
}

static bool scan_number(scan *s) {
  if (s->t[s->i] == '-') s->i++;
  bool is_zero = s->i < s->n && s->t[s->i] == '0';
  size_t n = scan_digits(s);
  if (n == 0 || (is_zero && n > 1)) return wrong(s, "a malformed number");
  if (s->i < s->n && s->t[s->i] == '.') {
    s->i++;
    if (!scan_digits(s)) return wrong(s, "a malformed number");
  }
  if (s->i < s->n && (s->t[s->i] | 32) == 'e') {
    s->i++;
    if (s->i < s->n && (s->t[s->i] == '+' || s->t[s->i] == '-')) s->i++;
    if (!scan_digits(s)) return wrong(s, "a malformed number");
  }
  s->n_tok++;
  return true;
}

static bool scan_scalar(scan *s) {
  static const char *const words[3] = {"true", "false", "null"};
  unsigned char c = s->t[s->i];
  if (c == '"') return scan_string(s);
  if (c == '-' || (c >= '0' && c <= '9')) return scan_number(s);
  for (int k = 0; k < 3; k++) {
    size_t n = strlen(words[k]);
    if (s->n - s->i >= n && memcmp(s->t + s->i, words[k], n) == 0) {
      s->i += n;
      s->n_tok++;
      return true;
    }
  }
  return wrong(s, "a value was expected");
}

static bool scan_key(scan *s) {
  if (s->i >= s->n || s->t[s->i] != '"') return wrong(s, "a key in quotes was expected");
  if (!scan_string(s)) return false;
  skip_space(s);
  if (s->i >= s->n || s->t[s->i] != ':') return wrong(s, "':' was expected after a key");
  s->i++;
  skip_space(s);
  return true;
}

// One bracket a level: '{' or '['. A value is expected at the top of the loop.
static bool scan_text(scan *s) {
  char stack[SV_JSON_CAP_DEPTH];
  int depth = 0;
  skip_space(s);
  if (s->i >= s->n || (s->t[s->i] != '{' && s->t[s->i] != '['))
    return wrong(s, "an object or array was expected");
  do {
    if (s->i >= s->n) return wrong(s, "the text ends too early");
    char c = (char)s->t[s->i];
    if (c == '{' || c == '[') {
      if (depth == SV_JSON_CAP_DEPTH) return wrong(s, "nested too deeply");
      stack[depth++] = c;
      s->i++;
      s->n_tok++;
      skip_space(s);
      if (s->i >= s->n || s->t[s->i] != (c == '{' ? '}' : ']')) {
        if (c == '{' && !scan_key(s)) return false;
        continue; // its first value
      }
    } else if (!scan_scalar(s)) return false;
    for (;;) { // after a value: closing brackets, then a comma and the next value
      skip_space(s);
      if (!depth) break;
      if (s->i >= s->n) return wrong(s, "the text ends too early");
      c = (char)s->t[s->i];
      if (c == (stack[depth - 1] == '{' ? '}' : ']')) {
        depth--;
        s->i++;
        continue;
      }
      if (c != ',') return wrong(s, "',' or a closing bracket was expected");
      s->i++;
      skip_space(s);
      if (stack[depth - 1] == '{' && !scan_key(s)) return false;
      break;
    }
  } while (depth);
  return s->i == s->n || wrong(s, "text after the end");
}

static int line_of(const char *text, size_t at) {
  int line = 1;
  for (size_t i = 0; i < at; i++) line += text[i] == '\n';
  return line;
}

sv_status sv_json_count(const char *name, const char *text, size_t bytes, int *n_tok, sv_err *err) {
  scan s = {(const unsigned char *)text, bytes, 0, 0, NULL};
  if (bytes > INT_MAX / 2) return sv_fail(err, SV_E_RANGE, "%s: larger than 1 GiB", name);
  if (!scan_text(&s))
    return sv_fail(err, SV_E_FORMAT, "%s:%d: not JSON: %s", name, line_of(text, s.i), s.what);
  *n_tok = s.n_tok;
  return SV_OK;
}

sv_status sv_json_parse(sv_json *j, const sv_file_data *file, jsmntok_t *tok, int cap_tok, sv_err *err) {
  const char *name = file->name, *text = file->data;
  const size_t bytes = file->bytes;
  int n = 0;
  *j = (sv_json){name, text, bytes, tok, 0};
  sv_status s = sv_json_count(name, text, bytes, &n, err);
  if (s != SV_OK) return s;
  if (n > cap_tok)
    return sv_fail(err, SV_E_NOMEM, "%s: has %d JSON tokens, there is room for %d", name, n, cap_tok);
  jsmn_parser p;
  jsmn_init(&p);
  if (jsmn_parse(&p, text, bytes, tok, (unsigned)cap_tok) != n)
    return sv_fail(err, SV_E_FORMAT, "%s:%d: not JSON", name, line_of(text, p.pos));
  j->n_tok = n;
  return SV_OK;
}

// --- walking -------------------------------------------------------------------------------------
static bool is_type(const sv_json *j, int i, jsmntype_t type) {
  return i >= 0 && i < j->n_tok && j->tok[i].type == type;
}
static char first_char(const sv_json *j, int i) { return j->text[j->tok[i].start]; }

bool sv_json_is_object(const sv_json *j, int i) { return is_type(j, i, JSMN_OBJECT); }
bool sv_json_is_array(const sv_json *j, int i) { return is_type(j, i, JSMN_ARRAY); }
bool sv_json_is_string(const sv_json *j, int i) { return is_type(j, i, JSMN_STRING); }
bool sv_json_is_number(const sv_json *j, int i) {
  return is_type(j, i, JSMN_PRIMITIVE) &&
         (first_char(j, i) == '-' || (first_char(j, i) >= '0' && first_char(j, i) <= '9'));
}
static bool is_null(const sv_json *j, int i) {
  return is_type(j, i, JSMN_PRIMITIVE) && first_char(j, i) == 'n';
}
int sv_json_size(const sv_json *j, int i) {
  return sv_json_is_array(j, i) || sv_json_is_object(j, i) ? j->tok[i].size : 0;
}

static int after(const sv_json *j, int i) { // the token after i and everything inside it
  int end = j->tok[i].end, k = i + 1;
  while (k < j->n_tok && j->tok[k].start < end) k++;
  return k;
}

int sv_json_first(const sv_json *j, int i) {
  return sv_json_is_array(j, i) && j->tok[i].size > 0 ? i + 1 : -1;
}

int sv_json_next(const sv_json *j, int i) {
  if (i < 0 || i >= j->n_tok) return -1;
  int k = after(j, i);
  return k < j->n_tok && j->tok[k].parent == j->tok[i].parent ? k : -1;
}

int sv_json_get(const sv_json *j, int i_object, const char *key) {
  if (!sv_json_is_object(j, i_object)) return -1;
  size_t n = strlen(key);
  for (int k = i_object + 1; k < j->n_tok && j->tok[k].parent == i_object; k = after(j, k + 1))
    if ((size_t)(j->tok[k].end - j->tok[k].start) == n && memcmp(j->text + j->tok[k].start, key, n) == 0)
      return k + 1;
  return -1;
}

// --- errors --------------------------------------------------------------------------------------
// The key path of token i, written backwards from the end of buf; returns its start.
static char *key_path(const sv_json *j, int i, char *buf, size_t cap) {
  char *p = buf + cap - 1;
  *p = 0;
  for (int depth = 0; i > 0 && depth < 2 * SV_JSON_CAP_DEPTH + 2; depth++) {
    int up = j->tok[i].parent;
    char part[48];
    if (sv_json_is_array(j, up)) {
      int nth = 0;
      for (int k = up + 1; k < i; k = after(j, k)) nth++;
      sv_fmt(part, sizeof part, "[%d]", nth);
    } else if (sv_json_is_string(j, up)) { // its key
      int n = j->tok[up].end - j->tok[up].start;
      bool is_top = j->tok[up].parent == 0 && sv_json_is_object(j, 0);
      sv_fmt(part, sizeof part, "%s%.*s", is_top ? "" : ".", n, j->text + j->tok[up].start);
      up = j->tok[up].parent;
    } else part[0] = 0;
    size_t n = strlen(part);
    if ((size_t)(p - buf) < n) break;
    p -= n;
    memcpy(p, part, n);
    i = up;
  }
  for (char *c = p; *c; c++)
    if ((unsigned char)*c < 0x20) *c = '?'; // keys come from outside
  return p;
}

sv_status sv_json_fail(const sv_json *j, int i, sv_err *err, sv_status s, const char *fmt, ...) {
  char text[160], path[80];
  va_list ap;
  va_start(ap, fmt);
  sv_vfmt(text, sizeof text, fmt, ap);
  va_end(ap);
  if (i < 0 || i >= j->n_tok) return sv_fail(err, s, "%s: %s", j->name, text);
  const char *p = key_path(j, i, path, sizeof path);
  return sv_fail(err, s, "%s:%d: %s%s%s", j->name, line_of(j->text, (size_t)j->tok[i].start), p,
                 *p ? ": " : "", text);
}

sv_status sv_json_missing(const sv_json *j, int i_object, const char *key, sv_err *err) {
  return sv_json_fail(j, i_object, err, SV_E_NOT_FOUND, "\"%s\" is missing", key);
}

static const char *kind_of(const sv_json *j, int i) {
  if (i < 0 || i >= j->n_tok) return "nothing";
  if (sv_json_is_object(j, i)) return "an object";
  if (sv_json_is_array(j, i)) return "an array";
  if (sv_json_is_string(j, i)) return "a string";
  return sv_json_is_number(j, i) ? "a number" : is_null(j, i) ? "null" : "true or false";
}

// --- values --------------------------------------------------------------------------------------
sv_status sv_json_double(const sv_json *j, int i, double *out, sv_err *err) {
  if (!sv_json_is_number(j, i))
    return sv_json_fail(j, i, err, SV_E_FORMAT, "a number was expected, found %s", kind_of(j, i));
  if (!sv_parse_double(j->text + j->tok[i].start, (size_t)(j->tok[i].end - j->tok[i].start), out))
    return sv_json_fail(j, i, err, SV_E_RANGE, "the number is too large");
  return SV_OK;
}

// 540.0 counts as a whole number: writers that keep everything in floats are common.
sv_status sv_json_int(const sv_json *j, int i, long long lo, long long hi, long long *out, sv_err *err) {
  double d;
  long long v;
  sv_status s = sv_json_double(j, i, &d, err);
  if (s != SV_OK) return s;
  if (!sv_parse_int(j->text + j->tok[i].start, (size_t)(j->tok[i].end - j->tok[i].start), &v)) {
    if (!(d >= -9e15 && d <= 9e15) || d != (double)(long long)d)
      return sv_json_fail(j, i, err, SV_E_RANGE, "a whole number from %lld to %lld was expected", lo, hi);
    v = (long long)d;
  }
  if (v < lo || v > hi) return sv_json_fail(j, i, err, SV_E_RANGE, "%lld is outside %lld to %lld", v, lo, hi);
  *out = v;
  return SV_OK;
}

sv_status sv_json_bool(const sv_json *j, int i, bool *out, sv_err *err) {
  if (!is_type(j, i, JSMN_PRIMITIVE) || sv_json_is_number(j, i) || is_null(j, i))
    return sv_json_fail(j, i, err, SV_E_FORMAT, "true or false was expected, found %s", kind_of(j, i));
  *out = first_char(j, i) == 't';
  return SV_OK;
}

static size_t put_utf8(char *o, uint32_t c) {
  if (c < 0x80) return o[0] = (char)c, 1;
  if (c < 0x800) return o[0] = (char)(0xC0 | c >> 6), o[1] = (char)(0x80 | (c & 63)), 2;
  if (c < 0x10000)
    return o[0] = (char)(0xE0 | c >> 12), o[1] = (char)(0x80 | (c >> 6 & 63)), o[2] = (char)(0x80 | (c & 63)),
           3;
  o[0] = (char)(0xF0 | c >> 18);
  o[1] = (char)(0x80 | (c >> 12 & 63));
  o[2] = (char)(0x80 | (c >> 6 & 63));
  o[3] = (char)(0x80 | (c & 63));
  return 4;
}

// One character of a checked string at t[*k]; 0 for a NUL or half of a surrogate pair.
static uint32_t next_char(const unsigned char *t, size_t n, size_t *k) {
  static const char from[] = "bfnrt", to[] = "\b\f\n\r\t";
  if (t[*k] != '\\') return t[(*k)++]; // a byte of UTF-8 is passed on as it is
  unsigned char e = t[*k + 1];
  *k += 2;
  if (e != 'u') {
    const char *p = strchr(from, e);
    return p ? (unsigned char)to[p - from] : e;
  }
  uint32_t c = (uint32_t)hex4(t + *k, n - *k);
  *k += 4;
  if (c < 0xD800 || c > 0xDFFF) return c;
  if (c > 0xDBFF || n - *k < 6 || t[*k] != '\\' || t[*k + 1] != 'u') return 0;
  int low = hex4(t + *k + 2, n - *k - 2);
  if (low < 0xDC00 || low > 0xDFFF) return 0;
  *k += 6;
  return 0x10000 + ((c - 0xD800) << 10) + ((uint32_t)low - 0xDC00);
}

sv_status sv_json_string(const sv_json *j, int i, char *out, size_t cap, sv_err *err) {
  if (!sv_json_is_string(j, i))
    return sv_json_fail(j, i, err, SV_E_FORMAT, "a string was expected, found %s", kind_of(j, i));
  const unsigned char *t = (const unsigned char *)j->text + j->tok[i].start;
  size_t n = (size_t)(j->tok[i].end - j->tok[i].start), len = 0;
  // the first pass only measures, so that out does not change on failure
  for (int pass = 0; pass < 2; pass++) {
    len = 0;
    for (size_t k = 0; k < n;) {
      bool is_raw = t[k] != '\\';
      uint32_t c = next_char(t, n, &k);
      char u[4];
      size_t m = is_raw ? 1 : put_utf8(u, c);
      if (is_raw) u[0] = (char)c;
      if (!c)
        return sv_json_fail(j, i, err, SV_E_RANGE, "the string holds a NUL or half of a surrogate pair");
      if (len + m >= cap)
        return sv_json_fail(j, i, err, SV_E_RANGE, "the string is longer than %zu bytes", cap - 1);
      if (pass) memcpy(out + len, u, m);
      len += m;
    }
  }
  out[len] = 0;
  return SV_OK;
}

sv_status sv_json_doubles(const sv_json *j, int i, double *out, int n, sv_err *err) {
  if (!sv_json_is_array(j, i) || j->tok[i].size != n)
    return sv_json_fail(j, i, err, SV_E_FORMAT, "an array of %d numbers was expected, found %s of %d", n,
                        kind_of(j, i), sv_json_size(j, i));
  int k = sv_json_first(j, i);
  for (int m = 0; m < n; m++, k = sv_json_next(j, k)) {
    sv_status s = sv_json_double(j, k, &out[m], err);
    if (s != SV_OK) return s;
  }
  return SV_OK;
}

sv_status sv_json_get_double(const sv_json *j, int i_object, const char *key, double *out, sv_err *err) {
  int i = sv_json_get(j, i_object, key);
  return i < 0 || is_null(j, i) ? SV_END : sv_json_double(j, i, out, err);
}

sv_status sv_json_get_int(const sv_json *j, int i_object, const char *key, sv_json_range range,
                          long long *out, sv_err *err) {
  int i = sv_json_get(j, i_object, key);
  return i < 0 || is_null(j, i) ? SV_END : sv_json_int(j, i, range.lo, range.hi, out, err);
}

sv_status sv_json_get_string(const sv_json *j, int i_object, const char *key, char *out, size_t cap,
                             sv_err *err) {
  int i = sv_json_get(j, i_object, key);
  return i < 0 || is_null(j, i) ? SV_END : sv_json_string(j, i, out, cap, err);
}
