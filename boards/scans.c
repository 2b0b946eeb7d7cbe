// SPDX-License-Identifier: Apache-2.0
#include "boards/scans.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "boards/board_main.h"

#define CAP_SCANS 10000 // below one folder; numbers have four digits or more

// The number of a scan's folder, 0: it is something else.
static long number_of(const char *name) {
  long long n;
  size_t digits = strspn(name, "0123456789");
  if (digits < 4 || name[digits] || !sv_parse_int(name, digits, &n) || n < 1 || n > 99999999) return 0;
  return (long)n;
}

static bool has(const char *scan, const char *name) {
  char path[SV_LINUX_CAP_PATH + 32];
  sv_fmt(path, sizeof path, "%s/%s", scan, name);
  return access(path, F_OK) == 0;
}

static bool has_files(const char *scan) {
  DIR *d = opendir(scan);
  bool is_found = false;
  for (const struct dirent *e; d && !is_found && (e = readdir(d));) is_found = e->d_name[0] != '.';
  if (d) closedir(d);
  return is_found;
}

// A scan has files alone. A folder below it, which is not of ours, keeps the scan.
static void remove_scan(int folder_fd, const char *name) {
  int fd = openat(folder_fd, name, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
  DIR *d = fd < 0 ? NULL : fdopendir(fd);
  if (!d) {
    if (fd >= 0) close(fd);
    return;
  }
  for (const struct dirent *e; (e = readdir(d));)
    if (strcmp(e->d_name, ".") != 0 && strcmp(e->d_name, "..") != 0) (void)unlinkat(fd, e->d_name, 0);
  closedir(d);
  (void)unlinkat(folder_fd, name, AT_REMOVEDIR);
}

typedef struct {
  long number[CAP_SCANS];
  int n;
} scan_list;

static sv_status list_scans(const char *folder, scan_list *list, sv_err *err) {
  sv_status s = sv_linux_make_dir(folder, err);
  if (s < 0) return s;
  DIR *d = opendir(folder);
  if (!d) return sv_fail(err, SV_E_IO, "%s: cannot be listed: %s", folder, sv_linux_reason(errno));
  list->n = 0;
  for (const struct dirent *e; list->n < CAP_SCANS && (e = readdir(d));) {
    long number = number_of(e->d_name);
    if (number > 0) list->number[list->n++] = number;
  }
  closedir(d);
  return SV_OK;
}

// All but the n newest; numbers differ, so counting the larger ones ranks them.
static void prune(const char *folder, const scan_list *list, int n_kept) {
  int fd = open(folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (fd < 0) return;
  for (int i = 0; i < list->n; i++) {
    int n_newer = 0;
    for (int k = 0; k < list->n; k++) n_newer += list->number[k] > list->number[i];
    char name[32];
    sv_fmt(name, sizeof name, "%04ld", list->number[i]);
    if (n_newer >= n_kept) remove_scan(fd, name);
  }
  close(fd);
}

sv_status scans_next(const char *folder, int n_kept, bool is_new, scans_run *run, sv_err *err) {
  static scan_list list;
  char *out = run->path;
  const size_t cap = run->cap;
  long newest = 0;
  run->is_interrupted = false;
  sv_status s = list_scans(folder, &list, err);
  if (s < 0) return s;
  for (int i = 0; i < list.n; i++)
    if (list.number[i] > newest) newest = list.number[i];
  sv_fmt(out, cap, "%s/%04ld", folder, newest);
  bool is_empty = newest > 0 && !has_files(out);
  bool has_checkpoint = newest > 0 && (has(out, "checkpoint.bin") || has(out, "checkpoint.1.bin"));
  run->is_interrupted = !is_new && has_checkpoint && !has(out, "run.json");
  if (!is_empty && !run->is_interrupted) {
    if (list.n == CAP_SCANS) return sv_fail(err, SV_E_IO, "%s: holds %d scans or more", folder, CAP_SCANS);
    if (sv_fmt(out, cap, "%s/%04ld", folder, newest + 1) >= cap)
      return sv_fail(err, SV_E_RANGE, "%s: too long a path", folder);
    list.number[list.n++] = newest + 1;
  }
  prune(folder, &list, n_kept);
  return sv_linux_make_dir(out, err);
}
