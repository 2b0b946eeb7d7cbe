// SPDX-License-Identifier: Apache-2.0
// A whole run (simulated capture, then training) gives the same bits for any number of threads, for
// every instruction set with a fused multiply-add, and on every machine: the digests stand in this
// file. Who changes the arithmetic of training on purpose takes the new digests from what the
// failing test prints.
#include <math.h>
#include <stdio.h>

#include "tests/common/test.h"
#include "tests/common/world.h"

#define SHORT_STEPS 30
#define LONG_STEPS  300

#define SHORT_DIGEST 0x2412dbb3de98f87cull
#define LONG_DIGEST  0x518177c2381389d0ull

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

// SH of degree 2 and relocation take part in both lengths, unless the run is a calm one.
static outcome run(uint32_t isa_mask, int n_threads, uint32_t steps, int n_exposures, const char *spec,
                   bool is_calm) {
  world_open_well(&w, spec, n_exposures, isa_mask, n_threads);
  w.cfg.train.n_gaussians = 1500;
  w.cfg.train.sh_degree = 2;
  w.cfg.train.relocate_every = 5;
  if (!is_calm) w.cfg.train.lr.logit = 0.3f; // fades what is not needed within a few steps
  w.cfg.steps = steps;
  world_run_well(&w);
  assert_int_equal(world_stats(&w).step, steps);
  assert_true(is_calm || world_stats(&w).n_relocated > 0);
  outcome o = {world_digest(&w), w.app.driver.last.loss};
  world_close(&w);
  return o;
}

// A picture whose sides are no multiples of 16, so that padding takes part.
#define SHORT_SPEC "textured,rig=stereo,size=100x76,noise=read:1e-4:shot:1e-3"
#define LONG_SPEC  "textured,rig=stereo,size=160x120"

static outcome run_short(uint32_t mask, int n_threads) {
  return run(mask, n_threads, SHORT_STEPS, 3, SHORT_SPEC, false);
}

TEST(test_threads) {
  if (is_emulated()) {
    print_message("skip numbers of threads: emulation is slow, and they are the same C here\n");
    skip();
  }
  for (int n = 1; n <= 4; n *= 2) {
    char what[32];
    snprintf(what, sizeof what, "short run, %d threads", n);
    assert_digest(run_short(~0u, n).digest, SHORT_DIGEST, what);
  }
}

// Each instruction set of this CPU alone.
TEST(test_instruction_sets) {
  for (int isa = 0; isa < SV_N_ISAS; isa++) {
    if (!(sv_cpu_isas() & SV_ISA_BIT(isa)) || isa == SV_ISA_SSE41) continue;
    outcome o = run_short(sv_isa_only((sv_isa)isa), 2);
    print_message("%s: digest %016llx, loss %.6f\n", sv_isa_name((sv_isa)isa), (unsigned long long)o.digest,
                  o.loss);
    assert_digest(o.digest, SHORT_DIGEST, sv_isa_name((sv_isa)isa));
  }
}

// Without a fused multiply-add the last bits differ. A relocation turns such a difference into
// another choice of slots, so the losses are compared where there is none.
TEST(test_without_fma) {
  if (!(sv_cpu_isas() & SV_ISA_BIT(SV_ISA_SSE41))) {
    print_message("skip SSE4.1: this CPU or build has none\n");
    skip();
  }
  double ref = run(SV_ISA_BIT(SV_ISA_REF), 2, SHORT_STEPS, 3, SHORT_SPEC, true).loss;
  double sse = run(sv_isa_only(SV_ISA_SSE41), 2, SHORT_STEPS, 3, SHORT_SPEC, true).loss;
  print_message("final loss: reference %.6f, sse41 %.6f\n", ref, sse);
  assert_true(fabs(sse - ref) < 0.02 * ref);
}

TEST(test_long_run) {
  if (IS_SLOW || is_emulated()) {
    print_message("skip the long run: it takes minutes under a sanitizer and under emulation\n");
    skip();
  }
  assert_digest(run(~0u, 2, LONG_STEPS, 4, LONG_SPEC, false).digest, LONG_DIGEST, "long run, 2 threads");
  assert_digest(run(~0u, 1, LONG_STEPS, 4, LONG_SPEC, false).digest, LONG_DIGEST, "long run, 1 thread");
  if (sv_cpu_isas() & SV_ISA_BIT(SV_ISA_AVX512)) // then the runs above were AVX-512
    assert_digest(run(sv_isa_only(SV_ISA_AVX2), 4, LONG_STEPS, 4, LONG_SPEC, false).digest, LONG_DIGEST,
                  "long run, AVX2");
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_threads),
      cmocka_unit_test(test_instruction_sets),
      cmocka_unit_test(test_without_fma),
      cmocka_unit_test(test_long_run),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
