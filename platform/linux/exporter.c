// SPDX-License-Identifier: Apache-2.0
#include "platform/linux/exporter.h"

#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "platform/linux/linux.h"
#include "src/base/str.h"

#define MEMORY_BYTES ((rlim_t)512 << 20) // SOG of 200,000 Gaussians of degree 3 takes 210 MiB
#define NICE         19

const char *sv_linux_export_format(int i) {
  static const char *const names[] = {"sog", "html", "glb"};
  return i < 0 || (size_t)i >= sizeof names / sizeof *names ? NULL : names[i];
}

bool sv_linux_exporter_open(sv_linux_exporter *e) {
  *e = (sv_linux_exporter){0};
  ssize_t n = readlink("/proc/self/exe", e->program, sizeof e->program - 32);
  while (n > 0 && e->program[n - 1] != '/') n--;
  if (n <= 0) n = 0;
  sv_copy(e->program + n, sizeof e->program - (size_t)n, "subview-lab");
  if (n == 0 || access(e->program, X_OK) != 0) e->program[0] = 0;
  return e->program[0] != 0;
}

static void start(sv_linux_exporter *e) {
  const struct rlimit memory = {MEMORY_BYTES, MEMORY_BYTES};
  const pid_t pid = sv_linux_spawn(e->argv, false);
  if (!pid) return;
  e->pid = pid;
  (void)prlimit(pid, RLIMIT_DATA, &memory, NULL);
  (void)setpriority(PRIO_PROCESS, (id_t)pid, NICE);
}

static bool is_newer(const char *file, const char *than) {
  struct stat a, b;
  return stat(file, &a) == 0 && stat(than, &b) == 0 && a.st_mtime >= b.st_mtime;
}

bool sv_linux_exporter_make(sv_linux_exporter *e, const char *folder, int i_format) {
  const char *format = sv_linux_export_format(i_format);
  if (!e->program[0] || e->pid > 0 || !format) return false;
  const size_t cap = sizeof e->model;
  if (sv_fmt(e->model, cap, "%s/model.ply", folder) >= cap ||
      sv_fmt(e->made, cap, "%s/model.%s", folder, format) >= cap ||
      sv_fmt(e->part, cap, "%s/export-part.%s", folder, format) >= cap)
    return false;
  if (access(e->model, R_OK) != 0) return false;
  if (is_newer(e->made, e->model)) return true;
  char *argv[] = {e->program, "export", "--model", e->model, "--format", (char *)(uintptr_t)format,
                  "--out",    e->part,  "--quiet", NULL};
  memcpy(e->argv, argv, sizeof argv);
  start(e);
  return e->pid > 0;
}

// status: of waitpid.
static void finish(sv_linux_exporter *e, int status) {
  e->pid = 0;
  if (!WIFEXITED(status) || WEXITSTATUS(status) != 0 || rename(e->part, e->made) != 0) (void)unlink(e->part);
}

void sv_linux_exporter_step(sv_linux_exporter *e) {
  int status;
  if (e->pid > 0 && waitpid(e->pid, &status, WNOHANG) == e->pid) finish(e, status);
}

void sv_linux_exporter_close(sv_linux_exporter *e) {
  int status;
  if (e->pid <= 0) return;
  kill(e->pid, SIGKILL);
  if (waitpid(e->pid, &status, 0) == e->pid) finish(e, status);
}
