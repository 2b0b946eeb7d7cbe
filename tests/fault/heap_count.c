// SPDX-License-Identifier: Apache-2.0
#include "tests/fault/heap_count.h"

#include <dlfcn.h>
#include <errno.h>
#include <stdatomic.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

#define CAP_CALLS 16

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define USE_HOOKS 1
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define USE_HOOKS 1
#endif
#endif
#ifndef USE_HOOKS
#define USE_HOOKS 0
#endif

typedef struct {
  const char *what;
  void *caller;
  size_t bytes;
} heap_call;

// Plain counters and a fixed list: this code runs inside malloc and must not need it.
static atomic_bool g_is_armed;
static atomic_ulong g_count;
static heap_call g_calls[CAP_CALLS];
static _Thread_local bool t_is_exempt;

static void count(const char *what, size_t bytes, void *caller) {
  if (!atomic_load_explicit(&g_is_armed, memory_order_relaxed) || t_is_exempt) return;
  unsigned long i = atomic_fetch_add(&g_count, 1);
  if (i < CAP_CALLS) g_calls[i] = (heap_call){what, caller, bytes};
}

#if USE_HOOKS

// sanitizer/allocator_interface.h; declared here because TSan-only machines may lack the header.
int __sanitizer_install_malloc_and_free_hooks(void (*malloc_hook)(const volatile void *, size_t),
                                              void (*free_hook)(const volatile void *));

static void on_malloc(const volatile void *p, size_t bytes) {
  (void)p;
  count("malloc", bytes, NULL);
}
static void on_free(const volatile void *p) {
  if (p) count("free", 0, NULL);
}
static void install(void) {
  static atomic_bool is_installed;
  if (atomic_exchange(&is_installed, true)) return;
  if (__sanitizer_install_malloc_and_free_hooks(on_malloc, on_free) == 0) {
    fputs("heap_count: the sanitizer has no room for another malloc hook\n", stderr);
    abort(); // counting nothing would look like a pass
  }
}

#else

// glibc's own entry points, which stay reachable under these names.
void *__libc_malloc(size_t bytes);
void *__libc_calloc(size_t n, size_t bytes);
void *__libc_realloc(void *p, size_t bytes);
void *__libc_memalign(size_t align, size_t bytes);
void __libc_free(void *p);

static void install(void) {}

#define CALLER __builtin_return_address(0)

void *malloc(size_t bytes) {
  count("malloc", bytes, CALLER);
  return __libc_malloc(bytes);
}
void *calloc(size_t n, size_t bytes) {
  count("calloc", n * bytes, CALLER);
  return __libc_calloc(n, bytes);
}
void *realloc(void *p, size_t bytes) {
  count("realloc", bytes, CALLER);
  return __libc_realloc(p, bytes);
}
void *reallocarray(void *p, size_t n, size_t bytes) {
  size_t total;
  count("reallocarray", n * bytes, CALLER);
  if (__builtin_mul_overflow(n, bytes, &total)) {
    errno = ENOMEM;
    return NULL;
  }
  return __libc_realloc(p, total);
}
void free(void *p) {
  if (p) count("free", 0, CALLER);
  __libc_free(p);
}
void *memalign(size_t align, size_t bytes) {
  count("memalign", bytes, CALLER);
  return __libc_memalign(align, bytes);
}
void *aligned_alloc(size_t align, size_t bytes) {
  count("aligned_alloc", bytes, CALLER);
  return __libc_memalign(align, bytes);
}
void *valloc(size_t bytes) {
  count("valloc", bytes, CALLER);
  return __libc_memalign(4096, bytes);
}
int posix_memalign(void **out, size_t align, size_t bytes) {
  count("posix_memalign", bytes, CALLER);
  if (align < sizeof(void *) || (align & (align - 1)) != 0) return EINVAL;
  void *p = __libc_memalign(align, bytes);
  if (!p) return ENOMEM;
  *out = p;
  return 0;
}

#endif

void sv_heap_arm(void) {
  install();
  atomic_store(&g_count, 0);
  atomic_store(&g_is_armed, true);
}

void sv_heap_disarm(void) { atomic_store(&g_is_armed, false); }

unsigned long sv_heap_count(void) { return atomic_load(&g_count); }

void sv_heap_exempt_thread(bool is_exempt) { t_is_exempt = is_exempt; }

void sv_heap_report(void) {
  bool was_armed = atomic_exchange(&g_is_armed, false); // stdio and dladdr may use the heap
  unsigned long n = sv_heap_count();
  for (unsigned long i = 0; i < n && i < CAP_CALLS; i++) {
    Dl_info at = {0};
    bool is_known = g_calls[i].caller && dladdr(g_calls[i].caller, &at) != 0;
    fprintf(stderr, "heap call %lu: %s of %zu bytes by %s (%s+0x%zx)\n", i + 1, g_calls[i].what,
            g_calls[i].bytes, is_known && at.dli_sname ? at.dli_sname : "?", is_known ? at.dli_fname : "?",
            is_known ? (size_t)((uintptr_t)g_calls[i].caller - (uintptr_t)at.dli_fbase) : 0);
  }
  if (n > CAP_CALLS) fprintf(stderr, "and %lu heap calls more\n", n - CAP_CALLS);
  atomic_store(&g_is_armed, was_armed);
}
