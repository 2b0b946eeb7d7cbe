// SPDX-License-Identifier: Apache-2.0
#include <errno.h>
#include <fcntl.h>
#include <stdio.h> // renameat
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "platform/linux/linux.h"
#include "src/base/str.h"

// The system's words for an error without strerror, which may allocate for its translations.
const char *sv_linux_reason(int e) {
  switch (e) {
  case ENOSPC: return "the disk is full";
  case EDQUOT: return "the disk quota is used up";
  case EACCES:
  case EPERM: return "no permission";
  case EROFS: return "the file system is read-only";
  case ENOENT: return "it does not exist";
  case ENOTDIR: return "a part of the path is not a folder";
  case EISDIR: return "it is a folder";
  case EIO: return "the device reports an I/O error";
  case EMFILE:
  case ENFILE: return "too many files are open";
  case ENAMETOOLONG: return "the name is too long";
  case EADDRINUSE: return "the port is in use";
  case EADDRNOTAVAIL: return "this machine has no such address";
  case EAFNOSUPPORT: return "this machine has no addresses of this kind";
  default: return "the system refused";
  }
}

static bool is_good_name(const char *name) {
  size_t n = strlen(name);
  if (n == 0 || n + sizeof ".tmp" > SV_LINUX_CAP_NAME) return false;
  return name[0] != '.' && !strchr(name, '/') && !strchr(name, '\\');
}

static void tmp_name(char out[SV_LINUX_CAP_NAME + 8], const char *name) {
  sv_fmt(out, SV_LINUX_CAP_NAME + 8, "%s.tmp", name);
}

static int close_fd(int fd) { // EINTR: Linux has closed it all the same
  return close(fd) < 0 && errno != EINTR ? -1 : 0;
}

static int sync_fd(int fd) {
  int r;
  do r = fsync(fd);
  while (r < 0 && errno == EINTR);
  // Some file systems cannot sync a folder and say EINVAL.
  return r < 0 && errno != EINVAL ? -1 : 0;
}

static int open_at(int dir_fd, const char *name, int flags) {
  int fd;
  do fd = openat(dir_fd, name, flags | O_CLOEXEC, 0666);
  while (fd < 0 && errno == EINTR);
  return fd;
}

static void store_abandon(void *self) {
  sv_linux_store *s = self;
  if (s->fd < 0) return;
  char tmp[SV_LINUX_CAP_NAME + 8];
  tmp_name(tmp, s->name);
  close_fd(s->fd);
  unlinkat(s->dir_fd, tmp, 0);
  s->fd = -1;
}

static sv_status store_begin(void *self, const char *name, sv_err *err) {
  sv_linux_store *s = self;
  if (s->fd >= 0)
    return sv_fail(err, SV_E_ARG, "%s/%s: cannot be saved while %s is being saved", s->dir, name, s->name);
  if (!is_good_name(name))
    return sv_fail(err, SV_E_ARG,
                   "\"%s\": not a file name (no separators, no dot at the start, 1 to %d characters)", name,
                   (int)(SV_LINUX_CAP_NAME - sizeof ".tmp"));
  char tmp[SV_LINUX_CAP_NAME + 8];
  tmp_name(tmp, name);
  s->fd = open_at(s->dir_fd, tmp, O_WRONLY | O_CREAT | O_TRUNC);
  if (s->fd < 0)
    return sv_fail(err, SV_E_IO, "%s/%s: cannot be written: %s", s->dir, tmp, sv_linux_reason(errno));
  sv_copy(s->name, sizeof s->name, name);
  s->n_bytes = 0;
  s->status = SV_OK;
  return SV_OK;
}

static sv_status store_failed(sv_linux_store *s, int e, sv_err *err) {
  s->status = sv_fail(err, SV_E_IO,
                      "%s/%s: not saved: %s after %llu bytes; a file that was there before is unchanged",
                      s->dir, s->name, sv_linux_reason(e), (unsigned long long)s->n_bytes);
  return s->status;
}

static sv_status store_write(void *self, const void *data, size_t bytes, sv_err *err) {
  sv_linux_store *s = self;
  if (s->fd < 0) return sv_fail(err, SV_E_ARG, "%s: write without begin", s->dir);
  if (s->status < 0) return sv_fail(err, s->status, "%s/%s: an earlier write failed", s->dir, s->name);
  const uint8_t *p = data;
  while (bytes) {
    ssize_t n = write(s->fd, p, bytes);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return store_failed(s, errno, err);
    if (n == 0) return store_failed(s, EIO, err); // would loop forever
    p += n;
    bytes -= (size_t)n;
    s->n_bytes += (uint64_t)n;
  }
  return SV_OK;
}

