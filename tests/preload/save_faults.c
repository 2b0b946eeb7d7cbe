// SPDX-License-Identifier: Apache-2.0
// Preloaded into a program (LD_PRELOAD): one of its system calls that write below a folder fails.
//   SV_FAULT_DIR    the folder; other files are left alone
//   SV_FAULT_AT     the at-th call fails (1: the first); 0: none
//   SV_FAULT_KIND   an errno's number; "short": writes take half; "xfsz": as over `ulimit -f`;
//                   "kill": the program ends at once
//   SV_FAULT_LASTS  so many calls fail one after the other; 1 without it
//   SV_FAULT_COUNT  a file for the number of calls, written at exit
// Waiting is cut to a millisecond, so that a save's retries cost no time.
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <signal.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

static const char *dir, *kind;
static long at, n_failing = 1;
static _Atomic long n_calls;

__attribute__((constructor)) static void begin(void) {
  const char *n = getenv("SV_FAULT_AT");
  dir = getenv("SV_FAULT_DIR");
  kind = getenv("SV_FAULT_KIND");
  at = n ? strtol(n, NULL, 10) : 0;
  n = getenv("SV_FAULT_LASTS");
  if (n) n_failing = strtol(n, NULL, 10);
}

__attribute__((destructor)) static void end(void) {
  const char *path = getenv("SV_FAULT_COUNT");
  char text[32];
  if (!path) return;
  const int n = snprintf(text, sizeof text, "%ld\n", n_calls);
  const int fd = (int)syscall(SYS_openat, AT_FDCWD, path, O_WRONLY | O_CREAT | O_TRUNC, 0666);
  if (fd < 0 || syscall(SYS_write, fd, text, (size_t)n) != n) return;
}

static bool is_below(const char *path) { return dir && strncmp(path, dir, strlen(dir)) == 0; }

static bool is_fd_below(int fd) {
  char link[64], path[PATH_MAX];
  if (!dir || fd < 0) return false;
  snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
  const ssize_t n = readlink(link, path, sizeof path - 1);
  path[n > 0 ? n : 0] = 0;
  return is_below(path);
}

static bool is_at_below(int dir_fd, const char *name) {
  return name[0] == '/' ? is_below(name) : dir_fd == AT_FDCWD ? false : is_fd_below(dir_fd);
}

static bool is_hit(long n) { return at && kind && n >= at && n - at < n_failing; }

// True when this call fails; errno is set.
static bool fails(bool is_ours) {
  if (!is_ours) return false;
  const long n = ++n_calls;
  if (!is_hit(n) || strcmp(kind, "short") == 0) return false;
  if (strcmp(kind, "kill") == 0) raise(SIGKILL);
  if (strcmp(kind, "xfsz") == 0) {
    raise(SIGXFSZ);
    errno = EFBIG;
  } else errno = (int)strtol(kind, NULL, 10);
  return true;
}

ssize_t write(int fd, const void *data, size_t bytes) {
  const bool is_ours = is_fd_below(fd);
  if (fails(is_ours)) return -1;
  const bool is_short = is_ours && is_hit(n_calls) && strcmp(kind, "short") == 0;
  return syscall(SYS_write, fd, data, is_short && bytes > 1 ? bytes / 2 : bytes);
}

int fsync(int fd) { return fails(is_fd_below(fd)) ? -1 : (int)syscall(SYS_fsync, fd); }
int syncfs(int fd) { return fails(is_fd_below(fd)) ? -1 : (int)syscall(SYS_syncfs, fd); }
int ftruncate(int fd, off_t n) { return fails(is_fd_below(fd)) ? -1 : (int)syscall(SYS_ftruncate, fd, n); }

// Linux closes the descriptor whatever it says.
int close(int fd) {
  struct stat st;
  const bool is_ours = fstat(fd, &st) == 0 && S_ISREG(st.st_mode) && is_fd_below(fd) &&
                       (fcntl(fd, F_GETFL) & O_ACCMODE) != O_RDONLY;
  const bool is_bad = fails(is_ours);
  const int e = errno, r = (int)syscall(SYS_close, fd);
  if (is_bad) errno = e;
  return is_bad ? -1 : r;
}

int renameat(int from_fd, const char *from, int to_fd, const char *to) {
  if (fails(is_at_below(from_fd, from))) return -1;
  return (int)syscall(SYS_renameat, from_fd, from, to_fd, to);
}

int linkat(int from_fd, const char *from, int to_fd, const char *to, int flags) {
  if (fails(is_at_below(from_fd, from))) return -1;
  return (int)syscall(SYS_linkat, from_fd, from, to_fd, to, flags);
}

int mkdirat(int fd, const char *path, mode_t mode) {
  return fails(is_at_below(fd, path)) ? -1 : (int)syscall(SYS_mkdirat, fd, path, mode);
}

static mode_t mode_of(int flags, va_list ap) { return flags & O_CREAT ? va_arg(ap, mode_t) : 0; }

int openat(int fd, const char *path, int flags, ...) {
  va_list ap;
  va_start(ap, flags);
  const mode_t mode = mode_of(flags, ap);
  va_end(ap);
  if (flags & O_CREAT && fails(is_at_below(fd, path))) return -1;
  return (int)syscall(SYS_openat, fd, path, flags, mode);
}

int open(const char *path, int flags, ...) {
  va_list ap;
  va_start(ap, flags);
  const mode_t mode = mode_of(flags, ap);
  va_end(ap);
  if (flags & O_CREAT && fails(is_at_below(AT_FDCWD, path))) return -1;
  return (int)syscall(SYS_openat, AT_FDCWD, path, flags, mode);
}

int clock_nanosleep(clockid_t clock, int flags, const struct timespec *t, struct timespec *left) {
  const struct timespec ms = {0, 1000000};
  (void)clock;
  (void)flags;
  (void)t;
  (void)left;
  return nanosleep(&ms, NULL);
}
