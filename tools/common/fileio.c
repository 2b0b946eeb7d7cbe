// SPDX-License-Identifier: Apache-2.0
#include "tools/common/fileio.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static sv_status io_error(sv_err *err, const char *path, const char *what) {
  int e = errno;
  return sv_fail(err,
                 e == ENOENT   ? SV_E_NOT_FOUND
                 : e == ENOMEM ? SV_E_NOMEM
                               : SV_E_IO,
                 "%s: %s: %s", path, what, strerror(e));
}

// Reads up to cap bytes until the end of the file.
static sv_status read_all(int fd, const char *path, char *buf, size_t cap, size_t *n, sv_err *err) {
  for (*n = 0; *n < cap;) {
    ssize_t r = read(fd, buf + *n, cap - *n);
    if (r < 0 && errno == EINTR) continue;
    if (r < 0) return io_error(err, path, "cannot read");
    if (r == 0) break;
    *n += (size_t)r;
  }
  return SV_OK;
}

sv_status sv_file_open(const char *path, int *fd, size_t *bytes, sv_err *err) {
  struct stat st;
  // a pipe that nobody writes to would block here
  *fd = open(path, O_RDONLY | O_NONBLOCK | O_CLOEXEC);
  if (*fd < 0) return io_error(err, path, "cannot open");
  if (fstat(*fd, &st) != 0 || !S_ISREG(st.st_mode)) {
    close(*fd);
    return sv_fail(err, SV_E_FORMAT, "%s: not a regular file", path);
  }
  *bytes = (size_t)st.st_size;
  return SV_OK;
}

sv_status sv_file_read(const char *path, void **data, size_t *bytes, sv_err *err) {
  int fd;
  size_t size;
  sv_status s = sv_file_open(path, &fd, &size, err);
  if (s != SV_OK) return s;
  char *buf = malloc(size + 1);
  s = buf ? read_all(fd, path, buf, size, bytes, err)
          : sv_fail(err, SV_E_NOMEM, "%s: no memory for its %zu bytes", path, size);
  close(fd);
  if (s != SV_OK) {
    free(buf);
    return s;
  }
  buf[*bytes] = 0;
  *data = buf;
  return SV_OK;
}

sv_status sv_folder_read(void *folder, const char *name, void *buf, size_t cap, size_t *bytes, sv_err *err) {
  char path[SV_CAP_PATH];
  int fd;
  size_t size;
  sv_status s = sv_path_join(path, sizeof path, folder, name, err);
  if (s == SV_OK) s = sv_file_open(path, &fd, &size, err);
  if (s != SV_OK) return s;
  s = size > cap ? sv_fail(err, SV_E_NOMEM, "%s: %zu bytes exceed the limit of %zu", path, size, cap)
                 : read_all(fd, path, buf, size, bytes, err);
  close(fd);
  return s;
}

// Temporary files that a killed tool has left, once a folder: the first time that it is written to.
static void sweep_once(int dir_fd) {
  static dev_t device;
  static ino_t inode;
  struct stat st;
  if (fstat(dir_fd, &st) != 0 || (st.st_dev == device && st.st_ino == inode)) return;
  device = st.st_dev;
  inode = st.st_ino;
  sv_linux_file_sweep(dir_fd);
}

