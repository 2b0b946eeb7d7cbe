// SPDX-License-Identifier: Apache-2.0
// `bin`, a row of blocks each of 16 splats at once; splats that are not small are cut into strips
// first. bin_ref.c is the specification.
#include "kernels/bin/bin.h"

#include <stddef.h>
#include <string.h>

#include "kernels/bin/bin_common.h"
#include "kernels/simd/v16.h"

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "two words of an intersection are written as one");

// --- rows of ellipses ----------------------------------------

// What a vector of rows needs of its splats. Columns are in blocks, from the first tile's first one
// on.
typedef struct {
  v16 k, l, b, lo, hi, r; // as in the reference
  v16 v, dy_right;
  v16 row, col;              // of the first tile
  v16 min, max, first, last; // bounds: [min, max) blocks; block rows
  v16i intersection_offset;
} splats16;

static inline v16 high16(v16i x) { // as a float; the halves are below 2^15
  return v16_mul(v16i_to_f(v16i_and(x, v16i_set1(0x7fff0000))), v16_set1(1.0f / 65536.0f));
}

static inline v16 low16(v16i x) { return v16i_to_f(v16i_and(x, v16i_set1(0xffff))); }

static __attribute__((noinline)) void load_splats(const sv_splat *splat, const uint32_t *id, splats16 *out) {
  _Static_assert(offsetof(sv_splat, bx0) == 48, "the fields are taken in their order");
  v16 field[16];
  for (uint32_t k = 0; k < 16; k++) field[k] = v16_load((const float *)(const void *)(splat + id[k]));
  v16_transpose(field);
  const v16 quarter = v16_set1(0.25f), m4a = v16_mul(v16_set1(-4.0f), field[2]);
  const v16i x = v16_bits(field[12]), y = v16_bits(field[13]);
  const v16 col = v16i_to_f(v16i_and(x, v16i_set1(0xfff8))), r = v16_mul(quarter, field[11]);
  splats16 s;
  s.intersection_offset = v16_bits(field[15]);
  s.col = col;
  s.row = v16i_to_f(v16i_and(y, v16i_set1(0xfff8)));
  s.r = v16_mul(v16_set1(BIN_ROOT_UP), r);
  s.k = v16_fma(field[3], field[3], v16_mul(m4a, field[4]));
  s.l = v16_mul(m4a, v16_sub(field[5], v16_set1(SV_POWER_MIN)));
  s.b = v16_mul(field[3], r);
  s.lo = v16_fms(quarter, v16_add(field[0], v16_set1(BIN_ROUND_LO)), col);
  s.hi = v16_fms(quarter, v16_add(field[0], v16_set1(BIN_ROUND_HI)), col);
  s.v = field[1];
  s.dy_right = field[10];
  s.min = v16_sub(low16(x), col);
  s.max = v16_sub(v16_add(high16(x), v16_set1(1.0f)), col);
  s.first = low16(y);
  s.last = high16(y);
  // One block wide or high: all of the bounds.
  const v16m bar = v16m_or(v16_ge(s.min, v16_sub(s.max, v16_set1(1.0f))), v16_ge(s.first, s.last));
  s.l = v16_sel(bar, v16_set1(BIN_ALL), s.l);
  *out = s;
}

static inline v16 root(v16 disc) {
  v16 y = v16_fma(v16_set1(-0.5f), v16i_to_f(v16_bits(disc)), v16_set1(BIN_ROOT_BITS));
  y = v16_from_bits(v16_trunc_i(y));
  const v16 x = v16_mul(disc, y);
  return v16_mul(x, v16_fma(v16_set1(-0.5f), v16_mul(x, y), v16_set1(1.5f)));
}

static inline v16 disc_at(const splats16 *s, v16 dy) { return v16_fma(v16_mul(s->k, dy), dy, s->l); }

// A row of blocks, half found: discriminants and edges at the two heights.
typedef struct {
  v16 disc_lo, disc_hi, lo, hi;
} half_row;

