// SPDX-License-Identifier: Apache-2.0
#include <errno.h>
#include <signal.h>
#include <string.h>
#include <unistd.h>

#include "platform/linux/linux.h"
#include "src/base/str.h"

// The only global: a signal handler has no context argument.
static volatile sig_atomic_t g_is_stop_requested;

static void on_signal(int signo) {
  (void)signo;
  g_is_stop_requested = 1;
}

static void put(int fd, const char *text, size_t bytes) {
  while (bytes) {
    ssize_t n = write(fd, text, bytes);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return; // a closed terminal must not stop a capture
    text += n;
    bytes -= (size_t)n;
  }
}

static sv_ns now_ns(void) {
  sv_clock c = sv_linux_clock();
  return c.now_ns(c.self);
}

static void log_line(void *self, sv_log_level level, const char *line) {
  sv_linux_console *c = self;
  if (c->is_quiet && level > SV_LOG_WARN) return;
  bool is_live = level == SV_LOG_LIVE;
  if (is_live && !c->is_terminal) {
    sv_ns t_ns = now_ns();
    if (c->last_live_ns && t_ns - c->last_live_ns < c->live_period_ns) return;
    c->last_live_ns = t_ns;
  }
  char buf[1024];
  sv_str s = sv_str_make(buf, sizeof buf - 8); // room for the line's end, even after a cut
  if (c->is_terminal && (is_live || c->has_live_line)) sv_str_add(&s, "\r\x1b[K");
  sv_str_add(&s, "%s%s", level == SV_LOG_ERROR ? "error: " : level == SV_LOG_WARN ? "warning: " : "", line);
  if (!is_live || !c->is_terminal) buf[s.len++] = '\n';
  put(c->fd, buf, s.len);
  c->has_live_line = is_live && c->is_terminal;
}

static bool is_stop_requested(void *self) {
  (void)self;
  return g_is_stop_requested != 0;
}

void sv_linux_console_init(sv_linux_console *c, int fd, bool is_quiet) {
  *c = (sv_linux_console){.fd = fd, .is_quiet = is_quiet, .live_period_ns = 5 * SV_NS_PER_S};
  c->is_terminal = isatty(fd) == 1;
}

sv_console sv_linux_console_port(sv_linux_console *c) { return (sv_console){c, log_line, is_stop_requested}; }

void sv_linux_console_finish(sv_linux_console *c) {
  if (c->has_live_line) put(c->fd, "\n", 1);
  c->has_live_line = false;
}

// A dropped connection sends SIGHUP twice, from the shell and from the kernel, so the second one
// does not end the program. Under nohup it stays ignored.
static int catch_hangup(void) {
  struct sigaction a, before;
  memset(&a, 0, sizeof a);
  a.sa_handler = on_signal;
  sigemptyset(&a.sa_mask);
  if (sigaction(SIGHUP, NULL, &before) < 0) return -1;
  return before.sa_handler == SIG_IGN ? 0 : sigaction(SIGHUP, &a, NULL);
}

sv_status sv_linux_catch_signals(sv_err *err) {
  struct sigaction a;
  memset(&a, 0, sizeof a);
  a.sa_handler = on_signal;
  a.sa_flags = (int)SA_RESETHAND; // the second one ends the program
  sigemptyset(&a.sa_mask);
  if (sigaction(SIGINT, &a, NULL) < 0 || sigaction(SIGTERM, &a, NULL) < 0 || catch_hangup() < 0)
    return sv_fail(err, SV_E_DEVICE, "the stop signals cannot be caught");
  return SV_OK;
}

void sv_linux_outlive_readers(void) {
  struct sigaction a;
  memset(&a, 0, sizeof a);
  a.sa_handler = SIG_IGN;
  (void)sigaction(SIGPIPE, &a, NULL);
}

void sv_linux_reset_stop(void) { g_is_stop_requested = 0; }
