// SPDX-License-Identifier: Apache-2.0
// The memory of an instance: one block of the caller, divided once by subview_init.
// Owns: nothing. The block belongs to the caller and may be static.
// Never: allocates, grows or frees.
#ifndef SUBVIEW_ARENA_H
#define SUBVIEW_ARENA_H

#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

// A block with this alignment loses no bytes. Others are accepted: subview_bytes includes the
// padding.
#define SUBVIEW_ALIGN 64

// One entry of the memory map. The entries add up to what is used of the block, padding included.
typedef struct {
  const char *name; // such as "model", "renderer", "exposures"
  size_t bytes;
} subview_part;

#ifdef __cplusplus
}
#endif
#endif
