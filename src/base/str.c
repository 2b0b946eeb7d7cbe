// SPDX-License-Identifier: Apache-2.0
#include "src/base/str.h"

#include <float.h>
#include <math.h>
#include <stdint.h>
#include <string.h>

typedef struct {
  char *buf;
  size_t cap, len; // len counts also what did not fit
} out_t;

static void put(out_t *o, char c) {
  if (o->len + 1 < o->cap) o->buf[o->len] = c;
  o->len++;
}

static void put_padded(out_t *o, const char *s, size_t n, int width, bool is_left, char pad) {
  size_t w = width > 0 ? (size_t)width : 0;
  if (pad == '0' && n && (s[0] == '-') && w > n) { // the sign goes before the zeros
    put(o, '-');
    s++;
    n--;
    w--;
  }
  if (!is_left)
    for (size_t i = n; i < w; i++) put(o, pad);
  for (size_t i = 0; i < n; i++) put(o, s[i]);
  if (is_left)
    for (size_t i = n; i < w; i++) put(o, ' ');
}

// Writes the digits of v backwards from end; returns the first.
static char *digits(char *end, uint64_t v, unsigned base) {
  do *--end = "0123456789abcdef"[v % base];
  while (v /= base);
  return end;
}

static size_t special(char *t, double x) {
  const char *s = x != x ? "nan" : x > 0 ? "inf" : "-inf";
  size_t n = strlen(s);
  memcpy(t, s, n);
  return n;
}

// Powers of ten are exact in double up to 10^22.
static double pow10i(int e) {
  double p = 1;
  for (; e > 22; e -= 22) p *= 1e22;
  for (; e > 0; e--) p *= 10;
  return p;
}

static size_t fixed(char *t, double x, int prec) { // |x| < 1e18, prec <= 12
  bool neg = x < 0;
  double scale = pow10i(prec), a = neg ? -x : x, ip = floor(a), fr = floor((a - ip) * scale + 0.5);
  if (fr >= scale) {
    ip += 1;
    fr = 0;
  }
  char tmp[48], *end = tmp + sizeof tmp, *p = end;
  if (prec > 0) {
    p = digits(p, (uint64_t)fr, 10);
    while (end - p < prec) *--p = '0';
    *--p = '.';
  }
  p = digits(p, (uint64_t)ip, 10);
  if (neg && (ip > 0 || fr > 0)) *--p = '-';
  memcpy(t, p, (size_t)(end - p));
  return (size_t)(end - p);
}

// Shortest of 1..max_digits significant digits that reads back as the same number (float for 9).
static size_t general(char *t, double x, int max_digits) {
  if (x == 0) return t[0] = '0', 1;
  bool neg = x < 0;
  double a = neg ? -x : x;
  int e0 = 0;
  for (double b = a; b >= 10; b /= 10) e0++;
  for (double b = a; b < 1; b *= 10) e0--;
  for (int nd = 1;; nd++) {
    int e = e0;         // 0.998 is 1 with one digit, but not with three
    int s = nd - 1 - e; // a * 10^s has nd digits before the point
    double m = s >= 0 ? (s > 300 ? a * pow10i(300) * pow10i(s - 300) : a * pow10i(s)) : a / pow10i(-s);
    double r = floor(m + 0.5);
    if (r < pow10i(nd - 1)) { // the search for e0 rounded up to a power of ten: try one lower
      e0--;
      nd--;
      continue;
    }
    if (r >= pow10i(nd)) {
      r = pow10i(nd - 1);
      e++;
      s--;
    }
    double back = s >= 0 ? (s > 300 ? r / pow10i(300) / pow10i(s - 300) : r / pow10i(s)) : r * pow10i(-s);
    if (nd < max_digits && (max_digits <= 9 ? (float)back != (float)a : back != a)) continue;
    char d[24], *end = d + sizeof d, *p = digits(end, (uint64_t)r, 10);
    size_t n = (size_t)(end - p), len = 0;
    while (n > 1 && p[n - 1] == '0') n--;
    if (neg) t[len++] = '-';
    if (e >= -5 && e < max_digits) {
      if (e < 0) {
        t[len++] = '0';
        t[len++] = '.';
        for (int i = -1; i > e; i--) t[len++] = '0';
      }
      for (size_t i = 0; i < n; i++) {
        if (e >= 0 && i == (size_t)e + 1) t[len++] = '.';
        t[len++] = p[i];
      }
      for (int i = (int)n; i <= e; i++) t[len++] = '0';
      return len;
    }
    t[len++] = p[0];
    if (n > 1) t[len++] = '.';
    for (size_t i = 1; i < n; i++) t[len++] = p[i];
    t[len++] = 'e';
    if (e < 0) t[len++] = '-';
    char eb[8], *ep = digits(eb + sizeof eb, (uint64_t)(e < 0 ? -e : e), 10);
    memcpy(t + len, ep, (size_t)(eb + sizeof eb - ep));
    return len + (size_t)(eb + sizeof eb - ep);
  }
}

