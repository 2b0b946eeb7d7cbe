// SPDX-License-Identifier: Apache-2.0
// The program of --prior external:CMD.
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <time.h>

#include "tools/train/prior.h"

#define TICK_NS    5000000
#define CAP_LINE   4096
#define PATIENCE_S 5 // for a program that was asked to end

extern char **environ;

static double now_s(void) {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static sv_status start(const char *command, const char *folder, const char *log, pid_t *pid, sv_err *err) {
  char line[CAP_LINE];
  posix_spawnattr_t attr;
  posix_spawn_file_actions_t files;
  sigset_t none, usual;
  if (snprintf(line, sizeof line, "%s \"$0\"", command) >= CAP_LINE)
    return sv_fail(err, SV_E_RANGE, "the command of --prior is longer than %d characters", CAP_LINE - 6);
  char *const argv[] = {(char *)(uintptr_t) "sh", (char *)(uintptr_t) "-c", line, (char *)(uintptr_t)folder,
                        NULL};
  if (posix_spawnattr_init(&attr)) return sv_fail(err, SV_E_NOMEM, "no memory to start a program");
  if (posix_spawn_file_actions_init(&files)) {
    posix_spawnattr_destroy(&attr);
    return sv_fail(err, SV_E_NOMEM, "no memory to start a program");
  }
  sigemptyset(&none);
  sigemptyset(&usual);
  sigaddset(&usual, SIGINT);
  sigaddset(&usual, SIGTERM);
  sigaddset(&usual, SIGXFSZ);
  posix_spawnattr_setsigmask(&attr, &none);
  posix_spawnattr_setsigdefault(&attr, &usual);
  posix_spawnattr_setpgroup(&attr, 0); // it is ended with all that it has started
  posix_spawnattr_setflags(&attr, POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF | POSIX_SPAWN_SETPGROUP);
  int e = posix_spawn_file_actions_addopen(&files, 0, "/dev/null", O_RDONLY, 0);
  if (!e)
    e = posix_spawn_file_actions_addopen(&files, 1, log, O_WRONLY | O_CREAT | O_TRUNC | O_NOFOLLOW, 0666);
  if (!e) e = posix_spawn_file_actions_adddup2(&files, 1, 2);
  if (!e) e = posix_spawn(pid, "/bin/sh", &files, &attr, argv, environ);
  posix_spawn_file_actions_destroy(&files);
  posix_spawnattr_destroy(&attr);
  return e ? sv_fail(err, SV_E_DEVICE, "'%.80s' cannot be started: %s", command, sv_linux_reason(e)) : SV_OK;
}

// Asks, waits a little, then does not ask any more.
static void finish(pid_t pid) {
  const struct timespec tick = {0, TICK_NS};
  const double t0 = now_s();
  int status;
  kill(-pid, SIGTERM);
  while (now_s() - t0 < PATIENCE_S && waitpid(pid, &status, WNOHANG) == 0) nanosleep(&tick, NULL);
  kill(-pid, SIGKILL);
  while (waitpid(pid, &status, 0) < 0 && errno == EINTR) continue;
}

sv_status lab_prior_run(const char *command, const char *folder, const char *log, double limit_s,
                        const sv_console *console, sv_err *err) {
  const struct timespec tick = {0, TICK_NS};
  const double t0 = now_s();
  char said[160];
  int status = 0;
  pid_t pid, got;
  sv_status s = start(command, folder, log, &pid, err);
  if (s != SV_OK) return s;
  while ((got = waitpid(pid, &status, WNOHANG)) == 0 || (got < 0 && errno == EINTR)) {
    const bool is_stop = console->is_stop_requested(console->self);
    if (is_stop || now_s() - t0 > limit_s) {
      finish(pid);
      return is_stop ? sv_fail(err, SV_E_INTERRUPTED, "stopped by request")
                     : sv_fail(err, SV_E_TIMEOUT,
                               "'%.80s' was stopped after %g s (--prior-limit); its output: %.120s", command,
                               limit_s, log);
    }
    nanosleep(&tick, NULL);
  }
  if (got < 0) return sv_fail(err, SV_E_DEVICE, "lost track of '%.80s'", command);
  if (WIFEXITED(status) && WEXITSTATUS(status) == 0) return SV_OK;
  if (WIFSIGNALED(status))
    return sv_fail(err, SV_E_DEVICE, "'%.80s' was killed by signal %d; its output: %.120s", command,
                   WTERMSIG(status), log);
  lab_last_line(log, said, sizeof said);
  return sv_fail(err, SV_E_DEVICE, "'%.80s' failed with exit code %d: %s", command, WEXITSTATUS(status),
                 *said ? said : "it printed nothing");
}
