// SPDX-License-Identifier: Apache-2.0
// C only: C++ has no _Atomic.
// What a calibration that runs beside a run tells: the block of memory that `subview run` shares
// with `subview-calibrate live`. Owns the layout. Never blocks: the writer's sequence number is odd
// while it writes, and a reader that was overtaken tries again later.
#ifndef SV_PORT_CALIBRATION_H
#define SV_PORT_CALIBRATION_H

#include <stdatomic.h>

#include "src/port/feed.h"

typedef struct {
  _Atomic uint32_t seq;
  _Atomic uint32_t is_enough; // set by the reader: no further images come, or the person says so
  sv_feed_calibration now;
  sv_feed_tiles tiles; // the newest exposure
} sv_calibration_block;

static inline void sv_calibration_write(sv_calibration_block *b, const sv_feed_calibration *now,
                                        const sv_feed_tiles *tiles) {
  const uint32_t seq = atomic_load(&b->seq) | 1;
  atomic_store(&b->seq, seq);
  atomic_thread_fence(memory_order_seq_cst);
  b->now = *now;
  if (tiles) b->tiles = *tiles;
  atomic_thread_fence(memory_order_seq_cst);
  atomic_store(&b->seq, seq + 1);
}

// False: nothing newer than *seen, or it is being written.
static inline bool sv_calibration_read(const sv_calibration_block *b, uint32_t *seen,
                                       sv_feed_calibration *now, sv_feed_tiles *tiles) {
  const uint32_t seq = atomic_load(&b->seq);
  if (seq == *seen || seq & 1) return false;
  atomic_thread_fence(memory_order_seq_cst);
  *now = b->now;
  *tiles = b->tiles;
  atomic_thread_fence(memory_order_seq_cst);
  if (atomic_load(&b->seq) != seq) return false;
  *seen = seq;
  return true;
}

#endif