static int open_folder(const char *path) {
  int fd;
  do fd = open(path, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  while (fd < 0 && errno == EINTR);
  if (fd >= 0) sweep_once(fd);
  return fd;
}

static sv_status not_written(sv_err *err, const char *path, int e) {
  errno = e;
  return io_error(err, path, "cannot write");
}

void sv_file_init(sv_file *f) { f->file.fd = f->dir_fd = -1; }

sv_status sv_file_begin(sv_file *f, const char *path, sv_err *err) {
  char folder[SV_CAP_PATH];
  sv_file_init(f);
  if (strlen(path) >= sizeof f->path) return sv_fail(err, SV_E_RANGE, "%s: the path is too long", path);
  strcpy(f->path, path);
  sv_path_folder(folder, sizeof folder, path);
  f->dir_fd = open_folder(folder);
  if (f->dir_fd < 0) return not_written(err, path, errno);
  int e = sv_linux_file_begin(&f->file, f->dir_fd, sv_path_name(path));
  if (!e) return SV_OK;
  close(f->dir_fd);
  f->dir_fd = -1;
  return not_written(err, path, e);
}

sv_status sv_file_append(void *file, const void *data, size_t bytes, sv_err *err) {
  sv_file *f = file;
  int e = sv_linux_file_write(&f->file, data, bytes);
  return e ? not_written(err, f->path, e) : SV_OK;
}

void sv_file_abandon(sv_file *f) {
  sv_linux_file_abandon(&f->file);
  if (f->dir_fd >= 0) close(f->dir_fd);
  f->dir_fd = -1;
}

sv_status sv_file_commit(sv_file *f, sv_err *err) {
  int e = sv_linux_file_commit(&f->file);
  sv_file_abandon(f);
  return e ? not_written(err, f->path, e) : SV_OK;
}

sv_status sv_file_write(const char *path, const void *data, size_t bytes, sv_err *err) {
  sv_file f;
  sv_status s = sv_file_begin(&f, path, err);
  if (s != SV_OK) return s;
  s = sv_file_append(&f, data, bytes, err);
  if (s == SV_OK) return sv_file_commit(&f, err);
  sv_file_abandon(&f);
  return s;
}

// --- streams -------------------------------------------------------------------------------------

typedef struct stream {
  FILE *f;
  sv_file file;
  sv_err err;
  struct stream *next;
} stream;
static stream *streams; // that are open

static ssize_t stream_write(void *cookie, const char *data, size_t bytes) {
  stream *s = cookie;
  return sv_file_append(&s->file, data, bytes, &s->err) == SV_OK ? (ssize_t)bytes : 0;
}

FILE *sv_stream_open(const char *path, sv_err *err) {
  stream *s = calloc(1, sizeof *s);
  const cookie_io_functions_t io = {.write = stream_write};
  if (!s || sv_file_begin(&s->file, path, err) != SV_OK) {
    if (!s) sv_fail(err, SV_E_NOMEM, "%s: no memory to write it", path);
    free(s);
    return NULL;
  }
  s->f = fopencookie(s, "w", io);
  if (!s->f) {
    sv_fail(err, SV_E_NOMEM, "%s: no memory to write it", path);
    sv_file_abandon(&s->file);
    free(s);
    return NULL;
  }
  s->next = streams;
  streams = s;
  return s->f;
}

sv_status sv_stream_save(FILE *f, sv_err *err) {
  stream **at = &streams;
  while ((*at)->f != f) at = &(*at)->next;
  stream *s = *at;
  *at = s->next;
  fclose(f); // a failure is in s->err
  sv_status status = s->err.status;
  if (status < 0) {
    *err = s->err;
    sv_file_abandon(&s->file);
  } else status = sv_file_commit(&s->file, err);
  free(s);
  return status;
}

// --- paths ---------------------------------------------------------------------------------------

sv_status sv_path_join(char *out, size_t cap, const char *folder, const char *name, sv_err *err) {
  size_t n = strlen(folder);
  const char *sep = n && folder[n - 1] == '/' ? "" : "/";
  int len =
      name[0] == '/' || !n ? snprintf(out, cap, "%s", name) : snprintf(out, cap, "%s%s%s", folder, sep, name);
  if (len < 0 || (size_t)len >= cap)
    return sv_fail(err, SV_E_RANGE, "%s/%s: the path is too long", folder, name);
  return SV_OK;
}

const char *sv_path_name(const char *path) {
  const char *s = strrchr(path, '/');
  return s ? s + 1 : path;
}

void sv_path_folder(char *out, size_t cap, const char *path) {
  const char *name = sv_path_name(path);
  size_t n = (size_t)(name - path);
  if (n > 1) n--; // without the separator, but "/" stays
  snprintf(out, cap, "%.*s", n ? (int)n : 1, n ? path : ".");
}

const char *sv_path_extension(const char *path) {
  const char *name = sv_path_name(path), *dot = strrchr(name, '.');
  return dot && dot != name ? dot : "";
}

bool sv_path_exists(const char *path) { return access(path, F_OK) == 0; }

bool sv_path_is_folder(const char *path) {
  struct stat st;
  return stat(path, &st) == 0 && S_ISDIR(st.st_mode);
}

sv_status sv_path_make_folder(const char *path, sv_err *err) {
  char part[SV_CAP_PATH];
  size_t n = strlen(path);
  if (n >= sizeof part) return sv_fail(err, SV_E_RANGE, "%s: the path is too long", path);
  for (size_t i = 1; i <= n; i++) {
    if (path[i] != '/' && path[i]) continue;
    memcpy(part, path, i);
    part[i] = 0;
    if (mkdir(part, 0755) != 0 && errno != EEXIST) return io_error(err, part, "cannot create the folder");
  }
  return sv_path_is_folder(path) ? SV_OK : sv_fail(err, SV_E_IO, "%s: exists but is not a folder", path);
}

sv_status sv_path_lock_folder(const char *path, int *fd, sv_err *err) {
  sv_status s = sv_path_make_folder(path, err);
  if (s != SV_OK) return s;
  *fd = open_folder(path);
  if (*fd < 0) return io_error(err, path, "cannot open the folder");
  if (sv_linux_folder_lock(*fd) != SV_LINUX_LOCK_IN_USE) return SV_OK;
  close(*fd);
  return sv_fail(err, SV_E_IO, "%s: another program is writing there; choose another --out", path);
}

static int by_name(const void *a, const void *b) { return strcmp(*(char *const *)a, *(char *const *)b); }

sv_status sv_folder_list(const char *folder, sv_names *out, sv_err *err) {
  *out = (sv_names){NULL, 0};
  DIR *d = opendir(folder);
  if (!d) return io_error(err, folder, "cannot list the folder");
  int cap = 0;
  for (struct dirent *e; (e = readdir(d));) {
    if (e->d_name[0] == '.') continue;
    if (out->n == cap) {
      cap = cap ? 2 * cap : 64;
      char **more = realloc(out->names, sizeof(char *) * (size_t)cap);
      if (more) out->names = more;
      else goto no_memory;
    }
    if (!(out->names[out->n] = strdup(e->d_name))) goto no_memory;
    out->n++;
  }
  closedir(d);
  if (out->n) qsort(out->names, (size_t)out->n, sizeof(char *), by_name);
  return SV_OK;
no_memory:
  closedir(d);
  sv_names_free(out);
  return sv_fail(err, SV_E_NOMEM, "%s: no memory for its names", folder);
}

void sv_names_free(sv_names *names) {
  for (int i = 0; i < names->n; i++) free(names->names[i]);
  free(names->names);
  *names = (sv_names){NULL, 0};
}
