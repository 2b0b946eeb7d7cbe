// SPDX-License-Identifier: Apache-2.0
#include <sys/mman.h>

#include "platform/linux/linux.h"

#define LARGE ((uintptr_t)2 << 20)

void sv_linux_large_pages(void *block, size_t bytes) {
  uintptr_t first = ((uintptr_t)block + LARGE - 1) & ~(LARGE - 1),
            end = ((uintptr_t)block + bytes) & ~(LARGE - 1);
  if (first < end) (void)madvise((void *)first, end - first, MADV_HUGEPAGE);
}
