// SPDX-License-Identifier: Apache-2.0
// The ring between two threads, for many operations: nothing is lost, nothing comes twice or out of
// order. Meant for a build with SAN=thread (make ring-stress).
//
// ring-stress OPERATIONS
#include <pthread.h>
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>

#include "src/base/ring.h"

#define CAP 64

static sv_ring ring;
static uint64_t n_elements;

typedef struct {
  uint64_t i, square; // both change together
} element;

static void *write_all(void *arg) {
  (void)arg;
  for (uint64_t i = 0; i < n_elements;) {
    const element e = {i, i * i};
    if (sv_ring_push(&ring, &e) == SV_OK) i++;
    else sched_yield();
  }
  return NULL;
}

int main(int argc, char **argv) {
  static _Alignas(SV_ARENA_ALIGN) uint8_t block[1 << 16];
  sv_arena a = sv_arena_make(block, sizeof block);
  pthread_t writer;
  n_elements = argc == 2 ? strtoull(argv[1], NULL, 10) / 2 : 0; // each is pushed and popped
  if (!n_elements) {
    fprintf(stderr, "usage: ring-stress OPERATIONS\n");
    return 2;
  }
  if (sv_ring_init(&ring, CAP, sizeof(element), &a) < 0 || pthread_create(&writer, NULL, write_all, NULL))
    return 1;
  for (uint64_t i = 0; i < n_elements;) {
    element e;
    if (sv_ring_pop(&ring, &e) != SV_OK) {
      sched_yield();
      continue;
    }
    if (e.i != i || e.square != i * i) {
      printf("FAILED: element %llu is %llu\n", (unsigned long long)i, (unsigned long long)e.i);
      return 1;
    }
    i++;
  }
  pthread_join(writer, NULL);
  printf("passed: %llu operations\n", 2 * (unsigned long long)n_elements);
  return 0;
}
