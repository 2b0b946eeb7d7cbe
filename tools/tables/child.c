// SPDX-License-Identifier: Apache-2.0
// A command of this program as a child process: a run's peak memory is its own, and a crash is not
// ours.
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include "src/base/str.h"
#include "tools/tables/tables.h"

#define TICK_MS      250
#define PATIENCE_S   20 // for a child that was asked to stop
#define CAP_SENTENCE 200

// In the child: never returns.
static void become(const tables_child *c, int out, pid_t parent) {
  int in = open("/dev/null", O_RDONLY), log = open(c->log, O_WRONLY | O_CREAT | O_APPEND | O_NOFOLLOW, 0666);
  // Ctrl-C on the terminal goes to the parent, which passes it on once; a second one would kill.
  setpgid(0, 0);
  prctl(PR_SET_PDEATHSIG, SIGTERM);
  if (getppid() != parent) _exit(126); // it died before that
  if (in < 0 || log < 0 || dup2(in, 0) < 0 || dup2(out, 1) < 0 || dup2(log, 2) < 0) _exit(126);
  execv("/proc/self/exe", c->argv);
  execv(c->program, c->argv); // where /proc is not there, or does not say who we are
  _exit(127);
}

// Reads until the other end is closed, that is until the child has ended.
static void collect(const tables_child *c, pid_t pid, int fd, char *out, size_t cap) {
  size_t n = 0;
  double asked_s = 0; // since when it is asked to stop
  const sv_console *con = &c->session->console;
  for (;;) {
    struct pollfd p = {.fd = fd, .events = POLLIN};
    char block[4096];
    int got = poll(&p, 1, TICK_MS);
    if (got > 0) {
      ssize_t k = read(fd, block, sizeof block);
      if (k == 0 || (k < 0 && errno != EINTR)) break;
      for (ssize_t i = 0; i < k; i++) // what is too much is lost: no object of ours is that long
        if (n + 1 < cap) out[n++] = block[i];
    }
    if (con->is_stop_requested(con->self)) {
      double now = lab_seconds(c->session);
      if (asked_s == 0) {
        kill(pid, SIGTERM);
        asked_s = now;
      } else if (now - asked_s > PATIENCE_S) kill(pid, SIGKILL);
    } else if (got <= 0) c->tick(c->self);
  }
  out[n] = 0;
}

static sv_status judge(const tables_child *c, int status, sv_err *err) {
  const sv_console *con = &c->session->console;
  char said[CAP_SENTENCE];
  if (con->is_stop_requested(con->self)) return sv_fail(err, SV_E_INTERRUPTED, "stopped by request");
  if (WIFEXITED(status) && WEXITSTATUS(status) == 0) return SV_OK;
  if (WIFSIGNALED(status))
    return sv_fail(err, SV_E_DEVICE, "%s was killed by signal %d; its output: %.120s", c->argv[1],
                   WTERMSIG(status), c->log);
  if (WEXITSTATUS(status) == 127)
    return sv_fail(err, SV_E_DEVICE, "%.120s could not be restarted for %s", c->program, c->argv[1]);
  lab_last_line(c->log, said, sizeof said);
  return sv_fail(err, SV_E_DEVICE, "%s: %s", c->argv[1], *said ? said : "failed without a message");
}

sv_status tables_child_run(const tables_child *c, char *out, size_t cap, sv_err *err) {
  int ends[2], status = 0;
  pid_t parent = getpid();
  out[0] = 0;
  if (pipe2(ends, O_CLOEXEC) < 0) return sv_fail(err, SV_E_DEVICE, "cannot create a pipe to a child process");
  pid_t pid = fork();
  if (pid == 0) become(c, ends[1], parent);
  close(ends[1]);
  if (pid < 0) {
    close(ends[0]);
    return sv_fail(err, SV_E_DEVICE, "cannot start a child process for %s: %s", c->argv[1],
                   sv_linux_reason(errno));
  }
  collect(c, pid, ends[0], out, cap);
  close(ends[0]);
  while (waitpid(pid, &status, 0) < 0)
    if (errno != EINTR) return sv_fail(err, SV_E_DEVICE, "lost the child process for %s", c->argv[1]);
  return judge(c, status, err);
}
