// SPDX-License-Identifier: Apache-2.0
// The vector vocabulary itself: every word against v16_ref.h, and its exp2 and log2 against libm in
// double.
#include <math.h>
#include <string.h>

#include "kernels/simd/s1_math.h"
#include "tests/kernels/check.h"
#include "tests/kernels/v16_probe.h"

static v16_probe_fn *const probes[SV_N_ISAS] = {
    [SV_ISA_REF] = v16_probe_ref,
#if defined(SV_HAVE_SSE41) && SV_HAVE_SSE41
    [SV_ISA_SSE41] = v16_probe_sse41,
#endif
#if defined(SV_HAVE_AVX2) && SV_HAVE_AVX2
    [SV_ISA_AVX2] = v16_probe_avx2,
#endif
#if defined(SV_HAVE_AVX512) && SV_HAVE_AVX512
    [SV_ISA_AVX512] = v16_probe_avx512,
#endif
#if defined(SV_HAVE_NEON) && SV_HAVE_NEON
    [SV_ISA_NEON] = v16_probe_neon,
#endif
};

static const v16_probe_word *word_named(const v16_probe_word *w, int n, const char *name) {
  for (int i = 0; i < n; i++)
    if (!strcmp(w[i].name, name)) return w + i;
  return NULL;
}

static void every_word(ck *c) {
  static v16_probe_word ref[V16_PROBE_WORDS], var[V16_PROBE_WORDS];
  for (int round = 0; round < 400; round++)
    for (int fill = 0; fill < CK_N_FILLS; fill++) {
      ck_begin(c, "round %d %s", round, ck_fill_name(fill));
      float *in = ck_floats_odd(c, 48), *block = ck_floats_odd(c, 256);
      uint8_t *u8 = ck_bytes(c, 16);
      ck_fill(c, in, 48, fill);
      ck_fill(c, block, 256, fill);
      ck_fill_bytes(c, u8, 16);
      if (fill == CK_MIXED) {
        in[4] = NAN;
        in[21] = NAN;
        in[9] = INFINITY;
      }
      int n = v16_probe_ref(in, block, u8, ref), m = probes[c->isa](in, block, u8, var);
      ck_true(c, n == m, "%d words, the reference has %d", m, n);
      for (int i = 0; i < n && i < m; i++) {
        float a[16], b[16];
        memcpy(a, ref[i].bits, 64);
        memcpy(b, var[i].bits, 64);
        if (ref[i].has_fma) // a two-step product of huge numbers has no useful bound
          c->is_exact || fill < CK_HUGE ? ck_same(c, ref[i].name, a, b, 16, 2e-6) : (void)0;
        else
          for (int k = 0; k < 16; k++)
            ck_true(c, ref[i].bits[k] == var[i].bits[k] || (isnan(a[k]) && isnan(b[k])),
                    "%s lane %d: %08x, reference %08x", ref[i].name, k, (unsigned)var[i].bits[k],
                    (unsigned)ref[i].bits[k]);
      }
    }
}

// To the nearest; what 16 bits hold stays as it is.
static void rounding(ck *c) {
  ck_begin(c, "16 bits");
  for (uint32_t i = 0; i < 0x7f80; i++) {
    const float x = s1_from_high((uint16_t)i), up = s1_from_high((uint16_t)(i + 1));
    ck_true(c, s1_high(x) == i && s1_high(-x) == (i | 0x8000), "%g of 16 bits does not stay", (double)x);
    if (i + 1 == 0x7f80) break; // next is infinity
    const float below = s1_from_bits((i << 16) + 0x7fff), above = s1_from_bits((i << 16) + 0x8001);
    ck_true(c, s1_high(below) == i && s1_from_high(s1_high(above)) == up, "near %g: not to the nearest",
            (double)x);
  }
}

#define EXP2_WORD "v16_exp2_up8(v16_max(v16_sub(v16_set1(-0.5f), p), v16_set1(-126.0f)))"