typedef struct {
  bool is_left;
  char pad;
  int width, prec, n_long; // n_long: 0 int, 1 long, 2 long long, 3 size_t
} spec_t;

static const char *read_spec(const char *f, spec_t *s, va_list *ap) {
  *s = (spec_t){.pad = ' ', .prec = -1};
  for (;; f++) {
    if (*f == '-') s->is_left = true;
    else if (*f == '0') s->pad = '0';
    else break;
  }
  if (*f == '*') {
    s->width = va_arg(*ap, int);
    f++;
  } else
    for (; *f >= '0' && *f <= '9'; f++) s->width = s->width * 10 + (*f - '0');
  if (*f == '.') {
    f++;
    s->prec = 0;
    if (*f == '*') {
      s->prec = va_arg(*ap, int);
      f++;
    } else
      for (; *f >= '0' && *f <= '9'; f++) s->prec = s->prec * 10 + (*f - '0');
  }
  for (; *f == 'l'; f++) s->n_long++;
  if (*f == 'z') {
    s->n_long = 3;
    f++;
  }
  return f;
}

static void put_number(out_t *o, char conv, const spec_t *s, va_list *ap) {
  char tmp[64], *end = tmp + sizeof tmp, *p;
  if (conv == 'd' || conv == 'i') {
    int64_t v = s->n_long == 0   ? va_arg(*ap, int)
                : s->n_long == 1 ? va_arg(*ap, long)
                : s->n_long == 2 ? va_arg(*ap, long long)
                                 : (int64_t)va_arg(*ap, size_t);
    p = digits(end, v < 0 ? -(uint64_t)v : (uint64_t)v, 10);
    if (v < 0) *--p = '-';
  } else {
    uint64_t v = s->n_long == 0   ? va_arg(*ap, unsigned)
                 : s->n_long == 1 ? va_arg(*ap, unsigned long)
                 : s->n_long == 2 ? va_arg(*ap, unsigned long long)
                                  : va_arg(*ap, size_t);
    p = digits(end, v, conv == 'x' ? 16 : 10);
  }
  put_padded(o, p, (size_t)(end - p), s->width, s->is_left, s->pad);
}

static void put_real(out_t *o, char conv, const spec_t *s, double x) {
  char tmp[400];
  size_t n;
  if (x != x || x > DBL_MAX || x < -DBL_MAX) n = special(tmp, x);
  else if (conv == 'f' && x < 1e18 && x > -1e18)
    n = fixed(tmp, x, s->prec < 0 ? 6 : s->prec > 12 ? 12 : s->prec);
  else n = general(tmp, x, s->prec > 9 ? 17 : 9);
  put_padded(o, tmp, n, s->width, s->is_left, s->pad);
}

