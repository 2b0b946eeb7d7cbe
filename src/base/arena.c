// SPDX-License-Identifier: Apache-2.0
#include "src/base/arena.h"

static void part_add(sv_arena *a, size_t bytes) {
  a->used_bytes += bytes;
  if (a->used_bytes > a->high_bytes) a->high_bytes = a->used_bytes;
  if (a->n_parts == 0) sv_arena_part_begin(a, "other");
  a->parts[a->n_parts - 1].bytes += bytes;
}

sv_arena sv_arena_make(void *block, size_t bytes) {
  sv_arena a = {.cap_bytes = bytes, .base = block};
  size_t off = (size_t)(-(uintptr_t)block & (SV_ARENA_ALIGN - 1));
  if (!block || off > bytes) {
    a.status = SV_E_NOMEM;
    a.cap_bytes = 0;
  } else if (off) {
    sv_arena_part_begin(&a, "align");
    part_add(&a, off);
  }
  return a;
}

sv_arena sv_arena_dry(void) {
  sv_arena a = {.cap_bytes = SIZE_MAX};
  return a;
}

void sv_arena_part_begin(sv_arena *a, const char *name) {
  // When the table is full, the last part takes the rest: the sum stays exact.
  if (a->n_parts == SV_ARENA_CAP_PARTS) return;
  a->parts[a->n_parts++] = (sv_arena_part){name, 0};
}

void *sv_arena_take(sv_arena *a, size_t n, size_t size) {
  if (a->status < 0) return NULL;
  if (a->is_sealed) {
    a->status = SV_E_SEALED;
    return NULL;
  }
  size_t left = a->cap_bytes - a->used_bytes;
  if (size && n > (SIZE_MAX - SV_ARENA_ALIGN) / size) {
    a->status = SV_E_NOMEM;
    return NULL;
  }
  size_t bytes = (n * size + SV_ARENA_ALIGN - 1) & ~(size_t)(SV_ARENA_ALIGN - 1);
  if (bytes > left) {
    a->status = SV_E_NOMEM;
    return NULL;
  }
  uint8_t *p = a->base ? a->base + a->used_bytes : NULL;
  part_add(a, bytes);
  return p;
}

sv_arena sv_arena_sub(sv_arena *a, size_t bytes) {
  void *block = sv_arena_take(a, bytes, 1);
  if (!block && !a->base && a->status >= 0) return sv_arena_dry();
  sv_arena sub = {.base = block, .cap_bytes = block ? bytes : 0, .status = block ? SV_OK : a->status};
  return sub;
}

size_t sv_arena_mark(const sv_arena *a) { return a->used_bytes; }

void sv_arena_reset(sv_arena *a, size_t mark) {
  if (mark > a->used_bytes) return;
  size_t drop = a->used_bytes - mark;
  a->used_bytes = mark;
  for (int i = a->n_parts; i-- > 0 && drop;) {
    size_t d = a->parts[i].bytes < drop ? a->parts[i].bytes : drop;
    a->parts[i].bytes -= d;
    drop -= d;
  }
  if (a->status < 0 && !a->is_sealed) a->status = SV_OK;
}

void sv_arena_seal(sv_arena *a) { a->is_sealed = true; }
