// SPDX-License-Identifier: Apache-2.0
// Counts the heap calls of a whole test program, shared libraries included. A program that includes
// this header is linked with heap_count.c, which takes the place of malloc, calloc, realloc, free
// and the aligned kin (strdup, fopen and the rest of libc reach the heap through those). Under ASan
// and TSan, which bring a heap of their own, their hooks are used instead: they see a realloc as a
// malloc and a free, and TSan's do not see aligned allocations.
//
//   sv_arena_seal(&arena);
//   sv_heap_arm();
//   ... run ...
//   sv_heap_disarm();
//   sv_heap_report();                  // tells who called, when someone did
//   assert_int_equal(sv_heap_count(), 0);
//
// C only
#ifndef SV_TESTS_FAULT_HEAP_COUNT_H
#define SV_TESTS_FAULT_HEAP_COUNT_H

#include <stdbool.h>

// Sets the count to zero and starts counting, on all threads.
void sv_heap_arm(void);
// Stops counting. The count stays readable.
void sv_heap_disarm(void);
// Heap calls (allocations and frees of a block, not free(NULL)) since the last arm.
unsigned long sv_heap_count(void);
// The calling thread's calls are left out while true: for a library that is known to use the heap
// and is counted apart.
void sv_heap_exempt_thread(bool is_exempt);
// Writes who made the first counted calls (at most 16) to stderr. Says nothing when there were
// none.
void sv_heap_report(void);

#endif
