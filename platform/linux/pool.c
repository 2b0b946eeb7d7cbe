// SPDX-License-Identifier: Apache-2.0
#include <linux/futex.h>
#include <limits.h>
#include <signal.h>
#include <string.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

#include "platform/linux/linux.h"

// Core code keeps its frames under 4 KiB and does not recurse.
#define STACK_BYTES (512u << 10)
// Longer than the serial parts of a training step and its longest task on a fast machine: waking a
// sleeper takes 20 to 60 us.
#define SPIN_US 200
// Spins between two readings of the clock, which cost more than a spin.
#define SPINS_PER_LOOK 64
// A task number has 16 bits in a share's word; longer jobs run in pieces of this size.
#define CAP_TASKS 65535

static void relax(void) {
#if defined(__x86_64__) || defined(__i386__)
  __builtin_ia32_pause();
#elif defined(__aarch64__) || defined(__arm__)
  __asm__ volatile("yield");
#endif
}

static int64_t now_ns(void) {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return (int64_t)t.tv_sec * SV_NS_PER_S + t.tv_nsec;
}

static void futex_wait(_Atomic uint32_t *word, uint32_t seen) {
  syscall(SYS_futex, (uint32_t *)word, FUTEX_WAIT_PRIVATE, seen, NULL, NULL, 0);
}

static void futex_wake(_Atomic uint32_t *word, int n) {
  syscall(SYS_futex, (uint32_t *)word, FUTEX_WAKE_PRIVATE, n, NULL, NULL, 0);
}

// Spins until *word differs from `seen` or the spin time is over; true when it changed.
static bool spin_for_change(_Atomic uint32_t *word, uint32_t seen, int64_t spin_ns) {
  if (atomic_load_explicit(word, memory_order_acquire) != seen) return true;
  if (spin_ns <= 0) return false;
  int64_t end_ns = now_ns() + spin_ns;
  do {
    for (int i = 0; i < SPINS_PER_LOOK; i++) {
      if (atomic_load_explicit(word, memory_order_acquire) != seen) return true;
      relax();
    }
  } while (now_ns() < end_ns);
  return false;
}

typedef struct {
  sv_task_fn fn;
  void *arg;
  int i_task;
} taken;

// Takes the first or the last remaining task of w's share. fn and arg are read before the share's
// word is exchanged: if another job began in between, the exchange fails and they are not used.
static bool take(sv_linux_pool *p, sv_linux_worker *w, bool is_own, taken *t) {
  uint64_t left = atomic_load_explicit(&w->left, memory_order_acquire);
  for (;;) {
    const uint32_t first = (uint32_t)(left >> 16) & 0xffff, end = (uint32_t)left & 0xffff;
    if (first >= end) return false;
    t->fn = atomic_load_explicit(&p->fn, memory_order_acquire);
    t->arg = atomic_load_explicit(&p->arg, memory_order_acquire);
    t->i_task = (int)(is_own ? first : end - 1);
    if (atomic_compare_exchange_weak_explicit(&w->left, &left, is_own ? left + (1u << 16) : left - 1,
                                              memory_order_acq_rel, memory_order_acquire))
      return true;
  }
}

// The thread's own share first: its data of the last job is in the cache. Then it steals from
// others.
static bool take_any(sv_linux_pool *p, int i_thread, taken *t) {
  for (int k = 0; k < p->n_threads; k++)
    if (take(p, &p->workers[(i_thread + k) % p->n_threads], k == 0, t)) return true;
  return false;
}

// Works until no tasks remain. A job ends when all threads that took part have added their count
// here, so the count belongs to one job.
static void work(sv_linux_pool *p, int i_thread) {
  uint32_t n = 0;
  for (taken t; take_any(p, i_thread, &t); n++) t.fn(t.arg, t.i_task, i_thread);
  if (n == 0) return;
  const uint32_t n_tasks = atomic_load(&p->n_tasks);
  if (atomic_fetch_add(&p->n_done, n) + n == n_tasks && atomic_load(&p->is_waited)) futex_wake(&p->n_done, 1);
}

static void *worker_main(void *arg) {
  sv_linux_worker *w = arg;
  sv_linux_pool *p = w->pool;
  uint32_t seen = 0; // no job; the pool is not read before the first one
  atomic_fetch_add(&p->n_started, 1);
  futex_wake(&p->n_started, 1);
  for (;;) {
    if (!spin_for_change(&p->i_job, seen, p->spin_ns)) {
      // The count goes up before the kernel compares i_job again: either the caller of the next job
      // sees a sleeper, or the sleeper sees the next job.
      atomic_fetch_add(&p->n_asleep, 1);
      if (atomic_load(&p->i_job) == seen) futex_wait(&p->i_job, seen);
      atomic_fetch_sub(&p->n_asleep, 1);
    }
    if (atomic_load_explicit(&p->is_stopping, memory_order_acquire)) return NULL;
    seen = atomic_load_explicit(&p->i_job, memory_order_acquire);
    work(p, w->i_thread);
  }
}

