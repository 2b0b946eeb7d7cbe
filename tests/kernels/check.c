// SPDX-License-Identifier: Apache-2.0
// kernels-check: every variant of every op against its reference.
//   kernels-check [--bench] [--op NAME]    SV_ISA=avx2 (or ref, sse41, ...) pins one ISA
// Ends with "N passed, N failed, N skipped"; one count per (op, variant). Exit code 1 on a failure.
#include "tests/kernels/check.h"

#include <math.h>
#include <setjmp.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <time.h>
#include <unistd.h>

#include "kernels/simd/s1_math.h"

#define GUARD_BYTES 128
#define CAP_BUFS    64
#define GUARD_BYTE  0xd7
#define FRESH_BYTE  0xff // as a float: NaN

static ck_entry *entries;
static struct {
  uint8_t *block, *user;
  size_t bytes, total; // total: user buffer and guards
  size_t mapped_bytes; // not 0: from mmap, with a page that must not be touched behind the total
} bufs[CAP_BUFS];
static int n_bufs;
static sigjmp_buf crash_jump;
static volatile sig_atomic_t crash_signal;

void ck_register(ck_entry *e) { // kept sorted by name, so that link order does not matter
  ck_entry **at = &entries;
  while (*at && strcmp((*at)->op, e->op) < 0) at = &(*at)->next;
  e->next = *at;
  *at = e;
}

static void on_crash(int sig) {
  crash_signal = sig;
  siglongjmp(crash_jump, 1);
}

// --- buffers ----------------------------------------
static void bad(ck *c, const char *fmt, ...) {
  va_list ap;
  if (c->n_bad++ >= 5) return; // the first five say enough
  printf("  FAIL %s %s [%s]: ", c->op, sv_isa_name(c->isa), c->what);
  va_start(ap, fmt);
  vprintf(fmt, ap);
  va_end(ap);
  putchar('\n');
}

static void drop_buffers(ck *c) {
  for (int i = 0; i < n_bufs; i++) {
    uint8_t *lo = bufs[i].block, *hi = bufs[i].user + bufs[i].bytes, *end = lo + bufs[i].total;
    for (uint8_t *p = lo; c && p < end; p++) {
      if (p >= bufs[i].user && p < hi) p = hi;
      if (p == end || *p == GUARD_BYTE) continue;
      long off = p < bufs[i].user ? (long)(p - bufs[i].user) : (long)(p - hi);
      bad(c, "buffer %d of %zu bytes: guard broken %ld bytes %s it", i, bufs[i].bytes, labs(off),
          p < bufs[i].user ? "before" : "after the end of");
      break;
    }
    if (bufs[i].mapped_bytes) munmap(bufs[i].block, bufs[i].mapped_bytes);
    else free(bufs[i].block);
  }
  n_bufs = 0;
}

static void *enter(uint8_t *block, size_t total, uint8_t *user, size_t bytes, size_t mapped_bytes) {
  memset(block, GUARD_BYTE, total);
  memset(user, FRESH_BYTE, bytes);
  bufs[n_bufs].block = block;
  bufs[n_bufs].user = user;
  bufs[n_bufs].bytes = bytes;
  bufs[n_bufs].mapped_bytes = mapped_bytes;
  bufs[n_bufs++].total = total;
  return user;
}

static void give_up(const char *why) {
  fprintf(stderr, "kernels-check: %s\n", why);
  exit(2);
}

static void *take(size_t bytes, size_t shift) {
  size_t total = (bytes + shift + 3 * GUARD_BYTES + 63) & ~(size_t)63;
  uint8_t *block = aligned_alloc(64, total);
  if (n_bufs == CAP_BUFS) give_up("too many buffers in one case");
  if (!block) give_up("out of memory");
  return enter(block, total, block + GUARD_BYTES + shift, bytes, 0);
}

