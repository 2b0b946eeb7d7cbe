// SPDX-License-Identifier: Apache-2.0
// The arena: one fixed memory block, carved at start and then sealed.
// Owns no memory: the caller passes the block in. The same carving code runs on a dry arena to
// learn the size, so sizing and layout cannot disagree. Never allocates, never frees a single part,
// and takes nothing after the seal.
#ifndef SV_BASE_ARENA_H
#define SV_BASE_ARENA_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "src/base/status.h"

#ifdef __cplusplus
extern "C" {
#endif

// every take starts on a cache line, which is also the widest vector's alignment
#define SV_ARENA_ALIGN     64
#define SV_ARENA_CAP_PARTS 48

typedef struct {
  const char *name;
  size_t bytes; // padding included: the parts add up to used_bytes exactly
} sv_arena_part;

typedef struct {
  uint8_t *base; // NULL when dry
  size_t cap_bytes, used_bytes, high_bytes;
  bool is_sealed;
  sv_status status; // first failure of a take, sticky
  int n_parts;
  sv_arena_part parts[SV_ARENA_CAP_PARTS];
} sv_arena;

// An arena over a caller's block; the base moves up to the alignment; the loss counts as the part
// "align".
sv_arena sv_arena_make(void *block, size_t bytes);
// A dry arena only counts: takes return NULL and never fail.
sv_arena sv_arena_dry(void);

// Names the memory taken from here on, until the next call (a part of the memory map).
void sv_arena_part_begin(sv_arena *a, const char *name);

// n elements of `size` bytes, 64-byte aligned, not cleared. Returns NULL on a dry arena (keep the
// pointer, do not use it) and after a failure; a->status is then E_NOMEM or E_SEALED.
void *sv_arena_take(sv_arena *a, size_t n, size_t size);
#define SV_TAKE(arena, type, n) ((type *)sv_arena_take((arena), (size_t)(n), sizeof(type)))

// A smaller arena inside this one, for scratch with mark and reset.
sv_arena sv_arena_sub(sv_arena *a, size_t bytes);
size_t sv_arena_mark(const sv_arena *a);
void sv_arena_reset(sv_arena *a, size_t mark); // back to a mark; also clears the sticky status

void sv_arena_seal(sv_arena *a);

#ifdef __cplusplus
}
#endif
#endif