static void wait_done(sv_linux_pool *p, uint32_t n_tasks) {
  for (;;) {
    uint32_t n_done = atomic_load_explicit(&p->n_done, memory_order_acquire);
    if (n_done == n_tasks) return;
    if (spin_for_change(&p->n_done, n_done, p->spin_ns)) continue;
    atomic_store(&p->is_waited, 1);
    if (atomic_load(&p->n_done) == n_done) futex_wait(&p->n_done, n_done);
    atomic_store(&p->is_waited, 0);
  }
}

// At most CAP_TASKS tasks, from `first` on.
typedef struct {
  sv_task_fn fn;
  void *arg;
  int first;
} part;

static void run_of_part(void *arg, int i_task, int i_thread) {
  const part *of = arg;
  of->fn(of->arg, of->first + i_task, i_thread);
}

static void run_some(sv_linux_pool *p, sv_task_fn fn, void *arg, int n_tasks) {
  const uint64_t i_job = ++p->n_jobs;
  // all shares are empty: nobody reads these
  atomic_store_explicit(&p->fn, fn, memory_order_relaxed);
  atomic_store_explicit(&p->arg, arg, memory_order_relaxed);
  atomic_store_explicit(&p->n_tasks, (uint32_t)n_tasks, memory_order_relaxed);
  atomic_store_explicit(&p->n_done, 0, memory_order_relaxed);
  for (int k = 0; k < p->n_threads; k++) {
    uint64_t first = (uint64_t)sv_pool_share(n_tasks, k, p->n_threads);
    uint64_t end = (uint64_t)sv_pool_share(n_tasks, k + 1, p->n_threads);
    atomic_store_explicit(&p->workers[k].left, i_job << 32 | first << 16 | end, memory_order_release);
  }
  atomic_fetch_add(&p->i_job, 1);
  uint32_t n_asleep = atomic_load(&p->n_asleep);
  if (n_asleep) futex_wake(&p->i_job, n_tasks - 1 < (int)n_asleep ? n_tasks - 1 : (int)n_asleep);
  work(p, 0);
  wait_done(p, (uint32_t)n_tasks);
}

static void run(void *self, sv_task_fn fn, void *arg, int n_tasks) {
  sv_linux_pool *p = self;
  if (p->n_threads == 1 || n_tasks <= 1) {
    for (int i = 0; i < n_tasks; i++) fn(arg, i, 0);
    return;
  }
  if (n_tasks <= CAP_TASKS) {
    run_some(p, fn, arg, n_tasks);
    return;
  }
  for (part some = {fn, arg, 0}; some.first < n_tasks; some.first += CAP_TASKS) {
    int left = n_tasks - some.first;
    run_some(p, run_of_part, &some, left < CAP_TASKS ? left : CAP_TASKS);
  }
}

static sv_status start_worker(sv_linux_pool *p, int i_thread) {
  pthread_attr_t attr;
  if (pthread_attr_init(&attr)) return SV_E_NOMEM;
  p->workers[i_thread] = (sv_linux_worker){.pool = p, .i_thread = i_thread};
  int failed = pthread_attr_setstacksize(&attr, STACK_BYTES);
  if (!failed) failed = pthread_create(&p->workers[i_thread].id, &attr, worker_main, &p->workers[i_thread]);
  pthread_attr_destroy(&attr);
  return failed ? SV_E_NOMEM : SV_OK;
}

sv_status sv_linux_pool_start(sv_linux_pool *p, int n_threads, int spin_us, sv_err *err) {
  if (n_threads < 1 || n_threads > SV_LINUX_CAP_THREADS)
    return sv_fail(err, SV_E_ARG, "threads: %d asked for, 1 to %d are possible", n_threads,
                   SV_LINUX_CAP_THREADS);
  memset(p, 0, sizeof *p);
  p->n_threads = 1;
  // On a single core a spinning thread only keeps the one it waits for from running.
  if (spin_us < 0) spin_us = sysconf(_SC_NPROCESSORS_ONLN) > 1 ? SPIN_US : 0;
  p->spin_ns = (int64_t)spin_us * SV_NS_PER_US;
  sigset_t all, old;
  sigfillset(&all);
  pthread_sigmask(SIG_SETMASK, &all, &old); // threads inherit the mask
  sv_status s = SV_OK;
  for (int i = 1; i < n_threads && s == SV_OK; i++) {
    s = start_worker(p, i);
    if (s == SV_OK) p->n_threads++;
  }
  pthread_sigmask(SIG_SETMASK, &old, NULL);
  // Wait until every thread has started: a sanitizer's runtime allocates at a thread's start.
  for (uint32_t seen; (seen = atomic_load(&p->n_started)) + 1 < (uint32_t)p->n_threads;)
    futex_wait(&p->n_started, seen);
  if (s == SV_OK) return s;
  int n_made = p->n_threads;
  sv_linux_pool_stop(p);
  return sv_fail(err, s, "threads: the system gave %d of the %d asked for", n_made, n_threads);
}

sv_pool sv_linux_pool_port(sv_linux_pool *p) {
  return (sv_pool){.self = p, .n_threads = p->n_threads, .run = run};
}

void sv_linux_pool_stop(sv_linux_pool *p) {
  atomic_store(&p->is_stopping, true);
  atomic_fetch_add(&p->i_job, 1);
  futex_wake(&p->i_job, INT_MAX);
  for (int i = 1; i < p->n_threads; i++) pthread_join(p->workers[i].id, NULL);
  p->n_threads = 1;
}
