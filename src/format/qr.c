// SPDX-License-Identifier: Apache-2.0
// Tables and sections are those of ISO/IEC 18004:2015.
#include "src/format/qr.h"

#include <string.h>

enum { N_VERSIONS = 9, CAP_CODEWORDS = 292, CAP_DATA = 232, CAP_CHECK = 30 };
enum { DARK = SV_QR_DARK, FIXED = 2 }; // FIXED: a module of a pattern, not of the message
enum { QUIET = 4 };                    // modules of white around the code

// Level L: data and check codewords of one block, and blocks (table 9); middle of the first
// alignment pattern beside 6 (table E.1).
static const struct {
  uint8_t n_data, n_check, n_blocks, align;
} versions[N_VERSIONS + 1] = {{0},
                              {19, 7, 1, 0},
                              {34, 10, 1, 18},
                              {55, 15, 1, 22},
                              {80, 20, 1, 26},
                              {108, 26, 1, 30},
                              {68, 18, 2, 34},
                              {78, 20, 2, 22},
                              {97, 24, 2, 24},
                              {116, 30, 2, 26}};

// --- codewords (7.4, 7.5, 7.6) -------------------------------------------------------------------

// In GF(256) with x^8 + x^4 + x^3 + x^2 + 1
static uint8_t multiply(uint8_t a, uint8_t b) {
  unsigned product = 0;
  for (int i = 7; i >= 0; i--) {
    product = product << 1 ^ (product >> 7) * 0x11du;
    product ^= (b >> i & 1u) * a;
  }
  return (uint8_t)product;
}

// The remainder of the data, a polynomial, by the product of (x - 2^i) for i < n_check.
static void add_check(const uint8_t *data, int n_data, int n_check, uint8_t *check) {
  uint8_t divisor[CAP_CHECK] = {0}, root = 1;
  divisor[n_check - 1] = 1;
  for (int i = 0; i < n_check; i++) {
    for (int k = 0; k < n_check; k++)
      divisor[k] = (uint8_t)(multiply(divisor[k], root) ^ (k + 1 < n_check ? divisor[k + 1] : 0));
    root = multiply(root, 2);
  }
  memset(check, 0, (size_t)n_check);
  for (int i = 0; i < n_data; i++) {
    const uint8_t factor = data[i] ^ check[0];
    for (int k = 0; k < n_check; k++)
      check[k] = (uint8_t)((k + 1 < n_check ? check[k + 1] : 0) ^ multiply(divisor[k], factor));
  }
}

// Mode 4 and the length in 4 and 8 bits, then the text: all shifted by half a byte.
static void fill_data(uint8_t *data, int cap, const char *text, int n) {
  data[0] = (uint8_t)(0x40 | n >> 4);
  data[1] = (uint8_t)(n << 4);
  for (int i = 0; i < n; i++) {
    const uint8_t c = (uint8_t)text[i];
    data[i + 1] |= c >> 4;
    data[i + 2] = (uint8_t)(c << 4);
  }
  for (int i = n + 2; i < cap; i++) data[i] = (i - n) & 1 ? 0x11 : 0xec;
}

// All blocks' codewords, one of each in turn.
static int interleave(int version, const uint8_t *data, uint8_t *out) {
  const int n_data = versions[version].n_data, n_check = versions[version].n_check;
  const int n_blocks = versions[version].n_blocks;
  uint8_t check[2][CAP_CHECK];
  for (int b = 0; b < n_blocks; b++) add_check(data + b * n_data, n_data, n_check, check[b]);
  int n = 0;
  for (int i = 0; i < n_data; i++)
    for (int b = 0; b < n_blocks; b++) out[n++] = data[b * n_data + i];
  for (int i = 0; i < n_check; i++)
    for (int b = 0; b < n_blocks; b++) out[n++] = check[b][i];
  return n;
}

// --- patterns (6.3, 7.9, 7.10) -------------------------------------------------------------------

static void put(sv_qr *q, int x, int y, bool is_dark) {
  q->module[y][x] = (uint8_t)(FIXED | (is_dark ? DARK : 0));
}

static int distance(int dx, int dy) {
  const int ax = dx < 0 ? -dx : dx, ay = dy < 0 ? -dy : dy;
  return ax > ay ? ax : ay;
}