// Worst errors of the three functions through the probe, whose inputs are shaped to their domains.
static void accuracy(ck *c) {
  static v16_probe_word w[V16_PROBE_WORDS];
  double worst[3] = {0};
  ck_begin(c, "accuracy");
  float *in = ck_floats(c, 48), *block = ck_floats(c, 256);
  uint8_t *u8 = ck_bytes(c, 16);
  memset(block, 0, 1024);
  memset(u8, 0, 16);
  for (int i = 0; i < 40000; i++) {
    for (int k = 0; k < 16; k++) {
      float u = ((float)(16 * i + k) + sv_rng_f(&c->rng)) / (16 * 40000);
      // exp2 and log2 take |a| limited to [1e-3, 1e3]
      in[k] = i & 1 ? u * 126 : powf(10, u * 6 - 3);
      in[k] = fminf(in[k], 126);
      in[32 + k] = u * 252 - 126;
    }
    int n = probes[c->isa](in, block, u8, w);
    const v16_probe_word *e = word_named(w, n, EXP2_WORD);
    const v16_probe_word *f = word_named(w, n, "v16_exp2_fine(c)"), *l = word_named(w, n, "v16_log2(p)");
    ck_true(c, e && f && l, "the probe has lost a word");
    if (!e || !f || !l) return;
    for (int k = 0; k < 16; k++) {
      float v[3], p = fminf(fmaxf(in[k], 1e-3f), 1e3f);
      memcpy(v, e->bits + k, 4);
      memcpy(v + 1, f->bits + k, 4);
      memcpy(v + 2, l->bits + k, 4);
      worst[0] = fmax(worst[0], fabs(v[0] / exp2(8 + (double)fmaxf(-0.5f - p, -126)) - 1));
      worst[1] = fmax(worst[1], fabs(v[1] / exp2((double)in[32 + k]) - 1));
      worst[2] = fmax(worst[2], fabs(v[2] - log2((double)p)) / fmax(1, fabs(log2((double)p))));
    }
  }
  ck_true(c, worst[0] < 4.0e-6, "exp2: relative error %.3g", worst[0]);
  ck_true(c, worst[1] < (c->is_exact ? 2.3e-7 : 3e-7), "exp2_fine: relative error %.3g", worst[1]);
  ck_true(c, worst[2] < 3.5e-7, "log2: error %.3g", worst[2]);
}

// The scalar twins that reference kernels use must be the vocabulary's own bits.
static void twins(ck *c) {
  static v16_probe_word w[V16_PROBE_WORDS];
  ck_begin(c, "scalar twins");
  float *in = ck_floats(c, 48), *block = ck_floats(c, 256);
  uint8_t *u8 = ck_bytes(c, 16);
  memset(block, 0, 1024);
  memset(u8, 0, 16);
  for (int i = 0; i < 2000; i++) {
    float lanes[16];
    for (int k = 0; k < 48; k++) in[k] = (sv_rng_f(&c->rng) - 0.3f) * 100;
    int n = v16_probe_ref(in, block, u8, w);
    memcpy(lanes, in, 64);
    float sum = s1_sum16(lanes);
    const v16_probe_word *s = word_named(w, n, "v16_set1(v16_sum(a))");
    ck_true(c, s && (uint32_t)s->bits[0] == s1_bits(sum), "s1_sum16");
    for (int k = 0; k < 16; k++) {
      float p = s1_min(s1_max(fabsf(in[k]), 1e-3f), 1e3f);
      const v16_probe_word *e = word_named(w, n, EXP2_WORD);
      const v16_probe_word *f = word_named(w, n, "v16_exp2_fine(c)"), *l = word_named(w, n, "v16_log2(p)");
      if (!e || !f || !l) return;
      ck_true(c, (uint32_t)e->bits[k] == s1_bits(s1_exp2_up8(s1_max(-0.5f - p, -126.0f))),
              "s1_exp2_up8(%.9g)", -0.5f - p);
      ck_true(c, (uint32_t)f->bits[k] == s1_bits(s1_exp2_fine(in[32 + k])), "s1_exp2_fine(%.9g)", in[32 + k]);
      ck_true(c, (uint32_t)l->bits[k] == s1_bits(s1_log2(p)), "s1_log2(%.9g)", p);
    }
  }
}

static void check_v16(ck *c) {
  every_word(c);
  accuracy(c);
  if (c->isa == SV_ISA_REF) {
    twins(c);
    rounding(c);
  }
}
CK_REGISTER(v16, check_v16, NULL)
