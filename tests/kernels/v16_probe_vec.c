// SPDX-License-Identifier: Apache-2.0
// The probe, compiled once per instruction set (mk/kernels.mk).
#include <string.h>

#include "kernels/simd/v16.h"
#include "tests/kernels/v16_probe.h"

static void put_f(v16_probe_word *w, const char *name, int has_fma, v16 v) {
  float f[16];
  v16_store(f, v);
  w->name = name;
  w->has_fma = has_fma;
  memcpy(w->bits, f, 64);
}
static void put_i(v16_probe_word *w, const char *name, v16i v) {
  w->name = name;
  w->has_fma = 0;
  v16i_store(w->bits, v);
}
static void put_u(v16_probe_word *w, const char *name, uint32_t v) {
  w->name = name;
  w->has_fma = 0;
  memset(w->bits, 0, 64);
  w->bits[0] = (int32_t)v;
}

#define F(expr)  put_f(o++, #expr, 0, expr)
#define FF(expr) put_f(o++, #expr, 1, expr)
#define I(expr)  put_i(o++, #expr, expr)
#define U(expr)  put_u(o++, #expr, expr)

static v16_probe_word *probe_words(const float *in, v16_probe_word *o) {
  v16 a = v16_load(in), b = v16_load(in + 16), c = v16_load(in + 32),
      p = v16_max(v16_abs(a), v16_set1(1e-3f));
  p = v16_min(p, v16_set1(1e3f));
  v16m m = v16_lt(a, b), n = v16_ge(b, c);
  F(v16_set1(in[3]));
  F(v16_zero());
  F(v16_iota());
  F(v16_load4x4(in, 8)); // clang-format off
  F(v16_load_quad(in + 7)); F(v16_load_quads(in + 9, in + 2, in + 40, in)); F(v16_dup4_0(a)); F(v16_dup4_1(a)); F(v16_dup4_2(a)); F(v16_dup4_3(a));
  F(v16_add(a, b)); F(v16_sub(a, b)); F(v16_mul(a, b)); F(v16_div(a, b));
  FF(v16_fma(a, b, c)); FF(v16_fnma(a, b, c)); FF(v16_fms(a, b, c)); FF(v16_fnms(a, b, c));
  F(v16_min(a, b)); F(v16_max(a, b)); F(v16_sqrt(p)); F(v16_abs(a)); F(v16_neg(a));
  U(v16m_bits(v16_lt(a, b))); U(v16m_bits(v16_le(a, b))); U(v16m_bits(v16_gt(a, b))); U(v16m_bits(v16_ge(a, b)));
  U(v16m_bits(v16_le(a, a))); U(v16m_bits(v16m_and(m, n))); U(v16m_bits(v16m_or(m, n)));
  U(v16m_bits(v16m_andnot(m, n))); U(v16m_bits(v16m_from_bits(0xa5c3u))); U(v16m_bits(v16m_from_bits(0u)));
  F(v16_sel(m, a, b)); F(v16_keep(m, a)); F(v16_keep(v16m_from_bits(0x8001u), b));
  F(v16_floor(a)); U((uint32_t)v16m_all(m)); U((uint32_t)v16m_all(v16_le(p, p)));
  I(v16i_set1(-7)); I(v16_bits(a)); F(v16_from_bits(v16_bits(b)));
  I(v16i_add(v16_bits(a), v16_bits(b))); I(v16i_and(v16_bits(a), v16_bits(b))); I(v16i_or(v16_bits(a), v16_bits(b)));
  I(v16i_andnot(v16_bits(a), v16_bits(b))); F(v16_pow2_floor(p, v16_min(v16_max(c, v16_set1(-20.0f)), v16_set1(20.0f))));
  I(v16i_shl8(v16_bits(a))); I(v16i_shr8(v16_bits(a))); I(v16i_shl16(v16_bits(a)));
  I(v16i_shl23(v16_bits(a))); I(v16i_shr23(v16_bits(a)));
  I(v16i_shl_by(v16i_set1(-2), v16_min(p, v16_set1(29.5f)))); F(v16i_to_f(v16_bits(a))); I(v16_trunc_i(v16_sub(p, c)));
  F(v16_min4(p)); F(v16_max4(p)); F(v16_set1(v16_sum(a))); F(v16_sum4(a, b, c, p));
  F(v16_rest(v16_min(v16_max(a, v16_set1(-4e6f)), v16_set1(4e6f)))); F(v16_rest(v16_mul(v16_set1(0.5f), v16i_to_f(v16_trunc_i(v16_sub(p, c))))));
  // clang-format on
  FF(v16_exp2_up8(v16_max(v16_sub(v16_set1(-0.5f), p), v16_set1(-126.0f))));
  FF(v16_exp2_fine(c));
  FF(v16_log2(p));
  return o;
}

int V(v16_probe)(const float *in, const float *block, const uint8_t *u8, v16_probe_word *out) {
  static const char *const row_name[4] = {"v16_transpose rows 0", "v16_transpose row 5",
                                          "v16_transpose row 10", "v16_transpose row 15"};
  v16_probe_word *o = probe_words(in, out);
  v16 t[16], s;
  for (int i = 0; i < 16; i++) t[i] = v16_load(block + 16 * i);
  s = v16_sum16(t);
  F(s);
  s = v16_sum11(t);
  F(s);
  s = v16_sum9(t);
  F(s);
  v16 four[4];
  v16_tr4(t[0], t[1], t[2], t[3], four);
  put_f(o++, "v16_tr4, first", 0, four[0]);
  put_f(o++, "v16_tr4, last", 0, four[3]);
  v16_transpose(t);
  for (int i = 0; i < 4; i++) put_f(o++, row_name[i], 0, t[5 * i]);
  F(v16_load_u8(u8));
  uint8_t bytes[64] = {0};
  v16_store_u8(bytes, v16_mul(v16_load(in + 32), v16_set1(40.0f)));
  memcpy(o->bits, bytes, 64);
  o->name = "v16_store_u8";
  o->has_fma = 0;
  o++;
  uint16_t high[16];
  v16_store_high(high, v16_load(in));
  memset(o->bits, 0, 64);
  memcpy(o->bits, high, 32);
  o->name = "v16_store_high";
  o->has_fma = 0;
  o++;
  memcpy(high, in + 7, 32);
  put_f(o++, "v16_load_high", 0, v16_load_high(high));
  v16i_store_high(high, v16_bits(v16_load(in + 16)));
  memset(o->bits, 0, 64);
  memcpy(o->bits, high, 32);
  o->name = "v16i_store_high";
  o->has_fma = 0;
  o++;
  uint8_t eleven[32];
  v16_store11(eleven, v16_load(in));
  memset(o->bits, 0, 64);
  memcpy(o->bits, eleven, 32);
  o->name = "v16_store11";
  o->has_fma = 0;
  o++;
  put_f(o++, "v16_load11", 0, v16_load11(eleven));
  float square[32] = {0};
  v16_store4x4(square, 7, v16_load(in));
  put_f(o++, "v16_store4x4", 0, v16_load(square));
  put_f(o++, "v16_store4x4, second half", 0, v16_load(square + 16));
  return (int)(o - out);
}