static void put_finder(sv_qr *q, int cx, int cy) {
  for (int y = cy - 4; y <= cy + 4; y++)
    for (int x = cx - 4; x <= cx + 4; x++) {
      const int d = distance(x - cx, y - cy);
      if (x >= 0 && y >= 0 && x < q->side && y < q->side) put(q, x, y, d != 2 && d != 4);
    }
}

static void put_alignment(sv_qr *q, int cx, int cy) {
  for (int y = cy - 2; y <= cy + 2; y++)
    for (int x = cx - 2; x <= cx + 2; x++) put(q, x, y, distance(x - cx, y - cy) != 1);
}

// value, followed by the remainder of its division in n_check bits.
static unsigned with_bch(unsigned value, int n_check, unsigned divisor) {
  unsigned rest = value;
  for (int i = 0; i < n_check; i++) rest = rest << 1 ^ (rest >> (n_check - 1) & 1) * divisor;
  return value << n_check | rest;
}

static void put_format(sv_qr *q, int mask) {
  const unsigned bits = with_bch(1u << 3 | (unsigned)mask, 10, 0x537) ^ 0x5412; // 1: level L
  const int s = q->side;
  for (int i = 0; i < 15; i++) {
    const bool is_dark = bits >> i & 1;
    // Beside the upper left finder, without the timing pattern's row and column
    if (i < 8) put(q, 8, i < 6 ? i : i + 1, is_dark);
    else put(q, i == 8 ? 7 : 14 - i, 8, is_dark);
    // Beside the other two
    if (i < 8) put(q, s - 1 - i, 8, is_dark);
    else put(q, 8, s - 15 + i, is_dark);
  }
  put(q, 8, s - 8, true);
}

static void put_version(sv_qr *q, int version) {
  const unsigned bits = with_bch((unsigned)version, 12, 0x1f25);
  for (int i = 0; i < 18; i++) {
    put(q, q->side - 11 + i % 3, i / 3, bits >> i & 1);
    put(q, i / 3, q->side - 11 + i % 3, bits >> i & 1);
  }
}

static void put_patterns(sv_qr *q, int version) {
  const int s = q->side, last = s - 7, mid = versions[version].align;
  for (int i = 0; i < s; i++) {
    put(q, i, 6, i % 2 == 0);
    put(q, 6, i, i % 2 == 0);
  }
  put_finder(q, 3, 3);
  put_finder(q, s - 4, 3);
  put_finder(q, 3, s - 4);
  if (mid) put_alignment(q, last, last);
  if (version >= 7) {
    const int at[5][2] = {{mid, 6}, {6, mid}, {mid, mid}, {last, mid}, {mid, last}};
    for (int i = 0; i < 5; i++) put_alignment(q, at[i][0], at[i][1]);
    put_version(q, version);
  }
  put_format(q, 0);
}

// Two columns at a time from the right, upwards and downwards in turn (7.7.3).
static void put_message(sv_qr *q, const uint8_t *codewords, int n) {
  int i = 0;
  bool is_up = false;
  for (int right = q->side - 1; right > 0; right -= 2) {
    if (right == 6) right--; // the timing pattern
    is_up = !is_up;
    for (int k = 0; k < q->side; k++) {
      const int y = is_up ? q->side - 1 - k : k;
      for (int x = right; x > right - 2; x--)
        if (!(q->module[y][x] & FIXED) && i < 8 * n) {
          q->module[y][x] = codewords[i / 8] >> (7 - i % 8) & 1;
          i++;
        }
    }
  }
}

// --- masks (7.8) ---------------------------------------------------------------------------------

static bool is_masked(int mask, int x, int y) {
  switch (mask) {
  case 0: return (x + y) % 2 == 0;
  case 1: return y % 2 == 0;
  case 2: return x % 3 == 0;
  case 3: return (x + y) % 3 == 0;
  case 4: return (y / 2 + x / 3) % 2 == 0;
  case 5: return x * y % 2 + x * y % 3 == 0;
  case 6: return (x * y % 2 + x * y % 3) % 2 == 0;
  default: return ((x + y) % 2 + x * y % 3) % 2 == 0;
  }
}

static void apply_mask(sv_qr *q, int mask) {
  for (int y = 0; y < q->side; y++)
    for (int x = 0; x < q->side; x++)
      if (!(q->module[y][x] & FIXED)) q->module[y][x] ^= is_masked(mask, x, y);
}

