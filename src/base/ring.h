// SPDX-License-Identifier: Apache-2.0
// C only: C++ has no _Atomic.
// A lock-free ring of fixed-size elements with one writer and one reader.
#ifndef SV_BASE_RING_H
#define SV_BASE_RING_H

#include <stdatomic.h>
#include <stdint.h>

#include "src/base/arena.h"

typedef struct {
  uint8_t *data; // [cap][elem_bytes]
  uint32_t cap, elem_bytes;
  _Atomic uint32_t head; // elements ever written
  _Atomic uint32_t tail; // elements ever read
} sv_ring;

// cap is rounded up to a power of two (at most 2^30).
sv_status sv_ring_init(sv_ring *r, uint32_t cap, uint32_t elem_bytes, sv_arena *arena) SV_MUST_USE;
sv_status sv_ring_push(sv_ring *r, const void *elem) SV_MUST_USE; // AGAIN when full
sv_status sv_ring_pop(sv_ring *r, void *elem) SV_MUST_USE;        // AGAIN when empty
uint32_t sv_ring_count(sv_ring *r);

#endif