V16_INLINE half_row begin_columns(const splats16 *s, v16 y) {
  v16 top = v16_sub(s->v, y), bottom = v16_sub(top, v16_set1(3.0f));
  v16 left = v16_min(v16_max(v16_neg(s->dy_right), bottom), top);
  v16 right = v16_min(v16_max(s->dy_right, bottom), top);
  half_row h = {disc_at(s, left), disc_at(s, right), v16_fma(s->b, left, s->lo), v16_fma(s->b, right, s->hi)};
  return h;
}

V16_INLINE v16m end_columns(const splats16 *s, const half_row *h, v16 *from, v16 *to) {
  v16 lo = v16_fma(s->r, root(h->disc_lo), h->lo), hi = v16_fnma(s->r, root(h->disc_hi), h->hi);
  *from = v16_min(v16_max(lo, s->min), s->max);
  *to = v16_min(v16_max(hi, v16_zero()), v16_sub(s->max, v16_set1(0.25f)));
  return v16_gt(h->disc_lo, v16_zero());
}

// The columns of the block row whose first pixel centres lie at y: from *from to *to, both cut to
// whole numbers.
static inline v16m columns(const splats16 *s, v16 y, v16 *from, v16 *to) {
  const half_row h = begin_columns(s, y);
  return end_columns(s, &h, from, to);
}

// Bits from..to of a row; from and to at least 0.
static inline v16i bits_between(v16m in, v16 from, v16 to) {
  const v16i bits = v16i_andnot(v16i_shl_by(v16i_set1(-1), from), v16i_shl_by(v16i_set1(-2), to));
  return v16_bits(v16_keep(in, v16_from_bits(bits)));
}

// --- intersections ----------------------------------------

// An intersection's fields as two words: a structure that is put together and then copied by wide
// loads waits for its stores.
static inline void put_record(sv_intersection *r, uint64_t tile_id, uint64_t mask) {
  memcpy(&r->tile, &tile_id, sizeof tile_id);
  r->mask = mask;
}

// --- small splats ----------------------------------------

// The rows of blocks j..j + 3 of a tile, a byte each, of the left and the right one of two tiles
// side by side. Those above the splat's first row are rows of the tile below.
static __attribute__((noinline)) void four_rows(const splats16 *s, float j, v16i *left, v16i *right) {
  const v16i even = v16i_set1(0x00ff00ff), odd = v16i_set1((int32_t)0xff00ff00);
  const v16 first = v16_sub(s->first, s->row), last = v16_sub(s->last, s->row);
  const v16 y = v16_fma(s->row, v16_set1(4.0f), v16_set1(0.5f));
  v16i b[4];
  half_row h[4];
  v16m is_in[4];
  for (int i = 0; i < 4; i++) {
    const float k = j + (float)i;
    v16 row = v16_sel(v16_gt(first, v16_set1(k)), v16_set1(k + 8.0f), v16_set1(k));
    h[i] = begin_columns(s, v16_fma(row, v16_set1(4.0f), y));
    is_in[i] = v16_le(row, last);
  }
  v16 from[4], to[4];
  for (int i = 0; i < 4; i++) is_in[i] = v16m_and(is_in[i], end_columns(s, h + i, from + i, to + i));
  for (int i = 0; i < 4; i++) b[i] = bits_between(is_in[i], from[i], to[i]);
  b[0] = v16i_or(b[0], v16i_shl16(b[2]));
  b[1] = v16i_or(b[1], v16i_shl16(b[3]));
  *left = v16i_or(v16i_and(b[0], even), v16i_shl8(v16i_and(b[1], even)));
  *right = v16i_or(v16i_shr8(v16i_and(b[0], odd)), v16i_and(b[1], odd));
}

typedef struct {
  const sv_splat *splat;
  const uint32_t *id; // [16]
  splats16 *to;
} next_splats;