size_t sv_vfmt(char *buf, size_t cap, const char *fmt, va_list ap_in) {
  out_t o = {buf, cap, 0};
  va_list ap;
  va_copy(ap, ap_in);
  for (const char *f = fmt; *f; f++) {
    if (*f != '%') {
      put(&o, *f);
      continue;
    }
    spec_t s;
    f = read_spec(f + 1, &s, &ap);
    if (*f == 'd' || *f == 'i' || *f == 'u' || *f == 'x') put_number(&o, *f, &s, &ap);
    else if (*f == 'f' || *f == 'g') put_real(&o, *f, &s, va_arg(ap, double));
    else if (*f == 'c') put(&o, (char)va_arg(ap, int));
    else if (*f == 's') {
      const char *t = va_arg(ap, const char *);
      size_t n = 0;
      if (!t) t = "(null)";
      while ((s.prec < 0 || n < (size_t)s.prec) && t[n]) n++;
      put_padded(&o, t, n, s.width, s.is_left, ' ');
    } else if (*f == '%') put(&o, '%');
    else break; // an unknown conversion ends the text instead of reading a wrong argument
  }
  va_end(ap);
  if (cap) buf[o.len < cap ? o.len : cap - 1] = 0;
  return o.len;
}

size_t sv_fmt(char *buf, size_t cap, const char *fmt, ...) {
  va_list ap;
  va_start(ap, fmt);
  size_t n = sv_vfmt(buf, cap, fmt, ap);
  va_end(ap);
  return n;
}

sv_str sv_str_make(char *buf, size_t cap) {
  if (cap) buf[0] = 0;
  return (sv_str){buf, cap, 0, false};
}

void sv_str_add(sv_str *s, const char *fmt, ...) {
  va_list ap;
  va_start(ap, fmt);
  size_t room = s->cap - s->len, n = sv_vfmt(s->buf + s->len, room, fmt, ap);
  va_end(ap);
  if (n >= room) {
    s->is_cut = true;
    s->len = s->cap ? s->cap - 1 : 0;
  } else s->len += n;
}

// Bytes of the UTF-8 character at t (RFC 3629: shortest form, no surrogates); 0: there is none.
static int utf8_bytes(const char *text) {
  const unsigned char *t = (const unsigned char *)text;
  int n = t[0] < 0x80 ? 1 : t[0] >= 0xc2 && t[0] < 0xe0 ? 2 : (t[0] & 0xf0) == 0xe0 ? 3 : t[0] < 0xf5 ? 4 : 0;
  if (t[0] >= 0x80 && t[0] < 0xc2) return 0;
  for (int i = 1; i < n; i++)
    if ((t[i] & 0xc0) != 0x80) return 0; // also at the text's end
  bool is_long = (t[0] == 0xe0 && t[1] < 0xa0) || (t[0] == 0xf0 && t[1] < 0x90);
  bool is_outside = (t[0] == 0xed && t[1] >= 0xa0) || (t[0] == 0xf4 && t[1] >= 0x90);
  return is_long || is_outside ? 0 : n;
}

void sv_str_add_json(sv_str *s, const char *text) {
  for (int n; *text; text += n ? n : 1) {
    unsigned char c = (unsigned char)*text;
    n = utf8_bytes(text);
    if (c == '"' || c == '\\') sv_str_add(s, "\\%c", c);
    else if (c < 0x20) sv_str_add(s, "\\u%04x", c);
    else if (n) sv_str_add(s, "%.*s", n, text);
    else sv_str_add(s, "\xef\xbf\xbd"); // U+FFFD, the replacement character
  }
}

bool sv_is_utf8(const char *text) {
  for (int n; *text; text += n)
    if (!(n = utf8_bytes(text))) return false;
  return true;
}

void sv_make_utf8(char *text) {
  for (int n; *text; text += n ? n : 1)
    if (!(n = utf8_bytes(text))) *text = '_';
}

bool sv_copy(char *dst, size_t cap, const char *src) {
  size_t n = strlen(src);
  if (!cap) return false;
  size_t m = n < cap ? n : cap - 1;
  memcpy(dst, src, m);
  dst[m] = 0;
  return m == n;
}