static bool is_dark(const sv_qr *q, int x, int y) { return q->module[y][x] & DARK; }

// Runs of five and more, and what looks like a finder, in a row or a column.
static int line_penalty(const sv_qr *q, int k, bool is_column) {
  int penalty = 0, run = 0;
  unsigned last = 0; // the last eleven modules
  for (int i = 0; i < q->side; i++) {
    const unsigned m = is_column ? is_dark(q, k, i) : is_dark(q, i, k);
    run = i && m == (last & 1) ? run + 1 : 1;
    if (run >= 5) penalty += run == 5 ? 3 : 1;
    last = (last << 1 | m) & 0x7ff;
    if (i >= 10 && (last == 0x05d || last == 0x5d0)) penalty += 40;
  }
  return penalty;
}

static int penalty_of(const sv_qr *q) {
  int penalty = 0, n_dark = 0;
  const int s = q->side;
  for (int k = 0; k < s; k++) penalty += line_penalty(q, k, false) + line_penalty(q, k, true);
  for (int y = 0; y < s; y++)
    for (int x = 0; x < s; x++) {
      n_dark += is_dark(q, x, y);
      if (x + 1 == s || y + 1 == s) continue;
      const int n = is_dark(q, x, y) + is_dark(q, x + 1, y) + is_dark(q, x, y + 1) + is_dark(q, x + 1, y + 1);
      if (n % 4 == 0) penalty += 3;
    }
  const int off = 20 * n_dark - 10 * s * s; // from half, in twentieths of all
  return penalty + 10 * ((off < 0 ? -off : off) / (s * s));
}

bool sv_qr_make(sv_qr *q, const char *text) {
  const size_t n = strlen(text);
  uint8_t data[CAP_DATA] = {0}, codewords[CAP_CODEWORDS];
  int version = 1, best = 0, least = 0;
  if (n > SV_QR_CAP_TEXT) return false;
  while ((size_t)(versions[version].n_data * versions[version].n_blocks - 2) < n) version++;
  memset(q, 0, sizeof *q);
  q->side = 17 + 4 * version;
  fill_data(data, versions[version].n_data * versions[version].n_blocks, text, (int)n);
  put_patterns(q, version);
  put_message(q, codewords, interleave(version, data, codewords));
  for (int mask = 0; mask < 8; mask++) {
    put_format(q, mask);
    apply_mask(q, mask);
    const int penalty = penalty_of(q);
    apply_mask(q, mask); // back
    if (mask == 0 || penalty < least) {
      best = mask;
      least = penalty;
    }
  }
  put_format(q, best);
  apply_mask(q, best);
  return true;
}

// --- pictures ------------------------------------------------------------------------------------

static bool is_dark_at(const sv_qr *q, int x, int y) {
  return x >= 0 && y >= 0 && x < q->side && y < q->side && is_dark(q, x, y);
}

void sv_qr_lines(const sv_qr *q, sv_str *out) {
  // Upper half dark: 1, lower: 2
  static const char *const blocks[] = {" ", "\u2580", "\u2584", "\u2588"};
  for (int y = -QUIET; y < q->side + QUIET; y += 2) {
    sv_str_add(out, "\033[38;5;16;48;5;231m");
    for (int x = -QUIET; x < q->side + QUIET; x++)
      sv_str_add(out, "%s", blocks[is_dark_at(q, x, y) + 2 * is_dark_at(q, x, y + 1)]);
    sv_str_add(out, "\033[0m\n");
  }
}

void sv_qr_svg(const sv_qr *q, sv_str *out) {
  const int s = q->side + 2 * QUIET;
  sv_str_add(out,
             "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 %d %d\" width=\"%d\" height=\"%d\" "
             "shape-rendering=\"crispEdges\"><path fill=\"#fff\" d=\"M0 0h%dv%dH0z\"/><path d=\"",
             s, s, 8 * s, 8 * s, s, s);
  for (int y = 0; y < q->side; y++)
    for (int x = 0; x < q->side; x++) {
      int n = 0;
      while (is_dark_at(q, x + n, y)) n++;
      if (n) sv_str_add(out, "M%d %dh%dv1h-%dz", x + QUIET, y + QUIET, n, n);
      x += n;
    }
  sv_str_add(out, "\"/></svg>\n");
}