// Sixteen splats, four intersections each: the tile, the one to the right, those below. How many of
// them a splat has cannot be predicted; what is too much is in the place of the next one's, which
// are written after it. Returns the bits of the splats of more than eight rows of blocks or two
// tiles wide, whose intersections are anything.
// next: loaded on the way.
static __attribute__((noinline)) uint32_t bin_small(const splats16 *s, const uint32_t *id, uint32_t n_tiles_x,
                                                    sv_intersection *intersection, const next_splats *next) {
  // All bits of the rows that are not of the tile below, by halves of a tile.
  const v16 first = v16_mul(v16_sub(s->first, s->row), v16_set1(8.0f)), minus = v16_set1(-1.0f);
  const v16i upper[2] = {
      v16_trunc_i(v16_keep(v16_lt(first, v16_set1(32.0f)), v16_pow2_floor(minus, first))),
      v16_trunc_i(v16_pow2_floor(minus, v16_max(v16_sub(first, v16_set1(32.0f)), v16_zero())))};
  const v16m is_wide = v16_gt(s->max, v16_set1(8.0f));
  const v16i tile =
      v16_trunc_i(v16_mul(v16_set1(0.125f), v16_fma(s->row, v16_set1((float)n_tiles_x), s->col)));
  const v16i below = v16i_add(tile, v16i_set1((int32_t)n_tiles_x)), one = v16i_set1(1);
  const v16 ids = v16_load((const float *)(const void *)id);
  v16 out[16];
  out[0] = v16_from_bits(tile);
  out[4] = v16_sel(is_wide, v16_from_bits(v16i_add(tile, one)), v16_from_bits(below));
  out[8] = v16_from_bits(below);
  out[12] = v16_from_bits(v16i_add(below, one));
  for (int k = 1; k < 16; k += 4) out[k] = ids;
  for (int half = 0; half < 2; half++) {
    v16i left, right;
    four_rows(s, (float)(4 * half), &left, &right);
    out[2 + half] = v16_from_bits(v16i_and(left, upper[half]));
    out[10 + half] = v16_from_bits(v16i_andnot(left, upper[half]));
    out[6 + half] = v16_sel(is_wide, v16_from_bits(v16i_and(right, upper[half])), out[10 + half]);
    out[14 + half] = v16_from_bits(v16i_andnot(right, upper[half]));
  }
  uint32_t at[16];
  v16i_store((int32_t *)at, s->intersection_offset);
  const uint32_t large =
      v16m_bits(v16m_or(v16_gt(v16_sub(s->last, s->first), v16_set1(7.0f)), v16_gt(s->max, v16_set1(16.0f))));
  load_splats(next->splat, next->id, next->to);
  v16_transpose(out);
  for (uint32_t k = 0; k < 16; k++) v16_store((float *)(void *)(intersection + at[k]), out[k]);
  return large;
}

// --- large splats ----------------------------------------

#define STRIP_TILES 3 // a row of bits is a whole number in a float

// Parts of splats, in one row of tiles each.
typedef struct {
  uint32_t n;
  uint32_t id[16];
  uint32_t tile[16], intersection[16]; // the first one, and its intersection
  uint32_t after[16];                  // tiles after the first one
  // first row of blocks, first column from the splat's first tile on
  float row[16], col[16];
} strips16;