static sv_status store_commit(void *self, sv_err *err) {
  sv_linux_store *s = self;
  if (s->fd < 0) return sv_fail(err, SV_E_ARG, "%s: commit without begin", s->dir);
  sv_status status = s->status;
  if (status < 0) sv_fail(err, status, "%s/%s: not saved: a write failed", s->dir, s->name);
  else if (sync_fd(s->fd) < 0) status = store_failed(s, errno, err);
  if (status < 0) {
    store_abandon(s);
    return status;
  }
  char tmp[SV_LINUX_CAP_NAME + 8];
  tmp_name(tmp, s->name);
  int fd = s->fd;
  s->fd = -1;
  if (close_fd(fd) < 0 || renameat(s->dir_fd, tmp, s->dir_fd, s->name) < 0) {
    status = store_failed(s, errno, err);
    unlinkat(s->dir_fd, tmp, 0);
    return status;
  }
  // The new file is in place; without this, a power cut could lose only its name.
  if (sync_fd(s->dir_fd) < 0)
    return sv_fail(err, SV_E_IO, "%s/%s: saved, but the folder could not be synced: %s", s->dir, s->name,
                   sv_linux_reason(errno));
  return SV_OK;
}

static sv_status read_all(sv_linux_store *s, int fd, const char *name, void *buf, size_t cap, size_t *bytes,
                          sv_err *err) {
  struct stat st;
  if (fstat(fd, &st) < 0 || !S_ISREG(st.st_mode))
    return sv_fail(err, SV_E_IO, "%s/%s: not a regular file", s->dir, name);
  *bytes = (size_t)st.st_size;
  if (*bytes > cap)
    return sv_fail(err, SV_E_NOMEM, "%s/%s: %zu bytes do not fit into the %zu reserved for it", s->dir, name,
                   *bytes, cap);
  size_t got = 0;
  while (got < *bytes) {
    ssize_t n = read(fd, (uint8_t *)buf + got, *bytes - got);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0)
      return sv_fail(err, SV_E_IO, "%s/%s: reading failed: %s", s->dir, name, sv_linux_reason(errno));
    if (n == 0) return sv_fail(err, SV_E_IO, "%s/%s: ends after %zu of %zu bytes", s->dir, name, got, *bytes);
    got += (size_t)n;
  }
  return SV_OK;
}

static sv_status store_read(void *self, const char *name, void *buf, size_t cap, size_t *bytes, sv_err *err) {
  sv_linux_store *s = self;
  *bytes = 0;
  if (!is_good_name(name)) return sv_fail(err, SV_E_ARG, "\"%s\": not a file name", name);
  int fd = open_at(s->dir_fd, name, O_RDONLY);
  if (fd < 0 && errno == ENOENT)
    return sv_fail(err, SV_E_NOT_FOUND, "%s/%s: there is no such file", s->dir, name);
  if (fd < 0) return sv_fail(err, SV_E_IO, "%s/%s: cannot be read: %s", s->dir, name, sv_linux_reason(errno));
  sv_status status = read_all(s, fd, name, buf, cap, bytes, err);
  close_fd(fd);
  return status;
}

sv_status sv_linux_make_dir(const char *dir, sv_err *err) {
  char path[SV_LINUX_CAP_PATH];
  if (!dir[0] || !sv_copy(path, sizeof path, dir))
    return sv_fail(err, SV_E_ARG, "\"%.80s\": a folder's path has 1 to %d characters", dir,
                   SV_LINUX_CAP_PATH - 1);
  for (size_t i = 1;; i++) {
    if (path[i] && path[i] != '/') continue;
    char c = path[i];
    path[i] = 0;
    struct stat st;
    if (mkdir(path, 0777) < 0 && errno != EEXIST && stat(path, &st) < 0)
      return sv_fail(err, SV_E_IO, "%s: the folder cannot be made: %s", path, sv_linux_reason(errno));
    path[i] = c;
    if (!c) return SV_OK;
  }
}

sv_status sv_linux_store_open(sv_linux_store *s, const char *dir, sv_err *err) {
  *s = (sv_linux_store){.dir_fd = -1, .fd = -1};
  sv_status status = sv_linux_make_dir(dir, err);
  if (status < 0) return status;
  sv_copy(s->dir, sizeof s->dir, dir);
  s->dir_fd = open_at(AT_FDCWD, dir, O_RDONLY | O_DIRECTORY);
  if (s->dir_fd < 0)
    return sv_fail(err, SV_E_IO, "%s: cannot be opened as a folder: %s", dir, sv_linux_reason(errno));
  return SV_OK;
}

sv_store sv_linux_store_port(sv_linux_store *s) {
  return (sv_store){s, store_begin, store_write, store_commit, store_abandon, store_read};
}

void sv_linux_store_close(sv_linux_store *s) {
  store_abandon(s);
  if (s->dir_fd >= 0) close_fd(s->dir_fd);
  s->dir_fd = -1;
}
