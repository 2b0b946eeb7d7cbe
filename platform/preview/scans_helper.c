// SPDX-License-Identifier: Apache-2.0
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <time.h>
#include <unistd.h>

#include "platform/linux/linux.h"
#include "platform/preview/preview.h"
#include "platform/preview/scans.h"

#define CAP_NAME 300
#define TRASH    ".deleted-" // before the name of a deleted scan

// --- names ---------------------------------------------------------------------------------------

// The number of a scan's folder, 0: it is something else.
static uint32_t number_of(const char *base, const char *name) {
  const pv_scans_place place = {"", base};
  const size_t n_base = strlen(base);
  char again[CAP_NAME];
  long long n = 1;
  if (n_base && strcmp(name, base) != 0) {
    if (strncmp(name, base, n_base) != 0 || name[n_base] != '-') return 0;
    if (!sv_parse_int(name + n_base + 1, strlen(name + n_base + 1), &n)) return 0;
  } else if (!n_base && !sv_parse_int(name, strlen(name), &n)) return 0;
  if (n < 1 || n > 99999999) return 0;
  // No other spelling of the number
  const bool is_same = pv_scan_folder_name(&place, (uint32_t)n, again, sizeof again) && !strcmp(again, name);
  return is_same ? (uint32_t)n : 0;
}

static bool name_of(const char *base, uint32_t number, bool is_deleted, char *out, size_t cap) {
  const pv_scans_place place = {"", base};
  const size_t n = is_deleted ? strlen(TRASH) : 0;
  if (n >= cap || number == 0) return false;
  memcpy(out, TRASH, n);
  return pv_scan_folder_name(&place, number, out + n, cap - n);
}

