// SPDX-License-Identifier: Apache-2.0
#include <errno.h>
#include <fcntl.h>
#include <sys/wait.h>
#include <unistd.h>

#include "tools/common/gnuplot.h"

int sv_gnuplot(const char *folder, const char *script, bool is_first) {
  int status = 0;
  pid_t pid = fork();
  if (pid == 0) {
    if (chdir(folder) != 0) _exit(126);
    int null = open("/dev/null", O_RDWR);
    int log =
        open("gnuplot.log", O_WRONLY | O_CREAT | O_APPEND | O_NOFOLLOW | (is_first ? O_TRUNC : 0), 0666);
    if (null < 0 || log < 0 || dup2(null, 0) < 0 || dup2(null, 1) < 0 || dup2(log, 2) < 0) _exit(126);
    execlp("gnuplot", "gnuplot", script, (char *)NULL);
    _exit(127);
  }
  if (pid < 0) return 126;
  while (waitpid(pid, &status, 0) < 0)
    if (errno != EINTR) return 126;
  return WIFEXITED(status) ? WEXITSTATUS(status) : 126;
}
