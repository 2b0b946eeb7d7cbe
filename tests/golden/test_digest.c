// SPDX-License-Identifier: Apache-2.0
// A whole run (simulated capture, then training) gives the same bits for any number of threads, for every
// instruction set with a fused multiply-add, and on every machine: the digests stand in this file. Who changes
// the arithmetic of training on purpose takes the new digests from what the failing test prints.
// clang-format off
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <cmocka.h>
// clang-format on
#include <math.h>
#include <stdio.h>

#include "tests/common/world.h"

#define SHORT_STEPS 60
#define LONG_STEPS  300

#define SHORT_DIGEST 0xa2df7d1e5542e0aeull
#define LONG_DIGEST  0xfebed56644db4de8ull

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define IS_SLOW 1
#else
#define IS_SLOW 0
#endif

static world w;

typedef struct {
  uint64_t digest;
  double loss;
} outcome;

// SH of degree 2 is reached in both lengths, and slots are relocated (the noise starts at step 0).
static outcome run(uint32_t isa_mask, int n_threads, uint32_t steps, int n_exposures, const char *spec) {
  if (!world_open(&w, spec, n_exposures, isa_mask, n_threads)) fail_msg("%s", w.err.text);
  w.cfg.train.n_gaussians = 1500;
  w.cfg.train.sh_degree = 2;
  w.cfg.train.relocate_every = 5;
  w.cfg.steps = steps;
  if (world_run(&w) < 0) fail_msg("%s", w.err.text);
  assert_int_equal(w.app.trainer.step, steps);
  outcome o = {sv_train_digest(&w.app.trainer), w.app.last.loss};
  world_close(&w);
  return o;
}

// A picture whose sides are no multiples of 16, so that padding takes part.
#define SHORT_SPEC "textured,rig=stereo,size=100x76,noise=read:1e-4:shot:1e-3"
#define LONG_SPEC  "textured,rig=stereo,size=160x120"

static outcome run_short(uint32_t mask, int n_threads) { return run(mask, n_threads, SHORT_STEPS, 3, SHORT_SPEC); }

static void expect(uint64_t digest, uint64_t expected, const char *what) {
  if (digest != expected)
    fail_msg("%s: digest 0x%016llxull, expected 0x%016llxull", what, (unsigned long long)digest,
             (unsigned long long)expected);
}

static void test_threads(void **state) {
  (void)state;
  for (int n = 1; n <= 4; n *= 2) {
    char what[32];
    snprintf(what, sizeof what, "short run, %d threads", n);
    expect(run_short(~0u, n).digest, SHORT_DIGEST, what);
  }
}

// Each instruction set of this CPU alone.
static void test_instruction_sets(void **state) {
  (void)state;
  double ref_loss = 0;
  for (int isa = 0; isa < SV_N_ISAS; isa++) {
    if (!(sv_cpu_isas() & SV_ISA_BIT(isa))) continue;
    outcome o = run_short(sv_isa_only((sv_isa)isa), 2);
    if (isa == SV_ISA_REF) ref_loss = o.loss;
    print_message("%s: digest %016llx, loss %.6f\n", sv_isa_name((sv_isa)isa), (unsigned long long)o.digest, o.loss);
    if (isa != SV_ISA_SSE41) expect(o.digest, SHORT_DIGEST, sv_isa_name((sv_isa)isa));
    else if (!(fabs(o.loss - ref_loss) < 0.02 * ref_loss))
      fail_msg("sse41: loss %.6f, the reference's is %.6f: more than 2 %% apart", o.loss, ref_loss);
  }
}

static void test_long_run(void **state) {
  (void)state;
#if defined(__x86_64__)
  if (IS_SLOW) {
    print_message("skip the long run: it takes minutes under this sanitizer\n");
    skip();
  }
  expect(run(~0u, 2, LONG_STEPS, 4, LONG_SPEC).digest, LONG_DIGEST, "long run, 2 threads");
  expect(run(~0u, 1, LONG_STEPS, 4, LONG_SPEC).digest, LONG_DIGEST, "long run, 1 thread");
  uint32_t avx512 = sv_isa_only(SV_ISA_AVX512);
  if (sv_cpu_isas() & SV_ISA_BIT(SV_ISA_AVX512)) {
    expect(run(avx512, 4, LONG_STEPS, 4, LONG_SPEC).digest, LONG_DIGEST, "long run, AVX-512, 4 threads");
    expect(run(sv_isa_only(SV_ISA_AVX2), 2, LONG_STEPS, 4, LONG_SPEC).digest, LONG_DIGEST, "long run, AVX2");
  }
#else
  print_message("skip the long run: on this machine's kind the short one says the same, and emulation is slow\n");
  skip();
#endif
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_threads),
      cmocka_unit_test(test_instruction_sets),
      cmocka_unit_test(test_long_run),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