static __attribute__((noinline)) void bin_strips(const sv_splat *splat, strips16 *p,
                                                 sv_intersection *intersection) {
  _Alignas(64) uint32_t bits[2 * STRIP_TILES][16];
  for (uint32_t k = p->n, last = k - 1; k < 16; k++) {
    p->id[k] = p->id[last];
    p->row[k] = p->row[last];
    p->col[k] = p->col[last];
  }
  splats16 s;
  load_splats(splat, p->id, &s);
  const v16 row = v16_load(p->row), col = v16_load(p->col);
  const v16 y = v16_fma(row, v16_set1(4.0f), v16_set1(0.5f));
  const v16 first = v16_sub(s.first, row), last = v16_sub(s.last, row);
  s.min = v16_max(s.min, col);
  s.max = v16_min(s.max, v16_add(col, v16_set1(8.0f * STRIP_TILES)));
  const v16i byte = v16i_set1(0xff);
  for (int half = 0; half < 2; half++) {
    v16i word[STRIP_TILES] = {v16i_set1(0), v16i_set1(0), v16i_set1(0)};
    for (int k = 3; k >= 0; k--) {
      const float j = (float)(4 * half + k);
      v16 from, to;
      v16m in = columns(&s, v16_add(y, v16_set1(4.0f * j)), &from, &to);
      in = v16m_and(in, v16m_and(v16_le(first, v16_set1(j)), v16_ge(last, v16_set1(j))));
      to = v16_sub(to, col);
      v16i b = bits_between(v16m_and(in, v16_ge(to, v16_zero())), v16_sub(from, col), to);
      word[0] = v16i_or(v16i_shl8(word[0]), v16i_and(b, byte));
      word[1] = v16i_or(v16i_shl8(word[1]), v16i_and(v16i_shr8(b), byte));
      word[2] = v16i_or(v16i_shl8(word[2]), v16i_shr8(v16i_shr8(b)));
    }
    for (int t = 0; t < STRIP_TILES; t++) v16i_store((int32_t *)bits[2 * t + half], word[t]);
  }
  for (uint32_t k = 0; k < p->n; k++) {
    const uint64_t tile = p->tile[k] | (uint64_t)p->id[k] << 32;
    sv_intersection *r = intersection + p->intersection[k];
    for (uint32_t t = 0; t <= p->after[k]; t++)
      put_record(r + t, tile + t, bits[2 * t][k] | (uint64_t)bits[2 * t + 1][k] << 32);
  }
  p->n = 0;
}

static void add_strips(const sv_splat *splat, uint32_t id, uint32_t n_tiles_x, sv_intersection *intersection,
                       strips16 *p) {
  const sv_splat *s = splat + id;
  const uint32_t tx0 = s->bx0 >> 3, tx1 = s->bx1 >> 3;
  uint32_t at = s->intersection_offset;
  for (uint32_t ty = s->by0 >> 3; ty <= s->by1 >> 3; ty++)
    for (uint32_t tx = tx0; tx <= tx1; tx += STRIP_TILES) {
      const uint32_t k = p->n++, after = tx1 - tx < STRIP_TILES - 1 ? tx1 - tx : STRIP_TILES - 1;
      p->id[k] = id;
      p->tile[k] = ty * n_tiles_x + tx;
      p->intersection[k] = at;
      p->after[k] = after;
      p->row[k] = (float)(8 * ty);
      p->col[k] = (float)(8 * (tx - tx0));
      at += after + 1;
      if (p->n == 16) bin_strips(splat, p, intersection);
    }
}

// --- all ----------------------------------------

// The ids from i on, the last one again where there are less than sixteen.
static inline const uint32_t *ids_at(const uint32_t *id, uint32_t n, uint32_t i, uint32_t some[16]) {
  if (i + 16 <= n) return id + i;
  for (uint32_t k = 0; k < 16; k++) some[k] = id[i + k < n ? i + k : n - 1];
  return some;
}

void V(sv_bin)(const sv_splat *splat, const uint32_t *id, uint32_t n, int n_tiles_x,
               sv_intersection *intersection) {
  if (n == 0) return;
  const uint32_t n_x = (uint32_t)n_tiles_x;
  uint32_t some[2][16];
  strips16 strips;
  splats16 splats[2];
  strips.n = 0;
  const uint32_t *now = ids_at(id, n, 0, some[0]), *next;
  load_splats(splat, now, splats);
  for (uint32_t i = 0, turn = 0; i < n; i += 16, turn ^= 1, now = next) {
    const uint32_t m = n - i < 16 ? n - i : 16;
    next = i + 16 < n ? ids_at(id, n, i + 16, some[turn ^ 1]) : now;
    const next_splats then = {splat, next, splats + (turn ^ 1)};
    uint32_t large = bin_small(splats + turn, now, n_x, intersection, &then) & (0xffffu >> (16 - m));
    for (; large; large &= large - 1)
      add_strips(splat, now[__builtin_ctz(large)], n_x, intersection, &strips);
  }
  if (strips.n) bin_strips(splat, &strips, intersection);
}
