// SPDX-License-Identifier: Apache-2.0
// The kernel checker's frame. A file tests/kernels/check_<op>.c holds one function that exercises
// one op through c->ref (reference table) and c->var (table with the variant under test) and
// registers itself:
//
//   static void check_foo(ck *c) {
//     for (int n = 1; n < 70; n++)
//       for (int fill = 0; fill < CK_N_FILLS; fill++) {
//         ck_begin(c, "n=%d %s", n, ck_fill_name(fill)); // names the case, frees the buffers of
//         the last one
//         float *in = ck_floats(c, n), *a = ck_floats(c, n), *b = ck_floats(c, n);
//         ck_fill(c, in, n, fill);
//         c->ref.foo(in, a, n);
//         c->var.foo(in, b, n);
//         ck_same(c, "out", a, b, n, 1e-6);  // bits, or the tolerance where the variant has no FMA
//       }
//   }
//   static void bench_foo(ck *c) { ... ck_time(c, "1024", 1024, run, &args); }
//   CK_REGISTER(foo, check_foo, bench_foo)
//
// The op name must be the one of variants.inc; an op without a check counts as failed. A crash
// inside a check is caught, named with its case, and counts as failed.
#ifndef SV_TESTS_KERNELS_CHECK_H
#define SV_TESTS_KERNELS_CHECK_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "kernels/kernels.h"
#include "src/base/rng.h"

typedef enum {
  CK_UNIT,   // random in [0, 1)
  CK_SIGNED, // random in [-1, 1), a tenth exact zeros
  CK_FLAT,   // one value everywhere
  CK_BINARY, // only 0 and 1
  CK_DENORM, // denormals and tiny normals of both signs
  CK_HUGE,   // magnitudes 1e15..1e18 (squares stay finite), both signs
  CK_MIXED,  // all the above, value by value
  CK_N_FILLS
} ck_fill_kind;

typedef struct {
  sv_kernels ref, var; // tables: all reference; the ISA under test where it has a variant
  sv_isa isa;
  bool is_exact;      // bits must agree (false: SSE4.1, tolerance)
  bool is_ref_timing; // bench: time c->var as always; var == ref in this pass
  sv_rng rng;
  // the rest belongs to check.c
  const char *op;
  char what[160];
  int n_bad;
  double ref_ns[16];
  int i_time;
} ck;

typedef void (*ck_fn)(ck *c);
typedef struct ck_entry {
  const char *op;
  ck_fn check, bench;
  struct ck_entry *next;
} ck_entry;
void ck_register(ck_entry *e);
#define CK_REGISTER(name, check_fn, bench_fn)                                                                \
  static ck_entry entry_##name = {#name, check_fn, bench_fn, 0};                                             \
  __attribute__((constructor)) static void register_##name(void) { ck_register(&entry_##name); }

// Starts a case: checks the guards of the last one, drops its buffers, and names the new one.
void ck_begin(ck *c, const char *fmt, ...) __attribute__((format(printf, 2, 3)));

// Buffers with guard words on both sides, 64-byte aligned, filled with a pattern that is a NaN as
// float, gone at the next ck_begin. `ck_floats_odd` starts 4 bytes off alignment.
void *ck_bytes(ck *c, size_t bytes);
// The same, not aligned, and ending where the memory ends: reading one byte too far is a crash.
void *ck_bytes_at_end(ck *c, size_t bytes);
float *ck_floats(ck *c, size_t n);
float *ck_floats_odd(ck *c, size_t n);
// Numbers of 16 bits (upper halves of floats): those nearest to floats, and floats of them.
uint16_t *ck_highs(ck *c, const float *from, size_t n);
float *ck_wide(ck *c, const uint16_t *from, size_t n);
// that two of them may differ by, where they are rounded from what differs by a little
#define CK_HIGH_TOL 8e-3
void ck_fill(ck *c, float *p, size_t n, int kind);
void ck_fill_bytes(ck *c, void *p, size_t n); // random bytes with runs of 0 and 255
const char *ck_fill_name(int kind);

// Float arrays: same bits when c->is_exact (any NaN equals any NaN), else |a - b| <= tol * max(1,
// |a|). tol_abs: |a - b| <= tol.
void ck_same(ck *c, const char *name, const float *ref, const float *var, size_t n, double tol);
void ck_same_abs(ck *c, const char *name, const float *ref, const float *var, size_t n, double tol);
void ck_same_bytes(ck *c, const char *name, const void *ref, const void *var, size_t bytes);
void ck_true(ck *c, bool is_ok, const char *fmt, ...) __attribute__((format(printf, 3, 4)));

// Bench: least time of many calls of fn(arg, &c->var), printed as one CSV line; n_items scales it.
void ck_time(ck *c, const char *size, double n_items, void (*fn)(void *arg, const sv_kernels *k), void *arg);

#endif
