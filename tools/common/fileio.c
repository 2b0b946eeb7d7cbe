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

sv_status sv_file_begin(sv_file *f, const char *path, sv_err *err) {
  f->fd = -1;
  if (strlen(path) >= sizeof f->path) return sv_fail(err, SV_E_RANGE, "%s: the path is too long", path);
  strcpy(f->path, path);
  snprintf(f->temporary, sizeof f->temporary, "%s.%d.tmp", path, (int)getpid() % 1000000);
  f->fd = open(f->temporary, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
  return f->fd < 0 ? io_error(err, path, "cannot write") : SV_OK;
}

sv_status sv_file_append(void *file, const void *data, size_t bytes, sv_err *err) {
  sv_file *f = file;
  const char *p = data;
  while (bytes) {
    ssize_t w = write(f->fd, p, bytes);
    if (w < 0 && errno == EINTR) continue;
    if (w <= 0) return io_error(err, f->path, "cannot write");
    p += w;
    bytes -= (size_t)w;
  }
  return SV_OK;
}

void sv_file_abandon(sv_file *f) {
  if (f->fd < 0) return;
  close(f->fd);
  unlink(f->temporary);
  f->fd = -1;
}

sv_status sv_file_commit(sv_file *f, sv_err *err) {
  char folder[SV_CAP_PATH];
  int failed = fsync(f->fd) != 0;
  failed |= close(f->fd) != 0;
  f->fd = -1;
  if (failed || rename(f->temporary, f->path) != 0) {
    sv_status s = io_error(err, f->path, "cannot write");
    unlink(f->temporary);
    return s;
  }
  sv_path_folder(folder, sizeof folder, f->path);
  int fd = open(folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC); // makes the new name last; some file
  // systems cannot, which loses nothing else
  if (fd >= 0) {
    (void)fsync(fd);
    close(fd);
  }
  return SV_OK;
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
