// SPDX-License-Identifier: Apache-2.0
#include <sys/mman.h>
#include <sys/resource.h>

#include "platform/linux/linux.h"

#define LARGE ((uintptr_t)2 << 20)

void sv_linux_large_pages(void *block, size_t bytes) {
  uintptr_t first = ((uintptr_t)block + LARGE - 1) & ~(LARGE - 1),
            end = ((uintptr_t)block + bytes) & ~(LARGE - 1);
  if (first < end) (void)madvise((void *)first, end - first, MADV_HUGEPAGE);
}

void *sv_linux_block(size_t bytes, sv_err *err) {
  void *p = mmap(NULL, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
  if (p != MAP_FAILED) return p;
  struct rlimit limit = {RLIM_INFINITY, RLIM_INFINITY};
  const unsigned long long mib = bytes >> 20;
  if (getrlimit(RLIMIT_AS, &limit) == 0 && limit.rlim_cur != RLIM_INFINITY)
    sv_fail(err, SV_E_NOMEM,
            "no address space for the memory block of %llu MiB: the limit is %llu MiB (ulimit -v); raise it",
            mib, (unsigned long long)limit.rlim_cur >> 20);
  else sv_fail(err, SV_E_NOMEM, "the system has no memory block of %llu MiB", mib);
  return NULL;
}