bool sv_str_eq(const char *a, const char *b) { return strcmp(a, b) == 0; }

#define CAP_NEAR 32 // letters of a word that is compared

// Letters to insert, remove, replace or swap with their neighbour (optimal string alignment).
static size_t wrong_letters(const char *a, size_t na, const char *b, size_t nb) {
  size_t row[3][CAP_NEAR + 1];
  for (size_t j = 0; j <= nb; j++) row[0][j] = j;
  for (size_t i = 1; i <= na; i++) {
    size_t *now = row[i % 3], *last = row[(i + 2) % 3], *before = row[(i + 1) % 3];
    now[0] = i;
    for (size_t j = 1; j <= nb; j++) {
      size_t n = last[j - 1] + (a[i - 1] != b[j - 1]);
      if (last[j] + 1 < n) n = last[j] + 1;
      if (now[j - 1] + 1 < n) n = now[j - 1] + 1;
      const bool is_swapped = i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1];
      if (is_swapped && before[j - 2] + 1 < n) n = before[j - 2] + 1;
      now[j] = n;
    }
  }
  return row[na % 3][nb];
}

sv_near_name sv_near_make(const char *word, size_t n) {
  return (sv_near_name){.word = word, .n = n, .n_wrong = n > 4 ? 3 : 2};
}

void sv_near_try(sv_near_name *near, const char *name) {
  const size_t n = strlen(name);
  if (!near->n || near->n > CAP_NEAR || n > CAP_NEAR) return;
  const size_t n_wrong = wrong_letters(near->word, near->n, name, n);
  if (n_wrong >= near->n_wrong) return;
  near->name = name;
  near->n_wrong = n_wrong;
}

bool sv_parse_double(const char *t, size_t len, double *out) {
  size_t i = 0;
  bool neg = false, any = false, neg_e = false;
  if (i < len && (t[i] == '-' || t[i] == '+')) neg = t[i++] == '-';
  double m = 0;
  int e10 = 0, e = 0, n_digits = 0;
  for (; i < len && t[i] >= '0' && t[i] <= '9'; i++, any = true) {
    if (n_digits < 18) {
      m = m * 10 + (t[i] - '0');
      n_digits += m > 0;
    } else e10++;
  }
  if (i < len && t[i] == '.')
    for (i++; i < len && t[i] >= '0' && t[i] <= '9'; i++, any = true)
      if (n_digits < 18) {
        m = m * 10 + (t[i] - '0');
        n_digits += m > 0;
        e10--;
      }
  if (!any) return false;
  if (i < len && (t[i] == 'e' || t[i] == 'E')) {
    i++;
    if (i < len && (t[i] == '-' || t[i] == '+')) neg_e = t[i++] == '-';
    if (i == len) return false;
    for (; i < len && t[i] >= '0' && t[i] <= '9'; i++)
      if (e < 10000) e = e * 10 + (t[i] - '0');
  }
  if (i != len) return false;
  e10 += neg_e ? -e : e;
  if (m != 0) {
    if (e10 > 330) return false;
    if (e10 < -340) m = 0;
    else if (e10 >= 0) m *= pow10i(e10);
    else if (e10 < -300) m = m / pow10i(300) / pow10i(-e10 - 300);
    else m /= pow10i(-e10);
  }
  if (m > DBL_MAX) return false;
  *out = neg ? -m : m;
  return true;
}

bool sv_parse_int(const char *t, size_t len, long long *out) {
  size_t i = 0;
  bool neg = false;
  if (i < len && (t[i] == '-' || t[i] == '+')) neg = t[i++] == '-';
  if (i == len || len - i > 18) return false;
  long long v = 0;
  for (; i < len; i++) {
    if (t[i] < '0' || t[i] > '9') return false;
    v = v * 10 + (t[i] - '0');
  }
  *out = neg ? -v : v;
  return true;
}