void *ck_bytes_at_end(ck *c, size_t bytes) {
  size_t page = (size_t)sysconf(_SC_PAGESIZE), total = (bytes + GUARD_BYTES + page - 1) / page * page;
  uint8_t *block = mmap(NULL, total + page, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  (void)c;
  if (n_bufs == CAP_BUFS) give_up("too many buffers in one case");
  if (block == MAP_FAILED || mprotect(block + total, page, PROT_NONE)) give_up("out of memory");
  return enter(block, total, block + total - bytes, bytes, total + page);
}

void *ck_bytes(ck *c, size_t bytes) { return (void)c, take(bytes, 0); }
float *ck_floats(ck *c, size_t n) { return (void)c, take(n * sizeof(float), 0); }
float *ck_floats_odd(ck *c, size_t n) { return (void)c, take(n * sizeof(float), 4); }

uint16_t *ck_highs(ck *c, const float *from, size_t n) {
  uint16_t *to = ck_bytes(c, n * sizeof *to);
  for (size_t i = 0; i < n; i++) to[i] = s1_high(from[i]);
  return to;
}

float *ck_wide(ck *c, const uint16_t *from, size_t n) {
  float *to = ck_floats(c, n);
  for (size_t i = 0; i < n; i++) to[i] = s1_from_high(from[i]);
  return to;
}

void ck_begin(ck *c, const char *fmt, ...) {
  va_list ap;
  drop_buffers(c);
  va_start(ap, fmt);
  vsnprintf(c->what, sizeof c->what, fmt, ap);
  va_end(ap);
}

// --- fills ----------------------------------------
static const char *const fill_names[CK_N_FILLS] = {"unit",   "signed", "flat", "binary",
                                                   "denorm", "huge",   "mixed"};
const char *ck_fill_name(int kind) { return fill_names[kind]; }

static float one_value(sv_rng *r, int kind, float flat) {
  float u = sv_rng_f(r);
  float sign = sv_rng_u32(r) & 1 ? -1.0f : 1.0f;
  switch (kind) {
  case CK_SIGNED: return sv_rng_below(r, 10) == 0 ? 0.0f : 2.0f * u - 1.0f;
  case CK_FLAT: return flat;
  case CK_BINARY: return u < 0.5f ? 0.0f : 1.0f;
  case CK_DENORM: return sign * u * (sv_rng_u32(r) & 1 ? 1e-38f : 1e-41f);
  case CK_HUGE: return sign * (1e15f + u * 1e18f);
  default: return u;
  }
}

void ck_fill(ck *c, float *p, size_t n, int kind) {
  float flat = sv_rng_f(&c->rng);
  for (size_t i = 0; i < n; i++)
    p[i] = one_value(&c->rng, kind == CK_MIXED ? (int)sv_rng_below(&c->rng, CK_MIXED) : kind, flat);
}

void ck_fill_bytes(ck *c, void *p, size_t n) {
  uint8_t *b = p;
  for (size_t i = 0; i < n; i++) {
    uint32_t v = sv_rng_u32(&c->rng);
    b[i] = v >> 29 == 0 ? 0 : v >> 29 == 1 ? 255 : (uint8_t)v;
  }
}

// --- comparisons ----------------------------------------
static uint32_t float_bits(float x) {
  uint32_t b;
  memcpy(&b, &x, 4);
  return b;
}

typedef struct {
  double tol;
  bool is_abs; // else relative, of values above 1
} tolerance;

static void same(ck *c, const char *name, const float *ref, const float *var, size_t n, tolerance t) {
  for (size_t i = 0; i < n; i++) {
    if (float_bits(ref[i]) == float_bits(var[i]) || (isnan(ref[i]) && isnan(var[i]))) continue;
    double scale = t.is_abs ? 1 : fmax(1, fabs(ref[i]));
    if (!c->is_exact && (fabs((double)ref[i] - var[i]) <= t.tol * scale)) continue;
    bad(c, "%s[%zu] of %zu: reference %.9g, variant %.9g", name, i, n, ref[i], var[i]);
    return;
  }
}

void ck_same(ck *c, const char *name, const float *ref, const float *var, size_t n, double tol) {
  same(c, name, ref, var, n, (tolerance){tol, false});
}
void ck_same_abs(ck *c, const char *name, const float *ref, const float *var, size_t n, double tol) {
  same(c, name, ref, var, n, (tolerance){tol, true});
}

void ck_same_bytes(ck *c, const char *name, const void *ref, const void *var, size_t bytes) {
  const uint8_t *a = ref, *b = var;
  for (size_t i = 0; i < bytes; i++)
    if (a[i] != b[i]) {
      bad(c, "%s byte %zu of %zu: reference %u, variant %u", name, i, bytes, a[i], b[i]);
      return;
    }
}

void ck_true(ck *c, bool is_ok, const char *fmt, ...) {
  char text[200];
  va_list ap;
  if (is_ok) return;
  va_start(ap, fmt);
  vsnprintf(text, sizeof text, fmt, ap);
  va_end(ap);
  bad(c, "%s", text);
}

// --- bench ----------------------------------------
static double now_ns(void) { // CPU time of this thread: other programs on the machine do not count
  struct timespec t;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return 1e9 * (double)t.tv_sec + (double)t.tv_nsec;
}

void ck_time(ck *c, const char *size, double n_items, void (*fn)(void *arg, const sv_kernels *k), void *arg) {
  double best = INFINITY, total = 0;
  for (int run = 0; run < 5 || (total < 2e8 && run < 20000); run++) {
    double t0 = now_ns();
    fn(arg, &c->var);
    double t = now_ns() - t0;
    total += t;
    if (t < best) best = t;
  }
  int i = c->i_time++;
  if (i >= 16) return;
  if (c->is_ref_timing) c->ref_ns[i] = best;
  printf("%s,%s,%s,%.4f,%.2f\n", c->op, sv_isa_name(c->isa), size, best / n_items, c->ref_ns[i] / best);
  fflush(stdout);
}

// --- the list ----------------------------------------
typedef struct {
  const char *op;
  unsigned isas; // bit per variant, reference included
} op_info;

static const op_info ops[] = {
#define OP(name) {#name, 1},
#define VARIANT(name, isa_lower, isa_upper)
#include "kernels/variants.inc"
    {0, 0}};

static const struct {
  const char *op;
  sv_isa isa;
} variants[] = {
#define OP(name)
#define VARIANT(name, isa_lower, isa_upper) {#name, SV_ISA_##isa_upper},
#include "kernels/variants.inc"
    {0, SV_ISA_REF}};

static unsigned isas_of(const char *op) {
  unsigned m = SV_ISA_BIT(SV_ISA_REF);
  for (size_t i = 0; variants[i].op; i++)
    if (!strcmp(variants[i].op, op)) m |= SV_ISA_BIT(variants[i].isa);
  return m;
}

static const ck_entry *entry_of(const char *op) {
  for (const ck_entry *e = entries; e; e = e->next)
    if (!strcmp(e->op, op)) return e;
  return NULL;
}

static const char *signal_name(int s) {
  return s == SIGSEGV ? "SIGSEGV" : s == SIGILL ? "SIGILL" : s == SIGFPE ? "SIGFPE" : "SIGBUS";
}

// One op on one ISA; true when it passed.
static bool run_one(const ck_entry *e, sv_isa isa, bool is_bench, double ref_ns[16]) {
  static ck c; // static: its contents survive the jump out of a crash
  memset(&c, 0, sizeof c);
  sv_kernels_init(&c.ref, SV_ISA_BIT(SV_ISA_REF));
  sv_kernels_init(&c.var, sv_isa_only(isa));
  c.isa = isa;
  c.is_exact = isa != SV_ISA_SSE41;
  c.is_ref_timing = isa == SV_ISA_REF;
  c.op = e->op;
  c.rng = sv_rng_make(20240607, 54);
  memcpy(c.ref_ns, ref_ns, sizeof c.ref_ns);
  if (sigsetjmp(crash_jump, 1) == 0) {
    if (is_bench) {
      if (e->bench) e->bench(&c);
    } else {
      e->check(&c);
    }
    drop_buffers(is_bench ? NULL : &c);
  } else {
    bad(&c, "crash: %s", signal_name((int)crash_signal));
    n_bufs = 0; // the heap may be damaged: leave the buffers alone
  }
  memcpy(ref_ns, c.ref_ns, sizeof c.ref_ns);
  return c.n_bad == 0;
}

typedef struct {
  int n_passed, n_failed, n_skipped;
} tally;

static void run_op(const char *op, uint32_t allowed, const char *pin, bool is_bench, tally *t) {
  const ck_entry *e = entry_of(op);
  const unsigned have = e && !strncmp(op, "v16", 3) ? ~0u : isas_of(op);
  double ref_ns[16] = {0};
  if (!e) {
    printf("FAIL %s: no check registered, add tests/kernels/check_%s.c\n", op, op);
    t->n_failed++;
    return;
  }
  for (int i = 0; i < SV_N_ISAS; i++) {
    if (!(have & SV_ISA_BIT(i)) || (is_bench && !e->bench)) continue;
    const char *why = !(sv_cpu_isas() & SV_ISA_BIT(i)) ? "not built in or not on this CPU"
                      : !(allowed & SV_ISA_BIT(i))     ? pin
                                                       : NULL;
    if (why) {
      if (!is_bench) printf("skip %s: %s (%s)\n", sv_isa_name((sv_isa)i), why, op);
      t->n_skipped++;
      continue;
    }
    bool is_ok = run_one(e, (sv_isa)i, is_bench, ref_ns);
    if (!is_bench) printf("%s %-16s %s\n", is_ok ? "ok  " : "FAIL", op, sv_isa_name((sv_isa)i));
    *(is_ok ? &t->n_passed : &t->n_failed) += 1;
  }
}

int main(int argc, char **argv) {
  bool is_bench = false;
  const char *only = NULL, *env = getenv("SV_ISA");
  char pin[64] = "";
  for (int i = 1; i < argc; i++) {
    if (!strcmp(argv[i], "--bench")) is_bench = true;
    else if (!strcmp(argv[i], "--op") && i + 1 < argc) only = argv[++i];
    else {
      fprintf(stderr, "usage: kernels-check [--bench] [--op NAME]   (SV_ISA=NAME pins one ISA)\n");
      return 2;
    }
  }
  uint32_t allowed = ~0u;
  if (env && *env) {
    int isa = sv_isa_by_name(env);
    if (isa < 0) {
      fprintf(stderr, "SV_ISA=%s: unknown, expected ref, sse41, avx2, avx512 or neon\n", env);
      return 2;
    }
    allowed = sv_isa_only((sv_isa)isa);
    snprintf(pin, sizeof pin, "SV_ISA=%s pins another", env);
  }
  const int signals[] = {SIGSEGV, SIGILL, SIGFPE, SIGBUS};
  for (int i = 0; i < 4; i++) {
    struct sigaction sa = {.sa_handler = on_crash, .sa_flags = SA_NODEFER};
    sigaction(signals[i], &sa, NULL);
  }
  tally t = {0};
  if (is_bench) puts("op,variant,size,ns_per_item,speedup_over_ref");
  for (size_t i = 0; ops[i].op; i++)
    if (!only || !strcmp(only, ops[i].op)) run_op(ops[i].op, allowed, pin, is_bench, &t);
  // checks of things that are no ops: the vector vocabulary
  for (const ck_entry *e = entries; e; e = e->next)
    if (!strncmp(e->op, "v16", 3) && (!only || !strcmp(only, e->op)))
      run_op(e->op, allowed, pin, is_bench, &t);
  if (only && !t.n_passed && !t.n_failed && !t.n_skipped) {
    printf("FAIL %s: no such op\n", only);
    t.n_failed++;
  }
  printf("%d passed, %d failed, %d skipped\n", t.n_passed, t.n_failed, t.n_skipped);
  return t.n_failed ? 1 : 0;
}
