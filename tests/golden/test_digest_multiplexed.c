// SPDX-License-Identifier: Apache-2.0
// A whole run on a multiplexed sensor gives the same bits for any number of threads, for every
// instruction set with a fused multiply-add, and on every machine. Who changes the arithmetic of
// training on purpose takes the new digest from what the failing test prints.
#include <stdio.h>

#include "tests/common/test.h"
#include "tests/common/world.h"

#define STEPS  60
#define DIGEST 0x6d71b6e6bf6579cfull

#define SUPPORT 0xab71896cb5490213ull

static world w;
static _Alignas(64) unsigned char room[64 << 10];

// Which lens saw which Gaussian.
static uint64_t support_digest(void) {
  sv_arena a = sv_arena_make(room, sizeof room);
  sv_support s;
  uint64_t h = 14695981039346656037ull;
  assert_int_equal(sv_driver_support(&w.app.trainer, &a, &s), SV_OK);
  assert_int_equal(s.n_views, 2 * 6);
  for (int i = 0; i < s.n; i++) h = (h ^ s.seen[i]) * 1099511628211ull;
  return h;
}

// Odd sizes, noise, total variation of lens images and of novel views, relocation: everything
// takes part.
static void expect(uint32_t isa_mask, int n_threads, const char *what) {
  world_open_well(&w, "textured,rig=multiplexed,grid=2x3,size=100x76,noise=read:1e-4:shot:1e-3", 2, isa_mask,
                  n_threads);
  sv_train_cfg *t = &w.cfg.train;
  t->n_gaussians = 600;
  t->sh_degree = 2;
  t->relocate_every = 10;
  t->lr.logit = 0.3f; // fades what is not needed within a few steps
  t->region_px = 40;
  t->weight_tv = 0.02f;
  t->n_novel = 1;
  t->novel_every = 3;
  t->novel_px = 24;
  t->weight_tv_novel = 0.05f;
  w.cfg.steps = STEPS;
  world_run_well(&w);
  assert_int_equal(world_stats(&w).step, STEPS);
  assert_true(world_stats(&w).n_relocated > 0);
  const uint64_t digest = world_digest(&w), support = support_digest();
  world_close(&w);
  if (digest != DIGEST)
    fail_msg("%s: digest 0x%016llxull, expected 0x%016llxull", what, (unsigned long long)digest,
             (unsigned long long)DIGEST);
  if (support != SUPPORT)
    fail_msg("%s: support 0x%016llxull, expected 0x%016llxull", what, (unsigned long long)support,
             (unsigned long long)SUPPORT);
}

TEST(test_threads) {
  if (is_emulated()) {
    print_message("skip numbers of threads: emulation is slow, and they are the same C here\n");
    skip();
  }
  for (int n = 1; n <= 4; n *= 2) {
    char what[24];
    snprintf(what, sizeof what, "%d threads", n);
    expect(~0u, n, what);
  }
}

TEST(test_instruction_sets) {
  for (int isa = 0; isa < SV_N_ISAS; isa++)
    if ((sv_cpu_isas() & SV_ISA_BIT(isa)) && isa != SV_ISA_SSE41)
      expect(sv_isa_only((sv_isa)isa), 2, sv_isa_name((sv_isa)isa));
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_threads),
      cmocka_unit_test(test_instruction_sets),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
