// SPDX-License-Identifier: Apache-2.0
// The heap counter must see every way to the heap, or a "no heap" test that passes would prove
// nothing.
#include <errno.h>
#include <pthread.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "tests/common/test.h"
#include "tests/fault/heap_count.h"

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define IS_SANITIZED 1
#else
#define IS_SANITIZED 0
#endif

// Keeps the compiler from removing an allocation nobody reads.
static void *volatile g_keep;

TEST(counts_only_while_armed) {
  g_keep = malloc(8);
  sv_heap_arm();
  assert_int_equal(sv_heap_count(), 0);
  sv_heap_disarm();
  free(g_keep);
  g_keep = malloc(8);
  unsigned long n = sv_heap_count();
  free(g_keep);
  assert_int_equal(n, 0);
}

// Every entry of the family, each one allocation and one free.
static void *by_malloc(void) { return malloc(100); }
static void *by_calloc(void) { return calloc(3, 50); }
static void *by_realloc(void) { return realloc(NULL, 70); }
static void *by_reallocarray(void) { return reallocarray(NULL, 7, 10); }
static void *by_aligned_alloc(void) { return aligned_alloc(64, 128); }
static void *by_posix_memalign(void) {
  void *p = NULL;
  return posix_memalign(&p, 64, 100) == 0 ? p : NULL;
}
static void *by_strdup(void) { return strdup("twelve bytes"); }
static void *by_getline(void) { // inside libc, where no source of ours is compiled
  char *line = NULL;
  size_t cap = 0;
  FILE *f = fopen("/proc/self/status", "r");
  if (!f) return NULL;
  ssize_t got = getline(&line, &cap, f);
  fclose(f);
  return got > 0 ? line : NULL;
}

TEST(sees_every_way) {
  static const struct {
    const char *name;
    void *(*take)(void);
  } ways[] = {{"malloc", by_malloc},
              {"calloc", by_calloc},
              {"realloc", by_realloc},
              {"reallocarray", by_reallocarray},
#ifndef __SANITIZE_THREAD__ // gcc 12's TSan does not tell its hooks about these
              {"aligned_alloc", by_aligned_alloc},
              {"posix_memalign", by_posix_memalign},
#endif
              {"strdup", by_strdup},
              {"getline", by_getline}};
  for (size_t i = 0; i < sizeof ways / sizeof ways[0]; i++) {
    sv_heap_arm();
    g_keep = ways[i].take();
    unsigned long n_take = sv_heap_count();
    bool is_there = g_keep != NULL;
    free(g_keep);
    unsigned long n_all = sv_heap_count();
    sv_heap_disarm();
    if (!is_there || n_take < 1 || n_all <= n_take)
      fail_msg("%s: %lu calls counted, %lu with free", ways[i].name, n_take, n_all);
  }
}

TEST(memory_is_good) {
  void *p = NULL;
#if !IS_SANITIZED // sanitizers end the program for it
  assert_int_equal(posix_memalign(&p, 3, 100), EINVAL);
#endif
  assert_int_equal(posix_memalign(&p, 256, 100), 0);
  assert_int_equal((uintptr_t)p % 256, 0);
  memset(p, 0x5a, 100);
  free(p);
  unsigned char *z = calloc(1000, 3);
  assert_non_null(z);
  for (int i = 0; i < 3000; i++) assert_int_equal(z[i], 0);
  unsigned char *larger = realloc(z, 9000);
  assert_non_null(larger);
  assert_int_equal(larger[2999], 0);
  free(larger);
  free(NULL);
}

static void *thread_takes(void *arg) {
  sv_heap_exempt_thread(*(const bool *)arg);
  void *volatile p = malloc(33);
  free(p);
  return NULL;
}

static unsigned long calls_of_a_thread(bool is_exempt) {
  pthread_t t;
  // pthread_create allocates on the caller, so the caller is left out.
  sv_heap_exempt_thread(true);
  sv_heap_arm();
  int made = pthread_create(&t, NULL, thread_takes, &is_exempt);
  if (made == 0) pthread_join(t, NULL);
  sv_heap_disarm();
  sv_heap_exempt_thread(false);
  assert_int_equal(made, 0);
  return sv_heap_count();
}

TEST(threads_count_unless_exempt) { assert_true(calls_of_a_thread(false) >= calls_of_a_thread(true) + 2); }

TEST(report_names_calls) {
  sv_heap_arm();
  for (int i = 0; i < 20; i++) {
    g_keep = malloc(4321);
    free(g_keep);
  }
  sv_heap_disarm();
  char text[8192] = "";
  FILE *f = tmpfile();
  assert_non_null(f);
  fflush(stderr);
  int err = dup(2);
  assert_true(err >= 0 && dup2(fileno(f), 2) == 2);
  sv_heap_report();
  fflush(stderr);
  assert_int_equal(dup2(err, 2), 2);
  close(err);
  rewind(f);
  size_t n = fread(text, 1, sizeof text - 1, f);
  fclose(f);
  text[n] = 0;
  assert_contains(text, "heap call 1: malloc of 4321 bytes");
  assert_contains(text, "and 24 heap calls more");
  assert_int_equal(sv_heap_count(), 40); // the report's own work is not counted
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(counts_only_while_armed),
                                     cmocka_unit_test(sees_every_way), cmocka_unit_test(memory_is_good),
                                     cmocka_unit_test(threads_count_unless_exempt),
                                     cmocka_unit_test(report_names_calls)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
