// SPDX-License-Identifier: Apache-2.0
// A library to be preloaded into subview on the virtual board: counts the calls of the malloc
// family and of C++'s operator new from the cameras' start (the first VIDIOC_STREAMON) to their
// stop (the first VIDIOC_STREAMOFF), apart by who calls: the program itself, libcamera and what it
// is made of, anything else. Says so on stderr at the end:
//   heap: started 1, ours 0, libcamera 1234, others 0
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <link.h>
#include <linux/videodev2.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <sys/syscall.h>
#include <unistd.h>

extern void *__libc_malloc(size_t);
extern void *__libc_calloc(size_t, size_t);
extern void *__libc_realloc(void *, size_t);
extern void __libc_free(void *);
extern void *__libc_memalign(size_t, size_t);

#define CAP_RANGES 64
enum { OURS, LIBCAMERA, OTHERS, N_OWNERS };
static struct {
  uintptr_t from, to;
  int owner;
} ranges[CAP_RANGES];
static const char *names[CAP_RANGES];
static int n_ranges;
static _Atomic(const char *) other; // the first of those
static _Atomic uint64_t n_calls[N_OWNERS];
static _Atomic int phase; // 0: before the start, 1: cameras run, 2: after

static int note(struct dl_phdr_info *info, size_t size, void *arg) {
  (void)size;
  (void)arg;
  const char *name = info->dlpi_name;
  // libstdc++ is how libcamera allocates; operator new is told apart below.
  int owner = !name[0]                                                                   ? OURS
              : strstr(name, "camera") || strstr(name, "stdc++") || strstr(name, "ipa_") ? LIBCAMERA
                                                                                         : OTHERS;
  for (int i = 0; i < info->dlpi_phnum && n_ranges < CAP_RANGES; i++) {
    const ElfW(Phdr) *p = &info->dlpi_phdr[i];
    if (p->p_type != PT_LOAD || !(p->p_flags & PF_X)) continue;
    ranges[n_ranges].from = info->dlpi_addr + p->p_vaddr;
    ranges[n_ranges].to = ranges[n_ranges].from + p->p_memsz;
    names[n_ranges] = name;
    ranges[n_ranges++].owner = owner;
  }
  return 0;
}

static void count(const void *caller) {
  if (atomic_load(&phase) != 1) return;
  uintptr_t at = (uintptr_t)caller;
  int owner = OTHERS;
  for (int i = 0; i < n_ranges; i++)
    if (at >= ranges[i].from && at < ranges[i].to) {
      owner = ranges[i].owner;
      if (owner == OTHERS && !atomic_load(&other)) atomic_store(&other, names[i]);
    }
  atomic_fetch_add(&n_calls[owner], 1);
}

#define CALLER __builtin_return_address(0)
void *malloc(size_t n) {
  count(CALLER);
  return __libc_malloc(n);
}
void *calloc(size_t n, size_t size) {
  count(CALLER);
  return __libc_calloc(n, size);
}
void *realloc(void *p, size_t n) {
  count(CALLER);
  return __libc_realloc(p, n);
}
void free(void *p) {
  if (p) count(CALLER);
  __libc_free(p);
}
int posix_memalign(void **out, size_t align, size_t n) {
  count(CALLER);
  *out = __libc_memalign(align, n);
  return *out ? 0 : ENOMEM;
}
// operator new and delete, so that code of ours in C++ is seen as ours.
void *_Znwm(size_t n) {
  count(CALLER);
  return __libc_malloc(n ? n : 1);
}
void *_Znam(size_t n) {
  count(CALLER);
  return __libc_malloc(n ? n : 1);
}
void _ZdlPv(void *p) {
  if (p) count(CALLER);
  __libc_free(p);
}
void _ZdaPv(void *p) {
  if (p) count(CALLER);
  __libc_free(p);
}
void _ZdlPvm(void *p, size_t n) {
  (void)n;
  if (p) count(CALLER);
  __libc_free(p);
}

int ioctl(int fd, unsigned long request, ...) {
  va_list ap;
  va_start(ap, request);
  void *arg = va_arg(ap, void *);
  va_end(ap);
  int r = (int)syscall(SYS_ioctl, fd, request, arg);
  if ((uint32_t)request == (uint32_t)VIDIOC_STREAMON && !atomic_load(&phase)) {
    dl_iterate_phdr(note, NULL);
    atomic_store(&phase, 1);
  }
  if ((uint32_t)request == (uint32_t)VIDIOC_STREAMOFF && atomic_load(&phase) == 1) atomic_store(&phase, 2);
  return r;
}

__attribute__((destructor)) static void tell(void) {
  char line[256];
  int n = snprintf(line, sizeof line, "heap: started %d, ours %llu, libcamera %llu, others %llu (%s)\n",
                   atomic_load(&phase) > 0, (unsigned long long)n_calls[OURS],
                   (unsigned long long)n_calls[LIBCAMERA], (unsigned long long)n_calls[OTHERS],
                   other ? other : "none");
  if (n > 0 && write(2, line, (size_t)n) < 0) return;
}
