// SPDX-License-Identifier: Apache-2.0
#include "platform/linux/file.h"

#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h> // renameat
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "src/base/str.h"

#define SUFFIX    ".subview-tmp"
#define CAP_TRIES 100 // temporary names of one process for one file

static int sync_fd(int fd) {
  int r;
  do r = fsync(fd);
  while (r < 0 && errno == EINTR);
  // Some file systems cannot sync a folder and say EINVAL.
  return r < 0 && errno != EINVAL ? errno : 0;
}

static int lock_now(int fd) {
  int r;
  do r = flock(fd, LOCK_EX | LOCK_NB);
  while (r < 0 && errno == EINTR);
  return r < 0 ? errno : 0;
}

sv_linux_lock sv_linux_folder_lock(int dir_fd) {
  int e = lock_now(dir_fd);
  if (!e) return SV_LINUX_LOCK_OURS;
  return e == EWOULDBLOCK ? SV_LINUX_LOCK_IN_USE : SV_LINUX_LOCK_UNSUPPORTED;
}

// A temporary file is locked as long as it is written, so that a sweep can tell those that nobody
// writes any more. False: a sweep was faster and has removed it or is about to.
static bool hold(int fd) {
  struct stat st;
  return lock_now(fd) != EWOULDBLOCK && fstat(fd, &st) == 0 && st.st_nlink > 0;
}

// O_EXCL: what stands in the name's place, a symbolic link too, is never opened.
static int open_new(int dir_fd, const char *name) {
  int fd;
  do fd = openat(dir_fd, name, O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0666);
  while (fd < 0 && errno == EINTR);
  return fd;
}

int sv_linux_file_begin(sv_linux_file *f, int dir_fd, const char *name) {
  *f = (sv_linux_file){.dir_fd = dir_fd, .fd = -1};
  if (!sv_copy(f->name, sizeof f->name, name)) return ENAMETOOLONG;
  for (int i = 0; i < CAP_TRIES; i++) {
    sv_fmt(f->temporary, sizeof f->temporary, "%s.%ld-%d" SUFFIX, name, (long)getpid(), i);
    int fd = open_new(dir_fd, f->temporary);
    if (fd < 0 && errno == EEXIST) continue;
    if (fd < 0) return errno;
    if (hold(fd)) {
      f->fd = fd;
      return 0;
    }
    close(fd);
  }
  return EEXIST;
}

int sv_linux_write_all(int fd, const void *data, size_t bytes, uint64_t *n_written) {
  const uint8_t *p = data;
  while (bytes) {
    ssize_t n = write(fd, p, bytes);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return errno;
    if (n == 0) return EIO; // would loop forever
    p += n;
    bytes -= (size_t)n;
    if (n_written) *n_written += (uint64_t)n;
  }
  return 0;
}

int sv_linux_file_write(sv_linux_file *f, const void *data, size_t bytes) {
  if (f->fd < 0) return EBADF;
  if (!f->error) f->error = sv_linux_write_all(f->fd, data, bytes, &f->n_bytes);
  return f->error;
}

void sv_linux_file_abandon(sv_linux_file *f) {
  if (f->fd < 0) return;
  unlinkat(f->dir_fd, f->temporary, 0);
  close(f->fd);
  f->fd = -1;
}

// The file that is there becomes `older` too, so that a kill at any moment leaves it under one of
// both names. Where a file cannot have two (FAT), it is moved.
static int keep(const sv_linux_file *f, const char *older, bool *is_moved) {
  *is_moved = false;
  unlinkat(f->dir_fd, older, 0);
  if (linkat(f->dir_fd, f->name, f->dir_fd, older, 0) == 0 || errno == ENOENT) return 0;
  *is_moved = renameat(f->dir_fd, f->name, f->dir_fd, older) == 0;
  return *is_moved || errno == ENOENT ? 0 : errno;
}

static int put_in_place(const sv_linux_file *f, const char *older) {
  bool is_moved = false;
  int e = older ? keep(f, older, &is_moved) : 0;
  if (!e && renameat(f->dir_fd, f->temporary, f->dir_fd, f->name) < 0) e = errno;
  if (e && is_moved) (void)renameat(f->dir_fd, older, f->dir_fd, f->name);
  return e;
}

static int commit(sv_linux_file *f, const char *older) {
  if (f->fd < 0) return EBADF;
  if (!f->error) f->error = sync_fd(f->fd);
  if (!f->error) f->error = put_in_place(f, older);
  f->is_in_place = !f->error;
  if (f->is_in_place) {
    close(f->fd); // what is synced cannot fail any more
    f->fd = -1;
    // Without this, a power cut could lose the new name.
    f->error = sync_fd(f->dir_fd);
  } else sv_linux_file_abandon(f);
  return f->error;
}

int sv_linux_file_commit(sv_linux_file *f) { return commit(f, NULL); }

int sv_linux_file_commit_over(sv_linux_file *f, const char *older, bool is_kept) {
  int e = commit(f, is_kept ? older : NULL);
  if (!e && !is_kept) unlinkat(f->dir_fd, older, 0);
  return e;
}

// --- sweep ---------------------------------------------------------------------------------------

// NAME.PID-N.subview-tmp: its PID; 0: another name.
static long pid_of(const char *name) {
  const size_t n = strlen(name), n_end = sizeof SUFFIX - 1;
  if (n <= n_end || strcmp(name + n - n_end, SUFFIX) != 0) return 0;
  const char *p = name + n - n_end;
  const char *const digits = "0123456789";
  const char *number = p;
  while (number > name && strchr(digits, number[-1])) number--;
  if (number == p || number == name || number[-1] != '-') return 0;
  const char *pid = --number;
  while (pid > name && strchr(digits, pid[-1])) pid--;
  if (pid == number || pid - name < 2 || pid[-1] != '.') return 0;
  return strtol(pid, NULL, 10);
}

static void sweep_one(int dir_fd, const char *name) {
  const long pid = pid_of(name);
  if (pid <= 0) return;
  const int fd = openat(dir_fd, name, O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);
  if (fd < 0) return;
  struct stat st;
  const int e = fstat(fd, &st) < 0 || !S_ISREG(st.st_mode) ? EWOULDBLOCK : lock_now(fd);
  // Where files cannot be locked, the process tells.
  const bool is_stale = !e || (e != EWOULDBLOCK && kill((pid_t)pid, 0) < 0 && errno == ESRCH);
  if (is_stale) unlinkat(dir_fd, name, 0);
  close(fd);
}

// The system's own record: opendir would allocate.
typedef struct {
  uint64_t inode;
  int64_t offset;
  uint16_t n_bytes;
  uint8_t type;
  char name[];
} entry;

void sv_linux_file_sweep(int dir_fd) {
  _Alignas(entry) char buf[2048];
  const int fd = openat(dir_fd, ".", O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (fd < 0) return;
  for (long n; (n = syscall(SYS_getdents64, fd, buf, sizeof buf)) > 0;)
    for (long at = 0; at < n;) {
      const entry *e = (const entry *)(const void *)(buf + at);
      sweep_one(dir_fd, e->name);
      at += e->n_bytes;
    }
  close(fd);
}
