// SPDX-License-Identifier: Apache-2.0
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "platform/linux/linux.h"
#include "src/base/str.h"

#define CAP_RESCUES 100 // second places of one process

// The system's words for an error without strerror, which may allocate for its translations.
const char *sv_linux_reason(int e) {
  switch (e) {
  case ENOSPC: return "the disk is full";
  case EDQUOT: return "the disk quota is used up";
  case EACCES:
  case EPERM: return "no permission";
  case EFBIG: return "the limit of a file's size is reached (ulimit -f)";
  case EROFS: return "the file system is read-only";
  case ENOENT: return "it does not exist";
  case ENOTDIR: return "a part of the path is not a folder";
  case EEXIST: return "a file of that name is in the way";
  case ELOOP: return "a symbolic link is in the way";
  case ENOMEM: return "no memory";
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
  if (n == 0 || n >= SV_LINUX_CAP_NAME) return false;
  return name[0] != '.' && !strchr(name, '/') && !strchr(name, '\\');
}

static int open_at(int dir_fd, const char *name, int flags) {
  int fd;
  do fd = openat(dir_fd, name, flags | O_CLOEXEC);
  while (fd < 0 && errno == EINTR);
  return fd;
}

static void store_abandon(void *self) {
  sv_linux_store *s = self;
  sv_linux_file_abandon(&s->file);
}

static sv_status store_begin(void *self, const char *name, sv_err *err) {
  sv_linux_store *s = self;
  if (s->file.fd >= 0)
    return sv_fail(err, SV_E_ARG, "%s/%s: cannot be saved while %s is being saved", s->dir, name,
                   s->file.name);
  if (!is_good_name(name))
    return sv_fail(err, SV_E_ARG,
                   "\"%s\": not a file name (no separators, no dot at the start, 1 to %d characters)", name,
                   SV_LINUX_CAP_NAME - 1);
  int e = sv_linux_file_begin(&s->file, s->dir_fd, name);
  return e ? sv_fail(err, SV_E_IO, "%s/%s: cannot be written: %s", s->dir, name, sv_linux_reason(e)) : SV_OK;
}

static sv_status result(const sv_linux_store *s, int e, sv_err *err) {
  const sv_linux_file *f = &s->file;
  if (!e) return SV_OK;
  if (f->is_in_place)
    return sv_fail(err, SV_E_IO, "%s/%s: saved, but the folder could not be synced: %s", s->dir, f->name,
                   sv_linux_reason(e));
  return sv_fail(err, SV_E_IO, "%s/%s: not saved: %s after %llu bytes; an older file is unchanged", s->dir,
                 f->name, sv_linux_reason(e), (unsigned long long)f->n_bytes);
}

static sv_status store_write(void *self, const void *data, size_t bytes, sv_err *err) {
  sv_linux_store *s = self;
  if (s->file.fd < 0) return sv_fail(err, SV_E_ARG, "%s: write without begin", s->dir);
  return result(s, sv_linux_file_write(&s->file, data, bytes), err);
}

static sv_status store_commit(void *self, sv_err *err) {
  sv_linux_store *s = self;
  if (s->file.fd < 0) return sv_fail(err, SV_E_ARG, "%s: commit without begin", s->dir);
  return result(s, sv_linux_file_commit(&s->file), err);
}

static sv_status store_commit_over(void *self, const char *older, bool is_kept, sv_err *err) {
  sv_linux_store *s = self;
  if (s->file.fd < 0) return sv_fail(err, SV_E_ARG, "%s: commit without begin", s->dir);
  return result(s, sv_linux_file_commit_over(&s->file, older, is_kept), err);
}

// Bytes of an open file, which must fit into cap.
static sv_status size_of(const sv_linux_store *s, int fd, const char *name, size_t cap, size_t *bytes,
                         sv_err *err) {
  struct stat st;
  if (fstat(fd, &st) < 0 || !S_ISREG(st.st_mode))
    return sv_fail(err, SV_E_IO, "%s/%s: not a regular file", s->dir, name);
  *bytes = (size_t)st.st_size;
  if (*bytes > cap)
    return sv_fail(err, SV_E_NOMEM, "%s/%s: %zu bytes do not fit into the %zu reserved for it", s->dir, name,
                   *bytes, cap);
  return SV_OK;
}

static sv_status read_all(const sv_linux_store *s, int fd, const char *name, void *buf, size_t bytes,
                          sv_err *err) {
  size_t got = 0;
  while (got < bytes) {
    ssize_t n = read(fd, (uint8_t *)buf + got, bytes - got);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0)
      return sv_fail(err, SV_E_IO, "%s/%s: reading failed: %s", s->dir, name, sv_linux_reason(errno));
    if (n == 0) return sv_fail(err, SV_E_IO, "%s/%s: ends after %zu of %zu bytes", s->dir, name, got, bytes);
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
  sv_status status = size_of(s, fd, name, cap, bytes, err);
  if (status >= 0) status = read_all(s, fd, name, buf, *bytes, err);
  close(fd);
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

// A new folder of this user alone; /dev/shm is everybody's.
static bool make_private(char *path, size_t cap, const char *in) {
  struct stat st;
  if (!in || stat(in, &st) < 0 || !S_ISDIR(st.st_mode)) return false;
  for (int i = 0; i < CAP_RESCUES; i++) {
    if (sv_fmt(path, cap, "%s/subview-rescue.%ld.%d", in, (long)getpid(), i) >= cap) return false;
    if (mkdir(path, 0700) == 0) return true;
    if (errno != EEXIST) return false;
  }
  return false;
}

sv_status sv_linux_rescue_dir(char *path, size_t cap, sv_err *err) {
  if (make_private(path, cap, "/dev/shm") || make_private(path, cap, getenv("XDG_RUNTIME_DIR"))) return SV_OK;
  return sv_fail(err, SV_E_IO, "there is no memory-backed folder to save in instead");
}

void sv_linux_store_init(sv_linux_store *s) { *s = (sv_linux_store){.dir_fd = -1, .file.fd = -1}; }

sv_status sv_linux_store_open(sv_linux_store *s, const char *dir, sv_err *err) {
  sv_linux_store_init(s);
  sv_status status = sv_linux_make_dir(dir, err);
  if (status < 0) return status;
  sv_copy(s->dir, sizeof s->dir, dir);
  s->dir_fd = open_at(AT_FDCWD, dir, O_RDONLY | O_DIRECTORY);
  if (s->dir_fd < 0)
    return sv_fail(err, SV_E_IO, "%s: cannot be opened as a folder: %s", dir, sv_linux_reason(errno));
  sv_linux_file_sweep(s->dir_fd);
  return SV_OK;
}

sv_status sv_linux_store_lock(const sv_linux_store *s, sv_err *err) {
  if (sv_linux_folder_lock(s->dir_fd) != SV_LINUX_LOCK_IN_USE) return SV_OK;
  return sv_fail(err, SV_E_IO, "%s: another program is writing there; choose another --out", s->dir);
}

sv_store sv_linux_store_port(sv_linux_store *s) {
  return (sv_store){.self = s,
                    .begin = store_begin,
                    .write = store_write,
                    .commit = store_commit,
                    .commit_over = store_commit_over,
                    .abandon = store_abandon,
                    .read = store_read};
}

void sv_linux_store_close(sv_linux_store *s) {
  store_abandon(s);
  if (s->dir_fd >= 0) close(s->dir_fd);
  s->dir_fd = -1;
}