static int open_folder(int at, const char *name) {
  return openat(at, name, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
}

// --- removing ------------------------------------------------------------------------------------

// A scan has files alone. A folder below it, which is not of ours, keeps it.
static int remove_scan(int folder_fd, const char *name) {
  const int fd = open_folder(folder_fd, name);
  DIR *d = fd < 0 ? NULL : fdopendir(fd);
  if (!d) {
    const int e = errno;
    if (fd >= 0) close(fd);
    return e;
  }
  for (const struct dirent *e; (e = readdir(d));)
    if (strcmp(e->d_name, ".") != 0 && strcmp(e->d_name, "..") != 0) (void)unlinkat(fd, e->d_name, 0);
  closedir(d);
  return unlinkat(folder_fd, name, AT_REMOVEDIR) == 0 ? 0 : errno;
}

static int move_scan(int folder_fd, const char *base, uint32_t number, bool is_deleted) {
  char from[CAP_NAME], to[CAP_NAME];
  struct stat st;
  if (!name_of(base, number, !is_deleted, from, sizeof from) ||
      !name_of(base, number, is_deleted, to, sizeof to))
    return EINVAL;
  if (fstatat(folder_fd, to, &st, AT_SYMLINK_NOFOLLOW) == 0) return EEXIST;
  return renameat(folder_fd, from, folder_fd, to) == 0 ? 0 : errno;
}

// --- listing -------------------------------------------------------------------------------------

static bool look_at(int folder_fd, const char *name, pv_scan *out) {
  struct stat st;
  int64_t made_s[PV_N_SCAN_FILE] = {0};
  const int fd = open_folder(folder_fd, name);
  DIR *d = fd < 0 ? NULL : fdopendir(fd);
  if (!d) {
    if (fd >= 0) close(fd);
    return false;
  }
  for (const struct dirent *e; (e = readdir(d));) {
    if (fstatat(fd, e->d_name, &st, AT_SYMLINK_NOFOLLOW) != 0 || !S_ISREG(st.st_mode)) continue;
    out->bytes += (uint64_t)st.st_size;
    for (int k = 0; k < PV_N_SCAN_FILE; k++)
      if (!strcmp(e->d_name, pv_scan_file_name(k))) {
        out->file_bytes[k] = (uint64_t)st.st_size;
        made_s[k] = st.st_mtime;
      }
  }
  closedir(d);
  out->time_s = made_s[0];
  for (int k = PV_N_SCAN_FILE - PV_N_SCAN_MADE; k < PV_N_SCAN_FILE; k++)
    if (made_s[k] < out->time_s) out->file_bytes[k] = 0; // of an earlier model
  return out->file_bytes[0] > 0;                         // without a model it is none yet
}

static int newer_first(const void *a, const void *b) {
  const pv_scan *x = a, *y = b;
  return (x->number < y->number) - (x->number > y->number);
}

// The newest PV_CAP_SCANS; deleted ones that cannot be restored any more go.
static int list(int folder_fd, const char *base, pv_scans_answer *a) {
  const int fd = open_folder(folder_fd, ".");
  DIR *d = fd < 0 ? NULL : fdopendir(fd);
  if (!d) {
    const int e = errno;
    if (fd >= 0) close(fd);
    return e;
  }
  for (const struct dirent *e; (e = readdir(d));) {
    const bool is_deleted = !strncmp(e->d_name, TRASH, strlen(TRASH));
    pv_scan s = {.number = number_of(base, e->d_name + (is_deleted ? strlen(TRASH) : 0)),
                 .is_deleted = is_deleted};
    struct stat st;
    if (!s.number) continue;
    // Renaming a folder sets its change time
    if (is_deleted && fstatat(folder_fd, e->d_name, &st, AT_SYMLINK_NOFOLLOW) == 0 &&
        time(NULL) - st.st_ctime > PV_UNDO_S) {
      (void)remove_scan(folder_fd, e->d_name);
      continue;
    }
    if (!look_at(folder_fd, e->d_name, &s)) continue;
    uint32_t i = a->n;
    if (i < PV_CAP_SCANS) a->n++;
    else // the oldest makes room
      for (i = 0; i < PV_CAP_SCANS && a->scan[i].number >= s.number; i++) continue;
    if (i < PV_CAP_SCANS) a->scan[i] = s;
  }
  closedir(d);
  qsort(a->scan, a->n, sizeof *a->scan, newer_first);
  return 0;
}

static int open_file(int folder_fd, const char *base, const pv_scans_ask *ask, pv_scans_answer *a, int *out) {
  char name[CAP_NAME];
  struct stat st;
  const char *file = pv_scan_file_name(ask->file < PV_N_SCAN_FILE ? (int)ask->file : -1);
  if (!file || !name_of(base, ask->number, false, name, sizeof name)) return EINVAL;
  const int folder = open_folder(folder_fd, name);
  if (folder < 0) return errno;
  const int fd = openat(folder, file, O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);
  int e = fd < 0 ? errno : 0;
  close(folder);
  if (!e && (fstat(fd, &st) != 0 || !S_ISREG(st.st_mode))) e = ENOENT;
  const int64_t from = e || ask->from >= 0 ? ask->from : ask->from < -st.st_size ? 0 : st.st_size + ask->from;
  if (!e && from && lseek(fd, (off_t)from, SEEK_SET) < 0) e = errno;
  if (e) {
    if (fd >= 0) close(fd);
    return e;
  }
  a->file_bytes = (uint64_t)st.st_size;
  *out = fd;
  return 0;
}

void pv_scans_do(int folder_fd, const char *base, const pv_scans_ask *ask, pv_scans_answer *a, int *file_fd) {
  struct statvfs disk;
  char name[CAP_NAME];
  memset(a, 0, sizeof *a);
  *file_fd = -1;
  if (fstatvfs(folder_fd, &disk) == 0) {
    a->free_bytes = (uint64_t)disk.f_bavail * disk.f_frsize;
    a->total_bytes = (uint64_t)disk.f_blocks * disk.f_frsize;
  }
  switch (ask->op) {
  case PV_SCANS_LIST: a->error = list(folder_fd, base, a); break;
  case PV_SCANS_OPEN: a->error = open_file(folder_fd, base, ask, a, file_fd); break;
  case PV_SCANS_DELETE: a->error = move_scan(folder_fd, base, ask->number, true); break;
  case PV_SCANS_RESTORE: a->error = move_scan(folder_fd, base, ask->number, false); break;
  case PV_SCANS_PURGE:
    a->error = name_of(base, ask->number, true, name, sizeof name) ? remove_scan(folder_fd, name) : EINVAL;
    break;
  default: a->error = EINVAL;
  }
}

// --- the process ---------------------------------------------------------------------------------

static bool reply(int fd, const pv_scans_answer *a, int file_fd) {
  union {
    struct cmsghdr head;
    char room[CMSG_SPACE(sizeof(int))];
  } control;
  struct iovec part = {(void *)(uintptr_t)a, sizeof *a};
  struct msghdr m = {.msg_iov = &part, .msg_iovlen = 1};
  if (file_fd >= 0) {
    memset(&control, 0, sizeof control);
    m.msg_control = control.room;
    m.msg_controllen = sizeof control.room;
    struct cmsghdr *c = CMSG_FIRSTHDR(&m);
    c->cmsg_level = SOL_SOCKET;
    c->cmsg_type = SCM_RIGHTS;
    c->cmsg_len = CMSG_LEN(sizeof file_fd);
    memcpy(CMSG_DATA(c), &file_fd, sizeof file_fd);
  }
  return sendmsg(fd, &m, MSG_NOSIGNAL) == (ssize_t)sizeof *a;
}

// Until the server is gone.
static void serve(int fd, int folder_fd, const char *base) {
  static pv_scans_answer a;
  pv_scans_ask ask;
  for (;;) {
    const ssize_t n = read(fd, &ask, sizeof ask);
    if (n < 0 && errno == EINTR) continue;
    if (n != (ssize_t)sizeof ask) return;
    int file_fd;
    pv_scans_do(folder_fd, base, &ask, &a, &file_fd);
    const bool is_sent = reply(fd, &a, file_fd);
    if (file_fd >= 0) close(file_fd);
    if (!is_sent) return;
  }
}

sv_status pv_scans_start(const pv_scans_place *p, int *fd, sv_err *err) {
  int ends[2];
  *fd = -1;
  const int folder = open(p->folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (folder < 0)
    return sv_fail(err, SV_E_NOT_FOUND, "%s: the scans cannot be read (%s)", p->folder,
                   sv_linux_reason(errno));
  if (socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, ends) != 0) {
    close(folder);
    return sv_fail(err, SV_E_DEVICE, "no socket for the scans (%s)", sv_linux_reason(errno));
  }
  const pid_t parent = getpid(), pid = fork();
  if (pid == 0) {
    close(ends[0]);
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    if (getppid() == parent && pv_sandbox_enter_folder(folder, ends[1])) serve(ends[1], folder, p->name);
    _exit(0);
  }
  close(ends[1]);
  close(folder);
  if (pid < 0) {
    close(ends[0]);
    return sv_fail(err, SV_E_DEVICE, "no process for the scans (%s)", sv_linux_reason(errno));
  }
  *fd = ends[0];
  return SV_OK;
}
