// SPDX-License-Identifier: Apache-2.0
#include "tests/kernels/check.h"

static void check_fma_peak(ck *c) {
  static const int rounds[] = {0, 1, 2, 17, 1000};
  static const float xs[] = {0.0f, 0.5f, -3.25f, 1e-38f, 1e30f};
  for (size_t r = 0; r < sizeof rounds / sizeof *rounds; r++)
    for (size_t i = 0; i < sizeof xs / sizeof *xs; i++) {
      ck_begin(c, "%d rounds x=%g", rounds[r], (double)xs[i]);
      float *a = ck_floats(c, 16), *b = ck_floats(c, 16);
      c->ref.fma_peak(rounds[r], xs[i], a);
      c->var.fma_peak(rounds[r], xs[i], b);
      ck_same(c, "out", a, b, 16, 1e-4);
    }
}

static void run(void *arg, const sv_kernels *k) { k->fma_peak(1000, 0.5f, arg); }
static void bench_fma_peak(ck *c) {
  ck_begin(c, "bench");
  ck_time(c, "per floating-point operation", 1000.0 * SV_FMA_PEAK_FLOPS, run, ck_floats(c, 16));
}

CK_REGISTER(fma_peak, check_fma_peak, bench_fma_peak)
