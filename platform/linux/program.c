// SPDX-License-Identifier: Apache-2.0
// The first and the last thing that a program does.
#include <errno.h>
#include <signal.h>
#include <spawn.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "platform/linux/linux.h"

extern char **environ;

static int g_print_error; // errno of the first write to stdout that failed

void sv_linux_begin_program(void) {
  struct sigaction a;
  memset(&a, 0, sizeof a);
  a.sa_handler = SIG_IGN;
  (void)sigaction(SIGXFSZ, &a, NULL);
}

void sv_linux_print(int fd, const char *text, size_t bytes) {
  const int e = sv_linux_write_all(fd, text, bytes, NULL);
  if (e && fd == 1 && !g_print_error) g_print_error = e;
}

int sv_linux_end_program(const char *program, int code) {
  // errno is that of the flush; an earlier failure leaves the stream's error flag alone.
  errno = 0;
  const bool is_bad = fflush(stdout) != 0 || ferror(stdout);
  if (is_bad && !g_print_error) g_print_error = errno ? errno : EIO;
  if (!g_print_error || g_print_error == EPIPE) return code;
  fprintf(stderr, "%s: the results could not be printed to stdout: %s\n", program,
          sv_linux_reason(g_print_error));
  return code ? code : 1;
}

pid_t sv_linux_spawn(char *const *argv, bool has_session) {
  posix_spawnattr_t attr;
  sigset_t none, usual;
  pid_t pid = 0;
  if (posix_spawnattr_init(&attr)) return 0;
  sigemptyset(&none);
  sigemptyset(&usual);
  sigaddset(&usual, SIGINT);
  sigaddset(&usual, SIGTERM);
  posix_spawnattr_setsigmask(&attr, &none);
  posix_spawnattr_setsigdefault(&attr, &usual);
  posix_spawnattr_setflags(&attr, (short)(POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF |
                                          (has_session ? POSIX_SPAWN_SETSID : POSIX_SPAWN_SETPGROUP)));
  if (posix_spawn(&pid, argv[0], NULL, &attr, argv, environ) != 0) pid = 0;
  posix_spawnattr_destroy(&attr);
  return pid;
}
