// SPDX-License-Identifier: Apache-2.0
#include "src/base/ring.h"

#include <string.h>

sv_status sv_ring_init(sv_ring *r, uint32_t cap, uint32_t elem_bytes, sv_arena *arena) {
  uint32_t c = 1;
  if (cap == 0 || cap > (1u << 30) || elem_bytes == 0) return SV_E_ARG;
  while (c < cap) c *= 2;
  r->cap = c;
  r->elem_bytes = elem_bytes;
  atomic_init(&r->head, 0);
  atomic_init(&r->tail, 0);
  r->data = sv_arena_take(arena, c, elem_bytes);
  return arena->status < 0 ? arena->status : SV_OK;
}

sv_status sv_ring_push(sv_ring *r, const void *elem) {
  uint32_t head = atomic_load_explicit(&r->head, memory_order_relaxed);
  uint32_t tail = atomic_load_explicit(&r->tail, memory_order_acquire);
  if (head - tail == r->cap) return SV_AGAIN;
  memcpy(r->data + (size_t)(head & (r->cap - 1)) * r->elem_bytes, elem, r->elem_bytes);
  atomic_store_explicit(&r->head, head + 1, memory_order_release);
  return SV_OK;
}

sv_status sv_ring_pop(sv_ring *r, void *elem) {
  uint32_t tail = atomic_load_explicit(&r->tail, memory_order_relaxed);
  uint32_t head = atomic_load_explicit(&r->head, memory_order_acquire);
  if (head == tail) return SV_AGAIN;
  memcpy(elem, r->data + (size_t)(tail & (r->cap - 1)) * r->elem_bytes, r->elem_bytes);
  atomic_store_explicit(&r->tail, tail + 1, memory_order_release);
  return SV_OK;
}

uint32_t sv_ring_count(sv_ring *r) {
  uint32_t tail = atomic_load_explicit(&r->tail, memory_order_acquire);
  return atomic_load_explicit(&r->head, memory_order_acquire) - tail;
}
